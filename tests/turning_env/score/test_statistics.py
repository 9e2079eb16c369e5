"""Estimates against hand-computed values, against SciPy, and against the truth."""

import numpy as np
import pytest
from scipy import stats

from turning_env.score.statistics import Bootstrap, Estimate, improvement, interquartile_mean


def test_interquartile_mean_drops_a_quarter_at_either_end() -> None:
    assert interquartile_mean(np.array([8.0, 1, 2, 100, 3, 4, 5, -50])) == (2 + 3 + 4 + 5) / 4


@pytest.mark.parametrize("count", [1, 3, 4, 5, 30, 257])
def test_interquartile_mean_is_scipys_trimmed_mean(count: int) -> None:
    values = np.random.default_rng(count).normal(size=(5, count))
    np.testing.assert_allclose(interquartile_mean(values), stats.trim_mean(values, 0.25, axis=-1), rtol=1e-14)


def test_improvement_counts_ties_half_and_averages_over_the_references_seeds() -> None:
    rows = np.array([[1.0, 2, 3, 4]])
    np.testing.assert_array_equal(improvement(rows, np.array([[0.0, 2, 4, 4]])), [[1, 0.5, 0, 0.5]])
    np.testing.assert_array_equal(improvement(rows, np.array([[0.0, 0, 0, 0], [9, 9, 9, 4]])), [[0.5, 0.5, 0.5, 0.75]])


def test_improvement_on_every_pair_is_the_mann_whitney_statistic() -> None:
    generator = np.random.default_rng(1)
    one, other = generator.integers(10, size=40).astype(float), generator.integers(12, size=40).astype(float)
    pairs = improvement(np.repeat(one, 40)[None], np.tile(other, 40)[None])
    assert pairs.mean() == pytest.approx(stats.mannwhitneyu(one, other).statistic / 1600)


def test_interval_of_a_mean_is_that_of_scipy() -> None:
    values = np.random.default_rng(2).exp(size=60)
    estimate = Estimate.of(float(values.mean()), Bootstrap(60, resamples=20000).means(values[None], "policy"))
    theirs = stats.bootstrap((values,), np.mean, method="percentile", n_resamples=20000, rng=3).confidence_interval
    assert (estimate.low, estimate.high) == pytest.approx((theirs.low, theirs.high), abs=0.01)


def test_means_of_resamples_are_those_of_the_resampled_rows() -> None:
    rows = np.random.default_rng(4).normal(size=(3, 11))
    bootstrap = Bootstrap(11, resamples=50)
    seeds, draws = bootstrap._seeds("policy", 3), bootstrap._draws
    by_hand = [rows[np.ix_(seeds[number], draws[number])] for number in range(50)]
    np.testing.assert_allclose(bootstrap.means(rows, "policy"), [part.mean() for part in by_hand], rtol=1e-12)
    trimmed = [stats.trim_mean(part, 0.25, axis=None) for part in by_hand]
    np.testing.assert_allclose(bootstrap.interquartile_means(rows, "policy"), trimmed, rtol=1e-12)


def test_same_rows_give_the_same_numbers() -> None:
    rows = np.random.default_rng(5).normal(size=(2, 9))
    np.testing.assert_array_equal(Bootstrap(9).means(rows, "policy"), Bootstrap(9).means(rows, "policy"))


def test_draws_are_paired_and_training_seeds_are_not() -> None:
    rows = np.random.default_rng(6).normal(size=(1, 30))
    bootstrap = Bootstrap(30)
    difference = bootstrap.means(rows + 1.0, "one") - bootstrap.means(rows, "other")
    np.testing.assert_allclose(difference, 1.0)
    seeds = np.repeat([[0.0], [1.0]], 30, axis=1)
    assert np.corrcoef(bootstrap.means(seeds, "one"), bootstrap.means(seeds, "other"))[0, 1] == pytest.approx(0.0, abs=0.1)


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    generator = np.random.default_rng(7)
    bootstrap = Bootstrap(64, resamples=500)
    covered = 0
    for _ in range(400):
        rows = generator.normal(size=(1, 64))
        estimate = Estimate.of(float(rows.mean()), bootstrap.means(rows, "policy"))
        covered += estimate.low <= 0.0 <= estimate.high
    assert 0.91 <= covered / 400 <= 0.98


def test_training_seeds_widen_the_interval_of_agents_that_differ() -> None:
    generator = np.random.default_rng(8)
    bootstrap, alike = Bootstrap(50), generator.normal(size=(5, 50))
    apart = alike + 3.0 * generator.normal(size=(5, 1))
    assert np.ptp(bootstrap.means(apart, "policy")) > 3.0 * np.ptp(bootstrap.means(alike, "policy"))
