"""The normal distribution of compiled loops is SciPy's."""

import numpy as np
import pytest
from scipy.special import ndtr

from baselines.models.edge_value import expected_excess
from baselines.models.normal import excess, probability


def test_probabilities_are_those_of_scipy() -> None:
    values = np.concatenate([np.linspace(-40.0, 40.0, 801), np.array([-np.sqrt(2.0), 0.0, np.sqrt(2.0)])])
    assert [probability(value) for value in values] == pytest.approx(ndtr(values), rel=1e-14, abs=1e-290)


@pytest.mark.parametrize("spread", [1e-3, 0.05, 1.0])
def test_the_expected_excess_is_that_of_the_price_of_life(spread: float) -> None:
    means = np.linspace(-2.0, 1.0, 61)
    assert [excess(mean, spread) for mean in means] == pytest.approx(expected_excess(means, spread), rel=1e-13, abs=1e-16)
