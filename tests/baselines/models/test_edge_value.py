"""Tests of the price of edge life."""

import numpy as np
import pytest

from baselines.models.edge_value import USED_LIVES, price_life, worth
from baselines.models.load_filter import records
from baselines.optimiser import numbers
from tests.turning_env.playing import changed
from turning_env import Scenario

PRICE = 10.0
SHIFT = Scenario.load("shift")


@pytest.mark.slow
def test_where_edges_are_changed_a_whole_edge_pays_for_its_time() -> None:
    """Time that is dear makes a worn edge not worth keeping, the more so the cheaper its successor."""
    worthless = [int((worth(changed(SHIFT, economics={"edge_cost": cost}), PRICE).life <= 0).sum()) for cost in (0.0, 30.0)]
    assert worthless[0] > worthless[1]


def price_of_laws(life_rate: float = 0.0, force: float = 0.0, power: float = 0.0) -> np.ndarray:
    """Return prices of life [s] by laws with changes of their logarithms."""
    parameters, shares = records([numbers(SHIFT, 1.0)]), USED_LIVES[3::6]
    laws = list(parameters["life"][0]) + [0.0] * 8
    laws[0] += life_rate
    for first, name, law, change in ((3, "force", SHIFT.material.thrust_force, force), (7, "power", SHIFT.material.power, power)):
        exponents = law.cutting_speed, law.feed, law.wear * SHIFT.material.wear.time
        laws[first : first + 4] = parameters[name][0] + change, *exponents
    found = np.empty(len(shares))
    price_life(parameters, np.tile(laws, (len(shares), 1)), shares, found)
    return found


def test_the_price_by_estimated_laws_is_near_that_by_dynamic_programming_and_follows_the_laws() -> None:
    exact, found = worth(SHIFT, SHIFT.economics.overload_price).life[3::6], price_of_laws()
    assert found == pytest.approx(exact, abs=0.15 * exact.max())
    assert (np.diff(exact) < 0.0).all()
    assert (np.diff(found) < 0.0).all()
    assert (price_of_laws(force=-0.2, power=-0.2)[-2:] >= found[-2:]).all()
    assert (price_of_laws(life_rate=0.3) < found)[0]
