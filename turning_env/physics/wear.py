"""Used life and wear of the edge.

``docs/models.md`` has the two rules, phases of wear and built-up edges.

A fresh edge at constant parameters wears as W = K t^n (Alaskari and Oraby 2018), where K comes from
the wear law and n is its exponent of time. The state is the used share of the edge's life,
D = (W / W_max)^(1/n), from which the wear follows: W = W_max D^n. By equivalent time,
dD/dt = (K / W_max)^(1/n). By clock time, each step adds K (t_i^n - t_{i-1}^n) to W.
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp, log, real_power

EQUIVALENT_TIME, CLOCK_TIME = range(2)
WEAR_RULES = {"equivalent_time": EQUIVALENT_TIME, "clock_time": CLOCK_TIME}


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
    wear = exp(log_wear(p, i, before))
    # Tertiary wear: beyond its limit, the rate grows exponentially with the wear.
    factor = exp(p.tertiary_rate[i] * max(wear - p.tertiary_wear[i], 0.0))
    # Running in: a sharp edge wears faster.
    factor *= 1.0 + p.running_in[i] * exp(-wear / p.running_in_wear[i])
    # Built-up edge: a bell over the logarithm of the cutting speed.
    off = (log_cutting_speed - p.log_built_up_speed[i]) / p.built_up_width[i]
    factor *= 1.0 + p.built_up_edge[i] * exp(-off * off)
    return before + (after - before) * factor


@compiled
def log_wear(p, i, used_life):
    """Return the logarithm of the flank wear [mm]; the edge must have cut (used life above 0)."""
    return p.log_wear_criterion[i] + p.wear_law.time[i] * log(used_life)
