"""Estimates with bootstrap intervals over held-out seeds and training seeds.

A policy's values are an array of shape (training seeds, seeds); a rule has one row. A resample
draws the same number of seeds, and the same number of each policy's training seeds, with
replacement. All policies share the resampled seeds, so the bars' common effect cancels in a
difference between two policies.

A policy is feasible if the upper confidence limit of its share of cutting time in severe overload
is within the scenario's allowance, and infeasible if the lower limit is above it. If the allowance
lies between the limits, feasibility is not shown: more seeds would decide. This is the constraint
of ``turning_env/physics/constraint.py`` on ``info["cost"]``: over episodes, a share within the
allowance and a sum of costs of at most 0 are the same.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from turning_env.physics.constraint import COST_LIMIT, overload_cost
from turning_env.scenario import Scenario

Floats = NDArray[np.float64]
Feasibility = Literal["feasible", "not shown", "infeasible"]

VERDICTS_IN_WORDS: dict[Feasibility, str] = {
    "feasible": "feasible",
    "not shown": "feasibility not shown",
    "infeasible": "infeasible",
}

CONFIDENCE = 0.95
RESAMPLES = 2000
KEY = 709  # fixed, so that the same episodes give the same limit
MAX_DECIMALS = 2
_PLACE = np.uint16  # of a value among others, as long as there are few
_LONG_ROW = 512  # values, from which a radix sort is faster
_CHUNK = 128_000  # values that are resampled together: they fit into a processor's cache
_MIN_WIDTH = 1e-6  # of an interval; a narrower one is only the rounding of sums


@dataclass(frozen=True)
class Estimate:
    """A value and its interval of confidence ``CONFIDENCE``."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, value: float, replicates: Floats) -> "Estimate":
        """Return a value with the percentile interval of its bootstrap replicates.

        ``replicates`` has the shape (resamples,).
        """
        tail = (1.0 - CONFIDENCE) / 2.0
        low, high = quantiles(replicates, tail, 1.0 - tail)
        return cls(float(value), low, high)

    def decimals(self, factor: float = 1.0) -> int:
        """Return the decimals, at most two, that show the interval in two digits.

        Without an interval, they show the value. ``factor`` is that from the unit of this estimate
        to the unit that is shown.
        """
        shown = factor * (self.high - self.low)
        if shown <= _MIN_WIDTH:
            shown = abs(factor * self.value)
        if shown <= _MIN_WIDTH:
            return 0
        return min(max(1 - math.floor(math.log10(shown)), 0), MAX_DECIMALS)


class Mean(NamedTuple):
    """A mean, and its bootstrap replicates of shape (resamples,)."""

    value: float
    replicates: Floats

    @property
    def estimate(self) -> Estimate:
        """Return the mean with its confidence interval."""
        return Estimate.of(self.value, self.replicates)


def score_of(mean: Mean, fixed: Mean, oracle: Mean) -> Mean | None:
    """Return the score of a policy by mean returns on the same episodes, with its replicates.

        100 (return - fixed) / (oracle - fixed)

    The best fixed parameters score 0, the oracle of the state scores 100. Return None if the oracle
    returns no more than the fixed parameters in some resample.
    """
    gap = Mean(oracle.value - fixed.value, oracle.replicates - fixed.replicates)
    if gap.replicates.min() <= 0.0:
        return None
    above_fixed = mean.replicates - fixed.replicates
    return Mean(
        100.0 * (mean.value - fixed.value) / gap.value,
        100.0 * above_fixed / gap.replicates,
    )


class Bootstrap:
    """The resamples of one ranking, in which every policy plays the same seeds.

    Args:
        seeds: number of seeds.
    """

    def __init__(self, seeds: int) -> None:
        self._seeds = _resamples_of_seeds(seeds)
        self._products = np.empty_like(self._seeds.weights)  # memory that all means share
        # All quantities of a policy are resampled with the same training seeds.
        self._training_seeds: dict[tuple[str, int], _Resamples] = {}

    def _of_training_seeds(self, policy: str, count: int) -> "_Resamples":
        """Return the resamples of a policy's training seeds."""
        if (policy, count) not in self._training_seeds:
            # Keyed by name: two policies' training seeds are unrelated even if they are equal
            # numbers.
            resamples = _Resamples([KEY, crc32(policy.encode())], count)
            self._training_seeds[policy, count] = resamples
        return self._training_seeds[policy, count]

    def means(self, values: Floats, policy: str) -> Floats:
        """Return the mean of a policy's values in each resample, shape (resamples,).

        Args:
            values: shape (training seeds, seeds).
            policy: name of the policy, which keys the resamples of its training seeds.
        """
        count = len(values)
        if count == 1:
            # A rule: every resample of its one row is the row itself.
            resampled = values
        else:
            resampled = self._of_training_seeds(policy, count).weights @ values
        products = np.multiply(resampled, self._seeds.weights, out=self._products)
        means: Floats = np.sum(products, axis=1)
        return means

    def interquartile_means(self, values: Floats, policy: str) -> Floats:
        """Return the interquartile mean of a policy's values in each resample, shape (resamples,).

        See ``means`` for the arguments.
        """
        rows = self._of_training_seeds(policy, len(values)).picks[:, :, np.newaxis]
        columns = self._seeds.picks[:, np.newaxis, :]
        num_seeds = values.shape[1]
        # Resample and sort the places of the values in ascending order: sorting integers of 16 bits
        # takes a third of the time of sorting the values, and leads to the same order.
        ascending = np.sort(values, axis=None)
        small = values.size <= np.iinfo(_PLACE).max
        places: NDArray[Any] = np.empty(values.size, _PLACE if small else np.int64)
        places[np.argsort(values, axis=None, kind="stable")] = np.arange(values.size)
        # Long rows of such integers are sorted faster by a radix sort.
        method: Literal["quicksort", "stable"] = "quicksort"
        if small and values.size >= _LONG_ROW:
            method = "stable"
        means = np.empty(RESAMPLES)
        for chunk in _chunks(values.size):
            # Picking from the flat array is faster than by rows and columns. All places exist, so
            # "clip" only saves their check.
            picks = rows[chunk] * num_seeds + columns[chunk]
            resampled = np.take(places, picks, mode="clip").reshape(-1, values.size)
            middle = _middle(np.sort(resampled, kind=method))
            means[chunk] = np.mean(np.take(ascending, middle, mode="clip"), axis=-1)
        return means

    def shares_above(self, values: Floats, levels: Floats, policy: str) -> Floats:
        """Return the share of a policy's values above each level, shape (levels, resamples).

        ``values`` has the shape (training seeds, seeds).
        """
        training_weights = self._of_training_seeds(policy, len(values)).weights
        order = np.argsort(-values, axis=None, kind="stable")
        training_seed, seed = np.divmod(order, values.shape[1])
        num_above = np.searchsorted(-values.ravel()[order], -levels, side="left")
        shares = np.empty((len(levels), RESAMPLES))
        for chunk in _chunks(values.size):
            weights = (
                training_weights[chunk][:, training_seed] * self._seeds.weights[chunk][:, seed]
            )
            shares_of_highest = np.zeros((len(weights), values.size + 1))
            np.cumsum(weights, axis=1, out=shares_of_highest[:, 1:])
            shares[:, chunk] = shares_of_highest[:, num_above].T
        return shares

    def severe_limit(self, severe: Floats, engaged: Floats, policy: str) -> float:
        """Return the upper limit of ``severe_limits``."""
        _, upper = self.severe_limits(severe, engaged, policy)
        return upper

    def severe_limits(self, severe: Floats, engaged: Floats, policy: str) -> tuple[float, float]:
        """Return the lower and upper one-sided confidence limits of ``severe_share`` [-].

        Args:
            severe: times in severe overload [s], shape (training seeds, seeds).
            engaged: cutting times [s], likewise.
            policy: name of the policy.
        """
        shares = ratio(self.means(severe, policy), self.means(engaged, policy))
        return quantiles(shares, 1.0 - CONFIDENCE, CONFIDENCE)


def feasibility(limits: tuple[float, float], allowance: float) -> Feasibility:
    """Return whether a policy is feasible.

    Args:
        limits: lower and upper confidence limits of its share of severe overload [-].
        allowance: allowed share [-].
    """
    lower, upper = limits
    # Costs of one second of cutting with these shares.
    lower_cost = overload_cost(lower, 1.0, allowance)
    upper_cost = overload_cost(upper, 1.0, allowance)
    if upper_cost <= COST_LIMIT:
        return "feasible"
    return "infeasible" if lower_cost > COST_LIMIT else "not shown"


def reason_not_to_rank(kind: str, scenario: Scenario) -> str | None:
    """Return why a policy of a kind has no rank on a scenario; None if it has one."""
    if kind == "oracle":
        return "oracle"
    if kind == "agent" and scenario.tool.wear_rule == "clock_time":
        return (
            "agent: the published wear rule counts time, so learning finds ways to idle, "
            "and the return is not machining"
        )
    return None


def severe_share(severe: Floats, engaged: Floats) -> float:
    """Return the share of cutting time in severe overload [-], 0 without cutting.

    Args:
        severe: time with an excess above the tolerance in each episode [s].
        engaged: cutting time of each episode [s].
    """
    return float(ratio(severe.sum(keepdims=True), engaged.sum(keepdims=True)).item())


def ratio(parts: Floats, wholes: Floats) -> Floats:
    """Return ``parts / wholes``, or 0 if a whole is 0: a policy that never cuts never overloads."""
    return np.divide(parts, wholes, out=np.zeros_like(parts), where=wholes > 0.0)


class RankKey(NamedTuple):
    """The key by which policies are sorted, the lowest first."""

    is_oracle: bool
    has_no_rank: bool
    is_not_feasible: bool
    demerit: float


def rank_key(kind: str, feasible: bool, merit: float, unranked: str | None = None) -> RankKey:
    """Return the key by which policies are sorted: ranked ones first, oracles last.

    Among these, feasible policies come first, then those of higher merit. ``unranked`` says why a
    policy has no rank.
    """
    return RankKey(
        is_oracle=kind == "oracle",
        has_no_rank=unranked is not None,
        is_not_feasible=not feasible,
        demerit=-merit,
    )


def quantiles(replicates: Floats, low: float, high: float) -> tuple[float, float]:
    """Return two quantiles of bootstrap replicates, shape (resamples,), by shares in 0..1.

    They are those of ``np.quantile``, bit for bit, in a third of its time: a leaderboard needs
    thousands.
    """
    last = len(replicates) - 1
    positions = [low * last, high * last]
    neighbours = []
    for position in positions:
        below = math.floor(position)
        neighbours += [below, min(below + 1, last)]
    ordered = np.partition(replicates, neighbours)
    values = []
    for position in positions:
        below = math.floor(position)
        share = position - below
        lower = float(ordered[below])
        upper = float(ordered[min(below + 1, last)])
        # NumPy interpolates from the nearer neighbour.
        if share < 0.5:
            values.append(lower + (upper - lower) * share)
        else:
            values.append(upper - (upper - lower) * (1.0 - share))
    return values[0], values[1]


def interquartile_mean(values: Floats) -> Floats:
    """Return the mean over the last axis without its lowest and highest quarter.

    Quarters are rounded down.
    """
    return np.asarray(np.mean(_middle(np.sort(values)), axis=-1))


def _middle(ascending: NDArray[Any]) -> NDArray[Any]:
    """Return values without their lowest and highest quarter, each rounded down."""
    count = ascending.shape[-1]
    cut = count // 4
    return ascending[..., cut : count - cut]


def _chunks(count: int) -> list[slice]:
    """Return the resamples of ``count`` values in chunks."""
    rows = max(_CHUNK // count, 1)
    return [slice(first, first + rows) for first in range(0, RESAMPLES, rows)]


class _Resamples:
    """Resamples of a number of seeds: random picks with replacement, as many as there are seeds.

    Attributes:
        picks: the seeds of each resample, shape (resamples, seeds).
        weights: share that a seed has of a resample, likewise.
    """

    def __init__(self, key: int | list[int], seeds: int) -> None:
        picks = np.random.default_rng(key).integers(seeds, size=(RESAMPLES, seeds))
        first = np.arange(RESAMPLES)[:, np.newaxis] * seeds
        counts = np.bincount((picks + first).ravel(), minlength=RESAMPLES * seeds)
        self.picks = picks.astype(np.int32)
        # Sums of shares in place of products: results were published with their last digits.
        shares = np.concatenate([[0.0], np.cumsum(np.full(seeds, 1.0 / seeds))])
        self.weights: Floats = shares[counts].reshape(RESAMPLES, seeds)


# Leaderboards with as many seeds share their resamples.
@lru_cache(2)
def _resamples_of_seeds(seeds: int) -> _Resamples:
    """Return the resamples of the seeds of a ranking."""
    return _Resamples(KEY, seeds)
