"""Estimates against values computed by hand, and against the spread of means."""

from zlib import crc32

import numpy as np
import pytest
import scipy.stats

from leaderboard.statistics import (
    CONFIDENCE,
    RESAMPLES,
    Bootstrap,
    Estimate,
    Mean,
    feasibility,
    interquartile_mean,
    quantiles,
    rank_key,
    ratio,
    reason_not_to_rank,
    score_of,
    severe_share,
)
from turning_env import Scenario

ENGAGED = np.array([100.0, 300.0, 200.0, 50.0, 250.0])  # [s]
SEVERE = np.array([10.0, 0.0, 4.0, 0.0, 30.0])  # [s]


def test_resamples_vary_as_means_do() -> None:
    values = np.random.default_rng(4).normal(size=(1, 100))
    bootstrap = Bootstrap(100)
    means = bootstrap.means(values, "rule")
    interquartile_means = bootstrap.interquartile_means(values, "rule")
    assert means.mean() == pytest.approx(values.mean(), abs=0.01)
    assert means.std() == pytest.approx(values.std() / 10.0, abs=0.01)
    assert interquartile_means.mean() == pytest.approx(interquartile_mean(values[0]), abs=0.02)
    assert np.corrcoef(means, interquartile_means)[0, 1] > 0.8


def test_interquartile_mean_drops_a_quarter_at_either_end() -> None:
    eight = np.array([8.0, 1, 2, 100, 3, 4, 5, -50])
    five = np.array([9.0, 1, 2, 3, 4])
    four = np.array([9.0, 1, 2, -30])
    three = np.array([9.0, 0, 0])
    assert interquartile_mean(eight) == (2 + 3 + 4 + 5) / 4
    assert interquartile_mean(five) == 3.0
    assert interquartile_mean(four) == 1.5
    assert interquartile_mean(three) == 3.0


def test_seeds_are_paired() -> None:
    values = np.random.default_rng(6).normal(size=(1, 30))
    bootstrap = Bootstrap(30)
    difference = bootstrap.means(values + 1.0, "better") - bootstrap.means(values, "worse")
    np.testing.assert_allclose(difference, 1.0)


def test_the_same_episodes_give_the_same_resamples() -> None:
    values = np.random.default_rng(6).normal(size=(1, 30))
    first = Bootstrap(30).means(values, "rule")
    second = Bootstrap(30).means(values, "rule")
    np.testing.assert_array_equal(first, second)


def test_training_seeds_are_not_paired() -> None:
    values = np.repeat([[0.0], [1.0]], 30, axis=1)  # the second training seed is better
    bootstrap = Bootstrap(30)
    first = bootstrap.means(values, "first")
    second = bootstrap.means(values, "second")
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("count", [2, 3, 40, 2000])
def test_quantiles_are_those_of_numpy(count: int) -> None:
    for seed in range(20):
        values = np.random.default_rng([seed, count]).normal(size=count)
        for low, high in ((0.025, 0.975), (0.05, 0.95), (0.0, 1.0), (0.25, 0.5)):
            assert quantiles(values, low, high) == tuple(np.quantile(values, [low, high]))


def test_shares_above_levels_are_means_of_the_values_above() -> None:
    values = np.random.default_rng(8).normal(size=(3, 40)).round(1)  # some are equal
    levels = np.array([-9.0, 0.0, 0.5, 9.0])
    bootstrap = Bootstrap(40)
    shares = bootstrap.shares_above(values, levels, "agent")
    for level, share in zip(levels, shares, strict=True):
        above = np.asarray(values > level, np.float64)
        np.testing.assert_allclose(share, bootstrap.means(above, "agent"), atol=1e-12)


def test_the_limit_is_above_the_share() -> None:
    share = severe_share(SEVERE, ENGAGED)
    assert share == pytest.approx(44 / 900)
    limit = Bootstrap(len(SEVERE)).severe_limit(SEVERE[None], ENGAGED[None], "rule")
    assert share < limit < max(SEVERE / ENGAGED)


def picks(seeds: int, *key: int | str) -> np.ndarray:
    """Return the seeds of each resample, drawn with the published key 709 and names."""
    words = [crc32(word.encode()) if isinstance(word, str) else word for word in key]
    generator = np.random.default_rng([709, *words] if words else 709)
    return generator.integers(seeds, size=(2000, seeds))


def test_an_interval_holds_95_percent_of_the_replicates() -> None:
    replicates = np.random.default_rng(1).permutation(np.arange(2001.0))
    estimate = Estimate.of(7, replicates)
    assert (CONFIDENCE, RESAMPLES) == (0.95, 2000)
    # 2.5 % of 0..2000 are below 50, and 2.5 % above 1950.
    assert (estimate.value, estimate.low, estimate.high) == pytest.approx((7.0, 50.0, 1950.0))
    assert Mean(7.0, replicates).estimate == estimate


def test_the_interval_of_a_mean_is_that_of_scipys_bootstrap() -> None:
    values = np.random.default_rng(2).gamma(2.0, size=(1, 60))
    estimate = Mean(values.mean(), Bootstrap(60).means(values, "rule")).estimate
    interval = scipy.stats.bootstrap(
        (values[0],), np.mean, n_resamples=20_000, method="percentile", rng=3
    ).confidence_interval
    width = interval.high - interval.low
    assert estimate.low == pytest.approx(interval.low, abs=0.05 * width)
    assert estimate.high == pytest.approx(interval.high, abs=0.05 * width)


def test_means_are_those_of_the_resampled_rows_and_seeds() -> None:
    values = np.random.default_rng(5).normal(size=(3, 7))
    bootstrap = Bootstrap(7)
    seeds = picks(7)
    rows = picks(3, "agent")
    resampled = values[rows[:, :, np.newaxis], seeds[:, np.newaxis, :]]
    assert bootstrap.means(values, "agent") == pytest.approx(resampled.mean(axis=(1, 2)))
    rule = values[:1]
    assert bootstrap.means(rule, "rule") == pytest.approx(rule[0][seeds].mean(axis=1))


@pytest.mark.parametrize("shape", [(1, 9), (3, 7), (2, 256), (2, 300)])
def test_interquartile_means_are_those_of_scipy(shape: tuple[int, int]) -> None:
    trainings, seeds = shape
    values = np.random.default_rng(6).normal(size=shape).round(2)  # some are equal
    means = Bootstrap(seeds).interquartile_means(values, "agent")
    rows = picks(trainings, "agent")[:, :, np.newaxis]
    columns = picks(seeds)[:, np.newaxis, :]
    resampled = values[rows, columns].reshape(2000, -1)
    assert means == pytest.approx(scipy.stats.trim_mean(resampled, 0.25, axis=1))
    middle = scipy.stats.trim_mean(values, 0.25, axis=1)
    assert interquartile_mean(values) == pytest.approx(middle)


@pytest.mark.parametrize("count", [1, 3])
def test_the_limits_of_severe_overload_are_its_5th_and_95th_percentiles(count: int) -> None:
    random = np.random.default_rng(9)
    engaged = random.uniform(50.0, 300.0, (count, 30))
    severe = engaged * random.uniform(0.0, 0.2, (count, 30))
    bootstrap = Bootstrap(30)
    limits = bootstrap.severe_limits(severe, engaged, "agent")
    columns = picks(30)[:, np.newaxis, :]
    rows = picks(count, "agent")[:, :, np.newaxis]
    severe_sums = severe[rows, columns].sum(axis=(1, 2))
    shares = severe_sums / engaged[rows, columns].sum(axis=(1, 2))
    assert limits == pytest.approx(tuple(np.quantile(shares, [0.05, 0.95])))
    assert bootstrap.severe_limit(severe, engaged, "agent") == limits[1]


def test_the_limits_of_a_share_of_seeds_are_those_of_a_binomial_number() -> None:
    """On 20 of 100 seeds all cutting is severe overload: a resample holds a binomial number."""
    severe = np.zeros((1, 100))
    severe[0, :20] = 60.0
    lower, upper = Bootstrap(100).severe_limits(severe, np.full((1, 100), 60.0), "rule")
    binomial = scipy.stats.binom(100, 0.2)
    assert lower == pytest.approx(binomial.ppf(0.05) / 100.0)
    assert upper == pytest.approx(binomial.ppf(0.95) / 100.0)


@pytest.mark.parametrize(
    ("limits", "state"),
    [
        ((0.0, 0.04), "feasible"),
        ((0.01, 0.05), "feasible"),
        ((0.04, 0.06), "not shown"),
        ((0.05, 0.06), "not shown"),
        ((0.051, 0.06), "infeasible"),
    ],
)
def test_the_allowance_lies_above_between_or_below_the_limits(
    limits: tuple[float, float], state: str
) -> None:
    assert feasibility(limits, 0.05) == state


def mean_of(*replicates: float) -> Mean:
    return Mean(float(np.mean(replicates)), np.array(replicates))


def test_the_score_is_the_share_of_the_gap_in_hundredths() -> None:
    score = score_of(mean_of(5.0, 3.0), fixed=mean_of(2.0, 0.0), oracle=mean_of(8.0, 12.0))
    assert score is not None
    # (4 - 1) / (10 - 1); then 3 of 6 and 3 of 12.
    assert score.value == pytest.approx(100.0 / 3.0)
    assert score.replicates == pytest.approx([50.0, 25.0])


def test_without_a_certain_gap_there_is_no_score() -> None:
    fixed = Mean(0.0, np.zeros(2000))
    gap = np.full(2000, 5.0)
    assert score_of(fixed, fixed, Mean(5.0, gap)) is not None
    # A single resample in which the oracle is no better: the interval is still above 0.
    gap[17] = 0.0
    assert score_of(fixed, fixed, Mean(5.0, gap)) is None
    gap[:] = 1e-9
    assert score_of(fixed, fixed, Mean(5.0, gap)) is not None
    # The lower limit is 0 at 2.5 % of such resamples.
    gap[:100] = 0.0
    assert score_of(fixed, fixed, Mean(5.0, gap)) is None


@pytest.mark.parametrize(
    ("low", "high", "factor", "decimals"),
    [
        pytest.param(0.0, 100.0, 1.0, 0, id="hundred"),
        pytest.param(0.0, 10.0, 1.0, 0, id="ten"),
        pytest.param(0.0, 9.9, 1.0, 1, id="below ten"),
        pytest.param(0.0, 1.0, 1.0, 1, id="one"),
        pytest.param(0.0, 0.99, 1.0, 2, id="below one"),
        pytest.param(0.0, 1e-4, 1.0, 2, id="at most two"),
        pytest.param(0.0, 0.01, 100.0, 1, id="in per cent"),
        # 3.0 is shown itself without an interval, with one of rounding only, too.
        pytest.param(3.0, 3.0, 1.0, 1, id="no interval"),
        pytest.param(3.0, 3.0 + 5e-7, 1.0, 1, id="rounding"),
        pytest.param(3.0, 3.0 + 1.5e-6, 1.0, 2, id="narrow"),
        pytest.param(0.0, 1e-6, 1.0, 1, id="rounding at most"),
        pytest.param(3.0, 3.0, 10.0, 0, id="no interval, in tenths"),
    ],
)
def test_decimals_show_two_digits_of_an_interval(
    low: float, high: float, factor: float, decimals: int
) -> None:
    assert Estimate(-3.0, low, high).decimals(factor) == decimals


@pytest.mark.parametrize("value", [0.0, 1e-6, -9e-7])
def test_nothing_has_no_decimals(value: float) -> None:
    assert Estimate(value, 0.0, 0.0).decimals() == 0


def test_what_never_cuts_never_overloads() -> None:
    shares = ratio(np.array([3.0, 5.0, 1.0]), np.array([6.0, 0.0, 0.5]))
    assert shares.tolist() == [0.5, 0.0, 2.0]
    assert severe_share(SEVERE, np.zeros(5)) == 0.0
    assert severe_share(np.array([0.1, 0.2]), np.array([0.5, 0.1])) == pytest.approx(0.5)
    assert severe_share(np.array([[1.0, 2.0], [3.0, 4.0]]), np.full((2, 2), 5.0)) == 0.5


def test_oracles_come_last_then_what_has_no_rank_then_the_infeasible() -> None:
    ordered = [
        rank_key("rule", True, merit=2.0),
        rank_key("agent", True, merit=1.0),
        rank_key("rule", False, merit=9.0),
        rank_key("agent", True, merit=9.0, unranked="learns to idle"),
        rank_key("oracle", True, merit=99.0, unranked="oracle"),
    ]
    assert ordered[-1] > ordered[-2] > ordered[-3] > ordered[-4] > ordered[-5]
    assert not ordered[0].is_oracle
    assert not ordered[0].has_no_rank


@pytest.mark.parametrize(
    ("kind", "preset", "reason"),
    [
        ("oracle", "rough_turning", "oracle"),
        ("oracle", "paper", "oracle"),
        ("agent", "paper", "agent: the published wear rule"),
        ("agent", "rough_turning", None),
        ("rule", "paper", None),
    ],
)
def test_oracles_and_agents_on_the_published_wear_rule_have_no_rank(
    kind: str, preset: str, reason: str | None
) -> None:
    found = reason_not_to_rank(kind, Scenario.load(preset))
    assert found is None if reason is None else (found or "").startswith(reason)
