"""The causal oracle: the optimiser with foresight, with the true present state (docs/results.md).

Its filter gets the true depth of cut, hardness and wear at the tool after every step. It does not
know depth and hardness ahead of the tool, nor the next bar. It is not ranked as a policy, because
no control can measure its inputs.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from baselines.models.kalman_steps import TrueStates
from baselines.optimiser import plays
from baselines.predictive import Predictive
from baselines.rule import Scenarios
from turning_env import Reading
from turning_env.numerics.functions import log

VERSION = 7  # raised when its actions change
STATE_DEVIATION = 1e-3
"""Standard deviation assumed of the true relative depth, log hardness and log wear factor [-]."""


class PerfectState(Predictive):
    """``Predictive`` on true states. Slopes along the bar follow from successive states.

    Call ``tell`` before every action.
    """

    def __init__(self, scenario: Scenarios, num_envs: int) -> None:
        super().__init__(scenario, num_envs, severity=1.0, caution=1.0)

    def tell(self, infos: Mapping[str, Any]) -> None:
        """Take the ``infos`` of the vector environment that came with the next observations."""
        self._truth = infos

    def _observe(self, reading: Reading) -> None:
        super()._observe(reading)
        depth = self._truth["depth_of_cut"]
        wear = self._truth["wear"]
        worn = (wear > 0.0) & (reading.nominal_wear > 0.0)
        known = self._truth["cutting"] & (depth > 0.0) & worn
        # A 1 in place of unknown values keeps the logarithms defined; the mask leaves them out.
        hardness = np.where(known, self._truth["hardness"], 1.0)
        true_wear = np.where(known, wear, 1.0)
        nominal_wear = np.where(known, reading.nominal_wear, 1.0)
        nominal_depth = self._filter.parameters["depth_of_cut"]
        states = TrueStates(
            depth=depth / nominal_depth - 1.0,
            log_hardness=log(hardness),
            log_wear_factor=log(true_wear / nominal_wear),
        )
        self._filter.tell(known, states, STATE_DEVIATION)


covers = plays  # whether a scenario has the actions and inputs that it needs
