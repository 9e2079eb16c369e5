"""Tests of the price of edge life."""

import numpy as np
import pytest

from baselines.models.edge_value import USED_LIVES, break_even, worth
from tests.turning_env.playing import changed
from turning_env import Scenario

PRICE = 10.0


def test_a_fresh_edge_is_worth_more_than_a_worn_one() -> None:
    prices = worth(Scenario(), PRICE).life
    assert prices.shape == USED_LIVES.shape
    assert (np.diff(prices) < 0).all()


def test_what_the_edge_is_charged_does_not_change_what_its_life_is_worth() -> None:
    dear = changed(Scenario(), economics={"edge_cost": 30.0})
    assert worth(dear, PRICE).life == pytest.approx(worth(Scenario(), PRICE).life)


def test_prices_are_where_the_best_set_points_gain_nothing() -> None:
    random = np.random.default_rng(0)
    gain, rate, weight = random.normal(size=(5, 3, 200)), random.uniform(0.1, 2.0, (3, 200)), np.array([0.2, 0.5, 0.3])
    prices = np.empty(5)
    break_even(gain, rate, weight, prices)
    best = (gain - prices[:, np.newaxis, np.newaxis] * rate).max(axis=2)
    assert best @ weight == pytest.approx(np.zeros(5), abs=1e-12)


@pytest.mark.slow
def test_where_edges_are_changed_a_whole_edge_pays_for_its_time() -> None:
    """Time that is dear makes a worn edge not worth keeping, the more so the cheaper its successor."""
    shift = Scenario.load("shift")
    worthless = [int((worth(changed(shift, economics={"edge_cost": cost}), PRICE).life <= 0).sum()) for cost in (0.0, 30.0)]
    assert worthless[0] > worthless[1]
