"""The transition: one control interval of one lathe.

Written once, for one lathe, as scalar Python over the records of ``records.py``. Every sub-step takes the state at its end
(so the result converges in the first order of the sub-step), and the fields at the middle of the metal it cut.
"""

import math

from turning_env.compilation import compiled
from turning_env.drives import clipped, follow_commands, set_point
from turning_env.economics import settle
from turning_env.edge import break_edge, charge_life, discard_edge, fit_edge, replace_edge
from turning_env.machinability import force_and_power, log_wear_coefficient
from turning_env.parts import end_part, end_pass, part_passes, start_part, start_pass
from turning_env.records import END, OVERRIDE, PART, SET_POINT
from turning_env.report import clear_sums, write_state
from turning_env.sensors import follow_process, read_sensors
from turning_env.surface import draw_reference, roughness
from turning_env.wear import advance_used_life, log_wear
from turning_env.workpiece import look_up_fields, position_in_row, probe_next_bar


@compiled
def start_episode(lane, parameters, report):
    """Put a fresh edge before the first bar. The lane's ``seed`` and ``episode`` say which edge and which bars."""
    lane.interval_count = 0
    lane.ended = False
    lane.path = 0.0
    lane.clock = 0.0
    lane.turns = 0.0
    _, lane.cutting = position_in_row(parameters, 0.0)
    lane.commanded_cutting_speed = parameters.initial_cutting_speed
    lane.commanded_feed = parameters.initial_feed
    lane.cutting_speed = parameters.initial_cutting_speed
    lane.feed = parameters.initial_feed
    lane.edge = 0
    fit_edge(lane, parameters)
    lane.bar = -1
    lane.pass_floor = 0.0
    lane.pass_ceiling = math.inf
    lane.log_nominal_depth = parameters.log_depth_of_cut
    look_up_fields(lane, parameters, 0.0)
    lane.measured_thrust_force = 0.0
    lane.measured_servo_current = 0.0
    lane.measured_power = 0.0
    look_ahead(lane, parameters)
    clear_sums(report)
    write_state(lane, parameters, report)


@compiled
def run_interval(lane, parameters, action, report):
    """Run one control interval; return (reward [s], terminated, truncated)."""
    p = parameters
    clear_sums(report)
    if p.change_action >= 0 and action[p.change_action] > 0.0:
        discard_edge(lane, p, report)
    if p.action == PART:
        minutes, worn, broken = turn_part(lane, p, action, report)
    else:
        command(lane, p, action)
        minutes, _, worn, broken = travel(lane, p, p.sub_steps, p.sub_step, report)
        mend(lane, p, worn, broken, report)
    lane.interval_count += 1
    read_sensors(lane, p)

    finished = lane.path > p.path_end - 1e-6  # a path of whole bars, but for rounding
    terminated = finished or (p.edge_changes == END and (worn or broken))
    if p.edge_changes == END:
        out_of_time = lane.interval_count >= p.interval_limit
    else:
        out_of_time = lane.clock + 0.5 * p.sub_step >= p.time_limit
    truncated = out_of_time and not terminated
    lane.ended = terminated or truncated
    look_ahead(lane, p)

    report.finished = 1.0 if finished else 0.0
    report.broken = 1.0 if report.edges_broken > 0.0 else 0.0
    if report.engaged_time > 0.0 and p.action != PART:
        report.mean_thrust_force /= report.engaged_time
        report.mean_power /= report.engaged_time
    write_state(lane, p, report)
    return settle(p, minutes, report), terminated, truncated


@compiled
def command(lane, parameters, action):
    """Set the commanded cutting speed and feed from an action in -1..1 (what lies outside is clipped)."""
    p = parameters
    if p.action == OVERRIDE:
        speed = lane.commanded_cutting_speed
        feed = 0.5 * (clipped(action[0]) + 1.0) * p.override_max * p.initial_feed
    elif p.action == SET_POINT:
        speed = set_point(action[0], p.cutting_speed_min, p.cutting_speed_max)
        feed = set_point(action[1], p.feed_min, p.feed_max)
    else:
        speed = lane.commanded_cutting_speed * math.exp(p.cutting_speed_step * clipped(action[0]))
        feed = lane.commanded_feed * math.exp(p.feed_step * clipped(action[1]))
    lane.commanded_cutting_speed = min(max(speed, p.cutting_speed_min), p.cutting_speed_max)
    lane.commanded_feed = min(max(feed, p.feed_min), p.feed_max)


@compiled
def travel(lane, parameters, sub_steps, sub_step, report):
    """Run up to so many sub-steps [min], until the edge is worn or broken or the job is finished.

    Returns (time passed [min], sub-steps run, worn, broken). Adds to the report's sums, where ``cost_force``, ``cost_power``
    and the means still are integrals: [min], [N s] and [kJ].
    """
    p = parameters
    used_life_before = lane.used_life
    cutting_time_before = lane.cutting_time
    time, engaged_time, removed = 0.0, 0.0, 0.0  # [min], [min], [cm3]
    force_excess, power_excess = 0.0, 0.0  # integrals [min]
    overload_time, severe_overload_time = 0.0, 0.0  # [min]
    impulse, work, deviation = 0.0, 0.0, 0.0  # integrals [N min], [kW min], [min]
    force_scale, power_scale = 1.0 / p.thrust_force_limit, 1.0 / p.power_limit
    worn, broken = False, False
    run = 0
    cut, _ = position_in_row(p, lane.path)

    for _ in range(sub_steps):
        follow_commands(lane, p)
        spindle_speed = lane.cutting_speed * p.revolutions_per_metre  # [rev/min]
        feed_velocity = spindle_speed * lane.feed  # [mm/min]
        turns = spindle_speed * sub_step
        lane.path += feed_velocity * sub_step
        lane.turns += turns
        time += sub_step
        run += 1
        cut_before = cut
        cut, lane.cutting = position_in_row(p, lane.path)
        if cut > cut_before:
            look_up_fields(lane, p, 0.5 * (cut_before + cut))
        if cut > cut_before and lane.depth_of_cut > 0.0:
            engaged = (cut - cut_before) / feed_velocity  # [min]
            cut_metal(lane, p, engaged, turns)
            engaged_time += engaged
            removed += lane.cutting_speed * lane.feed * lane.depth_of_cut * engaged
            impulse += engaged * lane.thrust_force
            work += engaged * lane.power
            over_force = max(lane.thrust_force * force_scale - 1.0, 0.0)
            over_power = max(lane.power * power_scale - 1.0, 0.0)
            force_excess += engaged * over_force
            power_excess += engaged * over_power
            over = max(over_force, over_power)
            overload_time += engaged if over > 0.0 else 0.0
            severe_overload_time += engaged if over > p.overload_tolerance else 0.0
            if p.holds_roughness:
                deviation += engaged * abs(roughness(p, lane.thrust_force) / lane.roughness_reference - 1.0)
            worn = lane.used_life >= 1.0
            broken = lane.thrust_force > lane.edge_strength
        if not lane.cutting or lane.depth_of_cut <= 0.0:
            leave_metal(lane, p, turns)
        follow_process(lane, p)
        if worn or broken or lane.path >= p.path_end:
            break

    lane.clock += time
    follow_nominal_wear(lane, p, cutting_time_before)
    charge_life(lane, p, used_life_before, report)
    report.time += 60.0 * time
    report.engaged_time += 60.0 * engaged_time
    report.removed += removed
    report.mean_thrust_force += 60.0 * impulse
    report.mean_power += 60.0 * work
    report.overload_time += 60.0 * overload_time
    report.severe_overload_time += 60.0 * severe_overload_time
    report.cost_force += force_excess
    report.cost_power += power_excess
    report.roughness_deviation += 60.0 * deviation
    return time, run, worn, broken


@compiled
def turn_part(lane, parameters, action, report):
    """Turn the next part in all its passes; return (time passed at work [min], whether an edge was worn, broken)."""
    p = parameters
    minutes, any_worn, any_broken = 0.0, False, False
    passes, depth = part_passes(p, action)
    start = start_part(lane, p)
    for number in range(passes):
        sub_step = start_pass(lane, p, action, start, number, passes, depth, report)
        engaged_before = report.engaged_time
        left = p.sub_steps
        while left > 0:
            time, run, worn, broken = travel(lane, p, left, sub_step, report)
            mend(lane, p, worn, broken, report)
            minutes += time
            left -= run
            any_worn |= worn
            any_broken |= broken
        end_pass(lane, p, engaged_before, report)
    end_part(lane, p, start)
    return minutes, any_worn, any_broken


@compiled
def mend(lane, parameters, worn, broken, report):
    """Book a broken edge, and put a fresh one in place of one worn or broken, where that is not the episode's end."""
    if broken:
        break_edge(lane, parameters, report)
    if (worn or broken) and parameters.edge_changes != END:
        replace_edge(lane, parameters, broken, report)


@compiled
def look_ahead(lane, parameters):
    """What the controller is told of the interval to come."""
    if parameters.holds_roughness:
        draw_reference(lane, parameters)
    if parameters.probe:
        probe_next_bar(lane, parameters)


@compiled
def cut_metal(lane, parameters, engaged, turns):
    """Wear the edge for an engaged time [min], then let thrust force [N] and power [kW] follow for so many turns [rev]."""
    speed, feed, depth = math.log(lane.cutting_speed), math.log(lane.feed), math.log(lane.depth_of_cut)
    hardness = lane.log_hardness
    log_coefficient = lane.log_wear_factor + log_wear_coefficient(parameters, speed, feed, depth, hardness) + lane.log_skin_wear
    end = lane.cutting_time + engaged
    lane.used_life = advance_used_life(parameters, lane.used_life, log_coefficient, lane.cutting_time, end)
    lane.cutting_time = end
    wear = log_wear(parameters, lane.used_life)
    force, power = force_and_power(parameters, speed, feed, depth, wear, hardness)
    if parameters.chip_lag > 0.0:
        share = -math.expm1(-turns / parameters.chip_lag)
        force = lane.thrust_force + (force - lane.thrust_force) * share
        power = lane.power + (power - lane.power) * share
    lane.thrust_force, lane.power = force, power


@compiled
def leave_metal(lane, parameters, turns):
    """Let thrust force and power vanish."""
    remains = math.exp(-turns / parameters.chip_lag) if parameters.chip_lag > 0.0 else 0.0
    lane.thrust_force *= remains
    lane.power *= remains


@compiled
def follow_nominal_wear(lane, parameters, cutting_time_before):
    """Advance the wear that the control's own nominal model predicts, from the speed and feed at the interval's end."""
    if lane.cutting_time > cutting_time_before:
        speed, feed = math.log(lane.cutting_speed), math.log(lane.feed)
        log_coefficient = log_wear_coefficient(parameters, speed, feed, lane.log_nominal_depth, 0.0)
        lane.nominal_used_life = advance_used_life(
            parameters, lane.nominal_used_life, log_coefficient, cutting_time_before, lane.cutting_time
        )
