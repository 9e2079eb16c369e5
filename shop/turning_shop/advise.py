"""Advise speed, feed and edge change for a scenario, in parts, minutes and money.

All numbers refer to one policy: the edge is changed after a fixed number of whole parts, which 97.5 % of edges last. If fewer
edges last a part, it is changed after a fixed share of one. Loads keep their limits up to the flank wear that no more than 2.5 %
of edges exceed at the change, with the margins of ``allowed.py`` for bars that vary. ``advise_play.py`` plays the advice.
"""

from collections.abc import Iterator, Mapping
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from turning_shop import Values, WorkshopError, aligned
from turning_shop.allowed import NO_STRENGTH, Allowed, allowed_loads, feed_range, needed_nose_radius
from turning_shop.fit import LEVEL
from turning_shop.prediction import Evidence, Prediction, outside, predict
from turning_shop.tables import records
from turning_shop.whatif import CHANGES, NO_LIMIT, Cuts, what_if

from turning_env.scenario import Scenario

SPEEDS, FEEDS = (
    120,
    60,
)  # largest number of round cutting speeds, and of round feeds, that are tried
AIMS = ("least cost", "least cost as measured", "most metal")
"""Aims of advice; the second keeps to the measured range, and is left out if the first does."""
BINDS = 5e-3  # relative gain of lifting a limit above which it binds [-]
WIDER = 0.1  # share by which an end of the machine's range is moved to tell what it costs [-]


class Prices(NamedTuple):
    """Prices of machining."""

    unit: str  # currency; "min" of machine time if no hourly rate is known
    minute: float  # of machine and operator
    edge: float
    change_time: float  # time to change an edge [min]

    @classmethod
    def of(cls, scenario: Scenario) -> "Prices":
        """Return the prices of a scenario."""
        economics = scenario.economics
        minute = (economics.machine_rate + economics.operator_rate) / 60.0
        unit = economics.currency if minute else "min"
        minute = minute or 1.0
        edge = (
            economics.insert_price / economics.edges_per_insert
            if economics.insert_price
            else economics.edge_cost * minute
        )
        if economics.insert_price and unit == "min":
            raise WorkshopError(
                "economics.insert_price is money, but economics.machine_rate is 0: set the machine's hourly rate"
            )
        return cls(unit, minute, edge, economics.edge_change_time)


class Plan(NamedTuple):
    """Settings and the edge change that follows from them: numbers, or arrays of one shape."""

    cuts: Cuts  # at the flank wear that the edge reaches at the change at most
    prediction: Prediction  # intervals of the cut
    parts: Any  # per edge; a share of one if edges do not last a part
    minutes: Any  # cutting time of an edge [min]
    cycle_time: Any  # from part to part, without edge changes [min]
    mean_removal_rate: Any  # metal per minute, edge changes included [cm3/min]
    cost: Any  # of a part, edges included
    cost_low: Any  # 95 % interval by the law of wear, with as many parts per edge as then last; NaN if it was not measured
    cost_high: Any

    @property
    def where(self) -> str:
        """Speed, feed and edge change, for people."""
        parts = f"after {self.parts:.0f} part{'s' * bool(self.parts > 1)}"
        if self.parts < 1:
            parts = f"after {self.minutes:.1f} min of cutting ({self.parts:.2f} parts)"
        return f"{self.cuts.cutting_speed:.4g} m/min, {self.cuts.feed:.4g} mm/rev, change {parts}"

    def as_record(self) -> dict[str, Any]:
        """Return all numbers for JSON."""
        _, _, *others = self._fields
        return records(self.cuts, self.prediction)[0] | {
            name: float(getattr(self, name)) for name in others
        }

    @property
    def mark(self) -> str:
        """A star if a law is used outside the measured range."""
        return " *" * bool(self.prediction.extrapolated)


class Bound(NamedTuple):
    """A limit that binds an advice."""

    limit: str  # name in the scenario, value and unit
    law: str  # what is known of its law; empty for a range of the machine
    without: Plan  # the advice without it, or with the range wider by ``WIDER``


class Advice(NamedTuple):
    """A plan, its aim, one of ``AIMS``, and the limits that bind it."""

    aim: str
    plan: Plan
    bounds: tuple[Bound, ...]

    def as_record(self) -> dict[str, Any]:
        """Return the advice for JSON, with all numbers of its cut and their intervals."""
        bounds = [each._asdict() | {"without": each.without.as_record()} for each in self.bounds]
        return {"aim": self.aim} | self.plan.as_record() | {"bounds": bounds}


def plan(
    scenario: Scenario,
    evidence: Evidence,
    cutting_speed: Any,
    feed: Any,
    wear: Any,
    hardness: Any = 1.0,
) -> Plan:
    """Return the plan of a cutting speed [m/min] and a feed [mm/rev] whose edge is changed before a flank wear [mm]."""
    prices, work, machine = Prices.of(scenario), scenario.workpiece, scenario.machine
    cuts = what_if(scenario, cutting_speed, feed, hardness=hardness, wear=wear)
    prediction = predict(scenario, evidence, cuts, of_wear=True)
    margin, known = (
        life_margin(scenario, evidence, cuts._asdict()),
        np.full(cuts.time.shape, np.nan),
    )
    if law := evidence.laws.get("wear"):
        known = (
            law.quantile
            * law.log_deviation(scenario.material.wear, cuts._asdict(), 0.0)
            / scenario.material.wear.time
        )
    per_minute = cuts.feed * cuts.spindle_speed  # [mm/min]
    part_time = work.bar_length / per_minute
    cycle = (work.bar_length + work.approach) / per_minute + machine.return_time

    def policy(shift: Any) -> tuple[Any, Any]:
        """Return parts per edge and the cost of a part if the logarithm of all lives shifts."""
        parts = whole_parts(cuts.time * np.exp(shift - margin) / part_time)
        return parts, prices.minute * (cycle + prices.change_time / parts) + prices.edge / parts

    parts, cost = policy(0.0)
    rate = part_volume(scenario) / (cycle + prices.change_time / parts)
    ends = policy(known)[1], policy(-known)[1]
    return Plan(cuts, prediction, parts, parts * part_time, cycle, rate, cost, *ends)


def advise(scenario: Scenario, evidence: Evidence) -> list[Advice]:
    """Return the advice for each aim, the headline first.

    Raises:
        WorkshopError: No speed and feed keep the limits with a worn edge, or the scenario is not one of plain bars.
    """
    if scenario.control.action == "part":
        raise WorkshopError(
            'control.action is "part": advise covers bars at one depth, not whole parts of several passes'
        )
    tried = plan(scenario, evidence, *settings(scenario))
    if not allowed_loads(scenario).keeps(scenario, tried.cuts).any():
        raise WorkshopError(
            f"no speed and feed keep {_loads_kept(scenario)} with an edge worn to {tried.cuts.wear.min():g} mm: "
            "reduce workpiece.depth_of_cut"
        )
    found: list[Advice] = []
    for aim in AIMS:
        best = _best(scenario, evidence, tried, aim)
        if best and (aim != AIMS[1] or found[0].plan.mark):
            found.append(Advice(aim, best, tuple(_bounds(scenario, evidence, aim, best))))
    return found


def settings(scenario: Scenario) -> tuple[Values, Values, Values]:
    """Return the round speeds [m/min] and feeds [mm/rev], and the wears [mm], that are tried, as axes of one table."""
    machine = scenario.machine
    speeds = round_numbers(machine.cutting_speed_min, scenario.cutting_speed_max, SPEEDS)
    if scenario.control.action == "override":
        speeds = np.array([scenario.control.initial_cutting_speed])
    wears = CHANGES * scenario.tool.wear_criterion
    feeds = round_numbers(*feed_range(scenario), FEEDS)
    return speeds, feeds[:, np.newaxis], wears[:, np.newaxis, np.newaxis]


def round_numbers(low: float, high: float, count: int) -> Values:
    """Return both ends, and between them multiples of 1, 2 or 5 times a power of ten, about ``count`` at most."""
    power = 10.0 ** np.floor(np.log10((high - low) / count))
    step = next(
        factor * power for factor in (1, 2, 5, 10) if (high - low) / (factor * power) <= count
    )
    inner = np.arange(np.floor(low / step) + 1, np.ceil(high / step)) * step
    return np.unique(np.round([low, *inner, high], 9))


def _aimed(tried: Plan, aim: str) -> Any:
    """Return what an aim minimises."""
    return -tried.mean_removal_rate if aim == "most metal" else tried.cost


def _best(scenario: Scenario, evidence: Evidence, tried: Plan, aim: str) -> Plan | None:
    """Return the best of the plans that are tried, for an aim; None if none keeps the limits."""
    possible = allowed_loads(scenario).keeps(scenario, tried.cuts) & ~(
        tried.prediction.extrapolated & (aim == AIMS[1])
    )
    if not possible.any():
        return None
    index = np.where(possible, _aimed(tried, aim), np.inf).argmin()
    return plan(
        scenario,
        evidence,
        *(getattr(tried.cuts, name).flat[index] for name in ("cutting_speed", "feed", "wear")),
    )


class _Lift(NamedTuple):
    """A limit or an end of a range, and its value when it is lifted or moved."""

    section: str
    name: str
    unit: str
    moved: float
    is_load: bool


def _lifts(scenario: Scenario) -> Iterator[_Lift]:
    """Yield the limits of load, which are lifted, and the ends of ranges, which are moved by ``WIDER``."""
    machine, spindle, tool, swarf = (
        scenario.machine,
        scenario.spindle,
        scenario.tool,
        scenario.swarf,
    )
    yield _Lift("limits", "power", "kW", NO_LIMIT["power"], is_load=True)
    yield _Lift("limits", "thrust_force", "N", NO_LIMIT["thrust_force"], is_load=True)
    yield _Lift("tool", "edge_strength", "N", NO_STRENGTH, is_load=True)
    wider, lower = 1.0 + WIDER, 1.0 - WIDER
    yield _Lift("spindle", "max_speed", "rev/min", wider * spindle.max_speed, is_load=False)
    yield _Lift(
        "machine", "cutting_speed_min", "m/min", lower * machine.cutting_speed_min, is_load=False
    )
    yield _Lift(
        "machine", "cutting_speed_max", "m/min", wider * machine.cutting_speed_max, is_load=False
    )
    yield _Lift("machine", "feed_min", "mm/rev", lower * machine.feed_min, is_load=False)
    yield _Lift("machine", "feed_max", "mm/rev", wider * machine.feed_max, is_load=False)
    yield _Lift("tool", "nose_radius", "mm", wider * tool.nose_radius, is_load=False)
    if swarf.tangle_rate > 0.0:
        yield _Lift("swarf", "chip_feed_min", "mm/rev", lower * swarf.chip_feed_min, is_load=False)
        yield _Lift("swarf", "chip_feed_max", "mm/rev", wider * swarf.chip_feed_max, is_load=False)


def _bounds(scenario: Scenario, evidence: Evidence, aim: str, best: Plan) -> Iterator[Bound]:
    """Yield the limits that an aim gains from lifting, and the ends of the machine's range that it gains from moving."""
    machine, fastest = scenario.machine, scenario.cutting_speed_max * (1 + 1e-9)
    lowest_feed, highest_feed = feed_range(scenario)
    for lift in _lifts(scenario):
        section = getattr(scenario, lift.section)
        lifted = scenario.model_copy(
            update={lift.section: section.model_copy(update={lift.name: lift.moved})}
        )
        better = _best(lifted, evidence, plan(lifted, evidence, *settings(lifted)), aim)
        if not better or _aimed(best, aim) - _aimed(better, aim) <= BINDS * abs(_aimed(best, aim)):
            continue
        in_range = machine.cutting_speed_min <= better.cuts.cutting_speed <= fastest
        in_range = in_range and lowest_feed <= better.cuts.feed <= highest_feed * (1 + 1e-9)
        if in_range and not lift.is_load:
            continue  # better only by other round numbers
        law = "thrust_force" if lift.name == "edge_strength" else lift.name
        known = f"its law was {'not ' * (law not in evidence.laws)}measured" if lift.is_load else ""
        limit = f"{lift.section}.{lift.name}, {getattr(section, lift.name):g} {lift.unit}"
        yield Bound(limit, known, better)


def _loads_kept(scenario: Scenario) -> str:
    """Return the limits of load that are on, for people."""
    limits, tool = scenario.limits, scenario.tool
    named = []
    if limits.thrust_force < NO_LIMIT["thrust_force"]:
        named.append(f"limits.thrust_force, {limits.thrust_force:g} N,")
    if limits.power < NO_LIMIT["power"]:
        named.append(f"limits.power, {limits.power:g} kW,")
    if tool.edge_strength < NO_STRENGTH:
        named.append(f"tool.edge_strength, {tool.edge_strength:g} N,")
    return " and ".join(named)


def life_spread(scenario: Scenario) -> float:
    """Return half the 95 % interval of an edge's life, in its logarithm, by the spread of edges that the scenario states [-]."""
    return (
        NormalDist().inv_cdf(0.5 + 0.5 * LEVEL)
        * scenario.tool.wear_factor_spread
        / scenario.material.wear.time
    )


def life_margin(scenario: Scenario, evidence: Evidence, factors: Mapping[str, Values]) -> Values:
    """Return the logarithm of the nominal life over that which 97.5 % of edges reach, at values of the law's factors [-]."""
    margin, wear = np.full(np.shape(factors["time"]), life_spread(scenario)), scenario.material.wear
    if law := evidence.laws.get("wear"):  # edges differ at least as much as the scenario says
        margin = np.maximum(margin, law.quantile * law.log_deviation(wear, factors) / wear.time)
    return margin


def whole_parts(lasting: Any) -> Any:
    """Return the number of parts after which an edge is changed: whole ones, or a share of one if it does not last a part."""
    return np.where(lasting < 1, lasting, np.floor(lasting * (1 + 1e-9)))


def part_volume(scenario: Scenario) -> float:
    """Return the metal cut from a part [cm3]."""
    work = scenario.workpiece
    return float(np.pi * work.diameter * work.depth_of_cut * work.bar_length / 1000.0)


def headline(scenario: Scenario, evidence: Evidence, found: list[Advice]) -> Iterator[str]:
    """Yield the recommendation in a sentence, and sentences on what binds it."""
    _, best, bounds = found[0]
    unit = Prices.of(scenario).unit
    ends = money(best.cost_low), money(best.cost_high)
    interval = f" ({ends[0]} to {ends[1]})" if ends[0] != ends[1] else ""
    yield f"Cut {best.where}: {money(best.cost)} {unit} a part{interval}{best.mark}"
    if best.mark:
        values = best.cuts._asdict()
        beyond = (
            f"{name} {values[name]:.3g}, but measured at {at}"
            for name, at, out in outside(evidence, values)
            if out
        )
        yield f"* outside what was measured: {'; '.join(beyond)}"
    yield from _margins(allowed_loads(scenario), scenario)
    for bound in bounds:
        there = bound.without
        moved = (
            f", and {bound.law}; without it"
            if bound.law
            else f"; with a range {100 * WIDER:g} % wider"
        )
        yield f"{bound.limit}, rules out a cheaper cut{moved} {there.where}: {money(there.cost)} {unit} a part{there.mark}"
    if not bounds:
        yield "No limit rules out a cheaper cut: time and edges are in balance"
    if not scenario.tool.nose_radius:
        radius = needed_nose_radius(float(best.cuts.feed))
        yield (
            f"{best.cuts.feed:.4g} mm/rev needs a nose radius of {radius:.2g} mm or more, "
            "but none is stated: set tool.nose_radius or --nose-radius"
        )


def _margins(allowed: Allowed, scenario: Scenario) -> Iterator[str]:
    """Yield sentences on how far loads stay below what the scenario states, so that bars and edges may vary."""
    below = [
        f"{100 * factor:.0f} % of limits.{name}"
        for name, factor in allowed.overload_factors.items()
        if factor < 0.995
    ]
    if below:
        share = 100 * scenario.limits.overload_allowance
        kept = " and ".join(below)
        yield f"loads of a nominal bar stay below {kept}: bars vary, and {share:g} % of the time may be in severe overload"
    if allowed.by_strength:
        yield (
            f"thrust of a nominal bar stays below {allowed.thrust_force:.0f} N: "
            f"half of the edges break at {scenario.tool.edge_strength:g} N, tool.edge_strength, and bars and edges vary"
        )


def money(value: float) -> str:
    """Return an amount of money with two digits behind the point, or three in all if it is small."""
    return f"{value:.2f}" if abs(value) >= 1 else f"{value:.3g}"


def summary(scenario: Scenario, evidence: Evidence, found: list[Advice]) -> Iterator[str]:
    """Yield lines of text: the jobs and prices, the recommendation, and a table of all advice."""
    prices, work = Prices.of(scenario), scenario.workpiece
    bars = f"bars of {work.diameter:g} mm diameter, {work.bar_length:g} mm long, {work.depth_of_cut:g} mm deep"
    yield f"{scenario.name}: {bars}; edges worn out at {scenario.tool.wear_criterion:g} mm"
    change = f"a change takes {prices.change_time:g} min"
    yield f"a minute costs {prices.minute:.3g} {prices.unit}, an edge {prices.edge:.3g} {prices.unit}; {change}"
    yield ""
    yield from headline(scenario, evidence, found)
    yield ""
    heads = (
        "speed",
        "feed",
        "change after",
        "or at wear",
        "tool life",
        "thrust",
        "power",
        "cycle",
        "mean MRR",
        "cost per part",
    )
    yield from aligned([
        ("", *heads),
        ("", "m/min", "mm/rev", "parts", "mm", "min", "N", "kW", "min", "cm3/min", prices.unit),
        *(
            (
                *(aim, f"{best.cuts.cutting_speed:.4g}", f"{best.cuts.feed:.4g}", f"{best.parts:.3g}", f"{best.cuts.wear:.3g}"),
                f"{best.cuts.tool_life:.1f}" + _interval(best, "tool_life", ".1f"),
                *(f"{best.cuts.thrust_force:.0f}", f"{best.cuts.power:.1f}", f"{best.cycle_time:.2f}"),
                *(f"{best.mean_removal_rate:.1f}", money(best.cost) + best.mark),
            )
            for aim, best, _ in found
        ),
    ])  # fmt: skip


def _interval(best: Plan, name: str, form: str) -> str:
    low, high = best.prediction.low[name], best.prediction.high[name]
    return f" ({low:{form}}-{high:{form}})" if np.isfinite(low) else ""
