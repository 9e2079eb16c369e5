"""The optimiser with foresight: it knows when the tool enters the next bar, of which it only knows what bars are like.

The filter's odometer and the geometry tell what the tool will be in at every point of the interval: the present bar, the air
before the next one, or the next one itself. An unmeasured bar may be hard and thick, so the feed has to fall before the tool
enters, not when force and power have told. That takes the feed servo some time: what is looked at ends later than the interval,
as the next command cannot help at once. When the new bar has been measured, the feed rises again.

More than one interval need not be planned: what an interval leaves behind is the state of the edge, whose price is known, and
speeds and feeds from which the next interval reaches almost any other.
"""

import numpy as np

from baselines.models.kalman import Array, Outlook, feed_velocity
from baselines.optimiser import PARAMETERS, Optimiser, plays
from baselines.rule import Rule
from turning_env import Reading, Scenario

POINTS = 8
"""Points in time at which the tool's place and the loads are predicted."""
SETTLING = 3.0
"""Time constants of the feed servo by which what is looked at ends later than the interval [-]."""


class Predictive(Optimiser):
    """Chooses each interval's cutting speed and feed by what it expects of that interval and of the bar to come.

    Args:
        scenario: what is played.
        lanes: how many lanes it controls.
        severity: factor on the price of overload [-]; above 1, limits are held better than pays.
        caution: factor on the standard deviations of force and power [-].
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


RULES = {
    "predictive": Rule(
        "the optimiser, which also slows for the entry into bars that it does not know",
        lambda scenario, num_envs, parameters: Predictive(scenario, num_envs, **parameters),
        plays,
        PARAMETERS,
        changes_edges=True,
        tuned_on="rough_turning",
    )
}
