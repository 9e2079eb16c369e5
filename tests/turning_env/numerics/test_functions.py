"""Exponential, logarithm, sine and cosine, against the C library's."""

import numpy as np
import pytest

from turning_env.numerics.functions import exp, expm1, log, real_power, sine_and_cosine

NEAR_ZERO = np.geomspace(1e-12, 1.0, 500)


@pytest.mark.parametrize("x", [np.linspace(-708.0, 708.0, 4001), np.linspace(-2.0, 2.0, 4001), NEAR_ZERO, -NEAR_ZERO])
def test_exponential(x):
    assert [exp(value) for value in x] == pytest.approx(np.exp(x), rel=5e-16)


@pytest.mark.parametrize(
    "x", [np.geomspace(1e-300, 1e300, 4001), np.linspace(0.5, 2.0, 4001), 1.0 + NEAR_ZERO, 1.0 - NEAR_ZERO[:-1]]
)
def test_logarithm(x):
    assert [log(value) for value in x] == pytest.approx(np.log(x), rel=7e-16, abs=1e-300)


def test_exponential_less_1():
    x = np.concatenate([NEAR_ZERO, -NEAR_ZERO, np.linspace(-30.0, 30.0, 301)])
    assert expm1(x) == pytest.approx(np.expm1(x), rel=1e-15)


@pytest.mark.parametrize(
    ("function", "values"),
    [
        (exp, np.linspace(-720.0, 720.0, 4001)),
        (log, np.geomspace(1e-300, 1e300, 4001)),
        (lambda x: real_power(x, 0.245), np.linspace(0.0, 3.0, 301)),
        (lambda x: sine_and_cosine(x)[0], np.linspace(0.0, 3.0, 301)),
        (lambda x: sine_and_cosine(x)[1], np.linspace(0.0, 3.0, 301)),
    ],
)
def test_arrays_have_the_bits_of_single_numbers(function, values):
    assert function(values).tobytes() == np.array([function(value) for value in values]).tobytes()
    assert function(values[:, np.newaxis]).shape == (len(values), 1)


@pytest.mark.parametrize("exponent", [0.245, 1 / 0.245, -1.5])
def test_raised(exponent):
    bases = np.geomspace(1e-6, 1e6, 500)
    assert [real_power(base, exponent) for base in bases] == pytest.approx(bases**exponent, rel=1e-13)
    assert real_power(0.0, exponent) == 0.0


def test_sine_and_cosine():
    turns = np.concatenate([np.linspace(0.0, 1.0, 4001), np.arange(0.0, 3.0, 0.125)])
    waves = np.array([sine_and_cosine(value) for value in turns])
    assert waves[:, 0] == pytest.approx(np.sin(2 * np.pi * turns), abs=4e-15)  # the C library's angle is rounded
    assert waves[:, 1] == pytest.approx(np.cos(2 * np.pi * turns), abs=4e-15)
    assert np.hypot(*waves.T) == pytest.approx(1.0, abs=1e-15)
