"""The window of feeds in which chips break, estimated from stops for tangled chips.

The catalogue's window is right, or shifted by a log factor. Outside the true window chips tangle at
a known rate, as a Poisson process (``turning_env/physics/swarf.py``). So each shift has a weight by
Bayes' rule: the chance of the stops that were seen in the time that was cut at each feed.
"""

from typing import Any

import numpy as np

from baselines.rule import Array, Mask
from turning_env import Reading
from turning_env.numerics.functions import exp, log

SHIFTS = np.array([0.0, -0.65, -0.55, -0.45, -0.35, 0.35, 0.45, 0.55, 0.65])
"""Log shifts of both ends of the window that are compared [-] (range: training jobs of the family
``unmodelled``)."""
PRIOR = np.array([0.5, *[0.5 / 8.0] * 8])  # weights of the shifts at the start
STRAY_RATE = 0.05
"""Rate of stops inside the window over that outside [-]: bars may be too thin or too thick for
chips to break (assumption)."""


class ChipWindow:
    """A belief about the window's shift in many environments: a weight for each of ``SHIFTS``.

    Args:
        scenario: nominal models side by side, or one for all.
        num_envs: number of environments.

    Attributes:
        log_weights: logarithms of the weights, up to a constant, shape (num_envs, shifts).
    """

    def __init__(self, scenario: Any, num_envs: int) -> None:
        swarf = scenario.swarf
        self._rate = np.broadcast_to(swarf.tangle_rate, num_envs)  # [1/min]
        self._low = np.broadcast_to(swarf.chip_feed_min, num_envs)
        self._high = np.broadcast_to(swarf.chip_feed_max, num_envs)
        self._minutes = np.broadcast_to(scenario.control.interval / 60.0, num_envs)
        self._scenario = scenario
        self.log_weights = np.tile(log(PRIOR), (num_envs, 1))

    def reset(self, mask: Mask) -> None:
        """Forget all stops in the environments of a mask."""
        self.log_weights[mask] = log(PRIOR)

    def observe(self, reading: Reading) -> None:
        """Learn from the stops in the last step, at the feed of the reading."""
        log_feed = log(reading.feed)
        above_low = log_feed - log(self._low)
        above_high = log_feed - log(self._high)
        shift = SHIFTS[np.newaxis]
        too_low = above_low[:, np.newaxis] < shift
        too_high = above_high[:, np.newaxis] > shift
        share = np.where(too_low | too_high, 1.0, STRAY_RATE)
        expected_stops = np.where(reading.cutting, self._rate * self._minutes, 0.0)
        # Scenarios that do not count the stops say nothing.
        stops = np.nan_to_num(reading.tangles)
        self.log_weights -= expected_stops[:, np.newaxis] * share
        self.log_weights += stops[:, np.newaxis] * log(share)

    @property
    def shift(self) -> Array:
        """Most probable log shift [-], shape (num_envs,)."""
        return np.asarray(SHIFTS[self.log_weights.argmax(axis=1)])

    def feed_range(self) -> tuple[Array, Array]:
        """Return the lowest and the highest feed by the most probable shift [mm/rev].

        Both have shape (num_envs,) and lie in the machine's range.
        """
        factor = exp(self.shift)
        machine = self._scenario.machine
        low = np.clip(self._low * factor, machine.feed_min, machine.feed_max)
        high = np.clip(self._high * factor, machine.feed_min, machine.feed_max)
        return low, high
