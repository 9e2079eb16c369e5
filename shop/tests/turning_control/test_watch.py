"""Readings that are possible one by one, but stand still or contradict one another."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from turning_control.core import Status
from turning_control.readings import Readings
from turning_control.watch import FROZEN_INTERVALS, STUCK_TIME

from shop.tests.turning_control.closed_loop import ClosedLoop
from turning_env import Scenario

APPROACH = -2.0  # [mm]
BEFORE_DEEP = 39.0  # before a section of triple depth [mm]


class Frozen:
    """Keeps the first readings that it gets, or some of their values."""

    def __init__(self, *names: str) -> None:
        self._names = names
        self._first: Readings | None = None

    def __call__(self, readings: Readings) -> Readings:
        if self._first is None:
            self._first = readings
        if not self._names:
            return self._first
        return replace(readings, **{name: getattr(self._first, name) for name in self._names})


def spoiled(
    spoil: Callable[[Readings], Readings], start: float, steps: int, preset: str = "override"
) -> ClosedLoop:
    """Return a loop that has run for some steps after three good ones."""
    loop = ClosedLoop(Scenario.load(preset), start=start)
    for _ in range(3):
        loop.step()
    for _ in range(steps):
        loop.step(spoil)
    return loop


@pytest.mark.parametrize("start", [APPROACH, BEFORE_DEEP])
def test_a_frozen_gateway_is_noticed_within_a_few_intervals(start: float) -> None:
    loop = spoiled(Frozen(), start, steps=200)
    assert max(loop.course.feeds[3 + FROZEN_INTERVALS :]) <= loop.safe_feed
    assert loop.commands.status == Status.SAFE
    assert loop.commands.reason == "sensor stuck"
    assert sum(loop.course.severe) == 0.0


def test_a_gateway_that_freezes_without_feed_motion_leaves_at_most_the_safe_feed() -> None:
    loop = ClosedLoop(Scenario.load("override"), start=98.0)
    while loop.commands.status != Status.IDLE or not loop.course.feeds:
        loop.step()
    frozen = Frozen()
    for _ in range(150):
        loop.step(frozen)
    assert max(loop.course.feeds[-150:]) <= loop.safe_feed


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        pytest.param(Frozen("position"), "position", id="position stands"),
        pytest.param(
            lambda readings: replace(readings, position=100.0 - readings.position),
            "position",
            id="position runs backwards",
        ),
        pytest.param(
            lambda readings: replace(
                readings,
                spindle_speed=readings.feed_velocity,
                feed_velocity=readings.spindle_speed,
            ),
            "feed_velocity contradicts spindle_speed",
            id="swapped velocities",
        ),
        pytest.param(
            lambda readings: replace(readings, cutting=False), "cutting", id="cutting is false"
        ),
        pytest.param(
            lambda readings: replace(readings, cutting=False, position=math.nan),
            "position",
            id="position lost",
        ),
        pytest.param(
            lambda readings: replace(readings, engaged_time=0.0), "engaged_time", id="edge's clock"
        ),
        pytest.param(lambda readings: replace(readings, new_edge=True), "new_edge", id="new edges"),
        pytest.param(Frozen("power"), "stuck", id="power"),
    ],
)
def test_a_contradiction_gives_the_safe_feed(
    spoil: Callable[[Readings], Readings], reason: str
) -> None:
    steps = math.ceil(STUCK_TIME / 0.012) + 2
    loop = spoiled(spoil, start=BEFORE_DEEP, steps=steps)
    assert loop.commands.status == Status.SAFE
    assert reason in loop.commands.reason
    assert loop.commands.adaptive_feed <= loop.safe_feed


def test_a_power_and_a_position_that_are_swapped_never_free_the_feed() -> None:
    def swap(readings: Readings) -> Readings:
        return replace(readings, position=readings.power, power=readings.position)

    loop = spoiled(swap, start=BEFORE_DEEP, steps=100)
    assert max(loop.course.feeds[3 + FROZEN_INTERVALS :]) <= loop.safe_feed


def test_loads_show_that_cutting_is_wrong_where_no_position_is_known() -> None:
    loop = ClosedLoop(Scenario.load("override"), start=BEFORE_DEEP)
    for _ in range(60):
        loop.step(lambda readings: replace(readings, position=math.nan, cutting=False))
    assert loop.commands.status == Status.SAFE
    assert loop.commands.reason == "loads contradict cutting"


def test_a_feed_above_its_command_gives_the_safe_feed() -> None:
    loop = ClosedLoop(Scenario.load("override"), start=APPROACH)
    frozen = Frozen("feed_velocity", "spindle_speed")
    loop.step()
    for _ in range(300):
        loop.step(lambda readings: replace(frozen(readings), position=math.nan))
    assert sum(loop.course.severe) < STUCK_TIME


def test_the_policy_resumes_when_the_readings_are_good_again() -> None:
    loop = spoiled(Frozen(), start=20.0, steps=20)
    loop.step()
    for _ in range(10):
        loop.step()
    assert loop.commands.status in (Status.POLICY, Status.SHIELD)
    assert loop.commands.adaptive_feed > loop.safe_feed


def run_up(obeys_from: float) -> ClosedLoop:
    """Return a loop after 2.4 s, which began 6 mm before the bar with adaptive feed off.

    The policy asks for half the programmed feed. Adaptive feed is on from the position
    ``obeys_from`` along the bar [mm].
    """
    loop = ClosedLoop(Scenario.load("override"), start=-6.0, action=-0.5)
    for _ in range(200):
        loop.obeys = loop.position >= obeys_from
        loop.step()
    return loop


@pytest.mark.slow
def test_in_a_run_up_with_adaptive_feed_off_the_feed_need_not_follow() -> None:
    loop = run_up(obeys_from=-0.3)
    assert loop.position > 0.0
    assert "SAFE" not in loop.course.statuses
    assert loop.commands.status == Status.POLICY


@pytest.mark.slow
def test_a_feed_that_does_not_follow_in_metal_is_a_fault() -> None:
    loop = run_up(obeys_from=math.inf)
    assert loop.position > 0.0
    assert loop.commands.status == Status.SAFE
    assert loop.commands.reason == "feed_velocity does not follow"


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["override", "surface", "rough_turning"])
def test_good_readings_are_never_a_fault(preset: str) -> None:
    loop = ClosedLoop(Scenario.load(preset))
    for _ in range(700):
        loop.step()
    assert "SAFE" not in loop.course.statuses
    assert loop.course.severe_share() <= 0.001


@pytest.mark.slow
def test_a_late_end_of_the_cutting_signal_does_not_spoil_the_next_bars() -> None:
    loop = ClosedLoop(Scenario.load("rough_turning"))
    for _ in range(400):
        loop.step(lambda readings: replace(readings, cutting=readings.engaged_time > 0.0))
    assert loop.course.severe_share() <= 0.001
