"""Used life and wear, as functions and in the environment."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.turning_env.playing import UNDISTURBED, changed
from turning_env import RoughTurningEnv, Scenario

RULES = ("equivalent_time", "clock_time")
SCENARIOS = {rule: changed(UNDISTURBED, tool={"wear_rule": rule}) for rule in RULES}
WEAR_LAW = UNDISTURBED.material.wear
WEAR_CRITERION = UNDISTURBED.tool.wear_criterion


@pytest.mark.parametrize("rule", RULES)
@settings(max_examples=25)
@given(
    set_points=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    interval=st.floats(0.5, 20),
    sub_steps=st.integers(1, 50),
)
def test_the_environment_wears_by_the_same_law(rule, set_points, interval, sub_steps):
    env = RoughTurningEnv(changed(SCENARIOS[rule], control={"interval": interval, "sub_steps": sub_steps}))
    env.reset(seed=0)
    for _ in range(10):
        *_, terminated, _, info = env.step(set_points)
        expected = WEAR_LAW(info["cutting_speed"], info["feed"], 2.5, time=info["cutting_time"])
        assert info["wear"] == pytest.approx(expected, rel=1e-9)
        assert terminated == (info["wear"] >= WEAR_CRITERION)
        if terminated:
            break


def test_clock_time_reproduces_the_published_second_interval():
    """Table 2 of Alaskari and Oraby 2018: after 1 min at 150 m/min and 0.58 mm/rev, one more minute at each pair."""
    second_minute = [(50, 0.165, 0.16972), (100, 0.53, 0.17990), (140, 0.58, 0.18519), (200, 0.36, 0.18893)]
    machine = Scenario().machine

    def set_points(speed, feed):
        ranges = (machine.cutting_speed_min, machine.cutting_speed_max), (machine.feed_min, machine.feed_max)
        return [2 * (value - low) / (high - low) - 1 for value, (low, high) in zip((speed, feed), ranges, strict=True)]

    env = RoughTurningEnv("paper")
    for speed, feed, total_wear in second_minute:
        env.reset(seed=0)
        *_, info = env.step(set_points(150, 0.58))
        assert info["wear"] == pytest.approx(0.157219, abs=1e-6)
        *_, info = env.step(set_points(speed, feed))
        assert info["wear"] == pytest.approx(total_wear, abs=2e-5)
