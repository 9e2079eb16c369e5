"""A loop of the feed by hand: f (T / L)^(1 / b), for the load that allows less."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from baselines.models.feed_loop import (
    FeedGaps,
    feed_gaps,
    held_in_air,
    log_feed_towards,
    shares_of,
    within_window,
)
from baselines.models.nominal_points import NominalPoints
from tests.turning_env.playing import changed
from turning_env import Scenario
from turning_env.scenario.laws import LoadShares
from turning_env.scenario.scenario_batch import ScenarioBatch


def points(lowest: float = 0.1, highest: float = 0.5) -> NominalPoints:
    return NominalPoints(
        log_speeds=np.zeros((1, 3)),
        log_feed=np.zeros(1),
        log_base_speed=np.zeros(1),
        log_lowest_feed=np.log([lowest]),
        log_highest_feed=np.log([highest]),
        power_exponent=np.array([0.5]),
        force_exponent=np.array([0.25]),
    )


def reading(**values: Any) -> Any:
    arrays = {name: np.array([value]) for name, value in values.items()}
    return SimpleNamespace(**arrays)


def test_loads_are_those_over_the_limits_at_the_cutting_speed() -> None:
    # 100 m/min at the base speed; at 50 m/min half of the power is available.
    scenario = changed(
        Scenario(),
        spindle={"base_speed": 1000.0 / math.pi},
        limits={"power": 6.0, "thrust_force": 900.0},
    )
    batch = ScenarioBatch.of([scenario])
    shares = shares_of(reading(cutting_speed=50.0, power=2.4, thrust_force=450.0), batch)
    assert shares.power == pytest.approx([0.8])
    assert shares.thrust_force == pytest.approx([0.5])


@pytest.mark.parametrize(
    ("power", "force", "by_power", "by_force"),
    [
        pytest.param(0.45, 0.9, 4.0, 1.0, id="power allows four times the feed"),
        pytest.param(1.8, 0.45, 0.25, 16.0, id="power allows a quarter"),
        pytest.param(0.0, 0.01, 18.0**2, 18.0**4, id="loads of at least a twentieth"),
    ],
)
def test_the_gap_is_that_to_the_feed_of_the_target(
    power: float, force: float, by_power: float, by_force: float
) -> None:
    loads = LoadShares(power=np.array([power]), thrust_force=np.array([force]))
    gaps = feed_gaps(loads, points(), np.log([0.9]))
    assert gaps.power == pytest.approx([math.log(by_power)])
    assert gaps.thrust_force == pytest.approx([math.log(by_force)])
    assert gaps.least == pytest.approx([math.log(min(by_power, by_force))])
    assert FeedGaps(np.array([1.0, 2.0]), np.array([2.0, 1.0])).least.tolist() == [1.0, 1.0]


@pytest.mark.parametrize(("gap", "moved"), [(0.5, 0.1), (-0.5, -0.4), (0.0, 0.0)])
def test_the_feed_rises_and_falls_by_shares_of_the_gap(gap: float, moved: float) -> None:
    log_feed = log_feed_towards(reading(feed=0.3), np.array([gap]), up=0.2, down=0.8)
    assert log_feed == pytest.approx([math.log(0.3) + moved])


@pytest.mark.parametrize(("cutting", "feed"), [(True, 0.2), (False, 0.4)])
def test_the_command_stays_in_air(cutting: bool, feed: float) -> None:
    now = reading(cutting=cutting, commanded_feed=0.4)
    assert held_in_air(now, np.log([0.2])) == pytest.approx([math.log(feed)])


@pytest.mark.parametrize(
    ("feed", "expected"),
    [(0.05, 0.1 * math.exp(0.01)), (0.3, 0.3), (0.9, 0.5 * math.exp(-0.02))],
)
def test_the_feed_keeps_margins_from_the_ends_of_the_window(feed: float, expected: float) -> None:
    assert np.exp(within_window(np.log([feed]), points())) == pytest.approx([expected])


def test_in_a_narrow_window_the_low_end_holds() -> None:
    narrow = points(lowest=0.3, highest=0.301)
    assert np.exp(within_window(np.log([0.9]), narrow)) == pytest.approx([0.3 * math.exp(0.01)])
    wide = within_window(np.log([0.9]), points(), low_margin=0.0, high_margin=0.5)
    assert np.exp(wide) == pytest.approx([0.5 * math.exp(-0.5)])
