"""The best set points by the laws of scenarios, and the numbers that describe them to a policy.

Families draw jobs by them (``family.py``). Limits and objective are those of ``laws.py``, but the
laws are evaluated here as products of a factor of each speed and one of each feed: a plan takes
half the time of the laws at every point (``python -m research.studies.searches``). The last bits
of these products decide the jobs of families, so another evaluation needs families of a new name.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.numerics.conversions import feed_velocity_at
from turning_env.numerics.functions import exp, log
from turning_env.numerics.wear_term import log_wear_term
from turning_env.scenario.laws import (
    capacity_at,
    depth_spread,
    edge_price,
    hardness_spread,
    idle_power_at,
    machining_cost,
    power_capacity,
)
from turning_env.scenario.power_law import log_response, wear_exponent
from turning_env.scenario.scenario_batch import ScenarioBatch

Array = NDArray[np.float64]

USED_LIVES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Used shares of an edge's life at which set points are planned."""
MIDDLE = 2  # index of half a life in ``USED_LIVES``

_GRID_SIZE = 20  # speeds, and feeds, that a plan compares, evenly spaced on a logarithmic scale
_MAX_SPEED_RATIO = 2.0  # of a speed to the base speed, above which torque does not matter
_MIN_REMOVAL_RATE = 1e-9  # in place of 0, if no set point is within the limits [cm3/min]
_MIN_POSITIVE = 1e-6  # in place of 0, before its logarithm becomes a feature
_INFEASIBLE = -1e9  # value of a set point over a limit, less its excess: the least excess is best


class SetPointGrid:
    """A grid of cutting speeds and feeds for each scenario, and what the laws say of them.

    Arrays have the shape (scenarios, speeds, feeds), or one that broadcasts to it.

    Attributes:
        speed: cutting speed [m/min].
        feed: feed [mm/rev].
        removal_rate: material removal rate at the nominal depth [cm3/min].
        life_rate: rate at which edges are used up [1/min].
    """

    def __init__(self, scenarios: ScenarioBatch) -> None:
        s = scenarios
        material = s.material
        limits = s.limits
        count = s.num_scenarios
        lowest_feed, highest_feed = s.feed_range
        log_speed = _log_grid(s.machine.cutting_speed_min, s.cutting_speed_max, count)
        log_feed = _log_grid(lowest_feed, highest_feed, count)
        self._scenarios = s
        self._log_speed = log_speed[:, :, np.newaxis]
        self._log_feed = log_feed[:, np.newaxis, :]
        self.speed = exp(self._log_speed)
        self.feed = exp(self._log_feed)
        self.removal_rate = self.speed * self.feed * _column(s.workpiece.depth_of_cut)

        # ``laws.life_rate`` at the wear criterion.
        log_wear = log_response_at(s, "wear", used_life=0.0)
        self.life_rate = self._response(
            material.wear,
            log_rest=log_wear - log(s.tool.wear_criterion),
            exponent=1.0 / material.wear.time,
        )

        # Shares of the limits of force and power; ``excess`` has the factors of wear and bars.
        self._force_share = self._response(material.thrust_force, -log(limits.thrust_force))
        self._power_share = self._response(material.power, -log(limits.power))
        self._idle_share = _column(idle_power_at(s, 1.0) / limits.power) * self.speed
        self._capacity = power_capacity(self.speed, _column(s.base_cutting_speed))

    def _response(self, law: Any, log_rest: Any, exponent: Any = 1.0) -> Any:
        """Return ``(exp(log_rest) * speed**a * feed**b) ** exponent`` over the grid."""
        of_speed = exp(
            _column(log_rest * exponent) + _column(law.cutting_speed * exponent) * self._log_speed
        )
        of_feed = exp(_column(law.feed * exponent) * self._log_feed)
        return of_speed * of_feed

    def life_rate_near(self, speed: Array, feed: Array) -> Array:
        """Return ``life_rate`` at the grid's set point nearest to one of each scenario.

        Args:
            speed: cutting speeds [m/min], shape (scenarios,).
            feed: feeds [mm/rev], shape (scenarios,).
        """
        rows = np.arange(len(speed))
        i = _nearest(self.speed[:, :, 0], speed)
        k = _nearest(self.feed[:, 0, :], feed)
        life_rate: Array = self.life_rate[rows, i, k]
        return life_rate

    def excess(self, used_life: float, deviations: float = 0.0) -> Any:
        """Return the larger of force and power over their limits, less 1.

        Args:
            used_life: used share of the edge's life [-].
            deviations: standard deviations by which bars are deeper and harder than the mean.
        """
        log_force = log_response_at(self._scenarios, "thrust_force", used_life, deviations)
        log_power = log_response_at(self._scenarios, "power", used_life, deviations)
        force = self._force_share * _column(exp(log_force))
        power = self._power_share * _column(exp(log_power)) + self._idle_share
        return np.maximum(force, power / self._capacity) - 1.0


def log_response_at(
    s: ScenarioBatch, law_name: str, used_life: float, deviations: float = 0.0
) -> Any:
    """Return the logarithm of a response at 1 m/min and 1 mm/rev to an edge of a used life.

    A used life of 0 is for laws without wear. ``deviations`` is that of ``SetPointGrid.excess``.
    """
    work = s.workpiece
    depth = work.depth_of_cut + deviations * depth_spread(work)
    log_hardness = log(s.mismatch.hardness_factor) + deviations * hardness_spread(work)
    log_wear = 0.0
    if used_life > 0.0:
        log_wear = log(s.tool.wear_criterion) + s.material.wear.time * log(used_life)
    law = getattr(s.material, law_name)
    return log_response(
        law,
        log_cutting_speed=0.0,
        log_feed=0.0,
        log_depth_of_cut=log(depth),
        log_time=0.0,
        log_wear_term=log_wear_term(law.wear_growth, log_wear),
        log_hardness=log_hardness,
    )


@dataclass(frozen=True)
class Plan:
    """The best set points at ``USED_LIVES``; arrays have the shape (scenarios, lives)."""

    speed: Array  # [m/min]
    feed: Array  # [mm/rev]
    life: Array  # life of an edge that cuts so [min]
    feasible: NDArray[np.bool_]  # whether any set point is within the limits
    removal_rate: Array
    """Highest removal rate that one set point sustains [cm3/min], edge changes and their price
    included; of shape (scenarios,)."""


def plan_of(s: ScenarioBatch) -> Plan:
    """Return the set points with the most metal per minute, less the price of the used life.

    Set points over a limit count only if no other is within the limits.
    """
    grid = SetPointGrid(s)
    count = s.num_scenarios
    rows = np.arange(count)
    excesses = [grid.excess(used_life) for used_life in USED_LIVES]
    price = _column(edge_price(s))  # [min]

    # The removal rate that pays for machine time is the best that one set point sustains.
    sustained = grid.removal_rate / machining_cost(1.0, grid.life_rate, price)
    sustained = np.where(excesses[MIDDLE] <= 0.0, sustained, 0.0)
    removal_rate = sustained.reshape(count, -1).max(axis=1)
    value = grid.removal_rate / np.maximum(_column(removal_rate), _MIN_REMOVAL_RATE)
    value = value - price * grid.life_rate

    shape = (count, len(USED_LIVES))
    speed = np.empty(shape)
    feed = np.empty(shape)
    life = np.empty(shape)
    feasible = np.empty(shape, np.bool_)
    for n, excess in enumerate(excesses):
        within_limits = excess <= 0.0
        worth = np.where(within_limits, value, _INFEASIBLE - excess)
        best = worth.reshape(count, -1).argmax(axis=1)
        i, k = np.divmod(best, _GRID_SIZE)
        speed[:, n] = grid.speed[rows, i, 0]
        feed[:, n] = grid.feed[rows, 0, k]
        life[:, n] = 1.0 / grid.life_rate[rows, i, k]
        feasible[:, n] = within_limits.any(axis=(1, 2))
    return Plan(speed=speed, feed=feed, life=life, feasible=feasible, removal_rate=removal_rate)


def _column(value: Any) -> Any:
    """Return one number for each scenario, or for all, in a shape that broadcasts to the grid."""
    return np.reshape(value, (-1, 1, 1))


def _log_grid(low: Any, high: Any, count: int) -> Array:
    """Return the logarithms of the grid between two ends, shape (scenarios, ``_GRID_SIZE``)."""
    log_low = np.reshape(log(low), (-1, 1))
    log_high = np.reshape(log(high), (-1, 1))
    grid = log_low + np.linspace(0.0, 1.0, _GRID_SIZE) * (log_high - log_low)
    return np.broadcast_to(grid, (count, _GRID_SIZE))


def _nearest(grid: Array, value: Array) -> NDArray[np.int64]:
    """Return the index of the number in each row of a grid that is nearest to a value by ratio."""
    distance = abs(log(grid / value[:, np.newaxis]))
    nearest: NDArray[np.int64] = distance.argmin(axis=1)
    return nearest


def features(s: ScenarioBatch, plan: Plan) -> dict[str, Array]:
    """Return the numbers that describe nominal models to a policy, not standardised.

    Each has the shape (scenarios,). Their order is that of the context, so it is part of a family.
    """
    numbers = _exponents(s)
    numbers |= _log_loads(s, plan)
    for name, value in _positive_numbers(s, plan).items():
        numbers[f"log_{name}"] = log(np.maximum(value, _MIN_POSITIVE))
    for n, used_life in enumerate(USED_LIVES):
        numbers[f"speed_at_{used_life}"] = log(plan.speed[:, n] / s.machine.cutting_speed_min)
        numbers[f"feed_at_{used_life}"] = log(plan.feed[:, n] / s.machine.feed_min)
        numbers[f"log_life_at_{used_life}"] = log(plan.life[:, n])
    shape = plan.removal_rate.shape
    return {name: np.broadcast_to(value, shape) for name, value in numbers.items()}


def _exponents(s: ScenarioBatch) -> dict[str, Any]:
    """Return the exponents of the laws [-]; of wear, those at half the wear criterion."""
    material = s.material
    log_wear = log(0.5 * s.tool.wear_criterion)
    exponents = {}
    for name in ("thrust_force", "power", "wear"):
        law = getattr(material, name)
        for factor in ("cutting_speed", "feed", "depth_of_cut"):
            exponents[f"{name}_{factor}_exponent"] = getattr(law, factor)
        if name == "wear":
            exponents["wear_time_exponent"] = law.time
        else:
            exponents[f"{name}_wear_exponent"] = wear_exponent(law, log_wear)
    exponents["taylor_exponent"] = material.wear.time / material.wear.cutting_speed
    return exponents


def _log_loads(s: ScenarioBatch, plan: Plan) -> dict[str, Any]:
    """Return log force and log power over their limits [-] at the best set point of half a life."""
    log_speed = log(plan.speed[:, MIDDLE])
    log_feed = log(plan.feed[:, MIDDLE])
    loads = {}
    for law_name, limit in (
        ("thrust_force", s.limits.thrust_force),
        ("power", s.limits.power * capacity_at(s, plan.speed[:, MIDDLE])),
    ):
        law = getattr(s.material, law_name)
        of_set_point = law.cutting_speed * log_speed + law.feed * log_feed
        log_load = of_set_point + log_response_at(s, law_name, USED_LIVES[MIDDLE])
        loads[f"log_{law_name}_load"] = log_load - log(limit)
    return loads


def _positive_numbers(s: ScenarioBatch, plan: Plan) -> dict[str, Any]:
    """Return the numbers whose logarithms describe the nominal models."""
    work = s.workpiece
    tool = s.tool
    machine = s.machine
    economics = s.economics
    speed = plan.speed[:, MIDDLE]
    feed = plan.feed[:, MIDDLE]
    travel = feed_velocity_at(speed, feed, work.diameter)
    power_limit = s.limits.power * capacity_at(s, speed)
    over_base_speed = speed / np.maximum(s.base_cutting_speed, 1.0)
    lowest_feed, highest_feed = s.feed_range
    return {
        "life": plan.life[:, MIDDLE],
        "removal_rate": plan.removal_rate,
        "edge_price": economics.edge_cost,
        "edge_change_time": economics.edge_change_time,
        "idle_power": idle_power_at(s, speed) / power_limit,
        "edge_strength": tool.edge_strength / s.limits.thrust_force,
        "wear_factor_spread": tool.wear_factor_spread,
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
        "speed_over_base_speed": np.minimum(over_base_speed, _MAX_SPEED_RATIO),
        "lowest_feed": lowest_feed / machine.feed_min,
        "highest_feed": highest_feed / machine.feed_min,
        "speed_over_fastest": speed / s.cutting_speed_max,
    }
