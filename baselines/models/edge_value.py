"""The price of edge life that maximises the return of a whole edge.

The environment charges used life at a constant price. But a fresh edge earns more than its time costs, and a worn edge does not.
So life is worth saving at first, but not towards the end. The return of a whole edge is greatest if, at every used share D of its
life, the set point maximises

    value of metal - time - overload - p(D) dD/dt

where p(D) is the price at which the best set points, averaged over bars, gain nothing. This is dynamic programming over D, with
one equation per D, because the used life only grows (Bellman 1957). The charged price does not enter, because a whole edge costs
the same under every policy. A slower or faster insert needs no other price if dD is counted at the nominal rate. A slower or
faster lot only changes the price of time, as its edges last longer or shorter.

If edges are changed and time is limited, a second costs what it could earn elsewhere. At that price of time, a whole edge just
pays for itself, its change and their time. If edges are changed on command, worthless life need not be used: the price is at
least 0, and the best time to change the edge is when it reaches 0.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from turning_env import Scenario
from turning_env.physics.spindle import capacity_at

Array = NDArray[np.float64]

USED_LIVES = np.linspace(0.0, 1.0, 41)[1:]
"""Shares of the life [-] at which the price is computed."""
SPREAD = 0.03
"""Log standard deviation of force and power about their estimates (assumption: similar to a filter's)."""
_SETTINGS = (40, 60)  # cutting speeds and feeds that are tried
_ITERATIONS = 30  # of Dinkelbach's, which converges faster than linearly
_MAX_TIME_PRICE = 100.0


def expected_excess(log_mean: Array, spread: Array | float) -> Array:
    """Return the expectation of max(X - 1, 0), where log X is normal with this mean and a standard deviation above 0."""
    ratio = log_mean / spread
    return np.asarray(np.exp(log_mean + 0.5 * np.square(spread)) * ndtr(ratio + spread) - ndtr(ratio))


class Worth(NamedTuple):
    """Prices of time and life."""

    time: float
    """Price of a second [s]: 1, or what a second can earn if time is limited."""
    life: Array
    """Price p(D) of a whole life [s] at each of ``USED_LIVES``."""


def worth(scenario: Scenario, overload_price: float) -> Worth:
    """Return the prices of time and life for a price of overload [s per s and relative excess of 1].

    The arrays are cached, because they can take half a second to compute: do not write to them.
    """
    return worth_of_lots(scenario, overload_price, (1.0,))[0]


@lru_cache(maxsize=1024)
def worth_of_lots(scenario: Scenario, overload_price: float, rates: tuple[float, ...]) -> list[Worth]:
    """Return ``worth`` for lots of edges that use their life at so many times the nominal rate, at which dD is still counted."""
    value, rate, weight = _outcomes(scenario, overload_price)
    if scenario.control.edge_changes == "end":
        return [Worth(1.0, _prices(value - 1.0, rate, weight))] * len(rates)
    economics = scenario.economics
    least = 0.0 if scenario.control.edge_changes == "commanded" else -np.inf

    def prices(time_price: float) -> Array:
        return np.maximum(_prices(value - time_price, rate, weight), least)

    def gain_of_an_edge(time_price: float, faster: float) -> float:
        change = time_price * economics.edge_change_time
        return float(prices(time_price).mean()) / faster - 60.0 * (economics.edge_cost + change)

    def time_price(faster: float) -> float:
        if gain_of_an_edge(0.0, faster) <= 0.0:
            return 0.0  # the edge does not even pay for itself
        from scipy.optimize import brentq  # takes as long as most other imports of the catalogue

        most = min(_MAX_TIME_PRICE, float(value.max()) + 1.0)
        return float(brentq(gain_of_an_edge, 0.0, most, (faster,), xtol=1e-3))

    return [Worth(price, prices(price)) for price in map(time_price, rates)]


def _outcomes(scenario: Scenario, overload_price: float) -> tuple[Array, Array, Array]:
    """Return the value of metal less overload [-] and the life used [1/s], for used lives, bars and set points, and bar weights.

    Bars are the nodes of a Gauss-Hermite rule of three points for the deviations of depth and of hardness.
    """
    machine, material, work, limits = scenario.machine, scenario.material, scenario.workpiece, scenario.limits
    normals, weights = np.sqrt(3.0) * np.array([-1.0, 0.0, 1.0]), np.array([1.0, 4.0, 1.0]) / 6.0
    deviation = np.hypot(work.depth_bar_spread, work.depth_along_spread) * normals
    depth = np.maximum(work.depth_of_cut + deviation, 0.05 * work.depth_of_cut)[:, np.newaxis, np.newaxis, np.newaxis]
    hardness = np.exp(np.hypot(work.hardness_bar_spread, work.hardness_along_spread) * normals)[:, np.newaxis, np.newaxis]
    speed = np.geomspace(machine.cutting_speed_min, machine.cutting_speed_max, _SETTINGS[0])[:, np.newaxis]
    feed = np.geomspace(*scenario.feed_range, _SETTINGS[1])
    metal = speed * feed * depth / scenario.economics.reference_removal_rate
    life_rate = (material.wear(speed, feed, depth, hardness=hardness) / scenario.tool.wear_criterion) ** (
        1.0 / material.wear.time
    )
    values = []
    for used_life in USED_LIVES:
        wear = scenario.tool.wear_criterion * used_life**material.wear.time
        force = material.thrust_force(speed, feed, depth, wear=wear, hardness=hardness) / limits.thrust_force
        power = material.power(speed, feed, depth, wear=wear, hardness=hardness) / limits.power / capacity_at(scenario, speed)
        excess = expected_excess(np.log(force), SPREAD) + expected_excess(np.log(power), SPREAD)
        values.append((metal - overload_price * excess).reshape(9, -1))
    return np.array(values), life_rate.reshape(9, -1) / 60.0, np.outer(weights, weights).ravel()


def _prices(gain: Array, rate: Array, weight: Array) -> Array:
    """Return the price at which the best gains, averaged over bars, are 0, for each used life (Dinkelbach 1967)."""
    price, gained, used = np.zeros(len(gain)), np.empty(gain.shape[:2]), np.empty(gain.shape[:2])
    bars, moving = np.arange(len(rate)), np.arange(len(gain))
    for _ in range(_ITERATIONS):
        for k in moving:
            best = np.argmax(gain[k] - price[k] * rate, axis=1)
            gained[k], used[k] = gain[k][bars, best], rate[bars, best]
        last, price = price, (gained @ weight) / (used @ weight)
        moving = np.flatnonzero(price != last)
        if not moving.size:
            break
    return price
