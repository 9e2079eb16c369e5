"""The normal distribution in compiled loops, with the same bits on all processors."""

import math

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp

_DENSITY = 1.0 / math.sqrt(2.0 * math.pi)


@compiled
def tail(z):
    """Return the probability that a standard normal number is above z >= 0, over the density exp(-z^2 / 2).

    The probability's error is below 1e-7 (Abramowitz and Stegun 1964, 26.2.17).
    """
    t = 1.0 / (1.0 + 0.2316419 * z)
    return (
        _DENSITY
        * t
        * (
            0.31938153
            + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429)))
        )
    )


@compiled
def probability(x):
    """Return the probability that a standard normal number is below x, and the density."""
    density = exp(-0.5 * (x * x))
    above = density * tail(abs(x))
    return above if x < 0.0 else 1.0 - above, _DENSITY * density


@compiled
def excess(log_mean, spread):
    """Return the expectation of max(X - 1, 0), where log X is normal, and its first two derivatives by the mean of log X."""
    ratio = log_mean / spread
    beyond = ratio + spread
    density = exp(-0.5 * (ratio * ratio))
    below, slope = density * tail(abs(ratio)), density * tail(abs(beyond))
    if ratio > 0.0:
        below = 1.0 - below
    if beyond > 0.0:
        slope = exp(log_mean + 0.5 * (spread * spread)) - slope
    return slope - below, slope, slope + _DENSITY * density / spread
