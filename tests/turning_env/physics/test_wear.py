"""Used life and wear, as functions and in the environment."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.turning_env.physics.one_env import ENV, Records, put, put_law, records_of
from tests.turning_env.playing import UNDISTURBED, changed, play
from turning_env import RoughTurningEnv
from turning_env.physics.wear import (
    CLOCK_TIME,
    EQUIVALENT_TIME,
    advance_used_life,
    life_by_clock,
    life_share,
    log_wear,
    with_phases,
)

RULES = ("equivalent_time", "clock_time")
SCENARIOS = {rule: changed(UNDISTURBED, tool={"wear_rule": rule}) for rule in RULES}
WEAR_LAW = UNDISTURBED.material.wear
WEAR_CRITERION = UNDISTURBED.tool.wear_criterion


@pytest.mark.compiled
@pytest.mark.parametrize("rule", RULES)
@settings(max_examples=25)
@given(
    set_points=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    interval=st.floats(0.5, 20),
    sub_steps=st.integers(1, 50),
)
def test_the_environment_wears_by_the_same_law(rule, set_points, interval, sub_steps):
    control = {"interval": interval, "sub_steps": sub_steps}
    env = RoughTurningEnv(changed(SCENARIOS[rule], control=control))
    env.reset(seed=0)
    for _ in range(10):
        _, _, terminated, _, info = env.step(set_points)
        expected = WEAR_LAW(
            info["cutting_speed"],
            info["feed"],
            2.5,
            time=info["cutting_time"],
        )
        assert info["wear"] == pytest.approx(expected, rel=1e-9)
        assert terminated == (info["wear"] >= WEAR_CRITERION)
        if terminated:
            break


def used_life(wear):
    """Return D = (W / W_max)^(1/n)."""
    return (wear / WEAR_CRITERION) ** (1 / WEAR_LAW.time)


class Rates(NamedTuple):
    """Rates of wear; arrays over steps."""

    speed: NDArray[np.float64]  # cutting speed [m/min]
    wear: NDArray[np.float64]  # wear before the step [mm]
    rate: NDArray[np.float64]  # rate of wear over that of the power law [-]


def rates_of_wear(actions, **failure):
    """Play steps of one sub-step; return their rates of wear."""
    scenario = changed(UNDISTURBED, edge_failure=failure, control={"interval": 3, "sub_steps": 1})
    record = play(RoughTurningEnv(scenario), seed=0, actions=np.array(actions, np.float32))
    speed = record["cutting_speed"][1:]
    feed = record["feed"][1:]
    growth = np.diff(used_life(record["wear"]))
    wear_by_law = WEAR_LAW(speed, feed, depth_of_cut=2.5, time=3 / 60)
    return Rates(
        speed=speed,
        wear=record["wear"][:-1],
        rate=growth / used_life(wear_by_law),
    )


def test_an_edge_runs_in_and_wears_fast_again_at_the_end():
    rates = rates_of_wear(
        [(1.0, 1.0)] * 64,
        running_in=0.6,
        running_in_wear=0.1,
        tertiary_wear=0.2,
        tertiary_rate=12.0,
    )
    running_in = 1 + 0.6 * np.exp(-rates.wear / 0.1)
    tertiary = np.exp(12 * np.maximum(rates.wear - 0.2, 0))
    assert rates.wear[-1] > 0.25
    assert rates.rate == pytest.approx(running_in * tertiary, rel=1e-6)


@pytest.mark.compiled
def test_wear_has_a_minimum_above_the_speed_at_which_edges_build_up():
    """One slow step at each speed; the power law's exponent over the range is taken out."""
    built_up = {"built_up_edge": 40.0, "built_up_speed": 90.0, "built_up_width": 0.25}
    speeds = []
    rates = []
    for action in np.linspace(-1, 1, 81):
        single_step = rates_of_wear([(action, -1.0)], **built_up)
        speeds.append(single_step.speed)
        rates.append(single_step.rate)
    speed = np.concatenate(speeds)
    rate = np.concatenate(rates)
    distance = np.log(speed / 90) / 0.25
    assert rate == pytest.approx(1 + 40 * np.exp(-(distance**2)), rel=1e-6)

    # Life goes with V^-mu, so the rate of the power law goes with V^mu.
    mu = WEAR_LAW.cutting_speed / WEAR_LAW.time
    wear = rate * (speed / 90) ** mu
    lowest_above = wear[speed > 90].min()
    assert lowest_above < wear[np.abs(speed - 90).argmin()]
    assert lowest_above < wear[-1]


LOG_K = math.log(0.05)  # [log mm]


def by_hand() -> Records:
    """Return records with n = 1/2 and a criterion of 0.4 mm, so W = 0.4 D^(1/2)."""
    records = records_of()
    put_law(records.p.wear_law, 1.0, time=0.5)
    put(records.p, life_exponent=2.0, log_wear_criterion=math.log(0.4))
    return records


def test_an_edge_uses_its_life_at_the_rate_of_taylor_by_equivalent_time():
    # (0.05 / 0.4)^2 = 1/64 per minute.
    assert life_share(by_hand().p, ENV, LOG_K, 3.0) == pytest.approx(3.0 / 64.0)


@pytest.mark.parametrize(
    ("used_life", "start", "end", "expected"),
    [
        # W / 0.4 grows by (0.05 / 0.4) (9^(1/2) - 4^(1/2)) = 1/8, from 0.5.
        pytest.param(0.25, 4.0, 9.0, 0.625**2, id="used"),
        pytest.param(0.0, 0.0, 16.0, 0.25, id="fresh"),
        pytest.param(0.25, 4.0, 4.0, 0.25, id="no time"),
    ],
)
def test_wear_grows_with_the_edges_own_time_by_the_clock(used_life, start, end, expected):
    records = by_hand()
    life = life_by_clock(records.p, ENV, used_life, LOG_K, start, end)
    assert life == pytest.approx(expected)
    put(records.p, wear_rule=CLOCK_TIME)
    assert advance_used_life(records.p, ENV, used_life, LOG_K, start, end) == life


def test_the_scenario_decides_the_rule():
    records = by_hand()
    put(records.p, wear_rule=EQUIVALENT_TIME)
    life = advance_used_life(records.p, ENV, 0.25, LOG_K, 4.0, 9.0)
    assert life == pytest.approx(0.25 + 5.0 / 64.0)


def test_wear_is_a_power_of_the_used_life():
    assert math.exp(log_wear(by_hand().p, ENV, 0.25)) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("phases", "factor"),
    [
        # The edge has a wear of 0.2 mm at the speed of 110 m/min.
        pytest.param({}, 1.0, id="none"),
        pytest.param({"tertiary_rate": 5.0, "tertiary_wear": 0.1}, math.exp(0.5), id="tertiary"),
        pytest.param({"tertiary_rate": 5.0, "tertiary_wear": 0.3}, 1.0, id="not yet tertiary"),
        pytest.param(
            {"running_in": 3.0, "running_in_wear": 0.4},
            1.0 + 3.0 * math.exp(-0.5),
            id="running in",
        ),
        pytest.param(
            {"built_up_edge": 2.0, "log_built_up_speed": math.log(110.0) - 0.5},
            1.0 + 2.0 * math.exp(-4.0),
            id="built-up edge of a lower speed",
        ),
        pytest.param(
            {"built_up_edge": 2.0, "log_built_up_speed": math.log(110.0) + 0.25},
            1.0 + 2.0 * math.exp(-1.0),
            id="built-up edge of a higher speed",
        ),
        pytest.param(
            {
                "tertiary_rate": 5.0,
                "tertiary_wear": 0.1,
                "running_in": 3.0,
                "running_in_wear": 0.4,
                "built_up_edge": 2.0,
                "log_built_up_speed": math.log(110.0),
            },
            math.exp(0.5) * (1.0 + 3.0 * math.exp(-0.5)) * 3.0,
            id="all",
        ),
    ],
)
def test_phases_multiply_the_used_life_of_a_cut(phases, factor):
    records = by_hand()
    put(records.p, tertiary_rate=0.0, running_in=0.0, built_up_edge=0.0, built_up_width=0.25)
    put(records.p, **phases)
    life = with_phases(records.p, ENV, 0.25, 0.26, math.log(110.0))
    assert life == pytest.approx(0.25 + 0.01 * factor)
