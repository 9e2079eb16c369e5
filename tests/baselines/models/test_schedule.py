"""The best use of an edge by forms that are known."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.stats import norm

from baselines.models.schedule import (
    FEEDS,
    HOT_SPOTS,
    LIVES,
    MIN_SPEED,
    SEVERITY,
    SPEEDS,
    Schedule,
    has_forms,
    schedule,
)
from tests.turning_env.playing import changed
from turning_env import Scenario

SHIFT = Scenario.load("shift")
COLLAPSE_TEMPERATURE = 900.0
HOT = changed(SHIFT, edge_failure={"collapse_temperature": COLLAPSE_TEMPERATURE})


def test_scenarios_with_edge_failure_have_forms() -> None:
    assert has_forms(HOT)
    assert not has_forms(SHIFT)


def test_edges_are_kept_from_collapse() -> None:
    plan = schedule(HOT)
    depth = HOT.workpiece.depth_of_cut
    used_life = (np.arange(LIVES) + 1.0) / LIVES
    wear = HOT.tool.wear_criterion * used_life**HOT.material.wear.time
    law = HOT.edge_failure.temperature
    temperature = law(plan.cutting_speed, plan.feed, depth, wear=wear)
    assert temperature[used_life <= plan.change_at].max() < COLLAPSE_TEMPERATURE


def test_where_edges_collapse_they_cut_more_slowly_and_time_is_worth_less() -> None:
    plan = schedule(HOT)
    without = schedule(SHIFT)
    last = int(LIVES * plan.change_at) - 1
    assert plan.cutting_speed[last] < without.cutting_speed[last]
    assert plan.time < without.time


def test_edges_that_notch_are_changed_before_they_break() -> None:
    notched = changed(SHIFT, edge_failure={"notch_growth": 2.0})
    assert 0.2 < schedule(notched).change_at < 0.5
    assert schedule(SHIFT).change_at > 0.5


SIMPLE = changed(
    SHIFT,
    material={
        "wear": {
            "coefficient": 0.006,
            "cutting_speed": 0.75,
            "feed": 0.5,
            "depth_of_cut": 0.5,
            "time": 0.25,
        },
        "thrust_force": {
            "coefficient": 1400.0,
            "cutting_speed": -0.1,
            "feed": 0.5,
            "depth_of_cut": 0.8,
            "wear": 0.4,
            "hardness": 0.6,
        },
        "power": {
            "coefficient": 0.06,
            "cutting_speed": 1.0,
            "feed": 0.75,
            "depth_of_cut": 1.0,
            "wear": 0.3,
            "hardness": 0.4,
        },
    },
    tool={"wear_criterion": 0.4, "edge_strength": 900.0, "edge_strength_spread": 0.12},
    limits={"thrust_force": 300.0, "power": 6.0},
    machine={"cutting_speed_min": 60.0, "cutting_speed_max": 400.0},
    spindle={"base_speed": 500.0, "idle_torque": 10.0},
    workpiece={
        "diameter": 100.0,
        "depth_of_cut": 2.0,
        "depth_bar_spread": 0.3,
        "depth_along_spread": 0.4,
        "hardness_bar_spread": 0.05,
        "hardness_along_spread": 0.12,
    },
    economics={
        "reference_removal_rate": 100.0,
        "edge_cost": 3.0,
        "edge_change_time": 2.0,
        "breakage_downtime": 7.0,
        "unplanned_stop": 1.5,
        "overload_price": 5.0,
    },
)
FORMS = {
    "laws alone": {},
    "tertiary wear": {"tertiary_rate": 12.0, "tertiary_wear": 0.25},
    "running in": {"running_in": 1.5, "running_in_wear": 0.1},
    "built-up edge": {"built_up_edge": 4.0, "built_up_speed": 150.0, "built_up_width": 0.3},
    "chipping": {
        "chipping_rate": 3.0,
        "chipping_load_exponent": 2.0,
        "chipping_wear_exponent": 1.5,
    },
    "collapse": {"collapse_temperature": 1200.0},
    "notches": {"notch_growth": 1.6},
}


def spread_of(law: Any) -> float:
    """Return the standard deviation of a log response over bars.

    The depth has 3 and 4 tenths of 2 mm, 25 %, the hardness 5 and 12 %: 13 %.
    """
    return math.hypot(0.25 * law.depth_of_cut, 0.13 * law.hardness)


class Steps(NamedTuple):
    """Each step of life at each set point; arrays of shape (LIVES, SPEEDS, FEEDS)."""

    gain: Any  # [s]
    time: Any  # [s]
    survival: Any  # [-]


def set_points_of(scenario: Scenario) -> tuple[Any, Any]:
    """Return the speeds, as a column, and the feeds that are compared."""
    machine = scenario.machine
    speeds = np.geomspace(1.5 * 60.0, 400.0, SPEEDS)[:, np.newaxis]
    return speeds, np.geomspace(machine.feed_min, machine.feed_max, FEEDS)


def bell(speed: Any, height: float, centre: float, width: float) -> Any:
    return height * np.exp(-((np.log(speed / centre) / width) ** 2))


def wear_at(life: float) -> float:
    return 0.4 * life**0.25


def force_at(scenario: Scenario, life: float) -> Any:
    """Return the thrust force [N], with that of chatter: pi * 100 mm a turn."""
    speed, feed = set_points_of(scenario)
    machine = scenario.machine
    centre = machine.chatter_speed * math.pi * 0.1
    dynamic = 1.0 + bell(speed, machine.chatter, centre, width=machine.chatter_width)
    return scenario.material.thrust_force(speed, feed, 2.0, wear=wear_at(life)) * dynamic


def stronger(scenario: Scenario, life: float) -> Any:
    """Return the chance that an edge is stronger than force and notch."""
    strength = scenario.tool.edge_strength
    force_spread = spread_of(scenario.material.thrust_force)
    by_force = np.log(strength / force_at(scenario, life)) / math.hypot(force_spread, 0.12)
    notch = max(scenario.edge_failure.notch_growth * life, 1e-9)
    return norm.cdf(by_force) * norm.cdf(-math.log(notch) / 0.12) + 1e-9


def minutes_of(scenario: Scenario, wear: float) -> Any:
    """Return the time of a step of life [min]."""
    speed, feed = set_points_of(scenario)
    failure = scenario.edge_failure
    rate = (scenario.material.wear(speed, feed, 2.0) / 0.4) ** 4
    rate = rate * (
        1.0
        + bell(speed, failure.built_up_edge, failure.built_up_speed, width=failure.built_up_width)
    )
    rate = rate * math.exp(failure.tertiary_rate * max(wear - failure.tertiary_wear, 0.0))
    rate = rate * (1.0 + failure.running_in * math.exp(-wear / failure.running_in_wear))
    return 1.0 / (LIVES * rate)


def value_of(scenario: Scenario, middle: float) -> Any:
    """Return the value of metal less overload [s per s], half a deviation above the expected."""
    speed, feed = set_points_of(scenario)
    material = scenario.material
    force = force_at(scenario, middle) * math.exp(0.5 * spread_of(material.thrust_force))
    power = material.power(speed, feed, 2.0, wear=wear_at(middle))
    power = power + 10.0 * speed * 2.0 / 60.0 / 100.0  # [kW] of 10 N m
    power = power / np.minimum(speed / (500.0 * math.pi * 0.1), 1.0)
    power = power * math.exp(0.5 * spread_of(material.power))
    over = np.maximum(force / 300.0 - 1.0, 0.0) + np.maximum(power / 6.0 - 1.0, 0.0)
    return speed * feed * 2.0 / 100.0 - 1.2 * 5.0 * over


def hazard_of(scenario: Scenario, middle: float, end: float) -> Any:
    """Return the rate of chipping and collapse [1/min]."""
    speed, feed = set_points_of(scenario)
    failure = scenario.edge_failure
    force_spread = spread_of(scenario.material.thrust_force)
    load = np.log(force_at(scenario, middle) / scenario.tool.edge_strength) + 0.5 * force_spread**2
    hazard = failure.chipping_rate * np.exp(failure.chipping_load_exponent * load)
    hazard = hazard * (wear_at(middle) / 0.4) ** failure.chipping_wear_exponent
    if failure.collapse_temperature:
        temperature = failure.temperature(speed, feed, 2.0, wear=wear_at(end))
        hotter = np.log(temperature / failure.collapse_temperature)
        spread = 2.0 * spread_of(failure.temperature) + 1e-3
        hazard = hazard + np.where(hotter > spread, np.inf, 3.0 * norm.cdf(hotter / spread))
    return hazard


def life_steps(scenario: Scenario) -> Steps:
    """Return all steps of life by the equations of docs/models.md and of the module."""
    shape = (LIVES, SPEEDS, FEEDS)
    steps = Steps(np.empty(shape), np.empty(shape), np.empty(shape))
    for k in range(LIVES):
        start = max(k / LIVES, 1e-9)
        end = (k + 1.0) / LIVES
        middle = (k + 0.5) / LIVES
        minutes = minutes_of(scenario, wear_at(middle))
        chance = np.minimum(stronger(scenario, end) / stronger(scenario, start), 1.0)
        steps.gain[k] = 60.0 * value_of(scenario, middle) * minutes
        steps.time[k] = 60.0 * minutes
        steps.survival[k] = np.exp(-hazard_of(scenario, middle, end) * minutes) * chance
    return steps


def worths(
    steps: Steps, price: float, change_at: int, unplanned_stop: float = 1.5
) -> tuple[Any, list[int]]:
    """Return the worth of an edge that is changed at a step of life [s], and its set points."""
    gain, time, survival = steps
    edge = 180.0
    worth = -60.0 * price * 2.0 - edge * (1.0 - change_at / LIVES)
    if change_at == LIVES:
        worth = -60.0 * price * (2.0 + unplanned_stop)
    set_points = []
    for k in range(change_at - 1, -1, -1):
        broken = -edge * (1.0 - (k + 1.0) / LIVES) - 60.0 * price * 9.0
        expected = gain[k] - price * time[k] - edge / LIVES
        expected = expected + survival[k] * worth + (1.0 - survival[k]) * broken
        set_points.append(int(expected.argmax()))
        worth = float(expected.max())
    return worth, set_points[::-1]


@pytest.mark.parametrize("form", FORMS)
def test_a_schedule_is_the_best_by_brute_force(form: str) -> None:
    """All steps of life at which the edge may be changed are tried."""
    scenario = changed(SIMPLE, edge_failure=FORMS[form])
    plan = schedule(scenario)
    steps = life_steps(scenario)
    values = [worths(steps, plan.time, change)[0] for change in range(1, LIVES + 1)]
    best = int(np.argmax(values)) + 1
    # At the price of time, the best use of an edge is worth nothing.
    assert values[best - 1] == pytest.approx(0.0, abs=0.01)
    assert plan.change_at == pytest.approx(best / LIVES)
    _, set_points = worths(steps, plan.time, best)
    speed_index, feed_index = np.divmod(set_points, FEEDS)
    speeds, feeds = set_points_of(scenario)
    assert plan.cutting_speed[:best] == pytest.approx(speeds[speed_index, 0])
    assert plan.feed[:best] == pytest.approx(feeds[feed_index])
    # The best speed lies between the lowest and the highest.
    assert 0 < speed_index[0] < SPEEDS - 1


@pytest.mark.parametrize(
    ("unplanned_stop", "last"),
    [
        pytest.param(0.0, LIVES, id="it stops nothing else"),
        # The last step gains 0.6 s more, or 0.2 s less, than the stop costs.
        pytest.param(0.055, LIVES, id="the stop just pays"),
        pytest.param(0.065, LIVES - 1, id="it just does not"),
    ],
)
def test_an_edge_is_used_up_if_its_end_stops_the_lathe_for_little(
    unplanned_stop: float, last: int
) -> None:
    scenario = changed(SIMPLE, economics={"unplanned_stop": unplanned_stop})
    plan = schedule(scenario)
    steps = life_steps(scenario)
    values = {}
    for change in (LIVES - 1, LIVES):
        values[change], _ = worths(steps, plan.time, change, unplanned_stop=unplanned_stop)
    assert max(values, key=lambda change: values[change]) == last
    assert plan.change_at == last / LIVES
    assert values[last] == pytest.approx(0.0, abs=0.01)
    assert abs(values[LIVES] - values[LIVES - 1]) > 0.1


def test_a_schedule_spares_weak_edges() -> None:
    """At 450 N instead of 900 N, the force breaks edges below its limit, too."""
    weak = changed(SIMPLE, tool={"edge_strength": 450.0})
    plan = schedule(weak)
    steps = life_steps(weak)
    values = [worths(steps, plan.time, change)[0] for change in range(1, LIVES + 1)]
    assert max(values) == pytest.approx(0.0, abs=0.01)
    assert plan.time < schedule(SIMPLE).time - 0.01


@pytest.mark.parametrize("edge_strength", [900.0, 450.0])
def test_a_schedule_knows_chatter(edge_strength: float) -> None:
    """Chatter exceeds the limit of force, and breaks weaker edges."""
    chatter = {"chatter": 0.8, "chatter_speed": 800.0, "chatter_width": 0.2}
    still = changed(SIMPLE, tool={"edge_strength": edge_strength})
    scenario = changed(still, machine=chatter)
    plan = schedule(scenario)
    steps = life_steps(scenario)
    values = [worths(steps, plan.time, change)[0] for change in range(1, LIVES + 1)]
    assert max(values) == pytest.approx(0.0, abs=0.01)
    assert plan.time < schedule(still).time


def test_where_all_edges_are_as_strong_they_are_changed_before_the_notch_breaks_them() -> None:
    """A notch of 2 D breaks an edge at half of its life: in step 20 of 40."""
    notched = changed(
        SIMPLE, tool={"edge_strength_spread": 0.0}, edge_failure={"notch_growth": 2.0}
    )
    assert schedule(notched).change_at == pytest.approx(19.0 / LIVES)


def test_the_price_of_time_is_at_most_five() -> None:
    rich = changed(SIMPLE, economics={"reference_removal_rate": 5.0})
    assert schedule(rich).time == pytest.approx(5.0, abs=1e-5)


def test_the_constants_of_the_plan() -> None:
    assert (MIN_SPEED, SEVERITY, HOT_SPOTS) == (1.5, 1.2, 3.0)
    assert Schedule._fields == ("cutting_speed", "feed", "change_at", "time")


@pytest.mark.parametrize(
    ("sections", "has"),
    [
        ({}, False),
        ({"edge_failure": {"notch_growth": 1.0}}, True),
        ({"machine": {"chatter": 0.1}}, True),
        ({"machine": {"chatter": 0.1}, "control": {"edge_changes": "automatic"}}, False),
        (
            {"edge_failure": {"notch_growth": 1.0}, "control": {"edge_changes": "automatic"}},
            False,
        ),
    ],
)
def test_forms_count_where_edges_are_changed_on_command(
    sections: dict[str, dict[str, Any]], has: bool
) -> None:
    assert has_forms(changed(SHIFT, **sections)) == has
