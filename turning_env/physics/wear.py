"""Used life and wear of the edge.

``docs/models.md`` has the two rules, phases of wear and built-up edges.

A fresh edge at constant parameters wears as W = K t^n (Alaskari and Oraby 2018), where K comes from
the wear law and n is its exponent of time. The state is the used share of the edge's life,
D = (W / W_max)^(1/n), from which the wear follows: W = W_max D^n. By equivalent time,
dD/dt = (K / W_max)^(1/n). By clock time, each step adds K (t_i^n - t_{i-1}^n) to W.
"""

from typing import Any, NamedTuple

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp, log, real_power, where

EQUIVALENT_TIME, CLOCK_TIME = range(2)
WEAR_RULES = {"equivalent_time": EQUIVALENT_TIME, "clock_time": CLOCK_TIME}


class Phases(NamedTuple):
    """Numbers of the phases of wear and of built-up edges (``EdgeFailure``)."""

    tertiary_wear: Any  # [mm]
    tertiary_rate: Any  # [1/mm]
    running_in: Any  # [-]
    running_in_wear: Any  # [mm]
    built_up_edge: Any  # [-]
    log_built_up_speed: Any  # [log m/min]
    built_up_width: Any  # [-]


@compiled
def life_share(p, i, log_wear_coefficient, time):
    """Return the share of life [-] that an edge uses in a cutting time, by equivalent time.

    The time is in minutes, at constant log K: D = t (K / W_max)^(1/n).
    """
    return time * exp((log_wear_coefficient - p.log_wear_criterion[i]) * p.life_exponent[i])


@compiled
def life_by_clock(p, i, used_life, log_wear_coefficient, start, end):
    """Return the used life [-] after cutting from ``start`` to ``end`` [min], by clock time.

    At constant log K: D^n grows by K / W_max (t_end^n - t_start^n).
    """
    n = p.wear_law.time[i]
    growth = exp(log_wear_coefficient - p.log_wear_criterion[i]) * (
        real_power(end, n) - real_power(start, n)
    )
    return real_power(real_power(used_life, n) + growth, p.life_exponent[i])


@compiled
def advance_used_life(p, i, used_life, log_wear_coefficient, start, end):
    """Return the used life [-] after cutting from ``start`` to ``end`` at constant log K.

    Both are cutting times of the edge [min]; the scenario decides the rule.
    """
    if p.wear_rule == EQUIVALENT_TIME:
        return used_life + life_share(p, i, log_wear_coefficient, end - start)
    return life_by_clock(p, i, used_life, log_wear_coefficient, start, end)


@compiled
def with_phases(p, i, before, after, log_cutting_speed):
    """Return the used life [-] after a short cut, with phases of wear and built-up edge.

    Without these, the cut would take it from ``before`` to ``after``. Forms and numbers are
    assumptions (``docs/models.md``).
    """
    phases = Phases(
        tertiary_wear=p.tertiary_wear[i],
        tertiary_rate=p.tertiary_rate[i],
        running_in=p.running_in[i],
        running_in_wear=p.running_in_wear[i],
        built_up_edge=p.built_up_edge[i],
        log_built_up_speed=p.log_built_up_speed[i],
        built_up_width=p.built_up_width[i],
    )
    wear = exp(log_wear(p, i, before))
    return before + (after - before) * phase_factor(phases, wear, log_cutting_speed)


@compiled
def phase_factor(phases, wear, log_cutting_speed):
    """Return the rate of wear over that of the power law [-], by ``Phases``.

    The flank wear is in mm, the cutting speed in m/min; numbers or arrays.
    """
    # Tertiary wear: beyond its limit, the rate grows exponentially with the wear.
    beyond = wear - phases.tertiary_wear
    factor = exp(phases.tertiary_rate * where(beyond > 0.0, beyond, 0.0))
    # Running in: a sharp edge wears faster.
    factor = factor * (1.0 + phases.running_in * exp(-wear / phases.running_in_wear))
    # Built-up edge: a bell over the logarithm of the cutting speed.
    off = (log_cutting_speed - phases.log_built_up_speed) / phases.built_up_width
    return factor * (1.0 + phases.built_up_edge * exp(-off * off))


@compiled
def log_wear(p, i, used_life):
    """Return the logarithm of the flank wear [mm]; the edge must have cut (used life above 0)."""
    return p.log_wear_criterion[i] + p.wear_law.time[i] * log(used_life)
