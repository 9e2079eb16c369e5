"""Check that the sections of a scenario agree, so that the simulation need not check anything.

Ranges of single numbers are checked by ``section.py``. The largest and smallest responses of the
laws are bounded here, too: extreme exponents give numbers that overflow in sums and quotients.
"""

import math
from collections.abc import Iterator
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

from turning_env.numerics.conversions import spindle_speed_at
from turning_env.numerics.wear_term import log_wear_term
from turning_env.scenario.power_law import MIN_DEPTH, MIN_LIFE, PowerLaw
from turning_env.scenario.sections import MAX_DELAY

if TYPE_CHECKING:
    from turning_env.scenario import Scenario

MAX_DIGITS = 100  # responses, and rates of used tool life [1/min], are at most 10 to this power
MIN_DIGITS = 280  # responses are at least 1 over 10 to this power

_MAX_DEVIATIONS = 10.0  # largest deviation from the mean in standard deviations
_MIN_LOG_LIFE = math.log(MIN_LIFE)
_ROUNDING = 1 + 1e-9  # a product of numbers from a file may exceed its limit by rounding
_LOG_10 = math.log(10.0)

_FURTHER_LIMITS = ("limits.radial_force", "limits.torque", "limits.roughness")

_LAGS = (
    "machine.feed_time_constant",
    "machine.spindle_time_constant",
    "machine.chip_lag",
    "machine.command_delay",
    "sensors.power_time_constant",
    "sensors.force_time_constant",
)
"""Lags that passes of whole parts do not have."""


class _Absent(NamedTuple):
    """Exponents that a law does not have, and why."""

    law: str
    exponents: tuple[str, ...]
    reason: str


_ABSENT_EXPONENTS = (
    _Absent("material.wear", ("wear", "wear_growth"), "is that of a fresh edge"),
    _Absent("material.thrust_force", ("time",), "has time through wear"),
    _Absent("material.power", ("time",), "has time through wear"),
    _Absent("edge_failure.temperature", ("time",), "has time through wear"),
    _Absent("edge_failure.temperature", ("wear_growth",), "is a power of the wear"),
    *(
        _Absent(
            law,
            ("cutting_speed", "time", "wear", "wear_growth"),
            "depends on feed, depth of cut and hardness",
        )
        for law in _FURTHER_LIMITS
    ),
)


class Span(NamedTuple):
    """Lowest and highest natural logarithm of a factor or response."""

    low: float
    high: float


def complaints(scenario: "Scenario") -> Iterator[str]:
    """Yield a complaint for each value that does not fit the others."""
    yield from _start_complaints(scenario)
    yield from _torque_complaints(scenario)
    yield from _episode_complaints(scenario)
    yield from _part_complaints(scenario)
    yield from _edge_and_currency_complaints(scenario)
    yield from _holder_complaints(scenario)
    yield from _law_complaints(scenario)


def _start_complaints(scenario: "Scenario") -> Iterator[str]:
    """Complain of an initial speed or feed that the machine cannot run."""
    control = scenario.control
    spindle = scenario.spindle
    for name in ("cutting_speed", "feed"):
        start = getattr(control, f"initial_{name}")
        low = getattr(scenario.machine, f"{name}_min")
        high = getattr(scenario.machine, f"{name}_max")
        if low == high:
            yield f"machine.{name}_min must be below machine.{name}_max, but both are {low}"
        elif not low <= start <= high:
            yield (
                f"control.initial_{name} is {start}, but must lie in the machine's {low} to {high}"
            )
    start = control.initial_cutting_speed
    highest = scenario.cutting_speed_max
    if start > highest:
        yield (
            f"control.initial_cutting_speed is {start}, but must be at most {highest:.4g} m/min, "
            f"which spindle.max_speed, {spindle.max_speed}, "
            f"reaches at workpiece.diameter, {scenario.workpiece.diameter}"
        )


def _torque_complaints(scenario: "Scenario") -> Iterator[str]:
    """Complain of a spindle that needs all of the allowed power to idle."""
    highest_speed = max(scenario.cutting_speed_max, scenario.base_cutting_speed)
    # Power [kW] = torque [N m] * cutting speed [m/min] / (30 * diameter [mm]).
    torque = 30.0 * scenario.workpiece.diameter * scenario.limits.power / highest_speed
    idle_torque = scenario.spindle.idle_torque
    if idle_torque >= torque:
        yield (
            f"spindle.idle_torque is {idle_torque}, but must be below {torque:.4g} N m, "
            f"to which limits.power, {scenario.limits.power}, comes at the highest cutting speed"
        )


def _episode_complaints(scenario: "Scenario") -> Iterator[str]:
    """Complain of an episode that ends at once, and of commands that cannot be carried out."""
    control = scenario.control
    machine = scenario.machine
    wear = scenario.mismatch.initial_wear
    criterion = scenario.tool.wear_criterion
    if wear >= criterion:
        yield (
            f"mismatch.initial_wear is {wear}, "
            f"but must be below tool.wear_criterion, which is {criterion}"
        )
    if control.time_limit * 60 < control.interval:
        yield (
            f"control.time_limit is {control.time_limit} min, "
            f"but must be at least one step of {control.interval} s"
        )
    if control.action == "override":
        highest_feed = control.initial_feed * control.override_max
        if highest_feed > machine.feed_max * _ROUNDING:
            yield (
                f"control.initial_feed is {control.initial_feed} mm/rev times "
                f"control.override_max, {control.override_max}: "
                f"above machine.feed_max, {machine.feed_max}"
            )
    if control.action != "part":
        longest_delay = MAX_DELAY * control.interval
        if machine.command_delay > longest_delay * _ROUNDING:
            yield (
                f"machine.command_delay is {machine.command_delay} s, but must be at most "
                f"{MAX_DELAY} times control.interval, which is {control.interval} s"
            )


def _part_complaints(scenario: "Scenario") -> Iterator[str]:
    """Complain of values that do not go with passes of whole parts, or only go with them."""
    control = scenario.control
    bars = scenario.workpiece.bars
    if control.action != "part":
        if scenario.sensors.probe:
            yield (
                'sensors.probe is true, but blanks are only probed where control.action is "part"'
            )
        return
    for name in _LAGS:
        lag = attrgetter(name)(scenario)
        if lag != 0:
            yield f"{name} is {lag}, but passes of whole parts are cut without lags: only 0"
    if bars == 0 or control.edge_changes != "automatic":
        yield (
            'control.action "part" needs workpiece.bars of 1 or more and '
            f'control.edge_changes "automatic", but they are {bars} and {control.edge_changes!r}'
        )


def _edge_and_currency_complaints(scenario: "Scenario") -> Iterator[str]:
    if scenario.sensors.inspects_edges and scenario.control.edge_changes == "end":
        yield (
            "sensors.inspects_edges is true, but no edge is taken out "
            'where control.edge_changes is "end"'
        )
    currency = scenario.economics.currency
    if not 1 <= len(currency) <= 8 or not currency.isprintable():
        yield (f"economics.currency is {currency!r}, but must have 1 to 8 printable characters")


def _holder_complaints(scenario: "Scenario") -> Iterator[str]:
    """Complain of the overhang of a holder whose diameter is not stated."""
    tool = scenario.tool
    if tool.overhang > 0 and tool.shank_diameter <= 0:
        yield (
            f"tool.overhang is {tool.overhang}, "
            "but tool.shank_diameter, the diameter of its shank [mm], is not stated"
        )


def _law_complaints(scenario: "Scenario") -> Iterator[str]:
    """Complain of exponents and responses that the simulation cannot use."""
    for absent in _ABSENT_EXPONENTS:
        for factor in absent.exponents:
            name = f"{absent.law}.{factor}"
            exponent = attrgetter(name)(scenario)
            if exponent != 0:
                yield f"{name} is {exponent}, but this law {absent.reason} alone: only 0"
    for name in ("material.thrust_force", "material.power"):
        law = attrgetter(name)(scenario)
        if law.wear_growth > 0.0 and law.wear == 0.0:
            yield (
                f"{name}.wear_growth is {law.wear_growth}, but {name}.wear, the exponent of "
                "1 + wear_growth * wear, is 0: usual is 1"
            )
    for name in _FURTHER_LIMITS:
        limit = attrgetter(name)(scenario)
        if limit.bounds and limit.feed <= 0:
            yield (
                f"{name}.feed is {limit.feed}, "
                "but a further limit must bound the feed: above 0, to 10"
            )
    if scenario.material.wear.time <= 0:
        yield (
            f"material.wear.time is {scenario.material.wear.time}, "
            "but wear must grow with time: above 0, to 10"
        )
    else:
        yield from _laws_out_of_range(scenario)


def _laws_out_of_range(scenario: "Scenario") -> Iterator[str]:
    """Complain of laws with too large or too small numbers within the scenario's ranges."""
    material = scenario.material
    control = scenario.control
    factors = _factor_spans(scenario)

    # W = K t^n, so the used life, 1 at the criterion, grows by (K / criterion)^(1 / n) a minute.
    fresh_edge = _log_span(material.wear, factors)
    insert = _insert_span(scenario)
    log_criterion = math.log(scenario.tool.wear_criterion)
    exponent = material.wear.time
    slowest_rate = (fresh_edge.low + insert.low - log_criterion) / exponent
    fastest_rate = (fresh_edge.high + insert.high - log_criterion) / exponent
    fastest_rate += scenario.edge_failure.tertiary_rate * max(
        scenario.tool.wear_criterion - scenario.edge_failure.tertiary_wear, 0.0
    )
    yield from _judge("material.wear", "tool lives per minute", Span(-math.inf, fastest_rate))

    # An edge is used for at least one sub-step, and for at most two lives or, if that is longer,
    # a step or a bar at the lowest speed and feed.
    slowest_spindle = spindle_speed_at(
        scenario.machine.cutting_speed_min, scenario.workpiece.diameter
    )
    longest_bar = scenario.workpiece.bar_length / (scenario.machine.feed_min * slowest_spindle)
    longest_time = max(control.interval / 60.0, longest_bar)
    shortest_time = control.interval / 60.0 / control.sub_steps
    most_life = math.log(2.0) + max(0.0, fastest_rate + math.log(longest_time))
    least_life = max(_MIN_LOG_LIFE, slowest_rate + math.log(shortest_time))
    highest_wear = log_criterion + exponent * most_life
    wear_from_zero = Span(log_criterion + exponent * _MIN_LOG_LIFE, highest_wear)
    wear_after_sub_step = Span(log_criterion + exponent * min(least_life, 0.0), highest_wear)
    for name, unit in (("thrust_force", "N"), ("power", "kW")):
        law = getattr(material, name)
        # Before the end of the first sub-step a response may be as low as it likes: its wear counts
        # for the highest response alone.
        highest = _log_span(law, factors | {"wear": wear_from_zero}).high
        lowest = _log_span(law, factors | {"wear": wear_after_sub_step}).low
        yield from _judge(f"material.{name}", unit, Span(lowest, highest))
    for name in _FURTHER_LIMITS:
        yield from _judge(name, "", _log_span(attrgetter(name)(scenario), factors))


def _factor_spans(scenario: "Scenario") -> dict[str, Span]:
    """Return the spans of the factors of the laws, except time and wear."""
    machine = scenario.machine
    work = scenario.workpiece
    mismatch = scenario.mismatch
    deepest = max(work.depth_of_cut, *work.depth_profile, 0.0) * (1.0 + work.depth_ripple)
    deepest += _MAX_DEVIATIONS * (work.depth_bar_spread + work.depth_along_spread)
    hardest = mismatch.hardness_factor * max(mismatch.skin_hardness, 1.0)
    hardness_spread = work.hardness_bar_spread + work.hardness_along_spread
    return {
        "cutting_speed": _span(machine.cutting_speed_min, machine.cutting_speed_max),
        "feed": _span(machine.feed_min, machine.feed_max),
        "depth_of_cut": _span(MIN_DEPTH, deepest + MIN_DEPTH),
        "hardness": _span(
            mismatch.hardness_factor, hardest, margin=_MAX_DEVIATIONS * hardness_spread
        ),
    }


def _insert_span(scenario: "Scenario") -> Span:
    """Return the span of an insert's wear over nominal."""
    mismatch = scenario.mismatch
    return _span(
        mismatch.wear_factor,
        mismatch.wear_factor * max(mismatch.skin_wear, 1.0),
        margin=_MAX_DEVIATIONS * scenario.tool.wear_factor_spread,
    )


def _judge(name: str, unit: str, response: Span) -> Iterator[str]:
    """Complain of a response that is too large or, if it is not, too small."""
    digits = response.high / _LOG_10
    if digits <= MAX_DIGITS:
        digits = response.low / _LOG_10
    if digits > MAX_DIGITS or -math.inf < digits < -MIN_DIGITS:
        yield (
            f"{name} comes to 1e{digits:.0f} {unit} within the scenario's ranges, "
            f"but may come to 1e-{MIN_DIGITS} to 1e{MAX_DIGITS} only"
        )


def _log_span(law: PowerLaw, factors: dict[str, Span]) -> Span:
    """Return the span of the response of a law to spans of its factors."""
    low = math.log(law.coefficient) - law.depth_of_cut * math.log(law.reference_depth_of_cut)
    high = low
    for name, factor in factors.items():
        exponent = getattr(law, name)
        if name == "wear":
            factor = Span(*(float(log_wear_term(law.wear_growth, end)) for end in factor))
        smaller, larger = sorted((exponent * factor.low, exponent * factor.high))
        low += smaller
        high += larger
    return Span(low, high)


def _span(low: float, high: float, margin: float = 0.0) -> Span:
    return Span(math.log(low) - margin, math.log(high) + margin)
