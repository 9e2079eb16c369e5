"""Edges changed by learned power (TMAC).

Golden actions cover what this and other rules of spindle load command.
"""

import numpy as np
from numpy.typing import NDArray

from baselines.load_override import LEARNING_TIME, SETTLING_TIME, WEAR_TIME, LearnedPower
from baselines.models.part_program import PartProgram
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.physics.quantities import DEVIATION_SCALE, OBS

SHIFT = Scenario.load("shift")
REFERENCE = 0.3  # load of the learned cut [-]
FIRST, _ = RoughTurningVectorEnv(1, SHIFT).reset(seed=0)


WEAR_FACTOR = 1.4  # load at which an edge counts as worn, over the learned one [-]
WEAR_LIMIT = WEAR_FACTOR * REFERENCE  # load [-]
LASTING = 5.0 * WEAR_TIME / 60.0  # [min]
SHORT = 0.1 * WEAR_TIME / 60.0  # [min]


def observe(load: float, cutting_time: float, override: float = 1.0) -> NDArray[np.float32]:
    """Return an observation in metal.

    Args:
        load: spindle load [-].
        cutting_time: cutting time of the edge [min].
        override: feed over the initial feed [-].
    """
    machine = SHIFT.machine
    feed = override * SHIFT.control.initial_feed
    seen = FIRST.copy()
    power_over_limit = load * machine.rated_power / SHIFT.limits.power
    seen[:, OBS.power] = DEVIATION_SCALE * (power_over_limit - 1.0)
    # Feeds are observed on a logarithmic scale from -1 to 1.
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
    policy = LearnedPower(
        program,
        1,
        target=1.0,
        gain=5.0,
        extreme=2.5,
        wear=WEAR_FACTOR,
    )
    for second in np.arange(0.0, LEARNING_TIME + 0.05, 0.1):
        has_settled = second >= SETTLING_TIME - 1e-6
        load = REFERENCE if has_settled else 0.1
        policy.act(observe(load, second / 60.0))
    return policy


def changes(policy: LearnedPower, load: float, minutes: float, override: float = 1.0) -> bool:
    """Return whether the control changes the edge when a load lasts, in the shift."""
    change_actions = []
    for second in range(int(60 * minutes)):
        observation = observe(load, 1.0 + second / 60.0, override=override)
        action = policy.act(observation)[0]
        change_actions.append(action[2])
    return max(change_actions) > 0.0


def test_an_edge_is_kept_below_the_wear_limit() -> None:
    assert not changes(learned(), 0.98 * WEAR_LIMIT, minutes=LASTING)


def test_a_hard_spot_changes_no_edge() -> None:
    assert not changes(learned(), 1.2 * WEAR_LIMIT, minutes=SHORT)


def test_more_power_by_more_feed_changes_no_edge() -> None:
    assert not changes(
        learned(),
        1.2 * WEAR_LIMIT,
        minutes=LASTING,
        override=2.0,
    )


def test_lasting_growth_of_power_changes_the_edge_and_the_fresh_one_is_learned() -> None:
    policy = learned()
    assert changes(policy, 1.02 * WEAR_LIMIT, minutes=LASTING)

    # The fresh edge takes a load at which the old one was worn.
    fresh_load = 1.8 * REFERENCE
    for second in range(4):
        policy.act(observe(fresh_load, cutting_time=second / 60.0))
    assert not changes(policy, fresh_load, minutes=LASTING)
