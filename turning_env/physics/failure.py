"""Failures of the edge beside too large a force: plastic collapse, chipping and notch wear. They count as breakage.

``docs/effects.md`` has equations and sources. An edge chips when the integral of its hazard rate over the cutting time exceeds
its margin, an exponential number with mean 1 that is drawn when the edge is fitted. So the result converges with the sub-step.
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp, log
from turning_env.physics.machinability import log_response

_MAX_EXPONENT = 300.0  # keeps the hazard finite at absurdly high forces


@compiled
def break_failing_edges(state, work, count, p):
    """Break edges that are hotter than they bear, have used up their margin or have too deep a notch, while they cut."""
    if p.collapses:
        for i in range(count):
            speed, feed, depth = work.log_cutting_speed[i], work.log_feed[i], work.log_depth[i]
            log_temperature = log_response(
                p.temperature_law, i, speed, feed, depth, work.log_wear[i], state.log_hardness[i]
            )
            too_hot = log_temperature > p.log_collapse_temperature[i]
            work.broken[i] |= 1 if too_hot and work.engaged[i] > 0.0 else 0
    if p.edges_chip:
        for i in range(count):
            load = log(state.thrust_force[i]) - log(state.edge_strength[i])
            worn = work.log_wear[i] - p.log_wear_criterion[i]
            log_hazard = p.chipping_load_exponent[i] * load + p.chipping_wear_exponent[i] * worn
            state.chipping_margin[i] -= (
                p.chipping_rate[i] * work.engaged[i] * exp(min(log_hazard, _MAX_EXPONENT))
            )
            work.broken[i] |= 1 if state.chipping_margin[i] <= 0.0 and work.engaged[i] > 0.0 else 0
    if p.notches:
        for i in range(count):
            too_deep = (
                p.notch_growth[i] * state.used_life[i] * p.edge_strength[i] > state.edge_strength[i]
            )
            work.broken[i] |= 1 if too_deep and work.engaged[i] > 0.0 else 0
