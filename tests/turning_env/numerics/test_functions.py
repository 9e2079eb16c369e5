"""Exponential, logarithm, powers, sine and cosine, against the C library's.

Arrays have the bits of single numbers.
"""

import numpy as np
import pytest

from turning_env.numerics.functions import exp, expm1, log, real_power, sine_and_cosine

NEAR_ZERO = np.geomspace(1e-12, 1.0, 500)
BOTH_SIDES = np.concatenate([NEAR_ZERO, -NEAR_ZERO, np.linspace(-30.0, 30.0, 301)])
WHOLE_RANGE = np.concatenate([np.linspace(-708.0, 708.0, 4001), BOTH_SIDES])
ABOVE_ZERO = np.concatenate(
    [
        np.geomspace(1e-300, 1e300, 4001),
        np.linspace(0.5, 2.0, 4001),
        1.0 + NEAR_ZERO,
        1.0 - NEAR_ZERO[:-1],
    ]
)
BASES = np.geomspace(1e-6, 1e6, 500)
EXPONENTS = (0.245, 4.08, -1.5)
TURNS = np.concatenate([np.linspace(0.0, 1.0, 4001), np.arange(0.0, 3.0, 0.125)])


def assert_same_as_library(function, library_function, x, rel=0.0, tiny=0.0):
    """Fail unless values are the C library's, and those of arrays have the bits of single ones."""
    values = function(x)
    assert values == pytest.approx(library_function(x), rel=rel, abs=tiny)
    assert values.tobytes() == np.array([function(number) for number in x]).tobytes()
    assert function(x[:, np.newaxis]).shape == (len(x), 1)


def test_exp_is_the_c_librarys():
    assert_same_as_library(exp, np.exp, WHOLE_RANGE, rel=5e-16)


def test_expm1_is_the_c_librarys():
    assert_same_as_library(expm1, np.expm1, BOTH_SIDES, rel=1e-15)


def test_log_is_the_c_librarys():
    assert_same_as_library(
        log,
        np.log,
        ABOVE_ZERO,
        rel=7e-16,
        tiny=1e-300,
    )


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_powers_are_the_c_librarys(exponent):
    def power(base):
        return real_power(base, exponent)

    def library_power(base):
        return base**exponent

    assert_same_as_library(power, library_power, BASES, rel=1e-13)


def test_sine_and_cosine_are_the_c_librarys():
    def sine(turns):
        return sine_and_cosine(turns)[0]

    def cosine(turns):
        return sine_and_cosine(turns)[1]

    # The C library's angle is rounded, hence the tolerance.
    assert_same_as_library(
        sine,
        lambda turns: np.sin(2 * np.pi * turns),
        TURNS,
        tiny=4e-15,
    )
    assert_same_as_library(
        cosine,
        lambda turns: np.cos(2 * np.pi * turns),
        TURNS,
        tiny=4e-15,
    )


def test_sine_and_cosine_lie_on_the_unit_circle():
    assert np.hypot(*sine_and_cosine(TURNS)) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_a_power_of_zero_is_zero(exponent):
    assert real_power(0.0, exponent) == 0.0


@pytest.mark.parametrize("function", [exp, expm1, log])
def test_values_that_are_no_numbers_stay_none_and_arguments_stay_as_they_are(function):
    x = np.array([[1.0, np.nan], [2.0, 3.0]])
    x.flags.writeable = False
    values = function(x.T)
    assert values.shape == (2, 2)
    assert values[0, 1] == function(2.0)
    if function is not log:  # whose argument must be a normal number
        assert np.isnan(values[1, 0])


@pytest.mark.parametrize("x", [-720.0, 720.0])
def test_exp_is_clipped_in_the_same_way_for_arrays(x):
    assert exp(x) == exp(np.array([x]))[0]
