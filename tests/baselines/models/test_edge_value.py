"""The price of edge life."""

import numpy as np
import pytest

from baselines.optimiser import worth
from turning_env import Scenario

SHIFT = Scenario.load("shift")
ENDLESS = Scenario()


@pytest.mark.parametrize("scenario", [SHIFT, ENDLESS], ids=["shift", "endless"])
def test_life_is_dearer_early(scenario: Scenario) -> None:
    assert (np.diff(worth(scenario).life) <= 0.0).all()


def test_an_edge_that_no_command_changes_must_be_used_up() -> None:
    assert worth(ENDLESS).time == 1.0
    assert worth(ENDLESS).life[-1] < 0.0
    assert worth(SHIFT).life[-1] == 0.0


def test_an_edge_pays_for_itself_and_its_change() -> None:
    prices = worth(SHIFT)
    cost = SHIFT.economics.edge_cost + prices.time * SHIFT.economics.edge_change_time
    assert prices.life.mean() == pytest.approx(60.0 * cost, rel=0.05)
