"""What each reading may be: a lost or impossible one gives the safe feed, alone and in a loop."""

import math
from dataclasses import fields, replace
from typing import Any

import pytest
from turning_control.core import Controller, Status, on_control
from turning_control.readings import SWITCHES, Readings, needed_readings, possible_values

from shop.tests.turning_control.closed_loop import Always, ClosedLoop
from turning_env import Scenario
from turning_env.observation import read

BAD = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf, "1e30": 1e30, "negative": -500.0}
NAMES = [field.name for field in fields(Readings)]
# Before a section of triple depth, where the highest feed is far too high [mm].
BEFORE_DEEP = 39.0


def with_all_sensors() -> Scenario:
    """Return a scenario that needs the spindle's heat and the wear of removed edges, too."""
    scenario = Scenario.load("override")
    spindle = scenario.spindle.model_copy(update={"short_time_load": 1.2})
    sensors = scenario.sensors.model_copy(update={"inspects_edges": True})
    return scenario.model_copy(update={"spindle": spindle, "sensors": sensors})


SCENARIOS = {
    "all": with_all_sensors(),
    "current": Scenario.load("override_current"),
    "surface": Scenario.load("surface"),
}


def used(scenario: Scenario) -> list[str]:
    """Return the names of the readings that a scenario uses."""
    return [*needed_readings(scenario), *SWITCHES, "position"]


@pytest.mark.parametrize("kind", SCENARIOS)
@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("name", NAMES)
def test_a_bad_reading_gives_the_safe_feed_and_harms_no_later_one(
    name: str, bad: str, kind: str
) -> None:
    scenario = SCENARIOS[kind]
    value = BAD[bad]
    loop = ClosedLoop(scenario, start=20.0)
    for _ in range(3):
        before = loop.step()
    spoiled = loop.step(lambda readings: replace(readings, **{name: value}))
    after = loop.step()
    assert before.status in (Status.POLICY, Status.SHIELD)
    if name in used(scenario):
        assert spoiled.status == Status.SAFE
        assert spoiled.adaptive_feed <= loop.safe_feed
        assert name in spoiled.reason
    assert after.status in (Status.POLICY, Status.SHIELD)
    assert math.isfinite(loop.controller.observation.sum())


@pytest.mark.slow
@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("name", used(SCENARIOS["all"]))
def test_a_bad_reading_in_a_closed_loop_never_frees_the_feed(name: str, bad: str) -> None:
    value = BAD[bad]
    loop = ClosedLoop(SCENARIOS["all"], start=BEFORE_DEEP)
    loop.step()
    for _ in range(200):
        commands = loop.step(lambda readings: replace(readings, **{name: value}))
        assert commands.adaptive_feed <= loop.safe_feed
    assert loop.course.severe_share() == 0.0


def test_a_position_that_was_never_given_is_not_missed() -> None:
    loop = ClosedLoop(Scenario.load("override"), start=20.0)
    for _ in range(10):
        commands = loop.step(lambda readings: replace(readings, position=math.nan))
    assert commands.status in (Status.POLICY, Status.SHIELD)


def test_the_time_of_an_edge_runs_on_while_it_is_not_known() -> None:
    scenario = on_control(Scenario.load("override"))
    controller = Controller(scenario, lambda num_envs: Always(scenario, 1.0))
    loop = ClosedLoop(Scenario.load("override"), start=20.0)
    true = loop.controller
    seen: list[Readings] = []

    def keep(readings: Readings) -> Readings:
        seen.append(readings)
        return readings

    for _ in range(20):
        loop.step(keep)
    for readings in seen:
        controller.decide(replace(readings, engaged_time=math.nan))
    expected = read(true.observation, scenario).cutting_time
    assert read(controller.observation, scenario).cutting_time == pytest.approx(expected, rel=0.1)


def test_no_value_of_a_machine_within_its_ranges_is_impossible() -> None:
    scenario = Scenario.load("override")
    spans = possible_values(scenario)
    turns = 1000.0 * scenario.machine.cutting_speed_max / (math.pi * 60.0)
    values: dict[str, Any] = {
        "spindle_speed": [0.0, turns],
        "feed_velocity": [0.0, turns * scenario.machine.feed_max],
        "power": [0.0, scenario.machine.rated_power],
        "thrust_force": [0.0, scenario.tool.edge_strength],
        "position": [-scenario.workpiece.approach, scenario.workpiece.bar_length],
    }
    for name, ends in values.items():
        for value in ends:
            assert spans[name].low <= value <= spans[name].high
