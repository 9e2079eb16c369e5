"""The optimiser with foresight that learns how a lathe's laws differ from the nominal model.

The filter of ``predictive`` gets further states (dual estimation): errors of the laws of wear,
force and power, which last from edge to edge. It expects those of training jobs (``law_errors.py``)
until it has measured loads, and the wear of removed edges. With these laws, the price of edge life
is computed anew in every step (``models/edge_value.py``). Uses from the nominal model what
``optimiser`` uses.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from baselines import law_errors
from baselines.optimiser import LifeLaw, optimising, plays
from baselines.predictive import Predictive
from baselines.rule import Array, Mask, Scenarios
from turning_env import Reading

EARLY = 0.3
"""Time by which the tool may enter a bar earlier than expected [s] (found on training jobs)."""
MIN_SPENT_LIFE = 0.5
"""Used life below which edges without a price are kept [-]: early estimates of the laws may be
wrong."""


class SelfTuning(Predictive):
    """``Predictive`` on a filter that expects errors of the nominal model.

    A schedule, where there are forms, replaces the highest speed and the used life at the change.

    Args:
        scenario: nominal model, or one for each environment.
        num_envs: number of environments.
        top_speed: highest cutting speed over the machine's [-].
        change_at: used life at which edges are changed, if not before [-].
        others: ``severity``, ``caution`` and ``wear_caution`` of ``Optimiser``.

    Attributes:
        top_speed: as above, of each environment, shape (num_envs,); it can be set before every
            action.
        change_at: likewise.
    """

    _priced_spread = 0.0  # its filter follows the bars that an edge has cut

    def __init__(
        self,
        scenario: Scenarios,
        num_envs: int,
        top_speed: float = 1.0,
        change_at: float = 1.0,
        **others: float,
    ) -> None:
        super().__init__(scenario, num_envs, **others, errors=law_errors.read())
        self.top_speed = np.full(num_envs, top_speed)
        self.change_at = np.full(num_envs, change_at)

    def _max_speed(self, used_life: Array) -> Any:
        if self._scheduled:
            return super()._max_speed(used_life)
        top_speed = self._scenario.machine.cutting_speed_max * self.top_speed
        return np.minimum(self._scenario.cutting_speed_max, top_speed)

    def _early(self, velocity: Array) -> Array:
        # An edge that was found worn or broken ended its step early, so the position is uncertain.
        return self._filter.memory["slack"] + EARLY * velocity

    def _life_law(self) -> LifeLaw:
        nominal = self._nominal_life_law()
        errors = self._filter.wear_errors
        # Wear grows as W_max D^n, so an error of log wear is its n-th part in the log of life D.
        exponent = self._scenario.material.wear.time
        return LifeLaw(
            log_rate=nominal.log_rate + errors.log_wear / exponent,
            speed=nominal.speed + errors.speed_exponent / exponent,
            feed=nominal.feed + errors.feed_exponent / exponent,
        )

    def _edge_is_spent(self, reading: Reading, used_life: Array, price: Array) -> Mask:
        # ``Optimiser`` changes an edge whose life has no price. Early in its life, such a price is
        # an error of the laws, so an edge with so short a life is kept.
        believed_price = np.where(used_life < MIN_SPENT_LIFE, np.inf, price)
        spent = super()._edge_is_spent(reading, used_life, believed_price)
        if not self._scheduled:
            spent |= (used_life >= self.change_at) & (reading.nominal_wear > 0.0)
        return spent


DESCRIPTION = "the optimiser with foresight, which learns the errors of the laws"
RULES = {
    "self_tuning": replace(
        optimising(DESCRIPTION, SelfTuning, version=6),
        plays=lambda scenario: plays(scenario) and scenario.sensors.inspects_edges,
        parameters={"severity": 1.2, "caution": 0.9, "wear_caution": 0.9},  # found on training jobs
        tuned_on=None,
    )
}
