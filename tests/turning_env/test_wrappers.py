"""The feed switch: grades, errors, Gymnasium's contract."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Discrete, MultiDiscrete
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from stable_baselines3.common.env_checker import check_env as check_env_for_agents

from tests.turning_env.playing import changed
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.wrappers import FEED_GRADES, FeedSwitch, VectorFeedSwitch

OVERRIDE = Scenario.load("override")
PERCENT = [0, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130, 150, 150]


def commanded_override(scenario: Scenario, grade: int) -> float:
    """Override [-] that the environment reports after one interval at a grade."""
    env = FeedSwitch(RoughTurningEnv(scenario))
    env.reset(seed=0)
    *_, info = env.step(np.int64(grade))
    return float(info["commanded_feed"] / scenario.control.initial_feed)


def test_the_table_has_16_grades() -> None:
    assert [round(100 * grade, 9) for grade in FEED_GRADES] == PERCENT


@pytest.mark.parametrize("grade", range(16))
def test_a_grade_is_the_override_of_the_table(grade: int) -> None:
    least = OVERRIDE.machine.feed_min / OVERRIDE.control.initial_feed  # of grade 0, 1 % is left
    assert commanded_override(OVERRIDE, grade) == pytest.approx(max(PERCENT[grade] / 100, least), abs=1e-6)


@pytest.mark.parametrize(("grade", "expected"), [(9, 0.9), (12, 1.2), (13, 1.2), (15, 1.2)])
def test_grades_above_the_highest_override_are_clipped_to_it(grade: int, expected: float) -> None:
    scenario = changed(OVERRIDE, control={"override_max": 1.2})
    assert commanded_override(scenario, grade) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("env_id", ["RoughTurning-Override-v0", "RoughTurning-Surface-v0"])
@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")  # as it should be
def test_checkers_are_content(env_id: str) -> None:
    check_env(FeedSwitch(gymnasium.make(env_id)))
    check_env_for_agents(FeedSwitch(gymnasium.make(env_id)))


def test_it_wraps_what_is_made_and_can_be_made_again() -> None:
    env = FeedSwitch(gymnasium.make("RoughTurning-Override-v0"))
    assert env.action_space == Discrete(16)
    env.reset(seed=1)
    env.step(env.action_space.sample())
    assert env.spec is not None
    again = gymnasium.make(env.spec)
    assert isinstance(again, FeedSwitch)
    first, second = ([*env.reset(seed=3), *env.step(np.int64(4))] for env in (env, again))
    assert first[0].tobytes() == second[0].tobytes()
    assert first[3] == second[3]


@pytest.mark.parametrize("grade", [-1, 16, 3.0, np.float32(3), [3], None, "3"])
def test_what_is_no_grade_is_refused_and_nothing_moves(grade: Any) -> None:
    env, untouched = (FeedSwitch(RoughTurningEnv(OVERRIDE)) for _ in range(2))
    env.reset(seed=1)
    untouched.reset(seed=1)
    with pytest.raises(ValueError, match="a grade must be a whole number, 0 to 15, got"):
        env.step(grade)
    assert env.step(np.int64(3))[1:] == untouched.step(np.int64(3))[1:]


@pytest.mark.parametrize("grades", [[0, 16], [-1, 3], [0.0, 1.0], [1], [1, 2, 3], [[1, 2]], [None, 1], "ab"])
def test_what_are_no_grades_of_the_lanes_is_refused(grades: Any) -> None:
    envs = VectorFeedSwitch(RoughTurningVectorEnv(2, OVERRIDE))
    envs.reset(seed=1)
    with pytest.raises(ValueError, match="grades must be 2 whole numbers, 0 to 15, got"):
        envs.step(grades)


@pytest.mark.parametrize("preset", ["rough_turning", "paper", "shift", "batch_casting"])
def test_tasks_without_an_override_are_refused(preset: str) -> None:
    scenario = Scenario.load(preset)
    said = f"control.action \"override\".*'{preset}' they are '{scenario.control.action}'"
    with pytest.raises(ValueError, match=said):
        FeedSwitch(RoughTurningEnv(scenario))
    with pytest.raises(ValueError, match=said):
        VectorFeedSwitch(RoughTurningVectorEnv(2, scenario))


def test_a_task_whose_edges_are_changed_on_command_is_refused() -> None:
    with pytest.raises(ValueError, match="'commanded'"):
        FeedSwitch(RoughTurningEnv(changed(OVERRIDE, control={"edge_changes": "commanded"})))


def test_other_environments_are_refused() -> None:
    with pytest.raises(ValueError, match="needs a RoughTurning environment"):
        FeedSwitch(gymnasium.make("CartPole-v1"))


def test_lanes_are_the_single_environments() -> None:
    lanes = 3
    envs = VectorFeedSwitch(gymnasium.make_vec("RoughTurning-Override-v0", lanes, vectorization_mode="vector_entry_point"))
    singles = [FeedSwitch(RoughTurningEnv(OVERRIDE)) for _ in range(lanes)]
    assert isinstance(envs.action_space, MultiDiscrete)
    assert envs.single_action_space == Discrete(16)
    together, _ = envs.reset(seed=5)
    alone = np.array([env.reset(seed=5 + lane)[0] for lane, env in enumerate(singles)])
    assert together.tobytes() == alone.tobytes()
    for step in range(20):
        grades = (step + np.arange(lanes)) % 16
        together, rewards, *_ = envs.step(grades)
        steps = [env.step(grade) for env, grade in zip(singles, grades, strict=True)]
        assert together.tobytes() == np.array([step[0] for step in steps]).tobytes()
        assert rewards.tolist() == [step[1] for step in steps]


def test_samples_of_the_batched_space_are_taken() -> None:
    envs = VectorFeedSwitch(RoughTurningVectorEnv(4, OVERRIDE, AutoresetMode.SAME_STEP))
    envs.reset(seed=0)
    envs.action_space.seed(0)
    for _ in range(5):
        _, rewards, *_ = envs.step(envs.action_space.sample())
    assert rewards.shape == (4,)


def test_gymnasiums_own_vector_environments_take_single_switches() -> None:
    envs = SyncVectorEnv([lambda: FeedSwitch(RoughTurningEnv(OVERRIDE))] * 2)
    envs.reset(seed=0)
    _, rewards, *_ = envs.step(np.array([3, 12]))
    assert rewards.shape == (2,)
