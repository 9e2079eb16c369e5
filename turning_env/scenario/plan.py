"""The best set points by the laws of a scenario, for many scenarios at once, and the numbers that describe them to a policy.

Many scenarios are one ``Scenario`` whose numbers can be arrays of shape (scenarios,).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.numerics.functions import exp, hypotenuse, log
from turning_env.scenario.power_law import log_response
from turning_env.scenario.scenario import Scenario, flat, nested

Array = NDArray[np.float64]

USED_LIVES = (
    0.05,
    0.25,
    0.5,
    0.75,
    0.95,
)  # used shares of an edge's life at which set points are planned
MIDDLE = 2  # place of half a life in ``USED_LIVES``
_ENOUGH = 2.0  # ratio of a cutting speed to the base speed above which the torque does not matter
_GRID = 20  # cutting speeds, and feeds, that a plan compares, evenly spaced on a logarithmic scale


def unchecked(values: dict[str, Any], section: Any = Scenario) -> Scenario:
    """Return a scenario of nested values, which are not checked: its numbers can be arrays of shape (scenarios,)."""
    kinds = {name: field.annotation for name, field in section.model_fields.items()}
    inner = {
        name: unchecked(value, kinds[name]) if isinstance(value, dict) else value
        for name, value in values.items()
    }
    made: Scenario = section.model_construct(**inner)
    return made


def columns_of(scenarios: Sequence[Scenario]) -> Scenario:
    """Return scenarios as one of arrays; values that all have stay as they are. Their nominal models are left out."""
    first, *others = (
        flat(scenario.model_dump(exclude={"name", "nominal_model"})) for scenario in scenarios
    )
    same = {name for name, value in first.items() if all(each[name] == value for each in others)}
    each_of = [first, *others]
    return unchecked(
        nested(
            (name, first[name] if name in same else np.array([v[name] for v in each_of]))
            for name in first
        )
    )


class Loads:
    """A grid of set points and their loads. Arrays have the shape (scenarios, speeds, feeds), or one that broadcasts to it.

    They are speed [m/min], feed [mm/rev], removal rate [cm3/min] and the rate at which edges are used up [1/min].
    """

    def __init__(self, s: Scenario, count: int) -> None:
        self._s = s
        self._log_speed = _span(s.machine.cutting_speed_min, s.cutting_speed_max, count)[:, :, None]
        self._log_feed = _span(*s.feed_range, count)[:, None, :]
        self.speed, self.feed = exp(self._log_speed), exp(self._log_feed)
        self.removal = self.speed * self.feed * _wide(s.workpiece.depth_of_cut)
        wear = log_response_at(s, "wear", 0.0)
        self.life_rate = self._over_grid(
            s.material.wear, wear - log(s.tool.wear_criterion), 1.0 / s.material.wear.time
        )
        self._force = self._over_grid(s.material.thrust_force, -log(s.limits.thrust_force))
        self._power = self._over_grid(s.material.power, -log(s.limits.power))
        self._idle = (
            _wide(s.spindle.idle_torque / (30.0 * s.workpiece.diameter) / s.limits.power)
            * self.speed
        )
        self._capacity = np.minimum(self.speed / _wide(np.maximum(s.base_cutting_speed, 1e-9)), 1.0)

    def _over_grid(self, law: Any, log_rest: Any, exponent: Any = 1.0) -> Any:
        """Return (exp(log_rest) V^a f^b)^exponent."""
        along_speed = exp(
            _wide(log_rest * exponent) + _wide(law.cutting_speed * exponent) * self._log_speed
        )
        return along_speed * exp(_wide(law.feed * exponent) * self._log_feed)

    def nearest(self, speed: Array, feed: Array) -> list[NDArray[np.int64]]:
        """Return the places of the grid's speeds and feeds that are nearest to some [m/min, mm/rev], shape (scenarios,) each."""
        pairs = (self.speed, speed), (self.feed, feed)
        return [
            abs(log(grid.reshape(len(at), -1) / at[:, None])).argmin(axis=1) for grid, at in pairs
        ]

    def excess(self, used_life: float, deviations: float = 0.0) -> Any:
        """Return the larger of force and power over their limits, less 1, for bars worse by a number of standard deviations."""
        s = self._s
        force = self._force * _wide(exp(log_response_at(s, "thrust_force", used_life, deviations)))
        power = (
            self._power * _wide(exp(log_response_at(s, "power", used_life, deviations)))
            + self._idle
        )
        return np.maximum(force, power / self._capacity) - 1.0


def log_response_at(s: Scenario, law_name: str, used_life: float, deviations: float = 0.0) -> Any:
    """Return the logarithm of a response at 1 m/min and 1 mm/rev, to an edge of a used life (0: the law has no wear)."""
    work, law = s.workpiece, getattr(s.material, law_name)
    depth = work.depth_of_cut + deviations * hypotenuse(
        work.depth_bar_spread, work.depth_along_spread
    )
    log_hardness = log(s.mismatch.hardness_factor) + deviations * hypotenuse(
        work.hardness_bar_spread, work.hardness_along_spread
    )
    log_wear = (
        log(s.tool.wear_criterion) + s.material.wear.time * log(used_life)
        if used_life > 0.0
        else 0.0
    )
    return log_response(law, 0.0, 0.0, log(depth), 0.0, log_wear, log_hardness)  # type: ignore[no-untyped-call]


@dataclass(frozen=True)
class Plan:
    """The best set points at ``USED_LIVES``; arrays of shape (scenarios, lives) or (scenarios,)."""

    speed: Array  # [m/min]
    feed: Array  # [mm/rev]
    life: Array  # life of an edge that cuts so [min]
    feasible: NDArray[np.bool_]  # whether any set point is within the limits
    removal_rate: Array  # highest that one set point sustains [cm3/min], edge changes and their price included; (scenarios,)


def plan_of(s: Scenario, count: int) -> Plan:
    """Return the set points with the most metal per minute, less the price of the used life, within the limits."""
    loads = Loads(s, count)
    price = _wide(s.economics.edge_cost + s.economics.edge_change_time)  # [min]
    over = [loads.excess(life) for life in USED_LIVES]
    sustained = loads.removal / (1.0 + price * loads.life_rate)
    rate = np.where(over[MIDDLE] <= 0.0, sustained, 0.0).reshape(count, -1).max(axis=1)
    value = loads.removal / np.maximum(_wide(rate), 1e-9) - price * loads.life_rate
    rows, found = np.arange(count), []
    for excess in over:
        feasible = excess <= 0.0
        best = np.where(feasible, value, -1e9 - excess).reshape(count, -1).argmax(axis=1)
        i, k = np.divmod(best, _GRID)
        life = 1.0 / loads.life_rate[rows, i, k]
        found.append(
            (loads.speed[rows, i, 0], loads.feed[rows, 0, k], life, feasible.any(axis=(1, 2)))
        )
    speed, feed, life, feasible = (np.stack(column, axis=1) for column in zip(*found, strict=True))
    return Plan(speed, feed, life, feasible, rate)


def _wide(value: Any) -> Any:
    return np.reshape(value, (-1, 1, 1))


def _span(low: Any, high: Any, count: int) -> Array:
    """Return the logarithms of the grid between two ends, shape (scenarios, ``_GRID``)."""
    low, high = np.reshape(log(low), (-1, 1)), np.reshape(log(high), (-1, 1))
    return np.broadcast_to(low + np.linspace(0.0, 1.0, _GRID) * (high - low), (count, _GRID))


def features(s: Scenario, plan: Plan) -> dict[str, Array]:
    """Return the numbers that describe nominal models to a policy, shape (scenarios,) each, not standardised."""
    material, work, machine = s.material, s.workpiece, s.machine
    speed, feed, life = plan.speed[:, MIDDLE], plan.feed[:, MIDDLE], plan.life[:, MIDDLE]
    travel = speed * feed * 1000.0 / (np.pi * work.diameter) / 60.0  # feed per second [mm/s]
    over_base = np.minimum(speed / np.maximum(s.base_cutting_speed, 1.0), _ENOUGH)
    power_limit = s.limits.power * np.minimum(over_base, 1.0)
    numbers: dict[str, Any] = {}
    for law in ("thrust_force", "power", "wear"):
        for factor in (
            "cutting_speed",
            "feed",
            "depth_of_cut",
            "wear" if law != "wear" else "time",
        ):
            numbers[f"{law}_{factor}_exponent"] = getattr(getattr(material, law), factor)
    numbers["taylor_exponent"] = material.wear.time / material.wear.cutting_speed
    for law, limit in (("thrust_force", s.limits.thrust_force), ("power", power_limit)):
        exponents = getattr(material, law)
        at_best = exponents.cutting_speed * log(speed) + exponents.feed * log(feed)
        numbers[f"log_{law}_load"] = (
            at_best + log_response_at(s, law, USED_LIVES[MIDDLE]) - log(limit)
        )
    logs = {
        "life": life,
        "removal_rate": plan.removal_rate,
        "edge_price": s.economics.edge_cost,
        "edge_change_time": s.economics.edge_change_time,
        "idle_power": s.spindle.idle_torque / (30.0 * work.diameter) * speed / power_limit,
        "edge_strength": s.tool.edge_strength / s.limits.thrust_force,
        "wear_factor_spread": s.tool.wear_factor_spread,
        "depth_bar_spread": work.depth_bar_spread / work.depth_of_cut,
        "depth_along_spread": work.depth_along_spread / work.depth_of_cut,
        "hardness_bar_spread": work.hardness_bar_spread,
        "hardness_along_spread": work.hardness_along_spread,
        "bar_time": work.bar_length / travel,
        "depth_correlation_time": work.depth_correlation_length / travel,
        "hardness_correlation_time": work.hardness_correlation_length / travel,
        "feed_time_constant": machine.feed_time_constant,
        "spindle_time_constant": machine.spindle_time_constant,
        "diameter": work.diameter,
        "depth_of_cut": work.depth_of_cut,
        "speed_over_base_speed": over_base,
        "lowest_feed": s.feed_range[0] / machine.feed_min,
        "highest_feed": s.feed_range[1] / machine.feed_min,
        "speed_over_fastest": speed / s.cutting_speed_max,
    }
    numbers |= {f"log_{name}": log(np.maximum(value, 1e-6)) for name, value in logs.items()}
    for k, used in enumerate(USED_LIVES):
        numbers[f"speed_at_{used}"] = log(plan.speed[:, k] / machine.cutting_speed_min)
        numbers[f"feed_at_{used}"] = log(plan.feed[:, k] / machine.feed_min)
        numbers[f"log_life_at_{used}"] = log(plan.life[:, k])
    return {
        name: np.broadcast_to(value, plan.removal_rate.shape) for name, value in numbers.items()
    }
