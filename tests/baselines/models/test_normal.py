"""The normal distribution of compiled loops is SciPy's."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from baselines.models.normal import excess


@pytest.mark.parametrize("spread", [1e-3, 0.05, 1.0])
def test_the_expected_excess_is_that_of_a_log_normal_variable(spread: float) -> None:
    def expected_excess(log_mean: NDArray[np.float64], spread: float) -> Any:
        """Black and Scholes (1973)."""
        ratio = log_mean / spread
        return np.exp(log_mean + 0.5 * spread**2) * ndtr(ratio + spread) - ndtr(ratio)

    means, by = np.linspace(-2.0, 1.0, 61), 0.01 * spread
    value, slope, bend = np.transpose([excess(mean, spread) for mean in means])
    below, at, above = (expected_excess(means + step, spread) for step in (-by, 0.0, by))
    assert value == pytest.approx(at, abs=1e-6)
    assert slope == pytest.approx((above - below) / (2.0 * by), rel=1e-4, abs=1e-4)
    assert bend == pytest.approx((above - 2.0 * at + below) / by**2, rel=1e-3, abs=1e-3)
