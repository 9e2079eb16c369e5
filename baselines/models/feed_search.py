"""The search for the cutting speed and feed with the greatest expected gain of a step.

It climbs on a grid of cutting speeds from the middle to the best one. For each speed it climbs on a grid of feeds, and on finer
ones around the best feed. A parabola through the best speed and its neighbours gives the speed between them.

The order of operations is part of a rule's version: other last bits of a gain, amplified by the parabola, change an episode.
"""

import math

import numpy as np

from baselines.models.normal import excess, probability
from turning_env.numerics.compilation import compiled, compiled_entry, compiled_separately

SPEEDS = 7
"""Number of cutting speeds to try, from the lowest to the highest within reach."""
FEEDS, REFINEMENTS = 9, 3
"""Number of feeds to try for each cutting speed, and of grids; each grid refines the last around its best feed."""
MARGIN = 1e-9
"""Difference of gains [-] that rounding does not reach."""
NEGLIGIBLE = 10.0
"""Distance of a load below its limit over its spread [-] from which the expected excess does not reach a gain's last bit."""

ENVIRONMENT = (
    *("slowest", "fastest", "lowest", "highest", "log_speed", "log_feed", "used_life", "breakage_price"),
    *("force_speed", "force_feed", "force_wear", "power_speed", "power_feed", "power_wear"),
)
"""Numbers of an environment: ends of the reach of log cutting speed and log feed, the first fields of ``Prospect``, exponents."""
SLOWEST, FASTEST, LOWEST, HIGHEST, LOG_SPEED, LOG_FEED, USED_LIFE, BREAKAGE_PRICE = range(8)
FORCE_SPEED, FORCE_FEED, FORCE_WEAR, POWER_SPEED, POWER_FEED, POWER_WEAR = range(8, len(ENVIRONMENT))
POINT = (
    "log_force",
    "log_power",
    "force_spread",
    "power_spread",
    "strength_spread",
    "metal_value",
    "life_price",
    "cutting",
    "unmeasured",
)
"""Numbers of a point ahead of the tool; see ``Prospect``. The spreads are above 0."""
LOG_FORCE, LOG_POWER, FORCE_SPREAD, POWER_SPREAD, STRENGTH_SPREAD, METAL_VALUE, LIFE_PRICE, CUTTING, UNMEASURED = range(
    len(POINT)
)


@compiled_entry
def search(parameters, lefts, environments, points, found):
    """Find the best cutting speeds and feeds.

    Args:
        parameters: laws and prices, an array of one record for all environments or one for each.
        lefts: times of the points after the step's start [s], and remaining deviations of the drives [-], shape (3, points), for
            all environments or each.
        environments: ``ENVIRONMENT``, shape (num_envs, fields).
        points: ``POINT``, shape (num_envs, fields, points).
        found: filled with log cutting speeds and log feeds, shape (num_envs, 2).
    """
    speeds, feeds, gains = np.empty(SPEEDS), np.empty(SPEEDS), np.empty(SPEEDS)
    work = np.empty((3, lefts.shape[2]))
    for i in range(len(found)):
        p, left = parameters[i % len(parameters)], lefts[i % len(lefts)]
        env, ahead = environments[i], points[i]
        for k in range(SPEEDS):
            speeds[k] = rung(env[SLOWEST], env[FASTEST], k, SPEEDS)
        top = SPEEDS // 2
        feeds[top], gains[top] = best_feed(p, left, env, ahead, speeds[top], work)
        for k in range(top + 1, SPEEDS):
            feeds[k], gains[k] = best_feed(p, left, env, ahead, speeds[k], work)
            if not gains[k] > gains[top]:
                break
            top = k
        if top == SPEEDS // 2:
            for k in range(top - 1, -1, -1):
                feeds[k], gains[k] = best_feed(p, left, env, ahead, speeds[k], work)
                if gains[k] < gains[top]:
                    break
                top = k
        speed, feed = between(speeds, feeds, gains, top)
        better = gain(p, left, env, ahead, speed, feed, -np.inf, work) > gains[top]
        found[i, 0], found[i, 1] = (speed, feed) if better else (speeds[top], feeds[top])


@compiled
def rung(low, high, index, count):
    """Return one of several values from low to high, as ``numpy.linspace`` does."""
    return high if index == count - 1 else index * ((high - low) / (count - 1)) + low


@compiled_separately
def best_feed(p, left, env, ahead, speed, work):
    """Return (best log feed, its gain) at a log speed."""
    low, high, top, best = env[LOWEST], env[HIGHEST], FEEDS // 2, -np.inf
    for grid in range(REFINEMENTS):
        if grid > 0:
            low, high = rung(low, high, max(top - 1, 0), FEEDS), rung(low, high, min(top + 1, FEEDS - 1), FEEDS)
        top = FEEDS // 2
        best = gain(p, left, env, ahead, speed, rung(low, high, top, FEEDS), -np.inf, work)
        for k in range(top + 1, FEEDS):
            value = gain(p, left, env, ahead, speed, rung(low, high, k, FEEDS), best - MARGIN, work)
            if not value > best:
                break
            best, top = value, k
        if top == FEEDS // 2:
            for k in range(top - 1, -1, -1):
                value = gain(p, left, env, ahead, speed, rung(low, high, k, FEEDS), best - MARGIN, work)
                if value < best:
                    break
                best, top = value, k
    return rung(low, high, top, FEEDS), best


@compiled
def between(speeds, feeds, gains, top):
    """Return the log speed and log feed at the top of a parabola through the best speed and its neighbours."""
    middle = min(max(top, 1), SPEEDS - 2)
    a, b, c = middle - 1, middle, middle + 1
    curvature = 2.0 * gains[b] - gains[a] - gains[c]
    share = 0.5 * (gains[c] - gains[a]) / curvature if curvature > 0.0 else 0.0
    share = min(max(share, -1.0), 1.0)
    below, at, above = 0.5 * share * (share - 1.0), 1.0 - share * share, 0.5 * share * (share + 1.0)
    speed = below * speeds[a] + at * speeds[b] + above * speeds[c]
    feed = below * feeds[a] + at * feeds[b] + above * feeds[c]
    return speed, min(max(feed, min(feeds[a], feeds[b], feeds[c])), max(feeds[a], feeds[b], feeds[c]))


@compiled_separately
def gain(p, left, env, ahead, log_speed, log_feed, least, work):
    """Return the expected mean gain [s of machine time per s] of a commanded log speed and log feed.

    If the gain is below ``least`` even without overload and breakage, it is returned without them.
    """
    points = left.shape[1]
    wear_law = p.wear
    for k in range(points):
        speed = log_speed + (env[LOG_SPEED] - log_speed) * left[1, k]
        feed = log_feed + (env[LOG_FEED] - log_feed) * left[2, k]
        work[1, k] = ahead[METAL_VALUE, k] * math.exp(speed + feed)
        work[2, k] = math.exp((wear_law[0] + wear_law[1] * speed + wear_law[2] * feed) / p.wear_time) / 60.0  # life used [1/s]
        work[0, k] = work[1, k] - ahead[CUTTING, k] * (ahead[LIFE_PRICE, k] * work[2, k])
    most = mean(work[0])
    if most < least:
        return most
    risk = 0.0
    for k in range(points):
        if ahead[CUTTING, k] == 0.0:
            continue
        speed = log_speed + (env[LOG_SPEED] - log_speed) * left[1, k]
        feed = log_feed + (env[LOG_FEED] - log_feed) * left[2, k]
        wear = p.wear_time * math.log(env[USED_LIFE] + work[2, k] * left[0, k])
        force = p.force + env[FORCE_SPEED] * speed + env[FORCE_FEED] * feed + env[FORCE_WEAR] * wear + ahead[LOG_FORCE, k]
        power = p.power + env[POWER_SPEED] * speed + env[POWER_FEED] * feed + env[POWER_WEAR] * wear + ahead[LOG_POWER, k]
        power -= min(speed - p.log_base_speed, 0.0)
        overload = 0.0
        if force > -NEGLIGIBLE * ahead[FORCE_SPREAD, k]:
            overload += excess(force, ahead[FORCE_SPREAD, k])
        if power > -NEGLIGIBLE * ahead[POWER_SPREAD, k]:
            overload += excess(power, ahead[POWER_SPREAD, k])
        work[0, k] = work[1, k] - (ahead[LIFE_PRICE, k] * work[2, k] + p.overload_price * overload)
        if ahead[UNMEASURED, k] > 0.0:
            risk = max(risk, probability((force - p.log_strength) / ahead[STRENGTH_SPREAD, k]))
    return mean(work[0]) - env[BREAKAGE_PRICE] * risk / p.interval


@compiled
def mean(values):
    """Return the mean, added up as NumPy does up to eight values."""
    if len(values) == 8:
        low, high = (values[0] + values[1]) + (values[2] + values[3]), (values[4] + values[5]) + (values[6] + values[7])
        return (low + high) / 8.0
    total = 0.0
    for value in values:
        total += value
    return total / len(values)
