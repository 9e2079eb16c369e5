"""Whatever happens to the readings, a load over its limit soon leaves at most the safe feed.

A lathe turns bars while its readings are lost, impossible, frozen, swapped, old or out of order,
one or several at a time. A sensor with a wrong scale is no such fault: the shield trusts it.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from turning_control.readings import SWITCHES, Readings, needed_readings, possible_values
from turning_control.watch import LAGS, STUCK_INTERVALS, STUCK_TIME

from shop.tests.turning_control.closed_loop import ClosedLoop
from tests.soundness.acting import tried
from turning_env import Scenario


def with_speed() -> Scenario:
    """Return a scenario whose policy sets the cutting speed, too, at a control's interval."""
    scenario = Scenario.load("rough_turning")
    control = scenario.control.model_copy(update={"interval": 0.05})
    return scenario.model_copy(update={"control": control})


SCENARIOS = {
    "override": Scenario.load("override"),
    "current": Scenario.load("override_current"),
    "speed": with_speed(),
}
NUMBERS = ("spindle_speed", "feed_velocity", "engaged_time", "power", "force", "position")
NAMES = (*NUMBERS, *SWITCHES)
BAD = (math.nan, math.inf, -math.inf, 1e30, -1e30, -500.0)
names = st.sampled_from(NAMES)
groups = st.lists(names, min_size=1, max_size=3, unique=True)

Fault = Callable[[Readings], Readings]


class Lathe(RuleBasedStateMachine):
    """A lathe whose readings suffer faults in any order."""

    @initialize(
        kind=st.sampled_from(sorted(SCENARIOS)),
        seed=st.integers(0, 20),
        place=st.sampled_from((-0.02, 0.15, 0.38, 0.58, 0.78, 0.97)),
    )
    def start(self, kind: str, seed: int, place: float) -> None:
        scenario = SCENARIOS[kind]
        self.loop = ClosedLoop(scenario, seed, start=place * scenario.workpiece.bar_length)
        self.faults: list[Fault] = []
        self.history: list[Readings] = []
        self.spans = possible_values(scenario)
        self.needed = needed_readings(scenario)
        # Intervals in a row over a limit with more than the safe feed, since the faults changed.
        self.over = 0
        machine = scenario.machine
        lag = LAGS * machine.feed_time_constant
        if scenario.control.action != "override":
            lag = LAGS * max(machine.feed_time_constant, machine.spindle_time_constant)
        intervals = max(STUCK_TIME, lag) / scenario.control.interval
        # Until a fault is found, and until the feed has fallen.
        falling = LAGS * machine.feed_time_constant / scenario.control.interval
        self.patience = max(intervals, STUCK_INTERVALS) + falling + 2

    def field(self, name: str) -> str:
        """Return the name of a reading; ``force`` is the one that the scenario uses."""
        is_current = "servo_current" in self.needed
        force = "servo_current" if is_current else "thrust_force"
        return force if name == "force" else name

    def suffer(self, fault: Fault) -> None:
        """Add a fault, and go on turning."""
        self.faults.append(fault)
        self.over = 0
        self.cut(20)

    @rule(group=groups, value=st.sampled_from(BAD))
    def spoil(self, group: list[str], value: float) -> None:
        bad = {self.field(name): value for name in group}
        self.suffer(lambda readings: replace(readings, **bad))

    @rule(group=groups)
    def lose(self, group: list[str]) -> None:
        lost: dict[str, Any] = {}
        for name in group:
            lost[self.field(name)] = None if name in SWITCHES else math.nan
        self.suffer(lambda readings: replace(readings, **lost))

    @rule(group=groups)
    def freeze(self, group: list[str]) -> None:
        frozen: dict[str, Any] = {}

        def keep_first(readings: Readings) -> Readings:
            for name in map(self.field, group):
                frozen.setdefault(name, getattr(readings, name))
            return replace(readings, **frozen)

        self.suffer(keep_first)

    @rule()
    def freeze_all(self) -> None:
        frozen: list[Readings] = []

        def keep_first(readings: Readings) -> Readings:
            frozen.append(readings)
            return frozen[0]

        self.suffer(keep_first)

    @rule(name=st.sampled_from(SWITCHES), value=st.booleans())
    def hold_switch(self, name: str, value: bool) -> None:
        self.suffer(lambda readings: replace(readings, **{name: value}))

    @rule(first=st.sampled_from(NUMBERS), second=st.sampled_from(NUMBERS))
    def swap(self, first: str, second: str) -> None:
        one = self.field(first)
        other = self.field(second)

        def swapped(readings: Readings) -> Readings:
            values = {one: getattr(readings, other), other: getattr(readings, one)}
            return replace(readings, **values)

        self.suffer(swapped)

    @rule(late=st.integers(1, 60), group=st.one_of(st.none(), groups))
    def delay(self, late: int, group: list[str] | None) -> None:
        def delayed(readings: Readings) -> Readings:
            old = self.history[max(len(self.history) - 1 - late, 0)]
            if group is None:
                return old
            return replace(readings, **{n: getattr(old, n) for n in map(self.field, group)})

        self.suffer(delayed)

    @rule(order=st.permutations(range(4)))
    def reorder(self, order: list[int]) -> None:
        def reordered(readings: Readings) -> Readings:
            last = len(self.history) - 1
            return self.history[max(last - order[last % len(order)], 0)]

        self.suffer(reordered)

    @rule(fault_steps=st.integers(1, 50), good_steps=st.integers(1, 3))
    def interrupt(self, fault_steps: int, good_steps: int) -> None:
        """Let good readings come now and then."""
        faults = self.faults
        self.faults = []

        def sometimes(readings: Readings) -> Readings:
            if len(self.history) % (fault_steps + good_steps) < good_steps:
                return readings
            return spoiled(readings, faults)

        self.suffer(sometimes)

    @rule()
    def recover(self) -> None:
        self.faults = []
        self.over = 0

    @rule(steps=st.integers(10, 100))
    def cut(self, steps: int) -> None:
        for _ in range(steps):
            self.step()

    def step(self) -> None:
        """Move for a control interval, and check what the shield commands."""
        loop = self.loop
        given: list[Readings] = []

        def spoil(readings: Readings) -> Readings:
            self.history.append(readings)
            given.append(spoiled(readings, self.faults))
            return given[0]

        commands = loop.step(spoil)
        above = commands.adaptive_feed > loop.safe_feed * (1.0 + 1e-6)
        if self.is_bad(given[0]):
            assert not above, given[0]
        is_over = loop.course.severe[-1] > 0.0 and above
        self.over = self.over + 1 if is_over else 0

    def is_bad(self, readings: Readings) -> bool:
        """Return whether readings alone show that they do not bound the load."""
        for name in SWITCHES:
            if getattr(readings, name) not in (True, False):
                return True
        for name in self.needed:
            value = getattr(readings, name)
            if not self.spans[name].low <= value <= self.spans[name].high:
                return True
        return False

    @invariant()
    def is_never_over_for_long(self) -> None:
        if hasattr(self, "loop"):
            assert self.over <= self.patience, self.loop.commands


def spoiled(readings: Readings, faults: list[Fault]) -> Readings:
    """Return readings with faults."""
    for fault in faults:
        readings = fault(readings)
    return readings


TestLathe = pytest.mark.slow(Lathe.TestCase)
TestLathe.settings = settings(tried(short=3, soak=1_000), stateful_step_count=20)
