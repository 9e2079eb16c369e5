"""The causal reference: what control can do that knows the present perfectly, and of what is to come only what it is like.

It is the optimiser with foresight (``predictive.py``), whose filter is told the true depth of cut, hardness and wear at the tool
after every interval. It does not know how depth and hardness go on from there, nor what the next bar is like. What it earns less
than the clairvoyant bound is the price of not foreseeing; what a policy of observations earns less than it is the price of not
knowing, if that policy controls as well.

It is no policy: it is told what no control can measure, so it is never ranked as one.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from baselines.models.kalman import DEPTH, HARDNESS, WEAR, Array, LoadFilter
from baselines.optimiser import plays
from baselines.predictive import Predictive
from turning_env import Reading, Scenario

DOUBT = 1e-3
"""Standard deviation with which the truth is told [-]: of relative depth, log hardness and log wear factor alike."""
_TOLD = np.eye(5)[[DEPTH, HARDNESS, WEAR]]


class ToldFilter(LoadFilter):
    """A load filter that learns the truth at the tool, too. Slopes along the bar follow from one truth after another."""

    truth: Mapping[str, Any]
    """``info`` of the vector environment, as it came with the observations that are to be read next."""

    def observe(self, reading: Reading) -> None:
        """Move on to a reading, and learn from it and from the truth."""
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
    """``Predictive`` on true states, which has to be told them before every action."""

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        super().__init__(scenario, num_envs, severity=1.0, caution=1.0)
        self._filter: ToldFilter = ToldFilter(scenario, num_envs)

    def tell(self, infos: Mapping[str, Any]) -> None:
        """Tell the ``infos`` that came with the observations to be acted on next."""
        self._filter.truth = infos


def covers(scenario: Scenario) -> bool:
    """Whether a scenario offers the actions and inputs that it needs."""
    return plays(scenario)
