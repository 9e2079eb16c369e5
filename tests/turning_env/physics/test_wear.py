"""Used life and wear, as functions and in the environment."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.turning_env.playing import UNDISTURBED, changed, play
from turning_env import RoughTurningEnv

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
