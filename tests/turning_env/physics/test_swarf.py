"""Chips that tangle outside the chip breaker's window."""

from typing import Any

import pytest

from baselines.fixed import FixedParameters
from tests.turning_env.playing import UNDISTURBED, changed
from turning_env import Scenario
from turning_env.scoring.play import Episodes, play

WINDOW = {
    "tangle_rate": 0.5,
    "chip_feed_min": 0.2,
    "chip_feed_max": 0.4,
    "chip_depth_min": 2.0,
    "chip_depth_max": 3.0,
}
EDGES = 100


def episodes(scenario: Scenario, feed: float, depth: float, **swarf: Any) -> Episodes:
    """Play edges that last some minutes."""
    scenario = changed(
        scenario, swarf=swarf, workpiece={"depth_of_cut": depth}, control={"interval": 6.0}
    )
    return play(lambda _: FixedParameters(scenario, 190.0, feed), scenario, range(EDGES))


@pytest.mark.parametrize(("feed", "depth"), [(0.15, 2.5), (0.45, 2.5), (0.3, 1.5), (0.3, 3.5)])
def test_outside_the_window_chips_stop_the_machine_at_their_rate(feed: float, depth: float) -> None:
    """The number of stops is Poisson, so its standard error over some 500 is 4.5 %."""
    played = episodes(UNDISTURBED, feed, depth, **WINDOW)
    stops = played["stopped_time"] / 60.0
    assert (stops == stops.round()).all()
    expected = 0.5 * played["engaged_time"].sum() / 60.0
    assert stops.sum() == pytest.approx(expected, abs=4.0 * expected**0.5)
    assert 0.5 < stops.var() / stops.mean() < 2.0
    assert played["time"] == pytest.approx(played["engaged_time"] + played["stopped_time"])
    assert played["reward_time"].tolist() == (-played["time"]).tolist()


def test_inside_the_window_and_by_default_chips_break() -> None:
    """The ends of the window belong to it, whatever the rounding of actions."""
    for feed, depth, swarf in (
        (0.2 * (1 - 1e-7), 2.5, WINDOW),
        (0.4 * (1 + 1e-7), 2.5, WINDOW),
        (0.15, 1.5, {}),
    ):
        assert not episodes(UNDISTURBED, feed, depth, **swarf)["stopped_time"].any()
