"""A short task, trivial policies, and results made up to order."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from leaderboard import run
from leaderboard.result import Result, Task
from turning_env import Scenario
from turning_env.score.play import EPISODE_FIELDS
from turning_env.score.policy import Actions, Observations, PolicySpec

ENV_ID = "RoughTurning-v0"
MakeResult = Callable[..., Result]


class Steady:
    """Takes the same action always."""

    def __init__(self, num_envs: int, action: tuple[float, float]) -> None:
        self._actions = np.tile(np.array(action, np.float32), (num_envs, 1))

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Nothing to forget."""

    def act(self, observations: Observations) -> Actions:
        """The same action in every lane."""
        assert len(observations) == len(self._actions)
        return self._actions


def spec(name: str, action: tuple[float, float] = (0.0, 0.0), seed: int | None = None, kind: str | None = None) -> PolicySpec:
    """A rule that always acts alike; with a training seed an agent, or what ``kind`` says."""
    return PolicySpec(
        name=name,
        kind=kind or ("rule" if seed is None else "agent"),  # type: ignore[arg-type]
        description="made up",
        parameters={"speed": action[0], "feed": action[1]},
        training_seed=seed,
        command=None if seed is None else f"train {seed}",
        make=lambda num_envs: Steady(num_envs, action),
    )


def play_all(task: Task, policies: Sequence[PolicySpec], folder: Path, fresh: bool) -> None:
    """Have them all play one task."""
    run.play_all([run.TaskRun(task, policies, folder)], fresh)


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    """Twelve intervals, then the time is up."""
    return Scenario.model_validate({"control": {"time_limit": 0.2}})


@pytest.fixture(scope="session")
def task(scenario: Scenario) -> Task:
    """Four episodes."""
    return Task(env_id=ENV_ID, scenario=scenario, seeds=[7, 8, 9, 10])


@pytest.fixture
def folder(tmp_path: Path, scenario: Scenario) -> Path:
    """Where the results of the environment on the scenario lie."""
    return tmp_path / "results" / ENV_ID / scenario.name


@pytest.fixture(scope="session")
def make_result(task: Task) -> MakeResult:
    """Makes a result with the given values, and a plain minute of cutting where nothing is given."""
    plain = {"time": 60.0, "engaged_time": 60.0, "removed": 100.0, "used_life": 0.5, "truncated": 1.0}

    def make(name: str, seed: int | None = None, kind: str | None = None, **values: object) -> Result:
        count = len(task.seeds)
        episodes = {field: np.broadcast_to(np.float64(plain.get(field, 0.0)), count) for field in EPISODE_FIELDS}
        episodes |= {field: np.broadcast_to(np.asarray(value, np.float64), count) for field, value in values.items()}
        return Result.of(task, spec(name, seed=seed, kind=kind), episodes)

    return make
