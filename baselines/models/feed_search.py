"""The search for the cutting speed and feed with the greatest expected gain of a step.

It is Newton's method in log speed and log feed, from the actual ones, within reach. With x the
logarithms of commanded speed and feed, g the slopes of the gain and H its curvatures, a step
maximises the parabola

    g' dx - dx' |H| dx / 2        within reach

and is shortened until the gain rises. |H| has the eigenvalues' magnitudes (Dauphin et al. 2014,
"Identifying and attacking the saddle point problem"), so the step goes uphill where the gain is not
concave, too.

Trying a grid of 20 x 20 set points within reach takes 6 times as long on RoughTurning-v0 and does
not return more: Newton's method returns 10 s more (standard error 9 s, 64 tuning seeds; ``python -m
research.studies.searches``). The laws are those of ``scenario/laws.py`` in logarithms, with slopes.

The optimiser fills in the records; this file knows neither scenarios nor filters.
"""

import math
from typing import NamedTuple

import numpy as np

from baselines.models.normal import excess, probability
from turning_env.numerics.compilation import compiled, compiled_entry, compiled_separately
from turning_env.numerics.functions import exp, log
from turning_env.numerics.wear_term import term_over_criterion, wear_term_slope

MAX_STEPS = 30  # steps that are tried
MIN_RISE = 1e-6  # expected rise of the mean gain [-] below which the search ends
FLAT = 1e-6  # curvature that is added, because a parabola without curvature has no top
CORNER = 0.001
"""Log distance from the base speed within which the limit of power bends smoothly [-]."""
NEGLIGIBLE = 6.0
"""Distance of a load below its limit over its spread [-] from which its excess does not count."""

ENVIRONMENT = np.dtype(
    (
        np.record,
        [
            # Reach of the command: log cutting speed [log m/min] and log feed [log mm/rev].
            ("min_log_speed", np.float64),
            ("max_log_speed", np.float64),
            ("min_log_feed", np.float64),
            ("max_log_feed", np.float64),
            # Actual values, likewise.
            ("log_speed", np.float64),
            ("log_feed", np.float64),
            ("used_life", np.float64),  # of the edge, by the nominal model [-]
            ("breakage_price", np.float64),  # cost of breaking the edge [s]
            # Log rate at which a usual edge's life is used at 1 m/min and 1 mm/rev [log 1/s],
            # and its exponents.
            ("log_life_rate", np.float64),
            ("life_speed", np.float64),
            ("life_feed", np.float64),
            # Exponents of speed, feed and wear in force and power.
            ("force_speed", np.float64),
            ("force_feed", np.float64),
            ("force_wear", np.float64),
            ("power_speed", np.float64),
            ("power_feed", np.float64),
            ("power_wear", np.float64),
            # Growth of their wear terms at the edge's wear criterion (``numerics/wear_term.py``).
            ("force_growth", np.float64),
            ("power_growth", np.float64),
        ],
    )
)
"""Numbers of an environment."""

POINT = np.dtype(
    (
        np.record,
        [
            # Log ratios of force and power to the nominal model at nominal wear [-].
            ("log_force", np.float64),
            ("log_power", np.float64),
            # Standard deviations above 0 of log force, of log power (both in the price of
            # overload), and of log(force / strength of the edge) [-].
            ("force_spread", np.float64),
            ("power_spread", np.float64),
            ("strength_spread", np.float64),
            # Value of metal over cutting speed and feed [per m/min and mm/rev].
            ("metal_value", np.float64),
            # Price of a life that is used at the rate of nominal depth and hardness [s].
            ("life_price", np.float64),
            ("cutting", np.float64),  # 1 in metal, else 0
            ("unmeasured", np.float64),  # 1 in metal of a bar that has not been measured, else 0
        ],
    )
)
"""Numbers of a point ahead of the tool."""

MOMENT = np.dtype(
    (
        np.record,
        [
            ("time", np.float64),  # after the step's start [s]
            # Shares of a deviation of the drives from their commands that remain [-].
            ("speed_left", np.float64),
            ("feed_left", np.float64),
        ],
    )
)
"""The moment of a point."""

SET_POINT = np.dtype((np.record, [("log_speed", np.float64), ("log_feed", np.float64)]))
"""A commanded set point [log m/min], [log mm/rev]."""


class Gain(NamedTuple):
    """A gain [s of machine time per s] with its derivatives by commanded log speed and log feed."""

    value: float
    by_speed: float
    by_feed: float
    by_speed_speed: float
    by_speed_feed: float
    by_feed_feed: float


class Newton(NamedTuple):
    """A step in log speed and log feed, and the rise of the gain that a parabola expects of it."""

    log_speed: float
    log_feed: float
    rise: float


class SearchPoint(NamedTuple):
    """A set point that was tried."""

    gain: float  # mean over the points [s of machine time per s]
    step: Newton  # to the next set point


class LogLoad(NamedTuple):
    """The log load over its limit, with its slopes by the commanded log speed and log feed."""

    value: float
    by_speed: float
    by_feed: float


class State(NamedTuple):
    """Log speed, log feed and log wear at a point, with their slopes by the commanded ones."""

    speed: float
    feed: float
    wear: float  # over the wear criterion
    speed_by_speed: float
    feed_by_feed: float
    wear_by_speed: float
    wear_by_feed: float


@compiled_entry
def search(parameters, moments, environments, points, best):
    """Fill in the best set points.

    Args:
        parameters: records of laws and prices (``edge_value.life_numbers``), for all environments
            or each.
        moments: records of ``MOMENT``, shape (1 or num_envs, points).
        environments: records of ``ENVIRONMENT``, shape (num_envs,).
        points: records of ``POINT``, shape (num_envs, points).
        best: records of ``SET_POINT``, shape (num_envs,), which are overwritten.
    """
    for i in range(len(best)):
        p = parameters[i % len(parameters)]
        times = moments[i % len(moments)]
        env = environments[i]
        ahead = points[i]
        log_speed = min(max(env.log_speed, env.min_log_speed), env.max_log_speed)
        log_feed = min(max(env.log_feed, env.min_log_feed), env.max_log_feed)
        start = try_set_point(p, times, env, ahead, log_speed, log_feed)
        gain = start.gain
        step = start.step
        for _ in range(MAX_STEPS):
            if step.rise < MIN_RISE:
                break
            new_log_speed = log_speed + step.log_speed
            new_log_feed = log_feed + step.log_feed
            trial = try_set_point(p, times, env, ahead, new_log_speed, new_log_feed)
            if trial.gain > gain:
                log_speed = new_log_speed
                log_feed = new_log_feed
                gain = trial.gain
                step = trial.step
            else:
                step = Newton(0.5 * step.log_speed, 0.5 * step.log_feed, rise=0.5 * step.rise)
        best[i].log_speed = log_speed
        best[i].log_feed = log_feed


@compiled_separately
def try_set_point(p, times, env, ahead, log_speed, log_feed):
    """Return the ``SearchPoint`` of a commanded set point: mean gain, and Newton's step from it.

    The gain [s of machine time per s] is a mean over points ahead of the tool. At each it is

        value of metal - price of the life used - price of overload

    and, once for all points, - price of breakage.

    Args:
        p: record of the numbers that all environments share.
        times: records ``MOMENT``, one of each point.
        env: record ``ENVIRONMENT``.
        ahead: records ``POINT``, shape (points,).
        log_speed: commanded log cutting speed [log m/min].
        log_feed: commanded log feed [log mm/rev].
    """
    points = len(ahead)
    gain = Gain(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    worst = LogLoad(-math.inf, 0.0, 0.0)
    for k in range(points):
        point = ahead[k]
        # The drives follow their commands with lags.
        by_speed = 1.0 - times[k].speed_left
        by_feed = 1.0 - times[k].feed_left
        speed = env.log_speed + by_speed * (log_speed - env.log_speed)
        feed = env.log_feed + by_feed * (log_feed - env.log_feed)
        metal = point.metal_value * exp(speed + feed)
        gain = with_term(gain, metal, metal, metal, by_speed, by_feed)
        if point.cutting == 0.0:
            continue

        life_rate = exp(env.log_life_rate + env.life_speed * speed + env.life_feed * feed)
        cost = -point.life_price * life_rate
        life_by_speed = by_speed * env.life_speed
        life_by_feed = by_feed * env.life_feed
        gain = with_term(gain, cost, cost, cost, life_by_speed, life_by_feed)

        # The used life grows with time: D = D0 + rate * time, and wear is D^wear_time.
        used_life = env.used_life + life_rate * times[k].time
        wear_by_rate = p.wear_time * life_rate * times[k].time / used_life
        state = State(
            speed=speed,
            feed=feed,
            wear=p.wear_time * log(used_life),
            speed_by_speed=by_speed,
            feed_by_feed=by_feed,
            wear_by_speed=wear_by_rate * by_speed * env.life_speed,
            wear_by_feed=wear_by_rate * by_feed * env.life_feed,
        )
        force = force_at(p, env, point, state)
        gain = charge_overload(p, gain, force, point.force_spread)
        gain = charge_power(p, gain, env, point, state)
        deviation = (force.value - p.log_strength) / point.strength_spread
        if point.unmeasured > 0.0 and deviation > worst.value:
            worst = LogLoad(
                value=deviation,
                by_speed=force.by_speed / point.strength_spread,
                by_feed=force.by_feed / point.strength_spread,
            )
    if worst.value > -math.inf:
        gain = charge_breakage(p, gain, env, worst, points)
    step = newton_step(env, gain, log_speed, log_feed)
    mean_step = Newton(step.log_speed, step.log_feed, rise=step.rise / points)
    return SearchPoint(gain.value / points, mean_step)


@compiled
def force_at(p, env, point, state):
    """Return the log force over its limit."""
    by_wear = env.force_wear * wear_term_slope(env.force_growth, state.wear)
    return LogLoad(
        value=p.log_force_coefficient
        + env.force_speed * state.speed
        + env.force_feed * state.feed
        + env.force_wear * term_over_criterion(env.force_growth, state.wear)
        + point.log_force,
        by_speed=env.force_speed * state.speed_by_speed + by_wear * state.wear_by_speed,
        by_feed=env.force_feed * state.feed_by_feed + by_wear * state.wear_by_feed,
    )


@compiled
def charge_overload(p, gain, load, spread):
    """Return the gain less the price of a load's expected excess over its limit."""
    if load.value <= -NEGLIGIBLE * spread:
        return gain
    price = -p.overload_price
    over = excess(load.value, spread)
    return with_term(
        gain,
        price * over.value,
        price * over.slope,
        price * over.curvature,
        load.by_speed,
        load.by_feed,
    )


@compiled
def charge_power(p, gain, env, point, state):
    """Return the gain less the price of the power's expected excess over its limit."""
    # Below the base speed V_b, the limit falls with the speed. In logarithms, with u = log(V /
    # V_b), power over limit rises by max(-u, 0), which is smoothed to (sqrt(u^2 + corner^2) - u) /
    # 2.
    above = state.speed - p.log_base_speed
    root = math.sqrt(above * above + CORNER * CORNER)
    value = (
        p.log_power_coefficient
        + env.power_speed * state.speed
        + env.power_feed * state.feed
        + env.power_wear * term_over_criterion(env.power_growth, state.wear)
        + point.log_power
    )
    value += 0.5 * (root - above)
    if value <= -NEGLIGIBLE * point.power_spread:
        return gain
    speed_exponent = env.power_speed + 0.5 * (above / root - 1.0)
    by_wear = env.power_wear * wear_term_slope(env.power_growth, state.wear)
    power = LogLoad(
        value=value,
        by_speed=speed_exponent * state.speed_by_speed + by_wear * state.wear_by_speed,
        by_feed=env.power_feed * state.feed_by_feed + by_wear * state.wear_by_feed,
    )
    price = -p.overload_price
    over = excess(power.value, point.power_spread)
    gain = with_term(
        gain,
        price * over.value,
        price * over.slope,
        price * over.curvature,
        power.by_speed,
        power.by_feed,
    )
    # The corner itself is curved: d2/du2 of the smoothed term is corner^2 / (2 root^3).
    corner = price * over.slope * 0.5 * (CORNER * CORNER) / (root * root * root)
    return with_term(gain, 0.0, 0.0, corner, state.speed_by_speed, 0.0)


@compiled
def charge_breakage(p, gain, env, worst, points):
    """Return the gain less the price of the risk that an unmeasured bar breaks the edge.

    ``worst``: log(force / strength) in standard deviations, at the point where it is highest. The
    risk is the normal probability below it.
    """
    # The gain is a sum over the points of a step, in terms per second. The edge breaks at most once
    # in the step, so the price is divided by the step's length and counts for all points at once.
    risk = probability(worst.value)
    price = -env.breakage_price / p.interval * points
    return with_term(
        gain,
        price * risk.below,
        price * risk.density,
        -price * risk.density * worst.value,
        worst.by_speed,
        worst.by_feed,
    )


@compiled
def with_term(gain, value, slope, curvature, by_speed, by_feed):
    """Return a ``Gain`` with one more term: a function of x, such as the log of a load.

    Args:
        gain: the gain without the term.
        value: value of the term; like the next two, in the gain's unit.
        slope: derivative of the term by x.
        curvature: second derivative of the term by x.
        by_speed: derivative of x by commanded log speed [-].
        by_feed: derivative of x by commanded log feed [-].
    """
    # The chain rule. Second derivatives of x are left out: most x are linear in the logarithms.
    curvature_by_speed = curvature * by_speed
    curvature_by_feed = curvature * by_feed
    return Gain(
        value=gain.value + value,
        by_speed=gain.by_speed + slope * by_speed,
        by_feed=gain.by_feed + slope * by_feed,
        by_speed_speed=gain.by_speed_speed + curvature_by_speed * by_speed,
        by_speed_feed=gain.by_speed_feed + curvature_by_speed * by_feed,
        by_feed_feed=gain.by_feed_feed + curvature_by_feed * by_feed,
    )


@compiled
def newton_step(env, gain, log_speed, log_feed):
    """Return the ``Newton`` step to the top, within reach, of a parabola about a set point.

    The parabola has the slopes g of the ``gain`` at the set point, ``log_speed`` [log m/min] and
    ``log_feed`` [log mm/rev], and the curvatures -|H|.
    """
    # |H| is the root of H^2. For 2 x 2 matrices, with d = |det H|, it is
    #     |H| = (H^2 + d I) / sqrt(trace H^2 + 2 d)
    ss = gain.by_speed_speed
    sf = gain.by_speed_feed
    ff = gain.by_feed_feed
    determinant = abs(ss * ff - sf * sf)
    root = math.sqrt(ss * ss + 2.0 * sf * sf + ff * ff + 2.0 * determinant) + FLAT
    parabola = Gain(
        value=0.0,
        by_speed=gain.by_speed,
        by_feed=gain.by_feed,
        by_speed_speed=(ss * ss + sf * sf + determinant) / root + FLAT,
        by_speed_feed=sf * (ss + ff) / root,
        by_feed_feed=(ff * ff + sf * sf + determinant) / root + FLAT,
    )
    # If the top is out of reach, the best point lies on an edge of the reach: with the speed
    # clipped and the best feed for it, or the other way round.
    speed_first = step_of_speed_first(env, parabola, log_speed, log_feed)
    feed_first = step_of_feed_first(env, parabola, log_speed, log_feed)
    return feed_first if feed_first.rise > speed_first.rise else speed_first


@compiled
def step_of_speed_first(env, parabola, log_speed, log_feed):
    """Return the step to the top's log speed within reach, and the best log feed for it."""
    b = parabola
    determinant = b.by_speed_speed * b.by_feed_feed - b.by_speed_feed * b.by_speed_feed
    top = (b.by_speed * b.by_feed_feed - b.by_feed * b.by_speed_feed) / determinant
    speed_step = min(max(top, env.min_log_speed - log_speed), env.max_log_speed - log_speed)
    best = (b.by_feed - b.by_speed_feed * speed_step) / b.by_feed_feed
    feed_step = min(max(best, env.min_log_feed - log_feed), env.max_log_feed - log_feed)
    return Newton(speed_step, feed_step, rise=rise_of(parabola, speed_step, feed_step))


@compiled
def step_of_feed_first(env, parabola, log_speed, log_feed):
    """Return the step to the top's log feed within reach, and the best log speed for it."""
    b = parabola
    determinant = b.by_speed_speed * b.by_feed_feed - b.by_speed_feed * b.by_speed_feed
    top = (b.by_feed * b.by_speed_speed - b.by_speed * b.by_speed_feed) / determinant
    feed_step = min(max(top, env.min_log_feed - log_feed), env.max_log_feed - log_feed)
    best = (b.by_speed - b.by_speed_feed * feed_step) / b.by_speed_speed
    speed_step = min(max(best, env.min_log_speed - log_speed), env.max_log_speed - log_speed)
    return Newton(speed_step, feed_step, rise=rise_of(parabola, speed_step, feed_step))


@compiled
def rise_of(parabola, speed_step, feed_step):
    """Return the rise of a parabola along a step; its curvatures are given by magnitudes."""
    curved = (
        parabola.by_speed_speed * speed_step * speed_step
        + 2.0 * parabola.by_speed_feed * speed_step * feed_step
        + parabola.by_feed_feed * feed_step * feed_step
    )
    return parabola.by_speed * speed_step + parabola.by_feed * feed_step - 0.5 * curved
