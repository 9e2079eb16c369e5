"""Lags of spindle and feed servo."""

import math

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, infos


def test_commands_are_followed_with_the_time_constants():
    lags = {"spindle_time_constant": 2.0, "feed_time_constant": 0.5}
    control = {"interval": 1, "initial_cutting_speed": 50, "initial_feed": 0.06}
    scenario = changed(UNDISTURBED, machine=lags, control=control)
    for seconds, info in enumerate(infos(scenario, [(1.0, 1.0)] * 4), 1):
        assert (info["commanded_cutting_speed"], info["commanded_feed"]) == (200, 0.60)
        assert info["cutting_speed"] == pytest.approx(
            200 - 150 * math.exp(-seconds / 2.0), rel=1e-12
        )
        assert info["feed"] == pytest.approx(0.60 - 0.54 * math.exp(-seconds / 0.5), rel=1e-12)


@pytest.mark.parametrize("delay", [0.25, 1.0, 2.5, 4.0])
def test_a_delayed_command_acts_after_its_dead_time(delay):
    machine = {"spindle_time_constant": 0.0, "feed_time_constant": 0.0, "command_delay": delay}
    scenario = changed(UNDISTURBED, machine=machine, control={"interval": 1, "sub_steps": 100})
    control, commanded, paths = scenario.control, [], [0.0]
    velocities = [control.initial_cutting_speed * control.initial_feed]
    for info in infos(scenario, np.random.default_rng(0).uniform(-1.0, 1.0, (12, 2))):
        commanded.append((info["commanded_cutting_speed"], info["commanded_feed"]))
        velocities.append(math.prod(commanded[-1]))
        paths.append(info["path"])
    # Every step cuts with the command of `delay` before: the part of it that came then, and before that the one before.
    whole = math.ceil(delay)
    late = delay - whole + 1
    padded = [velocities[0]] * whole + velocities
    turn = 1000.0 / (math.pi * scenario.workpiece.diameter) / 60.0
    expected = [turn * (late * padded[k] + (1 - late) * padded[k + 1]) for k in range(1, 13)]
    assert np.diff(paths) == pytest.approx(expected)
