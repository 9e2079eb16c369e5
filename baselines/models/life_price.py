"""The price of edge life by laws that a filter estimates, computed anew in every step.

It is that of ``edge_value.py``, but simpler: bars are as expected, and the feed is the highest that keeps the loads within their
limits, or the nearest that the chip breaker allows. At a price t of time, a job earns nothing at a used share D of an edge's life
if life has the price

    p(D) = max over cutting speeds of (value of metal less overload - t) / life used per time,

and t is such that a whole edge just pays for itself and its change (Newton's method).
"""

import numpy as np

from turning_env.numerics.compilation import compiled_entry, compiled_separately
from turning_env.numerics.functions import exp, log

LIVES = 6
"""Number of used shares of the life at which it is priced, beside the present one."""
SPEEDS = 24
"""Number of cutting speeds that are compared, evenly spaced on a logarithmic scale."""
NEWTON_STEPS = 8
MIN_EXPONENT = 0.1
"""Least exponent of the feed in a load [-]."""
MIN_CAPACITY = 1e-3
"""Least power of the spindle, less idle power, over the limit [-]."""
MIN_USED_LIFE = 0.01
MIN_TIME_PRICE, MAX_TIME_PRICE = 0.1, 10.0

LAWS = (
    "life_rate",
    "life_speed",
    "life_feed",
    "force",
    "force_speed",
    "force_feed",
    "force_life",
    "power",
    "power_speed",
    "power_feed",
    "power_life",
)
"""Estimates of an environment's laws in the expected bar: the logarithms of the used life [1/s], and of force and power of the
cut over their limits at the end of life, at 1 m/min and 1 mm/rev; exponents of speed, feed and, of loads, used life."""


@compiled_entry
def price_life(parameters, laws, used_life, prices):
    """Fill in the price of life [s] at used shares, shape (num_envs,); ``laws``: shape (num_envs, len(LAWS))."""
    gained, lasts = np.empty((LIVES + 1, SPEEDS)), np.empty((LIVES + 1, SPEEDS))
    for i in range(len(prices)):
        prices[i] = price_one(parameters[i % len(parameters)], laws[i], used_life[i], gained, lasts)


@compiled_separately
def price_one(p, laws, used_life, gained, lasts):
    """Return the price of life [s] in one environment."""
    life_rate, life_speed, life_feed, force, force_speed, force_feed, force_life, power, power_speed, power_feed, power_life = (
        laws
    )
    for k in range(SPEEDS):
        speed = p.slowest + (p.fastest - p.slowest) * k / (SPEEDS - 1.0)
        capacity = exp(min(speed - p.log_base_speed, 0.0)) - p.idle * exp(speed)
        of_force, of_power = force + force_speed * speed, power + power_speed * speed - log(max(capacity, MIN_CAPACITY))
        for j in range(LIVES + 1):
            share = min(max(used_life, MIN_USED_LIFE), 1.0) if j == LIVES else (j + 0.5) / LIVES
            log_used = log(share)
            highest = min(
                -(of_force + force_life * log_used) / max(force_feed, MIN_EXPONENT),
                -(of_power + power_life * log_used) / max(power_feed, MIN_EXPONENT),
            )
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
    return max(gained[LIVES, best] - time * lasts[LIVES, best], 0.0)


@compiled_separately
def best_of(gained, lasts, time):
    """Return the place of the speed at which life has the greatest price."""
    best, most = 0, gained[0] - time * lasts[0]
    for k in range(1, SPEEDS):
        price = gained[k] - time * lasts[k]
        if price > most:
            best, most = k, price
    return best
