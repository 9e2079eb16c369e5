"""The optimiser with foresight that learns from a job how the lathe's laws differ from the nominal model.

The filter of ``predictive`` gets further states (dual estimation): errors of the laws of wear, force and power, which last from
edge to edge. It expects those of training jobs (``law_errors.py``) until it has measured loads, and the wear of removed edges.
With these laws, the price of edge life is computed anew in every step (``models/edge_value.py``).

It needs of the nominal model what ``predictive`` needs.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines import law_errors
from baselines.models.edge_value import price_life
from baselines.models.load_filter import Array
from baselines.optimiser import optimising, plays
from baselines.predictive import Predictive
from turning_env import Reading, Scenario

EARLY = 0.3
"""Time by which the tool may enter a bar earlier than expected [s] (found on training jobs)."""
MIN_SPENT_LIFE = 0.5
"""Used life below which an edge is not changed because its life has no price [-]: early estimates of the laws may be wrong."""


class SelfTuning(Predictive):
    """A policy as ``Predictive``, on a filter that expects errors of the nominal model.

    See ``Optimiser`` for the other arguments. Attributes, shape (num_envs,), can be set before every action. A schedule of a
    nominal model with forms takes their place.

    Attributes:
        top_speed: highest cutting speed over the machine's highest one [-].
        change_at: used life at which edges are changed, if not before [-].
    """

    def __init__(
        self,
        scenario: Scenario | Sequence[Scenario],
        num_envs: int,
        severity: float,
        caution: float,
        wear_caution: float,
        top_speed: float = 1.0,
        change_at: float = 1.0,
    ) -> None:
        super().__init__(scenario, num_envs, severity, caution, wear_caution, law_errors.read())
        self.top_speed, self.change_at = np.full(num_envs, top_speed), np.full(num_envs, change_at)

    def _fastest(self, used_life: Array) -> Any:
        if self._scheduled:
            return super()._fastest(used_life)
        return np.minimum(self._scenario.cutting_speed_max, self._scenario.machine.cutting_speed_max * self.top_speed)

    def _early(self, velocity: Array) -> Array:
        return self._filter.memory["slack"] + EARLY * velocity

    def _life_rate(self) -> list[Array]:
        errors = self._filter.wear_errors / self._scenario.material.wear.time
        return [nominal + error for nominal, error in zip(super()._life_rate(), errors, strict=True)]

    def _price(self, used_life: Array) -> Array:
        exponents = self._filter.exponents.T * np.ones(len(used_life))  # (speed, feed and wear; force and power; num_envs)
        laws = self._life_rate()
        for law, name in enumerate(("force", "power")):
            speed, feed, wear = exponents[:, law]
            log_load = self._parameters[name] + self._filter.load_errors[law]
            laws += [log_load, speed, feed, self._parameters["wear_time"] * wear]
        prices = np.empty(len(used_life))
        price_life(self._parameters, np.stack(laws, axis=1), used_life, prices)
        return prices

    def _spent(self, reading: Reading, used_life: Array, price: Array) -> NDArray[np.bool_]:
        spent = super()._spent(reading, used_life, np.where(used_life < MIN_SPENT_LIFE, np.inf, price))
        return spent if self._scheduled else spent | ((used_life >= self.change_at) & (reading.nominal_wear > 0.0))


DESCRIPTION = "the optimiser with foresight, which learns the errors of the laws"
RULES = {
    "self_tuning": replace(
        optimising(DESCRIPTION, SelfTuning, version=6),
        plays=lambda scenario: plays(scenario) and scenario.sensors.inspects_edges,
        parameters={"severity": 1.2, "caution": 0.9, "wear_caution": 0.9},  # found on training jobs
        tuned_on=None,
    )
}
