"""The price of edge life that maximises the return of a whole edge.

The environment charges used life at a constant price. But a fresh edge earns more than its time
costs, and a worn edge does not. So life is worth saving at first, but not towards the end. The
return of a whole edge is greatest if, at every used share D of its life, the set point maximises

    value of metal - time - overload - p(D) dD/dt

where p(D) is the price at which the best set point gains nothing:

    p(D) = max over cutting speeds of (metal - overload - price of time) / life used per time

This is dynamic programming over D, with one equation per D, because the used life only grows
(Bellman 1957). The charged price does not enter, because a whole edge costs the same under every
policy. A slower or faster insert needs no other price if dD is counted at the nominal rate. Bars
are as expected, and the feed is the highest that keeps the loads within their limits, or the
nearest that the chip breaker allows.

If edges are changed and time is limited, a second costs what it could earn elsewhere: at that price
of time, a whole edge just pays for itself, its change and their time. If they are changed on
command, worthless life need not be used: the price is at least 0, and the best time to change the
edge is when it reaches 0.

Every step prices the life of every environment, with exponents as the filter believes them. So the
laws of ``scenario/laws.py`` stand here in logarithms in a compiled loop, with the highest feed at a
speed in closed form (``laws.feed_at_limit``).
"""

from typing import Any

import numpy as np

from turning_env import PowerLaw, Scenario
from turning_env.numerics.compilation import compiled, compiled_entry, compiled_separately
from turning_env.numerics.functions import exp, log
from turning_env.numerics.wear_term import term_over_criterion
from turning_env.scenario.laws import idle_power_at, load_spread

PRICED_SPREAD = 0.6
"""Standard deviations over bars that loads lie above the expected, at known laws [-] (found on
tuning seeds)."""
LIVES = 6  # used shares of the life over which the price of time is found
SPEEDS = 24  # cutting speeds that are compared, evenly spaced on a logarithmic scale
NEWTON_STEPS = 8
MIN_EXPONENT = 0.1  # lower bound of the exponent of feed in a load [-]
MIN_CAPACITY = 1e-3  # lower bound of the spindle's power, less idle power, over the limit [-]
MIN_USED_LIFE = 0.01
MIN_BASE_SPEED = 1e-9  # in place of 0, where there is no base speed [m/min]
MIN_TIME_PRICE = 0.1
MAX_TIME_PRICE = 10.0

EXPECTED_LAWS = np.dtype(
    (
        np.record,
        [
            # Log rate at which the life is used at 1 m/min and 1 mm/rev [log 1/s]; its exponents.
            ("log_life_rate", np.float64),
            ("life_speed", np.float64),
            ("life_feed", np.float64),
            # Log force over its limit at 1 m/min, 1 mm/rev and the end of life; its exponents of
            # speed and feed, and of used life if its wear term has no growth; that growth, over the
            # whole life. Then likewise of power.
            ("log_force", np.float64),
            ("force_speed", np.float64),
            ("force_feed", np.float64),
            ("force_life", np.float64),
            ("force_growth", np.float64),
            ("log_power", np.float64),
            ("power_speed", np.float64),
            ("power_feed", np.float64),
            ("power_life", np.float64),
            ("power_growth", np.float64),
        ],
    )
)
"""Laws of the expected bar."""

PRICES = np.dtype(
    (
        np.record,
        [
            ("time", np.float64),  # of a second [s]: 1, or what a second can earn if it is limited
            ("life", np.float64),  # p(D), of a whole life [s]
        ],
    )
)
"""Prices of time and life."""


def life_numbers(scenario: Scenario, severity: float) -> dict[str, Any]:
    """Return the numbers of a scenario for this file and ``feed_search.py``.

    ``severity``: factor on the price of overload [-].
    """
    material = scenario.material
    limits = scenario.limits
    tool = scenario.tool
    economics = scenario.economics
    work = scenario.workpiece
    edge_changes = scenario.control.edge_changes
    min_feed, max_feed = scenario.feed_range

    def at_one(law: PowerLaw, limit: float) -> float:
        """Return log(response / limit) at 1 m/min, 1 mm/rev, nominal depth and worn edge."""
        return float(log(law(1.0, 1.0, work.depth_of_cut, wear=tool.wear_criterion) / limit))

    # W = a t^n reaches the criterion W_max at D = 1, so the used life is D = (W / W_max)^(1/n).
    # The law of wear is in minutes, its rate in seconds.
    wear = material.wear
    return {
        "log_life_rate": at_one(wear, tool.wear_criterion) / wear.time - log(60.0),
        "life_speed": wear.cutting_speed / wear.time,
        "life_feed": wear.feed / wear.time,
        "wear_time": wear.time,  # n
        "log_force_coefficient": at_one(material.thrust_force, limits.thrust_force),
        "log_power_coefficient": at_one(material.power, limits.power),
        "force_spread": load_spread(material.thrust_force, work),
        "power_spread": load_spread(material.power, work),
        "log_base_speed": log(scenario.base_cutting_speed or MIN_BASE_SPEED),
        "log_strength": float(log(tool.edge_strength / limits.thrust_force)),
        "overload_price": severity * economics.overload_price,
        "interval": scenario.control.interval,  # [s]
        # Range of the set point [log m/min], [log mm/rev].
        "min_log_speed": log(scenario.machine.cutting_speed_min),
        "max_log_speed": log(scenario.cutting_speed_max),
        "min_log_feed": log(min_feed),
        "max_log_feed": log(max_feed),
        # Value of metal over cutting speed and feed [per m/min and mm/rev].
        "metal_value": work.depth_of_cut / economics.reference_removal_rate,
        # Idle power over the limit, per cutting speed [min/m].
        "idle_power": idle_power_at(scenario, 1.0) / limits.power,
        "edge_cost": 60.0 * economics.edge_cost,  # [s]
        "edge_change_time": 60.0 * economics.edge_change_time,  # [s]
        # 1 if a second could be spent elsewhere, else 0.
        "limits_time": float(edge_changes != "end"),
        "min_life_price": 0.0 if edge_changes == "commanded" else -np.inf,  # [s]
    }


@compiled_entry
def price_life(parameters, laws, used_lives, prices):
    """Fill in the prices of time and life.

    Args:
        parameters: records of ``life_numbers``, for all environments or each.
        laws: records of ``EXPECTED_LAWS``, shape (num_envs,).
        used_lives: used shares D of the edges' lives [-], shape (num_envs,).
        prices: records of ``PRICES``, shape (num_envs,), which are overwritten.
    """
    # Earnings of each set point until the edge is worn out [s], and the time until then [s]. The
    # rows are used lives; the last one is that of the edge in use.
    earnings = np.empty((LIVES + 1, SPEEDS))
    durations = np.empty((LIVES + 1, SPEEDS))
    for i in range(len(prices)):
        p = parameters[i % len(parameters)]
        used_life = min(max(used_lives[i], MIN_USED_LIFE), 1.0)
        compare_speeds(p, laws[i], used_life, earnings, durations)
        time = 1.0
        if p.limits_time > 0.0:
            time = price_of_time(p, earnings, durations)
        best = best_of(earnings[LIVES], durations[LIVES], time)
        life = earnings[LIVES, best] - time * durations[LIVES, best]
        prices[i].time = time
        prices[i].life = max(life, p.min_life_price)


@compiled
def compare_speeds(p, law, used_life, earnings, durations):
    """Fill in ``earnings`` [s] and ``durations`` [s] of the rest of an edge's life.

    Their shape is (LIVES + 1, SPEEDS): a row for each used life, the last one for ``used_life``
    [-], and a column for each cutting speed, with the highest feed within the limits. ``law`` is a
    record of ``EXPECTED_LAWS``.
    """
    for k in range(SPEEDS):
        speed = p.min_log_speed + (p.max_log_speed - p.min_log_speed) * k / (SPEEDS - 1.0)
        # Power that is left for the cut over the limit, which falls below the base speed.
        capacity = exp(min(speed - p.log_base_speed, 0.0)) - p.idle_power * exp(speed)
        force = law.log_force + law.force_speed * speed
        power = law.log_power + law.power_speed * speed - log(max(capacity, MIN_CAPACITY))
        for j in range(LIVES + 1):
            log_used = log(used_life if j == LIVES else (j + 0.5) / LIVES)
            force_term = life_term(law.force_growth, p.wear_time, log_used)
            power_term = life_term(law.power_growth, p.wear_time, log_used)
            force_feed = -(force + law.force_life * force_term) / max(law.force_feed, MIN_EXPONENT)
            power_feed = -(power + law.power_life * power_term) / max(law.power_feed, MIN_EXPONENT)
            highest = min(force_feed, power_feed)
            feed = min(max(highest, p.min_log_feed), p.max_log_feed)
            durations[j, k] = exp(
                -(law.log_life_rate + law.life_speed * speed + law.life_feed * feed)
            )
            # Above the highest feed, loads exceed their limits in about the same proportion.
            rate = p.metal_value * exp(speed + feed) - p.overload_price * max(feed - highest, 0.0)
            earnings[j, k] = rate * durations[j, k]


@compiled
def life_term(growth, wear_time, log_used):
    """Return the log of the wear term over a worn-out edge's, over n, at the log of the used life.

    The wear is W_max D^n, with n the ``wear_time``, so the term of a power law is log D.
    """
    if growth > 0.0:
        return term_over_criterion(growth, wear_time * log_used) / wear_time
    return log_used


@compiled
def price_of_time(p, earnings, durations):
    """Return the price of a second [s] at which a whole edge pays for itself, by Newton's method.

    ``earnings`` and ``durations`` are those of ``compare_speeds``.
    """
    # Find c such that mean over D of max(p(D), 0) = edge cost + c * change time, where
    # p(D) = earnings - c * durations at the best set point. By the envelope theorem, dp/dc =
    # -durations.
    time = 1.0
    for _ in range(NEWTON_STEPS):
        surplus = -(p.edge_cost + time * p.edge_change_time)
        slope = p.edge_change_time
        for j in range(LIVES):
            best = best_of(earnings[j], durations[j], time)
            life_price = earnings[j, best] - time * durations[j, best]
            if life_price > 0.0:
                surplus += life_price / LIVES
                slope += durations[j, best] / LIVES
        time = min(max(time + surplus / slope, MIN_TIME_PRICE), MAX_TIME_PRICE)
    return time


@compiled_separately
def best_of(gain, rate, price):
    """Return the index at which gain - price * rate is highest; arrays of one shape."""
    best = 0
    max_worth = -np.inf
    for k in range(len(gain)):
        worth = gain[k] - price * rate[k]
        if worth > max_worth:
            best = k
            max_worth = worth
    return best
