"""Quantiles of Student's t distribution, for confidence intervals."""

import math
from statistics import NormalDist

MANY = 1000
"""Degrees of freedom [-] above which the expansion about the normal distribution is exact to nine digits."""


def two_sided_quantile(confidence: float, degrees: int) -> float:
    """The t that a Student variable of 1 or more degrees of freedom exceeds in magnitude with probability 1 - confidence [-].

    Up to ``MANY`` degrees by bisection of the distribution function, a finite series (Abramowitz and Stegun 1964, equations
    26.7.3 and 26.7.4), above by the expansion about the normal quantile (equation 26.7.5).
    """
    if degrees > MANY:
        z = NormalDist().inv_cdf(0.5 + 0.5 * confidence)
        terms = (
            (z**3 + z) / 4,
            (5 * z**5 + 16 * z**3 + 3 * z) / 96,
            (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        )
        return z + sum(float(term / degrees**power) for power, term in enumerate(terms, 1))
    low, high = 0.0, 0.5 * math.pi
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _within(middle, degrees) < confidence else (low, middle)
    return math.sqrt(degrees) * math.tan(low)


def _within(angle: float, degrees: int) -> float:
    """Probability that the magnitude is at most sqrt(degrees) tan(angle)."""
    cosine, sine = math.cos(angle), math.sin(angle)
    odd = degrees % 2
    term = cosine if odd else 1.0
    total = term if degrees > 1 else 0.0
    for power in range(2 + odd, degrees - 1, 2):
        term *= (power - 1) / power * cosine * cosine
        total += term
    return 2.0 / math.pi * (angle + sine * total) if odd else sine * total
