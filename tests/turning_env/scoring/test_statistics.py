"""Estimates against hand-computed values, against SciPy, and against the truth."""

import numpy as np
import pytest

from turning_env.scoring.statistics import Bootstrap, interquartile_mean, severe_share


def test_resamples_vary_as_means_do() -> None:
    values, bootstrap = np.random.default_rng(4).normal(size=(1, 100)), Bootstrap(100)
    means, middle = bootstrap.means(values, "rule"), bootstrap.interquartile_means(values, "rule")
    assert (means.mean(), means.std()) == pytest.approx(
        (values.mean(), values.std() / 10.0), abs=0.01
    )
    assert middle.mean() == pytest.approx(interquartile_mean(values[0]), abs=0.02)
    assert np.corrcoef(means, middle)[0, 1] > 0.8


def test_interquartile_mean_drops_a_quarter_at_either_end() -> None:
    assert interquartile_mean(np.array([8.0, 1, 2, 100, 3, 4, 5, -50])) == (2 + 3 + 4 + 5) / 4
    assert interquartile_mean(np.array([9.0, 1, 2, 3, 4])) == 3.0


def test_seeds_are_paired_and_training_seeds_are_not() -> None:
    values = np.random.default_rng(6).normal(size=(1, 30))
    bootstrap = Bootstrap(30)
    difference = bootstrap.means(values + 1.0, "one") - bootstrap.means(values, "other")
    np.testing.assert_allclose(difference, 1.0)
    np.testing.assert_array_equal(
        bootstrap.means(values, "one"), Bootstrap(30).means(values, "one")
    )
    trained = np.repeat([[0.0], [1.0]], 30, axis=1)
    assert np.corrcoef(bootstrap.means(trained, "one"), bootstrap.means(trained, "other"))[
        0, 1
    ] == pytest.approx(0, abs=0.1)


ENGAGED = np.array([100.0, 300.0, 200.0, 50.0, 250.0])
SEVERE = np.array([10.0, 0.0, 4.0, 0.0, 30.0])


def test_the_limit_is_above_the_share() -> None:
    assert severe_share(SEVERE, ENGAGED) == pytest.approx(44 / 900)
    limit = Bootstrap(len(SEVERE)).severe_limit(SEVERE[None], ENGAGED[None], "rule")
    assert severe_share(SEVERE, ENGAGED) < limit < max(SEVERE / ENGAGED)
