"""A short task, policies that always act alike, and made-up results."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from baselines.policy_spec import PolicySpec
from leaderboard import run
from leaderboard.play import EPISODE_FIELDS
from leaderboard.result import Result, Task, read_file, result_folder
from turning_env import Scenario
from turning_env.policy import Actions, Observations

ENV_ID = "RoughTurning-v0"
MakeResult = Callable[..., Result]


class Steady:
    """A policy that always acts alike."""

    def __init__(self, num_envs: int, action: tuple[float, float]) -> None:
        self._actions = np.tile(np.array(action, np.float32), (num_envs, 1))

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Nothing to forget."""

    def act(self, observations: Observations) -> Actions:
        assert len(observations) == len(self._actions)
        return self._actions


def spec(
    name: str, action: tuple[float, float] = (0.0, 0.0), seed: int | None = None, **fields: object
) -> PolicySpec:
    """Return a policy that always acts alike: a rule, with a training seed an agent."""
    kind = "rule" if seed is None else "agent"
    parameters = {"speed": action[0], "feed": action[1]}
    values = {
        "name": name,
        "kind": kind,
        "description": "made up",
        "parameters": parameters,
        "training_seed": seed,
        "make": lambda num_envs: Steady(num_envs, action),
    }
    return PolicySpec.model_validate(values | fields)


def on(scenario: Scenario) -> Task:
    """Return a task of one seed on a scenario."""
    return Task(env_id=ENV_ID, scenario=scenario, seeds=[7])


def only(path: Path) -> Result:
    """Return the only result in a file."""
    (result,) = read_file(path)
    return result


def play_all(
    task: Task,
    policies: Sequence[PolicySpec],
    folder: Path,
    fresh: bool = False,
    *,
    replace: bool = False,
) -> None:
    """Have policies play a task in this process, and write the results into a folder."""
    run.play_all([run.TaskRun(task, policies, folder)], fresh, replace=replace)


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    """Twelve steps, then the time is up."""
    return Scenario.model_validate({"control": {"time_limit": 0.2}})


@pytest.fixture(scope="session")
def task(scenario: Scenario) -> Task:
    return Task(env_id=ENV_ID, scenario=scenario, seeds=[7, 8, 9, 10])


@pytest.fixture
def folder(tmp_path: Path, scenario: Scenario) -> Path:
    return result_folder(tmp_path / "results", ENV_ID, scenario.name)


@pytest.fixture(scope="session")
def make_result(task: Task) -> MakeResult:
    """Makes a result with the given values; otherwise it is a plain minute of cutting."""
    plain = {
        "time": 60.0,
        "engaged_time": 60.0,
        "removed": 100.0,
        "used_life": 0.5,
        "truncated": 1.0,
    }

    def make(
        name: str,
        seed: int | None = None,
        policy: PolicySpec | None = None,
        on: Task = task,
        returns: object = 0.0,
        **values: object,
    ) -> Result:
        filled = dict.fromkeys(EPISODE_FIELDS, 0.0) | plain | {"return": returns} | values
        episodes = {}
        for field, given in filled.items():
            episodes[field] = np.broadcast_to(np.asarray(given, np.float64), len(on.seeds))
        return Result.of(on, policy or spec(name, seed=seed), episodes)

    return make
