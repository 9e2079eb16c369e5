"""Edges changed by learned power (TMAC). What this and other rules of spindle load command: golden actions."""

import numpy as np

from baselines.load_override import LEARNING_TIME, SETTLING_TIME, WEAR_TIME, LearnedPower
from baselines.models.part_program import PartProgram
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.physics.quantities import DEVIATION_SCALE, OBS

SHIFT = Scenario.load("shift")
REFERENCE = 0.3
"""Load of the learned cut [-]."""


FIRST, _ = RoughTurningVectorEnv(1, SHIFT).reset(seed=0)


def observe(load: float, cutting_time: float, override: float = 1.0):
    """Return an observation in metal of a load [-], a cutting time [min] and an override of the initial feed [-]."""
    seen, machine, feed = FIRST.copy(), SHIFT.machine, override * SHIFT.control.initial_feed
    seen[:, OBS.power] = DEVIATION_SCALE * (load * machine.rated_power / SHIFT.limits.power - 1.0)
    position = np.log(feed / machine.feed_min) / np.log(machine.feed_max / machine.feed_min)
    seen[:, [OBS.feed, OBS.commanded_feed]] = np.clip(2.0 * position - 1.0, -1.0, 1.0)
    seen[:, OBS.cutting_time], seen[:, OBS.cutting] = np.log1p(cutting_time), 1.0
    return seen


def learned() -> LearnedPower:
    """A control that has learned a cut at the programmed feed, in the shift."""
    policy = LearnedPower(PartProgram(SHIFT, {}), 1, target=1.0, gain=5.0, extreme=2.5, wear=1.4)
    for second in np.arange(0.0, LEARNING_TIME + 0.05, 0.1):
        load = REFERENCE if second >= SETTLING_TIME - 1e-6 else 0.1  # rising at first
        policy.act(observe(load, second / 60.0))
    return policy


def changes(policy: LearnedPower, load: float, minutes: float, override: float = 1.0) -> bool:
    """Whether an edge change is asked for when a load lasts, in the shift."""
    answers = [
        policy.act(observe(load, 1.0 + second / 60.0, override))[0, 2]
        for second in range(int(60 * minutes))
    ]
    return max(answers) > 0.0


def test_growth_of_power_at_constant_feed_changes_the_edge_and_a_fresh_one_is_learned_anew() -> (
    None
):
    limit, lasting = 1.4 * REFERENCE, 5.0 * WEAR_TIME / 60.0
    assert not changes(learned(), limit * 0.98, lasting)
    assert not changes(learned(), limit * 1.2, 0.1 * WEAR_TIME / 60.0)  # a hard spot
    assert not changes(learned(), limit * 1.2, lasting, override=2.0)  # more feed, not more wear
    policy = learned()
    assert changes(policy, limit * 1.02, lasting)
    for second in range(4):
        policy.act(observe(REFERENCE * 1.8, second / 60.0))
    assert not changes(policy, REFERENCE * 1.8, lasting)
