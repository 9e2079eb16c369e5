"""Tests of the price of edge life."""

import numpy as np
import pytest

from baselines.models.edge_value import worth
from tests.turning_env.playing import changed
from turning_env import Scenario

PRICE = 10.0
SHIFT = Scenario.load("shift")


@pytest.mark.slow
def test_where_edges_are_changed_a_whole_edge_pays_for_its_time() -> None:
    """Time that is dear makes a worn edge not worth keeping, the more so the cheaper its successor."""
    worthless = [int((worth(changed(SHIFT, economics={"edge_cost": cost}), PRICE).life <= 0).sum()) for cost in (0.0, 30.0)]
    assert worthless[0] > worthless[1]
    assert (np.diff(worth(Scenario(), PRICE).life) < 0).all()
