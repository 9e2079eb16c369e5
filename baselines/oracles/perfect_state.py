"""The causal oracle: the optimiser with foresight, told the true present state.

Its filter gets the true depth of cut, hardness and wear at the tool after every step. It does not know how depth and hardness go
on from there, nor the next bar. The clairvoyant bound less its return is the cost of not foreseeing. Its return less that of a
policy is the cost of not knowing, if that policy controls as well.

It is not a policy, since no control can measure what it is told, and is never ranked as one.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from baselines.models.kalman import DEPTH, HARDNESS, WEAR, Array, LoadFilter
from baselines.optimiser import plays
from baselines.predictive import Predictive
from turning_env import Reading, Scenario

DOUBT = 1e-3
"""Standard deviation of the told state [-]: of relative depth, log hardness and log wear factor."""
_TOLD = np.eye(5)[[DEPTH, HARDNESS, WEAR]]


class ToldFilter(LoadFilter):
    """A load filter that also learns the true state at the tool. Slopes along the bar follow from successive true states."""

    truth: Mapping[str, Any]
    """``info`` of the vector environment that came with the next observations."""

    def observe(self, reading: Reading) -> None:
        """Move on to a reading and correct the estimate by it and by the truth."""
        super().observe(reading)
        scenario, truth = self._scenario, self.truth
        told = truth["cutting"] & (truth["depth_of_cut"] > 0.0) & (truth["wear"] > 0.0) & (reading.nominal_wear > 0.0)
        wear_factor = np.where(told, truth["wear"], 1.0) / np.where(told, reading.nominal_wear, 1.0)
        states = (
            truth["depth_of_cut"] / scenario.workpiece.depth_of_cut - 1.0,
            np.log(np.where(told, truth["hardness"], 1.0)),
            np.log(wear_factor),
        )
        surprise: Array = np.where(told[:, np.newaxis], np.stack(states, axis=1) - self._mean @ _TOLD.T, 0.0)
        self._correct(_TOLD * told[:, np.newaxis, np.newaxis], surprise, np.full(surprise.shape, DOUBT**2))
        self.measured |= told


class PerfectState(Predictive):
    """``Predictive`` on true states, which ``tell`` gives it before every action."""

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        super().__init__(scenario, num_envs, severity=1.0, caution=1.0)
        self._filter: ToldFilter = ToldFilter(scenario, num_envs)

    def tell(self, infos: Mapping[str, Any]) -> None:
        """Take the ``infos`` that came with the next observations."""
        self._filter.truth = infos


def covers(scenario: Scenario) -> bool:
    """Return whether a scenario has the actions and inputs that it needs."""
    return plays(scenario)
