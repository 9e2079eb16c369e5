"""The normal distribution against SciPy's, and the expected excess against its integral."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from baselines.models.normal import excess, probability, tail

POINTS = [-6.0, -2.5, -1.0, -0.1, 0.0, 0.1, 1.0, 2.5, 6.0]


@pytest.mark.parametrize("z", [z for z in POINTS if z >= 0.0])
def test_the_tail_is_scipys_over_its_exponential(z: float) -> None:
    assert tail(z) * math.exp(-0.5 * z * z) == pytest.approx(norm.sf(z), abs=1e-7)
    # Far out, the relative error counts.
    assert tail(z) * math.exp(-0.5 * z * z) == pytest.approx(norm.sf(z), rel=5e-3)


@pytest.mark.parametrize("x", POINTS)
def test_the_probability_and_its_density_are_scipys(x: float) -> None:
    found = probability(x)
    assert found.below == pytest.approx(norm.cdf(x), abs=1e-7)
    assert found.density == pytest.approx(norm.pdf(x), rel=1e-9)


def test_probabilities_of_arrays_are_those_of_their_elements() -> None:
    found = probability(np.array(POINTS))
    np.testing.assert_array_equal(found.below, [probability(x).below for x in POINTS])


def test_small_probabilities_keep_their_digits() -> None:
    assert probability(-6.0).below == pytest.approx(norm.cdf(-6.0), rel=5e-3)


def integral(log_mean: float, spread: float) -> float:
    """Return the expectation of max(X - 1, 0) by integration over the normal number."""

    def integrand(z: float) -> float:
        return max(math.exp(log_mean + spread * z) - 1.0, 0.0) * float(norm.pdf(z))

    # The excess begins where X is 1.
    start = max(-log_mean / spread, -12.0)
    return float(quad(integrand, start, start + 24.0, epsabs=1e-12)[0])


@pytest.mark.parametrize("spread", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("log_mean", [-0.3, -0.04, -0.01, 0.0, 0.03, 0.4])
def test_the_expected_excess_is_its_integral_and_slopes_are_differences(
    log_mean: float, spread: float
) -> None:
    found = excess(log_mean, spread)
    assert found.value == pytest.approx(integral(log_mean, spread), abs=4e-7)
    # The slope is the mean of X where it is above 1.
    beyond = log_mean / spread + spread
    slope = math.exp(log_mean + 0.5 * spread**2) * float(norm.cdf(beyond))
    assert found.slope == pytest.approx(slope, abs=4e-7)
    step = 0.01 * spread
    above = integral(log_mean + step, spread)
    below = integral(log_mean - step, spread)
    curvature = (above - 2.0 * integral(log_mean, spread) + below) / step**2
    assert found.slope == pytest.approx((above - below) / (2.0 * step), abs=1e-4)
    assert found.curvature == pytest.approx(curvature, rel=1e-3, abs=1e-3)


def test_far_below_the_limit_nothing_is_expected() -> None:
    assert np.abs(excess(-2.0, 0.1)) == pytest.approx(0.0, abs=1e-12)
