"""Lags of spindle and feed servo."""

import math

import numpy as np
import pytest

from tests.turning_env.physics.one_env import ENV, put, records_of
from tests.turning_env.playing import UNDISTURBED, changed, infos
from turning_env.physics.drives import (
    clipped,
    follow_late_command,
    force_from_current,
    lag_share,
    note_command,
    set_point,
    steady_current,
)
from turning_env.scenario.sections import MAX_DELAY


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


@pytest.mark.compiled
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


def test_a_lag_covers_a_share_of_the_way():
    assert lag_share(2.0, 4.0) == pytest.approx(1.0 - math.exp(-0.5))
    assert lag_share(2.0, 0.0) == 1.0
    # Small shares keep their digits.
    assert lag_share(1e-12, 1.0) == pytest.approx(1e-12, rel=1e-9)
    shares = lag_share(2.0, np.array([4.0, 0.0, 1.0]))
    assert shares == pytest.approx([1.0 - math.exp(-0.5), 1.0, 1.0 - math.exp(-2.0)])


@pytest.mark.parametrize(
    ("action", "clip", "value"),
    [(-3.0, -1.0, 100.0), (-1.0, -1.0, 100.0), (0.5, 0.5, 250.0), (1.0, 1.0, 300.0), (4, 1, 300)],
)
def test_an_action_is_linear_between_the_ends_of_a_range(action, clip, value):
    assert clipped(action) == clip
    assert set_point(action, 100.0, 300.0) == pytest.approx(value)


@pytest.mark.parametrize("step_count", [0, 5])
def test_commands_queue_up_behind_the_first_one(step_count):
    state = records_of().state
    before = np.arange(1.0, MAX_DELAY + 1.0)
    state.past_cutting_speeds[:, ENV] = before
    state.past_feeds[:, ENV] = 10.0 * before
    put(state, step_count=step_count, commanded_cutting_speed=99.0, commanded_feed=0.9)
    note_command(state, ENV)
    shifted = before[:-1] if step_count else np.full(MAX_DELAY - 1, 99.0)
    shifted_feeds = 10.0 * before[:-1] if step_count else np.full(MAX_DELAY - 1, 0.9)
    assert state.past_cutting_speeds[:, ENV].tolist() == [99.0, *shifted]
    assert state.past_feeds[:, ENV].tolist() == [0.9, *shifted_feeds]


@pytest.mark.parametrize(
    ("steps_late", "sub_steps_left", "speed", "feed"),
    [
        # Commands: 100 now, 200 a step ago, 300 two steps ago; a step has 4 sub-steps.
        pytest.param(0.5, 3, 200.0, 0.2, id="first sub-step, a step ago"),
        pytest.param(0.5, 2, 200.0, 0.2, id="second, a step ago"),
        pytest.param(0.5, 1, 100.0, 0.1, id="third, now"),
        pytest.param(0.5, 0, 100.0, 0.1, id="fourth, now"),
        pytest.param(0.375, 2, 150.0, 0.15, id="half of the second"),
        pytest.param(1.0, 0, 200.0, 0.2, id="a whole step"),
        pytest.param(1.5, 2, 300.0, 0.3, id="a step and a half, first half"),
        pytest.param(1.5, 1, 200.0, 0.2, id="a step and a half, second half"),
        pytest.param(0.0, 3, 100.0, 0.1, id="no delay"),
    ],
)
def test_late_commands_act_after_their_dead_time(steps_late, sub_steps_left, speed, feed):
    records = records_of(sub_steps=4, steps_late=steps_late)
    for place in range(MAX_DELAY):
        records.state.past_cutting_speeds[place, ENV] = 100.0 * (place + 2)
        records.state.past_feeds[place, ENV] = 0.1 * (place + 2)
    put(records.state, commanded_cutting_speed=100.0, commanded_feed=0.1)
    # The sub-steps left include the one that begins.
    put(records.work, sub_steps_left=sub_steps_left + 1)
    follow_late_command(records.state, records.work, ENV, records.p)
    assert records.work.target_cutting_speed[ENV] == pytest.approx(speed)
    assert records.work.target_feed[ENV] == pytest.approx(feed)


@pytest.mark.parametrize("more", [0.0, 2.0])
def test_the_longest_delay_reaches_the_end_of_the_queue(more):
    records = records_of(sub_steps=4, steps_late=MAX_DELAY + more)
    records.state.past_cutting_speeds[-1, ENV] = 70.0
    put(records.work, sub_steps_left=1)
    follow_late_command(records.state, records.work, ENV, records.p)
    assert records.work.target_cutting_speed[ENV] == 70.0


def test_the_servo_current_balances_friction_and_force_and_gives_the_force_back():
    p = records_of(no_load_current=2.0, no_load_current_rate=0.01, current_per_newton=0.005).p
    assert steady_current(p, ENV, 400.0, 50.0) == pytest.approx(2.0 + 0.5 + 2.0)
    assert force_from_current(p, ENV, 4.5, 50.0) == pytest.approx(400.0)
