"""Advise a cut from a catalogue: material, insert, grade, machine and stock, but no measured cut.

The laws are those of ``catalogue``, with the width of their sources. Search and costs are those of
``advise.py``. The answer is one sentence; then come limits, a table, the sources and every number
that was assumed.
"""

import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w
from turning_shop import WorkshopError
from turning_shop.advise import (
    MIN_COST,
    Advice,
    Plan,
    Prices,
    advise,
    best_plan,
    bound_sentence,
    extrapolation,
    money,
    not_by_wear,
    overload_risk,
    plan,
    surface,
    table,
    tried_plans,
)
from turning_shop.allowed import (
    FEED_PER_NOSE,
    MAX_DEFLECTION,
    bending_parts,
    feed_ends,
    feed_range,
    with_roughness,
)
from turning_shop.catalogue import UNMEASURED, groups, laws, materials, thrust
from turning_shop.catalogue.groups import softest, with_hardness
from turning_shop.catalogue.hardness import MAX_OF_CARBIDE
from turning_shop.catalogue.inserts import Insert, read_insert
from turning_shop.catalogue.materials import Material, find_material, other_states
from turning_shop.catalogue.start_values import (
    CONDITIONS,
    DEPTH_EXPONENT,
    FEED_EXPONENT,
    FEEDS_SOURCE,
    LIFE,
    Grade,
    Start,
    check_grade,
    feeds_of,
    for_conditions,
    read_grade,
    start_of,
    stated_start,
)
from turning_shop.fit import TYPICAL_EDGE_SPREAD
from turning_shop.prediction import Evidence, LawEvidence, longest_life
from turning_shop.provenance import TAYLOR, Stated, for_advice, stated_by
from turning_shop.units import METRIC, Units

from turning_env.numerics.conversions import cutting_speed_at
from turning_env.scenario import Scenario
from turning_env.scenario.scenario import flat, merged

MIN_EDGE_SPREAD = 1e-3  # log spread of edges that is taken for 0 [-]: 0 would be divided by
QUANTILE = 1.96  # half the 95 % interval over the standard deviation [-]
UNREACHED = 0.5
"""Lowest over highest value of a range that the machine, or the nose radius, ends (assumption)."""


class Stock(NamedTuple):
    """The bar."""

    diameter: float  # at which it is turned [mm]
    length: float  # of cut [mm]
    bore: float = 0.0  # inner diameter of a tube [mm]; 0: solid


class Question(NamedTuple):
    """Material, insert, grade, stock and wishes, as the user states them."""

    material: str
    tool: str
    grade: str
    stock: Stock
    depth: float | None = None  # of cut [mm]
    machine: str = "rough_turning"  # preset or file
    start_speed: float | None = None  # of the box of inserts [m/min]
    feeds: tuple[float, float] | None = None  # of the box of inserts [mm/rev]
    roughness: float | None = None  # highest theoretical one, Rt [um]
    support: str | None = None  # of the bar: "chuck", "tailstock" or "rigid"
    hardness: float | None = None  # Brinell hardness of the bar [HB]
    conditions: tuple[str, ...] = ()  # of the cut: keys of ``CONDITIONS``
    entering_angle: float | None = None  # of the straight edge to the feed [degree]


class Window(NamedTuple):
    """Ranges of cuts that insert, grade and machine allow."""

    speeds: tuple[float, float]  # [m/min]
    feeds: tuple[float, float]  # [mm/rev]
    depths: tuple[float, float]  # [mm]
    # Fields of the scenario whose ends are the catalogue's rather than the machine's.
    catalogue_ends: frozenset[str]
    assumptions: tuple[str, ...]


class Job(NamedTuple):
    """A job as a scenario with laws of a catalogue."""

    material: Material
    insert: Insert
    grade: str
    start: Start
    window: Window
    scenario: Scenario
    evidence: Evidence
    values: dict[str, Any]  # that the catalogue and the question state, by section
    machine: str
    conditions: tuple[str, ...]  # of the cut
    bore: float  # of a tube [mm]; 0: solid
    angle_stated: bool
    hardness_stated: bool
    efficiency_assumed: bool

    @property
    def sources(self) -> Iterator[str]:
        """Sentences on where the numbers come from."""
        group = self.material.group
        insert = self.insert
        speeds = self.start.speeds
        yield f"{self.material.described} ({materials.SOURCE})"
        yield (
            f"kc1.1 {group.kc11:g} N/mm2 within {_percent(group.force_deviation)}, "
            f"mc {group.mc:g} ({groups.SOURCE})"
        )
        share = thrust.share_of(group)
        yield (
            f"thrust is {share.value:g} of the cutting force at {thrust.REFERENCE_FEED:g} mm/rev "
            f"and {thrust.REFERENCE_DEPTH:g} mm, within {_percent(share.deviation)} "
            f"({share.source})"
        )
        yield (
            f"{speeds.usual:.0f} m/min ({speeds.low:.0f} to {speeds.high:.0f}) "
            f"for a life of {LIFE:g} min with {self.grade} ({'; '.join(self.start.sources)})"
        )
        yield (
            f"Taylor's n {TAYLOR:g} (Dormer Pramet 2024, p. 76); V f^{FEED_EXPONENT:g} "
            f"ap^{DEPTH_EXPONENT:g} is constant (handbooks, adaptive part programming paper)"
        )
        prepared = f", {insert.edge}" if insert.edge.letter else ""
        yield (
            f"{insert.name}: {insert.shape.name}, edge {insert.edge_length:.1f} mm, "
            f"nose radius {insert.nose_radius:g} mm, {insert.edges} edges{prepared} (ISO 1832); "
            f"{insert.cut.name} ({insert.cut.source}), scaled to its size, nose and clearance"
        )
        if feeds := feeds_of(group):
            low, high = feeds
            yield f"feeds of {low:g} to {high:g} mm/rev in {group.name} ({FEEDS_SOURCE})"
        yield f"modulus of elasticity {group.modulus:.0f} N/mm2 of the bar (handbooks)"

    @property
    def assumptions(self) -> Iterator[str]:
        """Sentences on numbers without a source, and on the user's own that are missing."""
        if not self.material.number and self.material.name != self.material.group.name:
            yield f"{self.material.name} is taken as the usual alloy: its number tells it exactly"
        if not self.conditions:
            names = ", ".join(CONDITIONS)
            yield f"the cut is smooth, clean, firm and wet: --cut states what it is not ({names})"
        if self.start.interrupted and "interrupted" not in self.conditions:
            yield (
                f"the start value of {self.grade} is the maker's for interrupted cuts, as it has "
                "none of this grade for smooth ones"
            )
        if not self.angle_stated and not self.insert.is_round:
            yield (
                f"the entering angle is {USUAL_ENTERING_ANGLE:g} degrees: --entering-angle states "
                "another"
            )
        yield from self.start.assumptions
        yield from self.insert.assumptions
        yield from self.window.assumptions
        yield from laws.ASSUMED
        yield (
            f"feeds up to {FEED_PER_NOSE:g} of the nose radius, depths up to "
            f"{self.insert.shape.usable:.2g} of the edge's length (rules of thumb)"
        )
        if bending_parts(self.scenario):
            yield f"the thrust may bend {bending_parts(self.scenario)} by {MAX_DEFLECTION:g} mm"
        for warning in self.evidence.warnings:
            if UNMEASURED not in warning:
                yield warning


def _percent(log_deviation: float) -> str:
    """Return a 95 % interval for people, from a log standard deviation."""
    return f"{100 * math.expm1(QUANTILE * log_deviation):.0f} %"


def job_of(question: Question) -> Job:
    """Return the job of a question.

    Raises:
        WorkshopError: A designation is unknown, or insert, material and machine do not meet.
        ScenarioError: The machine's file is invalid.
    """
    material = _material(question)
    insert = read_insert(question.tool)
    grade = read_grade(question.grade)
    machine = Scenario.load(question.machine)
    if machine.file is None:
        stated_values: dict[str, Any] = {}
        preset = machine.name
    else:
        stated_values, preset = stated_by(machine.file)
    stated = set(flat(stated_values))

    assumptions: tuple[str, ...] = ()
    depth = question.depth
    if depth is None:
        depth = min(insert.cut.depth.usual, insert.max_depth)
        assumptions = (f"no --depth is given: {depth:.3g} mm, the usual one of its chip breaker",)
    start = _start(question, material, insert=insert, grade=grade, depth=depth)
    window = _window(
        question,
        material,
        insert=insert,
        start=start,
        depth=depth,
        machine=machine,
        stated=stated,
    )
    sine = _entering_sine(question, insert, depth)
    _check_depth(depth, insert, sine=sine, stock=question.stock)

    fitted = laws.material_of(
        material.group, start, machine.tool.wear_criterion, entering_sine=sine
    )
    evidence_laws = laws.evidence_of(
        fitted, material.group, start, feeds=window.feeds, depths=window.depths
    )
    values = _values(question, insert=insert, window=window, depth=depth)
    # The bar's second moment of area is that of a solid one: a tube gets a smaller modulus.
    hollow = question.stock.bore / question.stock.diameter
    values["workpiece"]["elastic_modulus"] = (1.0 - hollow**4) * material.group.modulus
    # The more the edge leans, the more of the thrust is radial.
    radial_share = max(machine.workpiece.radial_share, math.sqrt(1.0 - sine**2))
    values["workpiece"]["radial_share"] = radial_share
    if question.support:
        values["workpiece"]["support"] = question.support
    elif "workpiece.support" not in stated:
        values["workpiece"]["support"] = "chuck"
        assumptions += ("the chuck alone holds the bar: --support states another",)
    values["material"] = fitted.model_dump()
    values["limits"] = _limits(machine, stated, fitted=fitted, window=window)
    if values["limits"]["thrust_force"] != machine.limits.thrust_force:
        window = window._replace(catalogue_ends=window.catalogue_ends | {"limits.thrust_force"})
    if "economics.edges_per_insert" not in stated:
        values["economics"] = {"edges_per_insert": float(insert.edges)}
    name = f"{material.name}_{insert.name}_{grade.name}"
    scenario = _scenario(name, machine, stated=stated, values=values)
    if question.roughness is not None:
        scenario = with_roughness(scenario, question.roughness, wiper=insert.cut.wiper)
        roughness = scenario.limits.roughness.model_dump(exclude_defaults=True)
        values["limits"]["roughness"] = roughness
    efficiency_stated = "spindle.efficiency" in stated
    tool = f"{insert.name} {grade.name} in {material.name}"
    known = Evidence(
        source="catalogue", tool=tool, laws=evidence_laws, hardness=material.group.hardness
    )
    scenario, known = for_advice(
        scenario,
        known,
        Stated(stated | set(flat(values)), preset),
        is_simulated=False,
    )
    return Job(
        material=material,
        insert=insert,
        grade=grade.name,
        start=start,
        window=window._replace(assumptions=window.assumptions + assumptions),
        scenario=scenario,
        evidence=known,
        values=values,
        machine=question.machine,
        conditions=question.conditions,
        bore=question.stock.bore,
        angle_stated=question.entering_angle is not None,
        hardness_stated=question.hardness is not None,
        efficiency_assumed=scenario.spindle.efficiency < 1.0 and not efficiency_stated,
    )


def _start(
    question: Question, material: Material, *, insert: Insert, grade: Grade, depth: float
) -> Start:
    """Return the start value: that of the box, or else of the table.

    Raises:
        WorkshopError: The table has none, for the grade is made for something else.
    """
    if question.start_speed is None:
        check_grade(material.group, grade)
        start = start_of(material.group, grade)
    else:
        feed = insert.cut.feed.usual
        if question.feeds is not None:
            # The box states its start speed at the middle of its own window.
            feed = sum(question.feeds) / 2
        start = stated_start(question.start_speed, feed, depth)
    return for_conditions(start, question.conditions, material.group)


def _material(question: Question) -> Material:
    """Return the material of a question, at the hardness that it states.

    Raises:
        WorkshopError: The material is unknown, or so hard that it is turned with CBN or ceramics.
    """
    material = find_material(question.material)
    hardness = question.hardness
    if hardness is None:
        return material
    if hardness > MAX_OF_CARBIDE:
        raise WorkshopError(
            f"--hardness {hardness:.0f} HB: above {MAX_OF_CARBIDE:g} HB (45 HRC) bars are turned "
            "with CBN or ceramics, for which the sources have no start values: measure a cut, and "
            "use calibrate"
        )
    annealed = softest(material.group).hardness
    if not 0.6 * annealed <= hardness <= 2.5 * annealed:
        raise WorkshopError(
            f"--hardness {hardness:.0f} HB: {material.name} has about {annealed:.0f} HB annealed"
        )
    return material._replace(group=with_hardness(material.group, hardness))


def questions(job: Job) -> Iterator[str]:
    """Yield what to tell because the answer depends on it, as sentences for people."""
    group = job.material.group
    if job.efficiency_assumed:
        efficiency = job.scenario.spindle.efficiency
        yield (
            f"are the {job.scenario.limits.power / efficiency:g} kW of limits.power on the "
            f"nameplate? spindle.efficiency states what share reaches the cut, here {efficiency:g}"
        )
    states = other_states(group)
    if states and job.material.name != group.name and not job.hardness_stated:
        yield (
            f"is the bar annealed, {group.hardness:g} HB? {states}: --hardness states it, such as "
            "--hardness 300HB or 32HRC"
        )


def _scenario(name: str, machine: Scenario, stated: set[str], values: dict[str, Any]) -> Scenario:
    """Return the machine's scenario with the values of a job."""
    allowed_name = re.sub(r"[^A-Za-z0-9.-]+", "_", name)[:64]
    allowed_name = allowed_name.strip("_.")
    base = machine.model_dump(exclude={"name"})
    for start_name in ("initial_cutting_speed", "initial_feed"):
        # A start that only the preset states moves into the range.
        if f"control.{start_name}" not in stated:
            del base["control"][start_name]
    job_values = merged(base, values)
    return Scenario.load({"name": allowed_name} | job_values)


USUAL_ENTERING_ANGLE = 90.0  # if none is stated [degree] (assumption)


def _entering_sine(question: Question, insert: Insert, depth: float) -> float:
    """Return the sine of the entering angle of a question's tool [-]."""
    angle = question.entering_angle or USUAL_ENTERING_ANGLE
    return insert.entering_sine(angle, depth)


def _check_depth(depth: float, insert: Insert, sine: float, stock: Stock) -> None:
    wall = (stock.diameter - stock.bore) / 2.0
    if stock.bore and depth >= wall:
        raise WorkshopError(f"--depth {depth:g} mm cuts through the tube's wall of {wall:g} mm")
    if 2.0 * depth >= stock.diameter:
        raise WorkshopError(
            f"--depth {depth:g} mm reaches the axis of a bar of {stock.diameter:g} mm diameter"
        )
    # The edge is in the cut over depth / sine; a round one is bounded by its diameter.
    max_depth = insert.max_depth if insert.is_round else sine * insert.max_depth
    if depth > max_depth:
        raise WorkshopError(
            f"--depth {depth:g} mm is too deep for {insert.name}: its edge of "
            f"{insert.edge_length:.1f} mm cuts up to {max_depth:.1f} mm; "
            "take more passes or a larger insert"
        )


class _Span(NamedTuple):
    """A range of speeds or feeds."""

    low: float
    high: float
    catalogue_ends: frozenset[str]  # fields of the scenario whose ends are the catalogue's
    assumptions: tuple[str, ...]


def _window(
    question: Question,
    material: Material,
    *,
    insert: Insert,
    start: Start,
    depth: float,
    machine: Scenario,
    stated: set[str],
) -> Window:
    """Return where insert, grade and machine allow cuts."""
    speeds = _speeds(question, start, machine=machine, stated=stated)
    sine = _entering_sine(question, insert, depth)
    feeds = _feeds(question, material, insert=insert, sine=sine, machine=machine, stated=stated)
    assumptions = speeds.assumptions + feeds.assumptions
    low_depth, high_depth = insert.depths
    if question.depth is not None and not low_depth <= question.depth <= high_depth:
        assumptions += (
            f"{question.depth:g} mm is outside the {low_depth:g} to {high_depth:.2g} mm of its "
            "chip breaker: chips may not break",
        )
    return Window(
        speeds=(speeds.low, speeds.high),
        feeds=(feeds.low, feeds.high),
        depths=insert.depths,
        catalogue_ends=speeds.catalogue_ends | feeds.catalogue_ends,
        assumptions=assumptions,
    )


def _speeds(question: Question, start: Start, machine: Scenario, stated: set[str]) -> _Span:
    """Return the cutting speeds of the catalogue that the machine reaches [m/min]."""
    ends = {"machine.cutting_speed_min", "machine.cutting_speed_max"}
    assumptions: tuple[str, ...] = ()
    low = start.speeds.low
    high = start.speeds.high
    if "machine.cutting_speed_max" in stated and machine.machine.cutting_speed_max < high:
        high = machine.machine.cutting_speed_max
        ends.discard("machine.cutting_speed_max")
    reached = high
    if machine.spindle.max_speed and "spindle.max_speed" in stated:
        by_spindle = cutting_speed_at(machine.spindle.max_speed, question.stock.diameter)
        reached = min(high, by_spindle)
    if reached <= low:
        assumptions = (
            f"the machine reaches {reached:.0f} m/min at {question.stock.diameter:g} mm diameter, "
            f"less than the catalogue's lowest, {low:.0f} m/min",
        )
        low = UNREACHED * reached
    span = _Span(low, high, catalogue_ends=frozenset(ends), assumptions=assumptions)
    if "machine.cutting_speed_min" not in stated:
        return span
    return _from_lowest(
        span,
        "machine.cutting_speed_min",
        machine.machine.cutting_speed_min,
        highest=reached,
        unit="m/min",
        reason=f"{question.tool} {question.grade} allows in this material",
    )


def _feeds_of_insert(insert: Insert, sine: float) -> tuple[float, float]:
    """Return the feeds of a chip breaker [mm/rev], for chips as thick as at 90 degrees."""
    low, high = insert.feeds
    return low / sine, high / sine


def _feeds(
    question: Question,
    material: Material,
    *,
    insert: Insert,
    sine: float,
    machine: Scenario,
    stated: set[str],
) -> _Span:
    """Return the feeds of insert and material that the machine has [mm/rev]."""
    ends = {"machine.feed_min", "machine.feed_max"}
    assumptions: tuple[str, ...] = ()
    low, high = question.feeds or _feeds_of_insert(insert, sine)
    by_material = feeds_of(material.group)
    if by_material and question.feeds is None:
        # Feeds that the chip breaker and the material both allow. If the chip breaker's window
        # begins above half of the material's highest feed, little or nothing is left of it: then
        # the range begins at that half, so that it does not become empty.
        lowest_of_material, highest_of_material = by_material
        low = min(low, UNREACHED * highest_of_material)
        low = max(low, lowest_of_material)
        high = min(high, highest_of_material)
    if "machine.feed_max" in stated and machine.machine.feed_max < high:
        high = machine.machine.feed_max
        ends.discard("machine.feed_max")
    highest = min(high, _highest_feed(question, insert))
    if low >= highest:
        low = UNREACHED * highest
        assumptions = (
            f"feeds begin at {low:.3g} mm/rev: the nose radius of {insert.nose_radius:g} mm, "
            "the roughness or the machine end them below the chip breaker's window, "
            "where chips may not break",
        )
    span = _Span(low, high, catalogue_ends=frozenset(ends), assumptions=assumptions)
    if "machine.feed_min" not in stated:
        return span
    return _from_lowest(
        span,
        "machine.feed_min",
        machine.machine.feed_min,
        highest=highest,
        unit="mm/rev",
        reason=f"{insert.name} allows, by its nose radius or the roughness",
    )


def _from_lowest(
    span: _Span, field: str, lowest: float, *, highest: float, unit: str, reason: str
) -> _Span:
    """Return a span that does not begin below the machine's lowest value.

    Args:
        span: of the catalogue, up to what the machine reaches.
        field: of the scenario, which states the lowest value.
        lowest: value of the field.
        highest: value that is possible.
        unit: of all values.
        reason: why none above ``highest`` is possible, for people.

    Raises:
        WorkshopError: The lowest value is not below the highest.
    """
    if lowest <= span.low:
        return span
    if lowest >= highest:
        raise WorkshopError(
            f"{field} is {lowest:g} {unit}, but must be below the {highest:.4g} {unit} that "
            f"{reason}"
        )
    return span._replace(low=lowest, catalogue_ends=span.catalogue_ends - {field})


def _highest_feed(question: Question, insert: Insert) -> float:
    """Return the highest feed that nose radius and roughness allow [mm/rev]."""
    tool = {"nose_radius": insert.nose_radius}
    scenario = Scenario.load({"machine": {"feed_max": 10.0}, "tool": tool})
    if question.roughness is not None:
        scenario = with_roughness(scenario, question.roughness, wiper=insert.cut.wiper)
    return feed_ends(scenario)[0].feed


def _values(question: Question, insert: Insert, window: Window, depth: float) -> dict[str, Any]:
    """Return the values of the question and the catalogue, by section."""
    return {
        "machine": {
            "cutting_speed_min": window.speeds[0],
            "cutting_speed_max": window.speeds[1],
            "feed_min": window.feeds[0],
            "feed_max": window.feeds[1],
        },
        "workpiece": {
            "diameter": question.stock.diameter,
            "bar_length": question.stock.length,
            "depth_of_cut": depth,
        },
        "tool": {"nose_radius": insert.nose_radius},
    }


def _limits(machine: Scenario, stated: set[str], fitted: Any, window: Window) -> dict[str, Any]:
    """Return the limits of force and power: those of the machine, and the insert's strength.

    The insert bears the thrust of its highest feed and depth in this material, worn out.
    """
    bearable = float(
        fitted.thrust_force(
            window.speeds[0],
            window.feeds[1],
            window.depths[1],
            wear=machine.tool.wear_criterion,
        )
    )
    limits: dict[str, Any] = {"thrust_force": bearable}
    if "limits.thrust_force" in stated:
        limits["thrust_force"] = min(bearable, machine.limits.thrust_force)
    if "limits.power" not in stated and "machine.rated_power" in stated:
        limits["power"] = machine.machine.rated_power
    return limits


def start_advice(job: Job) -> list[Advice]:
    """Return the advice on a job, the least cost first."""
    return advise(job.scenario, job.evidence)


_BOUND_NAMES = {
    "limits.power": "the spindle's power",
    "limits.thrust_force": "the strength of the insert",
    "tool.edge_strength": "the strength of the edge",
    "tool.nose_radius": "the nose radius",
    "limits.roughness": "the roughness",
    "workpiece.support": "the bending of the bar",
    "spindle.max_speed": "the highest spindle speed",
    "machine.cutting_speed_min": "the lowest cutting speed",
    "machine.cutting_speed_max": "the highest cutting speed",
    "machine.feed_min": "the lowest feed",
    "machine.feed_max": "the highest feed",
}


def _binding(job: Job, advice: Advice) -> str:
    """Return the limit whose lifting saves most, for people."""
    if not advice.bounds:
        return "no limit binds"
    bound = min(advice.bounds, key=lambda bound: float(bound.without.cost))
    name = _BOUND_NAMES.get(bound.name, bound.name)
    owner = " of the catalogue" if bound.name in job.window.catalogue_ends else ""
    return f"{name}{owner} binds"


class Narrowing(NamedTuple):
    """A measurement of one cut, and what it tells."""

    action: str
    saving: float  # of the interval of the cost, in the unit of the cost
    gain: str


def narrowings(job: Job, best: Plan) -> list[Narrowing]:
    """Return what one measured cut would narrow, that which narrows the cost most first.

    The cost is that of the best cut if a law is at the end of its interval.
    """
    both = (_wear_narrowing(job, best), _power_narrowing(job, best))
    return sorted(both, key=lambda narrowing: narrowing.saving, reverse=True)


def _wear_narrowing(job: Job, best: Plan) -> Narrowing:
    """Return what the wear of one edge, measured once, would narrow."""
    wear = job.evidence.laws["wear"]
    factors = best.cuts._asdict()
    deviation = wear.log_deviation(job.scenario.material.wear, factors, of_reading=False)
    before = float(deviation)
    # One edge tells the law but for the spread of edges. Catalogue and measurement are
    # independent, so the precisions 1 / deviation^2 add up.
    spread = max(job.scenario.tool.wear_factor_spread, MIN_EDGE_SPREAD)
    after = 1.0 / math.hypot(1.0 / before, 1.0 / spread)

    evidence = _with_wear_evidence(job.evidence, deviation=after)
    narrowed = _plan_again(job, best, evidence)
    count = max(1.0, float(best.parts_low))
    return Narrowing(
        action=f"the flank wear of one edge after {count:.0f} {_parts_word(count)}",
        saving=_cost_range(job, "wear", before) - _cost_range(job, "wear", after),
        gain=f"the parts an edge to {_between(narrowed.parts_low, narrowed.parts_high)}",
    )


def _power_narrowing(job: Job, best: Plan) -> Narrowing:
    """Return what the spindle's power, measured once, would narrow."""
    # Only the spread of edges remains: it is far below the deviation of the catalogue.
    before = job.material.group.force_deviation
    after = TYPICAL_EDGE_SPREAD["power"]
    power = float(best.cuts.power)
    percent = 100 * (QUANTILE * after)
    return Narrowing(
        action="the spindle's power in one cut",
        saving=_cost_range(job, "power", before) - _cost_range(job, "power", after),
        gain=f"{power:.1f} kW to within {percent:.0f} %",
    )


def _cost_range(job: Job, law: str, deviation: float) -> float:
    """Return how far the least cost goes if a law lies within its 95 % interval."""
    material = job.scenario.material
    nominal_law = getattr(material, law)
    costs = []
    for sign in (-1.0, 1.0):
        factor = math.exp(sign * QUANTILE * deviation)
        coefficient = factor * nominal_law.coefficient
        changed_law = nominal_law.model_copy(update={"coefficient": coefficient})
        changed_material = material.model_copy(update={law: changed_law})
        scenario = job.scenario.model_copy(update={"material": changed_material})
        tried = tried_plans(scenario, Evidence())
        best = best_plan(scenario, Evidence(), tried, aim=MIN_COST)
        cost = math.inf if best is None else float(best.cost)
        costs.append(cost)
    low, high = costs
    return abs(high - low)


def _with_wear_evidence(evidence: Evidence, deviation: float) -> Evidence:
    """Return the evidence with a law of wear that is known to a log standard deviation."""
    before = evidence.laws["wear"]
    known = {"terms": (), "covariance": ((deviation**2,),)}
    narrow: LawEvidence = before.model_copy(update=known)
    laws = evidence.laws | {"wear": narrow}
    return evidence.model_copy(update={"laws": laws})


def _plan_again(job: Job, best: Plan, evidence: Evidence) -> Plan:
    """Return a plan with other evidence."""
    return plan(
        job.scenario,
        evidence,
        cutting_speed=best.cuts.cutting_speed,
        feed=best.cuts.feed,
        wear=best.cuts.wear,
    )


def _between(low: Any, high: Any) -> str:
    """Return a range of parts for people."""
    return f"{_parts(low)} to {_parts(high)}"


def _parts(count: Any) -> str:
    return f"{float(count):.0f}" if count >= 1 else f"{float(count):.2g}"


def _parts_word(count: Any) -> str:
    return "part" if count == 1 else "parts"


def sentence(job: Job, advice: list[Advice]) -> str:
    """Return the answer: settings, edge change, cost, limit, and what to measure.

    The windows of speed, feed and depth are those of insert, grade and machine. The intervals of
    parts and cost follow from the width of the tool life.
    """
    best = advice[0].plan
    cuts = best.cuts
    low_speed, high_speed = job.window.speeds
    low_feed, high_feed = feed_range(job.scenario)
    low_depth, high_depth = job.window.depths
    speed = f"{cuts.cutting_speed:.4g} m/min ({low_speed:.0f} to {high_speed:.0f})"
    feed = f"{cuts.feed:.3g} mm/rev ({low_feed:.2g} to {high_feed:.2g})"
    depth = f"{cuts.depth_of_cut:g} mm deep ({low_depth:.2g} to {high_depth:.2g})"

    parts = _between(best.parts_low, best.parts_high)
    if not best.by_wear:
        parts = f"{longest_life(job.evidence):g} min; not limited by wear here"
    edge = f"{_parts(best.parts)} ({parts}) {_parts_word(best.parts)} an edge"
    unit = Prices.of(job.scenario).unit
    interval = f"{money(best.cost_low)} to {money(best.cost_high)}"
    cost = f"{money(best.cost)} {unit} a part ({interval}){best.mark}"
    narrowing = narrowings(job, best)[0]
    return (
        f"Cut {speed}, {feed}, {depth}: {edge}, {cost}; {_binding(job, advice[0])}; "
        f"{UNMEASURED}: measure {narrowing.action}, which narrows {narrowing.gain}"
    )


def summary(job: Job, advice: list[Advice], units: Units = METRIC) -> Iterator[str]:
    """Yield lines of text: the answer, limits, a table, sources and assumptions."""
    for line in _answer(job, advice):
        yield units.text(line)
    yield from table(job.scenario, advice, units)
    for line in _grounds(job):
        yield units.text(line)


def _answer(job: Job, advice: list[Advice]) -> Iterator[str]:
    """Yield the lines above the table, in metric units."""
    scenario = job.scenario
    prices = Prices.of(scenario)
    yield sentence(job, advice)
    yield from questions(job)
    yield ""
    if advice[0].plan.mark:
        yield extrapolation(job.evidence, advice[0].plan)
    yield from not_by_wear(job.evidence, advice[0].plan)
    for bound in advice[0].bounds:
        owner = ", of the catalogue" if bound.name in job.window.catalogue_ends else ""
        yield bound_sentence(bound._replace(limit=bound.limit + owner), prices.unit)
    work = scenario.workpiece
    yield from overload_risk(scenario, job.evidence, advice[0])
    yield surface(scenario, advice[0].plan, wiper=job.insert.cut.wiper)
    tube = f"a tube of {job.bore:g} mm inner diameter, " if job.bore else ""
    yield (
        f"{work.diameter:g} mm diameter, {tube}{work.bar_length:g} mm long; "
        f"a minute costs {prices.minute:.3g} {prices.unit}, an edge {prices.edge:.3g} "
        f"{prices.unit}; a change takes {prices.change_time:g} min"
    )
    yield ""


def _grounds(job: Job) -> Iterator[str]:
    """Yield the lines below the table, in metric units."""
    yield ""
    yield f"{UNMEASURED}:"
    yield from (f"  {source}" for source in job.sources)
    yield "assumed:"
    yield from (f"  {assumption}" for assumption in job.assumptions)


def toml_of(job: Job, out: Path) -> str:
    """Return the job as a scenario's file, with its evidence; ``calibrate`` can take it as base."""
    lines = [f"# Laws of a catalogue, not measured: {job.material.described}."]
    for line in (*job.sources, *job.assumptions):
        lines.append(f"# {line}")
    comment = "\n".join(lines)

    base = job.machine
    path = Path(job.machine)
    if path.suffix == ".toml":
        base = os.path.relpath(path, out.parent)
    warnings = (
        *job.start.assumptions,
        *job.insert.assumptions,
        *job.window.assumptions,
    )
    evidence = job.evidence.model_copy(update={"warnings": warnings})
    values = {"base": base} | job.values
    values["calibration"] = evidence.model_dump(mode="json")
    return f"{comment}\n\n{tomli_w.dumps(values)}"
