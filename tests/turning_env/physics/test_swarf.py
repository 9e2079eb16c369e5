"""Chips that tangle outside the chip breaker's window."""

from typing import Any

import pytest

from baselines.fixed import FixedParameters
from leaderboard.play import Episodes, play
from tests.turning_env.physics.one_env import AFTER, ENV, fill, put, records_of
from tests.turning_env.playing import UNDISTURBED, changed
from turning_env.numerics.keyed_random import TANGLE_CHANNEL, exponential
from turning_env.physics.swarf import tangle

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


@pytest.mark.compiled
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


@pytest.mark.compiled
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


def tangled(feed: float, depth: float, margin: float, rate: float = 2.0) -> Any:
    """Return records after a sub-step of 0.1 min in a window of 0.2..0.4 mm/rev and 2..3 mm."""
    records = records_of(
        chip_feed_min=0.2,
        chip_feed_max=0.4,
        chip_depth_min=2.0,
        chip_depth_max=3.0,
        tangle_rate=rate,
    )
    records.state.tangle_margin[:] = 1.0
    put(records.state, seed=4, feed=feed, depth_of_cut=depth, tangle_margin=margin, tangles=6)
    put(records.work, engaged=0.1, tangles=1)
    tangle(records.state, records.work, AFTER, records.p)
    return records


@pytest.mark.parametrize(
    ("feed", "depth", "used"),
    [
        pytest.param(0.3, 2.5, 0.0, id="inside"),
        pytest.param(0.2, 2.0, 0.0, id="lower corner"),
        pytest.param(0.4, 3.0, 0.0, id="upper corner"),
        pytest.param(0.2 * (1.0 - 9e-7), 2.5, 0.0, id="rounded down"),
        pytest.param(0.2 * (1.0 - 2e-6), 2.5, 0.2, id="feed too low"),
        pytest.param(0.4 * (1.0 + 9e-7), 2.5, 0.0, id="rounded up"),
        pytest.param(0.4 * (1.0 + 2e-6), 2.5, 0.2, id="feed too high"),
        pytest.param(0.3, 1.99, 0.2, id="too shallow"),
        pytest.param(0.3, 3.01, 0.2, id="too deep"),
        pytest.param(0.1, 1.0, 0.2, id="feed and depth"),
    ],
)
def test_the_margin_is_used_up_outside_the_window(feed: float, depth: float, used: float) -> None:
    """The rate is 2 per minute."""
    records = tangled(feed, depth, margin=0.7)
    assert records.state.tangle_margin[ENV] == pytest.approx(0.7 - used)
    assert records.state.tangles[ENV] == 6
    assert records.work.tangles[ENV] == 1


@pytest.mark.parametrize(("margin", "rate"), [(0.15, 2.0), (0.0, 0.0)])
def test_chips_tangle_once_the_margin_is_used_up_and_the_next_one_is_drawn(
    margin: float, rate: float
) -> None:
    records = tangled(feed=0.1, depth=2.5, margin=margin, rate=rate)
    next_margin = exponential(records.state, ENV, channel=TANGLE_CHANNEL, bar=0, index=7)
    left = margin - 0.1 * rate
    assert records.state.tangle_margin[ENV] == pytest.approx(left + next_margin)
    assert records.state.tangles[ENV] == 7
    assert records.work.tangles[ENV] == 2
    # The environments beside it go on.
    assert not records.state.tangles[:ENV].any()


def test_chips_of_all_environments_may_tangle_at_once() -> None:
    records = records_of()
    fill(records.state, seed=4, tangle_margin=-0.5)
    tangle(records.state, records.work, AFTER, records.p)
    assert records.work.tangles[:AFTER].tolist() == [1] * AFTER
    assert (records.state.tangle_margin[:AFTER] > -0.5).all()
