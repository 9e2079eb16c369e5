"""Whole parts: how an action names the passes of one, and what a pass cuts.

A path is made for an allowance A in z passes of equal depth A/z, counted from the finished contour outwards. Its first pass takes
whatever the blank has beyond that; where the blank has less, passes cut less, or air.
"""

import math

import numpy as np

from turning_env.compilation import compiled
from turning_env.drives import clipped, set_point

LEAST_DEPTH = 0.01
"""Depth of a pass [mm] below which the control's models are not asked."""


@compiled
def part_passes(parameters, action):
    """(number of passes, depth of each [mm]) of an action in -1..1; see ``RoughTurningEnv``."""
    p = parameters
    passes = min(1 + int(0.5 * (clipped(action[0]) + 1.0) * p.passes_max), p.passes_max)
    allowance = p.depth_of_cut * (1.0 + clipped(action[1]))
    return passes, allowance / passes


@compiled
def start_part(lane, parameters):
    """The path coordinate [mm] of the next part."""
    return np.rint(lane.path * parameters.bars_per_path) * parameters.bar_pitch


@compiled
def start_pass(lane, parameters, action, start, number, passes, depth, report):
    """Set speed, feed and depth of a pass, 0 the first, and return its sub-step [min]."""
    p = parameters
    lane.commanded_cutting_speed = set_point(action[2 + 2 * number], p.cutting_speed_min, p.cutting_speed_max)
    lane.commanded_feed = set_point(action[3 + 2 * number], p.feed_min, p.feed_max)
    lane.path = start
    lane.pass_floor = (passes - 1 - number) * depth
    lane.pass_ceiling = math.inf if number == 0 else (passes - number) * depth
    lane.log_nominal_depth = math.log(max(depth, LEAST_DEPTH))
    report.passes += 1.0
    report.mean_thrust_force = 0.0
    report.mean_power = 0.0
    feed_velocity = lane.commanded_cutting_speed * p.revolutions_per_metre * lane.commanded_feed
    return p.bar_pitch / feed_velocity / p.sub_steps


@compiled
def end_pass(lane, parameters, engaged_before, report):
    """Return the tool; what has been sensed in the pass is its mean force and power."""
    engaged = report.engaged_time - engaged_before
    if engaged > 0.0:
        report.mean_thrust_force /= engaged
        report.mean_power /= engaged
    lane.lagged_thrust_force = report.mean_thrust_force
    lane.lagged_power = report.mean_power
    lane.clock += parameters.return_time
    report.time += 60.0 * parameters.return_time


@compiled
def end_part(lane, parameters, start):
    """Put the tool before the next part."""
    lane.path = start + parameters.bar_pitch
    lane.pass_floor = 0.0
    lane.pass_ceiling = math.inf
