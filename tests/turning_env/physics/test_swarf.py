"""Chips that tangle outside the chip breaker's window."""

from typing import Any

import pytest

from baselines.fixed import FixedParameters
from leaderboard.play import Episodes, play
from tests.turning_env.playing import UNDISTURBED, changed

TANGLE_RATE = 0.5
WINDOW = {
    "tangle_rate": TANGLE_RATE,
    "chip_feed_min": 0.2,
    "chip_feed_max": 0.4,
    "chip_depth_min": 2.0,
    "chip_depth_max": 3.0,
}
EDGES = 100


def episodes(feed: float, depth: float, swarf: dict[str, Any]) -> Episodes:
    """Play edges that last some minutes."""
    scenario = changed(
        UNDISTURBED, swarf=swarf, workpiece={"depth_of_cut": depth}, control={"interval": 6.0}
    )
    return play(lambda _: FixedParameters(scenario, 190.0, feed), scenario, range(EDGES))


@pytest.mark.parametrize(
    ("feed", "depth"),
    [
        pytest.param(0.15, 2.5, id="low feed"),
        pytest.param(0.45, 2.5, id="high feed"),
        pytest.param(0.3, 1.5, id="shallow"),
        pytest.param(0.3, 3.5, id="deep"),
    ],
)
def test_outside_the_window_chips_stop_the_machine_at_their_rate(feed: float, depth: float) -> None:
    """The number of stops is Poisson, so its standard error over some 500 is 4.5 %."""
    played = episodes(feed, depth, WINDOW)
    stops = played["stopped_time"] / 60.0
    expected = TANGLE_RATE * played["engaged_time"].sum() / 60.0
    assert len(stops) == EDGES
    assert stops.tolist() == stops.round().tolist()
    assert stops.sum() == pytest.approx(expected, abs=4.0 * expected**0.5)
    assert 0.5 < stops.var() / stops.mean() < 2.0
    assert played["time"] == pytest.approx(played["engaged_time"] + played["stopped_time"])
    assert played["reward_time"].tolist() == (-played["time"]).tolist()


@pytest.mark.parametrize(
    ("feed", "depth", "swarf"),
    [
        pytest.param(0.2 * (1 - 1e-7), 2.5, WINDOW, id="lowest feed, rounded"),
        pytest.param(0.4 * (1 + 1e-7), 2.5, WINDOW, id="highest feed, rounded"),
        pytest.param(0.15, 1.5, {}, id="default"),
    ],
)
def test_inside_the_window_and_by_default_chips_break(
    feed: float, depth: float, swarf: dict[str, Any]
) -> None:
    """The ends of the window belong to it, whatever the rounding of actions."""
    assert episodes(feed, depth, swarf)["stopped_time"].tolist() == [0.0] * EDGES
