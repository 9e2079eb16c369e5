"""The optimiser with foresight that learns from a job the errors of the nominal laws and of the nominal life of its edges.

The filter of ``predictive`` gets further states (dual estimation): bias and exponents of the laws of force and power, and the
wear factor of the lot, which lasts from edge to edge. Measured loads correct the laws. The measured wear of each removed edge
corrects the lot, and with it the time of the next change and the price of life: if edges last shorter, time is worth less.

It needs the nominal model of ``predictive``, and prior deviations of laws and lot.
"""

from collections.abc import Sequence

import numpy as np

from baselines.models.load_filter import Array, LoadFilter, Uncertainty
from baselines.optimiser import plays
from baselines.predictive import Predictive
from baselines.rule import Range, Rule
from turning_env import Scenario
from turning_env.numerics.functions import log

REACH = 1.5
"""Distance of the slowest and the fastest lot that are priced from the expected one, over the prior deviation [-]."""


class SelfTuning(Predictive):
    """A policy as ``Predictive``, on a filter that also estimates errors of the nominal model.

    Args:
        scenario: nominal model, or one for each environment, which all have the same actions and sensors.
        num_envs: number of environments.
        severity: factor on the price of overload [-].
        caution: factor on the standard deviations of force and power [-].
        wear_caution: factor on the standard deviation of the wear at which an edge may soon be worn out [-].
        law_doubt: scale of the prior deviations of the laws of force and power [-], see ``load_filter.LAW_ERRORS``.
        lot_doubt: prior log standard deviation of the life of the lot's edges [-].
        lot_life: expected life of the lot's edges over the nominal life [-].
    """

    def __init__(
        self,
        scenario: Scenario | Sequence[Scenario],
        num_envs: int,
        severity: float,
        caution: float,
        wear_caution: float,
        law_doubt: float,
        lot_doubt: float,
        lot_life: float,
    ) -> None:
        self.wear_caution = wear_caution
        self._uncertainty = Uncertainty(law_doubt, lot_doubt, lot_life)
        super().__init__(scenario, num_envs, severity, caution)

    def _new_filter(self, num_envs: int) -> LoadFilter:
        return LoadFilter(self._scenarios, num_envs, self._uncertainty)

    def _log_rates(self) -> Array:
        lots: Array = self._uncertainty.lot * REACH * np.array([-1.0, 0.0, 1.0]) - log(self._uncertainty.lot_life)
        return lots if self._uncertainty.lot > 0.0 else lots[:1]


DESCRIPTION = "the optimiser with foresight, which learns the errors of the laws and the wear of the lot"
RULES = {
    "self_tuning": Rule(
        DESCRIPTION,
        lambda scenario, num_envs, parameters: SelfTuning(scenario, num_envs, **parameters),
        lambda scenario: plays(scenario) and scenario.sensors.inspects_edges,
        {
            "severity": 1.2,
            "caution": Range(0.5, 2.0, logarithmic=True),
            "wear_caution": Range(0.3, 3.0, logarithmic=True),
            "law_doubt": Range(0.3, 3.0, logarithmic=True),
            "lot_doubt": 0.4,
            "lot_life": 0.78,
        },
        version=3,
        changes_edges=True,
        together=True,
        tuned_on="shop",
    )
}
