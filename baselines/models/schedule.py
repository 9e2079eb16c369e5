"""The best use of an edge by laws and forms that are known: cutting speeds and feeds over its used life, and when to change it.

The power laws of a nominal model have no phases of wear, no built-up edge and no failures but by force. Where edges collapse,
chip, notch or run in (``EdgeFailure``), or a bar chatters, the best speed follows from dynamic programming over the used share D
of an edge's life, in steps of 1 / ``LIVES``. With a price of time c, a set point is worth at D

    metal - overload - c time - edge / LIVES + q V(D + 1 / LIVES) + (1 - q) broken(D + 1 / LIVES)

at the rate of wear there, where q is the chance that the edge survives the step. V(D) is the greatest such worth, or that of a
change of the edge, if larger. Time is limited, so it costs what it can earn: with the right c, a fresh edge is worth V(0) = 0.
Bars are as expected. Their spreads enter the expected excess over a limit and the chance to survive.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from baselines.models.normal import tail
from baselines.rule import Array
from turning_env import Scenario
from turning_env.numerics.functions import exp, hypotenuse, log, real_power
from turning_env.physics.spindle import capacity_at, idle_power_at
from turning_env.scenario.sections import EdgeFailure

FORMS = "edge_failure.", "machine.chatter"
"""How the dotted names of the fields begin that the schedule needs beside the power laws."""
LIVES = 40
_SPEEDS, _FEEDS, _BISECTIONS, _MAX_TIME_PRICE = 24, 14, 24, 5.0
_SLOWEST = 1.5  # lowest speed over the machine's [-]: below, an edge earns nothing for long (found on training jobs)
_SEVERITY = 1.2  # factor on the price of overload [-], that of ``self_tuning``
_HOT_SPOTS = (
    3.0  # independent places of a bar per minute, each of which can be too hot [1/min] (assumption)
)
_HEAT_MARGIN = (
    2.0  # factor on the standard deviation of the log temperature [-] (found on training jobs)
)
_LEAST = 1e-9


class Schedule(NamedTuple):
    """The best use of an edge."""

    cutting_speed: Array  # [m/min] in each step of the used life, shape (LIVES,)
    feed: Array  # [mm/rev], likewise
    change_at: float  # used life at which to change the edge [-]
    time: float  # what a second can earn [s]


def has_forms(scenario: Scenario) -> bool:
    """Return whether edges are changed on command and the scenario has forms that are none of the power laws'."""
    forms = scenario.edge_failure != EdgeFailure() or scenario.machine.chatter > 0.0
    return forms and scenario.control.edge_changes == "commanded"


@lru_cache(maxsize=4096)
def schedule(scenario: Scenario) -> Schedule:
    """Return the best use of an edge, by the scenario's own laws and forms, as if they were true."""
    slowest, (least, most) = _SLOWEST * scenario.machine.cutting_speed_min, scenario.feed_range
    speed = exp(np.linspace(log(slowest), log(scenario.cutting_speed_max), _SPEEDS))[:, np.newaxis]
    feed = exp(np.linspace(log(least), log(most), _FEEDS))
    gain, time, survival = (
        np.broadcast_to(each, (LIVES, _SPEEDS, _FEEDS)) for each in _steps(scenario, speed, feed)
    )
    low, high = 0.0, _MAX_TIME_PRICE
    for _ in range(_BISECTIONS):
        price = 0.5 * (low + high)
        fresh, best, change = _backward(scenario, gain - price * time, survival, price)
        low, high = (price, high) if fresh > 0.0 else (low, price)
    fast, wide = np.divmod(best, _FEEDS)
    return Schedule(speed[fast, 0], feed[wide], change / LIVES, price)


def _backward(
    scenario: Scenario, gain: Array, survival: Array, price: float
) -> tuple[float, Any, int]:
    """Return a fresh edge's worth [s], the best set point in each step of life, and the step in which to change the edge."""
    economics = scenario.economics
    edge, change, downtime = (
        60.0 * economics.edge_cost,
        economics.edge_change_time,
        economics.breakage_downtime,
    )
    worth, best, last = (
        -60.0 * price * (change + economics.unplanned_stop),
        np.zeros(LIVES, np.int64),
        LIVES,
    )
    for step in range(LIVES - 1, -1, -1):
        broken = -edge * (1.0 - (step + 1.0) / LIVES) - 60.0 * price * (change + downtime)
        worths = (gain[step] - edge / LIVES + survival[step] * (worth - broken) + broken).ravel()
        best[step] = worths.argmax()
        worth, changed = (
            float(worths[best[step]]),
            -edge * (1.0 - step / LIVES) - 60.0 * price * change,
        )
        if step > 0 and changed > worth:
            worth, last = changed, step
    return worth, best, last


def _steps(scenario: Scenario, speed: Array, feed: Array) -> tuple[Any, Any, Any]:
    """Return value of metal less overload [s], duration [s] and chance to survive of each step of life at each set point."""
    machine, tool, work, failure = (
        scenario.machine,
        scenario.tool,
        scenario.workpiece,
        scenario.edge_failure,
    )
    material, limits, economics = scenario.material, scenario.limits, scenario.economics
    depth, exponent = work.depth_of_cut, material.wear.time
    life = np.arange(LIVES + 1.0)[:, np.newaxis, np.newaxis] / LIVES
    middle, start, end = 0.5 * (life[:-1] + life[1:]), np.maximum(life[:-1], _LEAST), life[1:]
    depth_spread = hypotenuse(work.depth_bar_spread, work.depth_along_spread) / depth
    hardness_spread = hypotenuse(work.hardness_bar_spread, work.hardness_along_spread)
    sings = np.pi * work.diameter * machine.chatter_speed / 1000.0  # [m/min]
    dynamic = 1.0 + _bump(speed, machine.chatter, sings, machine.chatter_width)

    def spread(law: Any) -> Any:
        return hypotenuse(law.depth_of_cut * depth_spread, law.hardness * hardness_spread)

    def wear(used: Array) -> Any:
        return tool.wear_criterion * real_power(used, exponent)

    def force(used: Array) -> Any:
        return material.thrust_force(speed, feed, depth, wear=wear(used)) * dynamic

    worn = wear(middle)
    rate = real_power(
        material.wear(speed, feed, depth) / tool.wear_criterion, 1.0 / exponent
    )  # [1/min]
    rate = rate * (
        1.0 + _bump(speed, failure.built_up_edge, failure.built_up_speed, failure.built_up_width)
    )
    rate = rate * exp(failure.tertiary_rate * np.maximum(worn - failure.tertiary_wear, 0.0))
    rate = rate * (1.0 + failure.running_in * exp(-worn / failure.running_in_wear))
    minutes = 1.0 / (LIVES * rate)

    worst_force = force(middle) * exp(0.5 * spread(material.thrust_force))
    power = (
        material.power(speed, feed, depth, wear=worn) + idle_power_at(scenario, speed)
    ) / capacity_at(scenario, speed)
    over = np.maximum(worst_force / limits.thrust_force - 1.0, 0.0)
    over = over + np.maximum(power * exp(0.5 * spread(material.power)) / limits.power - 1.0, 0.0)
    value = (
        speed * feed * depth / economics.reference_removal_rate
        - _SEVERITY * economics.overload_price * over
    )

    load = log(force(middle) / tool.edge_strength) + 0.5 * spread(material.thrust_force) ** 2
    hazard = failure.chipping_rate * exp(failure.chipping_load_exponent * load)
    hazard = hazard * real_power(worn / tool.wear_criterion, failure.chipping_wear_exponent)
    if failure.collapse_temperature > 0.0:
        law = failure.temperature
        hotter = log(law(speed, feed, depth, wear=wear(end)) / failure.collapse_temperature)
        scale = _HEAT_MARGIN * spread(law) + 1e-3
        hazard = hazard + np.where(hotter > scale, np.inf, _HOT_SPOTS * _below(hotter / scale))

    def strong(used: Array) -> Any:
        """Return the chance that an edge is stronger than force and notch."""
        by_force = log(tool.edge_strength / force(used)) / hypotenuse(
            spread(material.thrust_force), tool.edge_strength_spread
        )
        by_notch = -log(np.maximum(failure.notch_growth * used, _LEAST)) / max(
            tool.edge_strength_spread, _LEAST
        )
        return _below(by_force) * _below(by_notch) + _LEAST

    survival = exp(-hazard * minutes) * np.minimum(strong(end) / strong(start), 1.0)
    return 60.0 * value * minutes, 60.0 * minutes, survival


def _bump(speed: Array, height: float, at: float, width: float) -> Any:
    off = log(speed / at) / width
    return height * exp(-off * off)


def _below(x: Any) -> Any:
    """Return the probability that a standard normal number is below x."""
    above = exp(-0.5 * x * x) * tail(np.abs(x))
    return np.where(x < 0.0, above, 1.0 - above)
