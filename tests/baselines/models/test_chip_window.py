"""The window of feeds, estimated from stops for tangled chips."""

from typing import Any

import numpy as np
import pytest

from baselines.models.chip_window import SHIFTS, ChipWindow
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
