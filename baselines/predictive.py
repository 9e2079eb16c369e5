"""The optimiser with foresight: it also prepares for the next bar, whose depth and hardness it does not know.

Travelled distance and geometry determine whether the tool will be in the present bar, in air or in the next bar at each point
of the horizon. An unmeasured bar may be hard and thick, so the feed must fall before the tool enters it. The feed servo needs
time for that, so the horizon is longer than the step. After the new bar has been measured, the feed rises again. It suffices to
plan one step: it leaves the edge in a state whose price is known, and a speed and feed from which the next step reaches almost
any other.

If the nominal model has forms beside its laws, such as collapse, a schedule sets the highest speed and when edges are changed
(``models/schedule.py``). It needs of the nominal model what ``optimiser`` needs.
"""

from typing import Any

import numpy as np

from baselines.models.load_filter import Outlook
from baselines.models.schedule import LIVES, has_forms, schedule
from baselines.optimiser import Optimiser, column, optimising
from baselines.rule import Array, Mask
from turning_env import Reading
from turning_env.numerics.functions import exp

POINTS = 8  # points of the horizon at which position and loads are predicted
SETTLING = 3.0  # (horizon - step) / time constant of the feed servo [-]
DOUBT = 0.5  # standard deviations of the wear by which an edge is taken to be more worn than expected in a schedule [-]
SPEED_MARGIN, LIFE_MARGIN = 1.05, 0.95
"""Highest speed, and used life at the change of the edge, over those of the schedule [-]. (All three: found on training jobs.)"""


class Predictive(Optimiser):
    """A policy that maximises the expected gain of each step and of the entry into the next bar; arguments as ``Optimiser``."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self._scheduled = any(map(has_forms, self._scenarios))
        if self._scheduled:
            plans = [schedule(each) for each in self._scenarios]
            self._speeds = SPEED_MARGIN * np.array([plan.cutting_speed for plan in plans])
            self._change_at = LIFE_MARGIN * np.array([plan.change_at for plan in plans])

    def _fastest(self, used_life: Array) -> Any:
        if not self._scheduled:
            return self._scenario.cutting_speed_max
        log_wear = self._filter.log_wear_factor + DOUBT * self._filter.wear_deviation
        worse = used_life * exp(log_wear / self._scenario.material.wear.time)
        step = np.minimum((worse * LIVES).astype(np.int64), LIVES - 1)
        return np.minimum(
            self._scenario.cutting_speed_max,
            self._speeds[np.arange(len(step)) % len(self._speeds), step],
        )

    def _spent(self, reading: Reading, used_life: Array, price: Array) -> Mask:
        spent = super()._spent(reading, used_life, price)
        return (
            spent | ((used_life >= self._change_at) & (reading.nominal_wear > 0.0))
            if self._scheduled
            else spent
        )

    def _look_at(self) -> Array:
        horizon = (
            self._scenario.control.interval + SETTLING * self._scenario.machine.feed_time_constant
        )
        return np.asarray(column(horizon) * np.arange(1.0, POINTS + 1.0) / POINTS)

    def _early(self, velocity: Array) -> Any:
        """Return how much earlier the tool may reach a bar than expected [mm], for feed velocities [mm/s]."""
        return 0.0

    def _ahead(self, reading: Reading) -> tuple[Outlook, Array, Array]:
        velocity = (
            reading.commanded_cutting_speed
            * reading.commanded_feed
            * self._filter.parameters["velocity"]
        )
        distance = velocity[:, np.newaxis] * self._times
        pitch, approach = (column(self._filter.parameters[name]) for name in ("pitch", "approach"))
        left, sooner = pitch - column(self._filter.along), distance + column(self._early(velocity))
        entering = (distance >= left) | (sooner >= left + approach)
        cutting = ((distance - left) % pitch >= approach) | ((sooner - left) % pitch >= approach)
        outlook = self._filter.outlook(np.minimum(distance, left), entering)
        unmeasured = cutting & (entering | column(self._filter.memory["measured"] == 0))
        return outlook, cutting.astype(np.float64), unmeasured.astype(np.float64)


DESCRIPTION = "the optimiser with foresight: it slows before it enters an unmeasured bar"
RULES = {"predictive": optimising(DESCRIPTION, Predictive, version=6)}
