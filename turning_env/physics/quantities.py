"""The table of quantities: all that the transition works on, reports and shows, each declared once.

To add a quantity, add a line here and compute it in the file of its phenomenon. Records, resets,
``info``, observations, their space and the tables of the documentation follow (``records.py``,
``info.py``, ``observation.py``, ``docs/site.py``).
"""

from collections import namedtuple
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from turning_env.scenario import Scenario, ScenarioBatch
from turning_env.scenario.sections import MAX_DELAY

WIDTH = 32
"""Environments of a block, whose quantities are arrays over them. So many fit the processor's
first cache."""

# Numbers for what the compiled transition tells apart, by the words of ``sections.Control``.
INCREMENTAL, SET_POINT, OVERRIDE, PART = range(4)
ACTIONS = {"incremental": INCREMENTAL, "set_point": SET_POINT, "override": OVERRIDE, "part": PART}
END, AUTOMATIC, COMMANDED = range(3)
EDGE_CHANGES = {"end": END, "automatic": AUTOMATIC, "commanded": COMMANDED}

DEVIATION_SCALE = 5.0
"""Scale of observed ratios - 1. A controller must tell a few per cent apart, so they are made a
sizeable part of 1."""
MAX_RATIO = 4.0
MAX_LOG_TIME = 12.0
_LOW = -DEVIATION_SCALE
_HIGH = DEVIATION_SCALE * (MAX_RATIO - 1.0)


class Quantity(NamedTuple):
    """A quantity of a block of environments, or one that is reported."""

    name: str
    unit: str
    meaning: str
    dtype: Any = np.float64
    shape: tuple[int, ...] = (WIDTH,)


class Entry(NamedTuple):
    """An entry of an observation, with its lowest and highest values.

    ``present`` says whether a scenario's observations have it.
    """

    name: str
    meaning: str
    low: float
    high: float
    present: Callable[[Scenario | ScenarioBatch], bool] = lambda scenario: True


def _observes_all(scenario: Scenario | ScenarioBatch) -> bool:
    """Return whether a scenario's observations hold the hidden state."""
    return bool(scenario.sensors.observes_all)


Q = Quantity

STATE = (
    # The episode.
    Q("seed", "-", "determines the episodes", dtype=np.uint64),
    Q("episode", "-", "number of the seed's episode", dtype=np.uint64),
    Q("step_count", "-", "steps since the episode's start", dtype=np.int64),
    Q("ended", "-", "the episode has ended, 0 or 1", dtype=np.int64),
    Q("cutting", "-", "the tool is in metal, 0 or 1", dtype=np.int64),
    Q("path", "mm", "tool position, air and metal"),
    Q("clock", "min", "machine time since the start; within a step, add the scratch's time"),
    Q("turns", "rev", "turns of the spindle since the start"),
    # Commands and drives.
    Q("commanded_cutting_speed", "m/min", "commanded cutting speed"),
    Q("commanded_feed", "mm/rev", "commanded feed"),
    Q(
        "past_cutting_speeds",
        "m/min",
        "commanded cutting speeds of the steps before, the last first",
        shape=(MAX_DELAY, WIDTH),
    ),
    Q("past_feeds", "mm/rev", "commanded feeds, likewise", shape=(MAX_DELAY, WIDTH)),
    Q("cutting_speed", "m/min", "actual cutting speed"),
    Q("feed", "mm/rev", "actual feed"),
    # The edge.
    Q("edge", "-", "edges used before this one", dtype=np.int64),
    Q("log_wear_factor", "-", "logarithm of the insert's wear over nominal"),
    Q("edge_strength", "N", "thrust force that breaks the edge"),
    Q("cutting_time", "min", "cutting time of the edge"),
    Q("used_life", "-", "used share of the edge's life"),
    Q("nominal_used_life", "-", "used share of the edge's life by the nominal model"),
    # The bar, and the nodes of its fields on either side of the tool.
    Q("bar", "-", "bar at the tool, whole numbers"),
    Q("bar_hardness_normal", "-", "standard normal number of the bar's hardness"),
    Q("bar_depth_normal", "-", "standard normal number of the bar's depth"),
    Q(
        "hardness_cell",
        "-",
        "hardness nodes on either side of the tool: this whole number and the next",
    ),
    Q("hardness_left", "-", "value of the node behind"),
    Q("hardness_right", "-", "value of the node ahead"),
    Q("depth_cell", "-", "depth nodes, likewise"),
    Q("depth_left", "-", "value of the node behind"),
    Q("depth_right", "-", "value of the node ahead"),
    # The cut.
    Q("log_hardness", "-", "logarithm of the mean hardness of the cut, with its skin"),
    Q("log_skin_wear", "-", "change of the logarithm of wear by the skin in the cut"),
    Q("depth_of_cut", "mm", "depth of cut"),
    Q("pass_floor", "mm", "height above the finished contour from which the pass cuts"),
    Q("pass_ceiling", "mm", "height to which the pass cuts; the passes before have cut the rest"),
    Q("log_nominal_depth", "-", "logarithm of the pass's depth [mm] in the nominal model"),
    Q("thrust_force", "N", "thrust force"),
    Q("power", "kW", "cutting power"),
    Q(
        "spindle_heat",
        "-",
        "heating of the spindle's motor over that of its rated load, 0 without short-time overload",
    ),
    # Sensors.
    Q("lagged_thrust_force", "N", "thrust force behind the sensor's lag"),
    Q("lagged_power", "kW", "power behind the sensor's lag"),
    Q(
        "measured_thrust_force",
        "N",
        "measured thrust force, 0 if the servo current is measured instead",
    ),
    Q("measured_servo_current", "A", "measured servo current, 0 if the force is measured"),
    Q("measured_power", "kW", "measured power"),
    Q("probed_depth", "mm", "mean allowance of the next blank, 0 if it is not probed"),
    Q("removed_wear", "mm", "flank wear of the edge that was taken out last, 0 before the first"),
    Q("roughness_reference", "um", "reference of Ra for the next step, 0 if there is none"),
    # Failures.
    Q("chipping_margin", "-", "integral of the chipping hazard that is left until the edge chips"),
    Q("tangle_margin", "-", "integral of the tangling rate that is left until chips tangle"),
    Q("tangles", "-", "times that chips have tangled", dtype=np.int64),
)
"""State: the quantities that an environment keeps from step to step."""

WORK = (
    Q("action", "-", "speed and feed of the action, clipped", shape=(2, WIDTH)),
    Q("sub_step", "min", "length of a sub-step"),
    Q("sub_steps_left", "-", "sub-steps left in the step or pass", dtype=np.int64),
    Q("target_cutting_speed", "m/min", "command that the spindle follows, which may be a late one"),
    Q("target_feed", "mm/rev", "command that the feed servo follows, likewise"),
    # Charging of time and life since the step's start or an edge's change.
    Q("time", "min", "time since clock and life were last brought up to date"),
    Q("used_life_before", "-", "used life at the beginning of that time"),
    Q("cutting_time_before", "min", "cutting time at the beginning of that time"),
    Q("minutes", "min", "time of the step at work"),
    Q("ended_before", "-", "the episode had ended before the step, 0 or 1", dtype=np.int64),
    Q("edge_failed", "-", "an edge was worn out or broken in the step, 0 or 1", dtype=np.int64),
    # Parts.
    Q("passes", "-", "passes of the part", dtype=np.int64),
    Q("pass_depth", "mm", "depth of a pass"),
    Q("part_start", "mm", "path at which the part begins"),
    Q("engaged_before", "s", "cutting time of the part before the pass"),
    Q(
        "turns",
        "rev",
        "turns of the spindle in the sub-step, 0 if the environment does not take part",
    ),
    Q("cut", "mm", "metal behind the tool at the sub-step's end"),
    Q("middle", "mm", "metal behind the middle of the sub-step's cut"),
    Q("engaged", "min", "time in metal in the sub-step"),
    # The bar at the tool, and the list of nodes to draw.
    Q("along", "mm", "place of the middle along the bar"),
    Q("passing", "-", "a node or a bar's beginning was passed, 0 or 1", dtype=np.int64),
    Q(
        "node_env",
        "-",
        "environments whose nodes are to be drawn",
        dtype=np.int64,
        shape=(2 * WIDTH,),
    ),
    Q("node_channel", "-", "channel of the node", dtype=np.uint64, shape=(2 * WIDTH,)),
    Q("node_number", "-", "number of the node", shape=(2 * WIDTH,)),
    Q(
        "word_0",
        "-",
        "random word of the node, or of the sensors",
        dtype=np.uint64,
        shape=(2 * WIDTH,),
    ),
    Q("word_1", "-", "another random word of the same", dtype=np.uint64, shape=(2 * WIDTH,)),
    Q("node_value", "-", "value of the node", shape=(2 * WIDTH,)),
    Q("nominal_depth", "mm", "nominal depth of the blank"),
    Q("blank_depth", "mm", "height of the blank above the finished contour"),
    # Factors of the laws, and what follows from them.
    Q("log_cutting_speed", "-", "logarithm of the cutting speed [m/min]"),
    Q("log_feed", "-", "logarithm of the feed [mm/rev]"),
    Q("log_depth", "-", "logarithm of the depth of cut [mm]"),
    Q("log_wear", "-", "logarithm of the flank wear [mm]"),
    Q("chip_remains", "-", "share of force and power that is left of before"),
    Q("over_further", "-", "largest excess over a further limit, relative"),
    Q("worn", "-", "the edge is worn out, 0 or 1", dtype=np.int64),
    Q("broken", "-", "the edge is broken, 0 or 1", dtype=np.int64),
    Q("force_noise", "-", "factor of the measured force"),
    Q("predicted_force", "N", "thrust force by the nominal model"),
    Q("chatter", "-", "dynamic over static thrust force"),
    Q("cut_stiffness", "N/mm", "thrust force over depth of cut, in the sub-step before"),
    Q("life_before", "-", "used life before the sub-step"),
    Q("tangles", "-", "times that chips have tangled in the step", dtype=np.int64),
)
"""Scratch: values used within a step only."""

_BY_NAME = {quantity.name: quantity for quantity in STATE}

_AT_END: tuple[str | Quantity, ...] = (
    "cutting_speed",
    "feed",
    "commanded_cutting_speed",
    "commanded_feed",
    Q("spindle_speed", "rev/min", "spindle speed"),
    Q("feed_velocity", "mm/min", "feed velocity"),
    Q("torque", "N m", "spindle torque"),
    "path",
    Q("bar", "-", "bars begun before this one"),
    Q("cutting", "bool", "the tool is in metal", dtype=np.bool_),
    Q("depth_of_cut", "mm", "depth of cut, 0 in air"),
    Q("hardness", "-", "hardness over nominal, 0 in air"),
    "cutting_time",
    "used_life",
    Q("wear", "mm", "flank wear"),
    Q("wear_factor", "-", "wear of the insert over nominal"),
    "edge_strength",
    "thrust_force",
    Q("power", "kW", "spindle power"),
    "measured_thrust_force",
    "measured_servo_current",
    "measured_power",
    Q(
        "spindle_load",
        "-",
        "spindle power over rated power, or torque over available torque (`spindle.reading`)",
    ),
    "spindle_heat",
    Q("roughness", "um", "Ra, 0 in air and in scenarios without a reference"),
    "roughness_reference",
    "probed_depth",
)
AT_END = tuple(_BY_NAME[line] if isinstance(line, str) else line for line in _AT_END)
"""True values in ``info`` at the end of a step. A bare name is a quantity of the state."""
KEPT = tuple(line for line in _AT_END if isinstance(line, str))
"""Names of those that are quantities of the state."""

OVER_STEP = (
    Q("mean_thrust_force", "N", "mean while cutting; with parts, in the last pass"),
    Q("mean_power", "kW", "mean while cutting; with parts, in the last pass"),
    # Time, metal and edges.
    Q("time", "s", "machine time"),
    Q("engaged_time", "s", "time in metal"),
    Q("stopped_time", "s", "time to change edges and to clear chips"),
    Q("removed", "cm3", "removed metal"),
    Q("passes", "-", "passes of parts"),
    Q("edges_used", "-", "used share of life, and all of an edge that is changed or broken"),
    Q("edges_broken", "-", "broken edges"),
    # Overload and deviation of the roughness.
    Q("overload_time", "s", "time beyond a limit"),
    Q("severe_overload_time", "s", "time beyond a limit by more than the tolerance"),
    Q("overload_2_percent_time", "s", "time beyond a limit by more than 2 %"),
    Q("overload_10_percent_time", "s", "time beyond a limit by more than 10 %"),
    Q("roughness_deviation", "s", "integral of the relative deviation of Ra, which is 1 in air"),
    Q(
        "cost",
        "s",
        "severe_overload_time - limits.overload_allowance * engaged_time; a policy is feasible if "
        "an episode's sum is at most 0 in expectation",
    ),
    Q("excess", "-", "excess_force + excess_power; above 0 means that a limit was exceeded"),
    Q(
        "excess_force",
        "-",
        "mean relative excess of thrust force, or of a further limit's response, over its limit",
    ),
    Q("excess_power", "-", "mean relative excess of power over its limit"),
    # Terms of the reward.
    Q("reward_metal", "s", "reward for removed metal"),
    Q("reward_time", "s", "reward for machine time"),
    Q("reward_edge", "s", "reward for used life"),
    Q("reward_overload", "s", "reward for overload"),
    Q("reward_breakage", "s", "reward for breakage"),
    Q("reward_roughness", "s", "reward for the deviation of Ra"),
    Q("broken", "bool", "an edge broke", dtype=np.bool_),
    Q("finished", "bool", "the last bar is done", dtype=np.bool_),
)
"""Sums in ``info`` over a step. Every step starts with 0 for all of these, and for ``OUTCOME``."""

OUTCOME = (
    Q("reward", "s", "sum of the reward's terms"),
    Q("terminated", "bool", "the episode has ended", dtype=np.bool_),
    Q("truncated", "bool", "the episode has run out of time", dtype=np.bool_),
)
"""Outputs of ``step`` beside the observation and ``info``."""

INFO = AT_END + OVER_STEP
REPORT = INFO + OUTCOME

OBSERVATION = (
    Entry("power", "measured power: `5 * (power / limit at this speed - 1)`", _LOW, _HIGH),
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
        "heat of the motor over that at rated load",
        low=0.0,
        high=MAX_RATIO,
        present=lambda s: s.spindle.short_time_load > 1,
    ),
    Entry(
        "roughness_reference",
        "reference of Ra, log scale, -1 to 1",
        low=-1.0,
        high=1.0,
        present=lambda s: s.control.aim == "roughness",
    ),
    Entry(
        "probed_depth",
        "allowance of the next blank: `5 * (mean / drawing's - 1)`",
        low=_LOW,
        high=_HIGH,
        present=lambda s: s.sensors.probe,
    ),
    Entry(
        "removed_wear",
        "wear of the last removed edge over the criterion",
        low=0.0,
        high=MAX_RATIO,
        present=lambda s: s.sensors.inspects_edges,
    ),
    Entry(
        "tangles",
        "stops for tangled chips in the step before",
        low=0.0,
        high=MAX_RATIO,
        present=lambda s: s.sensors.counts_tangles,
    ),
    Entry(
        "hardness",
        "true hardness: `5 * (hardness over nominal - 1)`, 0 in air",
        low=_LOW,
        high=_HIGH,
        present=_observes_all,
    ),
    Entry(
        "depth_of_cut",
        "true depth of cut: `5 * (depth / drawing's - 1)`, 0 in air",
        low=_LOW,
        high=_HIGH,
        present=_observes_all,
    ),
    Entry(
        "wear",
        "true flank wear over the criterion",
        low=0.0,
        high=MAX_RATIO,
        present=_observes_all,
    ),
    Entry(
        "wear_factor",
        "wear of the insert: `5 * (wear over nominal - 1)`",
        low=_LOW,
        high=_HIGH,
        present=_observes_all,
    ),
    Entry(
        "edge_strength",
        "strength of the edge: `5 * (strength / force limit - 1)`",
        low=_LOW,
        high=_HIGH,
        present=_observes_all,
    ),
)
"""Observation entries in order. Entries of some scenarios only come last."""


def _places(table: tuple[Any, ...]) -> Any:
    """Return a record that holds, by the name of each line of a table, its place there."""
    names = [line.name for line in table]
    return namedtuple("Places", names)(*range(len(names)))


OBS = _places(OBSERVATION)
"""Indices of entries in observations: ``OBS.power``.

``layout(scenario)`` has the entries of one scenario, some of which only some scenarios have.
"""
ROW = _places(REPORT)
"""Rows of reports: ``ROW.reward``."""


def layout(scenario: Scenario | ScenarioBatch) -> tuple[str, ...]:
    """Return the names of the entries of a scenario's observations, in order."""
    return tuple(entry.name for entry in OBSERVATION if entry.present(scenario))


def action_size(scenario: Scenario) -> int:
    """Return the number of entries of an action."""
    control = scenario.control
    if control.action == "override":
        size = 1
    elif control.action == "part":
        # Number of passes and allowance, then speed and feed of each pass.
        size = 2 + 2 * control.passes_max
    else:
        size = 2
    if control.edge_changes == "commanded":
        size += 1
    return size
