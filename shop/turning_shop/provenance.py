"""Load a scenario for advice, and say where each number that decides it comes from.

A value of a file counts as the user's. A value that only the preset below states is one of three:

* It is **off** if the advice can do without it: limits, the strength of edges, variation of bars,
  failures of the edge, tangled chips, the spindle's curve, model mismatch. Advice and simulation
  then agree, and a warning asks for it.
* It is **assumed** if advice needs it, as the diameter of the bar or the time to change an edge. A
  warning prints its value.
* It has **no effect** on constant speed and feed, as the noise of sensors. The simulation of
  adaptive control uses it, and says so.
"""

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from pydantic import BaseModel
from turning_shop import WorkshopError
from turning_shop.allowed import (
    CARBIDE_MODULUS,
    NO_STRENGTH,
    SLENDER,
    SLENDER_CARBIDE,
    SLENDER_HOLDER,
    with_roughness,
)
from turning_shop.catalogue import UNMEASURED
from turning_shop.fit import FACTORS
from turning_shop.prediction import Evidence, read_evidence
from turning_shop.whatif import NO_LIMIT

from turning_env.files import read_regular
from turning_env.scenario import Scenario, presets
from turning_env.scenario.power_law import PowerLaw
from turning_env.scenario.scenario import MAX_TOML, Source, flat, merged, nested
from turning_env.scenario.sections import Material

SectionT = TypeVar("SectionT", bound=BaseModel)

OF_PROGRAMS = {
    "machine.cutting_speed_max": "m/min",
    "machine.feed_max": "mm/rev",
    "tool.wear_criterion": "mm",
    "tool.wear_factor_spread": "",
    "economics.edge_change_time": "min",
}
"""Values on which the play of programs depends, and their units."""
OF_ADVICE = OF_PROGRAMS | {
    "machine.cutting_speed_min": "m/min",
    "machine.feed_min": "mm/rev",
    "machine.return_time": "min",
    "workpiece.diameter": "mm",
    "workpiece.bar_length": "mm",
    "workpiece.depth_of_cut": "mm",
    "workpiece.approach": "mm",
}
"""Values on which advice depends, and their units."""
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
BARS_VARY = (
    "workpiece.depth_bar_spread",
    "workpiece.depth_along_spread",
    "workpiece.hardness_bar_spread",
    "workpiece.hardness_along_spread",
)
_OFF = {
    "limits.thrust_force": NO_LIMIT["thrust_force"],
    "limits.power": NO_LIMIT["power"],
    "tool.edge_strength": NO_STRENGTH,
    **dict.fromkeys(BARS_VARY, 0.0),
}
"""Neutral values of fields whose defaults are not neutral."""
KNOWN_TO_ADVICE = (
    "name",
    "material",
    "tool",
    "machine",
    "spindle",
    "feed_drive",
    "workpiece",
    "control",
    "surface",
    "sensors",
    "economics",
    "limits",
)
"""Sections that advice knows. It knows no others, such as that of a new disturbance."""
BEYOND_ADVICE = (
    *(f"{name}." for name in Scenario.model_fields if name not in KNOWN_TO_ADVICE),
    "machine.chatter",
    "machine.chip_lag",
    "machine.command_delay",
    "workpiece.depth_profile",
    "workpiece.section_",
    "workpiece.depth_ripple",
    "limits.radial_force.",
    "limits.torque.",
)
"""Beginnings of names of values that the simulation plays and advice does not know.

Their defaults are neutral.
"""
_OFF_BY_DEFAULT = (*BEYOND_ADVICE, "spindle.", "workpiece.support", "limits.roughness.")
NEEDED_BY = {
    "limits.power": ("limits.overload_tolerance", "limits.overload_allowance"),
    "limits.thrust_force": ("limits.overload_tolerance", "limits.overload_allowance"),
    "tool.edge_strength": ("tool.edge_strength_spread", "economics.breakage_downtime"),
    "spindle.short_time_load": ("spindle.thermal_time_constant",),
    "workpiece.depth_along_spread": ("workpiece.depth_correlation_length",),
    "workpiece.hardness_along_spread": ("workpiece.hardness_correlation_length",),
    "workpiece.support": ("workpiece.elastic_modulus", "workpiece.radial_share"),
    "tool.overhang": ("tool.shank_modulus", "workpiece.radial_share"),
    "machine.chatter": ("machine.chatter_speed", "machine.chatter_width"),
    "swarf.tangle_rate": (
        "swarf.tangle_time",
        "swarf.chip_feed_min",
        "swarf.chip_feed_max",
        "swarf.chip_depth_min",
        "swarf.chip_depth_max",
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
EFFICIENCY = 0.8
"""Power at the cut over that of the spindle's motor, if no file states it [-].

Makers of inserts divide the power of the cut by 0.7 to 0.85 to find the motor.
"""
LIKELY_WATTS = 1000.0  # limit of power from which it probably is in W [kW]
TAYLOR = 0.25
"""Taylor exponent n in V T^n = C [-] of carbide in steel, stainless steel and cast iron.

These are the ISO groups P, M and K. Source: speed factors for lives of 20 to 60 min in the
catalogue Dormer Pramet 2024, p. 76. Mitsubishi's rule, that 20 % more speed halves the life, gives
0.26.
"""
CATALOGUE = (
    f"the exponent is such that Taylor's n is {TAYLOR:g}, "
    "as in catalogues for the ISO groups P, M and K"
)


def load(
    source: Source,
    needed: Mapping[str, str] = OF_ADVICE,
    nose_radius: float | None = None,
    is_simulated: bool = True,
    roughness: float | None = None,
) -> tuple[Scenario, Evidence]:
    """Return a scenario and the evidence for its laws.

    Warnings of the evidence name every number that no file states and no cut measured. A preset's
    own values count as stated. In a file based on a preset, what advice can do without is off
    unless the file states it. A law of wear that is the preset's gets the exponent of speed that
    catalogues state.

    Args:
        source: preset, file or values.
        needed: the values that are needed, with their units.
        nose_radius: of the inserts [mm]; it replaces that of the scenario.
        is_simulated: whether warnings say how bars and edges differ.
        roughness: highest theoretical roughness Rt [um].
    """
    scenario = Scenario.load(source)
    if nose_radius is not None:
        scenario = _changed(scenario, {"tool": {"nose_radius": nose_radius}})
    evidence = read_evidence(scenario)
    if scenario.file is None:
        warnings: list[str] = []
        # Only a user names a preset; programs give a scenario or its values.
        if isinstance(source, str):
            warnings += _preset_warnings(scenario, is_simulated)
        evidence = evidence.model_copy(update={"warnings": tuple(warnings)})
    else:
        values, preset = stated_by(scenario.file)
        stated = Stated(set(flat(values)), preset)
        scenario, evidence = for_advice(
            scenario, evidence, stated, needed=needed, is_simulated=is_simulated
        )
    if roughness is not None:
        scenario = with_roughness(scenario, roughness)
    return scenario, evidence


class Stated(NamedTuple):
    """The fields of a scenario that files state."""

    names: set[str]  # of the values, with their sections
    preset: str  # that has all others


def for_advice(
    scenario: Scenario,
    evidence: Evidence,
    stated_values: Stated,
    needed: Mapping[str, str] = OF_ADVICE,
    is_simulated: bool = True,
) -> tuple[Scenario, Evidence]:
    """Return a scenario without what no file states, and its evidence, as ``load`` does."""
    stated, preset = stated_values
    warnings = [f"{evidence.source}: {warning}" for warning in evidence.warnings]
    scenario, effects = _without_unstated(scenario, stated)
    assumed = _assumed(scenario, stated, needed)
    if assumed:
        names = ", ".join(assumed)
        warnings.append(f"not stated in your files, but taken from the preset {preset}: {names}")
    warnings += _law_warnings(scenario, evidence, stated, preset)
    warnings += _off_limits(scenario)
    if LIKELY_WATTS <= scenario.limits.power < NO_LIMIT["power"]:
        warnings.append("limits.power is 1000 kW or more: is it in W?")
    scenario, efficiency_warnings = _with_limit_at_the_cut(scenario, evidence, stated)
    warnings += efficiency_warnings
    if "workpiece.bar_length" in needed:
        _check_overhang(scenario)
        warnings += _slender(scenario, stated)
    warnings += _slender_holder(scenario)
    if is_simulated:
        warnings += _left_to_advice(stated)
        warnings += _even(scenario, stated)
        if effects:
            names = ", ".join(effects)
            off = "off, though the preset has them, as your files do not state them"
            warnings.append(f"{off}: {names}")
        warnings += _left_to_simulation(scenario)
    if "wear" not in evidence.laws and is_papers(scenario.material.wear):
        speed = Scenario.load(preset).control.initial_cutting_speed
        scenario = _with_taylor(scenario, speed)
        warnings.append(f"wear: {CATALOGUE}, with the preset's tool life at {speed:g} m/min")
    return scenario, evidence.model_copy(update={"warnings": tuple(warnings)})


def _with_limit_at_the_cut(
    scenario: Scenario, evidence: Evidence, stated: set[str]
) -> tuple[Scenario, list[str]]:
    """Return a scenario whose limit of power is that of the cut, and warnings on its efficiency.

    ``limits.power`` is that of the nameplate, at the motor. A catalogue's law of power is that of
    the cut; a measured one is of the power that was measured.
    """
    power = scenario.limits.power
    if power >= NO_LIMIT["power"]:
        return scenario, []
    law = evidence.laws.get("power")
    efficiency = scenario.spindle.efficiency
    warnings = []
    if "spindle.efficiency" not in stated and law and law.origin == "catalogue":
        efficiency = EFFICIENCY
        warnings.append(
            f"spindle.efficiency is not stated: {efficiency:g} (0.7 to 0.85, makers' guides), so "
            f"that of {power:g} kW on the nameplate {efficiency * power:.3g} kW reach the cut; "
            "state 1 if limits.power is the power at the cut"
        )
    changes = {"limits": {"power": efficiency * power}, "spindle": {"efficiency": efficiency}}
    return _changed(scenario, changes), warnings


def _preset_warnings(scenario: Scenario, is_simulated: bool) -> Iterator[str]:
    """Yield warnings on a preset that the user names."""
    yield f"laws and limits are those of the preset {scenario.name}, not measured on your machine"
    if is_simulated:
        yield from _left_to_simulation(scenario)


def _with_taylor(scenario: Scenario, speed: float) -> Scenario:
    """Return the scenario with the Taylor exponent of catalogues and the same life at a speed.

    From W = c V^a t^g follows V T^(g / a) = constant, so that n = g / a. The wear at ``speed``
    [m/min] stays: c' V^a' = c V^a.
    """
    wear = scenario.material.wear
    exponent = wear.time / TAYLOR
    coefficient = wear.coefficient * speed ** (wear.cutting_speed - exponent)
    law = {"cutting_speed": exponent, "coefficient": coefficient}
    return _changed(scenario, {"material": {"wear": law}})


def assumed_in_simulation(scenario: Scenario) -> list[str]:
    """Return the values, for people, that only the simulation uses and no file states.

    There are none for a preset.
    """
    if scenario.file is None or scenario.file.suffix != ".toml":
        return []
    values, _ = stated_by(scenario.file)
    stated = set(flat(values))
    return [
        shown(scenario, name, unit) for name, unit in OF_SIMULATION.items() if name not in stated
    ]


def shown(scenario: Scenario, name: str, unit: str | None = None) -> str:
    """Return the name and the value of a field for people; the unit is the declared one if None."""
    value = attrgetter(name)(scenario)
    number = value if isinstance(value, str) else f"{value:g}"
    if unit is None:
        unit = _declared_unit(scenario, name)
    return f"{name} {number} {unit.replace('-', '')}".rstrip()


def _declared_unit(scenario: Scenario, name: str) -> str:
    """Return the unit that a field's section declares; empty if there is none."""
    section_name, _, field = name.rpartition(".")
    section = attrgetter(section_name)(scenario)
    declared = type(section).model_fields[field].json_schema_extra
    if isinstance(declared, dict) and "unit" in declared:
        return str(declared["unit"])
    return ""


def _without_unstated(scenario: Scenario, stated: set[str]) -> tuple[Scenario, list[str]]:
    """Return the scenario without what advice can do without and no file states.

    Return the effects that are thus left out, too.
    """
    values = flat(scenario.model_dump())
    neutral = _neutral_values()
    unstated = []
    for name in values:
        is_switch = name in _OFF or name.startswith(_OFF_BY_DEFAULT)
        if is_switch and name not in stated:
            unstated.append(name)
    changes = nested((name, neutral[name]) for name in unstated if name in neutral)
    reduced = _changed(scenario, changes)

    # The nominal model holds what differs from the scenario, of which only stated values stay.
    prefix = "nominal_model."
    nominal_names = [name for name in stated if name.startswith(prefix)]
    nominal = nested((name.removeprefix(prefix), values[name]) for name in nominal_names)
    nominal_model = tuple(sorted(flat(nominal).items()))
    reduced = reduced.model_copy(update={"nominal_model": nominal_model})
    return reduced, _effects(values, unstated)


def _neutral_values() -> dict[str, Any]:
    """Return the value of each field at which it has no effect, by its name."""
    return flat(Scenario().model_dump()) | _OFF


def _changed(section: SectionT, changes: Mapping[str, Any]) -> SectionT:
    """Return a section with changed values, also in sections within it."""
    update = {}
    for name, value in changes.items():
        if isinstance(value, dict):
            update[name] = _changed(getattr(section, name), value)
        else:
            update[name] = value
    return section.model_copy(update=update)


def _assumed(scenario: Scenario, stated: set[str], needed: Mapping[str, str]) -> list[str]:
    """Return names and values that are needed and no file states, for people."""
    units: dict[str, str | None] = dict(needed)  # None: the unit that the section declares
    for switch, names in NEEDED_BY.items():
        if switch in stated and _is_on(scenario, switch):
            units |= dict.fromkeys(names)
    needs_prices = "economics.edge_change_time" in needed
    if needs_prices and not scenario.economics.insert_price:
        units["economics.edge_cost"] = None
    if scenario.control.action == "override":
        # Overrides are of the programmed feed, at the programmed speed.
        units["control.initial_cutting_speed"] = None
        units["control.initial_feed"] = None
    assumed = []
    for name, unit in units.items():
        if name not in stated:
            assumed.append(shown(scenario, name, unit))
    return assumed


def _is_on(scenario: Scenario, switch: str) -> bool:
    """Return whether a value on which others depend has an effect."""
    no_limit = NO_LIMIT.get(switch.removeprefix("limits."))
    return attrgetter(switch)(scenario) not in (0.0, no_limit, "rigid")


def _law_warnings(
    scenario: Scenario, evidence: Evidence, stated: set[str], preset: str
) -> Iterator[str]:
    """Yield warnings on laws that were not measured."""
    for name in FACTORS:
        if name not in evidence.laws:
            is_stated = any(field.startswith(f"material.{name}.") for field in stated)
            owner = "your files" if is_stated else preset
            yield f"{name}: the law was not measured; it is that of {owner}"
    published = [name for name, law in evidence.laws.items() if law.origin == "catalogue"]
    if published:
        yield f"laws of {', '.join(published)}: {UNMEASURED}"
    work = scenario.workpiece
    spreads = {
        "depth_of_cut": max(work.depth_bar_spread, work.depth_along_spread),
        "hardness": max(work.hardness_bar_spread, work.hardness_along_spread),
    }
    for factor, spread in spreads.items():
        laws = []
        for name, law in evidence.laws.items():
            if law.origin == "measured" and factor not in law.terms:
                laws.append(name)
        if spread > 0.0 and laws:
            names = ", ".join(laws)
            yield (f"bars vary in {factor}, whose exponent was not measured but assumed: {names}")


def _off_limits(scenario: Scenario) -> Iterator[str]:
    """Yield a warning on each limit that is off."""
    for name, no_limit in NO_LIMIT.items():
        if getattr(scenario.limits, name) == no_limit:
            yield f"limits.{name} is off: your files do not state it"


def _slender(scenario: Scenario, stated: set[str]) -> Iterator[str]:
    """Yield warnings if the bar is long for how it is held, or if no file states how or how far."""
    work = scenario.workpiece
    ratio = (work.overhang or work.bar_length) / work.diameter
    if work.support != "rigid" and not work.overhang:
        yield (
            "your files do not state workpiece.overhang: the bar is taken as free over "
            f"workpiece.bar_length, {work.bar_length:g} mm (assumption)"
        )
    if "workpiece.support" not in stated:
        if ratio > SLENDER["chuck"]:
            yield (
                f"the bar is {ratio:.1f} diameters long, but your files do not state "
                "workpiece.support, chuck or tailstock: bars do not bend"
            )
    elif work.support != "rigid" and ratio > SLENDER[work.support]:
        yield (
            f"the bar is {ratio:.1f} diameters long, held by workpiece.support, {work.support}: "
            f"above {SLENDER[work.support]:g} diameters bars often chatter, as a rule of thumb"
        )


def _check_overhang(scenario: Scenario) -> None:
    """Raise WorkshopError if the bar is cut along more than its free length."""
    work = scenario.workpiece
    if 0.0 < work.overhang < work.bar_length:
        raise WorkshopError(
            f"workpiece.overhang is {work.overhang:g} mm, but the bar is cut along "
            f"workpiece.bar_length, {work.bar_length:g} mm: the free length from the chuck is at "
            "least as long"
        )


def _slender_holder(scenario: Scenario) -> Iterator[str]:
    """Yield a warning if the overhang of the tool is long for its diameter."""
    tool = scenario.tool
    if not tool.overhang:
        return
    is_carbide = tool.shank_modulus >= CARBIDE_MODULUS
    highest = SLENDER_CARBIDE if is_carbide else SLENDER_HOLDER
    ratio = tool.overhang / tool.shank_diameter
    if ratio > highest:
        material = "cemented carbide" if is_carbide else "steel"
        yield (
            f"tool.overhang is {ratio:.1f} diameters of its shank: above {highest:g}, holders of "
            f"{material} often chatter, as a rule of thumb"
        )


def _left_to_advice(stated: set[str]) -> Iterator[str]:
    """Yield a warning on stated overhangs, which the simulation does not know."""
    names = [name for name in ("workpiece.overhang", "tool.overhang") if name in stated]
    if names:
        yield (
            f"the simulation knows {', '.join(names)} as a limit of the thrust force alone: it "
            "bends the bar over workpiece.bar_length, and no tool"
        )


def _even(scenario: Scenario, stated: set[str]) -> Iterator[str]:
    """Yield warnings if edges do not break or bars do not vary, as no file states by how much."""
    if scenario.tool.edge_strength == NO_STRENGTH:
        yield (
            "tool.edge_strength is off: your files do not state it, so edges do not break by force"
        )
    unstated = [name for name in BARS_VARY if name not in stated]
    if unstated:
        is_even = len(unstated) == len(BARS_VARY)
        bars = "bars do not vary" if is_even else "bars vary only as stated"
        yield f"{bars}: your files do not state {', '.join(unstated)}"


def _left_to_simulation(scenario: Scenario) -> Iterator[str]:
    """Yield a warning on effects that the simulation plays and the advice does not know."""
    values = flat(scenario.model_dump())
    effects = _effects(values, [name for name in values if name.startswith(BEYOND_ADVICE)])
    if effects:
        names = ", ".join(effects)
        yield f"only the simulation plays these, the advice does not know them: {names}"


def _effects(values: Mapping[str, Any], names: Iterable[str]) -> list[str]:
    """Return which of the named values switch an effect on.

    Those of a further limit or of the nominal model are named by their section.
    """
    neutral = _neutral_values()
    describing: set[str] = set()  # names of values that only describe an effect
    for dependent in NEEDED_BY.values():
        describing.update(dependent)
    effects: dict[str, None] = {}
    for name in names:
        if name in _OFF or name in describing or name.startswith("edge_failure.temperature."):
            continue
        if values[name] == neutral.get(name):
            continue
        if name.startswith(("limits.", "nominal_model.")):
            name = ".".join(name.split(".")[:2])
        effects[name] = None
    return list(effects)


def is_papers(wear: PowerLaw) -> bool:
    """Return whether a law of wear has the paper's Taylor exponent, 0.42: speed is then cheap."""
    paper = Material().wear
    return (wear.cutting_speed, wear.time) == (paper.cutting_speed, paper.time)


def stated_by(path: Path) -> tuple[dict[str, Any], str]:
    """Return the values that a scenario file and its bases state, and the preset below them."""
    values = tomllib.loads(read_regular(path, MAX_TOML).decode("utf-8-sig"))
    base = values.pop("base", "rough_turning")
    for table in ("name", "calibration"):
        values.pop(table, None)
    if base in presets():
        return values, base
    below, preset = stated_by(path.parent / base)
    return merged(below, values), preset
