"""The search for the cutting speed and feed with the greatest expected gain of a step.

It tries a grid of feeds for each of several cutting speeds and refines it around the best feed. A parabola through the best speed
and its neighbours gives the speed between them. Gains enter the tried values only through comparisons. So the last bits of
exponentials hardly ever change an action.
"""

from typing import NamedTuple

import numpy as np

from baselines.models.kalman import Array
from baselines.models.normal import excess, probability
from turning_env.numerics.compilation import compiled, compiled_entry, compiled_separately
from turning_env.numerics.functions import exp, log

SPEEDS = 7
"""Number of cutting speeds to try, from the lowest to the highest within reach."""
FEEDS, REFINEMENTS = 9, 3
"""Number of feeds to try for each cutting speed, and of grids; each grid refines the last around its best feed."""
NEGLIGIBLE = 9.0
"""Distance of a load below its limit over its spread [-] from which the expected excess is 0 to the last bit of a gain."""


class Prospect(NamedTuple):
    """The terms of the gain. A field has shape (num_envs,), from ``log_force`` on (num_envs, points ahead of the tool)."""

    slowest: Array
    """Lowest cutting speed within reach [log m/min]."""
    fastest: Array
    """Highest cutting speed within reach [log m/min]."""
    lowest: Array
    """Lowest feed within reach [log mm/rev]."""
    highest: Array
    """Highest feed within reach [log mm/rev]."""
    log_speed: Array
    """Actual cutting speed [log m/min]."""
    log_feed: Array
    """Actual feed [log mm/rev]."""
    used_life: Array
    """Used share of the edge's life by the nominal model [-]."""
    breakage_price: Array
    """Cost of breaking the edge [s]."""
    log_force: Array
    """Log ratio of thrust force to the nominal model at nominal wear [-]."""
    log_power: Array
    """Log ratio of power to the nominal model at nominal wear [-]."""
    force_spread: Array
    """Standard deviation of log force in the price of overload [-], above 0."""
    power_spread: Array
    """Standard deviation of log power in the price of overload [-], above 0."""
    strength_spread: Array
    """Standard deviation of log(force / strength of the edge) [-], above 0."""
    metal_value: Array
    """Value of metal over cutting speed and feed [per m/min and mm/rev]."""
    life_price: Array
    """Price of a life [s] that is used at the rate of nominal depth and hardness."""
    cutting: Array
    """1 in metal, 0 in air."""
    unmeasured: Array
    """1 in metal of a bar that has not been measured, else 0."""


ONES = Prospect._fields.index("log_force")
"""Number of fields that have one number per environment."""
SLOWEST, FASTEST, LOWEST, HIGHEST, LOG_SPEED, LOG_FEED, USED_LIFE, BREAKAGE_PRICE = range(ONES)
(
    LOG_FORCE,
    LOG_POWER,
    FORCE_SPREAD,
    POWER_SPREAD,
    STRENGTH_SPREAD,
    METAL_VALUE,
    LIFE_PRICE,
    CUTTING,
    UNMEASURED,
) = range(len(Prospect._fields) - ONES)


@compiled_entry
def search(parameters, left, environments, points, found):
    """Find the best cutting speeds and feeds.

    Args:
        parameters: laws and prices, an array of one record.
        left: times of the points after the step's start [s], and remaining deviations of the drives [-], shape (3, points).
        environments: fields of a prospect with a number per environment, shape (num_envs, fields).
        points: the other fields, shape (num_envs, fields, points).
        found: filled with cutting speeds [m/min] and feeds [mm/rev], shape (num_envs, 2).
    """
    p = parameters[0]
    feeds, gains = np.empty(SPEEDS), np.empty(SPEEDS)
    work = np.empty((3, left.shape[1])), np.empty(FEEDS)
    for i in range(len(found)):
        env, ahead = environments[i], points[i]
        for k in range(SPEEDS):
            feeds[k], gains[k] = best_feed(p, left, env, ahead, rung(env[SLOWEST], env[FASTEST], k, SPEEDS), work)
        top = int(np.argmax(gains))
        speed, feed = between(env[SLOWEST], env[FASTEST], feeds, gains, top)
        if not gain(p, left, env, ahead, speed, feed, work[0]) > gains[top]:
            speed, feed = rung(env[SLOWEST], env[FASTEST], top, SPEEDS), feeds[top]
        found[i, 0], found[i, 1] = exp(speed), exp(feed)


@compiled_separately
def best_feed(p, left, env, ahead, speed, work):
    """Return (best feed, its gain) at a log speed."""
    low, high = env[LOWEST], env[HIGHEST]
    gains = work[1]
    for k in range(FEEDS):
        gains[k] = gain(p, left, env, ahead, speed, rung(low, high, k, FEEDS), work[0])
    top = int(np.argmax(gains))
    for _ in range(REFINEMENTS - 1):
        best = gains[top]
        low, high = rung(low, high, max(top - 1, 0), FEEDS), rung(low, high, min(top + 1, FEEDS - 1), FEEDS)
        if 0 < top < FEEDS - 1:
            top = FEEDS // 2  # the same feed in the new grid; of the others only those on the way uphill are tried
        gains[:] = np.nan
        gains[top] = best
        climbing = True
        while climbing:
            start = top
            for k in range(max(start - 1, 0), min(start + 2, FEEDS)):
                if np.isnan(gains[k]):
                    gains[k] = gain(p, left, env, ahead, speed, rung(low, high, k, FEEDS), work[0])
                if gains[k] > gains[top]:
                    top = k
            climbing = top != start
    return rung(low, high, top, FEEDS), gains[top]


@compiled
def rung(low, high, index, count):
    """Return one of several values from low to high."""
    return high if index == count - 1 else low + index * ((high - low) / (count - 1))


@compiled
def between(slowest, fastest, feeds, gains, top):
    """Return the log speed and log feed at the top of a parabola through the best speed and its neighbours."""
    middle = min(max(top, 1), SPEEDS - 2)
    a, b, c = middle - 1, middle, middle + 1
    curvature = 2.0 * gains[b] - gains[a] - gains[c]
    share = 0.5 * (gains[c] - gains[a]) / curvature if curvature > 0.0 else 0.0
    share = min(max(share, -1.0), 1.0)
    below, at, above = 0.5 * share * (share - 1.0), 1.0 - share * share, 0.5 * share * (share + 1.0)
    feed = below * feeds[a] + at * feeds[b] + above * feeds[c]
    feed = min(max(feed, min(feeds[a], feeds[b], feeds[c])), max(feeds[a], feeds[b], feeds[c]))
    return rung(slowest, fastest, middle, SPEEDS) + share * (fastest - slowest) / (SPEEDS - 1), feed


@compiled_separately
def gain(p, left, env, ahead, log_speed, log_feed, work):
    """Return the expected mean gain [s of machine time per s] of a commanded log speed and log feed."""
    points = left.shape[1]
    wear, force, power, per_wear_time = p.wear, p.force, p.power, 1.0 / p.wear_time
    speed_off, feed_off, used_life = env[LOG_SPEED] - log_speed, env[LOG_FEED] - log_feed, env[USED_LIFE]
    for k in range(points):
        speed = log_speed + speed_off * left[1, k]
        feed = log_feed + feed_off * left[2, k]
        life_rate = exp((wear[0] + wear[1] * speed + wear[2] * feed) * per_wear_time) / 60.0  # [1/s]
        log_wear = p.wear_time * log(used_life + life_rate * left[0, k])
        capacity = min(speed - p.log_base_speed, 0.0)
        work[0, k] = force[0] + force[1] * speed + force[2] * feed + force[3] * log_wear + ahead[LOG_FORCE, k]
        work[1, k] = power[0] + power[1] * speed + power[2] * feed + power[3] * log_wear + ahead[LOG_POWER, k] - capacity
        work[2, k] = ahead[METAL_VALUE, k] * exp(speed + feed) - ahead[CUTTING, k] * ahead[LIFE_PRICE, k] * life_rate
    for load in range(2):
        near = False
        for k in range(points):
            near |= ahead[CUTTING, k] > 0.0 and work[load, k] > -NEGLIGIBLE * ahead[FORCE_SPREAD + load, k]
        if near:
            for k in range(points):
                price = p.overload_price * ahead[CUTTING, k]
                work[2, k] -= price * excess(work[load, k], ahead[FORCE_SPREAD + load, k])
    total, risk = 0.0, 0.0
    for k in range(points):
        total += work[2, k]
        if ahead[UNMEASURED, k] > 0.0:
            risk = max(risk, probability((work[0, k] - p.log_strength) / ahead[STRENGTH_SPREAD, k]))
    return total / points - env[BREAKAGE_PRICE] * risk / p.interval
