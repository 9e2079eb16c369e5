"""Load a scenario for advice, and say where each number that decides it comes from.

A value of a file counts as the user's. A value that only the preset below states is one of three:

* It is **off** if the advice can do without it: limits, the strength of edges, variation of bars, failures of the edge, tangled
  chips, the spindle's curve, model mismatch. Advice and simulation then agree, and a warning asks for it.
* It is **assumed** if advice needs it, as the diameter of the bar or the time to change an edge. A warning prints its value.
* It **has no effect** on constant speed and feed, as the noise of sensors. The simulation of adaptive control uses it, and says
  so.
"""

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from operator import attrgetter
from pathlib import Path
from typing import Any

from turning_shop.allowed import NO_STRENGTH
from turning_shop.fit import FACTORS
from turning_shop.prediction import Evidence, read_evidence
from turning_shop.whatif import NO_LIMIT

from turning_env.scenario import Scenario, presets
from turning_env.scenario.power_law import PowerLaw
from turning_env.scenario.scenario import Source, flat, merged, nested
from turning_env.scenario.sections import Material

OF_PROGRAMS = {
    "machine.cutting_speed_max": "m/min",
    "machine.feed_max": "mm/rev",
    "tool.wear_criterion": "mm",
    "tool.wear_factor_spread": "",
}
"""Values on which the play of programs depends, and their units."""
ASKED = OF_PROGRAMS | {
    "machine.cutting_speed_min": "m/min",
    "machine.feed_min": "mm/rev",
    "machine.return_time": "min",
    "workpiece.diameter": "mm",
    "workpiece.bar_length": "mm",
    "workpiece.depth_of_cut": "mm",
    "workpiece.approach": "mm",
    "economics.edge_change_time": "min",
}
"""Values on which advice depends, and their units."""
BARS_VARY = (
    "workpiece.depth_bar_spread",
    "workpiece.depth_along_spread",
    "workpiece.hardness_bar_spread",
    "workpiece.hardness_along_spread",
)
_OFF = {f"limits.{name}": none for name, none in NO_LIMIT.items()}
_OFF |= {"tool.edge_strength": NO_STRENGTH}
_OFF |= dict.fromkeys(BARS_VARY, 0.0)
"""Neutral values of fields whose defaults are not neutral."""
BEYOND_ADVICE = (
    *("edge_failure.", "swarf.", "mismatch.", "nominal_model."),
    *("machine.chatter", "machine.chip_lag", "machine.command_delay"),
    *(
        "workpiece.depth_profile",
        "workpiece.section_",
        "workpiece.depth_ripple",
        "workpiece.support",
    ),
    *("limits.radial_force.", "limits.torque.", "limits.roughness."),
)
"""Beginnings of names of values that the simulation plays and advice does not know. Their defaults are neutral."""
_OFF_BY_DEFAULT = (*BEYOND_ADVICE, "spindle.")
NEEDED_BY = {
    "limits.power": ("limits.overload_tolerance", "limits.overload_allowance"),
    "limits.thrust_force": ("limits.overload_tolerance", "limits.overload_allowance"),
    "tool.edge_strength": ("tool.edge_strength_spread", "economics.breakage_downtime"),
    "spindle.short_time_load": ("spindle.thermal_time_constant",),
    "workpiece.depth_along_spread": ("workpiece.depth_correlation_length",),
    "workpiece.hardness_along_spread": ("workpiece.hardness_correlation_length",),
    "machine.chatter": ("machine.chatter_speed", "machine.chatter_width"),
    "swarf.tangle_rate": (
        *("swarf.tangle_time", "swarf.chip_feed_min", "swarf.chip_feed_max"),
        *("swarf.chip_depth_min", "swarf.chip_depth_max"),
    ),
    "edge_failure.collapse_temperature": ("edge_failure.temperature.coefficient",),
    "edge_failure.tertiary_rate": ("edge_failure.tertiary_wear",),
    "edge_failure.chipping_rate": (
        "edge_failure.chipping_load_exponent",
        "edge_failure.chipping_wear_exponent",
    ),
    "edge_failure.running_in": ("edge_failure.running_in_wear",),
    "edge_failure.built_up_edge": ("edge_failure.built_up_speed", "edge_failure.built_up_width"),
    "economics.machine_rate": ("economics.currency",),
    "economics.insert_price": ("economics.edges_per_insert",),
}
"""Values that count only if another is stated and on."""
OF_SIMULATION = {
    "machine.feed_time_constant": "s",
    "machine.spindle_time_constant": "s",
    "sensors.power_noise": "",
    "sensors.force_noise": "",
    "sensors.power_time_constant": "s",
    "sensors.force_time_constant": "s",
    "control.interval": "s",
}
"""Values that only the simulation of adaptive control uses, and their units."""
TAYLOR = 0.25
"""Taylor exponent n in V T^n = C [-] of carbide in steel, stainless steel and cast iron (ISO groups P, M and K): speed factors
for lives of 20 to 60 min in the catalogue Dormer Pramet 2024, p. 76; Mitsubishi's rule, 20 % more speed halves the life: 0.26."""
CATALOGUE = f"the exponent is such that Taylor's n is {TAYLOR:g}, as in catalogues for the ISO groups P, M and K"


def load(
    source: Source,
    asked: Mapping[str, str] = ASKED,
    nose_radius: float | None = None,
    is_simulated: bool = True,
) -> tuple[Scenario, Evidence]:
    """Return a scenario and the evidence for its laws, with warnings on every number that no file states and no cut measured.

    ``asked`` are the values that are needed. A preset's own values count as stated. In a file based on a preset, what advice can
    do without is off unless the file states it, and a law of wear that is the preset's gets the exponent of speed that
    catalogues state. ``nose_radius`` [mm] replaces that of the scenario. Warnings leave out how bars and edges differ if they are
    not simulated.
    """
    scenario = Scenario.load(source)
    if nose_radius is not None:
        scenario = scenario.model_copy(
            update={"tool": scenario.tool.model_copy(update={"nose_radius": nose_radius})}
        )
    evidence = read_evidence(scenario)
    if scenario.file is None:
        warnings = [
            f"laws and limits are those of the preset {scenario.name}, not measured on your machine"
        ]
        warnings += _left_to_simulation(scenario) if is_simulated else ()
        return scenario, evidence.model_copy(
            update={"warnings": tuple(warnings) * isinstance(source, str)}
        )
    stated, preset = stated_by(scenario.file)
    own = set(flat(stated))
    warnings = [f"{evidence.source}: {warning}" for warning in evidence.warnings]
    scenario, effects = _without_unstated(scenario, own)
    if assumed := _assumed(scenario, own, asked):
        warnings.append(
            f"not stated in your files, but taken from the preset {preset}: {', '.join(assumed)}"
        )
    warnings += _law_warnings(scenario, evidence, own, preset)
    warnings += _off_limits(scenario)
    if is_simulated:
        warnings += _even(scenario, own)
        warnings += [
            f"off, though the preset has them, as your files do not state them: {', '.join(effects)}"
        ] * bool(effects)
        warnings += _left_to_simulation(scenario)
    warnings += ["limits.power is 1000 kW or more: is it in W?"] * (
        1000 <= scenario.limits.power < NO_LIMIT["power"]
    )
    wear = scenario.material.wear
    if "wear" not in evidence.laws and is_papers(wear):
        speed, exponent = Scenario.load(preset).control.initial_cutting_speed, wear.time / TAYLOR
        coefficient = wear.coefficient * speed ** (
            wear.cutting_speed - exponent
        )  # of the same life at this speed
        law = wear.model_copy(update={"cutting_speed": exponent, "coefficient": coefficient})
        scenario = scenario.model_copy(
            update={"material": scenario.material.model_copy(update={"wear": law})}
        )
        warnings.append(f"wear: {CATALOGUE}, with the preset's tool life at {speed:g} m/min")
    return scenario, evidence.model_copy(update={"warnings": tuple(warnings)})


def assumed_in_simulation(scenario: Scenario) -> list[str]:
    """Return the values, for people, that only the simulation uses and no file of a scenario states; none for a preset."""
    if scenario.file is None or scenario.file.suffix != ".toml":
        return []
    own = set(flat(stated_by(scenario.file)[0]))
    return [shown(scenario, name, unit) for name, unit in OF_SIMULATION.items() if name not in own]


def shown(scenario: Scenario, name: str, unit: str | None = None) -> str:
    """Return the name and the value of a field for people."""
    value = attrgetter(name)(scenario)
    if unit is None:
        *sections, field = name.split(".")
        section = attrgetter(".".join(sections))(scenario)
        declared = type(section).model_fields[field].json_schema_extra
        unit = str(declared["unit"]) if isinstance(declared, dict) and "unit" in declared else ""
    number = value if isinstance(value, str) else f"{value:g}"
    return f"{name} {number} {unit.replace('-', '')}".rstrip()


def _without_unstated(scenario: Scenario, own: set[str]) -> tuple[Scenario, list[str]]:
    """Return the scenario without what advice can do without and no file states, and the effects that are thus left out."""
    values, neutral = flat(scenario.model_dump()), flat(Scenario().model_dump()) | _OFF
    switched = [name for name in values if name in _OFF or name.startswith(_OFF_BY_DEFAULT)]
    unstated = [name for name in switched if name not in own]
    update = nested((name, neutral[name]) for name in unstated if name in neutral)
    nominal = nested(
        (name.partition(".")[2], values[name]) for name in own if name.startswith("nominal_model.")
    )
    made = _changed(scenario, update)
    made = made.model_copy(update={"nominal_model": tuple(sorted(flat(nominal).items()))})
    return made, _effects(values, unstated)


def _off_limits(scenario: Scenario) -> Iterator[str]:
    """Yield a warning on each limit that is off."""
    for name, none in NO_LIMIT.items():
        if getattr(scenario.limits, name) == none:
            yield f"limits.{name} is off: your files do not state it"


def _even(scenario: Scenario, own: set[str]) -> Iterator[str]:
    """Yield warnings if edges do not break and bars do not vary, as no file states by how much."""
    if scenario.tool.edge_strength == NO_STRENGTH:
        yield "tool.edge_strength is off: your files do not state it, so edges do not break by force"
    if vary := [name for name in BARS_VARY if name not in own]:
        none = "bars do not vary" if len(vary) == len(BARS_VARY) else "bars vary only as stated"
        yield f"{none}: your files do not state {', '.join(vary)}"


def _changed(section: Any, changes: Mapping[str, Any]) -> Any:
    """Return a section with changed values, also in sections within it."""
    update = {}
    for name, value in changes.items():
        update[name] = _changed(getattr(section, name), value) if isinstance(value, dict) else value
    return section.model_copy(update=update)


def _assumed(scenario: Scenario, own: set[str], asked: Mapping[str, str]) -> list[str]:
    """Return names and values that advice needs and no file states, for people."""
    needed: dict[str, str | None] = dict(asked)
    for switch, names in NEEDED_BY.items():
        if switch in own and attrgetter(switch)(scenario) not in (
            0.0,
            NO_LIMIT.get(switch.removeprefix("limits.")),
        ):
            needed |= dict.fromkeys(names)
    if asked is ASKED and not scenario.economics.insert_price:
        needed["economics.edge_cost"] = None
    if scenario.control.action == "override":  # of the programmed feed, at the programmed speed
        needed |= {"control.initial_cutting_speed": None, "control.initial_feed": None}
    return [shown(scenario, name, unit) for name, unit in needed.items() if name not in own]


def _law_warnings(
    scenario: Scenario, evidence: Evidence, own: set[str], preset: str
) -> Iterator[str]:
    """Yield warnings on laws that were not measured."""
    for name in FACTORS:
        if name not in evidence.laws:
            stated = any(each.startswith(f"material.{name}.") for each in own)
            whose = "that of your files" if stated else f"that of {preset}"
            yield f"{name}: the law was not measured; it is {whose}"
    work = scenario.workpiece
    spreads = {
        "depth_of_cut": max(work.depth_bar_spread, work.depth_along_spread),
        "hardness": max(work.hardness_bar_spread, work.hardness_along_spread),
    }
    for factor, spread in spreads.items():
        laws = [name for name, law in evidence.laws.items() if factor not in law.terms]
        if spread > 0.0 and laws:
            yield f"bars vary in {factor}, whose exponent was not measured but assumed: {', '.join(laws)}"


def _left_to_simulation(scenario: Scenario) -> Iterator[str]:
    """Yield a warning on effects that the simulation plays, but by which the advice does not go."""
    values = flat(scenario.model_dump())
    if on := _effects(values, [name for name in values if name.startswith(BEYOND_ADVICE)]):
        yield f"only the simulation plays these, the advice does not know them: {', '.join(on)}"


def _effects(values: Mapping[str, Any], names: Iterable[str]) -> list[str]:
    """Return which of the named values switch an effect on, those of a further limit under its name."""
    neutral = flat(Scenario().model_dump()) | _OFF
    describing = {name for needed in NEEDED_BY.values() for name in needed}
    on: dict[str, None] = {}
    for name in names:
        if name in _OFF or name in describing or name.startswith("edge_failure.temperature."):
            continue
        if values[name] != neutral.get(name):
            further = name.startswith(("limits.", "nominal_model."))
            on[".".join(name.split(".")[:2]) if further else name] = None
    return list(on)


def is_papers(wear: PowerLaw) -> bool:
    """Return whether a law of wear has the paper's Taylor exponent, 0.42, at which speed is cheap."""
    paper = Material().wear
    return (wear.cutting_speed, wear.time) == (paper.cutting_speed, paper.time)


def stated_by(path: Path) -> tuple[dict[str, Any], str]:
    """Return the values that a scenario file and the files of its bases state, and the preset below them."""
    values = tomllib.loads(path.read_text("utf-8-sig"))
    base = values.pop("base", "rough_turning")
    for table in ("name", "calibration"):
        values.pop(table, None)
    if base in presets():
        return values, base
    below, preset = stated_by(path.parent / base)
    return merged(below, values), preset
