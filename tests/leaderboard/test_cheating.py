"""A policy is given observations and nothing else, by which it can reach nothing else."""

import numpy as np
import pytest
from numpy.typing import NDArray

from baselines.policy_spec import ScenarioId
from leaderboard.play import play
from leaderboard.seeds import HELD_OUT_START, TUNING_START, held_out_seeds, tuning_seeds
from leaderboard.trajectories import record
from tests.leaderboard.conftest import Steady, spec
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.policy import Actions, Observations


class Spy(Steady):
    """Keeps what it is given, under whatever name, and would gladly be told more."""

    def __init__(self, num_envs: int) -> None:
        super().__init__(num_envs, (0.05, 0.1))
        self.given: list[object] = [num_envs]

    def reset(self, *given: object) -> None:  # type: ignore[override]
        self.given += given

    def act(self, *given: object) -> Actions:  # type: ignore[override]
        self.given += given
        return self._actions

    def tell(self, *given: object) -> None:
        """Only oracles are told."""
        raise AssertionError("a policy was told what is hidden")


class Scribbler(Steady):
    """Overwrites the observations that it is given."""

    def act(self, observations: Observations) -> Actions:
        observations[:] = np.nan
        return self._actions


def test_policies_are_given_observations_and_nothing_else(scenario: Scenario) -> None:
    spies: list[Spy] = []

    def make(num_envs: int) -> Spy:
        spies.append(Spy(num_envs))
        return spies[-1]

    play(make, scenario, [7, 8, 9])
    record(spec("spy", make=make), scenario, 7)
    for spy, num_envs in zip(spies, (3, 1), strict=True):
        first, *arrays = spy.given
        assert first == num_envs
        assert arrays
        for array in arrays:
            assert type(array) is np.ndarray
            if array.dtype == np.bool_:
                # The mask of a reset.
                assert array.shape == (num_envs,)
            else:
                assert array.dtype == np.float32
                assert array.shape == (num_envs, 11)


def test_writing_into_observations_changes_nothing(scenario: Scenario) -> None:
    def honest(num_envs: int) -> Steady:
        return Steady(num_envs, (0.05, 0.1))

    def scribbling(num_envs: int) -> Scribbler:
        return Scribbler(num_envs, (0.05, 0.1))

    expected = play(honest, scenario, [7, 8, 9])
    scribbled = play(scribbling, scenario, [7, 8, 9])
    for name, values in expected.items():
        np.testing.assert_array_equal(scribbled[name], values)
    recorded = record(spec("one", make=honest), scenario, 7)
    assert record(spec("one", make=scribbling), scenario, 7).series == recorded.series


@pytest.mark.parametrize("preset", ["rough_turning", "paper", "shift"])
def test_first_observations_do_not_tell_seeds_apart(preset: str) -> None:
    """Nothing is known before the first cut.

    On the other tasks the control knows the bar or a set point, and so does the policy.
    """
    for seeds in (held_out_seeds(64), tuning_seeds(64)):
        observations, _ = RoughTurningVectorEnv(64, Scenario.load(preset)).reset(seed=seeds)
        assert (observations == observations[0]).all()


def test_episodes_stay_with_their_seed(scenario: Scenario) -> None:
    """Later episodes of a seed are never those of another seed."""

    def bars(seed: int, later: int) -> NDArray[np.float64]:
        env = RoughTurningEnv(scenario)
        env.reset(seed=seed)
        for _ in range(later):
            env.reset()
        rows = []
        for _ in range(12):
            *_, info = env.step(np.zeros(2))
            rows.append([info["hardness"], info["depth_of_cut"]])
        return np.array(rows)

    trained = [bars(TUNING_START - 1, later) for later in range(4)]
    for seed in (TUNING_START, HELD_OUT_START):
        for trained_bars in trained:
            assert not np.allclose(bars(seed, 0), trained_bars)


@pytest.mark.parametrize(
    "name",
    ["", "..", "../up", "/abs", "a/b", "a\\b", ".hidden", "a\0b", "\x1b[2J", "a\nb", "a\x9bb"],
)
def test_names_are_names(name: str) -> None:
    with pytest.raises(ValueError, match="cannot be a policy's name"):
        spec(name)
    with pytest.raises(ValueError, match="should match pattern"):
        ScenarioId(name=name, digest="")
    with pytest.raises(ValueError, match="name"):
        Scenario.model_validate({"name": name})
