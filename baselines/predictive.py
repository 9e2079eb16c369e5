"""The optimiser with foresight: it also prepares for the next bar.

It does not know that bar's depth and hardness. Travelled distance and geometry determine whether
the tool will be in the present bar, in air or in the next bar at each point of the horizon. An
unmeasured bar may be hard and thick, so the feed must fall before the tool enters it. The feed
servo needs time for that, so the horizon is longer than the step. After the new bar has been
measured, the feed rises again. It suffices to plan one step: it leaves the edge in a state whose
price is known, and a speed and feed from which the next step reaches almost any other.

If the nominal model has forms beside its laws, such as collapse, a schedule sets the highest speed
and when edges are changed (``models/schedule.py``). Uses from the nominal model what ``optimiser``
uses.
"""

from typing import Any

import numpy as np

from baselines.models.schedule import LIVES, has_forms, schedule
from baselines.optimiser import Ahead, Optimiser, column, optimising
from baselines.rule import Array, Mask
from turning_env import Reading
from turning_env.numerics.functions import exp

POINTS = 8  # points of the horizon at which position and loads are predicted
SETTLING = 3.0  # (horizon - step) / time constant of the feed servo [-]
# Found on training jobs: margins between a schedule and what is commanded.
DOUBT = 0.5
"""Standard deviations of the wear by which an edge counts as more worn than expected [-]."""
SPEED_MARGIN = 1.05  # highest speed over that of the schedule [-]
LIFE_MARGIN = 0.95  # used life at the change of the edge over that of the schedule [-]


class Predictive(Optimiser):
    """A policy that maximises the expected gain of each step and of the entry into the next bar.

    Arguments as ``Optimiser``.
    """

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._scheduled = any(has_forms(scenario) for scenario in self._scenarios)
        if self._scheduled:
            plans = [schedule(scenario) for scenario in self._scenarios]
            speeds = np.array([plan.cutting_speed for plan in plans])
            changes = np.array([plan.change_at for plan in plans])
            self._speeds = SPEED_MARGIN * speeds
            self._change_at = LIFE_MARGIN * changes

    def _max_speed(self, used_life: Array) -> Any:
        if not self._scheduled:
            return self._scenario.cutting_speed_max
        # Wear grows as W_max D^n: a factor on wear is its n-th root on the used life D.
        exponent = self._scenario.material.wear.time
        log_wear = self._filter.log_wear_factor + DOUBT * self._filter.wear_deviation
        doubtful_life = used_life * exp(log_wear / exponent)
        begun_steps = (doubtful_life * LIVES).astype(np.int64)
        step = np.minimum(begun_steps, LIVES - 1)
        environments = np.arange(len(step))
        model = environments % len(self._speeds)
        scheduled = self._speeds[model, step]
        return np.minimum(self._scenario.cutting_speed_max, scheduled)

    def _edge_is_spent(self, reading: Reading, used_life: Array, price: Array) -> Mask:
        spent = super()._edge_is_spent(reading, used_life, price)
        if self._scheduled:
            has_cut = reading.nominal_wear > 0.0
            spent |= (used_life >= self._change_at) & has_cut
        return spent

    def _times_ahead(self) -> Array:
        settling = SETTLING * self._scenario.machine.feed_time_constant
        horizon = self._scenario.control.interval + settling
        numbers = np.arange(1.0, POINTS + 1.0)
        times = column(horizon) * numbers / POINTS
        return np.asarray(times)

    def _early(self, velocity: Array) -> Any:
        """Return how much earlier the tool may reach a bar than expected [mm]; velocity in mm/s."""
        return 0.0

    def _ahead(self, reading: Reading) -> Ahead:
        velocity = self._velocity(reading)
        distance = velocity[:, np.newaxis] * self._times
        earlier = distance + column(self._early(velocity))
        pitch = column(self._filter.parameters["pitch"])
        approach = column(self._filter.parameters["approach"])

        # Behind this bar comes the approach to the next one, in air. A point is in metal if the
        # tool is, where it is expected or as early as it may be: entering a bar too fast costs an
        # edge.
        distance_left = pitch - column(self._filter.along)
        cutting = (distance - distance_left) % pitch >= approach
        cutting |= (earlier - distance_left) % pitch >= approach
        entering = (distance >= distance_left) | (earlier >= distance_left + approach)
        measured = column(self._filter.memory["measured"] == 1)
        unmeasured = cutting & (entering | ~measured)
        return Ahead(
            outlook=self._filter.outlook(np.minimum(distance, distance_left), entering),
            cutting=cutting.astype(np.float64),
            unmeasured=unmeasured.astype(np.float64),
        )


DESCRIPTION = "the optimiser with foresight: it slows before it enters an unmeasured bar"
RULES = {"predictive": optimising(DESCRIPTION, Predictive, version=6)}
