"""The optimiser with foresight: it also expects the entry into the next bar, whose depth and hardness it does not know.

The travelled distance and the geometry tell whether the tool will be in the present bar, in air or in the next bar at each point
of the horizon. An unmeasured bar may be hard and thick, so the feed must fall before the tool enters it. That takes the feed
servo some time, so the horizon ends later than the step. Once the new bar has been measured, the feed rises again.

One step is enough to plan. It leaves behind the state of the edge, whose price is known, and a speed and feed from which the next
step reaches almost any other.
"""

import numpy as np

from baselines.models.kalman import Array, Outlook, feed_velocity
from baselines.optimiser import Optimiser, optimising
from turning_env import Reading, Scenario

POINTS = 8
"""Points of the horizon at which position and loads are predicted."""
SETTLING = 3.0
"""Time constants of the feed servo by which the horizon exceeds the step [-]."""


class Predictive(Optimiser):
    """Chooses the cutting speed and feed of each step by the gain that it expects of that step and of the bar to come.

    For the arguments see ``Optimiser``.
    """

    def __init__(self, scenario: Scenario, num_envs: int, severity: float, caution: float) -> None:
        super().__init__(scenario, num_envs, severity, caution)
        horizon = scenario.control.interval + SETTLING * scenario.machine.feed_time_constant
        self._look_at(horizon * np.arange(1.0, POINTS + 1.0) / POINTS)

    def _set_point(self, reading: Reading) -> tuple[Array, Array]:
        work = self._scenario.workpiece
        velocity = feed_velocity(self._scenario, reading.commanded_cutting_speed, reading.commanded_feed)
        distance = velocity[:, np.newaxis] * self._times
        pitch = work.bar_length + work.approach
        left = pitch - self._filter.along[:, np.newaxis]
        entering = distance >= left
        cutting = (distance - left) % pitch >= work.approach
        here, there = self._filter.ahead(np.minimum(distance, left)), self._filter.next_bar()
        outlook = Outlook(*(np.where(entering, b, a) for a, b in zip(here, there, strict=True)))
        unmeasured = cutting & (entering | ~self._filter.measured[:, np.newaxis])
        prospect = self._prospect(reading, outlook, cutting.astype(np.float64), unmeasured.astype(np.float64))
        return self._best(reading, prospect)


DESCRIPTION = "the optimiser with foresight: it slows before it enters an unmeasured bar"
RULES = {"predictive": optimising(DESCRIPTION, Predictive, version=2)}
