"""What an interval earns, in seconds of machine time: the terms of the reward.

An edge's whole life is charged as its used share grows, so that every interval pays for what it consumes. A broken edge
pays the share that is left, and the downtime. (Life charge: cost of a part, adaptive part programming paper, tau_I and
Q_I; overload price and breakage: assumptions, see docs/choices.md.)
"""

from turning_env.compilation import compiled


@compiled
def metal_value(parameters, removed):
    """Worth [s] of removed metal [cm3]: the time in which reference productivity removes it."""
    return 60.0 * removed / parameters.reference_productivity


@compiled
def edge_price(parameters):
    """Price [s] of a whole edge: what it costs, and the time to change it."""
    return 60.0 * (parameters.edge_cost + parameters.edge_change_time)


@compiled
def breakage_price(parameters, used_life):
    """Price [s] of breaking an edge at a used life share [-]: what is left of it, and the downtime."""
    return edge_price(parameters) * max(0.0, 1.0 - used_life) + 60.0 * parameters.breakage_downtime
