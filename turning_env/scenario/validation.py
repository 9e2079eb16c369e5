"""Check the range of the machinability laws over a whole scenario.

Laws with extreme exponents give numbers that overflow in sums and quotients. The scenario refuses such laws, so the simulation
need not check.
"""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from turning_env.scenario.power_law import PowerLaw

if TYPE_CHECKING:
    from turning_env.scenario import Scenario

MAX_DIGITS = 100
"""Responses, and rates of used tool life [1/min], are at most 10 to this power."""
MIN_DIGITS = 280
"""Responses are at least 1 over 10 to this power."""

_SPREADS = 10.0  # largest deviation from the mean in standard deviations
_MIN_DEPTH = 1e-6  # [mm], as in the transition
_MIN_LOG_LIFE = math.log(1e-300)  # of used tool life [-], as in the transition

Span = tuple[float, float]
"""Lowest and highest natural logarithm."""


def complaints(scenario: "Scenario") -> Iterator[str]:
    """Yield a complaint for each law that gives too large or too small numbers within the scenario's ranges."""
    material, tool, machine = scenario.material, scenario.tool, scenario.machine
    workpiece, control, mismatch = scenario.workpiece, scenario.control, scenario.mismatch
    hardness_spread = _SPREADS * (workpiece.hardness_bar_spread + workpiece.hardness_along_spread)
    deepest = max(workpiece.depth_of_cut, *workpiece.depth_profile, 0.0) * (1.0 + workpiece.depth_ripple)
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
    tertiary = scenario.edge_failure.tertiary_rate * max(tool.wear_criterion - scenario.edge_failure.tertiary_wear, 0.0)
    rate = (fresh[0] - criterion) / exponent, (fresh[1] - criterion) / exponent + tertiary
    yield from _judged("wear", "tool lives per minute", -math.inf, rate[1])

    slowest = 1000.0 * machine.cutting_speed_min / (math.pi * workpiece.diameter)  # spindle speed [rev/min]
    longest = max(control.interval / 60.0, workpiece.bar_length / (machine.feed_min * slowest))
    most_life = math.log(2.0) + max(0.0, rate[1] + math.log(longest))
    least_life = max(_MIN_LOG_LIFE, rate[0] + math.log(control.interval / 60.0 / control.sub_steps))
    for name, unit in (("thrust_force", "N"), ("power", "kW")):
        law = getattr(material, name)
        wear = criterion + exponent * _MIN_LOG_LIFE, criterion + exponent * most_life
        _, most = _log_span(law, factors | {"wear": wear})
        least, _ = _log_span(law, factors | {"wear": (criterion + exponent * min(least_life, 0.0), wear[1])})
        yield from _judged(name, unit, least, most)


def _judged(name: str, unit: str, least: float, most: float) -> Iterator[str]:
    digits = most / math.log(10.0) if most > MAX_DIGITS * math.log(10.0) else least / math.log(10.0)
    if digits > MAX_DIGITS or -math.inf < digits < -MIN_DIGITS:
        allowed = f"1e-{MIN_DIGITS} to 1e{MAX_DIGITS}"
        yield f"material.{name} comes to 1e{digits:.0f} {unit} within the scenario's ranges, but may come to {allowed} only"


def _log_span(law: PowerLaw, factors: dict[str, Span]) -> Span:
    low = high = math.log(law.coefficient) - law.depth_of_cut * math.log(law.reference_depth_of_cut)
    for name, (least, most) in factors.items():
        ends = sorted((getattr(law, name) * least, getattr(law, name) * most))
        low, high = low + ends[0], high + ends[1]
    return low, high


def _span(low: float, high: float, margin: float = 0.0) -> Span:
    return math.log(low) - margin, math.log(high) + margin
