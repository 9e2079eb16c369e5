"""The table of quantities: all that the transition reads, works on, reports and shows, each declared once.

To add a quantity, add a line here and compute it in the file of its phenomenon. Records, resets, ``info``, observations, their
space and the tables of the documentation follow (``records.py``, ``info.py``, ``observation.py``).
"""

from collections import namedtuple
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from turning_env.numerics.functions import log, real_power
from turning_env.physics.drives import lag_share
from turning_env.physics.slender_bar import RIGID, SUPPORTS
from turning_env.physics.spindle import idle_power_at
from turning_env.physics.wear import CLOCK_TIME, EQUIVALENT_TIME
from turning_env.scenario import Scenario
from turning_env.scenario.power_law import POWER_LAW_RECORD
from turning_env.scenario.sections import MAX_DELAY, MAX_DEPTHS, NO_LIMIT

WIDTH = 32
"""Environments of a block. Every quantity of a block is one array over its environments, so that the compiled loops take several
at once; a block's quantities fit the processor's first cache."""

# Numbers for what the compiled transition tells apart, by the words of ``sections.Control``.
INCREMENTAL, SET_POINT, OVERRIDE, PART = range(4)
ACTIONS = {"incremental": INCREMENTAL, "set_point": SET_POINT, "override": OVERRIDE, "part": PART}
END, AUTOMATIC, COMMANDED = range(3)
EDGE_CHANGES = {"end": END, "automatic": AUTOMATIC, "commanded": COMMANDED}

DEVIATION_SCALE = 5.0
"""Observations compare a measurement with its limit or prediction as ``DEVIATION_SCALE * (ratio - 1)``: a few per cent, which a
controller must tell apart near a limit, are then a sizeable part of 1."""
MAX_RATIO = 4.0
MAX_LOG_TIME = 12.0
_LOW, _HIGH = -DEVIATION_SCALE, DEVIATION_SCALE * (MAX_RATIO - 1.0)


class Quantity(NamedTuple):
    """A quantity of a block of environments, or one that is reported."""

    name: str
    unit: str
    meaning: str
    dtype: Any = np.float64
    shape: tuple[int, ...] = (WIDTH,)


class Parameter(NamedTuple):
    """A number that the transition reads: ``value`` of the scenario, or without one the scenario's field of the same name."""

    name: str
    unit: str = ""
    meaning: str = ""
    value: Callable[[Any], Any] | None = None
    dtype: Any = np.float64
    shape: tuple[int, ...] = ()


class Entry(NamedTuple):
    """An entry of an observation, with its lowest and highest values; ``present`` says in which scenarios there is one."""

    name: str
    meaning: str
    low: float
    high: float
    present: Callable[[Scenario], bool] = lambda scenario: True


Q = Quantity

STATE = (
    Q("seed", "-", "determines the episodes", np.uint64),
    Q("episode", "-", "number of the seed's episode", np.uint64),
    Q("step_count", "-", "steps since the episode's start", np.int64),
    Q("ended", "-", "the episode has ended, 0 or 1", np.int64),
    Q("cutting", "-", "the tool is in metal, 0 or 1", np.int64),
    Q("path", "mm", "tool position, air and metal"),
    Q("clock", "min", "machine time since the start"),
    Q("turns", "rev", "turns of the spindle since the start"),
    Q("commanded_cutting_speed", "m/min", "commanded cutting speed"),
    Q("commanded_feed", "mm/rev", "commanded feed"),
    Q("past_cutting_speeds", "m/min", "those before, the last first", np.float64, (MAX_DELAY, WIDTH)),
    Q("past_feeds", "mm/rev", "likewise", np.float64, (MAX_DELAY, WIDTH)),
    Q("cutting_speed", "m/min", "actual cutting speed"),
    Q("feed", "mm/rev", "actual feed"),
    Q("edge", "-", "edges used before this one", np.int64),
    Q("log_wear_factor", "-", "logarithm of the insert's wear over nominal"),
    Q("edge_strength", "N", "thrust force that breaks the edge"),
    Q("cutting_time", "min", "cutting time of the edge"),
    Q("used_life", "-", "used share of the edge's life"),
    Q("nominal_used_life", "-", "the same by the nominal model"),
    Q("bar", "-", "bar at the tool, whole numbers"),
    Q("bar_hardness_normal", "-", "standard normal number of the bar's hardness"),
    Q("bar_depth_normal", "-", "standard normal number of the bar's depth"),
    Q("hardness_cell", "-", "hardness nodes on either side of the tool: this whole number and the next"),
    Q("hardness_left", "-", "value of the node behind"),
    Q("hardness_right", "-", "value of the node ahead"),
    Q("depth_cell", "-", "depth nodes, likewise"),
    Q("depth_left", "-", "value of the node behind"),
    Q("depth_right", "-", "value of the node ahead"),
    Q("log_hardness", "-", "logarithm of the mean hardness of the cut, with its skin"),
    Q("log_skin_wear", "-", "what the skin in the cut adds to the logarithm of wear"),
    Q("depth_of_cut", "mm", "depth of cut"),
    Q("pass_floor", "mm", "a pass cuts what stands higher than this above the finished contour"),
    Q("pass_ceiling", "mm", "and lower than this, as the passes before it have cut the rest"),
    Q("log_nominal_depth", "-", "logarithm of the pass's depth [mm] in the nominal model"),
    Q("thrust_force", "N", "thrust force"),
    Q("power", "kW", "cutting power"),
    Q("spindle_heat", "-", "heating of the spindle's motor over that of its rated load"),
    Q("lagged_thrust_force", "N", "thrust force behind the sensor's lag"),
    Q("lagged_power", "kW", "power behind the sensor's lag"),
    Q("measured_thrust_force", "N", "measured thrust force"),
    Q("measured_servo_current", "A", "measured servo current"),
    Q("measured_power", "kW", "measured power"),
    Q("probed_depth", "mm", "mean depth of what is to be cut of the next bar"),
    Q("removed_wear", "mm", "flank wear of the edge that was taken out last, 0 before the first"),
    Q("roughness_reference", "um", "reference of Ra"),
    Q("chipping_margin", "-", "integral of the chipping hazard that the edge still bears"),
    Q("tangle_margin", "-", "likewise until chips tangle"),
    Q("tangles", "-", "times that chips have tangled", np.int64),
)
"""What an environment keeps from step to step."""

WORK = (
    Q("action", "-", "speed and feed of the action, clipped", np.float64, (2, WIDTH)),
    Q("sub_step", "min", "length of a sub-step"),
    Q("sub_steps_left", "-", "sub-steps left in the step or pass", np.int64),
    Q("sub_steps_held", "-", "sub-steps until the drives follow the next command"),
    Q("held_cutting_speed", "m/min", "command that the drives follow until then"),
    Q("held_feed", "mm/rev", "likewise"),
    Q("next_cutting_speed", "m/min", "command that they follow from then on"),
    Q("next_feed", "mm/rev", "likewise"),
    Q("time", "min", "time since clock and life were last brought up to date"),
    Q("used_life_before", "-", "used life at the beginning of that time"),
    Q("cutting_time_before", "min", "cutting time at the beginning of that time"),
    Q("minutes", "min", "time of the step at work"),
    Q("ended_before", "-", "the episode had ended before the step, 0 or 1", np.int64),
    Q("edge_failed", "-", "an edge was worn out or broken in the step, 0 or 1", np.int64),
    Q("passes", "-", "passes of the part", np.int64),
    Q("pass_depth", "mm", "depth of a pass"),
    Q("part_start", "mm", "path at which the part begins"),
    Q("engaged_before", "s", "cutting time of the part before the pass"),
    Q("running", "-", "the environment takes part in the sub-step, 0 or 1", np.int64),
    Q("turns", "rev", "turns of the spindle in the sub-step"),
    Q("cut", "mm", "metal behind the tool at the sub-step's end"),
    Q("middle", "mm", "likewise in the middle of what was cut"),
    Q("engaged", "min", "time in metal in the sub-step"),
    Q("along", "mm", "place of the middle along the bar"),
    Q("passing", "-", "a node or a bar's beginning was passed, 0 or 1", np.int64),
    Q("node_env", "-", "environments whose nodes are to be drawn", np.int64, (2 * WIDTH,)),
    Q("node_channel", "-", "channel of the node", np.uint64, (2 * WIDTH,)),
    Q("node_number", "-", "number of the node", np.float64, (2 * WIDTH,)),
    Q("node_word_0", "-", "random word of the node", np.uint64, (2 * WIDTH,)),
    Q("node_word_1", "-", "random word of the node", np.uint64, (2 * WIDTH,)),
    Q("node_value", "-", "value of the node", np.float64, (2 * WIDTH,)),
    Q("nominal_depth", "mm", "nominal depth of the blank"),
    Q("blank_depth", "mm", "what stands above the finished contour"),
    Q("log_cutting_speed", "-", "logarithm of the cutting speed [m/min]"),
    Q("log_feed", "-", "logarithm of the feed [mm/rev]"),
    Q("log_depth", "-", "logarithm of the depth of cut [mm]"),
    Q("log_wear", "-", "logarithm of the flank wear [mm]"),
    Q("time_power", "-", "cutting time to the power n of W = K t^n, by clock time"),
    Q("time_power_before", "-", "likewise before the sub-step"),
    Q("wear", "-", "wear over the criterion, by clock time"),
    Q("chip_remains", "-", "share of force and power that is left of before"),
    Q("over_further", "-", "largest excess over a further limit, relative"),
    Q("worn", "-", "the edge is worn out, 0 or 1", np.int64),
    Q("broken", "-", "the edge is broken, 0 or 1", np.int64),
    Q("word_0", "-", "random word of the sensors", np.uint64),
    Q("word_1", "-", "random word of the sensors", np.uint64),
    Q("force_noise", "-", "factor of the measured force"),
    Q("predicted_force", "N", "thrust force by the nominal model"),
    Q("cut_stiffness", "N/mm", "thrust force over depth of cut, in the sub-step before"),
    Q("life_before", "-", "used life before the sub-step"),
    Q("tangles", "-", "times that chips have tangled in the step", np.int64),
)
"""Scratch of a step: what is noted while a block is worked on. Nothing here lasts longer than a step."""

AT_END = (
    Q("cutting_speed", "m/min", "actual cutting speed"),
    Q("feed", "mm/rev", "actual feed"),
    Q("commanded_cutting_speed", "m/min", "commanded cutting speed"),
    Q("commanded_feed", "mm/rev", "commanded feed"),
    Q("spindle_speed", "rev/min", "spindle speed"),
    Q("feed_velocity", "mm/min", "feed velocity"),
    Q("torque", "N m", "spindle torque"),
    Q("path", "mm", "tool position, air and metal"),
    Q("bar", "-", "bars begun before this one"),
    Q("cutting", "bool", "the tool is in metal", np.bool_),
    Q("depth_of_cut", "mm", "depth of cut, 0 in air"),
    Q("hardness", "-", "hardness over nominal, 0 in air"),
    Q("cutting_time", "min", "cutting time of the edge"),
    Q("used_life", "-", "used share of the edge's life"),
    Q("wear", "mm", "flank wear"),
    Q("wear_factor", "-", "wear of the insert over nominal"),
    Q("edge_strength", "N", "thrust force that breaks the insert"),
    Q("thrust_force", "N", "thrust force"),
    Q("power", "kW", "spindle power"),
    Q("measured_thrust_force", "N", "measured thrust force, 0 if the servo current is measured instead"),
    Q("measured_servo_current", "A", "measured servo current, 0 if the force is measured"),
    Q("measured_power", "kW", "measured power"),
    Q("spindle_load", "-", "spindle power over rated power, or torque over available torque (`spindle.reading`)"),
    Q("spindle_heat", "-", "heating of the spindle's motor over that of its rated load, 0 without short-time overload"),
    Q("roughness", "um", "Ra, 0 in air and in scenarios without a reference"),
    Q("roughness_reference", "um", "reference of Ra for the next step, 0 if there is none"),
    Q("probed_depth", "mm", "mean allowance of the next blank, 0 if it is not probed"),
)
"""What ``info`` tells of the end of a step: true values."""

OVER_STEP = (
    Q("mean_thrust_force", "N", "mean while cutting; with parts, in the last pass"),
    Q("mean_power", "kW", "mean while cutting; with parts, in the last pass"),
    Q("time", "s", "machine time"),
    Q("engaged_time", "s", "time in metal"),
    Q("stopped_time", "s", "time to change edges and to clear chips"),
    Q("removed", "cm3", "removed metal"),
    Q("passes", "-", "passes of parts"),
    Q("edges_used", "-", "used share of life, and all of an edge that is changed or broken"),
    Q("edges_broken", "-", "broken edges"),
    Q("overload_time", "s", "time beyond a limit"),
    Q("severe_overload_time", "s", "time beyond a limit by more than the tolerance"),
    Q("roughness_deviation", "s", "integral of the relative deviation of Ra, which is 1 in air"),
    Q("cost", "-", "cost_force + cost_power; above 0 means violated"),
    Q("cost_force", "-", "mean relative excess of thrust force, or of a further limit's response, over its limit"),
    Q("cost_power", "-", "mean relative excess of power over its limit"),
    Q("reward_metal", "s", "reward for removed metal"),
    Q("reward_time", "s", "reward for machine time"),
    Q("reward_edge", "s", "reward for used life"),
    Q("reward_overload", "s", "reward for overload"),
    Q("reward_breakage", "s", "reward for breakage"),
    Q("reward_roughness", "s", "reward for the deviation of Ra"),
    Q("broken", "bool", "an edge broke", np.bool_),
    Q("finished", "bool", "the last bar is done", np.bool_),
)
"""What ``info`` tells of a step as a whole. Every step starts with 0 for all of these, and for ``OUTCOME``."""

OUTCOME = (
    Q("reward", "s", "sum of the reward's terms"),
    Q("terminated", "bool", "the episode has ended", np.bool_),
    Q("truncated", "bool", "the episode has run out of time", np.bool_),
)
"""What ``step`` returns beside the observation and ``info``."""

INFO = AT_END + OVER_STEP
REPORT = INFO + OUTCOME

OBSERVATION = (
    Entry("power", "measured power: `5 * (power / limit - 1)`", _LOW, _HIGH),
    Entry("thrust_force", "measured thrust force: `5 * (force / limit - 1)`", _LOW, _HIGH),
    Entry("cutting_speed", "actual cutting speed, log scale, -1 lowest, 1 highest", -1.0, 1.0),
    Entry("feed", "actual feed, log scale, -1 lowest, 1 highest", -1.0, 1.0),
    Entry("commanded_cutting_speed", "commanded cutting speed, likewise", -1.0, 1.0),
    Entry("commanded_feed", "commanded feed, likewise", -1.0, 1.0),
    Entry("cutting_time", "log(1 + cutting time of the edge in min)", 0.0, MAX_LOG_TIME),
    Entry("nominal_wear", "wear predicted by the nominal model over the criterion", 0.0, MAX_RATIO),
    Entry("power_ratio", "measured power: `5 * (power / predicted power - 1)`", _LOW, _HIGH),
    Entry("force_ratio", "measured thrust force: `5 * (force / predicted force - 1)`", _LOW, _HIGH),
    Entry("cutting", "1 in metal, 0 in air", 0.0, 1.0),
    Entry(
        "spindle_heat",
        "heating of the spindle's motor over that of its rated load",
        0.0,
        MAX_RATIO,
        lambda scenario: scenario.spindle.short_time_load > 1.0,
    ),
    Entry(
        "roughness_reference",
        "reference of Ra, log scale, -1 lowest, 1 highest",
        -1.0,
        1.0,
        lambda scenario: scenario.control.aim == "roughness",
    ),
    Entry(
        "probed_depth",
        "mean allowance of the next blank: `5 * (allowance / drawing's allowance - 1)`",
        _LOW,
        _HIGH,
        lambda scenario: scenario.sensors.probe,
    ),
    Entry(
        "removed_wear",
        "measured wear of the edge that was taken out last over the criterion, 0 before the first change",
        0.0,
        MAX_RATIO,
        lambda scenario: scenario.sensors.inspects_edges,
    ),
)
"""What a policy sees, in order. Entries that only some scenarios have come last."""

_NAMES = [entry.name for entry in OBSERVATION]
OBS: Any = namedtuple("OBS", _NAMES)(*range(len(_NAMES)))
"""Places of entries, in compiled code and in columns of observations: ``OBS.power``. ``layout(scenario)`` tells where
observations have those entries that only some scenarios have."""


def layout(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the entries of a scenario's observations, in order."""
    return tuple(entry.name for entry in OBSERVATION if entry.present(scenario))


def action_size(scenario: Scenario) -> int:
    """Return how many numbers an action has."""
    control = scenario.control
    size = {"incremental": 2, "set_point": 2, "override": 1, "part": 2 + 2 * control.passes_max}[control.action]
    return size + (control.edge_changes == "commanded")


def _layout_numbers(s: Scenario) -> list[int]:
    places = [_NAMES.index(name) for name in layout(s)]
    return places + [0] * (len(OBSERVATION) - len(places))


def _sub_step(s: Scenario) -> float:
    """Return the length of a sub-step [s]."""
    return s.control.interval / s.control.sub_steps


def _current_per_newton(s: Scenario) -> float:
    drive = s.feed_drive
    screw = drive.screw_lead / 1000.0 / (2.0 * np.pi * drive.efficiency)  # torque over force [m]
    return screw / (1.5 * drive.pole_pairs * drive.flux_linkage)


def _no_load_current(s: Scenario) -> float:
    drive = s.feed_drive
    return _current_per_newton(s) * (drive.guide_friction + drive.preload * (1.0 - drive.screw_efficiency**2))


def _bar_pitch(s: Scenario) -> float:
    return s.workpiece.bar_length + s.workpiece.approach


def _bar_flexibility(s: Scenario) -> float:
    moment = np.pi * s.workpiece.diameter**4 / 64.0  # second moment of area [mm4]
    return 1.0 / (3.0 * s.workpiece.elastic_modulus * moment)


def _unless_zero(value: Any) -> Any:
    """Return a value that means "none" if it is 0: then infinity. Scalar or array."""
    return np.where(np.equal(value, 0.0), np.inf, value)


def _section_starts(s: Scenario) -> Any:
    lengths = s.workpiece.section_lengths
    return _per_section(np.cumsum((0.0, *lengths))[:-1])


def _per_section(values: Any) -> Any:
    """Return the sections' values, followed by zeros up to ``MAX_DEPTHS``."""
    return np.pad(values, (0, MAX_DEPTHS - len(values)))


def _timeless(s: Scenario) -> bool:
    """Return whether changing an edge takes no time, and its price holds that time."""
    return s.control.edge_changes == "end"


def further_limits(s: Scenario) -> list[tuple[float, float, float, float]]:
    """Return the log response over limit at f = d = H = 1, and the exponents of f, d and H, of each further limit."""
    laws = [law for law in (s.limits.radial_force, s.limits.torque, s.limits.roughness) if np.any(law.coefficient > NO_LIMIT)]
    return [(law.log_coefficient - log(law.most), law.feed, law.depth_of_cut, law.hardness) for law in laws]


def _same(*names: str, dtype: Any = np.float64) -> tuple[Parameter, ...]:
    """Return parameters that are fields of the scenario."""
    return tuple(Parameter(name, dtype=dtype) for name in names)


P = Parameter

PARAMETERS = (
    P("wear_law", "mm", "wear of a fresh edge", lambda s: s.material.wear, POWER_LAW_RECORD),
    P("force_law", "N", "thrust force", lambda s: s.material.thrust_force, POWER_LAW_RECORD),
    P("power_law", "kW", "power", lambda s: s.material.power, POWER_LAW_RECORD),
    P(
        "wear_rule",
        "-",
        "how wear accumulates",
        lambda s: EQUIVALENT_TIME if s.tool.wear_rule == "equivalent_time" else CLOCK_TIME,
        np.int64,
    ),
    P("log_wear_criterion", "-", "logarithm of the criterion [mm]", lambda s: log(s.tool.wear_criterion)),
    P("life_exponent", "-", "1/n of W = K t^n", lambda s: 1.0 / s.material.wear.time),
    P("log_wear_mismatch", "-", "logarithm of the inserts' mean wear over nominal", lambda s: log(s.mismatch.wear_factor)),
    P(
        "initial_used_life",
        "-",
        "used life of a new edge",
        lambda s: real_power(s.mismatch.initial_wear / s.tool.wear_criterion, 1.0 / s.material.wear.time),
    ),
    *_same("wear_criterion", "wear_factor_spread", "edge_strength", "edge_strength_spread"),
    *_same("cutting_speed_min", "cutting_speed_max", "feed_min", "feed_max", "chip_lag", "return_time"),
    P("log_cutting_speed_min", "-", "logarithm of the lowest speed", lambda s: log(s.machine.cutting_speed_min)),
    P(
        "cutting_speed_scale",
        "-",
        "2 / log(highest / lowest speed)",
        lambda s: 2.0 / log(s.machine.cutting_speed_max / s.machine.cutting_speed_min),
    ),
    P("log_feed_min", "-", "logarithm of the lowest feed", lambda s: log(s.machine.feed_min)),
    P("feed_scale", "-", "2 / log(highest / lowest feed)", lambda s: 2.0 / log(s.machine.feed_max / s.machine.feed_min)),
    P(
        "spindle_share",
        "-",
        "share of the distance to the command that a sub-step covers",
        lambda s: lag_share(_sub_step(s), s.machine.spindle_time_constant),
    ),
    P("feed_share", "-", "likewise of the feed", lambda s: lag_share(_sub_step(s), s.machine.feed_time_constant)),
    P("delays_commands", "-", "commands act late", lambda s: bool(np.any(s.machine.command_delay > 0)), np.bool_),
    P("steps_late", "-", "steps by which commands act late", lambda s: s.machine.command_delay / s.control.interval),
    P("reachable_cutting_speed", "m/min", "highest cutting speed at the diameter", lambda s: s.cutting_speed_max),
    P(
        "idle_power_per_speed",
        "kW min/m",
        "idle power over cutting speed",
        lambda s: idle_power_at(s, 1.0),
    ),
    P(
        "capacity_per_speed",
        "min/m",
        "available over rated power, per cutting speed, below the base speed",
        lambda s: 1.0 / s.base_cutting_speed if np.all(s.base_cutting_speed) else np.inf,
    ),
    P("heats", "-", "a cold motor may be overloaded", lambda s: s.spindle.short_time_load > 1, np.bool_),
    P("reads_torque", "-", "the load is a share of torque", lambda s: s.spindle.reading == "torque", np.bool_),
    *_same("rated_power", "short_time_load", "thermal_time_constant"),
    P("current_per_newton", "A/N", "servo current over force", _current_per_newton),
    P("no_load_current", "A", "servo current without force, at rest", _no_load_current),
    *_same("no_load_current_rate"),
    P("current_ripple", "-", "amplitude of the current's ripple", lambda s: s.feed_drive.ripple),
    P("ripples_per_path", "1/mm", "waves of the ripple", lambda s: s.feed_drive.ripples_per_turn / s.feed_drive.screw_lead),
    P(
        "path_end",
        "mm",
        "end of the job, infinite in an endless row",
        lambda s: s.workpiece.bars * _bar_pitch(s) if s.workpiece.bars else np.inf,
    ),
    P("bar_pitch", "mm", "bar and approach", _bar_pitch),
    P("bars_per_path", "1/mm", "bars per path", lambda s: 1.0 / _bar_pitch(s)),
    P("bars_per_cut", "1/mm", "bars per metal", lambda s: 1.0 / s.workpiece.bar_length),
    P("revolutions_per_metre", "rev/m", "of the bar's circumference", lambda s: 1000.0 / (np.pi * s.workpiece.diameter)),
    P("log_depth_of_cut", "-", "logarithm of the nominal depth [mm]", lambda s: log(s.workpiece.depth_of_cut)),
    P("depth_sections", "-", "sections of different depth", lambda s: len(s.workpiece.depth_profile), np.int64),
    P(
        "depth_profile",
        "mm",
        "nominal depths of the sections",
        lambda s: _per_section(s.workpiece.depth_profile),
        np.float64,
        (MAX_DEPTHS,),
    ),
    P("section_starts", "mm", "where sections of given lengths start", _section_starts, np.float64, (MAX_DEPTHS,)),
    P("has_section_lengths", "-", "the sections' lengths are given", lambda s: bool(s.workpiece.section_lengths), np.bool_),
    P(
        "section_speeds",
        "m/min",
        "highest cutting speeds of the sections",
        lambda s: _per_section(s.workpiece.section_speeds),
        np.float64,
        (MAX_DEPTHS,),
    ),
    P("has_section_speeds", "-", "the sections limit the cutting speed", lambda s: bool(s.workpiece.section_speeds), np.bool_),
    *_same("bar_length", "approach", "depth_of_cut", "depth_ripple", "depth_bar_spread", "depth_along_spread"),
    P("ripples", "-", "the depth ripples", lambda s: s.workpiece.depth_ripple > 0, np.bool_),
    P("has_skin", "-", "blanks have a skin", lambda s: s.mismatch.skin_thickness > 0, np.bool_),
    P("chips_lag", "-", "force and power lag behind the chip", lambda s: s.machine.chip_lag > 0, np.bool_),
    P("depth_ripples_per_turn", "1/rev", "waves of the depth's ripple", lambda s: 1.0 / s.workpiece.depth_ripple_period),
    P("depth_nodes_per_length", "1/mm", "nodes of depth", lambda s: 1.0 / s.workpiece.depth_correlation_length),
    P("hardness_nodes_per_length", "1/mm", "nodes of hardness", lambda s: 1.0 / s.workpiece.hardness_correlation_length),
    P("log_hardness_mismatch", "-", "logarithm of the mean hardness over nominal", lambda s: log(s.mismatch.hardness_factor)),
    *_same("skin_thickness", "skin_hardness", "skin_wear", "hardness_bar_spread", "hardness_along_spread"),
    P("sub_step", "min", "length of a sub-step", lambda s: _sub_step(s) / 60.0),
    P("action", "-", "what an action names", lambda s: ACTIONS[s.control.action], np.int64),
    P("edge_changes", "-", "what follows on an edge's end", lambda s: EDGE_CHANGES[s.control.edge_changes], np.int64),
    P(
        "change_action",
        "-",
        "place of the action that changes the edge, -1 if there is none",
        lambda s: action_size(s) - 1 if s.control.edge_changes == "commanded" else -1,
        np.int64,
    ),
    P("entries", "-", "entries of the observation", lambda s: len(layout(s)), np.int64),
    P("observation_layout", "-", "places of the observation's entries", _layout_numbers, np.int64, (len(OBSERVATION),)),
    P("holds_roughness", "-", "a roughness is to be held", lambda s: s.control.aim == "roughness", np.bool_),
    *_same("sub_steps", "passes_max", dtype=np.int64),
    *_same("override_max", "cutting_speed_step", "feed_step", "initial_cutting_speed", "initial_feed", "time_limit"),
    P(
        "step_limit",
        "-",
        "steps after which an episode that ends with its edge is truncated",
        lambda s: round(s.control.time_limit * 60.0 / s.control.interval) if _timeless(s) else 0,
        np.int64,
    ),
    *_same("roughness_at_no_force", "roughness_rate"),
    P("log_reference_min", "-", "logarithm of the lowest reference [um]", lambda s: log(s.surface.reference_min)),
    P(
        "log_reference_span",
        "-",
        "log(highest / lowest reference)",
        lambda s: log(s.surface.reference_max / s.surface.reference_min),
    ),
    P("reference_time", "min", "time after which the reference changes", lambda s: s.surface.reference_time / 60.0),
    P("senses_current", "-", "the servo current is measured", lambda s: s.sensors.force == "servo_current", np.bool_),
    *_same("probe", "inspects_edges", dtype=np.bool_),
    *_same("power_noise", "force_noise", "power_bias", "force_bias"),
    P("power_sensor_share", "-", "as spindle_share", lambda s: lag_share(_sub_step(s), s.sensors.power_time_constant)),
    P("force_sensor_share", "-", "as spindle_share", lambda s: lag_share(_sub_step(s), s.sensors.force_time_constant)),
    *_same("reference_removal_rate", "edge_change_time", "unplanned_stop", "breakage_downtime"),
    *_same("overload_price", "roughness_price", "overload_tolerance"),
    P(
        "edge_price",
        "s",
        "price of a whole edge",
        lambda s: 60.0 * (s.economics.edge_cost + (s.economics.edge_change_time if _timeless(s) else 0.0)),
    ),
    P(
        "breakage_price",
        "s",
        "price of breakage beside the edge",
        lambda s: 60.0 * (s.economics.breakage_downtime if _timeless(s) else 0.0),
    ),
    P("clock_limit", "min", "machine time that stops end at", lambda s: np.inf if _timeless(s) else s.control.time_limit),
    P("collapses", "-", "edges collapse", lambda s: s.edge_failure.collapse_temperature > 0.0, np.bool_),
    P("temperature_law", "K", "temperature of the edge", lambda s: s.edge_failure.temperature, POWER_LAW_RECORD),
    P(
        "log_collapse_temperature",
        "-",
        "logarithm of the temperature [K] that an edge bears",
        lambda s: log(_unless_zero(s.edge_failure.collapse_temperature)),
    ),
    P("wears_faster", "-", "there is tertiary wear", lambda s: s.edge_failure.tertiary_rate > 0.0, np.bool_),
    P("edges_chip", "-", "edges chip", lambda s: s.edge_failure.chipping_rate > 0.0, np.bool_),
    *_same("tertiary_wear", "tertiary_rate", "chipping_rate", "chipping_load_exponent", "chipping_wear_exponent"),
    P("chips_tangle", "-", "chips tangle", lambda s: s.swarf.tangle_rate > 0.0, np.bool_),
    *_same("chip_feed_min", "chip_feed_max", "chip_depth_min", "chip_depth_max", "tangle_rate", "tangle_time"),
    P("support", "-", "how the bar is held", lambda s: SUPPORTS[s.workpiece.support], np.int64),
    P("bends", "-", "the bar bends", lambda s: SUPPORTS[s.workpiece.support] != RIGID, np.bool_),
    P("bar_flexibility", "1/(N mm2)", "1 / (3 E I)", _bar_flexibility),
    *_same("radial_share"),
    P("thrust_force_limit", "N", "highest allowed thrust force", lambda s: s.limits.thrust_force),
    P("power_limit", "kW", "highest allowed power", lambda s: s.limits.power),
    P("per_thrust_force_limit", "1/N", "1 / thrust_force_limit", lambda s: 1.0 / s.limits.thrust_force),
    P("per_power_limit", "1/kW", "1 / power_limit", lambda s: 1.0 / s.limits.power),
    P("further_limits", "-", "how many further limits there are", lambda s: len(further_limits(s)), np.int64),
    P(
        "further_laws",
        "-",
        "log response over limit of each: at f = d = H = 1, exponents of f, d and H",
        lambda s: np.array((*further_limits(s), *[(0.0, 0.0, 0.0, 0.0)] * 3)[:3]),
        np.float64,
        (3, 4),
    ),
)
"""What the transition reads of a scenario."""

NOMINAL = (
    *("wear_law", "force_law", "power_law", "log_wear_criterion", "life_exponent"),
    *("current_per_newton", "no_load_current", "no_load_current_rate", "idle_power_per_speed"),
)
"""Parameters that the control's predictions read of the nominal model: ``parameters.nominal.force_law``."""


def quantity_table(quantities: Iterable[Quantity]) -> str:
    """Return a Markdown table of quantities: name, unit, meaning."""
    return _markdown(("Name", "Unit", "Meaning"), [(f"`{q.name}`", q.unit, q.meaning) for q in quantities])


def observation_table(names: Iterable[str]) -> str:
    """Return a Markdown table of an observation's entries: place, name, meaning, range."""
    entries = [OBSERVATION[_NAMES.index(name)] for name in names]
    rows = [(str(i), e.name, e.meaning, f"{e.low:g} to {e.high:g}") for i, e in enumerate(entries)]
    return _markdown(("Index", "Entry", "Meaning", "Range"), rows)


def _markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(cell) for cell in column) for column in zip(header, *rows, strict=True)]
    rule = ["-" * width for width in widths]
    lines = [[cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in (header, rule, *rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
