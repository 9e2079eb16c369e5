"""Used life and wear, as functions and in the environment."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.turning_env.playing import UNDISTURBED, changed, play
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


@pytest.mark.parametrize("rule", RULES)
def test_tertiary_wear_follows_its_law(rule):
    """Integrated over the used life D by equivalent time, over the law's wear W0 by clock time: dW/dW0 = exp(r (W - W_t))."""
    begin, rate = 0.15, 5.0
    failure = {"tertiary_wear": begin, "tertiary_rate": rate}
    scenario = changed(SCENARIOS[rule], edge_failure=failure, control={"interval": 1, "sub_steps": 20})
    record = play(RoughTurningEnv(scenario), 0, np.ones((500, 2), np.float32))
    end = int(np.flatnonzero(record["terminated"])[0])
    minutes = record["cutting_time"][end]
    law = WEAR_LAW(200.0, 0.6, 2.5)
    if rule == "equivalent_time":
        wear = WEAR_CRITERION * np.linspace(0.0, 1.0, 100_001) ** WEAR_LAW.time
        expected = (WEAR_CRITERION / law) ** (1 / WEAR_LAW.time) * np.exp(-rate * np.maximum(wear - begin, 0.0)).mean()
    else:
        fresh = begin + (1.0 - math.exp(-rate * (WEAR_CRITERION - begin))) / rate
        expected = (fresh / law) ** (1 / WEAR_LAW.time)
    assert minutes == pytest.approx(expected, rel=2e-3)
    assert minutes < 0.8 * (WEAR_CRITERION / law) ** (1 / WEAR_LAW.time)
    early = (record["wear"][:end] < begin) & (record["wear"][:end] > 0.0)
    assert record["wear"][:end][early] == pytest.approx(law * record["cutting_time"][:end][early] ** WEAR_LAW.time)
