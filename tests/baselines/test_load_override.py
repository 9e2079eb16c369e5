"""Feed override by spindle load: constant load, one line, learned power (TMAC), air gaps (OMATIVE), and no control."""

import numpy as np
import pytest

from baselines.load_override import ENTRY_TIME, LEARNING_TIME, SETTLING_TIME, STOP, WEAR_TIME, AirGapControl, LearnedPower
from baselines.models.part_program import PartProgram
from tests.baselines.observing import observe, override_of
from tests.turning_env.playing import changed
from turning_env import Scenario
from turning_env.scoring.policy import Policy

OVERRIDE = Scenario.load("override")
INTERVAL = OVERRIDE.control.interval
FAST = changed(OVERRIDE, control={"interval": 0.1})
SHIFT = Scenario.load("shift")
REFERENCE = 0.3
"""Load of the learned cut [-]."""


def asked(policy: Policy, scenario: Scenario = OVERRIDE, **seen: float) -> float:
    """The override that is asked for [-]."""
    return float(override_of(policy.act(observe(scenario, **seen)), scenario)[0])


def learned(scenario: Scenario = FAST, **parameters: float) -> LearnedPower:
    """A control that has learned a cut at the programmed feed."""
    settings = {"target": 1.0, "gain": 5.0, "extreme": 2.5, "wear": 1.4} | parameters
    policy = LearnedPower(PartProgram(scenario, {}), 1, **settings)
    for second in np.arange(0.0, LEARNING_TIME + 0.05, 0.1):
        load = REFERENCE if second >= SETTLING_TIME - 1e-6 else 0.1  # rising at first
        policy.act(observe(scenario, load=load, cutting_time=second / 60.0))
    return policy


def test_it_learns_at_the_programmed_feed_and_then_keeps_the_power_constant() -> None:
    policy = LearnedPower(PartProgram(FAST, {}), 1, 1.0, 5.0, 2.5, 1.4)
    for second in (0.0, 0.6, 1.4):
        assert asked(policy, FAST, load=0.5, override=1.4, cutting_time=second / 60.0) == pytest.approx(1.0)
    assert asked(policy, FAST, load=0.5, override=1.4, cutting_time=1.6 / 60.0) > 1.4
    for load, sign in ((0.5, 1.0), (0.6, 0.0), (0.7, -1.0)):
        assert np.sign(round(asked(learned(), FAST, load=load, override=1.2) - 1.2, 5)) == sign


def test_the_feed_is_held_back_at_the_extreme_limit_and_stops_beyond_it() -> None:
    extreme = 1.5 * REFERENCE  # below the target of 60 %
    assert asked(learned(extreme=1.5), FAST, load=extreme * 1.001, override=1.5) < 1.5
    assert asked(learned(extreme=1.5), FAST, load=extreme * 0.999, override=1.5) > 1.5
    assert asked(learned(extreme=1.5), FAST, load=extreme * STOP * 1.001, override=1.5) == pytest.approx(0.01, rel=1e-3)
    assert asked(learned(extreme=9.0), FAST, load=extreme * STOP * 1.001, override=1.5) > 0.5


def changes(policy: LearnedPower, load: float, minutes: float, override: float = 1.0) -> bool:
    """Whether an edge change is asked for when a load lasts, in the shift."""
    answers = [
        policy.act(observe(SHIFT, load=load, override=override, cutting_time=1.0 + second / 60.0))[0, 2]
        for second in range(int(60 * minutes))
    ]
    return max(answers) > 0.0


def test_growth_of_power_at_constant_feed_changes_the_edge_and_a_fresh_one_is_learned_anew() -> None:
    limit, lasting = 1.4 * REFERENCE, 5.0 * WEAR_TIME / 60.0
    assert not changes(learned(SHIFT), limit * 0.98, lasting)
    assert not changes(learned(SHIFT), limit * 1.2, 0.1 * WEAR_TIME / 60.0)  # a hard spot
    assert not changes(learned(SHIFT), limit * 1.2, lasting, override=2.0)  # more feed, not more wear
    policy = learned(SHIFT)
    assert changes(policy, limit * 1.02, lasting)
    for second in range(4):
        policy.act(observe(SHIFT, load=REFERENCE * 1.8, cutting_time=second / 60.0))
    assert not changes(policy, REFERENCE * 1.8, lasting)


def in_metal(rise: float = 5.0, steps: int = int(ENTRY_TIME / INTERVAL) + 2) -> AirGapControl:
    """A control that has been in the metal for some steps."""
    policy = AirGapControl(PartProgram(OVERRIDE, {}), 1, target=1.0, entry=0.6, rise=rise)
    for _ in range(steps):
        policy.act(observe(OVERRIDE, load=0.6))
    return policy


def test_air_is_crossed_fast_and_metal_entered_gently() -> None:
    policy = in_metal(steps=0)
    assert asked(policy, cutting=False) == pytest.approx(2.0)
    entry = [asked(policy, load=0.1, override=2.0) for _ in range(int(ENTRY_TIME / INTERVAL))]
    assert entry == pytest.approx([0.6] * len(entry), rel=1e-4)
    for _ in range(2):
        later = asked(policy, load=0.1, override=0.6)
    assert later > 0.6
    assert asked(policy, cutting=False) == pytest.approx(2.0)
    assert asked(policy, load=0.1, override=2.0) == pytest.approx(0.6)


def test_the_feed_falls_at_once_to_what_the_metal_allows_and_rises_gradually() -> None:
    # Twice the load at the actual feed: the law's exponent 0.74 tells by how much the feed must fall.
    assert asked(in_metal(), load=1.2, override=1.5, actual_override=1.0) == pytest.approx(0.5 ** (1 / 0.74), rel=1e-3)
    slow, fast = (asked(in_metal(rise), load=0.3, override=0.5) for rise in (1.0, 10.0))
    assert 0.5 < slow < fast < 0.5 * 2 ** (1 / 0.74)
    assert slow - 0.5 == pytest.approx((0.5 * 2 ** (1 / 0.74) - 0.5) * (1 - np.exp(-INTERVAL)), rel=0.01)
