"""Whole parts: the passes of an action, and the metal that each pass cuts.

A path divides an allowance A into z passes of equal depth A/z, counted from the finished contour
outwards. Its first pass also takes what the blank has beyond the allowance. If the blank has less,
passes cut less, or air (adaptive part programming paper).

An action is (number of passes, allowance, then cutting speed and feed of each pass), all -1..1.
"""

import math

import numpy as np

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import log
from turning_env.physics.drives import clipped, set_point
from turning_env.physics.spindle import cool_down

MIN_DEPTH = 0.01
"""Depth of a pass [mm] below which the control's models are not evaluated."""


@compiled
def start_part(state, work, i, p, action):
    """Store the start of the next part, and the number and depth [mm] of its passes."""
    work.part_start[i] = np.rint(state.path[i] * p.bars_per_path[i]) * p.bar_pitch[i]
    # The range of the first number is divided evenly among 1, 2, ... passes.
    share = 0.5 * (clipped(action[0]) + 1.0)
    work.passes[i] = min(1 + int(share * p.passes_max), p.passes_max)
    allowance = p.depth_of_cut[i] * (1.0 + clipped(action[1]))
    work.pass_depth[i] = allowance / work.passes[i]


@compiled
def start_pass(state, work, report, i, p, action, number):
    """Set speed, feed, depth and sub-step of a pass; the first has the number 0.

    ``action`` holds the numbers of one environment, each clipped to -1..1.
    """
    speed = min(
        set_point(action[2 + 2 * number], p.cutting_speed_min[i], p.cutting_speed_max[i]),
        p.reachable_cutting_speed[i],
    )
    feed = set_point(action[3 + 2 * number], p.feed_min[i], p.feed_max[i])
    passes = work.passes[i]
    depth = work.pass_depth[i]
    state.commanded_cutting_speed[i] = speed
    state.commanded_feed[i] = feed
    state.path[i] = work.part_start[i]
    state.pass_floor[i] = (passes - 1 - number) * depth
    state.pass_ceiling[i] = math.inf if number == 0 else (passes - number) * depth
    state.log_nominal_depth[i] = log(max(depth, MIN_DEPTH))
    report.passes[i] += 1.0
    report.mean_thrust_force[i] = 0.0
    report.mean_power[i] = 0.0
    work.engaged_before[i] = report.engaged_time[i]
    feed_velocity = speed * p.revolutions_per_metre[i] * feed  # [mm/min]
    work.sub_step[i] = p.bar_pitch[i] / feed_velocity / p.sub_steps
    work.sub_steps_left[i] = p.sub_steps


@compiled
def end_pass(state, work, report, i, p):
    """Return the tool, before the next part; the pass's mean force and power are sensed."""
    engaged = report.engaged_time[i] - work.engaged_before[i]
    if engaged > 0.0:
        report.mean_thrust_force[i] /= engaged
        report.mean_power[i] /= engaged
    state.lagged_thrust_force[i] = report.mean_thrust_force[i]
    state.lagged_power[i] = report.mean_power[i]
    return_time = p.return_time[i]
    state.clock[i] += return_time
    report.time[i] += 60.0 * return_time
    cool_down(state, i, p, return_time)
    state.path[i] = work.part_start[i] + p.bar_pitch[i]
    state.pass_floor[i] = 0.0
    state.pass_ceiling[i] = math.inf
