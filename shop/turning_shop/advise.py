"""Advise speed, feed and edge change for a scenario, in parts, minutes and money.

All numbers refer to one policy: the edge is changed after a fixed number of whole parts, which
97.5 % of edges last. If fewer edges last a part, it is changed after a fixed share of one. Loads
keep their limits up to the flank wear that no more than 2.5 % of edges exceed at the change, with
the margins of ``allowed.py`` for bars that vary. ``advise_play.py`` plays the advice.

The cost of a part is ``scenario/laws.machining_cost``. Because edges are changed after whole parts,
it jumps with speed and feed, so all round speeds, feeds and wears are tried. The closed form for
metal without parts, ``two_limits.set_point``, costs 14 % more a part on the preset ``h13_romi``
(test_the_economic_optimum_of_metal_costs_more_a_part).
"""

from collections.abc import Iterator, Mapping
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from turning_shop import Values, WorkshopError, aligned
from turning_shop.allowed import (
    NO_STRENGTH,
    WIPER_SHARE,
    Allowed,
    allowed_loads,
    bending,
    bending_fields,
    feed_range,
    needed_nose_radius,
    theoretical_roughness,
)
from turning_shop.catalogue import UNMEASURED
from turning_shop.fit import LEVEL
from turning_shop.prediction import Evidence, Prediction, longest_life, outside, predict
from turning_shop.tables import records
from turning_shop.units import METRIC, Units, short
from turning_shop.whatif import CHANGES, NO_LIMIT, Cuts, what_if

from turning_env.scenario import Scenario
from turning_env.scenario.laws import capacity_at, machining_cost
from turning_env.scenario.sections import FeedLimit

MAX_SPEEDS = 120  # round cutting speeds that are tried
MAX_FEEDS = 60  # round feeds that are tried
MIN_COST = "least cost"
MIN_MEASURED_COST = "least cost as measured"
MAX_METAL = "most metal"
AIMS = (MIN_COST, MIN_MEASURED_COST, MAX_METAL)
"""Aims of advice; the second keeps to the measured range, and is left out if the first does."""
BINDS = 5e-3  # relative gain of lifting a limit above which it binds [-]
WIDER = 0.1  # share by which an end of the machine's range is moved to find what it costs [-]
ROUNDING = 1e-9  # relative error of a number that counts as rounding [-]


class Prices(NamedTuple):
    """Prices of machining."""

    unit: str  # currency; "min" of machine time if no hourly rate is known
    minute: float  # of machine and operator
    edge: float
    change_time: float  # time to change an edge [min]

    @classmethod
    def of(cls, scenario: Scenario) -> "Prices":
        """Return the prices of a scenario.

        Raises:
            WorkshopError: The price of an insert is known, but no hourly rate.
        """
        economics = scenario.economics
        minute = (economics.machine_rate + economics.operator_rate) / 60.0
        unit = economics.currency
        if not minute:
            unit = "min"
            minute = 1.0
        if economics.insert_price and unit == "min":
            raise WorkshopError(
                "economics.insert_price is money, but economics.machine_rate is 0: "
                "set the machine's hourly rate"
            )
        if economics.insert_price:
            edge = economics.insert_price / economics.edges_per_insert
        else:
            edge = economics.edge_cost * minute
        return cls(unit, minute, edge=edge, change_time=economics.edge_change_time)


class PartPlan(NamedTuple):
    """Settings and the edge change that follows from them: numbers, or arrays of one shape."""

    cuts: Cuts  # at the flank wear that the edge reaches at the change at most
    prediction: Prediction  # intervals of the cut
    parts: Any  # per edge; a share of one if edges do not last a part
    # 95 % interval of the parts by the law of wear; NaN if nothing is known of the law.
    parts_low: Any
    parts_high: Any
    minutes: Any  # cutting time of an edge [min]
    by_wear: Any  # whether wear limits the edge, and not ``longest_life``
    cycle_time: Any  # from part to part, without edge changes [min]
    mean_removal_rate: Any  # metal per minute, edge changes included [cm3/min]
    cost: Any  # of a part, edges included
    # 95 % interval by the law of wear, with as many parts per edge as then last; NaN if the law
    # was not measured.
    cost_low: Any
    cost_high: Any

    @property
    def where(self) -> str:
        """Speed, feed and edge change, for people."""
        if self.parts < 1:
            change = f"after {self.minutes:.1f} min of cutting ({self.parts:.2f} parts)"
        elif self.parts > 1:
            change = f"after {self.parts:.0f} parts"
        else:
            change = "after 1 part"
        settings = f"{self.cuts.cutting_speed:.4g} m/min, {self.cuts.feed:.4g} mm/rev"
        return f"{settings}, change {change}"

    def as_record(self) -> dict[str, Any]:
        """Return all numbers for JSON."""
        record = records(self.cuts, self.prediction)[0]
        for name, value in self._asdict().items():
            if name not in ("cuts", "prediction"):
                record[name] = float(value)
        return record

    @property
    def mark(self) -> str:
        """A star if a law is used outside the measured range."""
        return " *" if self.prediction.extrapolated else ""


class Bound(NamedTuple):
    """A limit that binds an advice."""

    name: str  # in the scenario
    limit: str  # the name, the value and its unit
    law: str  # what is known of its law; empty for a range of the machine
    without: PartPlan  # the advice without it, or with the range wider by ``WIDER``
    joint: str = ""  # other ends of the range that bind with it, as text after ``limit``


class Advice(NamedTuple):
    """A plan, its aim, one of ``AIMS``, and the limits that bind it."""

    aim: str
    plan: PartPlan
    bounds: tuple[Bound, ...]

    def as_record(self) -> dict[str, Any]:
        """Return the advice for JSON, with all numbers of its cut and their intervals."""
        bounds = []
        for bound in self.bounds:
            without = bound.without.as_record()
            limit = bound.limit + bound.joint
            bounds.append({"limit": limit, "law": bound.law, "without": without})
        return {"aim": self.aim, **self.plan.as_record(), "bounds": bounds}


def plan(
    scenario: Scenario,
    evidence: Evidence,
    cutting_speed: Any,
    feed: Any,
    wear: Any,
    hardness: Any = 1.0,
) -> PartPlan:
    """Return the plan of settings whose edge is changed before a flank wear.

    Arguments are numbers, or arrays that broadcast to one shape: cutting speed [m/min], feed
    [mm/rev], flank wear [mm] and hardness over nominal [-].
    """
    prices = Prices.of(scenario)
    work = scenario.workpiece
    cuts = what_if(scenario, cutting_speed, feed, hardness=hardness, wear=wear)
    prediction = predict(scenario, evidence, cuts, of_wear=True)
    factors = cuts._asdict()
    margin = life_margin(scenario, evidence, factors)
    feed_speed = cuts.feed * cuts.spindle_speed  # [mm/min]
    part_time = work.bar_length / feed_speed
    cycle_time = (work.bar_length + work.approach) / feed_speed + scenario.machine.return_time

    longest = longest_life(evidence)

    def parts_if(log_shift: Any) -> Any:
        """Return the parts per edge if the logarithm of all lives shifts."""
        lasting = np.minimum(cuts.time * np.exp(log_shift - margin), longest)
        return whole_parts(lasting / part_time)

    def cost_of(parts: Any) -> Any:
        """Return the cost of a part, edges included."""
        price_of_edge = prices.change_time + prices.edge / prices.minute  # [min]
        return prices.minute * machining_cost(cycle_time, 1.0 / parts, price_of_edge)

    # Half the 95 % interval of the logarithm of the mean life. Edges differ on top of it: that
    # is the margin.
    life_doubt = np.full(cuts.time.shape, np.nan)
    wear_law = scenario.material.wear
    if law := evidence.laws.get("wear"):
        deviation = law.log_deviation(wear_law, factors, of_reading=False)
        life_doubt = law.quantile * deviation / wear_law.time
    parts = parts_if(0.0)
    fewest = parts_if(-life_doubt)
    most = parts_if(life_doubt)
    time_with_changes = machining_cost(cycle_time, 1.0 / parts, prices.change_time)
    return PartPlan(
        cuts=cuts,
        prediction=prediction,
        parts=parts,
        parts_low=fewest,
        parts_high=most,
        minutes=parts * part_time,
        by_wear=cuts.time * np.exp(-margin) < longest,
        cycle_time=cycle_time,
        mean_removal_rate=part_volume(scenario) / time_with_changes,
        cost=cost_of(parts),
        cost_low=cost_of(most),
        cost_high=cost_of(fewest),
    )


def advise(scenario: Scenario, evidence: Evidence) -> list[Advice]:
    """Return the advice for each aim, the headline first.

    Raises:
        WorkshopError: No speed and feed keep the limits with a worn edge, or the scenario is not
            one of plain bars.
    """
    tried = _plans_to_choose_from(scenario, evidence)
    best_plans: dict[str, PartPlan] = {}
    for aim in AIMS:
        if aim == MIN_MEASURED_COST and not best_plans[MIN_COST].mark:
            continue  # the least cost is within the measured range
        best = best_plan(scenario, evidence, tried, aim=aim)
        if best:
            best_plans[aim] = best
    bounds = _bounds(scenario, evidence, tried, best_plans=best_plans)
    return [Advice(aim, best, tuple(bounds[aim])) for aim, best in best_plans.items()]


def cheapest(scenario: Scenario, evidence: Evidence) -> PartPlan:
    """Return the plan of the least cost, the first that ``advise`` returns.

    It does without the limits that bind, whose search takes most of the time of ``advise``.

    Raises:
        WorkshopError: As ``advise`` does.
    """
    tried = _plans_to_choose_from(scenario, evidence)
    best = best_plan(scenario, evidence, tried, aim=MIN_COST)
    assert best is not None  # at least one of them keeps the limits
    return best


def _plans_to_choose_from(scenario: Scenario, evidence: Evidence) -> PartPlan:
    """Return the plans that are tried, of which at least one keeps the limits.

    Raises:
        WorkshopError: As ``advise`` does.
    """
    if scenario.control.action == "part":
        raise WorkshopError(
            'control.action is "part": advise covers bars at one depth, '
            "not whole parts of several passes"
        )
    tried = tried_plans(scenario, evidence)
    if not allowed_loads(scenario).keeps(scenario, tried.cuts).any():
        closest = _closest(scenario, tried.cuts)
        depth = scenario.workpiece.depth_of_cut / closest.share
        raise WorkshopError(
            f"no speed and feed keep {_loads_exceeded(scenario, closest)} "
            f"with an edge worn to {closest.cuts.wear:g} mm: "
            f"reduce workpiece.depth_of_cut to about {depth:.2g} mm"
            f"{_help_against_bending(scenario)}"
        )
    return tried


def settings(scenario: Scenario) -> tuple[Values, Values, Values]:
    """Return the speeds [m/min], feeds [mm/rev] and wears [mm] that are tried.

    Speeds and feeds are round numbers. The arrays are the axes of one table.
    """
    if scenario.control.action == "override":
        speeds = np.array([scenario.control.initial_cutting_speed])
    else:
        lowest_speed = scenario.machine.cutting_speed_min
        speeds = round_numbers(lowest_speed, scenario.cutting_speed_max, MAX_SPEEDS)
    lowest_feed, highest_feed = feed_range(scenario)
    feeds = round_numbers(lowest_feed, highest_feed, MAX_FEEDS)
    wears = CHANGES * scenario.tool.wear_criterion
    return speeds, feeds[:, np.newaxis], wears[:, np.newaxis, np.newaxis]


def round_numbers(low: float, high: float, count: int) -> Values:
    """Return both ends and round numbers between them, about ``count`` in all at most.

    Round numbers are multiples of 1, 2 or 5 times a power of ten.
    """
    span = high - low
    power = 10.0 ** np.floor(np.log10(span / count))
    # 10 times the power is above span / count, so that the last factor always fits.
    for factor in (1, 2, 5, 10):
        step = factor * power
        if span / step <= count:
            break
    first = np.floor(low / step) + 1
    end = np.ceil(high / step)
    inner = np.arange(first, end) * step
    rounded = np.round([low, *inner, high], 9)
    return np.unique(rounded)


def tried_plans(scenario: Scenario, evidence: Evidence) -> PartPlan:
    """Return the plans of all settings that are tried, as arrays."""
    speeds, feeds, wears = settings(scenario)
    return plan(scenario, evidence, cutting_speed=speeds, feed=feeds, wear=wears)


class _Closest(NamedTuple):
    """The cut of those tried that comes nearest to the limits of load."""

    cuts: Cuts
    share: float  # largest load over what is allowed; a load is about in proportion to the depth
    by_force: bool  # whether the thrust force exceeds what is allowed
    by_power: bool  # whether the power does


def _closest(scenario: Scenario, cuts: Cuts) -> _Closest:
    """Return the cut that comes nearest to the limits of load."""
    shares = allowed_loads(scenario).shares(scenario, cuts)
    index = int(shares.highest.argmin())
    return _Closest(
        cuts=Cuts(*(np.asarray(values.flat[index]) for values in cuts)),
        share=float(shares.highest.flat[index]),
        by_force=bool(shares.thrust_force.flat[index] > 1.0),
        by_power=bool(shares.power.flat[index] > 1.0),
    )


def _objective(tried: PartPlan, aim: str) -> Any:
    """Return the quantity that an aim minimises."""
    return -tried.mean_removal_rate if aim == MAX_METAL else tried.cost


def best_plan(scenario: Scenario, evidence: Evidence, tried: PartPlan, aim: str) -> PartPlan | None:
    """Return the best of the plans that are tried, for an aim; None if none keeps the limits."""
    cuts = tried.cuts
    possible = allowed_loads(scenario).keeps(scenario, cuts)
    if aim == MIN_MEASURED_COST:
        possible = possible & ~tried.prediction.extrapolated
    if not possible.any():
        return None
    index = np.where(possible, _objective(tried, aim), np.inf).argmin()
    return plan(
        scenario,
        evidence,
        cutting_speed=cuts.cutting_speed.flat[index],
        feed=cuts.feed.flat[index],
        wear=cuts.wear.flat[index],
    )


class _Limit(NamedTuple):
    """A limit of load, or an end of a range, that may bind an advice."""

    section: str
    name: str
    unit: str = ""
    # Value that lifts a limit of load; None for an end of a range.
    no_limit: float | str | None = None
    widening: float = 1.0  # factor that moves an end of a range

    @property
    def path(self) -> str:
        """The field in the scenario."""
        return f"{self.section}.{self.name}"


_LOAD_LIMITS = (
    _Limit("limits", "power", "kW", no_limit=NO_LIMIT["power"]),
    _Limit("limits", "thrust_force", "N", no_limit=NO_LIMIT["thrust_force"]),
    _Limit("tool", "edge_strength", "N", no_limit=NO_STRENGTH),
    _Limit("workpiece", "support", no_limit="rigid"),
    _Limit("tool", "overhang", "mm", no_limit=0.0),
)
_RANGE_ENDS = (
    _Limit("spindle", "max_speed", "rev/min", widening=1.0 + WIDER),
    _Limit("machine", "cutting_speed_min", "m/min", widening=1.0 - WIDER),
    _Limit("machine", "cutting_speed_max", "m/min", widening=1.0 + WIDER),
    _Limit("machine", "feed_min", "mm/rev", widening=1.0 - WIDER),
    _Limit("machine", "feed_max", "mm/rev", widening=1.0 + WIDER),
    _Limit("tool", "nose_radius", "mm", widening=1.0 + WIDER),
    _Limit("limits", "roughness", widening=1.0 + WIDER),
)
_HIGHEST_FEEDS = ("feed_max", "nose_radius", "roughness", "chip_feed_max")
_HIGHEST_SPEEDS = ("cutting_speed_max", "max_speed")
# The window of the chip breaker counts only if chips tangle outside it.
_CHIP_WINDOW = (
    _Limit("swarf", "chip_feed_min", "mm/rev", widening=1.0 - WIDER),
    _Limit("swarf", "chip_feed_max", "mm/rev", widening=1.0 + WIDER),
)


def _bounds(
    scenario: Scenario, evidence: Evidence, tried: PartPlan, best_plans: Mapping[str, PartPlan]
) -> dict[str, list[Bound]]:
    """Return the limits that bind each aim: it gains from lifting a limit or widening a range.

    ``tried`` are the plans of the scenario, and ``best_plans`` the best of them by their aims.
    """
    limits: tuple[_Limit, ...] = _LOAD_LIMITS + _RANGE_ENDS
    if scenario.swarf.tangle_rate > 0.0:
        limits += _CHIP_WINDOW
    bounds: dict[str, list[Bound]] = {aim: [] for aim in best_plans}
    for limit in limits:
        lifted = _lifted(scenario, limit)
        if lifted == scenario:
            continue  # the limit is off
        is_load = limit.no_limit is not None
        # Without a limit of load, more of the same plans are allowed; a wider range has others.
        plans = tried if is_load else tried_plans(lifted, evidence)
        for aim, best in best_plans.items():
            better = _better(
                scenario, evidence, aim, best=best, lifted=lifted, tried=plans, is_load=is_load
            )
            if better is not None:
                bound = Bound(
                    limit.path,
                    limit=_named_value(scenario, limit, best.cuts),
                    law=_law_known(limit, evidence) if is_load else "",
                    without=better,
                )
                bounds[aim].append(bound)
    # Of two ends at the same feed or speed neither binds alone, but both together may.
    for names in (_HIGHEST_FEEDS, _HIGHEST_SPEEDS):
        ends = [limit for limit in limits if limit.name in names]
        paths = {end.path for end in ends}
        without_bound = {}
        for aim, best in best_plans.items():
            if not any(bound.name in paths for bound in bounds[aim]):
                without_bound[aim] = best
        for aim, bound in _joint_bounds(scenario, evidence, ends, best_plans=without_bound):
            bounds[aim].append(bound)
    return bounds


def _better(
    scenario: Scenario,
    evidence: Evidence,
    aim: str,
    best: PartPlan,
    lifted: Scenario,
    tried: PartPlan,
    is_load: bool,
) -> PartPlan | None:
    """Return the best plan of a scenario with lifted limits; None if the aim gains too little.

    ``tried`` are the plans of the lifted scenario.
    """
    better = best_plan(lifted, evidence, tried, aim=aim)
    objective = _objective(best, aim)
    if not better or objective - _objective(better, aim) <= BINDS * abs(objective):
        return None
    if not is_load and _in_range(scenario, better.cuts):
        return None  # better only because a wider range has other round numbers
    return better


def _joint_bounds(
    scenario: Scenario,
    evidence: Evidence,
    ends: list[_Limit],
    best_plans: Mapping[str, PartPlan],
) -> Iterator[tuple[str, Bound]]:
    """Yield each aim that the ends of one range bind together, and this bound."""
    widened = scenario
    for end in ends:
        widened = _lifted(widened, end)
    if not best_plans or widened == scenario:
        return
    tried = tried_plans(widened, evidence)
    for aim, best in best_plans.items():
        better = _better(
            scenario, evidence, aim, best=best, lifted=widened, tried=tried, is_load=False
        )
        if better is not None:
            yield aim, _joint_bound(scenario, ends, best=best, better=better)


def _joint_bound(scenario: Scenario, ends: list[_Limit], best: PartPlan, better: PartPlan) -> Bound:
    """Return the bound of the ends of one range beyond which a better plan lies."""
    # An end belongs to them if the cut is out of reach with this end alone left as it is.
    binding = []
    for end in ends:
        without_others = scenario
        for other_end in ends:
            if other_end != end:
                without_others = _lifted(without_others, other_end)
        if not _in_range(without_others, better.cuts):
            binding.append(end)
    first, *others = binding
    joint = ""
    for other_end in others:
        joint += f", with {_named_value(scenario, other_end, best.cuts)}"
    limit = _named_value(scenario, first, best.cuts)
    return Bound(first.path, limit=limit, law="", without=better, joint=joint)


def _named_value(scenario: Scenario, limit: _Limit, cuts: Cuts) -> str:
    """Return a limit and its value, for people."""
    return f"{limit.path}, {_shown_value(scenario, limit, cuts)}"


def _lifted(scenario: Scenario, limit: _Limit) -> Scenario:
    """Return a scenario without a limit of load, or with a range wider by ``WIDER``."""
    section = getattr(scenario, limit.section)
    value: Any = limit.no_limit
    if value is None:
        value = getattr(section, limit.name)
        if isinstance(value, FeedLimit):
            if value.bounds:
                value = value.model_copy(update={"most": limit.widening * value.most})
        else:
            value = limit.widening * value
    changed = section.model_copy(update={limit.name: value})
    return scenario.model_copy(update={limit.section: changed})


def _shown_value(scenario: Scenario, limit: _Limit, cuts: Cuts) -> str:
    """Return the value of a limit for people."""
    section = getattr(scenario, limit.section)
    value = getattr(section, limit.name)
    if limit.name in ("support", "overhang"):
        force = allowed_loads(scenario).thrust_force
        stated = value if limit.name == "support" else f"{value:g} mm"
        return f"{stated}: {bending(scenario)} at {force:.0f} N"
    if isinstance(value, FeedLimit):
        return f"{1000 * value.most:g} um"
    if limit.name == "power":
        return shown_power(scenario, cuts)
    return f"{value:g} {limit.unit}"


def shown_power(scenario: Scenario, cuts: Cuts) -> str:
    """Return the limit of power at a cut, for people: as the file states it, and what is left."""
    power = scenario.limits.power
    efficiency = scenario.spindle.efficiency
    text = f"{power / efficiency:g} kW"
    reasons = []
    capacity = float(capacity_at(scenario, cuts.cutting_speed))
    if capacity < 1.0:
        reasons.append(f"{float(cuts.spindle_speed):.0f} rev/min, below spindle.base_speed")
    if efficiency < 1.0:
        reasons.append(f"spindle.efficiency {efficiency:g}")
    if reasons:
        text += f", leaves {power * capacity:.3g} kW for the cut ({'; '.join(reasons)})"
    return text


def overload_risk(scenario: Scenario, evidence: Evidence, advice: Advice) -> Iterator[str]:
    """Yield a sentence on the probability of overload if power binds an advice."""
    if not any(bound.name == "limits.power" for bound in advice.bounds):
        return
    cuts = advice.plan.cuts
    low = float(advice.plan.prediction.low["power"])
    high = float(advice.plan.prediction.high["power"])
    if not low < high:
        return  # nothing is known of the law's width
    limit = scenario.limits.power * float(capacity_at(scenario, cuts.cutting_speed))
    power = float(cuts.power)
    deviation = np.log(high / low) / (2.0 * NormalDist().inv_cdf(0.5 + 0.5 * LEVEL))
    probability = 1.0 - NormalDist().cdf(float(np.log(limit / power) / deviation))
    yield (
        f"power binds at {power:.3g} kW of {limit:.3g} kW, interval {low:.3g} to {high:.3g} kW: a "
        f"worn edge overloads the spindle with a probability of {100.0 * probability:.0f} %"
    )


def _in_range(scenario: Scenario, cuts: Cuts) -> bool:
    """Return whether the machine reaches the speed and the feed of a cut."""
    lowest_speed = scenario.machine.cutting_speed_min
    highest_speed = scenario.cutting_speed_max * (1 + ROUNDING)
    lowest_feed, by_machine = feed_range(scenario)
    highest_feed = by_machine * (1 + ROUNDING)
    if not lowest_speed <= cuts.cutting_speed <= highest_speed:
        return False
    return bool(lowest_feed <= cuts.feed <= highest_feed)


def _law_known(limit: _Limit, evidence: Evidence) -> str:
    """Return what is known of the law of a load, for people."""
    # Edges break, and bars bend, by the thrust force.
    law = limit.name if limit.name == "power" else "thrust_force"
    known = evidence.known(law)
    return f"its law is from a {known}" if known == UNMEASURED else f"its law was {known}"


def _loads_exceeded(scenario: Scenario, closest: _Closest) -> str:
    """Return the limits of load that the closest cut exceeds, for people."""
    allowed = allowed_loads(scenario)
    loads = []
    if closest.by_force:
        force = f"{allowed.thrust_force:.0f} N"
        if allowed.by_deflection:
            loads.append(f"the {force} at which {bending(scenario)}, {bending_fields(scenario)},")
        elif allowed.by_strength:
            loads.append(f"tool.edge_strength, {scenario.tool.edge_strength:g} N,")
        else:
            loads.append(f"limits.thrust_force, {scenario.limits.thrust_force:g} N,")
    if closest.by_power:
        loads.append(f"limits.power, {shown_power(scenario, closest.cuts)},")
    return " and ".join(loads)


def _help_against_bending(scenario: Scenario) -> str:
    """Return what else to do, for people, if bending of bar or tool binds; else nothing."""
    if not allowed_loads(scenario).by_deflection:
        return ""
    ways = []
    if scenario.workpiece.support != "rigid":
        ways.append("support the bar")
    if scenario.tool.overhang:
        ways.append("shorten the overhang of the tool")
    return ", or " + " or ".join(ways)


def life_spread(scenario: Scenario) -> float:
    """Return half the 95 % interval of an edge's life, in its logarithm [-].

    It follows from the spread of edges that the scenario states.
    """
    quantile = NormalDist().inv_cdf(0.5 + 0.5 * LEVEL)
    # W = c t^g, so that the logarithm of a life deviates by 1 / g of that of wear.
    return quantile * scenario.tool.wear_factor_spread / scenario.material.wear.time


def life_margin(scenario: Scenario, evidence: Evidence, factors: Mapping[str, Values]) -> Values:
    """Return the logarithm of the nominal life over the life that 97.5 % of edges reach [-].

    ``factors`` are the values of the law's factors, in the units of ``Cuts``.
    """
    shape = np.shape(factors["time"])
    margin = np.full(shape, life_spread(scenario))
    wear = scenario.material.wear
    law = evidence.laws.get("wear")
    # A catalogue's doubt is about the level of all edges, which the first of them shows. So the
    # change is planned for the usual level, and the interval of the parts says what to expect.
    if law and law.origin == "measured":
        deviation = law.log_deviation(wear, factors)
        by_readings = law.quantile * deviation / wear.time
        # Edges differ at least as much as the scenario says.
        margin = np.maximum(margin, by_readings)
    return margin


def whole_parts(lasting: Any) -> Any:
    """Return the number of parts after which an edge is changed, from the parts that it lasts.

    The number is whole, or a share of one part if the edge does not last a part.
    """
    return np.where(lasting < 1, lasting, np.floor(lasting * (1 + ROUNDING)))


def part_volume(scenario: Scenario) -> float:
    """Return the metal cut from a part [cm3]."""
    work = scenario.workpiece
    return float(np.pi * work.diameter * work.depth_of_cut * work.bar_length / 1000.0)


def headline(scenario: Scenario, evidence: Evidence, advice: list[Advice]) -> Iterator[str]:
    """Yield the recommendation in a sentence, and sentences on the limits that bind it."""
    best = advice[0].plan
    unit = Prices.of(scenario).unit
    low = money(best.cost_low)
    high = money(best.cost_high)
    interval = f" ({low} to {high})" if low != high else ""
    cost = f"{money(best.cost)} {unit} a part{interval}"
    yield f"Cut {best.where}: {cost}{best.mark}"
    if best.mark:
        yield extrapolation(evidence, best)
    yield from not_by_wear(evidence, best)
    yield from _margins(allowed_loads(scenario), scenario)
    for bound in advice[0].bounds:
        yield bound_sentence(bound, unit)
    yield from overload_risk(scenario, evidence, advice[0])
    if not advice[0].bounds:
        yield "No limit rules out a cheaper cut: time and edges are in balance"
    yield surface(scenario, best)


def not_by_wear(evidence: Evidence, best: PartPlan) -> Iterator[str]:
    """Yield a sentence if the law of wear lets an edge last longer than it is used for."""
    if not best.by_wear:
        yield (
            f"not limited by wear here: the edge is changed after {longest_life(evidence):g} min, "
            f"the longest life that its law is used for"
        )


def extrapolation(evidence: Evidence, best: PartPlan) -> str:
    """Return a sentence on the factors of a plan's cut that lie outside what was measured."""
    values = best.cuts._asdict()
    beyond = []
    for measured in outside(evidence, values):
        if measured.outside:
            value = f"{measured.factor} {values[measured.factor]:.3g} {measured.unit}".rstrip()
            beyond.append(f"{value}, but {evidence.origins} at {measured.text}")
    return f"* outside what was {evidence.origins}: {'; '.join(beyond)}"


def surface(scenario: Scenario, best: PartPlan, wiper: bool = False) -> str:
    """Return a sentence on the surface that nose radius or wiper leave, or on the radius needed."""
    feed = float(best.cuts.feed)
    radius = scenario.tool.nose_radius
    if radius:
        roughness = theoretical_roughness(feed, radius)
        if wiper:
            return (
                f"{feed:.4g} mm/rev, a nose radius of {radius:g} mm and a wiper leave a roughness "
                f"of about {WIPER_SHARE * roughness:.1f} um, half the theoretical Rt"
            )
        return (
            f"{feed:.4g} mm/rev and a nose radius of {radius:g} mm leave a theoretical roughness "
            f"Rt of {roughness:.1f} um"
        )
    return (
        f"{feed:.4g} mm/rev needs a nose radius of {needed_nose_radius(feed):.2g} mm or more, "
        "but none is stated: set tool.nose_radius or --nose-radius"
    )


def bound_sentence(bound: Bound, unit: str) -> str:
    """Return a sentence on a limit that binds, with the advice without it."""
    if bound.law:
        change = f", and {bound.law}; without it"
    else:
        change = f"; with a range {100 * WIDER:g} % wider"
    better = bound.without
    cost = f"{money(better.cost)} {unit} a part{better.mark}"
    return f"{bound.limit}{bound.joint}, rules out a cheaper cut{change} {better.where}: {cost}"


def _margins(allowed: Allowed, scenario: Scenario) -> Iterator[str]:
    """Yield sentences on how far loads stay below their limits, so that bars and edges may vary."""
    below = []
    for name, factor in allowed.overload_factors.items():
        if factor < 0.995:  # else it would print as 100 %
            below.append(f"{100 * factor:.0f} % of limits.{name}")
    if below:
        share = 100 * scenario.limits.overload_allowance
        yield (
            f"loads of a nominal bar stay below {' and '.join(below)}: "
            f"bars vary, and {share:g} % of the time may be in severe overload"
        )
    if allowed.by_strength:
        yield (
            f"thrust of a nominal bar stays below {allowed.thrust_force:.0f} N: "
            f"half of the edges break at {scenario.tool.edge_strength:g} N, tool.edge_strength, "
            "and bars and edges vary"
        )


def money(value: float) -> str:
    """Return an amount of money with two decimals, or with three digits if it is below 1."""
    return f"{value:.2f}" if abs(value) >= 1 else f"{value:.3g}"


def summary(
    scenario: Scenario, evidence: Evidence, advice: list[Advice], units: Units = METRIC
) -> Iterator[str]:
    """Yield lines of text: the jobs and prices, the recommendation, and a table of all advice."""
    for line in _sentences(scenario, evidence, advice):
        yield units.text(line)
    yield from advice_table(scenario, advice, units)


def _sentences(scenario: Scenario, evidence: Evidence, advice: list[Advice]) -> Iterator[str]:
    """Yield the lines of a summary before its table, in metric units."""
    prices = Prices.of(scenario)
    work = scenario.workpiece
    yield (
        f"{scenario.name}: bars of {work.diameter:g} mm diameter, {work.bar_length:g} mm long, "
        f"{work.depth_of_cut:g} mm deep; edges worn out at {scenario.tool.wear_criterion:g} mm"
    )
    yield (
        f"a minute costs {prices.minute:.3g} {prices.unit}, "
        f"an edge {prices.edge:.3g} {prices.unit}; a change takes {prices.change_time:g} min"
    )
    yield ""
    yield from headline(scenario, evidence, advice)
    yield ""


def advice_table(scenario: Scenario, advice: list[Advice], units: Units = METRIC) -> Iterator[str]:
    """Yield the lines of a table of all advice, with units."""
    heads = {
        "speed": "m/min",
        "feed": "mm/rev",
        "change after": "parts",
        "or at wear": "mm",
        "tool life": "min",
        "thrust": "N",
        "power": "kW",
        "cycle": "min",
        "mean MRR": "cm3/min",
        "cost per part": Prices.of(scenario).unit,
    }
    rows = [["", *heads], ["", *map(units.name, heads.values())]]
    rows.extend(_row(entry, units) for entry in advice)
    yield from aligned(rows)


def _life_cell(best: PartPlan) -> str:
    """Return the tool life of a plan with its interval, for people."""
    if not best.by_wear:
        return "not by wear"
    text = f"{best.cuts.tool_life:.1f}"
    low = best.prediction.low["tool_life"]
    high = best.prediction.high["tool_life"]
    return f"{text} ({low:.1f}-{high:.1f})" if np.isfinite(low) else text


def _row(advice: Advice, units: Units) -> list[str]:
    """Return the cells of an advice in the table of ``summary``."""
    best = advice.plan
    cuts = best.cuts
    return [
        advice.aim,
        units.cell(float(cuts.cutting_speed), "m/min", ".4g"),
        units.cell(float(cuts.feed), "mm/rev", ".4g"),
        short(float(best.parts)),
        units.cell(float(cuts.wear), "mm", ".3g"),
        _life_cell(best),
        units.cell(float(cuts.thrust_force), "N", ".0f"),
        units.cell(float(cuts.power), "kW", ".1f"),
        f"{best.cycle_time:.2f}",
        units.cell(float(best.mean_removal_rate), "cm3/min", ".1f"),
        money(best.cost) + best.mark,
    ]
