"""Edges changed by learned power (TMAC).

Golden actions cover what this and other rules of spindle load command.
"""

import numpy as np

from baselines.load_override import LEARNING_TIME, SETTLING_TIME, WEAR_TIME, LearnedPower
from baselines.models.part_program import PartProgram
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.physics.quantities import DEVIATION_SCALE, OBS

SHIFT = Scenario.load("shift")
REFERENCE = 0.3  # load of the learned cut [-]
FIRST, _ = RoughTurningVectorEnv(1, SHIFT).reset(seed=0)


def observe(load: float, cutting_time: float, override: float = 1.0):
    """Return an observation in metal of a load [-] and a cutting time [min].

    ``override``: of the initial feed [-].
    """
    machine = SHIFT.machine
    feed = override * SHIFT.control.initial_feed
    seen = FIRST.copy()
    power_over_limit = load * machine.rated_power / SHIFT.limits.power
    seen[:, OBS.power] = DEVIATION_SCALE * (power_over_limit - 1.0)
    span = np.log(machine.feed_max / machine.feed_min)
    share = np.log(feed / machine.feed_min) / span
    position = np.clip(2.0 * share - 1.0, -1.0, 1.0)
    seen[:, OBS.feed] = position
    seen[:, OBS.commanded_feed] = position
    seen[:, OBS.cutting_time] = np.log1p(cutting_time)
    seen[:, OBS.cutting] = 1.0
    return seen


def learned() -> LearnedPower:
    """Return a control that has learned a cut at the programmed feed, in the shift."""
    program = PartProgram(SHIFT, {})
    policy = LearnedPower(program, 1, target=1.0, gain=5.0, extreme=2.5, wear=1.4)
    for second in np.arange(0.0, LEARNING_TIME + 0.05, 0.1):
        load = REFERENCE if second >= SETTLING_TIME - 1e-6 else 0.1  # rising at first
        policy.act(observe(load, second / 60.0))
    return policy


def changes(policy: LearnedPower, load: float, minutes: float, override: float = 1.0) -> bool:
    """Return whether the control changes the edge when a load lasts, in the shift."""
    answers = []
    for second in range(int(60 * minutes)):
        observation = observe(load, 1.0 + second / 60.0, override=override)
        answers.append(policy.act(observation)[0, 2])
    return max(answers) > 0.0


WEAR_LIMIT = 1.4 * REFERENCE  # load [-]
LASTING = 5.0 * WEAR_TIME / 60.0  # [min]


def test_an_edge_is_kept_below_the_wear_limit() -> None:
    assert not changes(learned(), WEAR_LIMIT * 0.98, LASTING)


def test_a_hard_spot_changes_no_edge() -> None:
    assert not changes(learned(), WEAR_LIMIT * 1.2, 0.1 * WEAR_TIME / 60.0)


def test_more_power_by_more_feed_changes_no_edge() -> None:
    assert not changes(learned(), WEAR_LIMIT * 1.2, LASTING, override=2.0)


def test_lasting_growth_of_power_changes_the_edge_and_the_fresh_one_is_learned() -> None:
    policy = learned()
    assert changes(policy, WEAR_LIMIT * 1.02, LASTING)
    for second in range(4):
        policy.act(observe(REFERENCE * 1.8, second / 60.0))
    assert not changes(policy, REFERENCE * 1.8, LASTING)
