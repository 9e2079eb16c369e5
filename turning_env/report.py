"""What an interval is reported as: sums over it, and the true state at its end."""

import math

import numpy as np

from turning_env.compilation import compiled
from turning_env.drives import spindle_torque
from turning_env.surface import roughness
from turning_env.wear import log_wear


@compiled
def clear_sums(report):
    """Zero what the report sums over an interval."""
    report.mean_thrust_force = 0.0
    report.mean_power = 0.0
    report.time = 0.0
    report.engaged_time = 0.0
    report.stopped_time = 0.0
    report.removed = 0.0
    report.passes = 0.0
    report.edges_used = 0.0
    report.edges_broken = 0.0
    report.overload_time = 0.0
    report.severe_overload_time = 0.0
    report.roughness_deviation = 0.0
    report.cost = 0.0
    report.cost_force = 0.0
    report.cost_power = 0.0
    report.reward_metal = 0.0
    report.reward_time = 0.0
    report.reward_edge = 0.0
    report.reward_overload = 0.0
    report.reward_breakage = 0.0
    report.reward_roughness = 0.0
    report.broken = 0.0
    report.finished = 0.0


@compiled
def write_state(lane, parameters, report):
    """Report the true state at the interval's end."""
    spindle_speed = lane.cutting_speed * parameters.revolutions_per_metre
    report.cutting_speed = lane.cutting_speed
    report.feed = lane.feed
    report.commanded_cutting_speed = lane.commanded_cutting_speed
    report.commanded_feed = lane.commanded_feed
    report.spindle_speed = spindle_speed
    report.feed_velocity = spindle_speed * lane.feed
    report.torque = spindle_torque(lane.power, spindle_speed)
    report.path = lane.path
    report.bar = np.floor(lane.path * parameters.bars_per_path)
    report.cutting = 1.0 if lane.cutting else 0.0
    report.depth_of_cut = lane.depth_of_cut if lane.cutting else 0.0
    report.hardness = math.exp(lane.log_hardness) if lane.cutting else 0.0
    report.cutting_time = lane.cutting_time
    report.used_life = lane.used_life
    report.wear = math.exp(log_wear(parameters, lane.used_life)) if lane.used_life > 0.0 else 0.0
    report.wear_factor = math.exp(lane.log_wear_factor)
    report.edge_strength = lane.edge_strength
    report.thrust_force = lane.thrust_force
    report.power = lane.power
    report.measured_thrust_force = lane.measured_thrust_force
    report.measured_servo_current = lane.measured_servo_current
    report.measured_power = lane.measured_power
    report.roughness = roughness(parameters, lane.thrust_force) if parameters.holds_roughness and lane.cutting else 0.0
    report.roughness_reference = lane.roughness_reference
    report.probed_depth = lane.probed_depth
