"""Edges: how one is fitted, used up, broken and replaced, and what that costs in life and time.

An edge's whole life is charged as its used share grows, so that every interval pays for what it consumes. A broken edge
pays the share that is left, and the downtime. (Life charge: cost of a part, adaptive part programming paper, tau_I and
Q_I; breakage: assumption, see docs/choices.md.)

Where an episode ends with its edge, the price of an edge holds the time to change it, and breakage its downtime; no time passes.
Where edges are changed, the time passes. Drawn edges: see ``docs/models.md``.
"""

import math

from turning_env.compilation import compiled
from turning_env.keyed_random import EDGE_CHANNEL, standard_normals


@compiled
def fit_edge(lane, parameters):
    """Put the lane's present edge into the holder, fresh as far as is known; the tool is out of the metal."""
    edge_normal, strength_normal = standard_normals(lane, EDGE_CHANNEL, 0, lane.edge)
    lane.log_wear_factor = parameters.log_lot_wear + parameters.wear_factor_spread * edge_normal
    lane.edge_strength = parameters.edge_strength * math.exp(parameters.edge_strength_spread * strength_normal)
    lane.cutting_time = 0.0
    lane.used_life = parameters.initial_used_life
    lane.nominal_used_life = 0.0
    lane.thrust_force = 0.0
    lane.power = 0.0
    lane.lagged_thrust_force = 0.0
    lane.lagged_power = 0.0


@compiled
def charge_life(lane, parameters, used_life_before, report):
    """Charge the share of the edge's life that has been used since."""
    charge(parameters, min(lane.used_life, 1.0) - used_life_before, report)


@compiled
def charge(parameters, share, report):
    """Charge a share of an edge's life."""
    report.edges_used += share
    report.reward_edge -= parameters.edge_price * share


@compiled
def break_edge(lane, parameters, report):
    """Charge what a broken edge had left, and the downtime."""
    lost = max(0.0, 1.0 - lane.used_life)
    report.edges_used += lost
    report.edges_broken += 1.0
    report.reward_breakage -= parameters.edge_price * lost + parameters.breakage_price


@compiled
def replace_edge(lane, parameters, broken, report):
    """Change an edge that has just been found broken or worn out."""
    found = parameters.breakage_downtime if broken else parameters.unplanned_stop
    change_edge(lane, parameters, found + parameters.edge_change_time, report)


@compiled
def discard_edge(lane, parameters, report):
    """Change an edge on command, and charge what it had left."""
    charge(parameters, max(0.0, 1.0 - lane.used_life), report)
    change_edge(lane, parameters, parameters.edge_change_time, report)


@compiled
def change_edge(lane, parameters, minutes, report):
    """Put the next edge in, which takes so much machine time [min]."""
    stand_still(lane, parameters, minutes, report)
    lane.edge += 1
    fit_edge(lane, parameters)


@compiled
def stand_still(lane, parameters, minutes, report):
    """Let machine time pass without cutting, though not beyond the end of the episode."""
    minutes = max(min(minutes, parameters.time_limit - lane.clock), 0.0)
    lane.clock += minutes
    report.time += 60.0 * minutes
    report.stopped_time += 60.0 * minutes
