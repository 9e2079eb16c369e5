"""The transition: one control interval of one lathe.

Written once, for one lathe, as scalar Python over the records of ``records.py``. Every sub-step takes the state at its end
(so the result converges in the first order of the sub-step), and the fields at the middle of the metal it cut.
"""

import math

import numpy as np

from turning_env.compilation import compiled
from turning_env.drives import follow_commands, spindle_torque
from turning_env.economics import breakage_price, edge_price, metal_value
from turning_env.keyed_random import EDGE_CHANNEL, standard_normals
from turning_env.machinability import force_and_power, log_wear_coefficient
from turning_env.sensors import follow_process, read_sensors
from turning_env.wear import advance_used_life, log_wear
from turning_env.workpiece import look_up_fields, position_in_row


@compiled
def start_episode(lane, parameters, report):
    """Put a fresh edge before the first bar. The lane's ``seed`` and ``episode`` say which edge and which bars."""
    edge_normal, strength_normal = standard_normals(lane, EDGE_CHANNEL, 0, 0)
    lane.interval_count = 0
    lane.ended = False
    lane.broken = False
    lane.path = 0.0
    _, lane.cutting = position_in_row(parameters, 0.0)
    lane.commanded_cutting_speed = parameters.initial_cutting_speed
    lane.commanded_feed = parameters.initial_feed
    lane.cutting_speed = parameters.initial_cutting_speed
    lane.feed = parameters.initial_feed
    lane.log_wear_factor = parameters.wear_factor_spread * edge_normal
    lane.edge_strength = parameters.edge_strength * math.exp(parameters.edge_strength_spread * strength_normal)
    lane.cutting_time = 0.0
    lane.used_life = 0.0
    lane.nominal_used_life = 0.0
    lane.bar = -1
    look_up_fields(lane, parameters, 0.0)
    lane.thrust_force = 0.0
    lane.power = 0.0
    lane.lagged_thrust_force = 0.0
    lane.lagged_power = 0.0
    lane.measured_thrust_force = 0.0
    lane.measured_power = 0.0
    clear_sums(report)
    write_state(lane, parameters, report)


@compiled
def run_interval(lane, parameters, cutting_speed_action, feed_action, report):
    """Run one control interval; return (reward [s], terminated, truncated)."""
    command(lane, parameters, cutting_speed_action, feed_action)
    used_life_before = lane.used_life
    cutting_time_before = lane.cutting_time
    time, engaged_time, removed = 0.0, 0.0, 0.0  # [min], [min], [cm3]
    force_excess, power_excess = 0.0, 0.0  # integrals [min]
    overload_time, severe_overload_time = 0.0, 0.0  # [min]
    force_scale, power_scale = 1.0 / parameters.thrust_force_limit, 1.0 / parameters.power_limit
    worn, broken = False, False
    cut, _ = position_in_row(parameters, lane.path)

    for _ in range(parameters.sub_steps):
        follow_commands(lane, parameters)
        feed_velocity = lane.cutting_speed * parameters.revolutions_per_metre * lane.feed  # [mm/min]
        lane.path += feed_velocity * parameters.sub_step
        time += parameters.sub_step
        cut_before = cut
        cut, lane.cutting = position_in_row(parameters, lane.path)
        if cut > cut_before:
            engaged = (cut - cut_before) / feed_velocity  # [min]
            look_up_fields(lane, parameters, 0.5 * (cut_before + cut))
            cut_metal(lane, parameters, engaged)
            engaged_time += engaged
            removed += lane.cutting_speed * lane.feed * lane.depth_of_cut * engaged
            over_force = max(lane.thrust_force * force_scale - 1.0, 0.0)
            over_power = max(lane.power * power_scale - 1.0, 0.0)
            force_excess += engaged * over_force
            power_excess += engaged * over_power
            over = max(over_force, over_power)
            overload_time += engaged if over > 0.0 else 0.0
            severe_overload_time += engaged if over > parameters.overload_tolerance else 0.0
            worn = lane.used_life >= 1.0
            broken = lane.thrust_force > lane.edge_strength
        if not lane.cutting:
            lane.thrust_force = 0.0
            lane.power = 0.0
        follow_process(lane, parameters)
        if worn or broken:
            break

    lane.interval_count += 1
    follow_nominal_wear(lane, parameters, cutting_time_before)
    lane.measured_power, lane.measured_thrust_force = read_sensors(lane, parameters)
    lane.broken = broken
    terminated = worn or broken
    truncated = (not terminated) and lane.interval_count >= parameters.interval_limit
    lane.ended = terminated or truncated

    report.time = 60.0 * time
    report.engaged_time = 60.0 * engaged_time
    report.removed = removed
    report.overload_time = 60.0 * overload_time
    report.severe_overload_time = 60.0 * severe_overload_time
    report.cost_force = force_excess / time
    report.cost_power = power_excess / time
    report.cost = report.cost_force + report.cost_power
    report.reward_metal = metal_value(parameters, removed)
    report.reward_time = -60.0 * time
    report.reward_edge = -edge_price(parameters) * (min(lane.used_life, 1.0) - used_life_before)
    report.reward_overload = -60.0 * parameters.overload_price * (force_excess + power_excess)
    report.reward_breakage = -breakage_price(parameters, lane.used_life) if broken else 0.0
    write_state(lane, parameters, report)
    reward = report.reward_metal + report.reward_time + report.reward_edge + report.reward_overload + report.reward_breakage
    return reward, terminated, truncated


@compiled
def command(lane, parameters, cutting_speed_action, feed_action):
    """Set the commanded cutting speed and feed from actions in -1..1 (what lies outside is clipped)."""
    p = parameters
    speed_action = min(max(cutting_speed_action, -1.0), 1.0)
    feed_action = min(max(feed_action, -1.0), 1.0)
    if p.incremental:
        speed = lane.commanded_cutting_speed * math.exp(p.cutting_speed_step * speed_action)
        feed = lane.commanded_feed * math.exp(p.feed_step * feed_action)
    else:
        speed = p.cutting_speed_min + 0.5 * (speed_action + 1.0) * (p.cutting_speed_max - p.cutting_speed_min)
        feed = p.feed_min + 0.5 * (feed_action + 1.0) * (p.feed_max - p.feed_min)
    lane.commanded_cutting_speed = min(max(speed, p.cutting_speed_min), p.cutting_speed_max)
    lane.commanded_feed = min(max(feed, p.feed_min), p.feed_max)


@compiled
def cut_metal(lane, parameters, engaged):
    """Wear the edge for an engaged time [min], then set thrust force [N] and power [kW] at the new wear."""
    speed, feed, depth = math.log(lane.cutting_speed), math.log(lane.feed), math.log(lane.depth_of_cut)
    hardness = lane.log_hardness
    log_coefficient = lane.log_wear_factor + log_wear_coefficient(parameters, speed, feed, depth, hardness)
    end = lane.cutting_time + engaged
    lane.used_life = advance_used_life(parameters, lane.used_life, log_coefficient, lane.cutting_time, end)
    lane.cutting_time = end
    wear = log_wear(parameters, lane.used_life)
    lane.thrust_force, lane.power = force_and_power(parameters, speed, feed, depth, wear, hardness)


@compiled
def follow_nominal_wear(lane, parameters, cutting_time_before):
    """Advance the wear that the control's own nominal model predicts, from the speed and feed at the interval's end."""
    if lane.cutting_time > cutting_time_before:
        speed, feed = math.log(lane.cutting_speed), math.log(lane.feed)
        log_coefficient = log_wear_coefficient(parameters, speed, feed, parameters.log_depth_of_cut, 0.0)
        lane.nominal_used_life = advance_used_life(
            parameters, lane.nominal_used_life, log_coefficient, cutting_time_before, lane.cutting_time
        )


@compiled
def clear_sums(report):
    """Zero what the report sums over an interval."""
    report.time = 0.0
    report.engaged_time = 0.0
    report.removed = 0.0
    report.overload_time = 0.0
    report.severe_overload_time = 0.0
    report.cost = 0.0
    report.cost_force = 0.0
    report.cost_power = 0.0
    report.reward_metal = 0.0
    report.reward_time = 0.0
    report.reward_edge = 0.0
    report.reward_overload = 0.0
    report.reward_breakage = 0.0


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
    report.measured_power = lane.measured_power
    report.broken = 1.0 if lane.broken else 0.0
