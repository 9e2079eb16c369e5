"""The search for the cutting speed and feed with the greatest expected gain of a step.

It is Newton's method in log speed and log feed, from the actual ones, within reach, with the gain's derivatives. A step goes to
the top of a parabola within reach; it is shortened until the gain rises. Where the gain is not concave, the parabola takes the
curvatures' magnitudes (Dauphin et al. 2014), so the step still goes uphill.
"""

import math

from baselines.models.normal import excess, probability
from turning_env.numerics.compilation import compiled, compiled_entry, compiled_separately
from turning_env.numerics.functions import exp, log

TRIES = 30  # greatest number of steps that are tried
ENOUGH = 1e-6  # expected rise of the mean gain [-] below which the search ends
FLAT = 1e-6  # curvature that is added, as a parabola without curvature has no top
CORNER = (
    0.001  # log distance from the base speed within which the limit of power bends smoothly [-]
)
NEGLIGIBLE = 6.0  # distance of a load below its limit over its spread [-] from which its excess does not count

SLOWEST, FASTEST, LOWEST, HIGHEST, LOG_SPEED, LOG_FEED, USED_LIFE, BREAKAGE_PRICE = range(8)
"""Numbers of an environment: ends of the reach of log cutting speed [log m/min] and log feed [log mm/rev]; the actual ones; used
share of the edge's life by the nominal model [-]; cost of breaking the edge [s]."""
LIFE_RATE, LIFE_SPEED, LIFE_FEED = range(8, 11)
"""Log rate at which a usual edge's life is used at 1 m/min and 1 mm/rev [1/s]; exponents of speed and feed."""
FORCE_SPEED, FORCE_FEED, FORCE_WEAR, POWER_SPEED, POWER_FEED, POWER_WEAR, ENVIRONMENT = range(
    11, 18
)
"""Exponents of speed, feed and wear in force and power; how many numbers there are."""
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
    POINT,
) = range(10)
"""Numbers of a point ahead of the tool: log ratios of force and power to the nominal model at nominal wear; standard deviations
above 0 of log force and log power in the price of overload, and of log(force / strength of the edge); value of metal over cutting
speed and feed [per m/min and mm/rev]; price of a life [s] that is used at the rate of nominal depth and hardness; 1 in metal,
else 0; 1 in metal of a bar that has not been measured, else 0; how many numbers there are."""


@compiled_entry
def search(parameters, lefts, environments, points, found):
    """Fill in the best log cutting speeds and log feeds, shape (num_envs, 2).

    ``parameters`` are records of laws and prices; ``lefts`` are times of the points after the step's start [s] and remaining
    deviations of the drives [-], shape (3, points); both are for all environments or each. Numbers of environments have the shape
    (num_envs, ENVIRONMENT), those of points (num_envs, POINT, points).
    """
    for i in range(len(found)):
        p, left, env, ahead = (
            parameters[i % len(parameters)],
            lefts[i % len(lefts)],
            environments[i],
            points[i],
        )
        x = min(max(env[LOG_SPEED], env[SLOWEST]), env[FASTEST])
        y = min(max(env[LOG_FEED], env[LOWEST]), env[HIGHEST])
        gain, dx, dy, rise = outlook(p, left, env, ahead, x, y)
        for _ in range(TRIES):
            if rise < ENOUGH:
                break
            there = outlook(p, left, env, ahead, x + dx, y + dy)
            if there[0] > gain:
                x, y = x + dx, y + dy
                gain, dx, dy, rise = there
            else:
                dx, dy, rise = 0.5 * dx, 0.5 * dy, 0.5 * rise
        found[i, 0], found[i, 1] = x, y


@compiled_separately
def outlook(p, left, env, ahead, x, y):
    """Return the mean gain [s of machine time per s] expected of a commanded log speed x and log feed y, and the next step."""
    points, overload_price = left.shape[1], -p.overload_price
    sums, worst, worst_x, worst_y = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), -math.inf, 0.0, 0.0
    for k in range(points):
        a, b = 1.0 - left[1, k], 1.0 - left[2, k]
        speed, feed = (
            env[LOG_SPEED] + a * (x - env[LOG_SPEED]),
            env[LOG_FEED] + b * (y - env[LOG_FEED]),
        )
        metal = ahead[METAL_VALUE, k] * exp(speed + feed)
        sums = plus(sums, metal, metal, metal, a, b)
        if ahead[CUTTING, k] == 0.0:
            continue
        rate = exp(env[LIFE_RATE] + env[LIFE_SPEED] * speed + env[LIFE_FEED] * feed)
        cost = -ahead[LIFE_PRICE, k] * rate
        sums = plus(sums, cost, cost, cost, a * env[LIFE_SPEED], b * env[LIFE_FEED])
        used = env[USED_LIFE] + rate * left[0, k]
        wear, by_rate = p.wear_time * log(used), p.wear_time * rate * left[0, k] / used
        wear_x, wear_y = by_rate * a * env[LIFE_SPEED], by_rate * b * env[LIFE_FEED]
        force = (
            p.force
            + env[FORCE_SPEED] * speed
            + env[FORCE_FEED] * feed
            + env[FORCE_WEAR] * wear
            + ahead[LOG_FORCE, k]
        )
        force_x, force_y = (
            env[FORCE_SPEED] * a + env[FORCE_WEAR] * wear_x,
            env[FORCE_FEED] * b + env[FORCE_WEAR] * wear_y,
        )
        if force > -NEGLIGIBLE * ahead[FORCE_SPREAD, k]:
            over, slope, bend = excess(force, ahead[FORCE_SPREAD, k])
            sums = plus(
                sums,
                overload_price * over,
                overload_price * slope,
                overload_price * bend,
                force_x,
                force_y,
            )
        above = speed - p.log_base_speed
        root = math.sqrt(above * above + CORNER * CORNER)
        power = (
            p.power
            + env[POWER_SPEED] * speed
            + env[POWER_FEED] * feed
            + env[POWER_WEAR] * wear
            + ahead[LOG_POWER, k]
        )
        power += 0.5 * (root - above)
        if power > -NEGLIGIBLE * ahead[POWER_SPREAD, k]:
            over, slope, bend = excess(power, ahead[POWER_SPREAD, k])
            power_x = (env[POWER_SPEED] + 0.5 * (above / root - 1.0)) * a + env[POWER_WEAR] * wear_x
            power_y = env[POWER_FEED] * b + env[POWER_WEAR] * wear_y
            sums = plus(
                sums,
                overload_price * over,
                overload_price * slope,
                overload_price * bend,
                power_x,
                power_y,
            )
            sums = plus(
                sums,
                0.0,
                0.0,
                overload_price * slope * 0.5 * (CORNER * CORNER) / (root * root * root),
                a,
                0.0,
            )
        deviation = (force - p.log_strength) / ahead[STRENGTH_SPREAD, k]
        if ahead[UNMEASURED, k] > 0.0 and deviation > worst:
            worst, worst_x, worst_y = (
                deviation,
                force_x / ahead[STRENGTH_SPREAD, k],
                force_y / ahead[STRENGTH_SPREAD, k],
            )
    if worst > -math.inf:
        risk, density = probability(worst)
        price = -env[BREAKAGE_PRICE] / p.interval * points
        sums = plus(sums, price * risk, price * density, -price * density * worst, worst_x, worst_y)
    dx, dy, rise = step(env, x, y, sums)
    return sums[0] / points, dx, dy, rise / points


@compiled
def plus(sums, value, slope, bend, x, y):
    """Add a term to sums of values, slopes and curvatures; x and y are the slopes of the form of which it is a function."""
    total, by_x, by_y, by_xx, by_xy, by_yy = sums
    bend_x, bend_y = bend * x, bend * y
    return (
        total + value,
        by_x + slope * x,
        by_y + slope * y,
        by_xx + bend_x * x,
        by_xy + bend_x * y,
        by_yy + bend_y * y,
    )


@compiled
def step(env, x, y, sums):
    """Return the step to the top within reach of the parabola with these slopes and magnitudes of curvatures, and its rise."""
    _, by_x, by_y, by_xx, by_xy, by_yy = sums
    determinant = abs(by_xx * by_yy - by_xy * by_xy)
    root = math.sqrt(by_xx * by_xx + 2.0 * by_xy * by_xy + by_yy * by_yy + 2.0 * determinant) + FLAT
    xx = (by_xx * by_xx + by_xy * by_xy + determinant) / root + FLAT
    yy = (by_yy * by_yy + by_xy * by_xy + determinant) / root + FLAT
    xy = by_xy * (by_xx + by_yy) / root
    dx = min(max((by_x * yy - by_y * xy) / (xx * yy - xy * xy), env[SLOWEST] - x), env[FASTEST] - x)
    dy = min(max((by_y - xy * dx) / yy, env[LOWEST] - y), env[HIGHEST] - y)
    best = dx, dy, by_x * dx + by_y * dy - 0.5 * (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy)
    dy = min(max((by_y * xx - by_x * xy) / (xx * yy - xy * xy), env[LOWEST] - y), env[HIGHEST] - y)
    dx = min(max((by_x - xy * dy) / xx, env[SLOWEST] - x), env[FASTEST] - x)
    rise = by_x * dx + by_y * dy - 0.5 * (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy)
    return (dx, dy, rise) if rise > best[2] else best
