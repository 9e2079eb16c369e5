"""Estimates against values computed by hand, and against the spread of means."""

import numpy as np
import pytest

from leaderboard.statistics import (
    Bootstrap,
    interquartile_mean,
    quantiles,
    severe_share,
)

ENGAGED = np.array([100.0, 300.0, 200.0, 50.0, 250.0])  # [s]
SEVERE = np.array([10.0, 0.0, 4.0, 0.0, 30.0])  # [s]


def test_resamples_vary_as_means_do() -> None:
    values = np.random.default_rng(4).normal(size=(1, 100))
    bootstrap = Bootstrap(100)
    means = bootstrap.means(values, "rule")
    interquartile_means = bootstrap.interquartile_means(values, "rule")
    assert means.mean() == pytest.approx(values.mean(), abs=0.01)
    assert means.std() == pytest.approx(values.std() / 10.0, abs=0.01)
    assert interquartile_means.mean() == pytest.approx(interquartile_mean(values[0]), abs=0.02)
    assert np.corrcoef(means, interquartile_means)[0, 1] > 0.8


def test_interquartile_mean_drops_a_quarter_at_either_end() -> None:
    eight = np.array([8.0, 1, 2, 100, 3, 4, 5, -50])
    five = np.array([9.0, 1, 2, 3, 4])
    assert interquartile_mean(eight) == (2 + 3 + 4 + 5) / 4
    assert interquartile_mean(five) == 3.0


def test_seeds_are_paired() -> None:
    values = np.random.default_rng(6).normal(size=(1, 30))
    bootstrap = Bootstrap(30)
    difference = bootstrap.means(values + 1.0, "better") - bootstrap.means(values, "worse")
    np.testing.assert_allclose(difference, 1.0)


def test_the_same_episodes_give_the_same_resamples() -> None:
    values = np.random.default_rng(6).normal(size=(1, 30))
    first = Bootstrap(30).means(values, "rule")
    second = Bootstrap(30).means(values, "rule")
    np.testing.assert_array_equal(first, second)


def test_training_seeds_are_not_paired() -> None:
    values = np.repeat([[0.0], [1.0]], 30, axis=1)  # the second training seed is better
    bootstrap = Bootstrap(30)
    first = bootstrap.means(values, "first")
    second = bootstrap.means(values, "second")
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("count", [2, 3, 40, 2000])
def test_quantiles_are_those_of_numpy(count: int) -> None:
    values = np.random.default_rng(count).normal(size=count)
    for low, high in ((0.025, 0.975), (0.05, 0.95), (0.0, 1.0)):
        assert quantiles(values, low, high) == tuple(np.quantile(values, [low, high]))


def test_shares_above_levels_are_means_of_the_values_above() -> None:
    values = np.random.default_rng(8).normal(size=(3, 40)).round(1)  # some are equal
    levels = np.array([-9.0, 0.0, 0.5, 9.0])
    bootstrap = Bootstrap(40)
    shares = bootstrap.shares_above(values, levels, "agent")
    for level, share in zip(levels, shares, strict=True):
        above = np.asarray(values > level, np.float64)
        np.testing.assert_allclose(share, bootstrap.means(above, "agent"), atol=1e-12)


def test_the_limit_is_above_the_share() -> None:
    share = severe_share(SEVERE, ENGAGED)
    assert share == pytest.approx(44 / 900)
    limit = Bootstrap(len(SEVERE)).severe_limit(SEVERE[None], ENGAGED[None], "rule")
    assert share < limit < max(SEVERE / ENGAGED)
