"""Advise speed and feed for a scenario, in parts, minutes and money.

Recommendations are nominal: limits are kept with a worn edge, at nominal depth and hardness. ``advise_play.py`` plays them.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from turning_env.scenario import Scenario
from turning_shop import WorkshopError
from turning_shop.prediction import LEVEL, Evidence, predict
from turning_shop.whatif import Cuts, what_if

Values = NDArray[np.float64]

GRID = 81
"""Number of cutting speeds, and of feeds, that are tried."""
SLICES = 6
"""Number of sections of the edge's life in a schedule."""
UNATTENDED_SHARE = 0.8
"""Share of the highest removal rate that the longest unattended run keeps [-]."""
AIMS = ("most metal", "least cost", "longest run")
"""Aims of recommendations; ``longest run`` is the longest time between changes of edge."""


class Prices(NamedTuple):
    """Prices of machining."""

    unit: str
    """Currency; "min" of machine time if no hourly rate is known."""
    minute: float
    """Price of a minute of machine and operator."""
    edge: float
    """Price of an edge."""
    change_time: float
    """Time to change an edge [min]."""

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
    """Speed and feed from one wear of the edge to another."""

    wear: float
    """Flank wear at the end [mm]."""
    cutting_speed: float
    """[m/min]"""
    feed: float
    """[mm/rev]"""
    minutes: float
    """Cutting time from the beginning of the step to its end [min]."""


class Advice(NamedTuple):
    """A recommendation: fixed parameters, or a schedule over the edge's life."""

    aim: str
    """One of ``AIMS``."""
    steps: tuple[Step, ...]
    """One for fixed parameters."""
    life: tuple[float, float, float]
    """Cutting time of an edge and its 95 % interval [min]."""
    part_time: float
    """Cutting time of a part [min]."""
    cycle_time: float
    """Time from part to part, without edge changes [min]."""
    parts: tuple[float, float, float]
    """Parts per edge and their 95 % interval."""
    removal_rate: float
    """Metal per minute, edge changes included [cm3/min]."""
    cost: float
    """Cost of a part, edges included."""
    extrapolated: bool
    """Whether the laws are used beyond what was measured."""

    @property
    def change_after(self) -> int:
        """Parts after which to change the edge: nearly all edges last as long."""
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
    bounds = scenario.tool.wear_criterion * np.linspace(0.0, 1.0, SLICES + 1)
    tables = [what_if(scenario, speeds, feeds[:, np.newaxis], wear=wear) for wear in bounds[1:]]
    if not tables[-1].within_limits.any():
        raise WorkshopError(
            f"no speed and feed keep limits.thrust_force, {scenario.limits.thrust_force:g} N, and limits.power, "
            f"{scenario.limits.power:g} kW, with an edge worn to {bounds[-1]:g} mm: reduce workpiece.depth_of_cut"
        )
    found = []
    for aim in AIMS:
        for scheduled in (False, True):
            # An edge may be changed before it is worn out, because a fresher one cuts faster.
            ends = [SLICES] if aim == "longest run" else [n for n in range(1, SLICES + 1) if tables[n - 1].within_limits.any()]
            plans = [_best(scenario, evidence, aim, tables[:end] if scheduled else tables[end - 1 : end]) for end in ends]
            found.append(min(plans, key=lambda each: each.cost if aim == "least cost" else -each.removal_rate))
    return found


def _best(scenario: Scenario, evidence: Evidence, aim: str, tables: list[Cuts]) -> Advice:
    """Return the best settings for each section of the edge's life, at whose end its limits are kept.

    The aim is a ratio, cost over volume or time over volume. Its least value k makes the least of cost - k volume zero
    (Dinkelbach 1967), and at given k each section of the life is optimised by itself.
    """
    prices = Prices.of(scenario)
    minute, edge = (prices.minute, prices.edge) if aim == "least cost" else (1.0, 0.0)
    stop = edge + minute * prices.change_time
    start, times = np.zeros_like(tables[0].time), []
    for table in tables:  # wear is the same function of a time at each setting, so sections are differences of such times
        times.append(table.time - start)
        start = table.time
    part = _part_time(scenario, tables[0])
    cost = [minute * time * (1.0 + _idle(scenario, tables[0]) / part) for time in times]
    metal = [time * table.removal_rate for time, table in zip(times, tables, strict=True)]
    allowed = [table.within_limits for table in tables]
    if aim == "longest run":
        rates = [np.where(ok, table.removal_rate, 0.0).max() for ok, table in zip(allowed, tables, strict=True)]
        choice = [
            int(np.where(ok & (table.removal_rate >= UNATTENDED_SHARE * rate), time, -1.0).argmax())
            for ok, table, rate, time in zip(allowed, tables, rates, times, strict=True)
        ]
    else:
        price = 0.0
        for _ in range(60):
            choice = [int(np.where(ok, c - price * m, np.inf).argmin()) for ok, c, m in zip(allowed, cost, metal, strict=True)]
            spent = stop + sum(float(c.flat[i]) for c, i in zip(cost, choice, strict=True))
            price = spent / sum(float(m.flat[i]) for m, i in zip(metal, choice, strict=True))
    return plan(scenario, evidence, prices, aim, tables, choice, times)


def plan(
    scenario: Scenario, evidence: Evidence, prices: Prices, aim: str, tables: list[Cuts], choice: list[int], times: list[Values]
) -> Advice:
    """Return what follows from the chosen settings.

    Args:
        scenario: The machine, material and limits.
        evidence: What is known of the laws.
        prices: Prices of machining.
        aim: One of ``AIMS``.
        tables: The cuts that are possible in each section of the edge's life, at the wear at its end.
        choice: Index of the chosen cut in each table.
        times: Cutting time of each cut in its section [min].
    """
    part = _part_time(scenario, tables[0])
    minutes = [float(time.flat[index]) for time, index in zip(times, choice, strict=True)]
    life = sum(minutes)
    parts = sum(time / float(part.flat[index]) for time, index in zip(minutes, choice, strict=True))
    # Edges differ at least as much as the scenario says, even if no edges were named in the sheet.
    half, extrapolated = life_spread(scenario), False
    for table, index in zip(tables, choice, strict=True):
        cut = Cuts(*(values.ravel()[index : index + 1] for values in table))
        prediction = predict(scenario, evidence, cut, of_wear=True)
        extrapolated = extrapolated or bool(prediction.extrapolated[0])
        if "wear" in evidence.laws:
            half = max(half, float(np.log(prediction.high["tool_life"][0] / cut.tool_life[0])))
    low, high = np.exp(-half), np.exp(half)
    idles = (
        time / float(part.flat[index]) * float(_idle(scenario, tables[0]).flat[index])
        for time, index in zip(minutes, choice, strict=True)
    )
    cycle = (life + sum(idles)) / parts
    volume = part_volume(scenario)
    steps = tuple(
        Step(float(table.wear.flat[i]), float(table.cutting_speed.flat[i]), float(table.feed.flat[i]), time)
        for table, i, time in zip(tables, choice, minutes, strict=True)
    )
    return Advice(
        aim=aim,
        steps=steps,
        life=(life, life * low, life * high),
        part_time=life / parts,
        cycle_time=cycle,
        parts=(parts, parts * low, parts * high),
        removal_rate=volume / (cycle + prices.change_time / parts),
        cost=prices.minute * (cycle + prices.change_time / parts) + prices.edge / parts,
        extrapolated=extrapolated,
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
    prices, work = Prices.of(scenario), scenario.workpiece
    yield (
        f"{scenario.name}: bars of {work.diameter:g} mm, {work.bar_length:g} mm long, {work.depth_of_cut:g} mm deep; "
        f"edges worn out at {scenario.tool.wear_criterion:g} mm"
    )
    unit, change = prices.unit, f"a change takes {prices.change_time:g} min"
    yield f"a minute costs {prices.minute:.3g} {unit}, an edge {prices.edge:.3g} {unit}; {change}"
    yield ""
    heads = ("", "speed", "feed", "tool life", "parts per edge", "change after", "at wear", "cycle", "MRR", "cost per part")
    units = ("", "m/min", "mm/rev", "min", "", "parts", "mm", "min", "cm3/min", unit)
    rows = [heads, units]
    for each in found:
        speeds, feeds = ([getattr(step, name) for step in each.steps] for name in ("cutting_speed", "feed"))
        kind = "fixed" if len(each.steps) == 1 else "schedule"
        rows.append(
            (
                f"{each.aim}, {kind}",
                _span(speeds, ".0f"),
                _span(feeds, ".3f"),
                _interval(each.life, ".1f"),
                _interval(each.parts, ".1f"),
                str(each.change_after),
                f"{each.steps[-1].wear:.2f}",
                f"{each.cycle_time:.2f}",
                f"{each.removal_rate:.1f}",
                f"{each.cost:.3f}" + (" *" if each.extrapolated else ""),
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(
            cell.ljust(width) if n == 0 else cell.rjust(width) for n, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
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


def _interval(values: tuple[float, float, float], form: str) -> str:
    value, low, high = values
    return f"{value:{form}} ({low:{form}}-{high:{form}})"
