"""Lags of spindle and feed servo."""

import math

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, infos


def test_commands_are_followed_with_the_time_constants():
    scenario = changed(
        UNDISTURBED,
        machine={"spindle_time_constant": 2.0, "feed_time_constant": 0.5},
        control={"interval": 1, "initial_cutting_speed": 50, "initial_feed": 0.06},
    )
    for seconds, info in enumerate(infos(scenario, [(1.0, 1.0)] * 4), start=1):
        expected_speed = 200 - 150 * math.exp(-seconds / 2.0)
        expected_feed = 0.60 - 0.54 * math.exp(-seconds / 0.5)
        assert info["commanded_cutting_speed"] == 200
        assert info["commanded_feed"] == 0.60
        assert info["cutting_speed"] == pytest.approx(expected_speed, rel=1e-12)
        assert info["feed"] == pytest.approx(expected_feed, rel=1e-12)


@pytest.mark.parametrize("delay", [0.25, 1.0, 2.5, 4.0])
def test_a_delayed_command_acts_after_its_dead_time(delay):
    scenario = changed(
        UNDISTURBED,
        machine={
            "spindle_time_constant": 0.0,
            "feed_time_constant": 0.0,
            "command_delay": delay,
        },
        control={"interval": 1, "sub_steps": 100},
    )
    control = scenario.control
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 2))
    paths = [0.0]
    products = [control.initial_cutting_speed * control.initial_feed]
    for info in infos(scenario, actions):
        paths.append(info["path"])
        products.append(info["commanded_cutting_speed"] * info["commanded_feed"])

    # Every step cuts with the command of `delay` seconds before: at first with the older of two
    # commands, for the rest of the delay that is no whole number of steps.
    whole = math.ceil(delay)
    rest = delay - whole + 1
    padded = [products[0]] * whole + products
    path_per_product = 1000.0 / (math.pi * scenario.workpiece.diameter) / 60.0
    expected = []
    for k in range(1, 13):
        mean_product = rest * padded[k] + (1 - rest) * padded[k + 1]
        expected.append(path_per_product * mean_product)
    assert np.diff(paths) == pytest.approx(expected)
