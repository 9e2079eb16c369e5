"""The transition: one control interval of the lathes of a block.

Written once, as scalar Python for one lane ``i`` of the records of ``records.py``, in short loops over some lanes of a block.
Loops have no branches but on the scenario: compiled, they run several lanes at once, one lane or many give the same bits, and a
lane that has stopped takes sub-steps of no length. What seldom happens, such as a bar's beginning or an edge's end, is left to
loops that look for the lanes in which it did.

Every sub-step takes the state at its end (so the result converges in the first order of the sub-step), and the fields at the
middle of the metal it cut.
"""

import math

from turning_env.compilation import compiled, compiled_apart
from turning_env.drives import clipped, set_point
from turning_env.economics import settle
from turning_env.edge import break_edge, charge, discard_edge, fit_edge, replace_edge
from turning_env.elementary import exponential, logarithm, raised
from turning_env.machinability import force_and_power, log_wear_coefficient
from turning_env.parts import end_passes, start_part, start_passes
from turning_env.records import END, OVERRIDE, PART, SET_POINT
from turning_env.report import clear_sums
from turning_env.sensors import follow_process, read_sensors
from turning_env.surface import draw_reference, roughness
from turning_env.wear import EQUIVALENT_TIME, life_by_clock, life_share, log_wear, wear_by_clock
from turning_env.workpiece import look_up_fields, position_in_row, probe_next_bar

_LEAST_DEPTH = 1e-6  # [mm] keeps the logarithm of a depth that is not cut within its range
_LEAST_LIFE = 1e-300  # [-] likewise of an edge that has not cut


@compiled_apart
def start_episode(lanes, work, report, i, parameters):
    """Put a fresh edge before the first bar. The lane's ``seed`` and ``episode`` say which edge and which bars."""
    p = parameters
    lanes.interval_count[i] = 0
    lanes.ended[i] = 0
    lanes.path[i] = 0.0
    lanes.clock[i] = 0.0
    lanes.turns[i] = 0.0
    _, in_metal = position_in_row(p, 0.0)
    lanes.cutting[i] = 1 if in_metal else 0
    lanes.commanded_cutting_speed[i] = p.initial_cutting_speed
    lanes.commanded_feed[i] = p.initial_feed
    lanes.cutting_speed[i] = p.initial_cutting_speed
    lanes.feed[i] = p.initial_feed
    lanes.edge[i] = 0
    fit_edge(lanes, i, p)
    lanes.bar[i] = -1.0
    lanes.pass_floor[i] = 0.0
    lanes.pass_ceiling[i] = math.inf
    lanes.log_nominal_depth[i] = p.log_depth_of_cut
    work.middle[i] = 0.0
    work.engaged[i] = 1.0
    look_up_fields(lanes, work, i, i + 1, p)
    lanes.measured_thrust_force[i] = 0.0
    lanes.measured_servo_current[i] = 0.0
    lanes.measured_power[i] = 0.0
    look_ahead(lanes, i, i + 1, p)
    clear_sums(report, i)
    work.log_cutting_speed[i] = logarithm(p.initial_cutting_speed)
    work.log_feed[i] = logarithm(p.initial_feed)


@compiled_apart
def run_interval(lanes, work, report, actions, count, parameters):
    """Run one control interval; ``actions``, shape (lanes, action size), are those of the block's lanes.

    Leaves reward [s], terminated and truncated in ``work``.
    """
    p = parameters
    for i in range(count):
        clear_sums(report, i)
        work.minutes[i] = 0.0
        work.edge_failed[i] = 0
        work.worn[i] = 0
        work.broken[i] = 0
    if p.change_action >= 0:
        for i in range(count):
            if actions[i, p.change_action] > 0.0:
                discard_edge(lanes, report, i, p)
    passes = prepare(lanes, work, actions, 0, count, p)
    for number in range(passes):
        if p.action == PART:
            start_passes(lanes, work, report, actions, 0, count, p, number)
        travel(lanes, work, report, count, p)
        if p.action == PART:
            end_passes(lanes, work, report, 0, count, p, number)
        else:
            mend(lanes, work, report, 0, count, p)
    for i in range(count):
        lanes.interval_count[i] += 1
    read_sensors(lanes, work, 0, count, p)
    timeless, by_interval = p.edge_changes == END, p.action != PART
    for i in range(count):
        finish_interval(lanes, work, report, i, p, timeless, by_interval)
    look_ahead(lanes, 0, count, p)


@compiled
def finish_interval(lanes, work, report, i, parameters, timeless, by_interval):
    """Find out whether the episode has ended, and settle what the interval earned."""
    p = parameters
    finished = 1 if lanes.path[i] > p.path_end - 1e-6 else 0  # a path of whole bars, but for rounding
    ends_with_edge = 1 if timeless else 0
    terminated = finished | (work.edge_failed[i] & ends_with_edge)
    out_of_intervals = 1 if lanes.interval_count[i] >= p.interval_limit else 0
    out_of_minutes = 1 if lanes.clock[i] + 0.5 * p.sub_step >= p.time_limit else 0
    out_of_time = out_of_intervals if timeless else out_of_minutes
    work.terminated[i] = terminated
    work.truncated[i] = out_of_time & (1 - terminated)
    lanes.ended[i] = out_of_time | terminated

    report.finished[i] = float(finished)
    report.broken[i] = 1.0 if report.edges_broken[i] > 0.0 else 0.0
    engaged = report.engaged_time[i] if by_interval and report.engaged_time[i] > 0.0 else 1.0
    report.mean_thrust_force[i] /= engaged
    report.mean_power[i] /= engaged
    work.reward[i] = settle(report, i, p, work.minutes[i])


@compiled
def prepare(lanes, work, actions, first, last, parameters):
    """Take the actions in; return how often the lanes have to travel: once, but with parts as often as one has passes."""
    p = parameters
    if p.action != PART:
        command(lanes, work, actions, first, last, p)
        for i in range(first, last):
            work.sub_step[i] = p.sub_step
            work.sub_steps_left[i] = p.sub_steps
        return 1
    most = 0
    for i in range(first, last):
        start_part(lanes, work, i, p, actions[i])
        most = max(most, work.passes[i])
    return most


@compiled
def command(lanes, work, actions, first, last, parameters):
    """Set the commanded cutting speed and feed from actions in -1..1 (what lies outside is clipped)."""
    p = parameters
    for i in range(first, last):
        work.action[0, i] = clipped(actions[i, 0])
    if p.action == OVERRIDE:
        for i in range(first, last):
            lanes.commanded_feed[i] = 0.5 * (work.action[0, i] + 1.0) * p.override_max * p.initial_feed
    else:
        for i in range(first, last):
            work.action[1, i] = clipped(actions[i, 1])
        if p.action == SET_POINT:
            for i in range(first, last):
                lanes.commanded_cutting_speed[i] = set_point(work.action[0, i], p.cutting_speed_min, p.cutting_speed_max)
                lanes.commanded_feed[i] = set_point(work.action[1, i], p.feed_min, p.feed_max)
        else:
            for i in range(first, last):
                lanes.commanded_cutting_speed[i] *= exponential(p.cutting_speed_step * work.action[0, i])
                lanes.commanded_feed[i] *= exponential(p.feed_step * work.action[1, i])
    for i in range(first, last):
        speed, feed = lanes.commanded_cutting_speed[i], lanes.commanded_feed[i]
        lanes.commanded_cutting_speed[i] = min(max(speed, p.cutting_speed_min), p.cutting_speed_max)
        lanes.commanded_feed[i] = min(max(feed, p.feed_min), p.feed_max)


@compiled_apart
def travel(lanes, work, report, count, parameters):
    """Run the sub-steps that every lane has left, but no further than to the end of its edge or of the job.

    With parts, an edge's end is looked after on the way. Adds to the report's sums, where ``cost_force``, ``cost_power`` and the
    means still are integrals: [min], [min], [N s] and [kJ].
    """
    p = parameters
    by_equivalent_time = p.wear_rule == EQUIVALENT_TIME
    for i in range(count):
        work.cut[i], _ = position_in_row(p, lanes.path[i])
        begin_account(lanes, work, i)
        work.chip_remains[i] = 0.0
        work.time_power[i] = 0.0
    if not by_equivalent_time:
        for i in range(count):
            work.time_power[i] = raised(lanes.cutting_time[i], p.wear_law.time)
    for _ in range(p.sub_steps):
        failed = run_sub_step(lanes, work, report, count, p)
        if failed > 0 and p.action == PART:
            for i in range(count):
                if work.worn[i] + work.broken[i] > 0:
                    close_account(lanes, work, report, i, p, by_equivalent_time)
            mend(lanes, work, report, 0, count, p)
            for i in range(count):
                if work.worn[i] + work.broken[i] > 0:
                    begin_account(lanes, work, i)
                    work.time_power[i] = raised(lanes.cutting_time[i], p.wear_law.time)
                work.worn[i] = 0
                work.broken[i] = 0
    for i in range(count):
        close_account(lanes, work, report, i, p, by_equivalent_time)


@compiled_apart
def run_sub_step(lanes, work, report, count, parameters):
    """Run one sub-step; return in how many lanes the edge is worn out or broken."""
    p = parameters
    for i in range(count):
        move(lanes, work, i, p)
    look_up_fields(lanes, work, 0, count, p)
    for i in range(count):
        work.engaged[i] = work.engaged[i] if lanes.depth_of_cut[i] > 0.0 else 0.0
        work.log_cutting_speed[i] = logarithm(lanes.cutting_speed[i])
        work.log_feed[i] = logarithm(lanes.feed[i])
        work.log_depth[i] = logarithm(max(lanes.depth_of_cut[i], _LEAST_DEPTH))
    for i in range(count):
        lanes.cutting_time[i] += work.engaged[i]
    if p.wear_rule == EQUIVALENT_TIME:
        for i in range(count):
            lanes.used_life[i] += life_share(p, log_coefficient(lanes, work, i, p), work.engaged[i])
    else:
        for i in range(count):
            work.time_power_before[i] = work.time_power[i]
            work.time_power[i] = raised(lanes.cutting_time[i], p.wear_law.time)
        for i in range(count):
            coefficient = log_coefficient(lanes, work, i, p)
            work.wear[i] = wear_by_clock(p, lanes.used_life[i], coefficient, work.time_power_before[i], work.time_power[i])
        for i in range(count):
            used_life = raised(work.wear[i], p.life_exponent)
            used_life = max(used_life, lanes.used_life[i])  # rounding must not make an edge sharper
            lanes.used_life[i] = used_life if work.engaged[i] > 0.0 else lanes.used_life[i]
    for i in range(count):
        work.log_wear[i] = log_wear(p, max(lanes.used_life[i], _LEAST_LIFE))
    if p.chip_lag > 0.0:
        for i in range(count):
            work.chip_remains[i] = exponential(-work.turns[i] / p.chip_lag)
    for i in range(count):
        load_edge(lanes, work, i, p)
    if p.holds_roughness:
        for i in range(count):
            deviation = abs(roughness(p, lanes.thrust_force[i]) / lanes.roughness_reference[i] - 1.0)
            report.roughness_deviation[i] += 60.0 * work.engaged[i] * deviation
    failed, stops = 0, p.action != PART
    force_scale, power_scale = 1.0 / p.thrust_force_limit, 1.0 / p.power_limit
    for i in range(count):
        sum_up(lanes, work, report, i, force_scale, power_scale, p.overload_tolerance)
        failed += watch_edge(lanes, work, i, p, stops)
        leave_metal(lanes, work, i)
        follow_process(lanes, work, i, p)
    return failed


@compiled
def move(lanes, work, i, parameters):
    """Let the drives follow their commands, and move the tool along."""
    p = parameters
    runs = work.sub_steps_left[i] > 0
    running = 1 if runs else 0
    work.running[i] = running
    work.sub_steps_left[i] -= running
    sub_step = work.sub_step[i] if runs else 0.0
    spindle_share = p.spindle_share if runs else 0.0
    feed_share = p.feed_share if runs else 0.0
    lanes.cutting_speed[i] += (lanes.commanded_cutting_speed[i] - lanes.cutting_speed[i]) * spindle_share
    lanes.feed[i] += (lanes.commanded_feed[i] - lanes.feed[i]) * feed_share
    spindle_speed = lanes.cutting_speed[i] * p.revolutions_per_metre  # [rev/min]
    feed_velocity = spindle_speed * lanes.feed[i]  # [mm/min]
    turns = spindle_speed * sub_step
    work.turns[i] = turns
    lanes.turns[i] += turns
    lanes.path[i] += feed_velocity * sub_step
    work.time[i] += sub_step
    cut_before = work.cut[i]
    cut, in_metal = position_in_row(p, lanes.path[i])
    work.cut[i] = cut
    work.middle[i] = 0.5 * (cut_before + cut)
    work.engaged[i] = max(cut - cut_before, 0.0) / feed_velocity
    cutting = 1 if in_metal else 0
    lanes.cutting[i] = cutting if runs else lanes.cutting[i]


@compiled
def log_coefficient(lanes, work, i, parameters):
    """Logarithm of the wear [mm] that a fresh edge would have after a minute of what is being cut."""
    nominal = log_wear_coefficient(
        parameters, work.log_cutting_speed[i], work.log_feed[i], work.log_depth[i], lanes.log_hardness[i]
    )
    return lanes.log_wear_factor[i] + nominal + lanes.log_skin_wear[i]


@compiled
def load_edge(lanes, work, i, parameters):
    """Let thrust force [N] and power [kW] follow, where metal was cut."""
    force, power = force_and_power(
        parameters, work.log_cutting_speed[i], work.log_feed[i], work.log_depth[i], work.log_wear[i], lanes.log_hardness[i]
    )
    remains = work.chip_remains[i]
    force = force * (1.0 - remains) + lanes.thrust_force[i] * remains
    power = power * (1.0 - remains) + lanes.power[i] * remains
    lanes.thrust_force[i] = force if work.engaged[i] > 0.0 else lanes.thrust_force[i]
    lanes.power[i] = power if work.engaged[i] > 0.0 else lanes.power[i]


@compiled
def sum_up(lanes, work, report, i, force_scale, power_scale, tolerance):
    """Add what was cut, and by how much force and power exceeded their limits, to the report's sums."""
    engaged = work.engaged[i]  # [min]
    seconds = 60.0 * engaged
    force, power = lanes.thrust_force[i], lanes.power[i]
    over_force = max(force * force_scale - 1.0, 0.0)
    over_power = max(power * power_scale - 1.0, 0.0)
    over = max(over_force, over_power)
    report.engaged_time[i] += seconds
    report.removed[i] += lanes.cutting_speed[i] * lanes.feed[i] * lanes.depth_of_cut[i] * engaged
    report.mean_thrust_force[i] += seconds * force
    report.mean_power[i] += seconds * power
    report.cost_force[i] += engaged * over_force
    report.cost_power[i] += engaged * over_power
    report.overload_time[i] += seconds if over > 0.0 else 0.0
    report.severe_overload_time[i] += seconds if over > tolerance else 0.0


@compiled
def watch_edge(lanes, work, i, parameters, stops):
    """Stop the lane at the end of its edge or of the job, if it ``stops`` there; return 1 if the edge has failed, else 0."""
    in_metal = 1 if work.engaged[i] > 0.0 else 0
    spent = 1 if lanes.used_life[i] >= 1.0 else 0
    overcome = 1 if lanes.thrust_force[i] > lanes.edge_strength[i] else 0
    arrived = 1 if lanes.path[i] >= parameters.path_end else 0
    work.worn[i] |= in_metal & spent
    work.broken[i] |= in_metal & overcome
    failed = work.worn[i] | work.broken[i]
    work.edge_failed[i] |= failed
    left = work.sub_steps_left[i]
    work.sub_steps_left[i] = 0 if stops and (failed | arrived) > 0 else left
    return failed


@compiled
def leave_metal(lanes, work, i):
    """Let thrust force and power vanish in air."""
    in_metal = min(float(lanes.cutting[i]), lanes.depth_of_cut[i]) > 0.0
    remains = 1.0 if in_metal else work.chip_remains[i]
    lanes.thrust_force[i] *= remains
    lanes.power[i] *= remains


@compiled
def begin_account(lanes, work, i):
    """Note down what the edge's life and cutting time are now."""
    work.time[i] = 0.0
    work.used_life_before[i] = min(lanes.used_life[i], 1.0)
    work.cutting_time_before[i] = lanes.cutting_time[i]


@compiled
def close_account(lanes, work, report, i, parameters, by_equivalent_time):
    """Bring clock, life charged and nominal wear up to date. The nominal model takes the speed and feed at the end."""
    p = parameters
    time = work.time[i]
    lanes.clock[i] += time
    report.time[i] += 60.0 * time
    work.minutes[i] += time
    charge(report, i, p, min(lanes.used_life[i], 1.0) - work.used_life_before[i])
    start, end, used = work.cutting_time_before[i], lanes.cutting_time[i], lanes.nominal_used_life[i]
    coefficient = log_wear_coefficient(p, work.log_cutting_speed[i], work.log_feed[i], lanes.log_nominal_depth[i], 0.0)
    if by_equivalent_time:
        lanes.nominal_used_life[i] = used + life_share(p, coefficient, end - start)
    else:
        life = life_by_clock(p, used, coefficient, start, end)
        lanes.nominal_used_life[i] = life if end > start else used


@compiled
def mend(lanes, work, report, first, last, parameters):
    """Book broken edges, and put a fresh one in place of one worn or broken, where that is not the episode's end."""
    p = parameters
    failed = 0
    for i in range(first, last):
        failed += work.worn[i] | work.broken[i]
    if failed > 0:
        for i in range(first, last):
            if work.broken[i] > 0:
                break_edge(lanes, report, i, p)
            if work.worn[i] + work.broken[i] > 0 and p.edge_changes != END:
                replace_edge(lanes, report, i, p, work.broken[i] > 0)


@compiled
def look_ahead(lanes, first, last, parameters):
    """What the controller is told of the interval to come."""
    if parameters.holds_roughness:
        for i in range(first, last):
            draw_reference(lanes, i, parameters)
    if parameters.probe:
        for i in range(first, last):
            probe_next_bar(lanes, i, parameters)
