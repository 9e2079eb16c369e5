"""The table of parameters: all that the transition reads of a scenario, each declared once.

Most parameters are fields of the scenario, the others follow from them. The values of a batch of
scenarios are arrays. ``records.py`` puts them into records.
"""

from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from turning_env.numerics.conversions import spindle_speed_at
from turning_env.numerics.functions import log
from turning_env.physics.drives import lag_share
from turning_env.physics.quantities import ACTIONS, EDGE_CHANGES, OBS, OBSERVATION, layout
from turning_env.physics.slender_bar import RIGID, SUPPORTS, rod_flexibility
from turning_env.physics.wear import WEAR_RULES
from turning_env.scenario import Scenario, ScenarioBatch
from turning_env.scenario.laws import chatter_cutting_speed, idle_power_at, used_life_at
from turning_env.scenario.power_law import POWER_LAW_RECORD
from turning_env.scenario.section import declared_ranges
from turning_env.scenario.sections import MAX_DEPTHS, NO_LIMIT

Source = Scenario | ScenarioBatch

FURTHER_LAW_RECORD = np.dtype(
    [
        ("log_share", np.float64),
        ("feed", np.float64),
        ("depth_of_cut", np.float64),
        ("hardness", np.float64),
    ]
)
"""A further limit: log(response / limit) at f = d = H = 1, and the exponents of f, d and H."""
MAX_FURTHER_LIMITS = 3


class Parameter(NamedTuple):
    """A number that the transition reads; ``value`` computes it from a scenario."""

    name: str
    unit: str
    meaning: str
    value: Callable[[Source], Any]
    dtype: Any = np.float64
    shape: tuple[int, ...] = ()
    field: str = ""
    """Dotted name of the scenario's field of which this is the value, if it is one."""

    @property
    def per_env(self) -> bool:
        """Whether the environments of a batch can differ in it. They share the others."""
        return self.shape == () and self.dtype in (np.float64, POWER_LAW_RECORD)


P = Parameter


def by_name(parameters: Iterable[Parameter]) -> dict[str, Parameter]:
    """Return parameters by their names; ValueError if two have the same name."""
    named: dict[str, Parameter] = {}
    for parameter in parameters:
        name = parameter.name
        if name in named:
            sources = named[name].field or "a derived one", parameter.field or "a derived one"
            raise ValueError(f"two parameters are named {name!r}: {' and '.join(sources)}")
        named[name] = parameter
    return named


_DECLARED = declared_ranges(Scenario)


def _field(
    field: str, unit: str = "-", dtype: Any = np.float64, shape: tuple[int, ...] = ()
) -> Parameter:
    """Return the parameter that is a field of the scenario, by its dotted name.

    ``unit``: unit of a field that is no ``quantity``; the others declare theirs.
    """
    name = field.rpartition(".")[2]
    if field in _DECLARED:
        unit = _DECLARED[field].unit
    return P(name, unit, field, value=attrgetter(field), dtype=dtype, shape=shape, field=field)


def _log(field: str) -> Parameter:
    """Return the natural logarithm of a field of the scenario, by its dotted name."""
    name = field.rpartition(".")[2]
    return P(f"log_{name}", "-", f"log {field}", value=lambda s: log(attrgetter(field)(s)))


def _any(name: str, meaning: str, *fields: str) -> Parameter:
    """Return the parameter that says whether any of these fields differs from 0."""

    def differs(s: Source) -> bool:
        return any(np.any(attrgetter(field)(s)) for field in fields)

    return P(name, "-", meaning, value=differs, dtype=np.bool_)


def _lag(name: str, field: str) -> Parameter:
    """Return the share of the distance to its target that a first-order lag covers in a sub-step.

    ``field`` is the dotted name of its time constant.
    """

    def share(s: Source) -> Any:
        return lag_share(_sub_step(s), attrgetter(field)(s))

    return P(name, "-", f"covered in a sub-step with {field}", value=share)


def _sub_step(s: Source) -> float:
    """Return the length of a sub-step [s]."""
    return s.control.interval / s.control.sub_steps


def _current_per_newton(s: Source) -> float:
    """Return L_0 / (2 pi eta) / (3/2 p lambda_m) (servo current paper, equations (2) and (8))."""
    drive = s.feed_drive
    torque_per_force = drive.screw_lead / 1000.0 / (2.0 * np.pi * drive.efficiency)  # [m]
    torque_per_current = 1.5 * drive.pole_pairs * drive.flux_linkage  # [N m/A]
    return torque_per_force / torque_per_current


def _no_load_current(s: Source) -> float:
    """Return the current of F_0 + F_p0 (1 - eta_0^2) (servo current paper, equation (1))."""
    drive = s.feed_drive
    force = drive.guide_friction + drive.preload * (1.0 - drive.screw_efficiency**2)
    return _current_per_newton(s) * force


def _bar_pitch(s: Source) -> float:
    return s.workpiece.bar_length + s.workpiece.approach


def _path_end(s: Source) -> float:
    return s.workpiece.bars * _bar_pitch(s) if s.workpiece.bars else np.inf


def _log_span(section: Any, name: str) -> Any:
    """Return log(highest / lowest) of a range of a section."""
    return log(getattr(section, f"{name}_max") / getattr(section, f"{name}_min"))


def _log_collapse_temperature(s: Source) -> Any:
    temperature = s.edge_failure.collapse_temperature
    # At 0, edges never collapse.
    return log(np.where(np.equal(temperature, 0.0), np.inf, temperature))


def _ends_with_edge(s: Source) -> bool:
    """Return whether an episode ends with its edge, so that the edge's price holds the change."""
    return s.control.edge_changes == "end"


def _edge_price(s: Source) -> Any:
    change_time = s.economics.edge_change_time if _ends_with_edge(s) else 0.0
    return 60.0 * (s.economics.edge_cost + change_time)


def _breakage_price(s: Source) -> Any:
    return 60.0 * s.economics.breakage_downtime if _ends_with_edge(s) else 0.0


def _further_laws(s: Source) -> Any:
    """Return a ``FURTHER_LAW_RECORD`` of each further limit."""
    laws = []
    for law in (s.limits.radial_force, s.limits.torque, s.limits.roughness):
        if np.any(law.coefficient > NO_LIMIT):
            log_share = law.log_coefficient - log(law.most)
            laws.append((log_share, law.feed, law.depth_of_cut, law.hardness))
    return np.array(laws, FURTHER_LAW_RECORD)


PARAMETERS = (
    # Laws of the material (``scenario/power_law.py``).
    P(
        "wear_law",
        "mm",
        "wear of a fresh edge",
        value=lambda s: s.material.wear,
        dtype=POWER_LAW_RECORD,
    ),
    P(
        "force_law",
        "N",
        "thrust force",
        value=lambda s: s.material.thrust_force,
        dtype=POWER_LAW_RECORD,
    ),
    P("power_law", "kW", "power", value=lambda s: s.material.power, dtype=POWER_LAW_RECORD),
    _any(
        "fresh_edges_load",
        "a fresh edge has a share of force or power, by the true laws or the nominal ones",
        "material.thrust_force.wear_growth",
        "material.power.wear_growth",
    ),
    P("life_exponent", "-", "1/n of W = K t^n", value=lambda s: 1.0 / s.material.wear.time),
    # Edges and their wear.
    P(
        "wear_rule",
        "-",
        "rule by which wear accumulates",
        value=lambda s: WEAR_RULES[s.tool.wear_rule],
        dtype=np.int64,
    ),
    _field("tool.wear_criterion"),
    _log("tool.wear_criterion"),
    _field("tool.wear_factor_spread"),
    _field("tool.edge_strength"),
    _field("tool.edge_strength_spread"),
    P(
        "initial_used_life",
        "-",
        "used life of a new edge",
        value=lambda s: used_life_at(s, s.mismatch.initial_wear),
    ),
    P(
        "log_wear_mismatch",
        "-",
        "log of the inserts' mean wear over nominal",
        value=lambda s: log(s.mismatch.wear_factor),
    ),
    _any(
        "has_phases",
        "wear has phases",
        "edge_failure.tertiary_rate",
        "edge_failure.running_in",
        "edge_failure.built_up_edge",
    ),
    _field("edge_failure.tertiary_wear"),
    _field("edge_failure.tertiary_rate"),
    _field("edge_failure.running_in"),
    _field("edge_failure.running_in_wear"),
    _field("edge_failure.built_up_edge"),
    _log("edge_failure.built_up_speed"),
    _field("edge_failure.built_up_width"),
    # Failures of edges.
    _any("collapses", "edges collapse", "edge_failure.collapse_temperature"),
    P(
        "temperature_law",
        "K",
        "temperature of the edge",
        value=lambda s: s.edge_failure.temperature,
        dtype=POWER_LAW_RECORD,
    ),
    P(
        "log_collapse_temperature",
        "-",
        "log of the temperature [K] that an edge bears",
        value=_log_collapse_temperature,
    ),
    _any("edges_chip", "edges chip", "edge_failure.chipping_rate"),
    _field("edge_failure.chipping_rate"),
    _field("edge_failure.chipping_load_exponent"),
    _field("edge_failure.chipping_wear_exponent"),
    _any("notches", "edges notch", "edge_failure.notch_growth"),
    _field("edge_failure.notch_growth"),
    # Chips.
    _any("chips_tangle", "chips tangle", "swarf.tangle_rate"),
    _field("swarf.tangle_rate"),
    _field("swarf.tangle_time"),
    _field("swarf.chip_feed_min"),
    _field("swarf.chip_feed_max"),
    _field("swarf.chip_depth_min"),
    _field("swarf.chip_depth_max"),
    # The machine's ranges and drives.
    _field("machine.cutting_speed_min"),
    _field("machine.cutting_speed_max"),
    _field("machine.feed_min"),
    _field("machine.feed_max"),
    _log("machine.cutting_speed_min"),
    _log("machine.feed_min"),
    P(
        "cutting_speed_scale",
        "-",
        "2 / log(highest / lowest speed)",
        value=lambda s: 2.0 / _log_span(s.machine, "cutting_speed"),
    ),
    P(
        "feed_scale",
        "-",
        "2 / log(highest / lowest feed)",
        value=lambda s: 2.0 / _log_span(s.machine, "feed"),
    ),
    P(
        "reachable_cutting_speed",
        "m/min",
        "highest cutting speed at the diameter",
        value=lambda s: s.cutting_speed_max,
    ),
    _lag("spindle_share", "machine.spindle_time_constant"),
    _lag("feed_share", "machine.feed_time_constant"),
    _any("delays_commands", "commands act late", "machine.command_delay"),
    P(
        "steps_late",
        "-",
        "steps by which commands act late",
        value=lambda s: s.machine.command_delay / s.control.interval,
    ),
    _any("chips_lag", "force and power lag behind the chip", "machine.chip_lag"),
    _field("machine.chip_lag"),
    _any("chatters", "bars chatter", "machine.chatter"),
    _field("machine.chatter"),
    _field("machine.chatter_width"),
    P(
        "log_chatter_cutting_speed",
        "-",
        "log of the cutting speed [m/min] at the worst spindle speed",
        value=lambda s: log(chatter_cutting_speed(s)),
    ),
    _field("machine.return_time"),
    # The spindle's motor.
    _field("machine.rated_power"),
    P(
        "idle_power_per_speed",
        "kW min/m",
        "idle power over cutting speed",
        value=lambda s: idle_power_at(s, 1.0),
    ),
    _any("has_base_speed", "the available power depends on the speed", "spindle.base_speed"),
    P(
        "capacity_per_speed",
        "min/m",
        "capacity over low speeds",
        value=lambda s: 1.0 / np.maximum(s.base_cutting_speed, 1e-9),
    ),
    P(
        "heats",
        "-",
        "a cold motor may be overloaded",
        value=lambda s: s.spindle.short_time_load > 1,
        dtype=np.bool_,
    ),
    _field("spindle.short_time_load"),
    _field("spindle.thermal_time_constant"),
    P(
        "reads_torque",
        "-",
        "the load is a share of torque",
        value=lambda s: s.spindle.reading == "torque",
        dtype=np.bool_,
    ),
    # The feed drive's motor.
    P("current_per_newton", "A/N", "servo current over force", value=_current_per_newton),
    P("no_load_current", "A", "servo current without force, at rest", value=_no_load_current),
    _field("feed_drive.no_load_current_rate"),
    P(
        "current_ripple",
        "-",
        "amplitude of the current's ripple",
        value=lambda s: s.feed_drive.ripple,
    ),
    P(
        "ripples_per_path",
        "1/mm",
        "periods of the current's ripple per path",
        value=lambda s: s.feed_drive.ripples_per_turn / s.feed_drive.screw_lead,
    ),
    # Bars: their row.
    _field("workpiece.bar_length"),
    _field("workpiece.approach"),
    P("path_end", "mm", "end of the job", value=_path_end),
    P("bar_pitch", "mm", "bar and approach", value=_bar_pitch),
    P("bars_per_path", "1/mm", "bars per path, air and metal", value=lambda s: 1.0 / _bar_pitch(s)),
    P("bars_per_cut", "1/mm", "bars per metal", value=lambda s: 1.0 / s.workpiece.bar_length),
    P(
        "revolutions_per_metre",
        "rev/m",
        "turns per length of the bar's circumference",
        value=lambda s: spindle_speed_at(1.0, s.workpiece.diameter),
    ),
    # Bars: depth of cut.
    _field("workpiece.depth_of_cut"),
    _log("workpiece.depth_of_cut"),
    _field("workpiece.depth_bar_spread"),
    _field("workpiece.depth_along_spread"),
    P(
        "depth_nodes_per_length",
        "1/mm",
        "nodes of depth along the bar",
        value=lambda s: 1.0 / s.workpiece.depth_correlation_length,
    ),
    P(
        "depth_sections",
        "-",
        "sections of different depth",
        value=lambda s: len(s.workpiece.depth_profile),
        dtype=np.int64,
    ),
    _field("workpiece.depth_profile", "mm", shape=(MAX_DEPTHS,)),
    _any("has_section_lengths", "the sections' lengths are given", "workpiece.section_lengths"),
    P(
        "section_starts",
        "mm",
        "starts of the sections along the bar",
        value=lambda s: np.cumsum((0.0, *s.workpiece.section_lengths[:-1])),
        shape=(MAX_DEPTHS,),
    ),
    _any("has_section_speeds", "the sections limit the cutting speed", "workpiece.section_speeds"),
    _field("workpiece.section_speeds", "m/min", shape=(MAX_DEPTHS,)),
    _any("ripples", "the depth ripples", "workpiece.depth_ripple"),
    _field("workpiece.depth_ripple"),
    P(
        "depth_ripples_per_turn",
        "1/rev",
        "periods of the depth's ripple per turn",
        value=lambda s: 1.0 / s.workpiece.depth_ripple_period,
    ),
    # Bars: hardness and bending.
    _field("workpiece.hardness_bar_spread"),
    _field("workpiece.hardness_along_spread"),
    P(
        "hardness_nodes_per_length",
        "1/mm",
        "nodes of hardness along the bar",
        value=lambda s: 1.0 / s.workpiece.hardness_correlation_length,
    ),
    P(
        "support",
        "-",
        "support of the bar",
        value=lambda s: SUPPORTS[s.workpiece.support],
        dtype=np.int64,
    ),
    P(
        "bends",
        "-",
        "the bar bends",
        value=lambda s: SUPPORTS[s.workpiece.support] != RIGID,
        dtype=np.bool_,
    ),
    P(
        "bar_flexibility",
        "1/(N mm2)",
        "1 / (3 E I)",
        value=lambda s: rod_flexibility(s.workpiece.diameter, s.workpiece.elastic_modulus),
    ),
    _field("workpiece.radial_share"),
    # Model mismatch of bars and sensors.
    P(
        "log_hardness_mismatch",
        "-",
        "log of the mean hardness over nominal",
        value=lambda s: log(s.mismatch.hardness_factor),
    ),
    _any("has_gradient", "bars are harder at the skin or within", "mismatch.hardness_gradient"),
    _field("mismatch.hardness_gradient"),
    _any("has_skin", "blanks have a skin", "mismatch.skin_thickness"),
    _field("mismatch.skin_thickness"),
    _field("mismatch.skin_hardness"),
    _field("mismatch.skin_wear"),
    _field("mismatch.power_bias"),
    _field("mismatch.force_bias"),
    _any(
        "warms_up",
        "readings or depth drift",
        "mismatch.power_drift",
        "mismatch.force_drift",
        "mismatch.thermal_growth",
    ),
    _field("mismatch.power_drift"),
    _field("mismatch.force_drift"),
    _field("mismatch.thermal_growth"),
    _field("mismatch.warm_up_time"),
    # Sensors and observations.
    P(
        "senses_current",
        "-",
        "the servo current is measured",
        value=lambda s: s.sensors.force == "servo_current",
        dtype=np.bool_,
    ),
    _lag("power_sensor_share", "sensors.power_time_constant"),
    _lag("force_sensor_share", "sensors.force_time_constant"),
    _field("sensors.power_noise"),
    _field("sensors.force_noise"),
    _field("sensors.probe", dtype=np.bool_),
    _field("sensors.inspects_edges", dtype=np.bool_),
    _field("sensors.counts_tangles", dtype=np.bool_),
    _field("sensors.observes_all", dtype=np.bool_),
    P("entries", "-", "entries of the observation", value=lambda s: len(layout(s)), dtype=np.int64),
    P(
        "observation_layout",
        "-",
        "the scenario's entries, as places in OBS",
        value=lambda s: [getattr(OBS, name) for name in layout(s)],
        dtype=np.int64,
        shape=(len(OBSERVATION),),
    ),
    # Roughness and its reference.
    P(
        "holds_roughness",
        "-",
        "a roughness is to be held",
        value=lambda s: s.control.aim == "roughness",
        dtype=np.bool_,
    ),
    _field("surface.roughness_at_no_force"),
    _field("surface.roughness_rate"),
    _log("surface.reference_min"),
    P(
        "log_reference_span",
        "-",
        "log(highest / lowest reference)",
        value=lambda s: _log_span(s.surface, "reference"),
    ),
    P(
        "reference_time",
        "min",
        "time after which the reference changes",
        value=lambda s: s.surface.reference_time / 60.0,
    ),
    # Actions and the length of an episode.
    P(
        "action",
        "-",
        "meaning of an action",
        value=lambda s: ACTIONS[s.control.action],
        dtype=np.int64,
    ),
    P(
        "edge_changes",
        "-",
        "consequence of an edge's end",
        value=lambda s: EDGE_CHANGES[s.control.edge_changes],
        dtype=np.int64,
    ),
    _field("control.sub_steps", dtype=np.int64),
    P("sub_step", "min", "length of a sub-step", value=lambda s: _sub_step(s) / 60.0),
    _field("control.passes_max", dtype=np.int64),
    _field("control.override_max"),
    _field("control.cutting_speed_step"),
    _field("control.feed_step"),
    _field("control.initial_cutting_speed"),
    _field("control.initial_feed"),
    _field("control.time_limit"),
    P(
        "step_limit",
        "-",
        "largest number of steps of an episode of one edge; 0: none",
        value=lambda s: s.max_episode_steps if _ends_with_edge(s) else 0,
        dtype=np.int64,
    ),
    P(
        "clock_limit",
        "min",
        "machine time at which stops of the machine end",
        value=lambda s: np.inf if _ends_with_edge(s) else s.control.time_limit,
    ),
    # Prices.
    _field("economics.reference_removal_rate"),
    P("edge_price", "s", "price of a whole edge", value=_edge_price),
    P("breakage_price", "s", "price of breakage beside the edge", value=_breakage_price),
    _field("economics.edge_change_time"),
    _field("economics.unplanned_stop"),
    _field("economics.breakage_downtime"),
    _field("economics.overload_price"),
    _field("economics.roughness_price"),
    # Limits.
    _field("limits.overload_tolerance"),
    _field("limits.overload_allowance"),
    P(
        "thrust_force_limit",
        "N",
        "largest allowed thrust force",
        value=lambda s: s.limits.thrust_force,
    ),
    P(
        "per_thrust_force_limit",
        "1/N",
        "1 / thrust_force_limit",
        value=lambda s: 1.0 / s.limits.thrust_force,
    ),
    P("power_limit", "kW", "largest allowed power", value=lambda s: s.limits.power),
    P("per_power_limit", "1/kW", "1 / power_limit", value=lambda s: 1.0 / s.limits.power),
    P(
        "further_limits",
        "-",
        "number of further limits",
        value=lambda s: len(_further_laws(s)),
        dtype=np.int64,
    ),
    P(
        "further_laws",
        "-",
        "laws of the further limits",
        value=_further_laws,
        dtype=FURTHER_LAW_RECORD,
        shape=(MAX_FURTHER_LIMITS,),
    ),
)
"""Parameters of the transition."""

NOMINAL = (
    "wear_law",
    "force_law",
    "power_law",
    "log_wear_criterion",
    "life_exponent",
    "current_per_newton",
    "no_load_current",
    "no_load_current_rate",
    "idle_power_per_speed",
)
"""Parameters that the control's predictions read of the nominal model: ``p.nominal.force_law``."""
