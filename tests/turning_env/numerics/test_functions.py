"""Exponential, logarithm, powers, sine and cosine, against the C library's; arrays have the bits of single numbers."""

import numpy as np
import pytest

from turning_env.numerics.functions import exp, expm1, log, real_power, sine_and_cosine

NEAR_ZERO = np.geomspace(1e-12, 1.0, 500)
BOTH_SIDES = np.concatenate([NEAR_ZERO, -NEAR_ZERO, np.linspace(-30.0, 30.0, 301)])
LOGARITHMS = np.concatenate(
    [
        np.geomspace(1e-300, 1e300, 4001),
        np.linspace(0.5, 2.0, 4001),
        1.0 + NEAR_ZERO,
        1.0 - NEAR_ZERO[:-1],
    ]
)
BASES, EXPONENTS = np.geomspace(1e-6, 1e6, 500), (0.245, 4.08, -1.5)
TURNS = np.concatenate([np.linspace(0.0, 1.0, 4001), np.arange(0.0, 3.0, 0.125)])


@pytest.mark.parametrize(
    ("function", "reference", "x", "rel", "tiny"),
    [
        (exp, np.exp, np.concatenate([np.linspace(-708.0, 708.0, 4001), BOTH_SIDES]), 5e-16, 0.0),
        (expm1, np.expm1, BOTH_SIDES, 1e-15, 0.0),
        (log, np.log, LOGARITHMS, 7e-16, 1e-300),
        *(
            (lambda x, e=e: real_power(x, e), lambda x, e=e: x**e, BASES, 1e-13, 0.0)
            for e in EXPONENTS
        ),
        # The C library's angle is rounded.
        (lambda x: sine_and_cosine(x)[0], lambda x: np.sin(2 * np.pi * x), TURNS, 0.0, 4e-15),
        (lambda x: sine_and_cosine(x)[1], lambda x: np.cos(2 * np.pi * x), TURNS, 0.0, 4e-15),
    ],
)
def test_values_are_the_c_librarys_and_arrays_hold_the_same_bits(function, reference, x, rel, tiny):
    values = function(x)
    assert values == pytest.approx(reference(x), rel=rel, abs=tiny)
    assert values.tobytes() == np.array([function(value) for value in x]).tobytes()
    assert function(x[:, np.newaxis]).shape == (len(x), 1)


def test_ends():
    assert [real_power(0.0, exponent) for exponent in EXPONENTS] == [0.0] * 3
    assert [exp(-720.0), exp(720.0)] == [exp(np.array([each]))[0] for each in (-720.0, 720.0)]
    assert np.hypot(*sine_and_cosine(TURNS)) == pytest.approx(1.0, abs=1e-15)
