"""Estimates with bootstrap intervals over draws and training seeds.

Rows are arrays of shape (training seeds, draws); a rule has one row. A resample takes as many draws, and of each policy as many
training seeds, as there are, with replacement. The resampled draws are the same for all policies, so that in a difference between
two policies what the bars have in common cancels.
"""

from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from turning_env.score.overload import CONFIDENCE, KEY, RESAMPLES

Floats = NDArray[np.float64]

_CHUNK = 100  # resamples whose rows are held in memory at a time


@dataclass(frozen=True)
class Estimate:
    """A value and the interval that covers it with ``CONFIDENCE``."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, value: float, replicates: Floats) -> "Estimate":
        """The percentile interval of bootstrap replicates, shape (resamples,)."""
        tail = (1.0 - CONFIDENCE) / 2.0
        low, high = np.quantile(replicates, [tail, 1.0 - tail])
        return cls(float(value), float(low), float(high))


class Bootstrap:
    """The resamples of one ranking, in which every policy plays the same number of draws."""

    def __init__(self, draws: int, resamples: int = RESAMPLES) -> None:
        self.resamples = resamples
        self._draws = np.random.default_rng(KEY).integers(draws, size=(resamples, draws))
        self._draw_weights = _weights(self._draws, draws)

    def _seeds(self, policy: str, count: int) -> NDArray[np.int64]:
        # Keyed by name: two policies' training seeds have nothing in common, even where they are called the same.
        return np.random.default_rng([KEY, crc32(policy.encode())]).integers(count, size=(self.resamples, count))

    def means(self, rows: Floats, policy: str) -> Floats:
        """Mean of ``policy``'s rows (seeds, draws) in each resample, shape (resamples,)."""
        seed_weights = _weights(self._seeds(policy, len(rows)), len(rows))
        means: Floats = np.sum(seed_weights @ rows * self._draw_weights, axis=1)
        return means

    def interquartile_means(self, rows: Floats, policy: str) -> Floats:
        """Interquartile mean of ``policy``'s rows (seeds, draws) in each resample, shape (resamples,)."""
        seeds = self._seeds(policy, len(rows))
        chunks = []
        for start in range(0, self.resamples, _CHUNK):
            chunk = slice(start, start + _CHUNK)
            resampled = rows[seeds[chunk, :, None], self._draws[chunk, None, :]]
            chunks.append(interquartile_mean(resampled.reshape(len(resampled), -1)))
        return np.concatenate(chunks)


def interquartile_mean(values: Floats) -> Floats:
    """Mean of what is left of the last axis when the lowest and the highest quarter (rounded down) are taken away."""
    count = values.shape[-1]
    cut = count // 4
    middle = np.sort(values, axis=-1)[..., cut : count - cut]
    mean: Floats = np.mean(middle, axis=-1)
    return mean


def improvement(rows: Floats, reference: Floats) -> Floats:
    """By how much each row beats a reference on the same draw: 1 above, 0.5 equal, 0 below.

    Args:
        rows: a policy's returns, shape (seeds, draws).
        reference: another's, shape (its seeds, draws); averaged over its seeds.

    Returns:
        An array of shape (seeds, draws), whose mean is the probability of improvement P(X > Y) + P(X = Y) / 2.
    """
    wins: Floats = np.mean((1.0 + np.sign(rows[:, None, :] - reference[None, :, :])) / 2.0, axis=1)
    return wins


def _weights(indices: NDArray[np.int64], count: int) -> Floats:
    """How much of each resample, shape (resamples, picks), each of ``count`` things makes up, shape (resamples, count)."""
    weights = np.zeros((len(indices), count))
    np.add.at(weights, (np.arange(len(indices))[:, None], indices), 1.0 / indices.shape[1])
    return weights
