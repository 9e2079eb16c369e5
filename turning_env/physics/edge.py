"""Edges: fit, use, break and replace them, and charge life and time.

An edge is charged as its used share of life grows, so every step pays for the life that it uses. A broken edge costs
its remaining share, and the downtime. (Life charge: cost of a part, adaptive part programming paper, tau_I and
Q_I; breakage: assumption, see docs/choices.md.)

If an episode ends with its edge, the price of an edge includes the time to change it, and breakage its downtime; no time passes.
If edges are changed, the time passes. Random properties of edges: see ``docs/models.md``.
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp
from turning_env.numerics.keyed_random import EDGE_CHANNEL, standard_normals
from turning_env.numerics.per_env import at
from turning_env.physics.failure import draw_chipping_margin
from turning_env.physics.spindle import cool_down
from turning_env.physics.wear import log_wear


@compiled
def fit_edge(state, i, parameters):
    """Put the present edge into the holder; the nominal model takes it as fresh, and the tool is out of the metal."""
    p = at(parameters, i)
    edge_normal, strength_normal = standard_normals(state, i, EDGE_CHANNEL, 0, state.edge[i])
    state.log_wear_factor[i] = p.log_wear_mismatch + p.wear_factor_spread * edge_normal
    state.edge_strength[i] = p.edge_strength * exp(p.edge_strength_spread * strength_normal)
    if p.edges_chip:
        draw_chipping_margin(state, i)
    state.cutting_time[i] = 0.0
    state.used_life[i] = p.initial_used_life
    state.nominal_used_life[i] = 0.0
    state.thrust_force[i] = 0.0
    state.power[i] = 0.0
    state.lagged_thrust_force[i] = 0.0
    state.lagged_power[i] = 0.0


@compiled
def charge(report, i, parameters, share):
    """Charge a share of an edge's life."""
    report.edges_used[i] += share
    report.reward_edge[i] -= at(parameters, i).edge_price * share


@compiled
def break_edge(state, report, i, parameters):
    """Charge a broken edge's remaining life, and the downtime."""
    p = at(parameters, i)
    lost = max(0.0, 1.0 - state.used_life[i])
    report.edges_used[i] += lost
    report.edges_broken[i] += 1.0
    report.reward_breakage[i] -= p.edge_price * lost + p.breakage_price


@compiled
def replace_edge(state, report, i, parameters, broken):
    """Change an edge that is broken or worn out."""
    p = at(parameters, i)
    found = p.breakage_downtime if broken else p.unplanned_stop
    change_edge(state, report, i, p, found + p.edge_change_time)


@compiled
def discard_edge(state, report, i, parameters):
    """Change an edge on command, and charge its remaining life."""
    charge(report, i, parameters, max(0.0, 1.0 - state.used_life[i]))
    change_edge(state, report, i, parameters, at(parameters, i).edge_change_time)


@compiled
def change_edge(state, report, i, parameters, minutes):
    """Inspect the edge and put in the next one, which takes ``minutes`` of machine time."""
    p = at(parameters, i)
    if p.inspects_edges:
        state.removed_wear[i] = exp(log_wear(p, state.used_life[i])) if state.used_life[i] > 0.0 else 0.0
    stop_machine(state, report, i, parameters, minutes)
    state.edge[i] += 1
    fit_edge(state, i, parameters)


@compiled
def stop_machine(state, report, i, parameters, minutes):
    """Let machine time pass while the machine stands, but not beyond the end of an episode that ends by the clock."""
    minutes = max(min(minutes, at(parameters, i).clock_limit - state.clock[i]), 0.0)
    state.clock[i] += minutes
    report.time[i] += 60.0 * minutes
    report.stopped_time[i] += 60.0 * minutes
    cool_down(state, i, parameters, minutes)
