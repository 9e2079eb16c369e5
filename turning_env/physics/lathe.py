"""The transition: one step of the environments of a block.

It is written once, as scalar Python for one environment ``i`` of the records of ``records.py``, in
short loops over some environments of a block. Loops branch only on the scenario. So the compiler
can vectorise them, and one environment or many give the same bits. A stopped environment takes
sub-steps of length 0. Separate loops handle rare events, such as the start of a bar or the end of
an edge, in the environments where they occur.

Phases are functions that are compiled into their callers, so their names cost no time. Each
phenomenon has its equations in a file of its own. Integration: ``docs/models.md``.
"""

import math

from turning_env.numerics.compilation import (
    FIRST_ENV,
    ONE_ENV,
    compiled,
    compiled_separately,
    env_range,
)
from turning_env.numerics.functions import exp, log
from turning_env.numerics.keyed_random import TANGLE_CHANNEL, exponential
from turning_env.physics import records
from turning_env.physics.drives import clipped, follow_late_command, note_command, set_point
from turning_env.physics.edge import break_edge, change_edge, charge, fit_edge, stop_machine
from turning_env.physics.failure import break_failing_edges
from turning_env.physics.machinability import (
    excess_over_further_limit,
    force_and_power,
    loads_with_fresh_share,
    log_wear_coefficient,
)
from turning_env.physics.parts import end_pass, start_part, start_pass
from turning_env.physics.quantities import (
    COMMANDED,
    END,
    OVERRIDE,
    PART,
    SET_POINT,
)
from turning_env.physics.report import clear_sums, finish_step
from turning_env.physics.sensors import follow_process, read_sensors
from turning_env.physics.slender_bar import bend_bar, chatter, note_stiffness
from turning_env.physics.spindle import allowed_share, heat_up, idle_power
from turning_env.physics.surface import draw_reference, roughness
from turning_env.physics.swarf import tangle
from turning_env.physics.wear import (
    EQUIVALENT_TIME,
    life_by_clock,
    life_share,
    log_wear,
    with_phases,
)
from turning_env.physics.workpiece import (
    limit_of_section,
    look_up_fields,
    position_in_row,
    probe_next_bar,
)
from turning_env.scenario.power_law import MIN_DEPTH, MIN_LIFE

# The start of an episode keeps the rows of a state before this one: its seed and its number.
_FIRST_CLEARED_ROW = records.row_of(records.STATE, "step_count")


@compiled_separately
def start_episode(state, work, report, i, p):
    """Put a fresh edge before the first bar.

    The state's ``seed`` and ``episode`` determine edges and bars.
    """
    clear_state(state, i)
    _, in_metal = position_in_row(p, i, 0.0)
    state.cutting[i] = 1 if in_metal else 0
    state.commanded_cutting_speed[i] = p.initial_cutting_speed[i]
    state.commanded_feed[i] = p.initial_feed[i]
    state.cutting_speed[i] = p.initial_cutting_speed[i]
    state.feed[i] = p.initial_feed[i]
    fit_edge(state, i, p)
    if p.chips_tangle:
        state.tangle_margin[i] = exponential(state, i, channel=TANGLE_CHANNEL, bar=0, index=0)
    state.bar[i] = -1.0  # no bar has been entered, so the first one is drawn
    state.pass_ceiling[i] = math.inf
    state.log_nominal_depth[i] = p.log_depth_of_cut[i]
    work.middle[i] = 0.0
    work.engaged[i] = 1.0  # any time above 0 makes ``look_up_fields`` draw the first bar
    work.tangles[i] = 0
    after = i + ONE_ENV
    look_up_fields(state, work, i, after, p)
    look_ahead(state, i, after, p)
    clear_sums(report, i, after)
    # The observation reads these logarithms.
    work.log_cutting_speed[i] = log(p.initial_cutting_speed[i])
    work.log_feed[i] = log(p.initial_feed[i])


@compiled
def clear_state(state, i):
    """Set all that an episode before left behind to 0."""
    table = state.table
    for k in range(_FIRST_CLEARED_ROW, table.shape[0]):
        table[k, i] = 0.0


@compiled_separately
def run_step(state, work, report, actions, count, p):
    """Run one step of the first ``count`` environments of a block.

    ``state``, ``work`` and ``report`` are the block's records, ``p`` its parameters
    (``records.py``); ``actions`` has shape (environments, action size). Until the step is finished,
    ``excess_force``, ``excess_power`` and the means in the report are integrals: [min], [min],
    [N s] and [kJ].
    """
    clear_sums(report, FIRST_ENV, count)
    for i in range(count):
        work.minutes[i] = 0.0
        work.edge_failed[i] = 0
        work.tangles[i] = 0
    if p.edge_changes == COMMANDED:
        change_commanded_edges(state, report, actions, count, p)
    if p.action == PART:
        passes = start_parts(state, work, actions, count, p)
    else:
        passes = 1
        start_interval(state, work, actions, count, p)
    for number in range(passes):
        run_pass(state, work, report, actions, count, p, number)
    if p.chips_tangle:
        for i in range(count):
            stop_machine(state, report, i, p, work.tangles[i] * p.tangle_time[i])
    for i in range(count):
        state.step_count[i] += 1
    read_sensors(state, work, FIRST_ENV, count, p)
    # Read once, before the loop: a loop that reads them again is not vectorised.
    ends_with_edge = p.edge_changes == END
    by_step = p.action != PART
    for i in range(count):
        finish_step(state, work, report, i, p, ends_with_edge, by_step)
    look_ahead(state, FIRST_ENV, count, p)


@compiled
def change_commanded_edges(state, report, actions, count, p):
    """Change the edges whose action asks for it; what is left of their life is charged, too."""
    for i in range(count):
        if actions[i, -1] > 0.0:
            charge(report, i, p, max(0.0, 1.0 - state.used_life[i]))
            change_edge(state, report, i, p, stop=0.0)


@compiled
def start_parts(state, work, actions, count, p):
    """Start the next part in every environment; return the largest number of passes."""
    passes = 1
    for i in range(count):
        start_part(state, work, i, p, actions[i])
        passes = max(passes, work.passes[i])
    return passes


@compiled
def start_interval(state, work, actions, count, p):
    """Set the commands and the sub-steps of a control interval."""
    if p.delays_commands:
        for i in range(count):
            note_command(state, i)
    command(state, work, actions, count, p)
    for i in range(count):
        work.sub_step[i] = p.sub_step[i]
        work.sub_steps_left[i] = p.sub_steps


@compiled
def command(state, work, actions, count, p):
    """Set the commanded cutting speed and feed from actions, which are clipped to -1..1."""
    second = 0 if p.action == OVERRIDE else 1
    for i in range(count):
        work.action[0, i] = clipped(actions[i, 0])
        work.action[1, i] = clipped(actions[i, second])
    if p.action == OVERRIDE:
        for i in range(count):
            override = 0.5 * (work.action[0, i] + 1.0) * p.override_max[i]
            state.commanded_feed[i] = override * p.initial_feed[i]
    elif p.action == SET_POINT:
        for i in range(count):
            state.commanded_cutting_speed[i] = set_point(
                work.action[0, i], p.cutting_speed_min[i], p.cutting_speed_max[i]
            )
            state.commanded_feed[i] = set_point(work.action[1, i], p.feed_min[i], p.feed_max[i])
    else:
        for i in range(count):
            state.commanded_cutting_speed[i] *= exp(p.cutting_speed_step[i] * work.action[0, i])
            state.commanded_feed[i] *= exp(p.feed_step[i] * work.action[1, i])
    for i in range(count):
        speed = max(state.commanded_cutting_speed[i], p.cutting_speed_min[i])
        feed = max(state.commanded_feed[i], p.feed_min[i])
        state.commanded_cutting_speed[i] = min(speed, p.reachable_cutting_speed[i])
        state.commanded_feed[i] = min(feed, p.feed_max[i])
    if p.has_section_speeds:
        for i in range(count):
            limit = limit_of_section(p, i, state.path[i])
            state.commanded_cutting_speed[i] = min(state.commanded_cutting_speed[i], limit)


@compiled
def run_pass(state, work, report, actions, count, p, number):
    """Run a control interval, or pass ``number`` of the parts."""
    if p.action == PART:
        for i in range(count):
            work.sub_steps_left[i] = 0  # where the part has fewer passes
            if number < work.passes[i]:
                start_pass(state, work, report, i, p, actions[i], number)
    for i in range(count):
        work.cut[i], _ = position_in_row(p, i, state.path[i])
        begin_charging(state, work, i)
        work.chip_remains[i] = 0.0
        work.target_cutting_speed[i] = state.commanded_cutting_speed[i]
        work.target_feed[i] = state.commanded_feed[i]
    by_equivalent_time = p.wear_rule == EQUIVALENT_TIME
    for _ in range(p.sub_steps):
        failed = run_sub_step(state, work, report, count, p)
        if failed > 0:
            replace_failed_edges(state, work, report, count, p, by_equivalent_time)
    for i in range(count):
        charge_time_and_life(state, work, report, i, p, by_equivalent_time)
    if p.action == PART:
        for i in range(count):
            if number < work.passes[i]:
                end_pass(state, work, report, i, p)


@compiled_separately
def run_sub_step(state, work, report, count, p):
    """Run one sub-step, not beyond the end of the job.

    Return the number of environments with a worn-out or broken edge.
    """
    move_tools(state, work, count, p)
    look_up_cuts(state, work, count, p)
    wear_edges(state, work, count, p)
    load_edges(state, work, count, p)
    if p.holds_roughness:
        for i in range(count):
            add_roughness(state, work, report, i, p)
    break_failing_edges(state, work, count, p)
    if p.chips_tangle:
        tangle(state, work, count, p)
    compare_with_further_limits(state, work, count, p)
    failed = end_sub_step(state, work, report, count, p)
    if p.heats:
        for i in range(count):
            heat_up(state, work, i, p)
    return failed


@compiled
def move_tools(state, work, count, p):
    """Move drives and tools over the sub-step."""
    if p.delays_commands:
        for i in range(count):
            follow_late_command(state, work, i, p)
    for i in range(count):
        move(state, work, i, p)


@compiled
def move(state, work, i, p):
    """Let the drives follow their commands, and move the tool."""
    runs = work.sub_steps_left[i] > 0
    work.sub_steps_left[i] -= 1 if runs else 0
    sub_step = work.sub_step[i] if runs else 0.0
    # First-order lags, solved exactly over the sub-step (``drives.lag_share``).
    spindle_share = p.spindle_share[i] if runs else 0.0
    feed_share = p.feed_share[i] if runs else 0.0
    speed_change = work.target_cutting_speed[i] - state.cutting_speed[i]
    feed_change = work.target_feed[i] - state.feed[i]
    state.cutting_speed[i] += speed_change * spindle_share
    state.feed[i] += feed_change * feed_share
    spindle_speed = state.cutting_speed[i] * p.revolutions_per_metre[i]  # [rev/min]
    feed_velocity = spindle_speed * state.feed[i]  # [mm/min]
    turns = spindle_speed * sub_step
    work.turns[i] = turns
    state.turns[i] += turns
    state.path[i] += feed_velocity * sub_step
    work.time[i] += sub_step
    # The ends of a bar are located exactly: only metal that was passed counts as cut.
    cut_before = work.cut[i]
    cut, in_metal = position_in_row(p, i, state.path[i])
    work.cut[i] = cut
    work.middle[i] = 0.5 * (cut_before + cut)
    work.engaged[i] = max(cut - cut_before, 0.0) / feed_velocity
    cutting = 1 if in_metal else 0
    state.cutting[i] = cutting if runs else state.cutting[i]


@compiled
def look_up_cuts(state, work, count, p):
    """Set hardness and depth of the cut, with the bar's deflection, and the cut's logarithms."""
    if p.bends:
        for i in range(count):
            note_stiffness(state, work, i)
    look_up_fields(state, work, FIRST_ENV, count, p)
    if p.bends:
        for i in range(count):
            bend_bar(state, work, i, p)
    # The laws of force, power and wear add up logarithms (``machinability.log_response``).
    for i in range(count):
        work.engaged[i] = work.engaged[i] if state.depth_of_cut[i] > 0.0 else 0.0
        work.log_cutting_speed[i] = log(state.cutting_speed[i])
        work.log_feed[i] = log(state.feed[i])
        work.log_depth[i] = log(max(state.depth_of_cut[i], MIN_DEPTH))
        work.life_before[i] = state.used_life[i]


@compiled
def wear_edges(state, work, count, p):
    """Advance the used life of the edges that cut, by the scenario's rule (``wear.py``).

    By the rule of equivalent time, a cut uses a share of the life, however worn the edge is. By
    clock time, it also depends on how long the edge has cut before.
    """
    if p.wear_rule == EQUIVALENT_TIME:
        for i in range(count):
            log_k = log_minute_wear(state, work, i, p)
            state.used_life[i] += life_share(p, i, log_k, work.engaged[i])
    else:
        for i in range(count):
            start = state.cutting_time[i]
            end = start + work.engaged[i]
            used_life = state.used_life[i]
            log_k = log_minute_wear(state, work, i, p)
            life = life_by_clock(p, i, used_life, log_k, start, end)
            # Rounding must not make an edge sharper. An edge out of the metal keeps its life.
            life = max(life, used_life)
            state.used_life[i] = life if work.engaged[i] > 0.0 else used_life
    if p.has_phases:
        for i in range(count):
            state.used_life[i] = with_phases(
                p, i, work.life_before[i], state.used_life[i], work.log_cutting_speed[i]
            )


@compiled
def log_minute_wear(state, work, i, p):
    """Return the logarithm of the wear [mm] of a fresh edge after a minute of the present cut."""
    nominal = log_wear_coefficient(
        p, i, work.log_cutting_speed[i], work.log_feed[i], work.log_depth[i], state.log_hardness[i]
    )
    return state.log_wear_factor[i] + nominal + state.log_skin_wear[i]


@compiled
def load_edges(state, work, count, p):
    """Set wear, thrust force [N] and cutting power [kW] at the end of the sub-step."""
    if p.chips_lag:
        for i in range(count):
            # First-order lag in turns: a chip needs one turn to reach its thickness.
            work.chip_remains[i] = exp(-work.turns[i] / p.chip_lag[i])
    if p.chatters:
        for i in range(count):
            chatter(state, work, i, p)
    # Two loops: with a branch in one loop, it is not vectorised.
    if p.fresh_edges_load:
        for i in range(count):
            set_loads(state, work, i, p, loads_with_fresh_share)
    else:
        for i in range(count):
            set_loads(state, work, i, p, force_and_power)


@compiled
def set_loads(state, work, i, p, laws):
    """Set thrust force and power by their laws, behind the lag of a chip that thickens.

    ``laws``: function of ``machinability.py``. An edge in air keeps the values of its last cut.
    """
    state.cutting_time[i] += work.engaged[i]
    work.log_wear[i] = log_wear(p, i, max(state.used_life[i], MIN_LIFE))
    force, power = laws(
        p,
        i,
        work.log_cutting_speed[i],
        work.log_feed[i],
        work.log_depth[i],
        work.log_wear[i],
        state.log_hardness[i],
    )
    force *= 1.0 + work.chatter[i]
    remains = work.chip_remains[i]
    cuts = work.engaged[i] > 0.0
    lagged_force = force * (1.0 - remains) + state.thrust_force[i] * remains
    lagged_power = power * (1.0 - remains) + state.power[i] * remains
    state.thrust_force[i] = lagged_force if cuts else state.thrust_force[i]
    state.power[i] = lagged_power if cuts else state.power[i]


@compiled
def add_roughness(state, work, report, i, p):
    """Add the relative deviation of Ra from its reference to its integral [s]."""
    ratio = roughness(p, i, state.thrust_force[i]) / state.roughness_reference[i]
    deviation = abs(ratio - 1.0)
    # In air no surface is made, which deviates by all of its reference.
    in_air = p.sub_step[i] - work.engaged[i]
    report.roughness_deviation[i] += 60.0 * (work.engaged[i] * deviation + in_air)


@compiled
def compare_with_further_limits(state, work, count, p):
    """Set the largest relative excess over a further limit; without such limits, it stays 0."""
    for k in range(p.further_limits):
        for i in range(count):
            excess = excess_over_further_limit(
                p, k, work.log_feed[i], work.log_depth[i], state.log_hardness[i]
            )
            work.over_further[i] = excess if k == 0 else max(work.over_further[i], excess)


@compiled
def end_sub_step(state, work, report, count, p):
    """Sum up the sub-step, find edges that failed and jobs that ended, and let sensors follow.

    Return the number of environments with a worn-out or broken edge.
    """
    # A step ends with the edge or the job; a part goes on with the next edge.
    stops = p.action != PART
    varies = p.heats or p.has_base_speed
    failed = 0
    for i in range(count):
        add_to_sums(state, work, report, i, p, varies)
        in_metal = 1 if work.engaged[i] > 0.0 else 0
        spent = 1 if state.used_life[i] >= 1.0 else 0
        overloaded = 1 if state.thrust_force[i] > state.edge_strength[i] else 0
        arrived = 1 if state.path[i] >= p.path_end[i] else 0
        work.worn[i] |= in_metal & spent
        work.broken[i] |= in_metal & overloaded
        edge_failed = work.worn[i] | work.broken[i]
        work.edge_failed[i] |= edge_failed
        failed += edge_failed
        ends = stops and (edge_failed | arrived) > 0
        work.sub_steps_left[i] = 0 if ends else work.sub_steps_left[i]
        leave_metal(state, work, i)
        follow_process(state, work, i, p)
    return failed


@compiled
def leave_metal(state, work, i):
    """Let force and power fall once the tool is out of the metal, behind the lag of the chip."""
    in_metal = min(float(state.cutting[i]), state.depth_of_cut[i]) > 0.0
    remains = 1.0 if in_metal else work.chip_remains[i]
    state.thrust_force[i] *= remains
    state.power[i] *= remains


@compiled
def add_to_sums(state, work, report, i, p, varies):
    """Add the removed metal, and the excess of force and power over their limits, to the sums.

    ``varies``: whether the allowed power depends on speed or heat.
    """
    engaged = work.engaged[i]  # [min]
    seconds = 60.0 * engaged
    force = state.thrust_force[i]
    power = state.power[i] + idle_power(p, i, state.cutting_speed[i])
    over_force = max(force * p.per_thrust_force_limit[i] - 1.0, work.over_further[i])
    share = allowed_share(state, i, p) if varies else 1.0
    over_power = max(power * p.per_power_limit[i] / share - 1.0, 0.0)
    over = max(over_force, over_power)
    removal_rate = state.cutting_speed[i] * state.feed[i] * state.depth_of_cut[i]  # [cm3/min]
    report.engaged_time[i] += seconds
    report.removed[i] += removal_rate * engaged
    report.mean_thrust_force[i] += seconds * force
    report.mean_power[i] += seconds * power
    report.excess_force[i] += engaged * over_force
    report.excess_power[i] += engaged * over_power
    report.overload_time[i] += seconds if over > 0.0 else 0.0
    # The severe share decides whether a policy is feasible; its tolerance is the scenario's.
    report.severe_overload_time[i] += seconds if over > p.overload_tolerance[i] else 0.0
    # Two fixed levels beside it show how a feasible policy is spread over the range of loads, so
    # scenarios with different tolerances can be compared.
    report.overload_2_percent_time[i] += seconds if over > 0.02 else 0.0
    report.overload_10_percent_time[i] += seconds if over > 0.10 else 0.0


@compiled
def begin_charging(state, work, i):
    """Store the edge's used life and cutting time at the start of charging."""
    work.time[i] = 0.0
    work.used_life_before[i] = min(state.used_life[i], 1.0)
    work.cutting_time_before[i] = state.cutting_time[i]


@compiled
def charge_time_and_life(state, work, report, i, p, by_equivalent_time):
    """Update clock, charged life and nominal wear.

    The nominal model takes the speed and feed at the end for the whole time.
    """
    time = work.time[i]
    state.clock[i] += time
    report.time[i] += 60.0 * time
    work.minutes[i] += time
    charge(report, i, p, min(state.used_life[i], 1.0) - work.used_life_before[i])
    start = work.cutting_time_before[i]
    end = state.cutting_time[i]
    used_life = state.nominal_used_life[i]
    log_k = log_wear_coefficient(
        p.nominal,
        i,
        log_cutting_speed=work.log_cutting_speed[i],
        log_feed=work.log_feed[i],
        log_depth_of_cut=state.log_nominal_depth[i],
        log_hardness=0.0,
    )
    if by_equivalent_time:
        state.nominal_used_life[i] = used_life + life_share(p.nominal, i, log_k, end - start)
    else:
        life = life_by_clock(p.nominal, i, used_life, log_k, start, end)
        state.nominal_used_life[i] = life if end > start else used_life


@compiled
def replace_failed_edges(state, work, report, count, p, by_equivalent_time):
    """Charge worn-out and broken edges, and replace them unless the episode ends with them."""
    for i in range(count):
        if work.worn[i] + work.broken[i] > 0:
            charge_time_and_life(state, work, report, i, p, by_equivalent_time)
            if work.broken[i] > 0:
                break_edge(state, report, i, p)
            if p.edge_changes != END:
                stop = p.breakage_downtime[i] if work.broken[i] > 0 else p.unplanned_stop[i]
                change_edge(state, report, i, p, stop)
            begin_charging(state, work, i)
            work.worn[i] = 0
            work.broken[i] = 0


@compiled
def look_ahead(state, first, last, p):
    """Draw the quantities that the control knows about the next step."""
    if p.holds_roughness:
        for i in env_range(first, last):
            draw_reference(state, i, p)
    if p.probe:
        for i in env_range(first, last):
            probe_next_bar(state, i, p)
