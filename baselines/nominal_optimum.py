"""The nominal model's best set point of each job of a family, or a share of it.

They are the fixed parameters with which all policies of families are compared
(``baselines/comparators.py``).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from turning_env.action import towards
from turning_env.observation import read
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.family import Family, Job
from turning_env.scenario.scenario_batch import ScenarioBatch

CHANGE_WEAR = 0.95
"""Nominal wear over the criterion at which edges are changed [-] (assumption)."""


class SetPointShares(NamedTuple):
    """Shares of the nominal optimum's cutting speed and feed [-]."""

    cutting_speed: float
    feed: float


WHOLE = SetPointShares(cutting_speed=1.0, feed=1.0)
FEASIBLE_SHARES = {
    "shop": SetPointShares(cutting_speed=0.94, feed=0.69),
    "unmodelled": SetPointShares(cutting_speed=0.65, feed=0.6),
}
"""Shares with the highest mean return of those that are feasible on training jobs.

``python -m research.studies.family_fixed`` compares them.
"""
USUAL_SHARES = SetPointShares(cutting_speed=0.85, feed=0.62)  # on other families


def feasible_shares(family: Family) -> SetPointShares:
    """Return the shares of the nominal optimum that are feasible on a family."""
    return FEASIBLE_SHARES.get(family.name, USUAL_SHARES)


class FixedNominalOptimum(Policy):
    """The nominal model's best set point of each job on a half-worn edge, or shares of it.

    Edges are changed by nominal wear.
    """

    def __init__(self, jobs: Sequence[Job], shares: SetPointShares = WHOLE) -> None:
        self._scenarios: Any = ScenarioBatch.of([job.scenario for job in jobs])
        cutting_speeds = np.array([job.cutting_speed for job in jobs])
        self._cutting_speeds = shares.cutting_speed * cutting_speeds
        self._feeds = shares.feed * np.array([job.feed for job in jobs])

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, 3), for observations, shape (num_envs, entries)."""
        reading = read(observations, self._scenarios)
        change = reading.nominal_wear >= CHANGE_WEAR * self._scenarios.tool.wear_criterion
        return towards(
            reading,
            self._scenarios,
            cutting_speed=self._cutting_speeds,
            feed=self._feeds,
            change_edge=change,
        )
