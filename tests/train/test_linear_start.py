"""The linear policy at which a search on a family starts."""

import numpy as np
import pytest

from baselines.nominal_optimum import FixedNominalOptimum
from leaderboard.play import play_family
from train.linear_start import nominal_optimum
from turning_env import Family
from turning_env.policy import Actions, Observations, Policy

JOBS = [0, 1, 2, 3]


class Linear(Policy):
    """A linear policy."""

    def __init__(self, family: Family) -> None:
        self._start = nominal_optimum(family)

    def act(self, observations: Observations) -> Actions:
        actions = observations @ self._start.matrix.T + self._start.constants
        return np.clip(actions, -1.0, 1.0).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["shop", "unmodelled"])
def test_the_start_plays_the_nominal_optimum_of_each_job(name: str) -> None:
    """As the rule that knows it: jobs of another split than those on which it is fitted."""
    family = Family.load(name)
    jobs = [family.job(index, "validation") for index in JOBS]
    linear = play_family(family, "validation", JOBS, lambda _: Linear(family), "told")
    fixed = play_family(family, "validation", JOBS, lambda _: FixedNominalOptimum(jobs), "hidden")
    assert linear["edges_used"] == pytest.approx(fixed["edges_used"])
    assert linear["removed"] == pytest.approx(fixed["removed"], rel=1e-3)
