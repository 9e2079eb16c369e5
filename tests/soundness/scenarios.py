"""Scenarios drawn from the ranges that ``Scenario.model_json_schema()`` states."""

import math
from copy import deepcopy
from typing import Any

from hypothesis import strategies as st

from turning_env import Scenario, presets

Path = tuple[str, ...]
_SCHEMA = Scenario.model_json_schema()
_MAX_CHANGES = 40
BASES = {preset: Scenario.load(preset).model_dump() for preset in presets()}


def _fields(properties: dict[str, Any], path: Path = ()) -> dict[Path, dict[str, Any]]:
    """Return the schema of every value by its path of names; the scenario's name and nominal model are left out."""
    found: dict[Path, dict[str, Any]] = {}
    for name, entry in properties.items():
        if "$ref" in entry:
            found |= _fields(
                _SCHEMA["$defs"][entry["$ref"].rsplit("/", 1)[1]]["properties"], (*path, name)
            )
        elif (*path, name) not in (("name",), ("nominal_model",)):
            found[(*path, name)] = entry
    return found


FIELDS = _fields(_SCHEMA["properties"])
"""Schemas of all values by name."""
LAWS = {path for path in FIELDS if path[0] == "material"}
"""The values of the material's laws: coefficients and exponents."""


def value_of(path: Path) -> st.SearchStrategy[Any]:
    """Values that the schema allows: ends of the range as often as values between, evenly and by order of magnitude."""
    entry = FIELDS[path]
    if "enum" in entry:
        return st.sampled_from(entry["enum"])
    if entry["type"] == "boolean":
        return st.booleans()
    if entry["type"] == "string":
        return st.sampled_from(("EUR", "kr"))
    if entry["type"] == "array":
        return st.lists(st.floats(0.01, 50.0), max_size=16).map(tuple)
    low, high = entry["minimum"], entry["maximum"]
    if entry["type"] == "integer":
        # Ten thousand sub-steps differ from a hundred in nothing but the time that they take.
        return st.sampled_from((low, min(high, 100))) | st.integers(low, min(high, 100))
    least = math.log10(max(low, 1e-6 * high))
    between = st.floats(low, high)
    orders = st.floats(least, math.log10(high)).map(lambda order: min(max(10.0**order, low), high))
    return st.sampled_from((float(low), float(high))) | (between if low < 0 else between | orders)


@st.composite
def values(draw: st.DrawFn, laws: bool = False) -> dict[str, Any]:
    """The values of a preset of which some are replaced; they need not go together. ``laws``: the material's, too."""
    base = BASES[draw(st.sampled_from(sorted(BASES)))]
    changed = deepcopy(base) | {"name": "drawn"}
    allowed = sorted(path for path in FIELDS if laws or path not in LAWS)
    most = draw(st.sampled_from((3, 12, len(allowed))))
    for path in draw(
        st.lists(st.sampled_from(allowed), unique=True, max_size=min(most, _MAX_CHANGES))
    ):
        _put(changed, path, draw(value_of(path)))
    return changed


def scenarios() -> st.SearchStrategy[Scenario]:
    """Scenarios whose values go together, of the presets' materials."""
    return values().map(reconciled).map(Scenario.model_validate)


def reconciled(drawn: dict[str, Any]) -> dict[str, Any]:
    """Return the values, changed if they contradict others."""
    changed = deepcopy(drawn)
    machine, control, surface, sensors = (
        changed[name] for name in ("machine", "control", "surface", "sensors")
    )
    for name in ("cutting_speed", "feed"):
        low, high = sorted((machine[f"{name}_min"], machine[f"{name}_max"]))
        machine[f"{name}_min"], machine[f"{name}_max"] = (
            (low, high) if low < high else (0.5 * high, high)
        )
        if machine[f"{name}_min"] < FIELDS["machine", f"{name}_min"]["minimum"]:
            machine[f"{name}_min"], machine[f"{name}_max"] = low, 2.0 * high
        start = control[f"initial_{name}"]
        control[f"initial_{name}"] = min(max(start, machine[f"{name}_min"]), machine[f"{name}_max"])
    surface["reference_min"], surface["reference_max"] = sorted(
        (surface["reference_min"], surface["reference_max"])
    )
    if changed["mismatch"]["initial_wear"] >= changed["tool"]["wear_criterion"]:
        changed["mismatch"]["initial_wear"] = 0.0
    if control["time_limit"] * 60.0 < control["interval"]:
        control["interval"] = control["time_limit"] * 60.0
    machine["command_delay"] = min(machine["command_delay"], 4.0 * control["interval"])
    if control["action"] == "override":
        control["override_max"] = min(
            control["override_max"], machine["feed_max"] / control["initial_feed"]
        )
        if control["override_max"] < 0.01:
            control["action"] = "set_point"
    if control["action"] == "part":
        for section, names in (
            (machine, ("feed_time_constant", "spindle_time_constant", "chip_lag", "command_delay")),
            (sensors, ("power_time_constant", "force_time_constant")),
        ):
            section.update(dict.fromkeys(names, 0.0))
        changed["workpiece"]["bars"] = max(changed["workpiece"]["bars"], 1)
        control["edge_changes"] = "automatic"
    else:
        sensors["probe"] = False
    sensors["inspects_edges"] &= control["edge_changes"] != "end"
    laws = changed["material"]
    laws["wear"]["wear"] = laws["thrust_force"]["time"] = laws["power"]["time"] = 0.0
    laws["wear"]["time"] = abs(laws["wear"]["time"]) or 0.245
    changed["edge_failure"]["temperature"]["time"] = 0.0
    for name in ("radial_force", "torque", "roughness"):
        law = changed["limits"][name]
        law |= dict.fromkeys(("cutting_speed", "time", "wear"), 0.0) | {
            "feed": abs(law["feed"]) or 0.75
        }
    spindle, work = changed["spindle"], changed["workpiece"]
    per_turn = math.pi * work["diameter"] / 1000.0  # [m]
    if per_turn * spindle["max_speed"] < control["initial_cutting_speed"]:
        spindle["max_speed"] = 0.0
    fastest = max(machine["cutting_speed_max"], per_turn * spindle["base_speed"])
    spindle["idle_torque"] = min(
        spindle["idle_torque"], 15.0 * work["diameter"] * changed["limits"]["power"] / fastest
    )
    sections = len(work["depth_profile"])
    if work["section_lengths"]:
        work["section_lengths"] = (work["bar_length"] / max(sections, 1),) * sections
    work["section_speeds"] = (work["section_speeds"] * sections)[:sections]
    for name in ("chip_feed", "chip_depth"):
        swarf = changed["swarf"]
        swarf[f"{name}_min"], swarf[f"{name}_max"] = sorted(
            (swarf[f"{name}_min"], swarf[f"{name}_max"])
        )
    return changed


def _put(tree: dict[str, Any], path: Path, value: Any) -> None:
    for name in path[:-1]:
        tree = tree[name]
    tree[path[-1]] = value
