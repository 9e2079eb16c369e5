"""Numbers of nominal models by hand, side by side."""

import math

import gymnasium
import numpy as np
import pytest

from baselines.models.nominal_points import MIN_EXPONENT, PointsOfEnvs, nominal_points
from tests.turning_env.playing import changed
from turning_env import FamilyVectorEnv, RoughTurningEnv, Scenario
from turning_env.scenario.plan import MIDDLE, plan_of
from turning_env.scenario.scenario_batch import ScenarioBatch

PLAIN = Scenario()
BASED = changed(
    PLAIN,
    material={
        "power": PLAIN.material.power.model_dump() | {"feed": 0.1},
        "thrust_force": PLAIN.material.thrust_force.model_dump() | {"feed": 0.7},
    },
    spindle={"base_speed": 1000.0 / math.pi},
    machine={"feed_min": 0.1, "feed_max": 0.5},
)


def test_the_numbers_of_models_side_by_side() -> None:
    batch = ScenarioBatch.of([PLAIN, BASED])
    points = nominal_points(batch)
    plan = plan_of(batch)
    assert points.log_speeds == pytest.approx(np.log(plan.speed))
    assert points.log_speed == pytest.approx(np.log(plan.speed[:, MIDDLE]))
    assert points.log_feed == pytest.approx(np.log(plan.feed[:, MIDDLE]))
    assert points.log_base_speed == pytest.approx([-math.inf, math.log(100.0)])
    assert np.exp(points.log_lowest_feed) == pytest.approx([0.06, 0.1])
    assert np.exp(points.log_highest_feed) == pytest.approx([0.6, 0.5])
    # An exponent of 0.1 would make steps too large.
    assert points.power_exponent == pytest.approx([0.627, 0.2])
    assert points.force_exponent == pytest.approx([0.236, 0.7])
    assert MIN_EXPONENT == 0.2


def test_an_environment_gets_the_numbers_of_another_model() -> None:
    points = nominal_points(ScenarioBatch.of([PLAIN, PLAIN]))
    points.set(1, nominal_points(ScenarioBatch.of([BASED])), row=0)
    expected = nominal_points(ScenarioBatch.of([PLAIN, BASED]))
    for found, numbers in zip(points, expected, strict=True):
        np.testing.assert_array_equal(found, numbers)


def test_points_follow_the_jobs_of_a_family() -> None:
    env = FamilyVectorEnv(3)
    points = PointsOfEnvs(env, 3, needed_by="a loop")
    observations, infos = env.reset(seed=0)
    points.follow(infos)
    nominals = [env.family.job(int(job), env.split).scenario.nominal() for job in infos["job"]]
    expected = nominal_points(ScenarioBatch.of(nominals))
    for found, numbers in zip(points.points, expected, strict=True):
        np.testing.assert_array_equal(found, numbers)
    limits = [nominal.limits.power for nominal in nominals]
    assert np.ravel(points.scenario.limits.power).tolist() == limits
    # The first entries are the environment's own.
    reading = points.read(np.concatenate([observations, np.zeros((3, 4), np.float32)], axis=1))
    assert reading.power.shape == (3,)


def test_one_environment_keeps_its_nominal_model() -> None:
    env = RoughTurningEnv(BASED)
    points = PointsOfEnvs(env, 1, needed_by="a loop")
    _, infos = env.reset(seed=0)
    points.follow(infos)
    assert points.points.log_base_speed == pytest.approx([math.log(100.0)])


def test_environments_of_others_are_refused() -> None:
    with pytest.raises(ValueError, match="a loop needs a RoughTurning environment"):
        PointsOfEnvs(gymnasium.make("CartPole-v1"), 1, needed_by="a loop")
