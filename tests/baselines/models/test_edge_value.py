"""The price of edge life."""

import numpy as np
import pytest

from baselines.optimiser import worth
from turning_env import Scenario


def test_life_is_dearer_early_and_an_edge_pays_for_itself() -> None:
    shift, endless = Scenario.load("shift"), Scenario()
    for scenario in (shift, endless):
        assert (np.diff(worth(scenario).life) <= 0.0).all()
    assert worth(endless).time == 1.0
    assert (
        worth(endless).life[-1] < 0.0 == worth(shift).life[-1]
    )  # an edge that no command changes must be used up
    cost = shift.economics.edge_cost + worth(shift).time * shift.economics.edge_change_time
    assert worth(shift).life.mean() == pytest.approx(60.0 * cost, rel=0.05)
