"""What an interval earns, in seconds of machine time: the terms of the reward, and the costs of its constraints.

Edges are charged in ``edge.py``. (Overload price: assumption, see docs/choices.md.)
"""

from turning_env.compilation import compiled


@compiled
def metal_value(parameters, removed):
    """Worth [s] of removed metal [cm3]: the time in which reference productivity removes it."""
    return 60.0 * removed / parameters.reference_productivity


@compiled
def settle(parameters, minutes, report):
    """Fill in what is left of the reward's terms, and the costs over ``minutes`` at work; return the reward [s]."""
    report.reward_metal = metal_value(parameters, report.removed)
    report.reward_time = -report.time
    report.reward_overload = -60.0 * parameters.overload_price * (report.cost_force + report.cost_power)
    report.reward_roughness = -parameters.roughness_price * report.roughness_deviation
    report.cost_force /= minutes
    report.cost_power /= minutes
    report.cost = report.cost_force + report.cost_power
    reward = report.reward_metal + report.reward_time + report.reward_edge + report.reward_overload + report.reward_breakage
    return reward + report.reward_roughness
