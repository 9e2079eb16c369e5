"""Edges: fit, use, break and replace them, and charge life and time.

An edge is charged as its used share of life grows, so every step pays for the life that it uses. A
broken edge costs its remaining share, and the downtime. If an episode ends with its edge, the price
of an edge includes the time to change it, and breakage its downtime; no time passes. If edges are
changed, the time passes. (Prices and laws: ``docs/models.md``.)
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp
from turning_env.numerics.keyed_random import (
    CHIPPING_CHANNEL,
    EDGE_CHANNEL,
    exponential,
    standard_normals,
)
from turning_env.physics.spindle import cool_down
from turning_env.physics.wear import log_wear


@compiled
def fit_edge(state, i, p):
    """Put the present edge into the holder, out of the metal.

    Inserts differ: wear and strength are log-normal. The nominal model takes every edge as fresh.
    """
    edge_normal, strength_normal = standard_normals(
        state, i, channel=EDGE_CHANNEL, bar=0, index=state.edge[i]
    )
    state.log_wear_factor[i] = p.log_wear_mismatch[i] + p.wear_factor_spread[i] * edge_normal
    state.edge_strength[i] = p.edge_strength[i] * exp(p.edge_strength_spread[i] * strength_normal)
    if p.edges_chip:
        state.chipping_margin[i] = exponential(
            state, i, channel=CHIPPING_CHANNEL, bar=0, index=state.edge[i]
        )
    state.cutting_time[i] = 0.0
    state.used_life[i] = p.initial_used_life[i]
    state.nominal_used_life[i] = 0.0
    state.thrust_force[i] = 0.0
    state.power[i] = 0.0
    state.lagged_thrust_force[i] = 0.0
    state.lagged_power[i] = 0.0


@compiled
def charge(report, i, p, share):
    """Charge a share of an edge's life."""
    report.edges_used[i] += share
    report.reward_edge[i] -= p.edge_price[i] * share


@compiled
def break_edge(state, report, i, p):
    """Charge a broken edge's remaining life, and the downtime."""
    lost = max(0.0, 1.0 - state.used_life[i])
    report.edges_used[i] += lost
    report.edges_broken[i] += 1.0
    report.reward_breakage[i] -= p.edge_price[i] * lost + p.breakage_price[i]


@compiled
def change_edge(state, report, i, p, stop):
    """Inspect the edge and put in the next one, which takes its time and another ``stop`` [min]."""
    if p.inspects_edges:
        has_cut = state.used_life[i] > 0.0
        state.removed_wear[i] = exp(log_wear(p, i, state.used_life[i])) if has_cut else 0.0
    stop_machine(state, report, i, p, stop + p.edge_change_time[i])
    state.edge[i] += 1
    fit_edge(state, i, p)


@compiled
def stop_machine(state, report, i, p, minutes):
    """Let machine time pass without cutting.

    It does not pass beyond the end of an episode that ends by the clock.
    """
    minutes = max(min(minutes, p.clock_limit[i] - state.clock[i]), 0.0)
    state.clock[i] += minutes
    report.time[i] += 60.0 * minutes
    report.stopped_time[i] += 60.0 * minutes
    cool_down(state, i, p, minutes)
