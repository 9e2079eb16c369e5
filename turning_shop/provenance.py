"""Load a scenario for advice: limits that are not the user's are off, and what was not measured or stated is said."""

import tomllib
from collections.abc import Mapping
from operator import attrgetter
from pathlib import Path
from typing import Any

from turning_env.scenario import Scenario, presets
from turning_env.scenario.power_law import PowerLaw
from turning_env.scenario.scenario import Source, flat
from turning_env.scenario.sections import Material
from turning_shop.fit import FACTORS
from turning_shop.prediction import Evidence, read_evidence
from turning_shop.whatif import NO_LIMIT

OF_PROGRAMS = {"machine.cutting_speed_max": "m/min", "machine.feed_max": "mm/rev", "tool.wear_criterion": "mm"}
_OF_BARS = {"workpiece.diameter": "mm", "workpiece.bar_length": "mm", "workpiece.depth_of_cut": "mm"}
ASKED = OF_PROGRAMS | _OF_BARS | {"economics.edge_change_time": "min", "machine.return_time": "min", "tool.edge_strength": "N"}
"""Values on which the play of programs and advice depend, and their units."""
TAYLOR = 0.25
"""Taylor exponent n in V T^n = C [-] of carbide in steel, stainless steel and cast iron (ISO groups P, M and K): speed factors
for lives of 20 to 60 min in the catalogue Dormer Pramet 2024, p. 76; Mitsubishi's rule, 20 % more speed halves the life: 0.26."""
CATALOGUE = f"the exponent is such that Taylor's n is {TAYLOR:g}, as in catalogues for the ISO groups P, M and K"


def load(source: Source, asked: Mapping[str, str] = ASKED) -> tuple[Scenario, Evidence]:
    """Return a scenario and the evidence for its laws; warnings say what of ``asked`` no file states, and what was not measured.

    A preset's values count as stated. In a file based on a preset, a limit of force or power that the file does not state is
    off, and a law of wear that is the preset's gets the exponent of speed that catalogues state.
    """
    scenario = Scenario.load(source)
    evidence = read_evidence(scenario)
    if scenario.file is None:
        of_preset = (f"laws and limits are those of the preset {scenario.name}, not measured on your machine",)
        return scenario, evidence.model_copy(update={"warnings": of_preset * isinstance(source, str)})
    stated, preset = stated_by(scenario.file)
    own = flat(stated).keys()
    warnings = [f"{evidence.source}: {warning}" for warning in evidence.warnings]
    if assumed := [f"{name} {attrgetter(name)(scenario):g} {unit}" for name, unit in asked.items() if name not in own]:
        warnings.append(f"not stated in your files, but taken from the preset {preset}: {', '.join(assumed)}")
    for name in FACTORS:
        if name not in evidence.laws:
            whose = "that of your files" if any(each.startswith(f"material.{name}.") for each in own) else f"that of {preset}"
            warnings.append(f"{name}: the law was not measured; it is {whose}")
    limits: dict[str, Any] = {name: none for name, none in NO_LIMIT.items() if f"limits.{name}" not in own}
    update: dict[str, Any] = {"limits": scenario.limits.model_copy(update=limits)}
    off = [name for name, none in NO_LIMIT.items() if getattr(update["limits"], name) == none]
    warnings += [f"limits.{name} is off: your files do not state it" for name in off]
    warnings += ["limits.power is 1000 kW or more: is it in W?"] * (1000 <= update["limits"].power < NO_LIMIT["power"])
    wear = scenario.material.wear
    if "wear" not in evidence.laws and is_papers(wear):
        speed, exponent = scenario.control.initial_cutting_speed, wear.time / TAYLOR
        coefficient = wear.coefficient * speed ** (wear.cutting_speed - exponent)  # of the same life at this speed
        law = wear.model_copy(update={"cutting_speed": exponent, "coefficient": coefficient})
        update["material"] = scenario.material.model_copy(update={"wear": law})
        warnings.append(f"wear: {CATALOGUE}, with the preset's tool life at {speed:g} m/min")
    return scenario.model_copy(update=update), evidence.model_copy(update={"warnings": tuple(warnings)})


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
    return {key: {**below.get(key, {}), **values.get(key, {})} for key in below | values}, preset
