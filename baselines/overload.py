"""Whether a policy overloads too much to be admissible, as far as the draws that it has played can tell."""

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
RESAMPLES = 2000
_KEY = 709  # fixed, so that the same episodes give the same limit


def severe_share(severe: NDArray[np.float64], engaged: NDArray[np.float64]) -> float:
    """Share of cutting time spent more than the tolerance over a limit [-]; 0 where nothing is cut.

    Args:
        severe: time more than the tolerance over a limit [s], of each episode, shape (draws,).
        engaged: cutting time [s], likewise.
    """
    return float(_shares(severe.sum(keepdims=True), engaged.sum(keepdims=True))[0])


def severe_limit(severe: NDArray[np.float64], engaged: NDArray[np.float64]) -> float:
    """One-sided upper confidence limit of ``severe_share`` [-], by bootstrap over draws; arguments as there."""
    count = len(engaged)
    resamples = np.random.default_rng(_KEY).integers(count, size=(RESAMPLES, count))
    return float(np.quantile(_shares(severe[resamples].sum(axis=1), engaged[resamples].sum(axis=1)), CONFIDENCE))


def _shares(parts: NDArray[np.float64], wholes: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.divide(parts, wholes, out=np.zeros_like(parts), where=wholes > 0.0)
