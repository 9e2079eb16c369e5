"""The answer to a question without measured cuts: one sentence, questions, limits and grounds."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from scipy import special
from turning_shop.advise import (
    MIN_COST,
    Advice,
    PartPlan,
    Prices,
    advice_table,
    best_plan,
    bound_sentence,
    extrapolation,
    money,
    not_by_wear,
    overload_risk,
    plan,
    surface,
    tried_plans,
)
from turning_shop.allowed import feed_range
from turning_shop.catalogue import UNMEASURED
from turning_shop.catalogue.materials import other_states
from turning_shop.fit import LEVEL, TYPICAL_EDGE_SPREAD
from turning_shop.prediction import Evidence, LawEvidence, longest_life
from turning_shop.start import QUANTILE, CatalogueJob
from turning_shop.units import METRIC, Units
from turning_shop.wear_plan import EDGES, ENOUGH

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


def _binding(job: CatalogueJob, advice: Advice) -> str:
    """Return the limit whose lifting saves most, for people."""
    if not advice.bounds:
        return "no limit binds"
    bound = min(advice.bounds, key=lambda bound: float(bound.without.cost))
    name = _BOUND_NAMES.get(bound.name, bound.name)
    is_range_end = bound.name in job.window.catalogue_ends and bound.name.startswith("machine.")
    owner = " of the catalogue" if is_range_end else ""
    return f"{name}{owner} binds"


class Narrowing(NamedTuple):
    """A measurement, and what it tells."""

    action: str
    saving: float  # of the interval of the cost, in the unit of the cost
    gain: str


def narrowings(job: CatalogueJob, best: PartPlan) -> list[Narrowing]:
    """Return what measurements would narrow, that which narrows the cost most first.

    The cost is that of the best cut if a law is at the end of its interval.
    """
    both = (_wear_narrowing(job, best), _power_narrowing(job, best))
    return sorted(both, key=lambda narrowing: narrowing.saving, reverse=True)


def _wear_narrowing(job: CatalogueJob, best: PartPlan) -> Narrowing:
    """Return what the wear of some edges, measured once each, would narrow."""
    wear = job.evidence.laws["wear"]
    factors = best.cuts._asdict()
    deviation = wear.log_deviation(job.scenario.material.wear, factors, of_reading=False)
    before = float(deviation)
    edges, after = _edges_to_measure(before, job.edge_spread)
    evidence = _with_wear_evidence(job.evidence, deviation=after)
    narrowed = _plan_again(job, best, evidence)
    count = max(1.0, float(best.parts_low))
    return Narrowing(
        action=f"the flank wear of {edges} edges, the first after {count:.0f} {_parts_word(count)}",
        saving=_cost_range(job, "wear", before) - _cost_range(job, "wear", after),
        gain=f"the parts an edge to {_between(narrowed.parts_low, narrowed.parts_high)}",
    )


def _edges_to_measure(before: float, spread: float) -> tuple[int, float]:
    """Return how many edges to measure, and the deviation of the law of wear that is left [-].

    ``calibrate`` takes the level of n edges from these alone, with Student's t of their spread. The
    fewest are taken that narrow the interval by ``ENOUGH``; the most if none do.

    Args:
        before: log standard deviation of the catalogue's law [-].
        spread: log standard deviation of edges [-].
    """
    edges = EDGES[-1]
    after = before
    for edges in EDGES:
        quantile = special.stdtrit(edges - 1, 0.5 + 0.5 * LEVEL)
        after = float(quantile) / QUANTILE * spread / math.sqrt(edges)
        if after <= ENOUGH * before:
            break
    return edges, min(after, before)


def _power_narrowing(job: CatalogueJob, best: PartPlan) -> Narrowing:
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


def _cost_range(job: CatalogueJob, law: str, deviation: float) -> float:
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


def _plan_again(job: CatalogueJob, best: PartPlan, evidence: Evidence) -> PartPlan:
    """Return a plan with other evidence."""
    return plan(
        job.scenario,
        evidence,
        cutting_speed=best.cuts.cutting_speed,
        feed=best.cuts.feed,
        wear=best.cuts.wear,
    )


def _between(low: Any, high: Any) -> str:
    """Return a range of parts for people; one number if both ends are the same."""
    ends = dict.fromkeys((_parts(low), _parts(high)))
    return " to ".join(ends)


def _parts(count: Any) -> str:
    return f"{float(count):.0f}" if count >= 1 else f"{float(count):.2g}"


def _parts_word(count: Any) -> str:
    return "part" if count == 1 else "parts"


def sentence(job: CatalogueJob, advice: list[Advice]) -> str:
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
    feed = f"{cuts.feed:.3g} mm/rev ({low_feed:.3g} to {high_feed:.3g})"
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


def summary(job: CatalogueJob, advice: list[Advice], units: Units = METRIC) -> Iterator[str]:
    """Yield lines of text: the answer, limits, a table, sources and assumptions."""
    for line in _answer(job, advice):
        yield units.text(line)
    yield from advice_table(job.scenario, advice, units)
    for line in _grounds(job):
        yield units.text(line)


def questions(job: CatalogueJob) -> Iterator[str]:
    """Yield what to tell because the answer depends on it, as sentences for people."""
    group = job.material.group
    if job.efficiency_assumed:
        efficiency = job.scenario.spindle.efficiency
        yield (
            f"are the {job.scenario.limits.power / efficiency:g} kW of limits.power on the "
            f"nameplate? spindle.efficiency states what share reaches the cut, here {efficiency:g}"
        )
    states = other_states(group)
    if states and job.material.name != group.name and job.question.hardness is None:
        yield (
            f"is the bar annealed, {group.hardness:g} HB? {states}: --hardness states it, such as "
            "--hardness 300HB or 32HRC"
        )


def _answer(job: CatalogueJob, advice: list[Advice]) -> Iterator[str]:
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
    tube = (
        f"a tube of {job.question.stock.bore:g} mm inner diameter, "
        if job.question.stock.bore
        else ""
    )
    yield (
        f"{work.diameter:g} mm diameter, {tube}{work.bar_length:g} mm long; "
        f"a minute costs {prices.minute:.3g} {prices.unit}, an edge {prices.edge:.3g} "
        f"{prices.unit}; a change takes {prices.change_time:g} min"
    )
    yield ""


def _grounds(job: CatalogueJob) -> Iterator[str]:
    """Yield the lines below the table, in metric units."""
    yield ""
    yield f"{UNMEASURED}:"
    yield from (f"  {source}" for source in job.sources)
    yield "assumed:"
    yield from (f"  {assumption}" for assumption in job.assumptions)
