"""Exponential, logarithm, powers, sine and cosine, against the C library's.

Arrays have the bits of single numbers.
"""

import math

import numpy as np
import pytest

from turning_env.numerics.functions import (
    exp,
    expm1,
    hypotenuse,
    log,
    real_power,
    sine_and_cosine,
    where,
)

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


def test_the_hypotenuse_is_that_of_a_triangle():
    assert hypotenuse(3.0, 4.0) == 5.0
    assert hypotenuse(np.array([5.0, 8.0]), np.array([12.0, 15.0])).tolist() == [13.0, 17.0]


def test_where_chooses_between_numbers_and_arrays():
    assert where(True, 1.0, 2.0) == 1.0
    assert where(np.array([True, False]), 1.0, np.array([3.0, 4.0])).tolist() == [1.0, 4.0]


@pytest.mark.parametrize("x", [708.0, 1000.0])
def test_beyond_708_the_exponential_keeps_its_value(x):
    assert exp(x) == pytest.approx(math.exp(708.0), rel=1e-15)
    assert exp(-x) == pytest.approx(math.exp(-708.0), rel=1e-15)
    assert expm1(x) == pytest.approx(math.exp(708.0), rel=1e-15)
    assert expm1(-x) == -1.0


def test_the_logarithm_of_0_is_about_minus_709():
    assert -710.0 < log(0.0) < -708.0


@pytest.mark.parametrize("turns", [-0.3, -2.625, 1e6 + 0.125, 123456.75])
def test_turns_of_either_sign_and_many_are_reduced(turns):
    sine, cosine = sine_and_cosine(turns)
    angle = 2.0 * math.pi * (turns - math.floor(turns))
    assert (sine, cosine) == pytest.approx((math.sin(angle), math.cos(angle)), abs=1e-14)


def test_a_power_of_a_number_near_0_is_a_power():
    assert real_power(1e-12, 0.5) == pytest.approx(1e-6)
    assert real_power(np.array([0.0, 4.0]), 0.5) == pytest.approx([0.0, 2.0])
    assert real_power(0.0, -1.5) == 0.0
