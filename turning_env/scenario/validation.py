"""Check that the sections of a scenario agree, and the range of its laws, so that the simulation need not check.

Laws with extreme exponents give numbers that overflow in sums and quotients.
"""

import math
from collections.abc import Iterator
from operator import attrgetter
from typing import TYPE_CHECKING

from turning_env.scenario.power_law import PowerLaw
from turning_env.scenario.sections import MAX_DELAY

if TYPE_CHECKING:
    from turning_env.scenario import Scenario

MAX_DIGITS = 100  # responses, and rates of used tool life [1/min], are at most 10 to this power
MIN_DIGITS = 280  # responses are at least 1 over 10 to this power

_SPREADS = 10.0  # largest deviation from the mean in standard deviations
_MIN_DEPTH = 1e-6  # [mm], as in the transition
_MIN_LOG_LIFE = math.log(1e-300)  # of used tool life [-], as in the transition

_FURTHER = ("limits.radial_force", "limits.torque", "limits.roughness")
_LEFT_OUT = {
    "material.wear": ("wear", "is that of a fresh edge"),
    **dict.fromkeys(
        ("material.thrust_force", "material.power", "edge_failure.temperature"),
        ("time", "has time through wear"),
    ),
    **dict.fromkeys(
        _FURTHER, ("cutting_speed time wear", "depends on feed, depth of cut and hardness")
    ),
}
"""Exponents that laws leave out, and why."""

Span = tuple[float, float]  # lowest and highest natural logarithm


def complaints(s: "Scenario") -> Iterator[str]:
    """Yield a complaint for each value that does not fit the others."""
    control, machine, spindle = s.control, s.machine, s.spindle
    for name in ("cutting_speed", "feed"):
        start, low, high = (
            getattr(control, f"initial_{name}"),
            getattr(machine, f"{name}_min"),
            getattr(machine, f"{name}_max"),
        )
        if not low <= start <= high or low == high:
            yield f"control.initial_{name} is {start}, but must lie in the machine's {low} to {high} (not equal)"
    start, reached = control.initial_cutting_speed, s.cutting_speed_max
    if start > reached:
        by = f"spindle.max_speed, {spindle.max_speed}, reaches at workpiece.diameter, {s.workpiece.diameter}"
        yield f"control.initial_cutting_speed is {start}, but must be at most {reached:.4g} m/min, which {by}"
    torque = 30.0 * s.workpiece.diameter * s.limits.power / max(reached, s.base_cutting_speed)
    if spindle.idle_torque >= torque:
        by = f"limits.power, {s.limits.power}, comes at the highest cutting speed"
        yield f"spindle.idle_torque is {spindle.idle_torque}, but must be below {torque:.4g} N m, to which {by}"
    wear, criterion = s.mismatch.initial_wear, s.tool.wear_criterion
    if wear >= criterion:
        yield f"mismatch.initial_wear is {wear}, but must be below tool.wear_criterion, which is {criterion}"
    if control.time_limit * 60 < control.interval:
        yield f"control.time_limit is {control.time_limit} min, but must be at least one step of {control.interval} s"
    if (
        control.action == "override"
        and control.initial_feed * control.override_max > machine.feed_max * (1 + 1e-9)
    ):
        asked = f"{control.initial_feed} mm/rev times control.override_max, {control.override_max}"
        yield f"control.initial_feed is {asked}: above machine.feed_max, {machine.feed_max}"
    if (
        machine.command_delay > MAX_DELAY * control.interval * (1 + 1e-9)
        and control.action != "part"
    ):
        most = f"{MAX_DELAY} times control.interval, which is {control.interval} s"
        yield f"machine.command_delay is {machine.command_delay} s, but must be at most {most}"
    if control.action == "part":
        lags = (
            "machine.feed_time_constant",
            "machine.spindle_time_constant",
            "machine.chip_lag",
            "machine.command_delay",
        )
        for name in (*lags, "sensors.power_time_constant", "sensors.force_time_constant"):
            if (lag := attrgetter(name)(s)) != 0:
                yield f"{name} is {lag}, but passes of whole parts are cut without lags: only 0"
        if s.workpiece.bars == 0 or control.edge_changes != "automatic":
            needs = 'control.action "part" needs workpiece.bars of 1 or more and control.edge_changes "automatic"'
            yield f"{needs}, but they are {s.workpiece.bars} and {control.edge_changes!r}"
    elif s.sensors.probe:
        yield 'sensors.probe is true, but blanks are only probed where control.action is "part"'
    if s.sensors.inspects_edges and control.edge_changes == "end":
        yield 'sensors.inspects_edges is true, but no edge is taken out where control.edge_changes is "end"'
    if not 1 <= len(s.economics.currency) <= 8 or not s.economics.currency.isprintable():
        yield f"economics.currency is {s.economics.currency!r}, but must have 1 to 8 printable characters"
    for name, (left_out, why) in _LEFT_OUT.items():
        for factor in left_out.split():
            if (exponent := attrgetter(f"{name}.{factor}")(s)) != 0:
                yield f"{name}.{factor} is {exponent}, but this law {why} alone: only 0"
    for name in _FURTHER:
        limit = attrgetter(name)(s)
        if limit.bounds and limit.feed <= 0:
            yield f"{name}.feed is {limit.feed}, but a further limit must bound the feed: above 0, to 10"
    if s.material.wear.time <= 0:
        yield f"material.wear.time is {s.material.wear.time}, but wear must grow with time: above 0, to 10"
    else:
        yield from _laws_out_of_range(s)


def _laws_out_of_range(scenario: "Scenario") -> Iterator[str]:
    """Yield a complaint for each law that gives too large or too small numbers within the scenario's ranges."""
    material, tool, machine = scenario.material, scenario.tool, scenario.machine
    workpiece, control, mismatch = scenario.workpiece, scenario.control, scenario.mismatch
    hardness_spread = _SPREADS * (workpiece.hardness_bar_spread + workpiece.hardness_along_spread)
    deepest = max(workpiece.depth_of_cut, *workpiece.depth_profile, 0.0) * (
        1.0 + workpiece.depth_ripple
    )
    deepest += _SPREADS * (workpiece.depth_bar_spread + workpiece.depth_along_spread)
    hardest = mismatch.hardness_factor * max(mismatch.skin_hardness, 1.0)
    factors = {
        "cutting_speed": _span(machine.cutting_speed_min, machine.cutting_speed_max),
        "feed": _span(machine.feed_min, machine.feed_max),
        "depth_of_cut": _span(_MIN_DEPTH, deepest + _MIN_DEPTH),
        "hardness": _span(mismatch.hardness_factor, hardest, hardness_spread),
    }
    wear_factor = mismatch.wear_factor * max(mismatch.skin_wear, 1.0)
    own = _span(mismatch.wear_factor, wear_factor, _SPREADS * tool.wear_factor_spread)
    fresh = tuple(a + b for a, b in zip(_log_span(material.wear, factors), own, strict=True))
    criterion, exponent = math.log(tool.wear_criterion), material.wear.time
    tertiary = scenario.edge_failure.tertiary_rate * max(
        tool.wear_criterion - scenario.edge_failure.tertiary_wear, 0.0
    )
    rate = (fresh[0] - criterion) / exponent, (fresh[1] - criterion) / exponent + tertiary
    yield from _judged("material.wear", "tool lives per minute", -math.inf, rate[1])

    slowest = (
        1000.0 * machine.cutting_speed_min / (math.pi * workpiece.diameter)
    )  # spindle speed [rev/min]
    longest = max(control.interval / 60.0, workpiece.bar_length / (machine.feed_min * slowest))
    most_life = math.log(2.0) + max(0.0, rate[1] + math.log(longest))
    least_life = max(_MIN_LOG_LIFE, rate[0] + math.log(control.interval / 60.0 / control.sub_steps))
    for name, unit in (("thrust_force", "N"), ("power", "kW")):
        law = getattr(material, name)
        wear = criterion + exponent * _MIN_LOG_LIFE, criterion + exponent * most_life
        _, most = _log_span(law, factors | {"wear": wear})
        least, _ = _log_span(
            law, factors | {"wear": (criterion + exponent * min(least_life, 0.0), wear[1])}
        )
        yield from _judged(f"material.{name}", unit, least, most)
    for name in _FURTHER:
        yield from _judged(name, "", *_log_span(attrgetter(name)(scenario), factors))


def _judged(name: str, unit: str, least: float, most: float) -> Iterator[str]:
    digits = most / math.log(10.0) if most > MAX_DIGITS * math.log(10.0) else least / math.log(10.0)
    if digits > MAX_DIGITS or -math.inf < digits < -MIN_DIGITS:
        allowed = f"1e-{MIN_DIGITS} to 1e{MAX_DIGITS}"
        yield f"{name} comes to 1e{digits:.0f} {unit} within the scenario's ranges, but may come to {allowed} only"


def _log_span(law: PowerLaw, factors: dict[str, Span]) -> Span:
    low = high = math.log(law.coefficient) - law.depth_of_cut * math.log(law.reference_depth_of_cut)
    for name, (least, most) in factors.items():
        ends = sorted((getattr(law, name) * least, getattr(law, name) * most))
        low, high = low + ends[0], high + ends[1]
    return low, high


def _span(low: float, high: float, margin: float = 0.0) -> Span:
    return math.log(low) - margin, math.log(high) + margin
