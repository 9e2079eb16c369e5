"""The table of parameters: all that the transition reads of a scenario, each declared once.

``parameter_records`` of ``records.py`` takes the values of one scenario or of a batch (``ScenarioBatch``).
"""

from collections.abc import Callable
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from turning_env.numerics.functions import log, real_power
from turning_env.physics.drives import lag_share
from turning_env.physics.quantities import ACTIONS, EDGE_CHANGES, OBS, OBSERVATION, layout
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


P = Parameter


def _same(
    *names: str, dtype: Any = np.float64, shape: tuple[int, ...] = ()
) -> tuple[Parameter, ...]:
    """Return parameters that are fields of the scenario."""
    return tuple(P(name, dtype=dtype, shape=shape) for name in names)


def _log(field: str) -> Parameter:
    """Return the natural logarithm of a field of the scenario, by its dotted name."""
    return P(f"log_{field.partition('.')[2]}", "-", field, lambda s: log(attrgetter(field)(s)))


def _any(name: str, meaning: str, *fields: str) -> Parameter:
    """Return the parameter that says whether any of these fields, by their dotted names, differs from 0."""
    return P(
        name,
        "-",
        meaning,
        lambda s: any(np.any(attrgetter(field)(s)) for field in fields),
        np.bool_,
    )


def _lag(name: str, field: str) -> Parameter:
    """Return the share of the distance to its target that a first-order lag with a time constant covers in a sub-step."""
    return P(
        name,
        "-",
        f"covered in a sub-step with {field}",
        lambda s: lag_share(_sub_step(s), attrgetter(field)(s)),
    )


def _sub_step(s: Scenario) -> float:
    """Return the length of a sub-step [s]."""
    return s.control.interval / s.control.sub_steps


def _current_per_newton(s: Scenario) -> float:
    drive = s.feed_drive
    screw = drive.screw_lead / 1000.0 / (2.0 * np.pi * drive.efficiency)  # torque over force [m]
    return screw / (1.5 * drive.pole_pairs * drive.flux_linkage)


def _no_load_current(s: Scenario) -> float:
    drive = s.feed_drive
    return _current_per_newton(s) * (
        drive.guide_friction + drive.preload * (1.0 - drive.screw_efficiency**2)
    )


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


def _log_collapse_temperature(s: Scenario) -> Any:
    temperature = s.edge_failure.collapse_temperature
    return log(np.where(np.equal(temperature, 0.0), np.inf, temperature))


def _chatter_speed(s: Scenario) -> Any:
    return log(np.pi * s.workpiece.diameter * s.machine.chatter_speed / 1000.0)


def _timeless(s: Scenario) -> bool:
    """Return whether changing an edge takes no time, and its price holds that time."""
    return s.control.edge_changes == "end"


def _lost(s: Scenario, name: str) -> Any:
    """Return a time of the economics [min] that counts in a price, because it does not pass."""
    return getattr(s.economics, name) if _timeless(s) else 0.0


def _further_laws(s: Scenario) -> Any:
    """Return log response over limit at f = d = H = 1, and exponents of f, d and H, of each further limit."""
    laws = [
        law
        for law in (s.limits.radial_force, s.limits.torque, s.limits.roughness)
        if np.any(law.coefficient > NO_LIMIT)
    ]
    rows = [
        (law.log_coefficient - log(law.most), law.feed, law.depth_of_cut, law.hardness)
        for law in laws
    ]
    return np.reshape(rows, (-1, 4))


PARAMETERS = (
    P("wear_law", "mm", "wear of a fresh edge", lambda s: s.material.wear, POWER_LAW_RECORD),
    P("force_law", "N", "thrust force", lambda s: s.material.thrust_force, POWER_LAW_RECORD),
    P("power_law", "kW", "power", lambda s: s.material.power, POWER_LAW_RECORD),
    P(
        "temperature_law",
        "K",
        "temperature of the edge",
        lambda s: s.edge_failure.temperature,
        POWER_LAW_RECORD,
    ),
    *map(
        _log,
        (
            "tool.wear_criterion",
            "machine.cutting_speed_min",
            "machine.feed_min",
            "workpiece.depth_of_cut",
        ),
    ),
    *map(_log, ("surface.reference_min", "edge_failure.built_up_speed")),
    P(
        "log_wear_mismatch",
        "-",
        "logarithm of the inserts' mean wear over nominal",
        lambda s: log(s.mismatch.wear_factor),
    ),
    P(
        "log_hardness_mismatch",
        "-",
        "logarithm of the mean hardness over nominal",
        lambda s: log(s.mismatch.hardness_factor),
    ),
    P(
        "log_collapse_temperature",
        "-",
        "logarithm of the temperature [K] that an edge bears",
        _log_collapse_temperature,
    ),
    P(
        "log_chatter_cutting_speed",
        "-",
        "logarithm of the cutting speed [m/min] at the worst spindle speed",
        _chatter_speed,
    ),
    *_same("wear_criterion", "wear_factor_spread", "edge_strength", "edge_strength_spread"),
    *_same(
        "chipping_rate",
        "chipping_load_exponent",
        "chipping_wear_exponent",
        "tertiary_wear",
        "tertiary_rate",
    ),
    *_same(
        "running_in",
        "running_in_wear",
        "built_up_edge",
        "built_up_width",
        "notch_growth",
        "tangle_rate",
        "tangle_time",
    ),
    *_same(
        "chip_feed_min",
        "chip_feed_max",
        "chip_depth_min",
        "chip_depth_max",
        "chip_lag",
        "chatter",
        "chatter_width",
    ),
    *_same(
        "cutting_speed_min",
        "cutting_speed_max",
        "feed_min",
        "feed_max",
        "return_time",
        "rated_power",
    ),
    *_same(
        "short_time_load",
        "thermal_time_constant",
        "no_load_current_rate",
        "radial_share",
        "bar_length",
        "approach",
    ),
    *_same(
        "depth_of_cut",
        "depth_ripple",
        "depth_bar_spread",
        "depth_along_spread",
        "hardness_bar_spread",
    ),
    *_same(
        "hardness_along_spread",
        "override_max",
        "cutting_speed_step",
        "feed_step",
        "initial_cutting_speed",
        "initial_feed",
    ),
    *_same(
        "time_limit",
        "roughness_at_no_force",
        "roughness_rate",
        "power_noise",
        "force_noise",
        "power_bias",
        "force_bias",
    ),
    *_same(
        "skin_thickness",
        "skin_hardness",
        "skin_wear",
        "power_drift",
        "force_drift",
        "thermal_growth",
        "warm_up_time",
    ),
    *_same(
        "hardness_gradient",
        "reference_removal_rate",
        "edge_change_time",
        "unplanned_stop",
        "breakage_downtime",
    ),
    *_same("overload_price", "roughness_price", "overload_tolerance"),
    *_same("depth_profile", "section_speeds", shape=(MAX_DEPTHS,)),
    *_same("sub_steps", "passes_max", dtype=np.int64),
    *_same("probe", "inspects_edges", dtype=np.bool_),
    P("wear_rule", "-", "how wear accumulates", lambda s: WEAR_RULES[s.tool.wear_rule], np.int64),
    P("life_exponent", "-", "1/n of W = K t^n", lambda s: 1.0 / s.material.wear.time),
    P("initial_used_life", "-", "used life of a new edge", _initial_used_life),
    P(
        "cutting_speed_scale",
        "-",
        "2 / log(highest / lowest speed)",
        lambda s: 2.0 / _log_span(s.machine, "cutting_speed"),
    ),
    P(
        "feed_scale",
        "-",
        "2 / log(highest / lowest feed)",
        lambda s: 2.0 / _log_span(s.machine, "feed"),
    ),
    _lag("spindle_share", "machine.spindle_time_constant"),
    _lag("feed_share", "machine.feed_time_constant"),
    _lag("power_sensor_share", "sensors.power_time_constant"),
    _lag("force_sensor_share", "sensors.force_time_constant"),
    _any("delays_commands", "commands act late", "machine.command_delay"),
    P(
        "steps_late",
        "-",
        "steps by which commands act late",
        lambda s: s.machine.command_delay / s.control.interval,
    ),
    P(
        "reachable_cutting_speed",
        "m/min",
        "highest cutting speed at the diameter",
        lambda s: s.cutting_speed_max,
    ),
    P(
        "idle_power_per_speed",
        "kW min/m",
        "idle power over cutting speed",
        lambda s: idle_power_at(s, 1.0),
    ),
    P(
        "capacity_per_speed",
        "min/m",
        "capacity over low speeds",
        lambda s: 1.0 / np.maximum(s.base_cutting_speed, 1e-9),
    ),
    P(
        "heats",
        "-",
        "a cold motor may be overloaded",
        lambda s: s.spindle.short_time_load > 1,
        np.bool_,
    ),
    _any("has_base_speed", "the available power depends on the speed", "spindle.base_speed"),
    P(
        "reads_torque",
        "-",
        "the load is a share of torque",
        lambda s: s.spindle.reading == "torque",
        np.bool_,
    ),
    P("current_per_newton", "A/N", "servo current over force", _current_per_newton),
    P("no_load_current", "A", "servo current without force, at rest", _no_load_current),
    P("current_ripple", "-", "amplitude of the current's ripple", lambda s: s.feed_drive.ripple),
    P(
        "ripples_per_path",
        "1/mm",
        "waves of the ripple",
        lambda s: s.feed_drive.ripples_per_turn / s.feed_drive.screw_lead,
    ),
    P(
        "path_end",
        "mm",
        "end of the job",
        lambda s: s.workpiece.bars * _bar_pitch(s) if s.workpiece.bars else np.inf,
    ),
    P("bar_pitch", "mm", "bar and approach", _bar_pitch),
    P("bars_per_path", "1/mm", "bars per path", lambda s: 1.0 / _bar_pitch(s)),
    P("bars_per_cut", "1/mm", "bars per metal", lambda s: 1.0 / s.workpiece.bar_length),
    P(
        "revolutions_per_metre",
        "rev/m",
        "of the bar's circumference",
        lambda s: 1000.0 / (np.pi * s.workpiece.diameter),
    ),
    P(
        "depth_sections",
        "-",
        "sections of different depth",
        lambda s: len(s.workpiece.depth_profile),
        np.int64,
    ),
    _any("has_section_lengths", "the sections' lengths are given", "workpiece.section_lengths"),
    P(
        "section_starts",
        "mm",
        "starts",
        lambda s: np.cumsum((0.0, *s.workpiece.section_lengths[:-1])),
        shape=(MAX_DEPTHS,),
    ),
    _any("has_section_speeds", "the sections limit the cutting speed", "workpiece.section_speeds"),
    P(
        "depth_ripples_per_turn",
        "1/rev",
        "waves of the depth's ripple",
        lambda s: 1.0 / s.workpiece.depth_ripple_period,
    ),
    P(
        "depth_nodes_per_length",
        "1/mm",
        "nodes of depth",
        lambda s: 1.0 / s.workpiece.depth_correlation_length,
    ),
    P(
        "hardness_nodes_per_length",
        "1/mm",
        "nodes of hardness",
        lambda s: 1.0 / s.workpiece.hardness_correlation_length,
    ),
    P("sub_step", "min", "length of a sub-step", lambda s: _sub_step(s) / 60.0),
    P("action", "-", "what an action names", lambda s: ACTIONS[s.control.action], np.int64),
    P(
        "edge_changes",
        "-",
        "what follows on an edge's end",
        lambda s: EDGE_CHANGES[s.control.edge_changes],
        np.int64,
    ),
    P("entries", "-", "entries of the observation", lambda s: len(layout(s)), np.int64),
    P(
        "observation_layout",
        "-",
        "rows",
        lambda s: [getattr(OBS, name) for name in layout(s)],
        np.int64,
        (len(OBSERVATION),),
    ),
    P(
        "holds_roughness",
        "-",
        "a roughness is to be held",
        lambda s: s.control.aim == "roughness",
        np.bool_,
    ),
    P(
        "step_limit",
        "-",
        "most steps of an episode of one edge",
        lambda s: s.max_episode_steps if _timeless(s) else 0,
        np.int64,
    ),
    P(
        "log_reference_span",
        "-",
        "log(highest / lowest reference)",
        lambda s: _log_span(s.surface, "reference"),
    ),
    P(
        "reference_time",
        "min",
        "time after which the reference changes",
        lambda s: s.surface.reference_time / 60.0,
    ),
    P(
        "senses_current",
        "-",
        "the servo current is measured",
        lambda s: s.sensors.force == "servo_current",
        np.bool_,
    ),
    P(
        "edge_price",
        "s",
        "price of a whole edge",
        lambda s: 60.0 * (s.economics.edge_cost + _lost(s, "edge_change_time")),
    ),
    P(
        "breakage_price",
        "s",
        "price of breakage beside the edge",
        lambda s: 60.0 * _lost(s, "breakage_downtime"),
    ),
    P(
        "clock_limit",
        "min",
        "machine time that stops end at",
        lambda s: np.inf if _timeless(s) else s.control.time_limit,
    ),
    _any("ripples", "the depth ripples", "workpiece.depth_ripple"),
    _any("has_skin", "blanks have a skin", "mismatch.skin_thickness"),
    _any("has_gradient", "bars are harder at the skin or within", "mismatch.hardness_gradient"),
    _any(
        "warms_up",
        "readings or depth drift",
        "mismatch.power_drift",
        "mismatch.force_drift",
        "mismatch.thermal_growth",
    ),
    _any("chips_lag", "force and power lag behind the chip", "machine.chip_lag"),
    _any("chatters", "bars chatter", "machine.chatter"),
    _any("chips_tangle", "chips tangle", "swarf.tangle_rate"),
    _any("collapses", "edges collapse", "edge_failure.collapse_temperature"),
    _any("edges_chip", "edges chip", "edge_failure.chipping_rate"),
    _any("notches", "edges notch", "edge_failure.notch_growth"),
    _any(
        "has_phases",
        "wear has phases",
        "edge_failure.tertiary_rate",
        "edge_failure.running_in",
        "edge_failure.built_up_edge",
    ),
    P("support", "-", "how the bar is held", lambda s: SUPPORTS[s.workpiece.support], np.int64),
    P("bends", "-", "the bar bends", lambda s: SUPPORTS[s.workpiece.support] != RIGID, np.bool_),
    P("bar_flexibility", "1/(N mm2)", "1 / (3 E I)", _bar_flexibility),
    P("thrust_force_limit", "N", "highest allowed thrust force", lambda s: s.limits.thrust_force),
    P(
        "per_thrust_force_limit",
        "1/N",
        "1 / thrust_force_limit",
        lambda s: 1.0 / s.limits.thrust_force,
    ),
    P("power_limit", "kW", "highest allowed power", lambda s: s.limits.power),
    P("per_power_limit", "1/kW", "1 / power_limit", lambda s: 1.0 / s.limits.power),
    P(
        "further_limits",
        "-",
        "how many further limits there are",
        lambda s: len(_further_laws(s)),
        np.int64,
    ),
    P(
        "further_laws",
        "-",
        "log response over limit of each at f = d = H = 1; exponents of f, d, H",
        _further_laws,
        shape=(3, 4),
    ),
)
"""Parameters of the transition."""

NOMINAL = (
    *("wear_law", "force_law", "power_law", "log_wear_criterion", "life_exponent"),
    *("current_per_newton", "no_load_current", "no_load_current_rate", "idle_power_per_speed"),
)
"""Parameters that the control's predictions read of the nominal model: ``parameters.nominal.force_law``."""
