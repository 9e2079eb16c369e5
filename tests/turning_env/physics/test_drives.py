"""Lags of spindle and feed servo."""

import math

import pytest

from tests.turning_env.playing import UNDISTURBED, changed
from turning_env import RoughTurningEnv
from turning_env.physics.drives import lag_share


def test_share_is_exact_for_any_split_of_time():
    assert 1 - lag_share(0.7, 0.4) == pytest.approx((1 - lag_share(0.1, 0.4)) ** 7, rel=1e-12)
    assert lag_share(0.4, 0.4) == pytest.approx(1 - math.exp(-1))
    assert lag_share(0.1, 0) == 1.0


def test_commands_are_followed_with_the_time_constants():
    lags = {"spindle_time_constant": 2.0, "feed_time_constant": 0.5}
    control = {"interval": 1, "initial_cutting_speed": 50, "initial_feed": 0.06}
    env = RoughTurningEnv(changed(UNDISTURBED, machine=lags, control=control))
    env.reset(seed=0)
    for seconds in range(1, 5):
        *_, info = env.step((1.0, 1.0))
        assert (info["commanded_cutting_speed"], info["commanded_feed"]) == (200, 0.60)
        assert info["cutting_speed"] == pytest.approx(200 - 150 * math.exp(-seconds / 2.0), rel=1e-12)
        assert info["feed"] == pytest.approx(0.60 - 0.54 * math.exp(-seconds / 0.5), rel=1e-12)


def test_torque_times_angular_velocity_is_power():
    env = RoughTurningEnv(UNDISTURBED)
    env.reset(seed=0)
    *_, info = env.step((0.0, 0.0))
    assert info["torque"] * 2 * math.pi * info["spindle_speed"] / 60 == pytest.approx(1000 * info["power"], rel=1e-12)
