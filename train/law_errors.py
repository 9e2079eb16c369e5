"""Estimate the errors of the nominal laws in a family's training jobs: mean and covariance.

Errors count from a pivot, the mean of the nominal models' best set points within their ranges, because exponents that are wrong
change loads and life the more, the farther a set point is from where they were measured. Errors of force and power are
correlated, as both follow from the specific cutting force.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env import Family
from turning_env.scenario.family import CHUNK, Draw
from turning_env.scenario.plan import MIDDLE, USED_LIVES, log_response_at

Floats = NDArray[np.float64]

LOADS = (3, 7)
"""Places of the first errors of force and power: logarithm with a half-worn edge, and exponents of speed, feed and wear [-]. The
three before are those of wear: logarithm of the rate at which life is used, its exponent of speed over the nominal one, less 1,
and its exponent of feed [-]."""
ERRORS = 11
_JITTER = 1e-9  # variance of an error that all jobs lack
_LAWS = ("thrust_force", "power")


def error_prior(family: Family, pivot: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return mean, shape (ERRORS,), and Cholesky factor of the covariance of all training jobs' errors.

    Args:
        family: the family.
        pivot: logarithms of speed and feed over the lowest ones.
    """
    errors = np.concatenate([_errors(family.draw("train", chunk), pivot) for chunk in range(-(-family.jobs // CHUNK))])
    covariance: Floats = np.cov(errors, rowvar=False) + _JITTER * np.eye(ERRORS)
    return errors.mean(axis=0), np.asarray(np.linalg.cholesky(covariance), np.float64)


def _errors(draw: Draw, pivot: tuple[float, float]) -> Floats:
    """Return the errors of some jobs, shape (jobs, ERRORS)."""
    true, nominal, jobs = draw.true, draw.true.nominal(), len(draw.plan.life)
    speed = pivot[0] + np.log(true.machine.cutting_speed_min)
    feed = pivot[1] + np.log(true.machine.feed_min)

    def more(law: str, name: str) -> Any:
        return getattr(getattr(true.material, law), name) - getattr(getattr(nominal.material, law), name)

    def bias(law: str, used_life: float) -> Any:
        at_one = log_response_at(true, law, used_life) - log_response_at(nominal, law, used_life)
        return at_one + more(law, "cutting_speed") * speed + more(law, "feed") * feed

    time, half = nominal.material.wear.time, USED_LIVES[MIDDLE]
    found = [
        bias("wear", 0.0) / time,
        more("wear", "cutting_speed") / nominal.material.wear.cutting_speed,
        more("wear", "feed") / time,
    ]
    for law in _LAWS:
        found += [bias(law, half), *(more(law, name) for name in ("cutting_speed", "feed", "wear"))]
    return np.stack([np.broadcast_to(each, jobs) for each in found], axis=1)
