"""The typed records that the compiled transition works on.

A block of lanes has its state, what is noted down while it is worked on, and the interval's report; all share the parameters.
"""

from typing import Any

import numpy as np

from turning_env.physics.drives import lag_share
from turning_env.physics.wear import CLOCK_TIME, EQUIVALENT_TIME
from turning_env.scenario import Scenario
from turning_env.scenario.power_law import POWER_LAW_RECORD
from turning_env.scenario.sections import MAX_DEPTHS

# Numbers for what the compiled transition tells apart, by the words of ``sections.Control``.
INCREMENTAL, SET_POINT, OVERRIDE, PART = range(4)
ACTIONS = {"incremental": INCREMENTAL, "set_point": SET_POINT, "override": OVERRIDE, "part": PART}
END, AUTOMATIC, COMMANDED = range(3)
EDGE_CHANGES = {"end": END, "automatic": AUTOMATIC, "commanded": COMMANDED}

WIDTH = 32
"""Lanes of a block. Every quantity of a block is one array over its lanes, so that the compiled loops over lanes take several at
once; a block's quantities fit the processor's first cache."""


MAX_ENTRIES = 12
"""Entries that an observation may have."""


def block_of(*fields: tuple[Any, ...]) -> np.dtype[Any]:
    """The type of a block's record: for every field (name, kind) an array over the lanes, or one of the shape that is given."""
    return np.dtype([(name, kind, shape[0] if shape else (WIDTH,)) for name, kind, *shape in fields], align=True)


def narrowed(block: np.dtype[Any]) -> np.dtype[Any]:
    """The type of a block of one lane, with fields of its own: every array's last axis ``WIDTH`` times shorter."""
    fields: list[Any] = []
    for name in block.names or ():
        kind = block.fields[name][0]  # type: ignore[index]
        fields.append((name, kind.base, (*kind.shape[:-1], kind.shape[-1] // WIDTH)))
    notes: np.dtype[Any] = np.dtype((np.record, np.dtype(fields, align=True)))  # interpreted, it is asked for attributes
    return notes


LANES = block_of(
    # the episode's key
    ("seed", np.uint64),
    ("episode", np.uint64),
    # where the episode stands
    ("step_count", np.int64),
    ("ended", np.int64),  # 0 or 1
    ("cutting", np.int64),  # the tool is in metal, 0 or 1
    ("path", np.float64),  # tool position, air and metal [mm]
    ("clock", np.float64),  # machine time since the start [min]
    ("turns", np.float64),  # of the spindle since the start [rev]
    # drives
    ("commanded_cutting_speed", np.float64),  # [m/min]
    ("commanded_feed", np.float64),  # [mm/rev]
    ("cutting_speed", np.float64),  # [m/min]
    ("feed", np.float64),  # [mm/rev]
    # edge
    ("edge", np.int64),  # edges used before this one
    ("log_wear_factor", np.float64),  # [-]
    ("edge_strength", np.float64),  # [N]
    ("cutting_time", np.float64),  # [min]
    ("used_life", np.float64),  # [-]
    ("nominal_used_life", np.float64),  # as the nominal model has it [-]
    # bar at the tool
    ("bar", np.float64),  # whole numbers
    ("bar_hardness_normal", np.float64),
    ("bar_depth_normal", np.float64),
    ("hardness_cell", np.float64),  # nodes on either side: whole number and the next
    ("hardness_left", np.float64),
    ("hardness_right", np.float64),
    ("depth_cell", np.float64),
    ("depth_left", np.float64),
    ("depth_right", np.float64),
    ("log_hardness", np.float64),  # mean of the cut, with its skin [-]
    ("log_skin_wear", np.float64),  # what the skin in the cut adds to log wear [-]
    ("depth_of_cut", np.float64),  # [mm]
    ("pass_floor", np.float64),  # a pass cuts what stands higher than this above the finished contour [mm]
    ("pass_ceiling", np.float64),  # and, the passes before it having cut the rest, lower than this [mm]
    ("log_nominal_depth", np.float64),  # of the pass, as the control's models have it [mm]
    # process and sensors
    ("thrust_force", np.float64),  # [N]
    ("power", np.float64),  # [kW]
    ("lagged_thrust_force", np.float64),  # [N]
    ("lagged_power", np.float64),  # [kW]
    ("measured_thrust_force", np.float64),  # [N]
    ("measured_servo_current", np.float64),  # [A]
    ("measured_power", np.float64),  # [kW]
    ("probed_depth", np.float64),  # mean of what is to be cut of the next bar [mm]
    ("roughness_reference", np.float64),  # [um]
)

# What the transition notes down of a block while it works on it; nothing here lasts longer than an interval.
WORK = block_of(
    # the interval
    ("action", np.float64, (2, WIDTH)),  # speed and feed
    ("sub_step", np.float64),  # its length [min]
    ("sub_steps_left", np.int64),
    ("time", np.float64),  # since clock and life were last brought up to date [min]
    ("used_life_before", np.float64),  # at the beginning of that time [-]
    ("cutting_time_before", np.float64),  # likewise [min]
    ("minutes", np.float64),  # of the interval at work [min]
    ("ended_before", np.int64),  # the episode had ended before the interval, 0 or 1
    ("edge_failed", np.int64),  # an edge was worn out or broken, 0 or 1
    ("reward", np.float64),  # [s]
    ("terminated", np.int64),  # 0 or 1
    ("truncated", np.int64),
    # the part and its pass
    ("passes", np.int64),
    ("pass_depth", np.float64),  # [mm]
    ("part_start", np.float64),  # [mm of path]
    ("engaged_before", np.float64),  # of the part's cutting time, before the pass [s]
    # the sub-step
    ("running", np.int64),  # 0 in a lane that has stopped, else 1
    ("turns", np.float64),  # of the spindle [rev]
    ("cut", np.float64),  # metal behind the tool at its end [mm]
    ("middle", np.float64),  # likewise in the middle of what was cut [mm]
    ("engaged", np.float64),  # time in metal [min]
    ("along", np.float64),  # the middle's place along the bar [mm]
    ("passing", np.int64),  # a node or a bar's beginning was passed, 0 or 1
    ("node_lane", np.int64, (2 * WIDTH,)),  # nodes to be drawn
    ("node_channel", np.uint64, (2 * WIDTH,)),
    ("node_number", np.float64, (2 * WIDTH,)),
    ("node_word_0", np.uint64, (2 * WIDTH,)),
    ("node_word_1", np.uint64, (2 * WIDTH,)),
    ("node_value", np.float64, (2 * WIDTH,)),
    ("nominal_depth", np.float64),  # of the blank [mm]
    ("blank_depth", np.float64),  # what stands above the finished contour [mm]
    ("log_cutting_speed", np.float64),
    ("log_feed", np.float64),
    ("log_depth", np.float64),
    ("log_wear", np.float64),
    ("time_power", np.float64),  # cutting time to the power n of W = K t^n, by clock time
    ("time_power_before", np.float64),  # likewise before the sub-step
    ("wear", np.float64),  # over the criterion, by clock time [-]
    ("chip_remains", np.float64),  # share of force and power that is left of before [-]
    ("worn", np.int64),  # the edge, 0 or 1
    ("broken", np.int64),
    # sensors and observation
    ("word_0", np.uint64),
    ("word_1", np.uint64),
    ("force_noise", np.float64),  # factor of the measured force [-]
    ("predicted_force", np.float64),  # by the nominal model [N]
    ("observation", np.float64, (MAX_ENTRIES, WIDTH)),
)

PARAMETERS = np.dtype(
    [
        ("wear_law", POWER_LAW_RECORD),
        ("force_law", POWER_LAW_RECORD),
        ("power_law", POWER_LAW_RECORD),
        ("wear_rule", np.int64),
        ("wear_criterion", np.float64),
        ("log_wear_criterion", np.float64),
        ("life_exponent", np.float64),  # 1/n of W = K t^n [-]
        ("wear_factor_spread", np.float64),
        ("edge_strength", np.float64),
        ("edge_strength_spread", np.float64),
        ("log_wear_mismatch", np.float64),
        ("initial_used_life", np.float64),
        ("cutting_speed_min", np.float64),
        ("cutting_speed_max", np.float64),
        ("feed_min", np.float64),
        ("feed_max", np.float64),
        ("log_cutting_speed_min", np.float64),
        ("log_cutting_speed_span", np.float64),  # log(max / min)
        ("log_feed_min", np.float64),
        ("log_feed_span", np.float64),
        ("spindle_share", np.float64),  # of the distance to the command that one sub-step covers [-]
        ("feed_share", np.float64),
        ("chip_lag", np.float64),  # [rev]
        ("return_time", np.float64),  # [min]
        ("current_per_newton", np.float64),  # servo current [A/N]
        ("no_load_current", np.float64),  # at rest [A]
        ("no_load_current_rate", np.float64),  # [A min/mm]
        ("current_ripple", np.float64),
        ("ripples_per_path", np.float64),  # [1/mm]
        ("path_end", np.float64),  # of the job, infinite in an endless row [mm]
        ("bar_length", np.float64),
        ("bar_pitch", np.float64),  # bar and approach [mm]
        ("approach", np.float64),
        ("bars_per_path", np.float64),  # [1/mm]
        ("bars_per_cut", np.float64),  # [1/mm]
        ("revolutions_per_metre", np.float64),  # of the bar's circumference [rev/m]
        ("depth_of_cut", np.float64),
        ("log_depth_of_cut", np.float64),
        ("depth_sections", np.int64),
        ("depth_profile", np.float64, (MAX_DEPTHS,)),
        ("depth_ripple", np.float64),
        ("depth_ripples_per_turn", np.float64),  # [1/rev]
        ("depth_bar_spread", np.float64),
        ("depth_along_spread", np.float64),
        ("depth_nodes_per_length", np.float64),
        ("log_hardness_mismatch", np.float64),
        ("skin_thickness", np.float64),
        ("skin_hardness", np.float64),
        ("skin_wear", np.float64),
        ("hardness_bar_spread", np.float64),
        ("hardness_along_spread", np.float64),
        ("hardness_nodes_per_length", np.float64),
        ("sub_steps", np.int64),
        ("sub_step", np.float64),  # [min]
        ("action", np.int64),
        ("edge_changes", np.int64),
        ("change_action", np.int64),  # the place of the action that changes the edge, -1 where there is none
        ("holds_roughness", np.bool_),
        ("override_max", np.float64),
        ("passes_max", np.int64),
        ("cutting_speed_step", np.float64),
        ("feed_step", np.float64),
        ("initial_cutting_speed", np.float64),
        ("initial_feed", np.float64),
        ("step_limit", np.int64),  # intervals after which an episode is truncated
        ("time_limit", np.float64),  # likewise where changing an edge takes time [min]
        ("roughness_at_no_force", np.float64),
        ("roughness_rate", np.float64),
        ("log_reference_min", np.float64),
        ("log_reference_span", np.float64),
        ("reference_time", np.float64),  # [min]
        ("senses_current", np.bool_),
        ("probe", np.bool_),
        ("power_noise", np.float64),
        ("force_noise", np.float64),
        ("power_bias", np.float64),
        ("force_bias", np.float64),
        ("power_sensor_share", np.float64),
        ("force_sensor_share", np.float64),
        ("reference_removal_rate", np.float64),
        ("edge_price", np.float64),  # of a whole edge [s]
        ("breakage_price", np.float64),  # beside the edge [s]
        ("edge_change_time", np.float64),
        ("unplanned_stop", np.float64),
        ("breakage_downtime", np.float64),
        ("overload_price", np.float64),
        ("roughness_price", np.float64),
        ("thrust_force_limit", np.float64),
        ("power_limit", np.float64),
        ("overload_tolerance", np.float64),
    ],
    align=True,
)

# One interval as `info` tells it: true values at the interval's end, and sums over the interval.
REPORT_FIELDS = (
    "cutting_speed",  # [m/min]
    "feed",  # [mm/rev]
    "commanded_cutting_speed",  # [m/min]
    "commanded_feed",  # [mm/rev]
    "spindle_speed",  # [rev/min]
    "feed_velocity",  # [mm/min]
    "torque",  # [N m]
    "path",  # tool position, air and metal [mm]
    "bar",  # bars begun before this one [-]
    "cutting",  # the tool is in metal [0 or 1]
    "depth_of_cut",  # [mm], 0 in air
    "hardness",  # relative to nominal [-], 0 in air
    "cutting_time",  # of the edge [min]
    "used_life",  # of the edge [-]
    "wear",  # [mm]
    "wear_factor",  # of the insert [-]
    "edge_strength",  # of the insert [N]
    "thrust_force",  # [N]
    "power",  # [kW]
    "measured_thrust_force",  # [N], 0 where the servo current is measured instead
    "measured_servo_current",  # [A], 0 where the force is measured
    "measured_power",  # [kW]
    "roughness",  # Ra [um], 0 in air
    "roughness_reference",  # Ra [um], for the next interval; 0 where there is none
    "probed_depth",  # mean allowance of the next blank [mm], 0 where it is not told
    "mean_thrust_force",  # while cutting, this interval; with parts, in the last pass [N]
    "mean_power",  # likewise [kW]
    "time",  # this interval [s]
    "engaged_time",  # cutting, this interval [s]
    "stopped_time",  # changing edges, this interval [s]
    "removed",  # this interval [cm3]
    "passes",  # of parts, this interval [-]
    "edges_used",  # used share of life, and all of an edge that is changed or broken, this interval [-]
    "edges_broken",  # this interval [-]
    "overload_time",  # beyond a limit, this interval [s]
    "severe_overload_time",  # beyond a limit by more than the tolerance, this interval [s]
    "roughness_deviation",  # integral of the relative deviation of Ra while cutting, this interval [s]
    "cost",  # sum of the two below [-]
    "cost_force",  # mean relative excess of thrust force over its limit, this interval [-]
    "cost_power",  # mean relative excess of power over its limit, this interval [-]
    "reward_metal",  # [s]
    "reward_time",  # [s]
    "reward_edge",  # [s]
    "reward_overload",  # [s]
    "reward_breakage",  # [s]
    "reward_roughness",  # [s]
    "broken",  # the edge broke [0 or 1]
    "finished",  # the last bar is done [0 or 1]
)
REPORT_FLAGS = ("cutting", "broken", "finished")
REPORT = block_of(*((name, np.float64) for name in REPORT_FIELDS))


def new_records(dtype: np.dtype[Any], count: int) -> Any:
    """``count`` zeroed records whose fields are attributes, compiled or not."""
    return np.zeros(count, dtype).view(np.recarray)


def action_size(scenario: Scenario) -> int:
    """How many numbers an action has."""
    control = scenario.control
    size = {"incremental": 2, "set_point": 2, "override": 1, "part": 2 + 2 * control.passes_max}[control.action]
    return size + (control.edge_changes == "commanded")


def parameter_records(scenario: Scenario) -> Any:
    """The scenario as the one record that the transition reads (an array of one, as Numba passes arrays faster)."""
    material, tool, machine, workpiece = scenario.material, scenario.tool, scenario.machine, scenario.workpiece
    control, sensors, limits, surface = scenario.control, scenario.sensors, scenario.limits, scenario.surface
    drive, economics, mismatch = scenario.feed_drive, scenario.economics, scenario.mismatch
    sub_step = control.interval / control.sub_steps
    # Where no time passes when an edge is changed, the price of the edge holds that time.
    timeless = control.edge_changes == "end"
    screw = drive.screw_lead / 1000.0 / (2.0 * np.pi * drive.efficiency)  # torque over force [m]
    current_per_newton = screw / (1.5 * drive.pole_pairs * drive.flux_linkage)
    values = {
        "wear_law": material.wear.record(),
        "force_law": material.thrust_force.record(),
        "power_law": material.power.record(),
        "wear_rule": EQUIVALENT_TIME if tool.wear_rule == "equivalent_time" else CLOCK_TIME,
        "log_wear_criterion": np.log(tool.wear_criterion),
        "log_wear_mismatch": np.log(mismatch.wear_factor),
        "log_hardness_mismatch": np.log(mismatch.hardness_factor),
        "initial_used_life": (mismatch.initial_wear / tool.wear_criterion) ** (1.0 / material.wear.time),
        "log_cutting_speed_min": np.log(machine.cutting_speed_min),
        "log_cutting_speed_span": np.log(machine.cutting_speed_max / machine.cutting_speed_min),
        "log_feed_min": np.log(machine.feed_min),
        "log_feed_span": np.log(machine.feed_max / machine.feed_min),
        "spindle_share": lag_share(sub_step, machine.spindle_time_constant),
        "feed_share": lag_share(sub_step, machine.feed_time_constant),
        "current_per_newton": current_per_newton,
        "no_load_current": current_per_newton * (drive.guide_friction + drive.preload * (1.0 - drive.screw_efficiency**2)),
        "current_ripple": drive.ripple,
        "ripples_per_path": drive.ripples_per_turn / drive.screw_lead,
        "life_exponent": 1.0 / material.wear.time,
        "path_end": workpiece.bars * (workpiece.bar_length + workpiece.approach) or np.inf,
        "bar_pitch": workpiece.bar_length + workpiece.approach,
        "bars_per_path": 1.0 / (workpiece.bar_length + workpiece.approach),
        "bars_per_cut": 1.0 / workpiece.bar_length,
        "revolutions_per_metre": 1000.0 / (np.pi * workpiece.diameter),
        "log_depth_of_cut": np.log(workpiece.depth_of_cut),
        "depth_sections": len(workpiece.depth_profile),
        "depth_profile": np.pad(workpiece.depth_profile, (0, MAX_DEPTHS - len(workpiece.depth_profile))),
        "depth_ripples_per_turn": 1.0 / workpiece.depth_ripple_period,
        "depth_nodes_per_length": 1.0 / workpiece.depth_correlation_length,
        "hardness_nodes_per_length": 1.0 / workpiece.hardness_correlation_length,
        "sub_step": sub_step / 60.0,
        "action": ACTIONS[control.action],
        "edge_changes": EDGE_CHANGES[control.edge_changes],
        "change_action": action_size(scenario) - 1 if control.edge_changes == "commanded" else -1,
        "holds_roughness": control.aim == "roughness",
        "step_limit": round(control.time_limit * 60.0 / control.interval),
        "log_reference_min": np.log(surface.reference_min),
        "log_reference_span": np.log(surface.reference_max / surface.reference_min),
        "reference_time": surface.reference_time / 60.0,
        "senses_current": sensors.force == "servo_current",
        "power_sensor_share": lag_share(sub_step, sensors.power_time_constant),
        "force_sensor_share": lag_share(sub_step, sensors.force_time_constant),
        "edge_price": 60.0 * (economics.edge_cost + (economics.edge_change_time if timeless else 0.0)),
        "breakage_price": 60.0 * (economics.breakage_downtime if timeless else 0.0),
        "thrust_force_limit": limits.thrust_force,
        "power_limit": limits.power,
        "overload_tolerance": limits.overload_tolerance,
    }
    for section in (tool, machine, drive, workpiece, control, surface, sensors, mismatch, economics):
        for name in type(section).model_fields:
            if name in (PARAMETERS.names or ()):
                values.setdefault(name, getattr(section, name))
    records = new_records(PARAMETERS, 1)
    for name in PARAMETERS.names or ():
        records[name][0] = values[name]
    return records
