"""The price of edge life that maximises the return of a whole edge.

The environment charges used life at a constant price. But a fresh edge earns more than its time costs, and a worn edge does not.
So life is worth saving at first, but not towards the end. The return of a whole edge is greatest if, at every used share D of its
life, the set point maximises

    value of metal - time - overload - p(D) dD/dt

where p(D) is the price at which the best set point gains nothing:

    p(D) = max over cutting speeds of (value of metal less overload - price of time) / life used per time

This is dynamic programming over D, with one equation per D, because the used life only grows (Bellman 1957). The charged price
does not enter, because a whole edge costs the same under every policy. A slower or faster insert needs no other price if dD is
counted at the nominal rate. Bars are as expected, and the feed is the highest that keeps the loads within their limits, or the
nearest that the chip breaker allows.

If edges are changed and time is limited, a second costs what it could earn elsewhere: at that price of time, a whole edge just
pays for itself, its change and their time. If they are changed on command, worthless life need not be used: the price is at least
0, and the best time to change the edge is when it reaches 0.
"""

from typing import Any

import numpy as np

from turning_env import PowerLaw, Scenario
from turning_env.numerics.compilation import compiled_entry, compiled_separately
from turning_env.numerics.functions import exp, hypotenuse, log
from turning_env.physics.spindle import idle_power_at

PRICED_SPREAD = 0.6  # standard deviations over bars that loads lie above the expected, at known laws [-] (found on tuning seeds)
LIVES = 6  # number of used shares of the life over which the price of time is found
SPEEDS = 24  # number of cutting speeds that are compared, evenly spaced on a logarithmic scale
NEWTON_STEPS = 8
MIN_EXPONENT = 0.1  # least exponent of the feed in a load [-]
MIN_CAPACITY = 1e-3  # least power of the spindle, less idle power, over the limit [-]
MIN_USED_LIFE = 0.01
MIN_TIME_PRICE, MAX_TIME_PRICE = 0.1, 10.0


def numbers(scenario: Scenario, severity: float) -> dict[str, Any]:
    """Return what ``feed_search.py`` and this file must know of a scenario; ``severity``: factor on the price of overload [-]."""
    material, limits, tool, economics = (
        scenario.material,
        scenario.limits,
        scenario.tool,
        scenario.economics,
    )
    work, changes = scenario.workpiece, scenario.control.edge_changes
    depth_spread = hypotenuse(work.depth_bar_spread, work.depth_along_spread) / work.depth_of_cut
    hardness_spread = hypotenuse(work.hardness_bar_spread, work.hardness_along_spread)

    def at_one(law: PowerLaw, limit: float) -> float:
        """Return log(response / limit) at 1 m/min, 1 mm/rev, nominal depth and the wear criterion."""
        return float(log(law(1.0, 1.0, work.depth_of_cut, wear=tool.wear_criterion) / limit))

    wear, loads = material.wear, (material.thrust_force, material.power)
    life = at_one(wear, tool.wear_criterion) / wear.time - log(60.0)
    return {
        "life": (
            life,
            wear.cutting_speed / wear.time,
            wear.feed / wear.time,
        ),  # of the log used life [1/s]
        "force": at_one(material.thrust_force, limits.thrust_force),
        "power": at_one(material.power, limits.power),
        # Standard deviations over bars of log force and log power:
        "spreads": [
            hypotenuse(law.depth_of_cut * depth_spread, law.hardness * hardness_spread)
            for law in loads
        ],
        "wear_time": wear.time,
        "log_base_speed": log(scenario.base_cutting_speed or 1e-9),
        "log_strength": float(log(tool.edge_strength / limits.thrust_force)),
        "overload_price": severity * economics.overload_price,
        "interval": scenario.control.interval,
        "slowest": log(scenario.machine.cutting_speed_min),
        "fastest": log(scenario.cutting_speed_max),
        "lowest": log(scenario.feed_range[0]),
        "highest": log(scenario.feed_range[1]),
        "metal": work.depth_of_cut / economics.reference_removal_rate,
        "idle": idle_power_at(scenario, 1.0) / limits.power,
        "edge_cost": 60.0 * economics.edge_cost,
        "edge_change_time": 60.0 * economics.edge_change_time,
        "limits_time": float(changes != "end"),
        "least_price": 0.0 if changes == "commanded" else -np.inf,  # of life [s]
    }


@compiled_entry
def price_life(parameters, laws, used_lives, found):
    """Fill in the prices of time [s] and life [s], shape (num_envs, 2), at used shares [-], by laws of the expected bar.

    Their numbers, shape (num_envs, 11), are the logarithm of the used life [1/s] at 1 m/min and 1 mm/rev, and exponents of speed
    and feed; likewise of force and of power, over their limits at the end of life, and of used life.
    """
    gained, lasts = np.empty((LIVES + 1, SPEEDS)), np.empty((LIVES + 1, SPEEDS))
    for i in range(len(found)):
        p, own = parameters[i % len(parameters)], laws[i]
        life_rate, life_speed, life_feed = own[0], own[1], own[2]
        force, force_speed, force_feed, force_life = own[3], own[4], own[5], own[6]
        power, power_speed, power_feed, power_life = own[7], own[8], own[9], own[10]
        for k in range(SPEEDS):
            speed = p.slowest + (p.fastest - p.slowest) * k / (SPEEDS - 1.0)
            capacity = exp(min(speed - p.log_base_speed, 0.0)) - p.idle * exp(speed)
            of_force, of_power = (
                force + force_speed * speed,
                power + power_speed * speed - log(max(capacity, MIN_CAPACITY)),
            )
            for j in range(LIVES + 1):
                log_used = log(
                    min(max(used_lives[i], MIN_USED_LIFE), 1.0) if j == LIVES else (j + 0.5) / LIVES
                )
                by_force = -(of_force + force_life * log_used) / max(force_feed, MIN_EXPONENT)
                highest = min(
                    by_force, -(of_power + power_life * log_used) / max(power_feed, MIN_EXPONENT)
                )
                feed = min(max(highest, p.lowest), p.highest)
                lasts[j, k] = exp(-(life_rate + life_speed * speed + life_feed * feed))
                gained[j, k] = (
                    p.metal * exp(speed + feed) - p.overload_price * max(feed - highest, 0.0)
                ) * lasts[j, k]
        time = 1.0
        for _ in range(NEWTON_STEPS if p.limits_time > 0.0 else 0):
            earned, slope = -(p.edge_cost + time * p.edge_change_time), p.edge_change_time
            for j in range(LIVES):
                best = best_of(gained[j], lasts[j], time)
                price = gained[j, best] - time * lasts[j, best]
                if price > 0.0:
                    earned += price / LIVES
                    slope += lasts[j, best] / LIVES
            time = min(max(time + earned / slope, MIN_TIME_PRICE), MAX_TIME_PRICE)
        best = best_of(gained[LIVES], lasts[LIVES], time)
        found[i, 0], found[i, 1] = (
            time,
            max(gained[LIVES, best] - time * lasts[LIVES, best], p.least_price),
        )


@compiled_separately
def best_of(gain, rate, price):
    """Return the place of the set point that gains most at a price of its rate."""
    best, most = 0, -np.inf
    for k in range(len(gain)):
        worth = gain[k] - price * rate[k]
        if worth > most:
            best, most = k, worth
    return best
