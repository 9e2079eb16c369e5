"""The wear term of a law is the wear, or grows with it from 1."""

import numpy as np
import pytest

from turning_env.numerics.wear_term import (
    log_wear_term,
    term_of_factor,
    term_over_criterion,
    wear_term_slope,
)

GROWTHS = np.array([0.0, 0.5, 1.8, 9.7])  # [1/mm]
LOG_WEARS = np.log([0.01, 0.1, 0.3])


@pytest.mark.parametrize("log_wear", LOG_WEARS)
def test_the_term_is_the_wear_or_grows_from_1(log_wear: float) -> None:
    wear = np.exp(log_wear)
    expected = [wear, 1.0 + 0.5 * wear, 1.0 + 1.8 * wear, 1.0 + 9.7 * wear]
    assert np.exp(log_wear_term(GROWTHS, log_wear)) == pytest.approx(expected)


def test_without_growth_the_logarithm_keeps_its_bits() -> None:
    assert log_wear_term(0.0, LOG_WEARS).tolist() == LOG_WEARS.tolist()
    assert term_over_criterion(0.0, LOG_WEARS).tolist() == LOG_WEARS.tolist()
    assert term_of_factor(0.0, LOG_WEARS, 0.3).tolist() == [0.3, 0.3, 0.3]


@pytest.mark.parametrize("log_wear", LOG_WEARS)
def test_the_slope_is_the_derivative(log_wear: float) -> None:
    step = 1e-5
    above = log_wear_term(GROWTHS, log_wear + step)
    below = log_wear_term(GROWTHS, log_wear - step)
    assert wear_term_slope(GROWTHS, log_wear) == pytest.approx((above - below) / (2.0 * step))


def test_a_large_growth_tends_to_a_power_law() -> None:
    assert term_over_criterion(1e9, LOG_WEARS) == pytest.approx(LOG_WEARS, abs=1e-6)


def test_a_factor_of_the_wear_changes_the_term() -> None:
    change = term_of_factor(GROWTHS, np.log(0.2), np.log(1.5))
    assert np.exp(change) == pytest.approx([1.5, 1.15 / 1.1, 1.54 / 1.36, 3.91 / 2.94])
