"""The terms of a step's reward, in seconds of machine time, and the costs of its constraints.

Edges are charged in ``edge.py``. (Overload price: assumption, see docs/choices.md.)
"""

from turning_env.numerics.compilation import compiled


@compiled
def compute_reward(report, i, p, minutes):
    """Compute the remaining terms of the reward, and the mean costs over ``minutes`` of work; return the reward [s]."""
    report.reward_metal[i] = 60.0 * report.removed[i] / p.reference_removal_rate[i]
    report.reward_time[i] = -report.time[i]
    report.reward_overload[i] = -60.0 * p.overload_price[i] * (report.cost_force[i] + report.cost_power[i])
    report.reward_roughness[i] = -p.roughness_price[i] * report.roughness_deviation[i]
    report.cost_force[i] /= minutes
    report.cost_power[i] /= minutes
    report.cost[i] = report.cost_force[i] + report.cost_power[i]
    reward = report.reward_metal[i] + report.reward_time[i] + report.reward_edge[i]
    return reward + report.reward_overload[i] + report.reward_breakage[i] + report.reward_roughness[i]
