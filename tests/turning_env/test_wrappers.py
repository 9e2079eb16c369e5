"""The feed switch: grades, errors, Gymnasium's contract."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Discrete, MultiDiscrete
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv
from stable_baselines3.common.env_checker import check_env as check_env_for_agents

from tests.turning_env.playing import changed
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.wrappers import FeedSwitch, VectorFeedSwitch

OVERRIDE = Scenario.load("override")
PERCENT = [0, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100, 110, 120, 130, 150, 150]


@pytest.mark.parametrize(("grade", "most"), [(0, 2.0), (7, 2.0), (14, 2.0), (15, 2.0), (12, 1.2), (13, 1.2)])
def test_a_grade_is_the_override_of_the_table_up_to_the_highest(grade: int, most: float) -> None:
    scenario = changed(OVERRIDE, control={"override_max": most})
    least = OVERRIDE.machine.feed_min / OVERRIDE.control.initial_feed  # of grade 0, 1 % is left
    env = FeedSwitch(RoughTurningEnv(scenario))
    env.reset(seed=0)
    *_, info = env.step(np.int64(grade))
    override = info["commanded_feed"] / scenario.control.initial_feed
    assert override == pytest.approx(min(max(PERCENT[grade] / 100, least), most), abs=1e-6)


@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")  # as it should be
def test_checkers_are_content_and_its_spec_makes_it_again() -> None:
    env = FeedSwitch(gymnasium.make("RoughTurning-Surface-v1"))
    check_env(env)
    check_env_for_agents(env)
    assert env.spec is not None
    again = gymnasium.make(env.spec)
    assert isinstance(again, FeedSwitch)
    first, second = ([*env.reset(seed=3), *env.step(np.int64(4))] for env in (env, again))
    assert first[0].tobytes() == second[0].tobytes()
    assert first[3] == second[3]


@pytest.mark.parametrize("grade", [-1, 16, 3.0, [3], None])
def test_what_is_no_grade_is_refused_and_nothing_moves(grade: Any) -> None:
    env, untouched = (FeedSwitch(RoughTurningEnv(OVERRIDE)) for _ in range(2))
    envs = VectorFeedSwitch(RoughTurningVectorEnv(2, OVERRIDE))
    for each in (env, untouched, envs):
        each.reset(seed=1)
    with pytest.raises(ValueError, match="a grade must be a whole number, 0 to 15, got"):
        env.step(grade)
    for grades in (grade, [0, grade], [1], [1, 2, 3], [[1, 2]]):
        with pytest.raises(ValueError, match=r"grades must be 2 whole numbers, 0 to 15, got|inhomogeneous"):
            envs.step(grades)
    assert env.step(np.int64(3))[1:] == untouched.step(np.int64(3))[1:]


def test_the_vector_wrapper_is_single_ones_side_by_side() -> None:
    ours = VectorFeedSwitch(gymnasium.make_vec("RoughTurning-Override-v0", 3, vectorization_mode="vector_entry_point"))
    theirs = SyncVectorEnv([lambda: FeedSwitch(RoughTurningEnv(OVERRIDE))] * 3)
    assert isinstance(ours.action_space, MultiDiscrete)
    assert ours.single_action_space == Discrete(16)
    assert ours.reset(seed=5)[0].tobytes() == theirs.reset(seed=5)[0].tobytes()
    for step in range(20):
        grades = ours.action_space.sample() if step % 2 else (step + np.arange(3)) % 16
        for our, their in zip(ours.step(grades)[:4], theirs.step(grades)[:4], strict=True):
            assert our.tobytes() == their.tobytes()


@pytest.mark.parametrize("preset", ["rough_turning", "shift", "batch_casting"])
def test_tasks_without_an_override_are_refused(preset: str) -> None:
    for make in (lambda: FeedSwitch(RoughTurningEnv(preset)), lambda: VectorFeedSwitch(RoughTurningVectorEnv(2, preset))):
        with pytest.raises(ValueError, match=r'needs control\.action "override" and no edge changes on command'):
            make()
    with pytest.raises(ValueError, match="needs a RoughTurning environment"):
        FeedSwitch(gymnasium.make("CartPole-v1"))
