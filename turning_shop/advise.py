"""Advise speed and feed for a scenario, in parts, minutes and money.

Recommendations are nominal: limits are kept with a worn edge, at nominal depth and hardness. ``advise_play.py`` plays them.
"""

import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from turning_env.scenario import Scenario
from turning_shop import Values, WorkshopError, aligned
from turning_shop.prediction import LEVEL, Evidence, predict
from turning_shop.whatif import Cuts, what_if

GRID = 81
"""Number of cutting speeds, and of feeds, that are tried."""
SLICES = 6
"""Number of sections of the edge's life in a schedule."""
UNATTENDED_SHARE = 0.8
"""Share of the highest removal rate that the longest unattended run keeps [-]."""
AIMS = ("most metal", "least cost", "longest run")
"""Aims of recommendations; ``longest run`` is the longest time between changes of edge."""


class Prices(NamedTuple):
    """Prices of machining.

    Attributes:
        unit: Currency; "min" of machine time if no hourly rate is known.
        minute, edge: Price of a minute of machine and operator, and of an edge.
        change_time: Time to change an edge [min].
    """

    unit: str
    minute: float
    edge: float
    change_time: float

    @classmethod
    def of(cls, scenario: Scenario) -> "Prices":
        """Return the prices of a scenario."""
        economics = scenario.economics
        minute = (economics.machine_rate + economics.operator_rate) / 60.0
        unit = economics.currency if minute else "min"
        minute = minute or 1.0
        edge = economics.insert_price / economics.edges_per_insert if economics.insert_price else economics.edge_cost * minute
        if economics.insert_price and unit == "min":
            raise WorkshopError("economics.insert_price is money, but economics.machine_rate is 0: set the machine's hourly rate")
        return cls(unit, minute, edge, economics.edge_change_time)


class Step(NamedTuple):
    """Speed and feed from one wear of the edge to another.

    Attributes:
        wear: Flank wear at the end [mm].
        cutting_speed, feed: [m/min], [mm/rev].
        minutes: Cutting time from the beginning of the step to its end [min].
    """

    wear: float
    cutting_speed: float
    feed: float
    minutes: float


class Advice(NamedTuple):
    """A recommendation: fixed parameters, or a schedule over the edge's life.

    Attributes:
        aim: One of ``AIMS``.
        steps: One for fixed parameters.
        life: Cutting time of an edge and its 95 % interval [min].
        part_time: Cutting time of a part [min].
        cycle_time: Time from part to part, without edge changes [min].
        parts: Parts per edge and their 95 % interval.
        removal_rate: Metal per minute, edge changes included [cm3/min].
        cost: Cost of a part, edges included.
        extrapolated: Whether the laws are used beyond what was measured.
    """

    aim: str
    steps: tuple[Step, ...]
    life: tuple[float, float, float]
    part_time: float
    cycle_time: float
    parts: tuple[float, float, float]
    removal_rate: float
    cost: float
    extrapolated: bool

    @property
    def change_after(self) -> int:
        """Number of parts after which to change the edge; nearly all edges last as long."""
        return int(self.parts[1])


def advise(scenario: Scenario, evidence: Evidence) -> list[Advice]:
    """Return fixed parameters and a schedule for each aim, in this order.

    Raises:
        WorkshopError: No speed and feed keep the limits with a worn edge, or the scenario is not one of plain bars.
    """
    if scenario.control.action == "part":
        raise WorkshopError('control.action is "part": advise covers bars at one depth, not whole parts of several passes')
    machine = scenario.machine
    speeds = np.geomspace(machine.cutting_speed_min, machine.cutting_speed_max, GRID)
    feeds = np.geomspace(machine.feed_min, machine.feed_max, GRID)
    if scenario.control.action == "override":
        speeds = np.array([scenario.control.initial_cutting_speed])
    wears = scenario.tool.wear_criterion * np.arange(1, SLICES + 1) / SLICES
    speeds, feeds = (values.ravel() for values in np.meshgrid(speeds, feeds))
    cuts = what_if(scenario, speeds, feeds, wear=wears[:, np.newaxis])  # a row per section of the edge's life, at its end
    possible = np.atleast_1d(cuts.within_limits.any(axis=1))
    if not possible[-1]:
        raise WorkshopError(
            f"no speed and feed keep limits.thrust_force, {scenario.limits.thrust_force:g} N, and limits.power, "
            f"{scenario.limits.power:g} kW, with an edge worn to {wears[-1]:g} mm: reduce workpiece.depth_of_cut"
        )
    found = []
    for aim, scheduled in itertools.product(AIMS, (False, True)):
        # An edge may be changed before it is worn out, because a fresher one cuts faster.
        ends = [SLICES] if aim == "longest run" else np.flatnonzero(possible) + 1
        plans = [_best(scenario, evidence, aim, _at(cuts, slice(0 if scheduled else end - 1, end))) for end in ends]
        found.append(min(plans, key=lambda each: each.cost if aim == "least cost" else -each.removal_rate))
    return found


def _at(cuts: Cuts, index: Any) -> Cuts:
    return Cuts(*(values[index] for values in cuts))


def _best(scenario: Scenario, evidence: Evidence, aim: str, cuts: Cuts) -> Advice:
    """Return the best settings for each section of the edge's life, at whose end its limits are kept.

    The aim is a ratio, cost over volume or time over volume. Its least value k makes the least of cost - k volume zero
    (Dinkelbach 1967), and at given k each section of the life is optimised by itself.

    ``cuts`` have the shape (sections, settings).
    """
    prices, sections = Prices.of(scenario), np.arange(len(cuts.time))
    minute, edge = (prices.minute, prices.edge) if aim == "least cost" else (1.0, 0.0)
    # Wear is the same function of a time at each setting, so sections are differences of such times.
    times = np.diff(cuts.time, axis=0, prepend=0.0)
    if aim == "longest run":
        rates = np.where(cuts.within_limits, cuts.removal_rate, 0.0)
        fast = cuts.within_limits & (rates >= UNATTENDED_SHARE * rates.max(axis=1, keepdims=True))
        choice = np.where(fast, times, -1.0).argmax(axis=1)
    else:
        cost = minute * times * (1.0 + _idle(scenario, cuts) / _part_time(scenario, cuts))
        metal = times * cuts.removal_rate
        price = 0.0
        for _ in range(60):
            choice = np.where(cuts.within_limits, cost - price * metal, np.inf).argmin(axis=1)
            spent = edge + minute * prices.change_time + cost[sections, choice].sum()
            price = spent / metal[sections, choice].sum()
    return plan(scenario, evidence, aim, _at(cuts, (sections, choice)), times[sections, choice])


def plan(scenario: Scenario, evidence: Evidence, aim: str, cuts: Cuts, minutes: Values) -> Advice:
    """Return the recommendation that follows from chosen settings.

    Args:
        scenario: The machine, material, limits and prices.
        evidence: Evidence for the laws.
        aim: One of ``AIMS``.
        cuts: The cut in each section of the edge's life, at the wear at its end, shape (sections,).
        minutes: Cutting time of each section [min], shape (sections,).
    """
    prices = Prices.of(scenario)
    parts_of_section = minutes / _part_time(scenario, cuts)
    life, parts = float(minutes.sum()), float(parts_of_section.sum())
    # Edges differ at least as much as the scenario says, even if no edges were named in the sheet.
    half, prediction = life_spread(scenario), predict(scenario, evidence, cuts, of_wear=True)
    if "wear" in evidence.laws:
        half = max(half, float(np.log(prediction.high["tool_life"] / cuts.tool_life).max()))
    low, high = float(np.exp(-half)), float(np.exp(half))
    cycle = (life + float(parts_of_section @ _idle(scenario, cuts))) / parts
    with_change = cycle + prices.change_time / parts
    columns = (cuts.wear, cuts.cutting_speed, cuts.feed, minutes)
    return Advice(
        aim=aim,
        steps=tuple(Step(*row) for row in np.column_stack(columns).tolist()),
        life=(life, life * low, life * high),
        part_time=life / parts,
        cycle_time=cycle,
        parts=(parts, parts * low, parts * high),
        removal_rate=part_volume(scenario) / with_change,
        cost=prices.minute * with_change + prices.edge / parts,
        extrapolated=bool(prediction.extrapolated.any()),
    )


def life_spread(scenario: Scenario) -> float:
    """Return half the 95 % interval of an edge's life, in its logarithm, by the spread of edges that the scenario states [-]."""
    return float(stats.norm.ppf(0.5 + 0.5 * LEVEL)) * scenario.tool.wear_factor_spread / scenario.material.wear.time


def part_volume(scenario: Scenario) -> float:
    """Return the metal cut from a part [cm3]."""
    work = scenario.workpiece
    return float(np.pi * work.diameter * work.depth_of_cut * work.bar_length / 1000.0)


def _part_time(scenario: Scenario, cuts: Cuts) -> Values:
    """Return the cutting time of a part [min]: its length over the feed velocity."""
    return np.asarray(scenario.workpiece.bar_length / (cuts.feed * cuts.spindle_speed))


def _idle(scenario: Scenario, cuts: Cuts) -> Values:
    """Return the time of a part without cutting [min]: the return, and the path in air before the bar."""
    return np.asarray(scenario.machine.return_time + scenario.workpiece.approach / (cuts.feed * cuts.spindle_speed))


def summary(scenario: Scenario, found: list[Advice]) -> Iterator[str]:
    """Yield lines of text."""
    prices, work, unit = Prices.of(scenario), scenario.workpiece, Prices.of(scenario).unit
    bars = f"bars of {work.diameter:g} mm, {work.bar_length:g} mm long, {work.depth_of_cut:g} mm deep"
    yield f"{scenario.name}: {bars}; edges worn out at {scenario.tool.wear_criterion:g} mm"
    change = f"a change takes {prices.change_time:g} min"
    yield f"a minute costs {prices.minute:.3g} {unit}, an edge {prices.edge:.3g} {unit}; {change}"
    yield ""
    yield from aligned([
        ("", "speed", "feed", "tool life", "parts per edge", "change after", "at wear", "cycle", "MRR", "cost per part"),
        ("", "m/min", "mm/rev", "min", "", "parts", "mm", "min", "cm3/min", unit),
        *(
            (
                f"{each.aim}, {'fixed' if len(each.steps) == 1 else 'schedule'}",
                _span([step.cutting_speed for step in each.steps], ".0f"),
                _span([step.feed for step in each.steps], ".3f"),
                "{:.1f} ({:.1f}-{:.1f})".format(*each.life),
                "{:.1f} ({:.1f}-{:.1f})".format(*each.parts),
                str(each.change_after),
                f"{each.steps[-1].wear:.2f}",
                f"{each.cycle_time:.2f}",
                f"{each.removal_rate:.1f}",
                f"{each.cost:.3f}" + " *" * each.extrapolated,
            )
            for each in found
        ),
    ])  # fmt: skip
    for each in found:
        if len(each.steps) > 1:
            yield ""
            yield f"schedule for {each.aim}: cutting time of the edge, speed, feed, wear at the end"
            begun = 0.0
            for step in each.steps:
                times = f"{begun:6.1f} to {begun + step.minutes:6.1f} min"
                yield f"  {times}  {step.cutting_speed:6.0f} m/min  {step.feed:.3f} mm/rev  {step.wear:.3f} mm"
                begun += step.minutes
    if any(each.extrapolated for each in found):
        yield "* extrapolated: a setting lies outside what was measured"


def _span(values: list[float], form: str) -> str:
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low}-{high}"
