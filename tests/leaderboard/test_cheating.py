"""A policy is given observations and nothing else, by which it can reach nothing else."""

import numpy as np
import pytest
from numpy.typing import NDArray

from leaderboard.oracles import references
from leaderboard.result import MadeFor, PolicyRecord
from leaderboard.trajectories import play_course
from tests.leaderboard.conftest import Steady, record_of
from turning_env import IDS, RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.score.play import play
from turning_env.score.policy import Actions, Observations
from turning_env.score.seeds import HELD_OUT_START, TUNING_START, held_out_seeds, tuning_seeds


class Spy(Steady):
    """Keeps what it is given, under whatever name, and would gladly be told more."""

    def __init__(self, num_envs: int) -> None:
        super().__init__(num_envs, (0.05, 0.1))
        self.given: list[object] = [num_envs]

    def reset(self, *given: object) -> None:  # type: ignore[override]
        """Which lanes."""
        self.given += given

    def act(self, *given: object) -> Actions:  # type: ignore[override]
        """On observations."""
        self.given += given
        return self._actions

    def tell(self, *given: object) -> None:
        """Only references are told."""
        raise AssertionError("a policy was told what is hidden")


class Scribbler(Steady):
    """Writes over what it is given."""

    def act(self, observations: Observations) -> Actions:
        """After all has been seen."""
        observations[:] = np.nan
        return self._actions


def test_policies_are_given_observations_and_nothing_else(scenario: Scenario) -> None:
    spies: list[Spy] = []

    def make(num_envs: int) -> Spy:
        spies.append(Spy(num_envs))
        return spies[-1]

    play(make, scenario, [7, 8, 9])
    play_course(make, scenario, 7, ["wear"])
    for spy, lanes in zip(spies, (3, 1), strict=True):
        assert spy.given[0] == lanes
        for given in spy.given[1:]:
            assert type(given) is np.ndarray
            assert (given.dtype, given.shape) in ((np.bool_, (lanes,)), (np.float32, (lanes, 11)))


def test_observations_lead_nowhere(scenario: Scenario) -> None:
    env = RoughTurningVectorEnv(3, scenario)
    given = [env.reset(seed=1)[0], env.step(np.zeros((3, 2)))[0]]
    hidden = [env._batch._states, env._batch.table, env._batch._scratches[0]]
    for observations in given:
        assert observations.base is None
        assert not any(np.shares_memory(observations, each) for each in hidden)
    single = RoughTurningEnv(scenario)
    for alone in (single.reset(seed=1)[0], single.step(np.zeros(2))[0]):
        assert alone.base is None


def test_writing_into_observations_changes_nothing(scenario: Scenario) -> None:
    honest, scribbled = (
        play(lambda num_envs, kind=kind: kind(num_envs, (0.05, 0.1)), scenario, [7, 8, 9]) for kind in (Steady, Scribbler)
    )
    for name, values in honest.items():
        np.testing.assert_array_equal(scribbled[name], values)
    courses = [
        play_course(lambda num_envs, kind=kind: kind(num_envs, (0.0, 0.1)), scenario, 7, ["wear"]) for kind in (Steady, Scribbler)
    ]
    assert courses[0] == courses[1]


@pytest.mark.parametrize("preset", ["rough_turning", "paper", "shift"])
def test_first_observations_do_not_tell_draws_apart(preset: str) -> None:
    """Before the first cut; on the other tasks the control is told of the bar or of a reference, and so is the policy."""
    for seeds in (held_out_seeds(64), tuning_seeds(64)):
        observations, _ = RoughTurningVectorEnv(64, Scenario.load(preset)).reset(seed=seeds)
        assert (observations == observations[0]).all()


def test_only_references_are_told_more() -> None:
    for preset in IDS.values():
        assert all(each.policy.kind == "reference" for each in references(Scenario.load(preset)))


def test_episodes_stay_with_their_seed(scenario: Scenario) -> None:
    """After as many episodes as one likes a lane still plays its own seed: those of the next seed are not among them."""
    env = RoughTurningVectorEnv(2, scenario)
    seeds = [TUNING_START - 1, TUNING_START]
    env.reset(seed=seeds)
    for _ in range(5):
        env.reset()
    for _ in range(60):
        env.step(np.zeros((2, 2)))
    blocks = env._batch._states
    assert np.ravel(blocks["seed"])[:2].tolist() == seeds
    assert (np.ravel(blocks["episode"])[:2] > 5).all()

    def bars(seed: int, later: int) -> NDArray[np.float64]:
        alone = RoughTurningEnv(scenario)
        alone.reset(seed=seed)
        for _ in range(later):
            alone.reset()
        infos = [alone.step(np.zeros(2))[4] for _ in range(12)]
        return np.array([[info["hardness"], info["depth_of_cut"]] for info in infos])

    trained = [bars(TUNING_START - 1, later) for later in range(4)]
    for seed in (TUNING_START, HELD_OUT_START):
        assert not any(np.allclose(bars(seed, 0), each) for each in trained)


@pytest.mark.parametrize("name", ["", "..", "../up", "/abs", "a/b", "a\\b", ".hidden", "a\0b", "\x1b[2J", "a\nb", "a\x9bb"])
def test_names_are_names(name: str) -> None:
    with pytest.raises(ValueError, match="cannot be a policy's name"):
        PolicyRecord.model_validate(record_of("plain").model_dump() | {"name": name})
    with pytest.raises(ValueError, match="cannot be a scenario's name"):
        MadeFor(scenario=name, digest="")
    with pytest.raises(ValueError, match="name"):
        Scenario.model_validate({"name": name})
