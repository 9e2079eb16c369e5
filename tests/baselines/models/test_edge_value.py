"""What life is worth."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from baselines.models.edge_value import USED_LIVES, _prices, expected_excess, worth
from tests.turning_env.playing import changed
from turning_env import Scenario

PRICE = 10.0


@pytest.mark.parametrize(("log_mean", "spread"), [(-0.5, 0.1), (-0.02, 0.05), (0.0, 0.2), (0.3, 0.1)])
def test_the_expected_excess_is_the_integral(log_mean: float, spread: float) -> None:
    def integrand(z: float) -> float:
        return float(max(np.exp(log_mean + spread * z) - 1.0, 0.0) * norm.pdf(z))

    assert expected_excess(np.array(log_mean), spread) == pytest.approx(quad(integrand, -8, 8, points=[-log_mean / spread])[0])


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
    prices = _prices(gain, rate, weight)
    best = (gain - prices[:, np.newaxis, np.newaxis] * rate).max(axis=2)
    assert best @ weight == pytest.approx(np.zeros(5), abs=1e-12)


@pytest.mark.slow
def test_where_edges_are_changed_a_whole_edge_pays_for_its_time() -> None:
    """Time that is dear makes a worn edge not worth keeping, the more so the cheaper its successor."""
    shift = Scenario.load("shift")
    worthless = [int((worth(changed(shift, economics={"edge_cost": cost}), PRICE).life <= 0).sum()) for cost in (0.0, 30.0)]
    assert worthless[0] > worthless[1]
