"""The price of edge life that maximises the return of a whole edge.

The environment charges used life at a constant price. But a fresh edge earns more than its time costs, and a worn edge does not.
So life is worth saving at first, but not towards the end. The return of a whole edge is greatest if, at every used share D of its
life, the set point maximises

    value of metal - time - overload - p(D) dD/dt

where p(D) is the price at which the best set points, averaged over bars, gain nothing. This is dynamic programming over D, with
one equation per D, because the used life only grows (Bellman 1957). The charged price does not enter, because a whole edge costs
the same under every policy. A slower or faster insert needs no other price if dD is counted at the nominal rate.

If edges are changed and time is limited, a second costs what it could earn elsewhere: at that price of time, a whole edge just
pays for itself, its change and their time. If they are changed on command, worthless life need not be used: the price is at least
0, and the best time to change the edge is when it reaches 0.

``price_life`` prices life by laws that a filter estimates, in every step. Bars are then as expected, and the feed is the highest
that keeps the loads within their limits, or the nearest that the chip breaker allows:

    p(D) = max over cutting speeds of (value of metal less overload - price of time) / life used per time
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from baselines.models.normal import excess
from baselines.rule import Array
from turning_env import Scenario
from turning_env.numerics.compilation import compiled_entry, compiled_separately
from turning_env.numerics.functions import exp, hypotenuse, log
from turning_env.physics.spindle import capacity_at
from turning_env.scenario.power_law import log_response

USED_LIVES = np.linspace(0.0, 1.0, 41)[1:]  # shares of the life [-] at which the price is computed
SPREAD = 0.03  # log standard deviation of force and power about their estimates (assumption: similar to a filter's)
_SETTINGS = (40, 60)  # cutting speeds and feeds that are tried
_ITERATIONS = 30  # of Dinkelbach's, which converges faster than linearly
_MAX_TIME_PRICE = 100.0

LIVES = 6  # number of used shares of the life at which price_life prices it, beside the present one
SPEEDS = 24  # number of cutting speeds that it compares, evenly spaced on a logarithmic scale
NEWTON_STEPS = 8
MIN_EXPONENT = 0.1  # least exponent of the feed in a load [-]
MIN_CAPACITY = 1e-3  # least power of the spindle, less idle power, over the limit [-]
MIN_USED_LIFE = 0.01
MIN_TIME_PRICE, MAX_TIME_PRICE = 0.1, 10.0


class Worth(NamedTuple):
    """Prices of time and life."""

    time: float  # of a second [s]: 1, or what a second can earn if time is limited
    life: Array  # p(D), of a whole life [s], at each of ``USED_LIVES``


@lru_cache(maxsize=1024)
def worth(scenario: Scenario, overload_price: float) -> Worth:
    """Return the prices of time and life, whose array is cached, for a price of overload [s per s and relative excess of 1]."""
    value, rate, weight = _outcomes(scenario, overload_price)
    least = 0.0 if scenario.control.edge_changes == "commanded" else -np.inf

    def prices(time_price: float) -> Array:
        found = np.empty(len(value))
        break_even(value - time_price, rate, weight, found)
        return np.maximum(found, least)

    if scenario.control.edge_changes == "end":
        return Worth(1.0, prices(1.0))
    edge, change = scenario.economics.edge_cost, scenario.economics.edge_change_time

    def gain_of_an_edge(time_price: float) -> float:
        return float(prices(time_price).mean()) - 60.0 * (edge + time_price * change)

    time_price = 0.0  # the edge does not even pay for itself
    if gain_of_an_edge(0.0) > 0.0:
        from scipy.optimize import brentq  # takes as long as most other imports of the catalogue

        most = min(_MAX_TIME_PRICE, float(value.max()) + 1.0)
        time_price = float(brentq(gain_of_an_edge, 0.0, most, xtol=1e-3))
    return Worth(time_price, prices(time_price))


def _outcomes(scenario: Scenario, overload_price: float) -> tuple[Array, Array, Array]:
    """Return the value of metal less overload [-] and the life used [1/s], for used lives, bars and set points, and bar weights.

    Bars are the nodes of a Gauss-Hermite rule of three points for the deviations of depth and of hardness.
    """
    machine, material, work, limits = scenario.machine, scenario.material, scenario.workpiece, scenario.limits
    normals, weights = np.sqrt(3.0) * np.array([-1.0, 0.0, 1.0]), np.array([1.0, 4.0, 1.0]) / 6.0
    deviation = hypotenuse(work.depth_bar_spread, work.depth_along_spread) * normals
    depth = np.maximum(work.depth_of_cut + deviation, 0.05 * work.depth_of_cut).repeat(3)  # of each bar
    log_hardness = np.tile(hypotenuse(work.hardness_bar_spread, work.hardness_along_spread) * normals, 3)
    log_depth, log_wear = log(depth), log(scenario.tool.wear_criterion) + material.wear.time * log(USED_LIVES)
    log_speed = np.linspace(log(machine.cutting_speed_min), log(machine.cutting_speed_max), _SETTINGS[0])
    least, most = scenario.feed_range
    log_feed = np.linspace(log(least), log(most), _SETTINGS[1])
    log_capacity = log(capacity_at(scenario, exp(log_speed)))

    unworn = log_response(material.wear, 0.0, 0.0, log_depth, 0.0, 0.0, log_hardness) - log(scenario.tool.wear_criterion)
    per_time = 1.0 / material.wear.time
    along_speed = exp(unworn[:, np.newaxis] * per_time + material.wear.cutting_speed * per_time * log_speed)
    rate = along_speed[:, :, np.newaxis] * exp(material.wear.feed * per_time * log_feed) / 60.0  # (bars, speeds, feeds)
    metal = exp(log_speed)[:, np.newaxis] * exp(log_feed) / scenario.economics.reference_removal_rate
    value = np.broadcast_to(metal * depth[:, np.newaxis, np.newaxis], (len(USED_LIVES), *rate.shape)).copy()
    for law, limit, room in ((material.thrust_force, limits.thrust_force, 0.0), (material.power, limits.power, log_capacity)):
        at_one = log_response(law, 0.0, 0.0, log_depth, 0.0, log_wear[:, np.newaxis], log_hardness) - log(limit)
        charge_overload(overload_price, at_one, law.cutting_speed * log_speed - room, law.feed * log_feed, value)
    settings = len(depth), -1
    return value.reshape(len(USED_LIVES), *settings), rate.reshape(settings), np.outer(weights, weights).ravel()


@compiled_entry
def charge_overload(price, at_one, along_speed, along_feed, value):
    """Subtract the price of a load's expected excess over its limit from the ``value`` [-], shape (lives, bars, speeds, feeds).

    The log load over the limit is ``at_one``, shape (lives, bars), at 1 m/min and 1 mm/rev; speeds and feeds add to it.
    """
    for life in range(value.shape[0]):
        for bar in range(value.shape[1]):
            for i in range(value.shape[2]):
                log_load = at_one[life, bar] + along_speed[i]
                for k in range(value.shape[3]):
                    value[life, bar, i, k] -= price * excess(log_load + along_feed[k], SPREAD)[0]


@compiled_entry
def break_even(gain, rate, weight, price):
    """Fill in the price of life [s] at which the best gains, averaged over bars, are 0, for each used life (Dinkelbach 1967).

    Shapes: ``gain`` of set points [-], (lives, bars, set points); ``rate`` of life [1/s], (bars, set points); ``weight`` of bars.
    """
    for life in range(gain.shape[0]):
        price[life], last = price[life - 1] if life > 0 else 0.0, np.inf
        for _ in range(_ITERATIONS):
            if price[life] == last:
                break
            gained, used = 0.0, 0.0
            for bar in range(gain.shape[1]):
                best = best_of(gain[life, bar], rate[bar], price[life])
                gained += weight[bar] * gain[life, bar, best]
                used += weight[bar] * rate[bar, best]
            last, price[life] = price[life], gained / used


@compiled_entry
def price_life(parameters, laws, used_lives, prices):
    """Fill in the price of life [s] at used shares [-], shape (num_envs,), by estimated laws of the expected bar.

    Their numbers, shape (num_envs, 11), are the logarithm of the used life [1/s] at 1 m/min and 1 mm/rev, and exponents of speed
    and feed; likewise of force and of power, over their limits at the end of life, and of used life.
    """
    gained, lasts = np.empty((LIVES + 1, SPEEDS)), np.empty((LIVES + 1, SPEEDS))
    for i in range(len(prices)):
        p, own = parameters[i % len(parameters)], laws[i]
        life_rate, life_speed, life_feed = own[0], own[1], own[2]
        force, force_speed, force_feed, force_life = own[3], own[4], own[5], own[6]
        power, power_speed, power_feed, power_life = own[7], own[8], own[9], own[10]
        for k in range(SPEEDS):
            speed = p.slowest + (p.fastest - p.slowest) * k / (SPEEDS - 1.0)
            capacity = exp(min(speed - p.log_base_speed, 0.0)) - p.idle * exp(speed)
            of_force, of_power = force + force_speed * speed, power + power_speed * speed - log(max(capacity, MIN_CAPACITY))
            for j in range(LIVES + 1):
                log_used = log(min(max(used_lives[i], MIN_USED_LIFE), 1.0) if j == LIVES else (j + 0.5) / LIVES)
                by_force = -(of_force + force_life * log_used) / max(force_feed, MIN_EXPONENT)
                highest = min(by_force, -(of_power + power_life * log_used) / max(power_feed, MIN_EXPONENT))
                feed = min(max(highest, p.lowest), p.highest)
                lasts[j, k] = exp(-(life_rate + life_speed * speed + life_feed * feed))
                gained[j, k] = (p.metal * exp(speed + feed) - p.overload_price * max(feed - highest, 0.0)) * lasts[j, k]
        time = 1.0
        for _ in range(NEWTON_STEPS):
            earned, slope = -(p.edge_cost + time * p.edge_change_time), p.edge_change_time
            for j in range(LIVES):
                best = best_of(gained[j], lasts[j], time)
                price = gained[j, best] - time * lasts[j, best]
                if price > 0.0:
                    earned += price / LIVES
                    slope += lasts[j, best] / LIVES
            time = min(max(time + earned / slope, MIN_TIME_PRICE), MAX_TIME_PRICE)
        best = best_of(gained[LIVES], lasts[LIVES], time)
        prices[i] = max(gained[LIVES, best] - time * lasts[LIVES, best], 0.0)


@compiled_separately
def best_of(gain, rate, price):
    """Return the place of the set point that gains most at a price of its rate."""
    best, most = 0, -np.inf
    for k in range(len(gain)):
        worth = gain[k] - price * rate[k]
        if worth > most:
            best, most = k, worth
    return best
