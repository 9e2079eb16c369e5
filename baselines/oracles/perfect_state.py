"""The causal oracle: the optimiser with foresight, with the true present state.

Its filter gets the true depth of cut, hardness and wear at the tool after every step. It does not know depth and hardness ahead
of the tool, nor the next bar. So the clairvoyant bound minus its return is the cost of not knowing the future. Its return minus a
policy's is the cost of not knowing the present, if that policy controls equally well.

It is not ranked as a policy, because no control can measure its inputs.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from baselines.models.schedule import has_forms
from baselines.optimiser import plays
from baselines.predictive import Predictive
from turning_env import Reading, Scenario
from turning_env.numerics.functions import log

STATE_DEVIATION = 1e-3  # standard deviation assumed of the true relative depth, log hardness and log wear factor [-]


class PerfectState(Predictive):
    """``Predictive`` on true states; call ``tell`` before every action. Slopes along the bar follow from successive states."""

    def __init__(self, scenario: Scenario | Sequence[Scenario], num_envs: int) -> None:
        super().__init__(scenario, num_envs, severity=1.0, caution=1.0)

    def tell(self, infos: Mapping[str, Any]) -> None:
        """Take the ``infos`` of the vector environment that came with the next observations."""
        self._truth = infos

    def _observe(self, reading: Reading) -> None:
        super()._observe(reading)
        truth = self._truth
        known = truth["cutting"] & (truth["depth_of_cut"] > 0.0) & (truth["wear"] > 0.0) & (reading.nominal_wear > 0.0)
        wear_factor = np.where(known, truth["wear"], 1.0) / np.where(known, reading.nominal_wear, 1.0)
        depth = truth["depth_of_cut"] / self._filter.parameters["depth_of_cut"] - 1.0
        hardness = log(np.where(known, truth["hardness"], 1.0))
        self._filter.tell(known, np.stack((depth, hardness, log(wear_factor)), axis=1), STATE_DEVIATION)


covers = plays  # whether a scenario has the actions and inputs that it needs


def version_on(scenario: Scenario) -> int:
    """Return its version: 6 where it follows the schedule of a scenario with forms; elsewhere it acts as in version 5."""
    return 6 if has_forms(scenario) else 5
