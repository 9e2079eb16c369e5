"""Estimates with bootstrap intervals over held-out seeds and training seeds.

A policy's values are an array of shape (training seeds, seeds); a rule has one row. A resample draws the same
number of seeds, and the same number of each policy's training seeds, with replacement. All policies share the resampled seeds,
so the bars' common effect cancels in a difference between two policies. A policy is feasible if the upper confidence limit of its
share of cutting time in severe overload is within the scenario's allowance.
"""

from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

CONFIDENCE = 0.95
RESAMPLES = 2000
KEY = 709  # fixed, so that the same episodes give the same limit


@dataclass(frozen=True)
class Estimate:
    """A value and its interval of confidence ``CONFIDENCE``."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, value: float, replicates: Floats) -> "Estimate":
        """Return a value with the percentile interval of its bootstrap replicates, shape (resamples,)."""
        tail = (1.0 - CONFIDENCE) / 2.0
        low, high = np.quantile(replicates, [tail, 1.0 - tail])
        return cls(float(value), float(low), float(high))


class Bootstrap:
    """The resamples of one ranking, in which every policy plays the same seeds."""

    def __init__(self, seeds: int) -> None:
        self._seeds = np.random.default_rng(KEY).integers(seeds, size=(RESAMPLES, seeds))
        self._seed_weights = _weights(self._seeds, seeds)

    def _training_seeds(self, policy: str, count: int) -> NDArray[np.int64]:
        # Keyed by name: two policies' training seeds are unrelated even if they are the same numbers.
        return np.random.default_rng([KEY, crc32(policy.encode())]).integers(count, size=(RESAMPLES, count))

    def means(self, values: Floats, policy: str) -> Floats:
        """Return the mean of a policy's values, shape (training seeds, seeds), in each resample, shape (resamples,)."""
        weights = _weights(self._training_seeds(policy, len(values)), len(values))
        means: Floats = np.sum(weights @ values * self._seed_weights, axis=1)
        return means

    def interquartile_means(self, values: Floats, policy: str) -> Floats:
        """Return the interquartile mean of a policy's values in each resample: see ``means``."""
        rows, columns = self._training_seeds(policy, len(values))[:, :, None], self._seeds[:, None, :]
        chunks = (values[rows[k : k + 100], columns[k : k + 100]] for k in range(0, RESAMPLES, 100))  # to bound memory
        return np.concatenate([interquartile_mean(chunk.reshape(len(chunk), -1)) for chunk in chunks])

    def severe_limit(self, severe: Floats, engaged: Floats, policy: str) -> float:
        """Return the one-sided upper confidence limit of ``severe_share`` [-]; arguments of shape (training seeds, seeds)."""
        return float(np.quantile(ratio(self.means(severe, policy), self.means(engaged, policy)), CONFIDENCE))


def severe_share(severe: Floats, engaged: Floats) -> float:
    """Return the share of cutting time with an excess above the tolerance [-], 0 without cutting, from times per episode [s]."""
    return float(ratio(severe.sum(keepdims=True), engaged.sum(keepdims=True)).item())


def ratio(parts: Floats, wholes: Floats) -> Floats:
    """Return ``parts / wholes``, or 0 if a whole is 0: a policy that never cuts causes no overload."""
    return np.divide(parts, wholes, out=np.zeros_like(parts), where=wholes > 0.0)


def rank_key(kind: str, feasible: bool, merit: float) -> tuple[bool, bool, float]:
    """Return the key by which policies are ranked: oracles last, feasible policies first, then the higher merit."""
    return kind == "oracle", not feasible, -merit


def interquartile_mean(values: Floats) -> Floats:
    """Return the mean over the last axis without its lowest and highest quarter, each rounded down."""
    cut = values.shape[-1] // 4
    return np.asarray(np.mean(np.sort(values)[..., cut : values.shape[-1] - cut], axis=-1))


def _weights(indices: NDArray[np.int64], count: int) -> Floats:
    """Return the share of each of ``count`` things, shape (resamples, count), in resamples of indices (resamples, picks)."""
    weights = np.zeros((len(indices), count))
    np.add.at(weights, (np.arange(len(indices))[:, None], indices), 1.0 / indices.shape[1])
    return weights
