"""Cutting speed and feed from two active limits, or at the economic optimum.

A rule of Sharmazanashvili (2008) such as [PV] names two limits that are reached together and so fix
cutting speed and feed. The limits are P thrust force, N power, M torque, V the machine's highest
cutting speed, S its highest feed, and T the economic life of the edge along the other limit. In the
logarithms of cutting speed and feed, every limit is a straight line, so a rule is two linear
equations.

A scenario may limit radial force, torque and roughness, too. Where radial force is tighter, it
takes the place of P, roughness that of S; torque is M. A rule's point may be out of reach. Two
steps correct it:

1. If the feed is outside the machine's range, it is set to the end of the range, and the cutting
   speed to the highest that the rule's two limits allow. Then the same is done with the cutting
   speed and the feed exchanged.
2. If force, power or a further limit is exceeded, the feed is lowered; if the lowest feed does not
   suffice, the cutting speed is lowered. A force that falls with rising cutting speed, as with
   709M40, may still be exceeded.

On logarithmic scales the search is exact, since it compares the points where two lines cross. The
cheapest point of a grid of 20 x 20 costs 5 % more (``python -m research.studies.searches``).

With 709M40 on the presets' lathe, many rules coincide (docs/controllers.md), so the catalogue has
one of each kind; ``set_point`` knows all. Uses from the nominal model: the laws of wear, force and
power, the exponents of limited responses, and prices.
"""

from functools import partial, reduce
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baselines.fixed import FixedParameters
from baselines.models.process import ALIKE, Limit, LimitLine, Process, Scales
from baselines.rule import Array, Mask, Rule, TuningRange
from turning_env import PowerLaw, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.numerics.functions import exp, log
from turning_env.policy import Actions, Observations, Policy

TWO_LIMITS = ("PV", "SV", "PT", "ST", "SN", "PN", "MV", "MN", "MT")  # the paper's rules
ECONOMIC_OPTIMUM = "economic_optimum"
"""Name of the point of least cost within force, power and the machine's ranges."""
MIN_DEPTH = 1e-6  # depth of cut in place of 0 [mm]
FURTHER = {"P": "radial_force", "S": "roughness"}
"""Further limits that replace a rule's first limit if they are tighter."""

_CUTTING_SPEED = PowerLaw(coefficient=1.0, cutting_speed=1.0)
_FEED = PowerLaw(coefficient=1.0, feed=1.0)

Lines = tuple[LimitLine, ...]
LogPoint = tuple[Array, Array]  # log cutting speed [log m/min] and log feed [log mm/rev]


class CutConditions(NamedTuple):
    """Conditions of the cut, which broadcast."""

    depth_of_cut: ArrayLike  # [mm], above 0
    hardness: ArrayLike  # over the nominal [-], above 0
    wear: ArrayLike  # flank wear [mm], above 0


class LimitPair(NamedTuple):
    """Two limits that fix a point."""

    name: str
    other_name: str
    limit: Limit
    other_limit: Limit


class Optimum(NamedTuple):
    """The economic optimum; arrays of one shape."""

    log_speed: Array  # [log m/min]
    log_feed: Array  # [log mm/rev]
    pair: NDArray[np.int64]
    """Place in ``_pairs`` of the limits that fix the point, or the number of pairs if none do."""


def limits(rule: str, process: Process) -> tuple[Limit, Limit]:
    """Return the two limits of a rule, such as thrust force and highest speed of "PV".

    Args:
        rule: two letters, one of ``TWO_LIMITS``. The second may be T, the economic life of the edge
            along the first limit.
        process: laws and limits.

    Raises:
        ValueError: the rule is unknown, or with these laws its limits fix no point.
    """
    if rule not in TWO_LIMITS:
        known = f"{', '.join(TWO_LIMITS)} and {ECONOMIC_OPTIMUM}"
        raise ValueError(f"no rule is called {rule!r}; there are {known}")
    _, max_speed = process.cutting_speed_range
    _, max_feed = process.feed_range
    limit_of = {
        "P": process.thrust_force,
        "N": process.power,
        "M": process.torque,
        "V": Limit(_CUTTING_SPEED, max_speed),
        "S": Limit(_FEED, max_feed),
    }
    first_letter = rule[0]
    second_letter = rule[1]
    first = limit_of[first_letter]
    second = process.life_limit(first) if second_letter == "T" else limit_of[second_letter]
    if first.parallel(second):
        raise ValueError(
            f"[{rule}] fixes no point: "
            "cutting speed and feed enter its two limits in the same proportion"
        )
    return first, second


def set_point(
    rule: str,
    process: Process,
    depth_of_cut: ArrayLike,
    hardness: ArrayLike = 1.0,
    wear: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Return the cutting speed [m/min] and feed [mm/rev] of a rule.

    Args:
        rule: one of ``TWO_LIMITS``, or ``ECONOMIC_OPTIMUM``.
        process: laws and limits.
        depth_of_cut: depth of cut [mm], 0 or more.
        hardness: relative hardness [-], above 0.
        wear: flank wear at which the limits hold [mm], above 0; None: the mean over the edge's
            life.

    Returns:
        Arrays of the shape to which the arguments broadcast.

    Raises:
        ValueError: the rule is unknown, or with these laws its limits fix no point.
    """
    cut = CutConditions(
        depth_of_cut=np.maximum(depth_of_cut, MIN_DEPTH),
        hardness=hardness,
        wear=process.mean_wear if wear is None else wear,
    )
    lines = _limit_lines(process, cut)
    if rule == ECONOMIC_OPTIMUM:
        optimum = _cheapest(process, lines, cut)
        log_speed, log_feed = optimum.log_speed, optimum.log_feed
    else:
        log_speed, log_feed = _point_of_rule(rule, process, cut)
    log_speed, log_feed = _within_force_and_power(process, lines, (log_speed, log_feed))
    speed = np.clip(exp(log_speed), *process.cutting_speed_range)
    feed = np.clip(exp(log_feed), *process.feed_range)
    return speed, feed


def _point_of_rule(rule: str, process: Process, cut: CutConditions) -> LogPoint:
    """Return the point at which both limits of a rule are reached, or that nearest in range.

    ``rule`` is one of ``TWO_LIMITS``. The point lies within the machine's ranges.
    """
    first_limit, second_limit = limits(rule, process)
    # A line: exponent of speed * log speed + exponent of feed * log feed = room.
    first = first_limit.line(*cut)
    second = second_limit.line(*cut)
    # A radial force takes the place of P, a roughness that of S, where it is tighter.
    further_name = FURTHER.get(rule[0], "")
    further = process.further.get(further_name)
    if further is not None and first.cutting_speed == 0.0:
        # Both limit the feed alone; the tighter one holds.
        further_line = further.line(*cut)
        first_feed = first.room / first.feed
        further_feed = further_line.room / further_line.feed
        first = LimitLine(
            cutting_speed=0.0,
            feed=1.0,
            room=np.minimum(first_feed, further_feed),
        )
    point = first.crossing(second)
    return _within_ranges(process, (first, second), point)


def _limit_lines(process: Process, cut: CutConditions) -> Lines:
    """Return the lines of force, power and further limits."""
    held = (process.thrust_force, process.power, *process.further.values())
    return tuple(limit.line(*cut) for limit in held)


def binding(process: Process, depth_of_cut: ArrayLike, hardness: ArrayLike) -> NDArray[np.str_]:
    """Return the pair of limits that fixes the economic optimum, such as "P_y V".

    T is the economic life along the other limit. V_min and S_min are the lowest speed and feed. The
    pair is "" if no speed and feed keep all limits. Depth of cut [mm] and relative hardness [-] are
    above 0.
    """
    cut = CutConditions(depth_of_cut, hardness, wear=process.mean_wear)
    optimum = _cheapest(process, _limit_lines(process, cut), cut)
    names = []
    for pair in _pairs(process):
        # Machine and life are named last: "NVT".find is -1 for the other names.
        ordered = sorted((pair.name, pair.other_name), key="NVT".find)
        names.append(" ".join(ordered))
    names.append("")
    return np.array(names)[optimum.pair]


def _pairs(process: Process) -> list[LimitPair]:
    """Return the pairs of limits that fix a point."""
    slowest, fastest = process.cutting_speed_range
    lowest, highest = process.feed_range
    bounds = {
        "P_z": process.thrust_force,
        "N": process.power,
        "V_min": Limit(_CUTTING_SPEED, slowest),
        "V": Limit(_CUTTING_SPEED, fastest),
        "S_min": Limit(_FEED, lowest),
        "S": Limit(_FEED, highest),
    }
    letters = {"radial_force": "P_y", "torque": "M", "roughness": "R_z"}
    for name, limit in process.further.items():
        bounds[letters[name]] = limit
    pairs = []
    for (name, limit), (other_name, other_limit) in combinations(bounds.items(), 2):
        pairs.append(LimitPair(name, other_name, limit=limit, other_limit=other_limit))
    for name, limit in bounds.items():
        pairs.append(LimitPair(name, "T", limit=limit, other_limit=process.life_limit(limit)))
    return [pair for pair in pairs if not pair.limit.parallel(pair.other_limit)]


def _within_ranges(
    process: Process, lines: tuple[LimitLine, LimitLine], point: LogPoint
) -> LogPoint:
    """Return a rule's point within the machine's ranges; step 1 of the module's description.

    Feed, then cutting speed, is clipped to its range; the other one is set to the highest that both
    lines allow with it. Points are logarithms [log m/min], [log mm/rev].
    """
    first, second = lines
    log_speed, log_feed = point
    slowest, fastest = log(process.cutting_speed_range)
    lowest, highest = log(process.feed_range)

    feed = np.clip(log_feed, lowest, highest)
    first_speed = first.highest_cutting_speed(feed)
    second_speed = second.highest_cutting_speed(feed)
    at_feed = np.minimum(first_speed, second_speed)
    log_speed = np.where(feed == log_feed, log_speed, at_feed)

    speed = np.clip(log_speed, slowest, fastest)
    first_feed = first.highest_feed(speed)
    second_feed = second.highest_feed(speed)
    at_speed = np.minimum(first_feed, second_feed)
    feed = np.where(speed == log_speed, feed, at_speed)
    return speed, np.clip(feed, lowest, highest)


def _within_force_and_power(process: Process, lines: Lines, point: LogPoint) -> LogPoint:
    """Return a point lowered until all lines allow it; step 2 of the module's description.

    The feed is lowered first, then the cutting speed, down to the machine's lowest. Points are
    logarithms [log m/min], [log mm/rev].
    """
    log_speed, log_feed = point
    min_speed, _ = process.cutting_speed_range
    min_feed, _ = process.feed_range
    slowest = log(min_speed)
    lowest = log(min_feed)
    feeds = [line.highest_feed(log_speed) for line in lines]
    wanted = np.minimum(log_feed, reduce(np.minimum, feeds))
    feed = np.maximum(wanted, lowest)

    # Where the lowest feed is too high, the speed falls.
    speeds = [line.highest_cutting_speed(feed) for line in lines]
    at_feed = reduce(np.minimum, speeds)
    slower = np.maximum(np.minimum(log_speed, at_feed), slowest)
    return np.where(wanted < feed, slower, log_speed), feed


def _cheapest(process: Process, lines: Lines, cut: CutConditions) -> Optimum:
    """Return the economic optimum, or the highest speed and lowest feed if no point is feasible.

    On logarithmic scales, the cost is convex and all limits are lines. So the optimum is where two
    lines cross, or where the life along a line is its economic life.
    """
    slowest, fastest = log(process.cutting_speed_range)
    lowest, highest = log(process.feed_range)
    points = []
    for pair in _pairs(process):
        line = pair.limit.line(*cut)
        other_line = pair.other_limit.line(*cut)
        points.append(line.crossing(other_line))
    points.append((fastest, lowest))
    shapes = [line.room.shape for line in lines]
    shapes += [np.shape(value) for value in cut]
    shape = np.broadcast_shapes(*shapes)
    speeds = np.stack([np.broadcast_to(speed, shape) for speed, _ in points])
    feeds = np.stack([np.broadcast_to(feed, shape) for _, feed in points])

    feasible = (speeds >= slowest - ALIKE) & (speeds <= fastest + ALIKE)
    feasible &= (feeds >= lowest - ALIKE) & (feeds <= highest + ALIKE)
    for line in lines:
        used = line.cutting_speed * speeds + line.feed * feeds
        feasible &= used <= line.room + ALIKE
    costs = process.log_cost(
        np.clip(speeds, slowest, fastest),
        np.clip(feeds, lowest, highest),
        depth_of_cut=cut.depth_of_cut,
        hardness=cut.hardness,
    )
    costs = np.where(feasible, costs, np.inf)
    # The last resort beats infeasible points only.
    costs[-1] = np.minimum(costs[-1], np.finfo(np.float64).max)
    best = np.argmin(costs, axis=0)[np.newaxis]
    return Optimum(
        log_speed=np.take_along_axis(speeds, best, axis=0)[0],
        log_feed=np.take_along_axis(feeds, best, axis=0)[0],
        pair=best[0],
    )


class AdaptiveRule(Policy):
    """A policy that applies a rule in every step to rescaled models.

    Predictions and limits use nominal wear, depth and hardness. Scales of measured over predicted
    force and power absorb the deviations.

    Args:
        scenario: nominal model.
        num_envs: number of environments.
        rule: name of the rule of ``set_point``.
        margin: factor on the limits of force, power and torque [-].
        smoothing: weight of the newest ratio in a scale [-].
    """

    def __init__(
        self, scenario: Scenario, num_envs: int, rule: str, margin: float, smoothing: float
    ) -> None:
        self._scenario = scenario
        self._process = Process.of(scenario)
        self._rule = rule
        self._margin = margin
        self._scales = Scales(num_envs, smoothing)

    def reset(self, mask: Mask) -> None:
        self._scales.reset(mask)

    def act(self, observations: Observations) -> Actions:
        scenario = self._scenario
        process = self._process
        reading = read(observations, scenario)
        depth = scenario.workpiece.depth_of_cut
        speed, feed = reading.cutting_speed, reading.feed
        # A fresh edge counts with the wear after one control interval: without wear, no limit would
        # apply.
        first_wear = process.wear(speed, feed, depth, time=scenario.control.interval / 60.0)
        wear = np.maximum(reading.nominal_wear, first_wear)
        force = process.thrust_force.law(speed, feed, depth, wear=wear)
        power = process.power.law(speed, feed, depth, wear=wear)
        force_scale, power_scale = self._scales.follow(
            reading.cutting & (reading.power > 0),
            force_ratio=reading.thrust_force / force,
            power_ratio=reading.power / power,
        )
        rescaled = process.rescaled(force_scale / self._margin, power_scale / self._margin)
        best_speed, best_feed = set_point(self._rule, rescaled, depth, wear=wear)
        return towards(reading, scenario, best_speed, best_feed)


def _plays(rule: str, scenario: Scenario) -> bool:
    try:
        limits(rule, Process.of(scenario))
    except ValueError:
        return False
    return sets_speed_and_feed(scenario)


def _fixed_at_rule(scenario: Scenario, num_envs: int, rule: str) -> FixedParameters:
    speed, feed = set_point(rule, Process.of(scenario), scenario.workpiece.depth_of_cut)
    return FixedParameters(scenario, speed, feed)


RULES = {}
for _rule in ("PV", "SN", "PN"):
    RULES[f"rule_{_rule.lower()}"] = Rule(
        f"rule [{_rule}] of Sharmazanashvili (2008) on nominal models at mean wear",
        partial(_fixed_at_rule, rule=_rule),
        plays=partial(_plays, _rule),
        parameters={},
        published=True,
    )
for _rule in ("PV", "SN", "PN"):
    RULES[f"adaptive_{_rule.lower()}"] = Rule(
        f"rule [{_rule}] of Sharmazanashvili (2008) in real time, "
        "on models rescaled by measured force and power, with a margin",
        partial(AdaptiveRule, rule=_rule),
        plays=partial(_plays, _rule),
        parameters={"margin": TuningRange(0.80, 1.05), "smoothing": TuningRange(0.05, 1.0)},
        worth_tuning=_rule == "PN",
        published=True,
    )
