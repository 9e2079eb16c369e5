"""The optimiser with foresight: it also prepares for the next bar, whose depth and hardness it does not know.

Travelled distance and geometry determine whether the tool will be in the present bar, in air or in the next bar at each point
of the horizon. An unmeasured bar may be hard and thick, so the feed must fall before the tool enters it. The feed servo needs
time for that, so the horizon is longer than the step. After the new bar has been measured, the feed rises again.

It suffices to plan one step. The step leaves the edge in a state whose price is known, and a speed and feed from which the next
step reaches almost any other.

It needs of the nominal model what ``optimiser`` needs.
"""

from typing import Any

import numpy as np

from baselines.models.load_filter import Array, Outlook, feed_velocity
from baselines.optimiser import Optimiser, column, optimising
from turning_env import Reading

POINTS = 8
"""Points of the horizon at which position and loads are predicted."""
SETTLING = 3.0
"""(Horizon - step) / time constant of the feed servo [-]."""


class Predictive(Optimiser):
    """A policy that maximises the expected gain of each step and of the entry into the next bar.

    See ``Optimiser`` for the arguments.
    """

    def _look_at(self) -> Array:
        horizon = self._scenario.control.interval + SETTLING * self._scenario.machine.feed_time_constant
        return np.asarray(column(horizon) * np.arange(1.0, POINTS + 1.0) / POINTS)

    def _early(self, velocity: Array) -> Any:
        """Return how much earlier the tool may reach a bar than expected [mm], for feed velocities [mm/s]."""
        return 0.0

    def _ahead(self, reading: Reading) -> tuple[Outlook, Array, Array]:
        work = self._scenario.workpiece
        velocity = feed_velocity(self._scenario, reading.commanded_cutting_speed, reading.commanded_feed)
        distance = velocity[:, np.newaxis] * self._times
        pitch = work.bar_length + work.approach
        left = column(pitch - self._filter.along)
        early, approach = column(self._early(velocity)), column(work.approach)
        entering = (distance >= left) | (distance + early >= left + approach)
        cutting = (distance - left) % column(pitch) >= approach
        cutting |= (distance + early - left) % column(pitch) >= approach
        outlook = self._filter.outlook(np.minimum(distance, left), entering)
        unmeasured = cutting & (entering | column(self._filter.memory["measured"] == 0))
        return outlook, cutting.astype(np.float64), unmeasured.astype(np.float64)


DESCRIPTION = "the optimiser with foresight: it slows before it enters an unmeasured bar"
RULES = {"predictive": optimising(DESCRIPTION, Predictive, version=4)}
