"""Used life and wear, as functions and in the environment."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.turning_env.playing import UNDISTURBED, changed
from turning_env import RoughTurningEnv, Scenario
from turning_env.physics.records import parameter_records
from turning_env.physics.wear import advance_used_life, log_wear

RULES = ("equivalent_time", "clock_time")
SCENARIOS = {rule: changed(UNDISTURBED, tool={"wear_rule": rule}) for rule in RULES}
PARAMETERS = {rule: parameter_records(scenario)[0] for rule, scenario in SCENARIOS.items()}
WEAR_LAW = UNDISTURBED.material.wear
WEAR_CRITERION = UNDISTURBED.tool.wear_criterion


def wear_after(rule: str, coefficient: float, durations: list[float]) -> float:
    used_life, time = 0.0, 0.0
    for duration in durations:
        used_life = advance_used_life(PARAMETERS[rule], used_life, math.log(coefficient), time, time + duration)
        time += duration
    return math.exp(log_wear(PARAMETERS[rule], used_life))


@pytest.mark.parametrize("rule", RULES)
@given(coefficient=st.floats(0.01, 0.5), durations=st.lists(st.floats(0.01, 10), min_size=1, max_size=20))
def test_constant_parameters_wear_as_a_fresh_edge_however_the_cut_is_split(rule, coefficient, durations):
    expected = coefficient * sum(durations) ** WEAR_LAW.time
    assert wear_after(rule, coefficient, durations) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("rule", RULES)
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


@given(coefficients=st.lists(st.floats(0.05, 0.2), min_size=2, max_size=6))
def test_equivalent_time_adds_shares_of_taylor_lives_in_any_order(coefficients):
    shares = [0.1 * (coefficient / WEAR_CRITERION) ** (1 / WEAR_LAW.time) for coefficient in coefficients]
    used_life = sum(shares)
    for order in (coefficients, coefficients[::-1]):
        reached, time = 0.0, 0.0
        for coefficient in order:
            reached = advance_used_life(PARAMETERS["equivalent_time"], reached, math.log(coefficient), time, time + 0.1)
            time += 0.1
        assert reached == pytest.approx(used_life, rel=1e-9)


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


def test_used_life_one_is_the_wear_criterion():
    for parameters in PARAMETERS.values():
        assert np.exp(log_wear(parameters, 1.0)) == pytest.approx(WEAR_CRITERION, rel=1e-14)
