"""Feed override by spindle load: edges changed by learned power (TMAC), air gaps (OMATIVE). All others: golden actions."""

import numpy as np
import pytest

from baselines.load_override import ENTRY_TIME, LEARNING_TIME, SETTLING_TIME, WEAR_TIME, AirGapControl, LearnedPower
from baselines.models.part_program import PartProgram
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.physics.quantities import DEVIATION_SCALE, OBS

OVERRIDE = Scenario.load("override")
SHIFT = Scenario.load("shift")
REFERENCE = 0.3
"""Load of the learned cut [-]."""


FIRST = {scenario.name: RoughTurningVectorEnv(1, scenario).reset(seed=0)[0] for scenario in (OVERRIDE, SHIFT)}


def observe(scenario: Scenario, load: float = 0.0, override: float = 1.0, cutting: bool = True, cutting_time: float = 1.0):
    """Return an observation of a load and an override of the scenario's feed [-], and a cutting time [min]."""
    seen, machine, feed = FIRST[scenario.name].copy(), scenario.machine, override * scenario.control.initial_feed
    seen[:, OBS.power] = DEVIATION_SCALE * (load * machine.rated_power / scenario.limits.power - 1.0)
    position = np.log(max(feed, machine.feed_min) / machine.feed_min) / np.log(machine.feed_max / machine.feed_min)
    seen[:, [OBS.feed, OBS.commanded_feed]] = np.clip(2.0 * position - 1.0, -1.0, 1.0)
    seen[:, OBS.cutting_time], seen[:, OBS.cutting] = np.log1p(cutting_time), cutting
    return seen


def learned() -> LearnedPower:
    """A control that has learned a cut at the programmed feed, in the shift."""
    policy = LearnedPower(PartProgram(SHIFT, {}), 1, target=1.0, gain=5.0, extreme=2.5, wear=1.4)
    for second in np.arange(0.0, LEARNING_TIME + 0.05, 0.1):
        load = REFERENCE if second >= SETTLING_TIME - 1e-6 else 0.1  # rising at first
        policy.act(observe(SHIFT, load=load, cutting_time=second / 60.0))
    return policy


def changes(policy: LearnedPower, load: float, minutes: float, override: float = 1.0) -> bool:
    """Whether an edge change is asked for when a load lasts, in the shift."""
    answers = [
        policy.act(observe(SHIFT, load=load, override=override, cutting_time=1.0 + second / 60.0))[0, 2]
        for second in range(int(60 * minutes))
    ]
    return max(answers) > 0.0


def test_growth_of_power_at_constant_feed_changes_the_edge_and_a_fresh_one_is_learned_anew() -> None:
    limit, lasting = 1.4 * REFERENCE, 5.0 * WEAR_TIME / 60.0
    assert not changes(learned(), limit * 0.98, lasting)
    assert not changes(learned(), limit * 1.2, 0.1 * WEAR_TIME / 60.0)  # a hard spot
    assert not changes(learned(), limit * 1.2, lasting, override=2.0)  # more feed, not more wear
    policy = learned()
    assert changes(policy, limit * 1.02, lasting)
    for second in range(4):
        policy.act(observe(SHIFT, load=REFERENCE * 1.8, cutting_time=second / 60.0))
    assert not changes(policy, REFERENCE * 1.8, lasting)


def test_air_is_crossed_fast_and_metal_entered_gently() -> None:
    policy = AirGapControl(PartProgram(OVERRIDE, {}), 1, target=1.0, entry=0.6, rise=5.0)

    def asked(**seen: float) -> float:
        """Return the override that is asked for [-]."""
        return 0.5 * (float(policy.act(observe(OVERRIDE, **seen))[0, 0]) + 1.0) * OVERRIDE.control.override_max

    assert asked(cutting=False) == pytest.approx(2.0)
    entry = [asked(load=0.1, override=2.0) for _ in range(int(ENTRY_TIME / OVERRIDE.control.interval))]
    assert entry == pytest.approx([0.6] * len(entry), rel=1e-4)
    assert [asked(load=0.1, override=0.6) for _ in range(2)][-1] > 0.6
    assert asked(cutting=False) == pytest.approx(2.0)
    assert asked(load=0.1, override=2.0) == pytest.approx(0.6)
