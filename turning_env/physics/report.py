"""The report of a step: sums over the step, the reward [s] and its terms, and the true state.

Edges are charged in ``edge.py``, metal and overload are summed in ``lathe.py``. The price of
overload is an assumption (``docs/models.md``).
"""

import math

import numpy as np

from turning_env.numerics.compilation import compiled, env_range
from turning_env.numerics.functions import exp
from turning_env.physics import records
from turning_env.physics.constraint import overload_cost
from turning_env.physics.quantities import AT_END, KEPT, REPORT
from turning_env.physics.spindle import capacity, idle_power
from turning_env.physics.surface import roughness
from turning_env.physics.wear import log_wear

# Values at the end of a step come first in the report, its sums after them.
_FIRST_SUM = len(AT_END)
_ROWS = len(REPORT)
# Rows of the quantities that a state and a report share, in the tables of both.
_KEPT_IN_STATE = np.array([records.row_of(records.STATE, name) for name in KEPT])
_KEPT_IN_REPORT = np.array([records.row_of(records.REPORT, name) for name in KEPT])
_ROUNDING = 1e-6  # [mm] error of a path that is the sum of whole bars


@compiled
def clear_sums(report, first, last):
    """Set the report's sums over a step to 0: ``quantities.OVER_STEP`` and ``OUTCOME``."""
    table = report.table
    for i in env_range(first, last):
        for k in range(_FIRST_SUM, _ROWS):
            table[k, i] = 0.0


@compiled
def finish_step(state, work, report, i, p, ends_with_edge, by_step):
    """Set terminated, truncated, reward, its terms and cost [s], and mean force, power and excess.

    ``ends_with_edge``: whether the episode ends with its edge. ``by_step``: whether means are over
    the step; with parts, they are over the last pass and set already.
    """
    set_end(state, work, report, i, p, ends_with_edge)
    report.broken[i] = 1.0 if report.edges_broken[i] > 0.0 else 0.0
    engaged = report.engaged_time[i] if by_step and report.engaged_time[i] > 0.0 else 1.0
    report.mean_thrust_force[i] /= engaged
    report.mean_power[i] /= engaged
    set_reward(report, i, p)
    # The integrals of the excess [min] become means over the step [-].
    report.excess_force[i] /= work.minutes[i]
    report.excess_power[i] /= work.minutes[i]
    report.excess[i] = report.excess_force[i] + report.excess_power[i]
    report.cost[i] = overload_cost(
        report.severe_overload_time[i], report.engaged_time[i], p.overload_allowance[i]
    )


@compiled
def set_end(state, work, report, i, p, ends_with_edge):
    """Set whether the episode has ended: by its job, by its edge, or out of time."""
    finished = 1 if state.path[i] > p.path_end[i] - _ROUNDING else 0
    failure_ends = 1 if ends_with_edge else 0
    terminated = finished | (work.edge_failed[i] & failure_ends)
    out_of_steps = 1 if state.step_count[i] >= p.step_limit else 0
    # Half a sub-step is added: the clock, a sum of sub-steps, may miss the limit by rounding.
    out_of_minutes = 1 if state.clock[i] + 0.5 * p.sub_step[i] >= p.time_limit[i] else 0
    out_of_time = out_of_steps if ends_with_edge else out_of_minutes
    report.terminated[i] = float(terminated)
    report.truncated[i] = float(out_of_time & (1 - terminated))
    report.finished[i] = float(finished)
    state.ended[i] = out_of_time | terminated


@compiled
def set_reward(report, i, p):
    """Set the terms of the reward that follow from sums, and the reward [s].

    reward = 60 V / Q_ref - time - edges - 60 c_o (integral of the excess) - c_r (deviation of Ra)
    - breakage, with the removed volume V [cm3] and the reference removal rate Q_ref [cm3/min].
    Form: adaptive part programming paper, cost of a part (``docs/models.md``).
    """
    overload = report.excess_force[i] + report.excess_power[i]  # [min]
    report.reward_metal[i] = 60.0 * report.removed[i] / p.reference_removal_rate[i]
    report.reward_time[i] = -report.time[i]
    report.reward_overload[i] = -60.0 * p.overload_price[i] * overload
    report.reward_roughness[i] = -p.roughness_price[i] * report.roughness_deviation[i]
    report.reward[i] = (
        report.reward_metal[i]
        + report.reward_time[i]
        + report.reward_edge[i]
        + report.reward_overload[i]
        + report.reward_breakage[i]
        + report.reward_roughness[i]
    )


@compiled
def write_state(state, report, first, last, p):
    """Report the true state of some environments of a block at the step's end."""
    copy_kept(state, report, first, last)
    for i in env_range(first, last):
        report_spindle(state, report, i, p)
        report_cut(state, report, i, p)
        report.roughness[i] = 0.0
    if p.holds_roughness:
        for i in env_range(first, last):
            rough = roughness(p, i, state.thrust_force[i])
            report.roughness[i] = rough if state.cutting[i] > 0 else 0.0


@compiled
def copy_kept(state, report, first, last):
    """Copy the quantities that a state and a report share."""
    for k in range(len(KEPT)):
        source = _KEPT_IN_STATE[k]
        target = _KEPT_IN_REPORT[k]
        for i in env_range(first, last):
            report.table[target, i] = state.table[source, i]


@compiled
def report_spindle(state, report, i, p):
    """Report the speeds, torque [N m], power [kW] and load [-] of the spindle."""
    speed = state.cutting_speed[i]
    spindle_speed = speed * p.revolutions_per_metre[i]
    power = state.power[i] + idle_power(p, i, speed)
    share = capacity(p, i, speed) if p.reads_torque else 1.0
    available = p.rated_power[i] * share
    report.spindle_speed[i] = spindle_speed
    report.feed_velocity[i] = spindle_speed * state.feed[i]
    # M = P / (2 pi n); 30000 converts kW and rev/min to N m.
    report.torque[i] = 30000.0 * power / (math.pi * spindle_speed)
    report.spindle_load[i] = power / available
    report.power[i] = power


@compiled
def report_cut(state, report, i, p):
    """Report the bar, the cut (0 in air) and the wear of the edge."""
    report.bar[i] = np.floor(state.path[i] * p.bars_per_path[i])
    in_metal = state.cutting[i] > 0
    hardness = exp(state.log_hardness[i])
    report.cutting[i] = 1.0 if in_metal else 0.0
    report.depth_of_cut[i] = state.depth_of_cut[i] if in_metal else 0.0
    report.hardness[i] = hardness if in_metal else 0.0
    report.wear_factor[i] = exp(state.log_wear_factor[i])
    wear = exp(log_wear(p, i, state.used_life[i]))
    report.wear[i] = wear if state.used_life[i] > 0.0 else 0.0
