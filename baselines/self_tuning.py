"""The optimiser with foresight that learns from a job how the lathe's laws differ from the nominal model.

The filter of ``predictive`` gets further states (dual estimation): errors of the laws of wear, force and power, which last from
edge to edge. It expects those of training jobs (``law_errors.py``) until it has measured loads, and the wear of removed edges.
With these laws, the price of edge life is computed anew in every step (``models/edge_value.py``). It needs of the nominal model
what ``optimiser`` needs.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from baselines import law_errors
from baselines.optimiser import optimising, plays
from baselines.predictive import Predictive
from baselines.rule import Array, Mask, Scenarios
from turning_env import Reading

EARLY = (
    0.3  # time by which the tool may enter a bar earlier than expected [s] (found on training jobs)
)
MIN_SPENT_LIFE = 0.5  # used life below which edges without a price are kept [-]: early estimates of the laws may be wrong


class SelfTuning(Predictive):
    """``Predictive`` on a filter that expects errors of the nominal model; for the ``others`` see ``Optimiser``.

    Attributes, shape (num_envs,), can be set before every action: ``top_speed``, the highest cutting speed over the machine's,
    and ``change_at``, the used life at which edges are changed, if not before. A schedule, where there are forms, replaces them.
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
        self.top_speed, self.change_at = np.full(num_envs, top_speed), np.full(num_envs, change_at)

    def _fastest(self, used_life: Array) -> Any:
        if self._scheduled:
            return super()._fastest(used_life)
        return np.minimum(
            self._scenario.cutting_speed_max,
            self._scenario.machine.cutting_speed_max * self.top_speed,
        )

    def _early(self, velocity: Array) -> Array:
        return self._filter.memory["slack"] + EARLY * velocity

    def _life_rate(self) -> list[Array]:
        errors = self._filter.wear_errors / self._scenario.material.wear.time
        return [
            nominal + error for nominal, error in zip(super()._life_rate(), errors, strict=True)
        ]

    def _spent(self, reading: Reading, used_life: Array, price: Array) -> Mask:
        spent = super()._spent(
            reading, used_life, np.where(used_life < MIN_SPENT_LIFE, np.inf, price)
        )
        return (
            spent
            if self._scheduled
            else spent | ((used_life >= self.change_at) & (reading.nominal_wear > 0.0))
        )


RULES = {
    "self_tuning": replace(
        optimising(
            "the optimiser with foresight, which learns the errors of the laws",
            SelfTuning,
            version=6,
        ),
        plays=lambda scenario: plays(scenario) and scenario.sensors.inspects_edges,
        parameters={"severity": 1.2, "caution": 0.9, "wear_caution": 0.9},  # found on training jobs
        tuned_on=None,
    )
}
