"""The share of cutting time with a severe overload, and its confidence limit, which decides whether a policy is feasible."""

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
RESAMPLES = 2000
KEY = 709  # fixed, so that the same episodes give the same limit


def severe_share(severe: NDArray[np.float64], engaged: NDArray[np.float64]) -> float:
    """Return the share of cutting time more than the tolerance over a limit [-], 0 if nothing is cut.

    Args:
        severe: time more than the tolerance over a limit [s], of each episode, shape (seeds,).
        engaged: cutting time [s], likewise.
    """
    return float(ratio(severe.sum(keepdims=True), engaged.sum(keepdims=True))[0])


def severe_limit(severe: NDArray[np.float64], engaged: NDArray[np.float64]) -> float:
    """Return the one-sided upper confidence limit of ``severe_share`` [-], by bootstrap over seeds; arguments as there."""
    count = len(engaged)
    resamples = np.random.default_rng(KEY).integers(count, size=(RESAMPLES, count))
    return float(np.quantile(ratio(severe[resamples].sum(axis=1), engaged[resamples].sum(axis=1)), CONFIDENCE))


def ratio(parts: NDArray[np.float64], wholes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``parts / wholes``, and 0 where a whole is 0: a policy that never cuts overloads nothing."""
    return np.divide(parts, wholes, out=np.zeros_like(parts), where=wholes > 0.0)
