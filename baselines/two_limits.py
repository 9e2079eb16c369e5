"""Cutting speed and feed from two active limits, or at the economic optimum (Sharmazanashvili 2008).

A rule such as [PV] names two limits that are reached together and so fix cutting speed and feed. The limits are P thrust force,
N power, M torque, V the machine's highest cutting speed, S its highest feed, and T the economic life of the edge along the other
limit. In the logarithms of cutting speed and feed, every limit is a straight line, so a rule is two linear equations.

A scenario may limit radial force, torque and roughness, too. Where radial force is tighter, it takes the place of P, roughness
that of S; torque is M. A rule's point may be out of reach. Two steps correct it:

1. If the feed is outside the machine's range, it is set to the end of the range, and the cutting speed to the highest that the
   rule's two limits allow. Then the same is done with the cutting speed and the feed exchanged.
2. If force, power or a further limit is exceeded, the feed is lowered; if the lowest feed does not suffice, the cutting speed is
   lowered. A force that falls with rising cutting speed, as with 709M40, may still be exceeded.

With 709M40 on the presets' lathe, many rules coincide (docs/controllers.md), so the catalogue has one of each kind; ``set_point``
knows all. It needs of the nominal model: the laws of wear, force and power, the exponents of limited responses, and prices.
"""

from functools import partial, reduce
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baselines.fixed import FixedParameters
from baselines.models.process import ALIKE, Limit, Line, Process, Scales
from baselines.rule import Array, Mask, Range, Rule
from turning_env import PowerLaw, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.numerics.functions import exp, log
from turning_env.scoring.policy import Actions, Observations, Policy

TWO_LIMITS = ("PV", "SV", "PT", "ST", "SN", "PN", "MV", "MN", "MT")  # the paper's rules
ECONOMIC_OPTIMUM = "economic_optimum"  # name of the point of least cost within force, power and the machine's ranges

Cut = tuple[
    ArrayLike, ArrayLike, ArrayLike
]  # depth of cut [mm], relative hardness [-] and flank wear [mm]
Lines = tuple[Line, ...]
_CUTTING_SPEED, _FEED = (
    PowerLaw(coefficient=1.0, cutting_speed=1.0),
    PowerLaw(coefficient=1.0, feed=1.0),
)

MIN_DEPTH = 1e-6  # depth of cut in place of 0 [mm]
FURTHER = {
    "P": "radial_force",
    "S": "roughness",
}  # further limits that replace a rule's first limit if they are tighter


def limits(rule: str, process: Process) -> tuple[Limit, Limit]:
    """Return the two limits of a rule; ValueError if it is unknown, or with these laws its limits fix no point."""
    if rule not in TWO_LIMITS:
        raise ValueError(
            f"no rule is called {rule!r}; there are {', '.join(TWO_LIMITS)} and {ECONOMIC_OPTIMUM}"
        )
    found = {
        "P": process.thrust_force,
        "N": process.power,
        "M": process.torque,
        "V": Limit(_CUTTING_SPEED, process.cutting_speed_range[1]),
        "S": Limit(_FEED, process.feed_range[1]),
    }
    first = found[rule[0]]
    second = process.life_limit(first) if rule[1] == "T" else found[rule[1]]
    if first.parallel(second):
        raise ValueError(
            f"[{rule}] fixes no point: cutting speed and feed enter its two limits in the same proportion"
        )
    return first, second


def set_point(
    rule: str,
    process: Process,
    depth_of_cut: ArrayLike,
    hardness: ArrayLike = 1.0,
    wear: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Return the cutting speed [m/min] and feed [mm/rev] of a rule, of the shape to which the arguments broadcast.

    ``rule``: one of ``TWO_LIMITS``, or ``ECONOMIC_OPTIMUM``; ValueError if it is unknown, or with these laws its limits fix no
    point. Depth of cut [mm] is 0 or more, relative hardness [-] above 0. The limits hold at the flank wear [mm], above 0; by
    default it is the mean over the edge's life.
    """
    cut = (
        np.maximum(depth_of_cut, MIN_DEPTH),
        hardness,
        process.mean_wear if wear is None else wear,
    )
    held = _held(process, cut)
    if rule == ECONOMIC_OPTIMUM:
        log_speed, log_feed, _ = _cheapest(process, held, cut)
    else:
        first, second = (limit.line(*cut) for limit in limits(rule, process))
        further = process.further.get(FURTHER.get(rule[0], ""))
        if further is not None and first.cutting_speed == 0.0:
            other = further.line(*cut)
            first = Line(0.0, 1.0, np.minimum(first.room / first.feed, other.room / other.feed))
        log_speed, log_feed = _within_ranges(process, (first, second), *first.crossing(second))
    log_speed, log_feed = _within_force_and_power(process, held, log_speed, log_feed)
    return np.clip(exp(log_speed), *process.cutting_speed_range), np.clip(
        exp(log_feed), *process.feed_range
    )


def _held(process: Process, cut: Cut) -> Lines:
    return tuple(
        limit.line(*cut)
        for limit in (process.thrust_force, process.power, *process.further.values())
    )


def binding(process: Process, depth_of_cut: ArrayLike, hardness: ArrayLike) -> NDArray[np.str_]:
    """Return the pair of limits that fixes the economic optimum, such as "P_y V"; "" if no speed and feed keep all limits.

    T is the economic life along the other limit. V_min and S_min are the lowest speed and feed. Depth of cut [mm] and relative
    hardness [-] are above 0.
    """
    cut = (depth_of_cut, hardness, process.mean_wear)
    _, _, pair = _cheapest(process, _held(process, cut), cut)
    return np.array(
        [*(" ".join(sorted(names, key="NVT".find)) for names, _, _ in _pairs(process)), ""]
    )[pair]


def _pairs(process: Process) -> list[tuple[tuple[str, str], Limit, Limit]]:
    """Return the pairs of limits that fix a point, and their names."""
    (slowest, fastest), (least, most) = process.cutting_speed_range, process.feed_range
    bounds = {"P_z": process.thrust_force, "N": process.power}
    bounds |= {"V_min": Limit(_CUTTING_SPEED, slowest), "V": Limit(_CUTTING_SPEED, fastest)}
    bounds |= {"S_min": Limit(_FEED, least), "S": Limit(_FEED, most)}
    bounds |= {
        {"radial_force": "P_y", "torque": "M", "roughness": "R_z"}[name]: each
        for name, each in process.further.items()
    }
    lives = [(bound, ("T", process.life_limit(bound[1]))) for bound in bounds.items()]
    pairs = [*combinations(bounds.items(), 2), *lives]
    return [
        ((name, another), one, other)
        for (name, one), (another, other) in pairs
        if not one.parallel(other)
    ]


def _within_ranges(
    process: Process, lines: Lines, log_speed: Array, log_feed: Array
) -> tuple[Array, Array]:
    """Apply step 1 of the module's description."""
    feed = np.clip(log_feed, *log(process.feed_range))
    at_feed = np.minimum(*(line.highest_cutting_speed(feed) for line in lines))
    log_speed = np.where(feed == log_feed, log_speed, at_feed)
    speed = np.clip(log_speed, *log(process.cutting_speed_range))
    at_speed = np.minimum(*(line.highest_feed(speed) for line in lines))
    return speed, np.clip(np.where(speed == log_speed, feed, at_speed), *log(process.feed_range))


def _within_force_and_power(
    process: Process, held: Lines, log_speed: Array, log_feed: Array
) -> tuple[Array, Array]:
    """Apply step 2 of the module's description."""
    wanted = np.minimum(
        log_feed, reduce(np.minimum, (line.highest_feed(log_speed) for line in held))
    )
    feed = np.maximum(wanted, log(process.feed_range[0]))
    at_feed = reduce(np.minimum, (line.highest_cutting_speed(feed) for line in held))
    slower = np.maximum(np.minimum(log_speed, at_feed), log(process.cutting_speed_range[0]))
    return np.where(wanted < feed, slower, log_speed), feed


def _cheapest(process: Process, held: Lines, cut: Cut) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return the log economic optimum, or log highest speed and lowest feed if no point keeps all limits, and its pair's place.

    On logarithmic scales, the cost is convex and all limits are lines. So the optimum is where two lines cross, or where the
    life along a line is its economic life.
    """
    slowest, fastest = log(process.cutting_speed_range)
    least, most = log(process.feed_range)
    points = [one.line(*cut).crossing(other.line(*cut)) for _, one, other in _pairs(process)] + [
        (fastest, least)
    ]
    shape = np.broadcast_shapes(
        *(line.room.shape for line in held), *(np.shape(value) for value in cut)
    )
    speeds, feeds = (
        np.stack([np.broadcast_to(point[axis], shape) for point in points]) for axis in (0, 1)
    )
    feasible = (
        (speeds >= slowest - ALIKE)
        & (speeds <= fastest + ALIKE)
        & (feeds >= least - ALIKE)
        & (feeds <= most + ALIKE)
    )
    for line in held:
        feasible &= line.cutting_speed * speeds + line.feed * feeds <= line.room + ALIKE
    costs = process.log_cost(
        np.clip(speeds, slowest, fastest), np.clip(feeds, least, most), cut[0], cut[1]
    )
    costs = np.where(feasible, costs, np.inf)
    costs[-1] = np.minimum(
        costs[-1], np.finfo(np.float64).max
    )  # the last resort beats infeasible points only
    best = np.argmin(costs, axis=0)[np.newaxis]
    return (
        np.take_along_axis(speeds, best, axis=0)[0],
        np.take_along_axis(feeds, best, axis=0)[0],
        best[0],
    )


class AdaptiveRule(Policy):
    """A policy that applies a rule in every step to models rescaled by measured over predicted force and power.

    Predictions and limits use nominal wear, depth and hardness; the scales absorb the deviations. ``margin``: factor on the
    limits of force, power and torque [-]; ``smoothing``: weight of the newest ratio in a scale [-].
    """

    def __init__(
        self, scenario: Scenario, num_envs: int, rule: str, margin: float, smoothing: float
    ) -> None:
        self._scenario, self._process, self._rule = scenario, Process.of(scenario), rule
        self._margin, self._scales = margin, Scales(num_envs, smoothing)

    def reset(self, mask: Mask) -> None:
        self._scales.reset(mask)

    def act(self, observations: Observations) -> Actions:
        reading, depth = read(observations, self._scenario), self._scenario.workpiece.depth_of_cut
        setting = reading.cutting_speed, reading.feed, depth
        # A fresh edge counts with the wear after one control interval: without wear, no limit would apply.
        wear = np.maximum(
            reading.nominal_wear,
            self._process.wear(*setting, time=self._scenario.control.interval / 60.0),
        )
        force, power = (
            limit.law(*setting, wear=wear)
            for limit in (self._process.thrust_force, self._process.power)
        )
        measured = reading.cutting & (reading.power > 0)
        scales = self._scales.follow(measured, reading.thrust_force / force, reading.power / power)
        used = (scale / self._margin for scale in scales)
        return towards(
            reading,
            self._scenario,
            *set_point(self._rule, self._process.rescaled(*used), depth, wear=wear),
        )


def _plays(rule: str, scenario: Scenario) -> bool:
    try:
        limits(rule, Process.of(scenario))
    except ValueError:
        return False
    return sets_speed_and_feed(scenario)


def _fixed(scenario: Scenario, num_envs: int, rule: str) -> FixedParameters:
    return FixedParameters(
        scenario, *set_point(rule, Process.of(scenario), scenario.workpiece.depth_of_cut)
    )


_RESCALED = "in real time, on models rescaled by measured force and power, with a margin"
_MARGINS = {"margin": Range(0.80, 1.05), "smoothing": Range(0.05, 1.0)}

RULES = {
    f"{kind}_{rule.lower()}": Rule(
        f"rule [{rule}] of Sharmazanashvili (2008) {how}",
        partial(controller, rule=rule),
        partial(_plays, rule),
        parameters,
        worth_tuning=rule == "PN" and controller is AdaptiveRule,
    )
    for kind, how, controller, parameters in (
        ("rule", "on nominal models at mean wear", _fixed, {}),
        ("adaptive", _RESCALED, AdaptiveRule, _MARGINS),
    )
    for rule in ("PV", "SN", "PN")
}
