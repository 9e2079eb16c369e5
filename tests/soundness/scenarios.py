"""Scenarios drawn from the ranges that ``Scenario.model_json_schema()`` states."""

import math
from copy import deepcopy
from typing import Any

from hypothesis import strategies as st

from turning_env import Scenario, presets

Path = tuple[str, ...]
_SCHEMA = Scenario.model_json_schema()
_MAX_CHANGES = 40
# With higher exponents, a law may leave the range of numbers that a response may have.
_MAX_EXPONENT = 3.0
_MAX_LOG_GROWTH = 50.0
"""Largest logarithm by which the rate of wear grows after its tertiary phase begins [-]."""
BASES = {preset: Scenario.load(preset).model_dump() for preset in presets()}


def _fields(properties: dict[str, Any], path: Path = ()) -> dict[Path, dict[str, Any]]:
    """Return the schema of every value by its path of names.

    The scenario's name and nominal model are left out.
    """
    schemas: dict[Path, dict[str, Any]] = {}
    for name, entry in properties.items():
        inner = (*path, name)
        if "$ref" in entry:
            section = entry["$ref"].rsplit("/", 1)[1]
            schemas |= _fields(_SCHEMA["$defs"][section]["properties"], inner)
        elif inner not in (("name",), ("nominal_model",)):
            schemas[inner] = entry
    return schemas


FIELDS = _fields(_SCHEMA["properties"])
"""Schemas of all values by name."""
LAWS = {path for path in FIELDS if path[0] == "material"}
"""The values of the material's laws: coefficients and exponents."""


def value_of(path: Path) -> st.SearchStrategy[Any]:
    """Return values that the schema allows.

    Ends of the range are as frequent as values between, which are drawn evenly and by order of
    magnitude.
    """
    entry = FIELDS[path]
    if "enum" in entry:
        return st.sampled_from(entry["enum"])
    if entry["type"] == "boolean":
        return st.booleans()
    if entry["type"] == "string":
        return st.sampled_from(("EUR", "kr"))
    if entry["type"] == "array":
        return st.lists(st.floats(0.01, 50.0), max_size=16).map(tuple)
    low = entry["minimum"]
    high = entry["maximum"]
    if entry["type"] == "integer":
        # Ten thousand sub-steps differ from a hundred only in the time that they take.
        high = min(high, 100)
        return st.sampled_from((low, high)) | st.integers(low, high)

    between = st.floats(low, high)
    if low >= 0:
        # A range that starts at 0 has no lowest order of magnitude: six are enough.
        lowest_order = math.log10(max(low, 1e-6 * high))
        orders = st.floats(lowest_order, math.log10(high))
        between |= orders.map(lambda order: min(max(10.0**order, low), high))
    return st.sampled_from((float(low), float(high))) | between


@st.composite
def values(draw: st.DrawFn, laws: bool = False) -> dict[str, Any]:
    """Return the values of a preset with some replaced, which need not be consistent.

    With ``laws``, those of the material are replaced, too.
    """
    base = BASES[draw(st.sampled_from(sorted(BASES)))]
    changed = deepcopy(base) | {"name": "drawn"}
    allowed = sorted(path for path in FIELDS if laws or path not in LAWS)
    max_changes = min(draw(st.sampled_from((3, 12, len(allowed)))), _MAX_CHANGES)
    paths = st.lists(st.sampled_from(allowed), unique=True, max_size=max_changes)
    for path in draw(paths):
        _put(changed, path, draw(value_of(path)))
    return changed


def scenarios() -> st.SearchStrategy[Scenario]:
    """Return scenarios with consistent values and the materials of presets."""
    return values().map(reconciled).map(Scenario.model_validate)


def reconciled(drawn: dict[str, Any]) -> dict[str, Any]:
    """Return the values, changed where they contradict one another."""
    changed = deepcopy(drawn)
    # In this order: each function reads what those before it have changed.
    for name in ("cutting_speed", "feed"):
        _reconcile_range(changed, name)
    _reconcile_wear_and_times(changed)
    _reconcile_actions(changed)
    _reconcile_laws(changed)
    _reconcile_spindle(changed)
    _reconcile_depth_profile(changed["workpiece"])
    _reconcile_holder(changed["tool"])
    _sort(changed["surface"], "reference")
    _sort(changed["swarf"], "chip_feed")
    _sort(changed["swarf"], "chip_depth")
    return changed


def _sort(section: dict[str, Any], name: str) -> None:
    """Exchange the ends of a range if they are the wrong way round."""
    low, high = sorted((section[f"{name}_min"], section[f"{name}_max"]))
    section[f"{name}_min"] = low
    section[f"{name}_max"] = high


def _reconcile_range(changed: dict[str, Any], name: str) -> None:
    """Give the machine a range of speed or feed, with the initial one in it."""
    machine = changed["machine"]
    control = changed["control"]
    lowest = FIELDS["machine", f"{name}_min"]["minimum"]
    low, high = sorted((machine[f"{name}_min"], machine[f"{name}_max"]))
    if low == high:
        # An empty range is widened downwards, or upwards where that is too low.
        if 0.5 * high >= lowest:
            low = 0.5 * high
        else:
            high = 2.0 * high
    machine[f"{name}_min"] = low
    machine[f"{name}_max"] = high
    control[f"initial_{name}"] = min(max(control[f"initial_{name}"], low), high)


def _reconcile_wear_and_times(changed: dict[str, Any]) -> None:
    control = changed["control"]
    machine = changed["machine"]
    criterion = changed["tool"]["wear_criterion"]
    if changed["mismatch"]["initial_wear"] >= criterion:
        changed["mismatch"]["initial_wear"] = 0.0
    failure = changed["edge_failure"]
    failure["tertiary_rate"] = min(failure["tertiary_rate"], _MAX_LOG_GROWTH / criterion)
    if control["time_limit"] * 60.0 < control["interval"]:
        control["interval"] = control["time_limit"] * 60.0
    machine["command_delay"] = min(machine["command_delay"], 4.0 * control["interval"])


def _reconcile_actions(changed: dict[str, Any]) -> None:
    """Keep overrides within the machine's feed, and actions of parts free of lags."""
    control = changed["control"]
    machine = changed["machine"]
    sensors = changed["sensors"]
    if control["action"] == "override":
        highest = machine["feed_max"] / control["initial_feed"]
        control["override_max"] = min(control["override_max"], highest)
        if control["override_max"] < 0.01:
            control["action"] = "set_point"
    if control["action"] == "part":
        for name in ("feed_time_constant", "spindle_time_constant", "chip_lag", "command_delay"):
            machine[name] = 0.0
        for name in ("power_time_constant", "force_time_constant"):
            sensors[name] = 0.0
        changed["workpiece"]["bars"] = max(changed["workpiece"]["bars"], 1)
        control["edge_changes"] = "automatic"
    else:
        sensors["probe"] = False
    sensors["inspects_edges"] &= control["edge_changes"] != "end"


def _reconcile_laws(changed: dict[str, Any]) -> None:
    """Set exponents to 0 that a law may not have, and others to values that it may."""
    laws = changed["material"]
    laws["wear"] |= {"wear": 0.0, "wear_growth": 0.0}
    for name in ("thrust_force", "power"):
        law = laws[name]
        law["time"] = 0.0
        if law["wear_growth"] > 0.0:
            law["wear"] = law["wear"] or 1.0
    laws["wear"]["time"] = abs(laws["wear"]["time"]) or 0.245
    changed["edge_failure"]["temperature"] |= {"time": 0.0, "wear_growth": 0.0}
    for name in ("radial_force", "torque", "roughness"):
        law = changed["limits"][name]
        law |= {
            "cutting_speed": 0.0,
            "time": 0.0,
            "wear": 0.0,
            "wear_growth": 0.0,
        }
        law["feed"] = min(abs(law["feed"]) or 0.75, _MAX_EXPONENT)
        for factor in ("depth_of_cut", "hardness"):
            law[factor] = min(max(law[factor], -_MAX_EXPONENT), _MAX_EXPONENT)


def _reconcile_spindle(changed: dict[str, Any]) -> None:
    """Let the spindle reach the initial speed, and idle within its power."""
    spindle = changed["spindle"]
    diameter = changed["workpiece"]["diameter"]
    per_turn = math.pi * diameter / 1000.0  # [m]
    if per_turn * spindle["max_speed"] < changed["control"]["initial_cutting_speed"]:
        spindle["max_speed"] = 0.0
    fastest = max(changed["machine"]["cutting_speed_max"], per_turn * spindle["base_speed"])
    max_torque = 15.0 * diameter * changed["limits"]["power"] / fastest
    spindle["idle_torque"] = min(spindle["idle_torque"], max_torque)


def _reconcile_depth_profile(work: dict[str, Any]) -> None:
    """Give every section of the bar a length and a speed, if any has."""
    sections = len(work["depth_profile"])
    if work["section_lengths"]:
        work["section_lengths"] = (work["bar_length"] / max(sections, 1),) * sections
    work["section_speeds"] = (work["section_speeds"] * sections)[:sections]


def _reconcile_holder(tool: dict[str, Any]) -> None:
    """Give a holder that is longer than 0 a shank."""
    if tool["overhang"] > 0.0:
        tool["shank_diameter"] = tool["shank_diameter"] or 25.0


def _put(tree: dict[str, Any], path: Path, value: Any) -> None:
    for name in path[:-1]:
        tree = tree[name]
    tree[path[-1]] = value
