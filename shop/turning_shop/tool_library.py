"""Read and write tools: CSV, FreeCAD's tool bits, and GTC or ISO 13399 files in P21.

Only what advice needs is read: designation, grade, nose radius, length of the edge, and start
values. A designation of ISO 1832 gives the lengths that a file lacks, and must agree with those
that it has.

* FreeCAD: a tool bit is JSON (``.fctb``, version 2). Inserts have the shapes ``Iso_Shape_C``, D, S
  and T with EdgeLength, TipAngle and TipRadius, as in FreeCAD's ``iso_shape_c.fctb``. Start values
  are presets, as ``Path/Tool/FeedsSpeeds/presets.py`` there describes them; that they stand under
  ``presets`` is an assumption.
* P21 (ISO 10303-21): values are ``NUMERICAL_VALUE(name, digits, unit, number)`` and
  ``STRING_VALUE(name, #text)``; names are symbols of ISO 13399: RE (nose radius), L or LE (length
  of the edge), GRADE, MC or the item's name (designation).
"""

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from turning_shop import WorkshopError, regular_file
from turning_shop.catalogue.inserts import Insert, read_insert

MAX_BYTES = 20_000_000  # of a file
MAX_TOOLS = 10_000  # of a file
TOLERANCE = 0.05  # share by which lengths of file and designation may differ [-]
MIN_TOLERANCE = 0.11  # the same in absolute terms: files round to 0.1 [mm]
INCH = 25.4  # [mm]


@dataclass(frozen=True)
class Tool:
    """An insert, and start values for it; NaN or an empty text where they are unknown."""

    designation: str  # ISO 1832, or the maker's own
    grade: str = ""
    material: str = ""  # of the workpiece, for which the start values are
    nose_radius: float = math.nan  # [mm]
    edge_length: float = math.nan  # [mm]
    cutting_speed: float = math.nan  # [m/min]
    feed: float = math.nan  # [mm/rev]
    depth_of_cut: float = math.nan  # [mm]
    diameter: float = math.nan  # of the bar [mm]


UNITS = {
    "nose_radius": "mm",
    "edge_length": "mm",
    "cutting_speed": "m/min",
    "feed": "mm/rev",
    "depth_of_cut": "mm",
    "diameter": "mm",
}
FIELDS = tuple(item.name for item in fields(Tool))
HEADERS = [f"{name} [{UNITS[name]}]" if name in UNITS else name for name in FIELDS]
NAMES = {
    "designation": ("designation", "insert", "tool", "name", "iso", "bezeichnung"),
    "grade": ("grade", "sorte"),
    "material": ("material", "work material", "werkstoff"),
    "nose_radius": ("nose radius", "corner radius", "re", "tip radius", "eckenradius"),
    "edge_length": ("edge length", "cutting edge length", "l", "le", "schneidkantenlaenge"),
    "cutting_speed": ("cutting speed", "vc", "surface speed"),
    "feed": ("feed", "f", "fn", "vorschub"),
    "depth_of_cut": ("depth of cut", "ap"),
    "diameter": ("diameter", "d", "workpiece diameter"),
}
"""Headers of a CSV file, in small letters and without units."""


def read_tools(path: Path) -> list[Tool]:
    """Return the tools of a file; its suffix tells the format.

    Raises:
        WorkshopError: The format is unknown, or the file is none of it; a value is no number, or
            contradicts the designation.
        OSError: The file cannot be read.
    """
    readers = {
        ".csv": _tools_of_csv,
        ".fctb": _tools_of_toolbit,
        ".p21": _tools_of_p21,
        ".stp": _tools_of_p21,
    }
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise WorkshopError(f"{path}: the suffix must be one of {', '.join(readers)}")
    data = regular_file(path, MAX_BYTES).read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    try:
        return [completed(tool) for tool in readers[suffix](text)]
    except WorkshopError as error:
        raise WorkshopError(f"{path}: {error}") from error


def insert_of(tool: Tool) -> Insert | None:
    """Return the insert of a tool's designation; None if it is the maker's own."""
    try:
        return read_insert(tool.designation)
    except WorkshopError:
        return None


def completed(tool: Tool) -> Tool:
    """Return a tool with the lengths that its designation tells.

    WorkshopError if the tool has none, or its lengths are others.
    """
    if not tool.designation:
        raise WorkshopError("a tool has no designation")
    insert = insert_of(tool)
    if insert is None:
        return tool
    lengths = {"nose_radius": insert.nose_radius, "edge_length": insert.edge_length}
    for name, length in lengths.items():
        stated = getattr(tool, name)
        if math.isnan(stated):
            lacking: dict[str, Any] = {name: length}
            tool = replace(tool, **lacking)
        elif abs(stated - length) > max(TOLERANCE * length, MIN_TOLERANCE):
            raise WorkshopError(
                f"{tool.designation}: {name} is {stated:g} mm, but the designation says "
                f"{length:.3g} mm"
            )
    return tool


def _tools_of_csv(text: str) -> Iterator[Tool]:
    """Yield the tools of a table with one tool per row, in the columns of ``NAMES``."""
    first_line, _, _ = text.partition("\n")
    separator = max(",;\t", key=first_line.count)
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    header = next(rows, [])
    if not any(header):
        raise WorkshopError("is empty: a header and rows of tools are needed")
    places: dict[int, str] = {}
    for place, cell in enumerate(header):
        name = _field_of(cell)
        if name is not None and name not in places.values():
            places[place] = name
    if "designation" not in places.values():
        raise WorkshopError(
            f"no column designation; it has {', '.join(header)[:200]}, "
            f"and the columns understood are {', '.join(HEADERS)}"
        )
    for number, cells in enumerate(rows, 2):
        if number > MAX_TOOLS:
            raise WorkshopError(f"more than {MAX_TOOLS} tools")
        if not any(cell.strip() for cell in cells):
            continue
        values: dict[str, Any] = {}
        for place, name in places.items():
            cell = cells[place].strip() if place < len(cells) else ""
            values[name] = cell
            if name in UNITS:
                values[name] = _number(cell, f"line {number}, {name}")
        yield Tool(**values)


def _field_of(header: str) -> str | None:
    """Return the field that a header names; WorkshopError if it is in another unit."""
    bracketed = re.fullmatch(r"\s*(.*?)\s*(?:[\[(]\s*(.*?)\s*[\])])?\s*", header)
    if bracketed is None:
        return None
    plain = re.sub(r"[\s_.]+", " ", bracketed[1].casefold()).strip()
    unit = (bracketed[2] or "").replace(" ", "")
    for name, aliases in NAMES.items():
        spelled = name.replace("_", " ")
        if plain == spelled or plain in aliases:
            expected = UNITS.get(name)
            if unit and unit != expected:
                raise WorkshopError(f"column {header!r}: the unit must be {expected}")
            return name
    return None


def _number(text: str, where: str) -> float:
    """Return a number, NaN for an empty text; decimals may have a comma."""
    if not text:
        return math.nan
    try:
        value = float(text.replace(",", "."))
    except ValueError as error:
        raise WorkshopError(f"{where}: {text[:40]!r} is not a number") from error
    if not 0.0 < value < 1e5:
        raise WorkshopError(f"{where}: {value:g} must be above 0")
    return value


def _tools_of_toolbit(text: str) -> Iterator[Tool]:
    """Yield the tool of a FreeCAD tool bit, once for each preset with a cutting speed."""
    try:
        bit = json.loads(text)
        name = str(bit["name"])
        parameters = dict(bit["parameter"])
        presets = list(bit.get("presets") or [])
    except (ValueError, KeyError, TypeError) as error:
        raise WorkshopError(f"this is no tool bit of FreeCAD: {error!r}") from error
    tool = Tool(
        designation=name,
        nose_radius=_length(parameters.get("TipRadius"), "TipRadius"),
        edge_length=_length(parameters.get("EdgeLength"), "EdgeLength"),
    )
    if not presets:
        yield tool
    for preset in presets:
        hint = preset.get("material_hint") or {}
        notes = str(preset.get("notes") or "")
        yield replace(
            tool,
            grade=_noted("grade", notes),
            material=str(hint.get("name") or ""),
            cutting_speed=_number(str(preset.get("surface_speed") or ""), "surface_speed"),
            feed=_number(str(preset.get("chipload") or ""), "chipload"),
            depth_of_cut=_number(_noted("depth", notes), "depth"),
            diameter=_number(_noted("diameter", notes), "diameter"),
        )


def _noted(name: str, notes: str) -> str:
    """Return what the notes of a preset say of a name; see ``_preset``."""
    match = re.search(rf"\b{name} ([\w.]+)", notes)
    return match[1] if match else ""


def _length(value: Any, where: str) -> float:
    """Return a length of FreeCAD, such as "6.35 mm" or '0.25 in' [mm]."""
    if value is None:
        return math.nan
    match = re.fullmatch(r"\s*(?P<number>[\d.]+)\s*(?P<unit>mm|in|\")?\s*", str(value))
    if match is None:
        raise WorkshopError(f"{where} is {value!r}, but must be a length such as '6.35 mm'")
    factor = INCH if match["unit"] in ("in", '"') else 1.0
    return factor * _number(match["number"], where)


_ENTITY = re.compile(r"#(\d+)\s*=\s*([A-Z_0-9]+)\s*\((.*?)\)\s*;", re.DOTALL)
_PARAMETER = re.compile(r"'(?:[^']|'')*'|\((?:[^()']|'(?:[^']|'')*')*\)|[^,]+")
SYMBOLS = {
    "RE": "nose_radius",
    "L": "edge_length",
    "LE": "edge_length",
    "GRADE": "grade",
    "MC": "designation",
}
"""Fields by the symbols of ISO 13399."""


def _tools_of_p21(text: str) -> Iterator[Tool]:
    """Yield the tool of a P21 file."""
    if not text.lstrip().startswith("ISO-10303-21"):
        raise WorkshopError("this is no P21 file: it must begin with ISO-10303-21")
    entities = {}
    for number, kind, inner in _ENTITY.findall(text):
        parts = [part.strip() for part in _PARAMETER.findall(inner)]
        entities[f"#{number}"] = (kind, parts)
    values: dict[str, Any] = {}
    item = ""
    for kind, parameters in entities.values():
        if kind == "ITEM" and len(parameters) >= 3:
            item = _text(parameters[2], entities) or _text(parameters[0], entities)
        symbol = ""
        if parameters:
            symbol = _text(parameters[0], entities).upper()
        name = SYMBOLS.get(symbol)
        if name is None or name in values:
            continue
        if kind == "NUMERICAL_VALUE" and len(parameters) == 4 and name in UNITS:
            number = _number(parameters[3].strip("'"), symbol)
            factor = INCH if _is_inch(parameters[2], entities) else 1.0
            values[name] = factor * number
        elif kind == "STRING_VALUE" and len(parameters) >= 2 and name not in UNITS:
            values[name] = _text(parameters[1], entities)
    designation = values.pop("designation", "") or item
    if not designation or not values:
        raise WorkshopError("it has no item with a nose radius (RE), an edge (L, LE) or a grade")
    yield Tool(designation=designation, **values)


def _text(parameter: str, entities: dict[str, tuple[str, list[str]]]) -> str:
    """Return a text, also behind references to texts in languages."""
    for _ in range(4):  # a reference leads to a text in at most three steps
        if parameter.startswith("'"):
            return parameter[1:-1].replace("''", "'").strip()
        kind, parameters = entities.get(parameter, ("", []))
        if kind == "STRING_WITH_LANGUAGE" and parameters:
            parameter = parameters[0]
        elif kind == "MULTI_LANGUAGE_STRING" and len(parameters) >= 2:
            parameter = parameters[1]
        else:
            return ""
    return ""


def _is_inch(parameter: str, entities: dict[str, tuple[str, list[str]]]) -> bool:
    """Return whether a unit is the inch."""
    _, parameters = entities.get(parameter, ("", []))
    return any(_text(part, entities).lower() in ("in", "inch") for part in parameters)


def csv_of(tools: Sequence[Tool]) -> str:
    """Return a CSV table of tools."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(HEADERS)
    for tool in tools:
        writer.writerow([_cell(getattr(tool, name)) for name in FIELDS])
    return file.getvalue()


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    return "" if math.isnan(value) else f"{value:.4g}"


TIP_ANGLES = {"C": 80.0, "D": 55.0, "S": 90.0, "T": 60.0}
"""Tip angles of the shapes of FreeCAD's inserts [degrees]."""


def toolbit_of(tools: Sequence[Tool]) -> str:
    """Return FreeCAD's tool bit of an insert, with a preset for each of its start values.

    ``tools`` have the same designation.

    Raises:
        WorkshopError: The designation is not one of ISO 1832, or FreeCAD has no such shape.
    """
    tool = tools[0]
    insert = insert_of(tool)
    letter = tool.designation[:1].upper()
    if insert is None or letter not in TIP_ANGLES:
        raise WorkshopError(
            f"{tool.designation}: FreeCAD has inserts of the shapes {', '.join(TIP_ANGLES)} "
            "(first letter of ISO 1832)"
        )
    bit: dict[str, Any] = {
        "version": 2,
        "id": re.sub(r"[^a-z0-9]+", "_", f"{tool.designation}_{tool.grade}".lower()).strip("_"),
        "name": tool.designation,
        "shape": f"Iso_Shape_{letter}.fcstd",
        "parameter": {
            "EdgeLength": f"{insert.edge_length:.2f} mm",
            "TipAngle": f"{TIP_ANGLES[letter]:.2f} °",
            "TipRadius": f"{insert.nose_radius:.2f} mm",
            "Material": "Carbide",
        },
        "attribute": {},
    }
    presets = [_preset(other) for other in tools if not math.isnan(other.cutting_speed)]
    if presets:
        bit["presets"] = presets
    return json.dumps(bit, indent=2, ensure_ascii=False) + "\n"


def _preset(tool: Tool) -> dict[str, Any]:
    """Return the preset of a tool; the notes hold what FreeCAD has no field for."""
    notes = [f"grade {tool.grade}"] if tool.grade else []
    for name, value in (("depth", tool.depth_of_cut), ("diameter", tool.diameter)):
        if not math.isnan(value):
            notes.append(f"{name} {value:g} mm")
    return {
        "name": f"turning {tool.material}".strip(),
        "material_hint": {"uuid": None, "name": tool.material} if tool.material else None,
        "op_type_hint": None,
        "surface_speed": tool.cutting_speed,
        "chipload": None if math.isnan(tool.feed) else tool.feed,
        "vert_feed_ratio": 1.0,
        "notes": f"turning: {', '.join(notes)}" if notes else "turning",
    }
