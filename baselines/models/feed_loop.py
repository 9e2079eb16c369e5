"""A proportional loop that holds a load by the feed.

A load L is a measured load over the limit that holds at the present cutting speed. Below the base
speed n_b the limit of power is that of the torque, c P_limit (``docs/models.md``):

    L_power = P / (c P_limit),   c = min(1, n / n_b)        L_force = F / F_limit

A load grows as f^b with the feed f, so by the nominal law it reaches the target T at the feed
f (T / L)^(1/b). In metal, the loop goes the share g of the way there, for the load that allows
less:

    log f_command = log f + g min((log T - log L_power) / b_power, (log T - log L_force) / b_force)

In air nothing is measured, and the command stays. The feed is kept within the chip breaker's
window.
"""

from typing import NamedTuple

import numpy as np

from baselines.models.nominal_points import NominalPoints
from baselines.rule import Array
from turning_env import Reading
from turning_env.numerics.functions import log
from turning_env.scenario.laws import LoadShares, capacity_at, load_shares
from turning_env.scenario.scenario_batch import ScenarioBatch

MIN_LOAD = 0.05  # lower bound of a load [-], before its logarithm is taken
LOW_MARGIN = 0.01  # distance from the low end of the window of feeds, as a logarithm [-]
HIGH_MARGIN = 0.02  # likewise from the high end


def shares_of(reading: Reading, scenario: ScenarioBatch) -> LoadShares:
    """Return the loads of a reading over the limits that hold at its cutting speed [-].

    Their shape is (num_envs,).
    """
    capacity = capacity_at(scenario, reading.cutting_speed)
    return load_shares(reading, scenario.limits, capacity)


class FeedGaps(NamedTuple):
    """Log ratios of the feed with the target load to the present feed [-], shape (num_envs,)."""

    power: Array
    thrust_force: Array

    @property
    def least(self) -> Array:
        """Gap of the load that allows less."""
        return np.minimum(self.power, self.thrust_force)


def feed_gaps(loads: LoadShares, points: NominalPoints, log_target: Array) -> FeedGaps:
    """Return how far the feed is from that of the target load, by the nominal exponents."""
    log_power = log(np.maximum(loads.power, MIN_LOAD))
    log_force = log(np.maximum(loads.thrust_force, MIN_LOAD))
    return FeedGaps(
        power=(log_target - log_power) / points.power_exponent,
        thrust_force=(log_target - log_force) / points.force_exponent,
    )


def log_feed_towards(reading: Reading, gap: Array, up: Array | float, down: Array | float) -> Array:
    """Return the log feed that goes a share of a gap: ``up`` if the feed rises, else ``down``."""
    share = np.where(gap > 0.0, up, down)
    return np.asarray(log(reading.feed) + share * gap)


def held_in_air(reading: Reading, log_feed: Array) -> Array:
    """Return a log feed in metal, and the command of before in air."""
    return np.where(reading.cutting, log_feed, log(reading.commanded_feed))


def within_window(
    log_feed: Array,
    points: NominalPoints,
    low_margin: Array | float = LOW_MARGIN,
    high_margin: Array | float = HIGH_MARGIN,
) -> Array:
    """Return a log feed that keeps margins [-] from the ends of the window of feeds."""
    lowest = points.log_lowest_feed + low_margin
    highest = np.maximum(points.log_highest_feed - high_margin, lowest)
    return np.clip(log_feed, lowest, highest)
