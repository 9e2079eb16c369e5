"""Failures of the edge beside too large a force: plastic collapse, chipping and notch wear.

They count as breakage. ``docs/models.md`` has equations and sources.
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp, log
from turning_env.physics.machinability import log_response

_MAX_EXPONENT = 300.0  # keeps the hazard finite at absurdly high forces


@compiled
def break_failing_edges(state, work, count, p):
    """Break edges that fail while they cut: too hot, chipped, or with too deep a notch."""
    if p.collapses:
        for i in range(count):
            collapse(state, work, i, p)
    if p.edges_chip:
        for i in range(count):
            chip(state, work, i, p)
    if p.notches:
        for i in range(count):
            break_at_notch(state, work, i, p)


@compiled
def collapse(state, work, i, p):
    """Break an edge that is hotter than it bears (test T9 of the grid search paper)."""
    log_temperature = log_response(
        p.temperature_law,
        i,
        log_cutting_speed=work.log_cutting_speed[i],
        log_feed=work.log_feed[i],
        log_depth_of_cut=work.log_depth[i],
        wear_term=work.log_wear[i],
        log_hardness=state.log_hardness[i],
    )
    too_hot = log_temperature > p.log_collapse_temperature[i]
    work.broken[i] |= 1 if too_hot and work.engaged[i] > 0.0 else 0


@compiled
def chip(state, work, i, p):
    """Break an edge whose chipping hazard, integrated over the cutting time, exceeds its margin.

    rate = k (F / strength)^a (W / W_max)^b (assumption). The margin is an exponential number with
    mean 1 that is drawn when the edge is fitted, so the result converges with the sub-step.
    """
    log_load = log(state.thrust_force[i]) - log(state.edge_strength[i])
    log_worn = work.log_wear[i] - p.log_wear_criterion[i]
    log_hazard = p.chipping_load_exponent[i] * log_load + p.chipping_wear_exponent[i] * log_worn
    hazard = exp(min(log_hazard, _MAX_EXPONENT))
    state.chipping_margin[i] -= p.chipping_rate[i] * work.engaged[i] * hazard
    work.broken[i] |= 1 if state.chipping_margin[i] <= 0.0 and work.engaged[i] > 0.0 else 0


@compiled
def break_at_notch(state, work, i, p):
    """Break an edge where g D exceeds its strength over the median strength (assumption)."""
    notch = p.notch_growth[i] * state.used_life[i]
    too_deep = notch * p.edge_strength[i] > state.edge_strength[i]
    work.broken[i] |= 1 if too_deep and work.engaged[i] > 0.0 else 0
