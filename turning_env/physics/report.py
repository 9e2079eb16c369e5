"""The report of a step: sums over the step, and the true state at its end."""

import math

import numpy as np
from numba import literal_unroll

from turning_env.numerics.compilation import compiled, env_range
from turning_env.numerics.functions import exp
from turning_env.physics.quantities import KEPT
from turning_env.physics.records import FIRST_SUM, LAST_ROW
from turning_env.physics.spindle import capacity, idle_power
from turning_env.physics.surface import roughness
from turning_env.physics.wear import log_wear


@compiled
def clear_sums(report, first, last):
    """Set the report's sums over a step to 0: ``quantities.OVER_STEP`` and ``OUTCOME``."""
    table = report.table
    for i in env_range(first, last):
        for k in range(FIRST_SUM, LAST_ROW):
            table[k, i] = 0.0


@compiled
def write_state(state, report, first, last, p):
    """Report the true state of some environments of a block at the step's end."""
    for name in literal_unroll(KEPT):
        for i in env_range(first, last):
            report[name][i] = state[name][i]
    for i in env_range(first, last):
        spindle_speed = state.cutting_speed[i] * p.revolutions_per_metre[i]
        power = state.power[i] + idle_power(p, i, state.cutting_speed[i])
        available = p.rated_power[i] * (capacity(p, i, state.cutting_speed[i]) if p.reads_torque else 1.0)
        report.spindle_speed[i] = spindle_speed
        report.feed_velocity[i] = spindle_speed * state.feed[i]
        report.torque[i] = 30000.0 * power / (math.pi * spindle_speed)
        report.spindle_load[i] = power / available
        report.power[i] = power
        report.bar[i] = np.floor(state.path[i] * p.bars_per_path[i])
    for i in env_range(first, last):
        in_metal = state.cutting[i] > 0
        hardness = exp(state.log_hardness[i])
        report.cutting[i] = 1.0 if in_metal else 0.0
        report.depth_of_cut[i] = state.depth_of_cut[i] if in_metal else 0.0
        report.hardness[i] = hardness if in_metal else 0.0
        report.wear_factor[i] = exp(state.log_wear_factor[i])
    for i in env_range(first, last):
        wear = exp(log_wear(p, i, state.used_life[i]))
        report.wear[i] = wear if state.used_life[i] > 0.0 else 0.0
        report.roughness[i] = 0.0
    if p.holds_roughness:
        for i in env_range(first, last):
            rough = roughness(p, i, state.thrust_force[i])
            report.roughness[i] = rough if state.cutting[i] > 0 else 0.0
