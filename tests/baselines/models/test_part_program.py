"""Programs, their overrides, and the rules that act on them."""

import math
from typing import Any

import numpy as np
import pytest

from baselines.models.part_program import (
    PROGRAM,
    SPEED_AND_TARGET,
    OverrideLaw,
    PartProgram,
    on_override,
    on_program,
    on_speed_and_feed,
    override_rules,
    target_load,
)
from baselines.rule import TuningRange
from tests.turning_env.playing import changed
from turning_env import RoughTurningVectorEnv, Scenario, read

OVERRIDE = changed(
    "override",
    control={"initial_cutting_speed": 150.0, "initial_feed": 0.3, "override_max": 1.5},
    machine={
        "cutting_speed_min": 50.0,
        "cutting_speed_max": 300.0,
        "feed_min": 0.06,
        "feed_max": 0.45,
    },
)
SET_POINT = Scenario.load("paper")


def reading_of(scenario: Scenario, commanded_feed: list[float]) -> Any:
    """Return a first reading of environments, with other commanded feeds [mm/rev]."""
    env = RoughTurningVectorEnv(len(commanded_feed), scenario)
    observations, _ = env.reset(seed=0)
    return read(observations, scenario)._replace(commanded_feed=np.array(commanded_feed))


@pytest.mark.parametrize(
    ("parameters", "speed", "feed"),
    [
        pytest.param({}, 150.0, 0.3, id="the task's"),
        pytest.param({"cutting_speed": 120.0}, 120.0, 0.3, id="own speed"),
        pytest.param({"feed": 0.2}, 150.0, 0.2, id="own feed"),
        pytest.param({"cutting_speed": 10.0, "feed": 0.01}, 50.0, 0.06, id="lowest"),
        pytest.param({"cutting_speed": 900.0, "feed": 0.9}, 300.0, 0.45, id="highest"),
    ],
)
def test_a_program_lies_within_the_machines_range(
    parameters: dict[str, float], speed: float, feed: float
) -> None:
    program = PartProgram(OVERRIDE, parameters)
    assert (program.cutting_speed, program.feed) == (speed, feed)
    assert program.override_max == 1.5


def test_a_program_asks_for_no_speed_that_the_spindle_does_not_reach() -> None:
    """At 600 rev/min a bar of 100 mm moves at 60 pi m/min, less than the machine's 300."""
    slow = changed(OVERRIDE, workpiece={"diameter": 100.0}, spindle={"max_speed": 600.0})
    program = PartProgram(slow, {"cutting_speed": 250.0})
    assert program.cutting_speed == pytest.approx(60.0 * math.pi)


def test_the_commanded_override_is_the_share_of_the_programmed_feed() -> None:
    program = PartProgram(OVERRIDE, {"feed": 0.2})
    reading = reading_of(OVERRIDE, [0.1, 0.2, 0.3, 0.9, -0.1])
    assert program.override(reading) == pytest.approx([0.5, 1.0, 1.5, 1.5, 0.0])


def test_an_override_commands_its_share_of_the_programmed_feed() -> None:
    """An action of the task is linear in the override of its own program, 0 to 1.5 at 0.3."""
    reading = reading_of(OVERRIDE, [0.3] * 5)
    actions = PartProgram(OVERRIDE, {}).act(reading, np.array([0.5, 1.0, 1.2, 9.0, 0.1]))
    overrides = 0.75 * (actions[:, 0] + 1.0)
    # At least 0.06 mm/rev, at most 0.45.
    assert overrides == pytest.approx([0.5, 1.0, 1.2, 1.5, 0.2], rel=1e-6)
    # A slower program: 1.2 times 0.2 mm/rev are 0.8 of the task's 0.3.
    slow = PartProgram(OVERRIDE, {"feed": 0.2})
    actions = slow.act(reading, np.array([0.5, 1.0, 1.2, 9.0, -9.0]))
    overrides = 0.75 * (actions[:, 0] + 1.0)
    assert overrides == pytest.approx([1.0 / 3.0, 2.0 / 3.0, 0.8, 1.0, 0.2], rel=1e-6)


def test_a_program_commands_its_speed_where_an_action_sets_it() -> None:
    program = PartProgram(SET_POINT, {"cutting_speed": 125.0, "feed": 0.2})
    reading = reading_of(SET_POINT, [0.2, 0.2])
    actions = program.act(reading, np.array([1.0, 1.5]))
    machine = SET_POINT.machine
    speed_range = machine.cutting_speed_max - machine.cutting_speed_min
    feed_range = machine.feed_max - machine.feed_min
    speeds = machine.cutting_speed_min + 0.5 * (actions[:, 0] + 1.0) * speed_range
    feeds = machine.feed_min + 0.5 * (actions[:, 1] + 1.0) * feed_range
    assert speeds == pytest.approx([125.0, 125.0], rel=1e-6)
    assert feeds == pytest.approx([0.2, 0.3], rel=1e-6)


def test_a_law_gets_the_reading_and_the_commanded_override() -> None:
    program = PartProgram(OVERRIDE, {"feed": 0.2})
    env = RoughTurningVectorEnv(2, OVERRIDE)
    observations, _ = env.reset(seed=0)
    seen = []

    def law(reading: Any, override: Any) -> Any:
        seen.append((reading.commanded_feed.copy(), override))
        return np.array([0.5, 1.0])

    actions = OverrideLaw(program, law).act(observations)
    ((commanded_feed, override),) = seen
    assert override == pytest.approx(np.clip(commanded_feed / 0.2, 0.0, 1.5))
    expected = program.act(read(observations, OVERRIDE), np.array([0.5, 1.0]))
    np.testing.assert_array_equal(actions, expected)


def test_a_controller_gets_its_program_and_its_own_parameters() -> None:
    got: list[Any] = []

    def controller(program: PartProgram, num_envs: int, **own: float) -> Any:
        got.append((program.cutting_speed, program.feed, num_envs, own))

    build: Any = on_program(controller)
    build(OVERRIDE, 3, cutting_speed=120.0, feed=0.1, target=0.8)
    build(OVERRIDE, 2, target=0.7)
    assert got == [(120.0, 0.1, 3, {"target": 0.8}), (150.0, 0.3, 2, {"target": 0.7})]


def never(scenario: Scenario) -> bool:
    return False


def controller(program: PartProgram, num_envs: int, **parameters: float) -> Any:
    raise NotImplementedError


@pytest.mark.parametrize(
    ("with_speed", "tuned"), [(PROGRAM, "speed and feed"), (SPEED_AND_TARGET, "speed")]
)
def test_a_controller_of_the_override_makes_two_rules(
    with_speed: dict[str, TuningRange], tuned: str
) -> None:
    own = {"target": TuningRange(0.5, 1.0)}
    rules = override_rules(
        "steady",
        "holds the load",
        controller,
        parameters=own,
        with_speed=with_speed,
        changes_edges=True,
        worth_tuning=True,
    )
    assert list(rules) == ["steady", "steady_with_speed"]
    plain = rules["steady"]
    programmed = rules["steady_with_speed"]
    assert (plain.plays(OVERRIDE), plain.plays(SET_POINT)) == (True, False)
    assert (programmed.plays(OVERRIDE), programmed.plays(SET_POINT)) == (False, True)
    assert (plain.parameters, programmed.parameters) == (own, with_speed)
    assert plain.changes_edges
    assert programmed.changes_edges
    assert (plain.worth_tuning, programmed.worth_tuning) == (True, False)
    assert plain.description == "holds the load"
    assert programmed.description == f"holds the load, with the program's {tuned} tuned"


def test_rules_may_have_a_further_condition_and_leave_edges_by_default() -> None:
    rules = override_rules(
        "odd", "never", controller, parameters={}, with_speed=PROGRAM, plays=never
    )
    for rule in rules.values():
        assert not rule.plays(OVERRIDE)
        assert not rule.plays(SET_POINT)
        assert not rule.changes_edges
        assert not rule.worth_tuning


def test_the_target_is_a_share_of_the_power_limit() -> None:
    scenario = changed(Scenario(), limits={"power": 6.0}, machine={"rated_power": 7.5})
    assert target_load(scenario, 0.5) == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("preset", "override", "speed_and_feed"),
    [("override", True, False), ("surface", False, False), ("paper", False, True)],
)
def test_what_an_action_sets_and_the_aim_decide_on_the_program(
    preset: str, override: bool, speed_and_feed: bool
) -> None:
    scenario = Scenario.load(preset)
    assert on_override(scenario) == override
    assert on_speed_and_feed(scenario) == speed_and_feed
    assert on_override(Scenario.load("surface"), aim="roughness")


def test_the_ranges_of_tuned_programs() -> None:
    assert {
        "cutting_speed": TuningRange(50.0, 200.0),
        "feed": TuningRange(0.06, 0.60, logarithmic=True),
    } == PROGRAM
    expected = {"cutting_speed": PROGRAM["cutting_speed"], "target": TuningRange(0.5, 1.0)}
    assert expected == SPEED_AND_TARGET
