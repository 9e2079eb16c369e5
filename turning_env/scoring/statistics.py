"""Estimates with bootstrap intervals over held-out seeds and training seeds.

A policy's values are an array of shape (training seeds, seeds); a rule has one row. A resample draws the same
number of seeds, and the same number of each policy's training seeds, with replacement. All policies share the resampled seeds,
so the bars' common effect cancels in a difference between two policies. A policy is feasible if the upper confidence limit of its
share of cutting time in severe overload is within the scenario's allowance, and infeasible if the lower limit is above it. If the
allowance lies between the limits, feasibility is not shown: more seeds would decide.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from turning_env.scenario import Scenario

Floats = NDArray[np.float64]

CONFIDENCE = 0.95
RESAMPLES = 2000
KEY = 709  # fixed, so that the same episodes give the same limit
_ROUNDING = 1e-6  # an interval that is narrower is but the rounding of sums


Feasibility = Literal["feasible", "not shown", "infeasible"]
MAX_DECIMALS = 2


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

    def decimals(self, factor: float = 1.0) -> int:
        """Return the decimals, at most two, that show the interval in two digits, or without an interval the value.

        ``factor`` is that from the unit of this estimate to the unit that is shown.
        """
        width = factor * (self.high - self.low)
        shown = width if width > _ROUNDING else abs(factor * self.value)
        if shown <= _ROUNDING:
            return 0
        return min(max(1 - math.floor(math.log10(shown)), 0), MAX_DECIMALS)


class Bootstrap:
    """The resamples of one ranking, in which every policy plays the same seeds."""

    def __init__(self, seeds: int) -> None:
        self._seeds = np.random.default_rng(KEY).integers(seeds, size=(RESAMPLES, seeds))
        self._seed_weights = _weights(self._seeds, seeds)

    def _training_seeds(self, policy: str, count: int) -> NDArray[np.int64]:
        # Keyed by name: two policies' training seeds are unrelated even if they are the same numbers.
        return np.random.default_rng([KEY, crc32(policy.encode())]).integers(
            count, size=(RESAMPLES, count)
        )

    def means(self, values: Floats, policy: str) -> Floats:
        """Return the mean of a policy's values, shape (training seeds, seeds), in each resample, shape (resamples,)."""
        weights = _weights(self._training_seeds(policy, len(values)), len(values))
        means: Floats = np.sum(weights @ values * self._seed_weights, axis=1)
        return means

    def interquartile_means(self, values: Floats, policy: str) -> Floats:
        """Return the interquartile mean of a policy's values in each resample: see ``means``."""
        rows, columns = (
            self._training_seeds(policy, len(values))[:, :, None],
            self._seeds[:, None, :],
        )
        chunks = (
            values[rows[k : k + 100], columns[k : k + 100]] for k in range(0, RESAMPLES, 100)
        )  # to bound memory
        return np.concatenate(
            [interquartile_mean(chunk.reshape(len(chunk), -1)) for chunk in chunks]
        )

    def severe_limit(self, severe: Floats, engaged: Floats, policy: str) -> float:
        """Return the one-sided upper confidence limit of ``severe_share`` [-]; arguments of shape (training seeds, seeds)."""
        return self.severe_limits(severe, engaged, policy)[1]

    def severe_limits(self, severe: Floats, engaged: Floats, policy: str) -> tuple[float, float]:
        """Return the one-sided lower and upper confidence limits of ``severe_share``; see ``severe_limit``."""
        shares = ratio(self.means(severe, policy), self.means(engaged, policy))
        lower, upper = np.quantile(shares, [1.0 - CONFIDENCE, CONFIDENCE])
        return float(lower), float(upper)


def feasibility(limits: tuple[float, float], allowance: float) -> Feasibility:
    """Return whether a policy is feasible, by the lower and upper confidence limits of its share of severe overload [-]."""
    lower, upper = limits
    if upper <= allowance:
        return "feasible"
    return "infeasible" if lower > allowance else "not shown"


def reason_not_to_rank(kind: str, scenario: Scenario) -> str | None:
    """Return why a policy of a kind has no rank on a scenario; None if it has one."""
    if kind == "oracle":
        return "oracle"
    if kind == "agent" and scenario.tool.wear_rule == "clock_time":
        return "agent: the published wear rule counts time, so learning finds ways to idle, and the return is not machining"
    return None


def severe_share(severe: Floats, engaged: Floats) -> float:
    """Return the share of cutting time with an excess above the tolerance [-], 0 without cutting, from times per episode [s]."""
    return float(ratio(severe.sum(keepdims=True), engaged.sum(keepdims=True)).item())


def ratio(parts: Floats, wholes: Floats) -> Floats:
    """Return ``parts / wholes``, or 0 if a whole is 0: a policy that never cuts causes no overload."""
    return np.divide(parts, wholes, out=np.zeros_like(parts), where=wholes > 0.0)


class RankKey(NamedTuple):
    """The key by which policies are sorted, the lowest first."""

    is_oracle: bool
    has_no_rank: bool
    is_not_feasible: bool
    demerit: float


def rank_key(kind: str, feasible: bool, merit: float, unranked: str | None = None) -> RankKey:
    """Return the key by which policies are sorted: those without a rank after the ranked, oracles last.

    Among these, feasible policies come first, then those of higher merit.
    """
    return RankKey(
        is_oracle=kind == "oracle",
        has_no_rank=unranked is not None,
        is_not_feasible=not feasible,
        demerit=-merit,
    )


def interquartile_mean(values: Floats) -> Floats:
    """Return the mean over the last axis without its lowest and highest quarter, each rounded down."""
    cut = values.shape[-1] // 4
    return np.asarray(np.mean(np.sort(values)[..., cut : values.shape[-1] - cut], axis=-1))


def _weights(indices: NDArray[np.int64], count: int) -> Floats:
    """Return the share of each of ``count`` things, shape (resamples, count), in resamples of indices (resamples, picks)."""
    weights = np.zeros((len(indices), count))
    np.add.at(weights, (np.arange(len(indices))[:, None], indices), 1.0 / indices.shape[1])
    return weights
