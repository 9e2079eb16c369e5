"""The window of feeds, estimated from stops for tangled chips."""

from typing import Any

import numpy as np
import pytest

from baselines.models.chip_window import SHIFTS, ChipWindow
from tests.turning_env.playing import changed
from turning_env import Family, Scenario, read

FAMILY = Family.load("unmodelled")
MODEL = FAMILY.job(0).scenario.nominal()
LOW, HIGH = MODEL.feed_range


def reading(scenario: Scenario, feed: float, stops: float) -> Any:
    """Return a reading of one environment that cuts at a feed [mm/rev]."""
    observation = np.zeros((1, 13), np.float32)
    one = read(observation, scenario)
    return one._replace(
        feed=np.array([feed]), tangles=np.array([stops]), cutting=np.ones(1, np.bool_)
    )


def after(stops: list[float], feed: float) -> ChipWindow:
    """Return the window after steps with stops at a feed [mm/rev]."""
    window = ChipWindow(MODEL, 1)
    for count in stops:
        window.observe(reading(MODEL, feed, count))
    return window


def test_without_stops_the_window_is_the_catalogues() -> None:
    low, high = after([0.0] * 300, feed=LOW * 1.05).feed_range()
    assert (low[0], high[0]) == pytest.approx((LOW, HIGH))


def test_stops_at_low_feeds_raise_the_window_and_at_high_feeds_lower_it() -> None:
    minute = [0.0] * 59
    low, high = after([*minute, 1.0, *minute, 1.0], feed=LOW * 1.02).feed_range()
    assert low[0] > 1.3 * LOW
    assert high[0] == pytest.approx(HIGH)  # the machine has no higher feed
    low, high = after([*minute, 1.0, *minute, 1.0], feed=HIGH / 1.02).feed_range()
    assert low[0] < LOW
    assert high[0] < HIGH / 1.02


def test_time_without_stops_outweighs_an_early_one() -> None:
    window = after([1.0, *[0.0] * 1200], feed=LOW * 1.02)
    assert window.shift[0] == 0.0
    # A window that is shifted up would have stopped the machine again.
    log_odds = window.log_weights[0] - window.log_weights[0, SHIFTS == 0.0]
    assert np.exp(log_odds[SHIFTS > 0.0]).sum() < 1e-3


def test_a_reset_forgets_the_stops() -> None:
    window = after([1.0, 1.0, 1.0], feed=LOW * 1.02)
    window.reset(np.ones(1, np.bool_))
    np.testing.assert_array_equal(window.log_weights, ChipWindow(MODEL, 1).log_weights)


TANGLING = changed(
    Scenario(),
    swarf={"tangle_rate": 2.0, "chip_feed_min": 0.2, "chip_feed_max": 0.4},
    control={"interval": 15.0},
    machine={"feed_min": 0.15, "feed_max": 0.5},
)


def read_as(feed: float, stops: float, cutting: bool = True) -> Any:
    one = read(np.zeros((1, 11), np.float32), TANGLING)
    return one._replace(
        feed=np.array([feed]), tangles=np.array([stops]), cutting=np.array([cutting])
    )


def odds_after(feed: float, stops: float, cutting: bool = True) -> dict[float, float]:
    """Return the weight of each shift over its prior, after one step."""
    window = ChipWindow(TANGLING, 1)
    before = np.exp(window.log_weights[0])
    window.observe(read_as(feed, stops, cutting))
    ratios = np.exp(window.log_weights[0]) / before
    return dict(zip(SHIFTS.tolist(), ratios.tolist(), strict=True))


def test_half_of_the_weight_is_on_the_catalogues_window_at_first() -> None:
    assert SHIFTS.tolist() == [0.0, -0.65, -0.55, -0.45, -0.35, 0.35, 0.45, 0.55, 0.65]
    weights = np.exp(ChipWindow(TANGLING, 2).log_weights)
    assert weights.shape == (2, 9)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    assert weights[1, SHIFTS == 0.0] == pytest.approx(0.5)
    assert weights[0, SHIFTS != 0.0] == pytest.approx(1.0 / 16.0)


@pytest.mark.parametrize(
    ("feed", "inside"),
    [
        # The window 0.2..0.4 mm/rev times exp(shift).
        pytest.param(0.2825, [0.0], id="middle: neither shift reaches it"),
        pytest.param(0.201, [0.0, -0.65, -0.55, -0.45, -0.35], id="low"),
        pytest.param(0.2, [0.0, -0.65, -0.55, -0.45, -0.35], id="lowest"),
        pytest.param(0.4, [0.0, 0.35, 0.45, 0.55, 0.65], id="highest"),
        pytest.param(0.199, [-0.65, -0.55, -0.45, -0.35], id="below the catalogue's"),
        pytest.param(0.399, [0.0, 0.35, 0.45, 0.55, 0.65], id="high"),
        pytest.param(0.401, [0.35, 0.45, 0.55, 0.65], id="above the catalogue's"),
    ],
)
@pytest.mark.parametrize("stops", [0.0, 2.0])
def test_the_weights_follow_bayes_rule_for_a_poisson_process(
    feed: float, inside: list[float], stops: float
) -> None:
    """In 15 s at 2 per minute half a stop is expected outside, and 5 % of that inside."""
    for shift, ratio in odds_after(feed, stops).items():
        share = 0.05 if shift in inside else 1.0
        assert ratio == pytest.approx(np.exp(-0.5 * share) * share**stops), shift


def test_air_says_nothing_and_neither_do_stops_that_are_not_counted() -> None:
    assert list(odds_after(0.3, 0.0, cutting=False).values()) == [1.0] * 9
    assert odds_after(0.3, np.nan) == odds_after(0.3, 0.0)


@pytest.mark.parametrize(
    ("shift", "low", "high"),
    [
        pytest.param(0.0, 0.2, 0.4, id="catalogue"),
        pytest.param(-0.35, 0.15, 0.4 * np.exp(-0.35), id="down, to the machine's lowest feed"),
        pytest.param(0.65, 0.2 * np.exp(0.65), 0.5, id="up, to its highest"),
    ],
)
def test_the_range_of_feeds_is_that_of_the_most_probable_shift(
    shift: float, low: float, high: float
) -> None:
    window = ChipWindow(TANGLING, 2)
    window.log_weights[1, shift == SHIFTS] = 9.0
    assert window.shift.tolist() == [0.0, shift]
    lowest, highest = window.feed_range()
    assert (lowest[1], highest[1]) == pytest.approx((low, high))
    assert (lowest[0], highest[0]) == pytest.approx((0.2, 0.4))


def test_only_the_environments_of_a_mask_forget() -> None:
    window = ChipWindow(TANGLING, 2)
    window.log_weights[:] = 3.0
    window.reset(np.array([False, True]))
    assert window.log_weights[0].tolist() == [3.0] * 9
    assert np.exp(window.log_weights[1]).sum() == pytest.approx(1.0)
