"""Lags of spindle and feed servo."""

import math

import pytest

from tests.turning_env.playing import UNDISTURBED, changed
from turning_env import RoughTurningEnv


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
