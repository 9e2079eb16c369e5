"""The table of parameters: all that the transition reads of a scenario, each declared once.

``parameter_records`` of ``records.py`` takes the values also from many scenarios at once (``scenario/plan.py``).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from turning_env.numerics.functions import log, real_power
from turning_env.physics.drives import lag_share
from turning_env.physics.quantities import ACTIONS, EDGE_CHANGES, OBS, OBSERVATION, action_size, layout
from turning_env.physics.slender_bar import RIGID, SUPPORTS
from turning_env.physics.spindle import idle_power_at
from turning_env.physics.wear import WEAR_RULES
from turning_env.scenario import Scenario
from turning_env.scenario.power_law import POWER_LAW_RECORD
from turning_env.scenario.sections import MAX_DEPTHS, NO_LIMIT


class Parameter(NamedTuple):
    """A number that the transition reads: ``value`` of the scenario, or without one the scenario's field of the same name."""

    name: str
    unit: str = ""
    meaning: str = ""
    value: Callable[[Any], Any] | None = None
    dtype: Any = np.float64
    shape: tuple[int, ...] = ()


def _layout_numbers(s: Scenario) -> list[int]:
    places = [OBS._fields.index(name) for name in layout(s)]
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


def _initial_used_life(s: Scenario) -> Any:
    return real_power(s.mismatch.initial_wear / s.tool.wear_criterion, 1.0 / s.material.wear.time)


def _log_span(section: Any, name: str) -> Any:
    """Return log(highest / lowest) of a range of a section."""
    return log(getattr(section, f"{name}_max") / getattr(section, f"{name}_min"))


def _capacity_per_speed(s: Scenario) -> Any:
    return 1.0 / s.base_cutting_speed if np.all(s.base_cutting_speed) else np.inf


def _change_action(s: Scenario) -> int:
    return action_size(s) - 1 if s.control.edge_changes == "commanded" else -1


def _step_limit(s: Scenario) -> int:
    return round(s.control.time_limit * 60.0 / s.control.interval) if _timeless(s) else 0


def _log_collapse_temperature(s: Scenario) -> Any:
    temperature = s.edge_failure.collapse_temperature
    return log(np.where(np.equal(temperature, 0.0), np.inf, temperature))


def _has_phases(s: Scenario) -> bool:
    wear = s.edge_failure
    return any(np.any(rate) for rate in (wear.tertiary_rate, wear.running_in, wear.built_up_edge))


def _warms_up(s: Scenario) -> bool:
    return any(np.any(change) for change in (s.mismatch.power_drift, s.mismatch.force_drift, s.mismatch.thermal_growth))


def _chatter_speed(s: Scenario) -> Any:
    return log(np.pi * s.workpiece.diameter * s.machine.chatter_speed / 1000.0)


def _section_starts(s: Scenario) -> Any:
    lengths = s.workpiece.section_lengths
    return _per_section(np.cumsum((0.0, *lengths))[:-1])


def _per_section(values: Any) -> Any:
    """Return the sections' values, followed by zeros up to ``MAX_DEPTHS``."""
    return np.pad(values, (0, MAX_DEPTHS - len(values)))


def _timeless(s: Scenario) -> bool:
    """Return whether changing an edge takes no time, and its price holds that time."""
    return s.control.edge_changes == "end"


def _lost(s: Scenario, name: str) -> float:
    """Return a time of the economics [min] that counts in a price, because it does not pass."""
    time: float = getattr(s.economics, name)
    return time if _timeless(s) else 0.0


def _further_laws(s: Scenario) -> Any:
    return np.array((*further_limits(s), *[(0.0, 0.0, 0.0, 0.0)] * 3)[:3])


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
    P("wear_rule", "-", "how wear accumulates", lambda s: WEAR_RULES[s.tool.wear_rule], np.int64),
    P("log_wear_criterion", "-", "logarithm of the criterion [mm]", lambda s: log(s.tool.wear_criterion)),
    P("life_exponent", "-", "1/n of W = K t^n", lambda s: 1.0 / s.material.wear.time),
    P("log_wear_mismatch", "-", "logarithm of the inserts' mean wear over nominal", lambda s: log(s.mismatch.wear_factor)),
    P("initial_used_life", "-", "used life of a new edge", _initial_used_life),
    *_same("wear_criterion", "wear_factor_spread", "edge_strength", "edge_strength_spread"),
    *_same("cutting_speed_min", "cutting_speed_max", "feed_min", "feed_max", "chip_lag", "return_time"),
    P("log_cutting_speed_min", "-", "logarithm of the lowest speed", lambda s: log(s.machine.cutting_speed_min)),
    P("cutting_speed_scale", "-", "2 / log(highest / lowest speed)", lambda s: 2.0 / _log_span(s.machine, "cutting_speed")),
    P("log_feed_min", "-", "logarithm of the lowest feed", lambda s: log(s.machine.feed_min)),
    P("feed_scale", "-", "2 / log(highest / lowest feed)", lambda s: 2.0 / _log_span(s.machine, "feed")),
    P(
        "spindle_share",
        "-",
        "covered per sub-step",
        lambda s: lag_share(_sub_step(s), s.machine.spindle_time_constant),
    ),
    P("feed_share", "-", "likewise of the feed", lambda s: lag_share(_sub_step(s), s.machine.feed_time_constant)),
    P("delays_commands", "-", "commands act late", lambda s: bool(np.any(s.machine.command_delay > 0)), np.bool_),
    P("steps_late", "-", "steps by which commands act late", lambda s: s.machine.command_delay / s.control.interval),
    P("reachable_cutting_speed", "m/min", "highest cutting speed at the diameter", lambda s: s.cutting_speed_max),
    P("idle_power_per_speed", "kW min/m", "idle power over cutting speed", lambda s: idle_power_at(s, 1.0)),
    P("capacity_per_speed", "min/m", "available over rated power per cutting speed, below the base speed", _capacity_per_speed),
    P("heats", "-", "a cold motor may be overloaded", lambda s: s.spindle.short_time_load > 1, np.bool_),
    P("reads_torque", "-", "the load is a share of torque", lambda s: s.spindle.reading == "torque", np.bool_),
    *_same("rated_power", "short_time_load", "thermal_time_constant"),
    P("current_per_newton", "A/N", "servo current over force", _current_per_newton),
    P("no_load_current", "A", "servo current without force, at rest", _no_load_current),
    *_same("no_load_current_rate"),
    P("current_ripple", "-", "amplitude of the current's ripple", lambda s: s.feed_drive.ripple),
    P("ripples_per_path", "1/mm", "waves of the ripple", lambda s: s.feed_drive.ripples_per_turn / s.feed_drive.screw_lead),
    P("path_end", "mm", "end of the job", lambda s: s.workpiece.bars * _bar_pitch(s) if s.workpiece.bars else np.inf),
    P("bar_pitch", "mm", "bar and approach", _bar_pitch),
    P("bars_per_path", "1/mm", "bars per path", lambda s: 1.0 / _bar_pitch(s)),
    P("bars_per_cut", "1/mm", "bars per metal", lambda s: 1.0 / s.workpiece.bar_length),
    P("revolutions_per_metre", "rev/m", "of the bar's circumference", lambda s: 1000.0 / (np.pi * s.workpiece.diameter)),
    P("log_depth_of_cut", "-", "logarithm of the nominal depth [mm]", lambda s: log(s.workpiece.depth_of_cut)),
    P("depth_sections", "-", "sections of different depth", lambda s: len(s.workpiece.depth_profile), np.int64),
    P("depth_profile", "mm", "sections' depths", lambda s: _per_section(s.workpiece.depth_profile), shape=(MAX_DEPTHS,)),
    P("section_starts", "mm", "where sections of given lengths start", _section_starts, shape=(MAX_DEPTHS,)),
    P("has_section_lengths", "-", "the sections' lengths are given", lambda s: bool(s.workpiece.section_lengths), np.bool_),
    P("section_speeds", "m/min", "their highest speeds", lambda s: _per_section(s.workpiece.section_speeds), shape=(MAX_DEPTHS,)),
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
    P("change_action", "-", "place of the action that changes the edge, -1 if there is none", _change_action, np.int64),
    P("entries", "-", "entries of the observation", lambda s: len(layout(s)), np.int64),
    P("observation_layout", "-", "places of the observation's entries", _layout_numbers, np.int64, (len(OBSERVATION),)),
    P("holds_roughness", "-", "a roughness is to be held", lambda s: s.control.aim == "roughness", np.bool_),
    *_same("sub_steps", "passes_max", dtype=np.int64),
    *_same("override_max", "cutting_speed_step", "feed_step", "initial_cutting_speed", "initial_feed", "time_limit"),
    P("step_limit", "-", "most steps of an episode that ends with its edge", _step_limit, np.int64),
    *_same("roughness_at_no_force", "roughness_rate"),
    P("log_reference_min", "-", "logarithm of the lowest reference [um]", lambda s: log(s.surface.reference_min)),
    P("log_reference_span", "-", "log(highest / lowest reference)", lambda s: _log_span(s.surface, "reference")),
    P("reference_time", "min", "time after which the reference changes", lambda s: s.surface.reference_time / 60.0),
    P("senses_current", "-", "the servo current is measured", lambda s: s.sensors.force == "servo_current", np.bool_),
    *_same("probe", "inspects_edges", dtype=np.bool_),
    *_same("power_noise", "force_noise", "power_bias", "force_bias"),
    P("power_sensor_share", "-", "as spindle_share", lambda s: lag_share(_sub_step(s), s.sensors.power_time_constant)),
    P("force_sensor_share", "-", "as spindle_share", lambda s: lag_share(_sub_step(s), s.sensors.force_time_constant)),
    *_same("reference_removal_rate", "edge_change_time", "unplanned_stop", "breakage_downtime"),
    *_same("overload_price", "roughness_price", "overload_tolerance"),
    P("edge_price", "s", "price of a whole edge", lambda s: 60.0 * (s.economics.edge_cost + _lost(s, "edge_change_time"))),
    P("breakage_price", "s", "price of breakage beside the edge", lambda s: 60.0 * _lost(s, "breakage_downtime")),
    P("clock_limit", "min", "machine time that stops end at", lambda s: np.inf if _timeless(s) else s.control.time_limit),
    P("collapses", "-", "edges collapse", lambda s: bool(np.any(s.edge_failure.collapse_temperature > 0.0)), np.bool_),
    P("temperature_law", "K", "temperature of the edge", lambda s: s.edge_failure.temperature, POWER_LAW_RECORD),
    P("log_collapse_temperature", "-", "logarithm of the temperature [K] that an edge bears", _log_collapse_temperature),
    P("has_phases", "-", "wear has phases, or edges build up", _has_phases, np.bool_),
    P("log_built_up_speed", "-", "logarithm of the speed [m/min]", lambda s: log(s.edge_failure.built_up_speed)),
    *_same("running_in", "running_in_wear", "built_up_edge", "built_up_width", "notch_growth"),
    P("notches", "-", "edges notch", lambda s: bool(np.any(s.edge_failure.notch_growth > 0.0)), np.bool_),
    P("chatters", "-", "bars chatter", lambda s: bool(np.any(s.machine.chatter > 0.0)), np.bool_),
    P("log_chatter_cutting_speed", "-", "logarithm of the cutting speed [m/min] at the worst spindle speed", _chatter_speed),
    *_same("chatter", "chatter_width"),
    P("warms_up", "-", "readings or depth drift", _warms_up, np.bool_),
    *_same("power_drift", "force_drift", "thermal_growth", "warm_up_time", "hardness_gradient"),
    P(
        "has_gradient",
        "-",
        "bars are harder at the skin or within",
        lambda s: bool(np.any(s.mismatch.hardness_gradient != 0.0)),
        np.bool_,
    ),
    P("edges_chip", "-", "edges chip", lambda s: bool(np.any(s.edge_failure.chipping_rate > 0.0)), np.bool_),
    *_same("tertiary_wear", "tertiary_rate", "chipping_rate", "chipping_load_exponent", "chipping_wear_exponent"),
    P("chips_tangle", "-", "chips tangle", lambda s: bool(np.any(s.swarf.tangle_rate > 0.0)), np.bool_),
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
    P("further_laws", "-", "log response over limit of each at f = d = H = 1; exponents of f, d, H", _further_laws, shape=(3, 4)),
)
"""Parameters of the transition."""

NOMINAL = (
    *("wear_law", "force_law", "power_law", "log_wear_criterion", "life_exponent"),
    *("current_per_newton", "no_load_current", "no_load_current_rate", "idle_power_per_speed"),
)
"""Parameters that the control's predictions read of the nominal model: ``parameters.nominal.force_law``."""
