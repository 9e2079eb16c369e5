"""The share of cutting time in severe overload; its upper confidence limit decides whether a policy is feasible."""

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
RESAMPLES = 2000
KEY = 709  # fixed, so that the same episodes give the same limit


def severe_share(severe: NDArray[np.float64], engaged: NDArray[np.float64]) -> float:
    """Return the share of cutting time with an excess above the tolerance [-]: sum(severe) / sum(engaged), 0 without cutting.

    Args:
        severe: time with an excess above the tolerance [s] in each episode, shape (seeds,).
        engaged: cutting time [s] in each episode, shape (seeds,).
    """
    return float(ratio(severe.sum(keepdims=True), engaged.sum(keepdims=True))[0])


def severe_limit(severe: NDArray[np.float64], engaged: NDArray[np.float64]) -> float:
    """Return the one-sided upper confidence limit of ``severe_share`` [-] by bootstrap over seeds, for the same arguments."""
    count = len(engaged)
    resamples = np.random.default_rng(KEY).integers(count, size=(RESAMPLES, count))
    return float(np.quantile(ratio(severe[resamples].sum(axis=1), engaged[resamples].sum(axis=1)), CONFIDENCE))


def ratio(parts: NDArray[np.float64], wholes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``parts / wholes``, or 0 where a whole is 0: a policy that never cuts causes no overload."""
    return np.divide(parts, wholes, out=np.zeros_like(parts), where=wholes > 0.0)
