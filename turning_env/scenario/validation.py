"""What the machinability laws can come to anywhere within a scenario.

A law with exponents beyond all sense comes to numbers whose sums and quotients no computer can represent; it is refused when the
scenario is made, so that nothing has to be checked while lathes run.
"""

import math
from collections.abc import Iterator

from turning_env.scenario.power_law import PowerLaw
from turning_env.scenario.sections import Control, Machine, Material, Mismatch, Tool, Workpiece

MAX_DIGITS = 100
"""Responses, and rates at which life is used up [1/min], lie below 1 with so many zeros."""
MIN_DIGITS = 280
"""Responses lie above 1 over 1 with so many zeros."""

_SPREADS = 10.0  # standard deviations that a draw may lie off
_MIN_DEPTH = 1e-6  # [mm], as the transition has it
_MIN_LOG_LIFE = math.log(1e-300)  # likewise [-]

Span = tuple[float, float]
"""Lowest and highest natural logarithm."""


def complaints(
    material: Material, tool: Tool, machine: Machine, workpiece: Workpiece, control: Control, mismatch: Mismatch
) -> Iterator[str]:
    """What is wrong with each law that comes to too much or too little, by its field."""
    hardness_spread = _SPREADS * (workpiece.hardness_bar_spread + workpiece.hardness_along_spread)
    deepest = max(workpiece.depth_of_cut, *workpiece.depth_profile, 0.0) * (1.0 + workpiece.depth_ripple)
    deepest += _SPREADS * (workpiece.depth_bar_spread + workpiece.depth_along_spread)
    factors = {
        "cutting_speed": _span(machine.cutting_speed_min, machine.cutting_speed_max),
        "feed": _span(machine.feed_min, machine.feed_max),
        "depth_of_cut": _span(_MIN_DEPTH, deepest + _MIN_DEPTH),
        "hardness": _wider(
            _span(mismatch.hardness_factor, mismatch.hardness_factor * max(mismatch.skin_hardness, 1.0)), hardness_spread
        ),
    }
    own = _wider(
        _span(mismatch.wear_factor, mismatch.wear_factor * max(mismatch.skin_wear, 1.0)), _SPREADS * tool.wear_factor_spread
    )
    fresh = tuple(a + b for a, b in zip(_log_span(material.wear, factors), own, strict=True))
    criterion, exponent = math.log(tool.wear_criterion), material.wear.time
    rate = (fresh[0] - criterion) / exponent, (fresh[1] - criterion) / exponent
    yield from _judged("wear", "lives used up per minute", (-math.inf, rate[1]), rate[1])
    longest = max(control.interval / 60.0, workpiece.bar_length / (machine.feed_min * _slowest(machine, workpiece)))
    most_life = math.log(2.0) + max(0.0, rate[1] + math.log(longest))
    least_life = max(_MIN_LOG_LIFE, rate[0] + math.log(control.interval / 60.0 / control.sub_steps))
    for name, unit in (("thrust_force", "N"), ("power", "kW")):
        law = getattr(material, name)
        wear = criterion + exponent * _MIN_LOG_LIFE, criterion + exponent * most_life
        _, most = _log_span(law, factors | {"wear": wear})
        least, _ = _log_span(law, factors | {"wear": (criterion + exponent * min(least_life, 0.0), wear[1])})
        yield from _judged(name, unit, (least, most), most)


def _judged(name: str, unit: str, span: Span, most: float) -> Iterator[str]:
    digits = most / math.log(10.0) if most > MAX_DIGITS * math.log(10.0) else span[0] / math.log(10.0)
    if digits > MAX_DIGITS or -math.inf < digits < -MIN_DIGITS:
        allowed = f"1e-{MIN_DIGITS} to 1e{MAX_DIGITS}"
        yield f"material.{name} comes to 1e{digits:.0f} {unit} within the scenario's ranges, but may come to {allowed} only"


def _log_span(law: PowerLaw, factors: dict[str, Span]) -> Span:
    low = high = math.log(law.coefficient) - law.depth_of_cut * math.log(law.reference_depth_of_cut)
    for name, (least, most) in factors.items():
        ends = sorted((getattr(law, name) * least, getattr(law, name) * most))
        low, high = low + ends[0], high + ends[1]
    return low, high


def _span(low: float, high: float) -> Span:
    return math.log(low), math.log(high)


def _wider(span: Span, by: float) -> Span:
    return span[0] - by, span[1] + by


def _slowest(machine: Machine, workpiece: Workpiece) -> float:
    """Spindle speed [rev/min] at the lowest cutting speed."""
    return 1000.0 * machine.cutting_speed_min / (math.pi * workpiece.diameter)
