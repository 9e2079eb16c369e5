"""Read and write tables of tools as CSV.

Only what advice needs is read: designation, grade, nose radius, length of the edge, and start
values. A designation of ISO 1832 gives the lengths that a table lacks, and must agree with those
that it has.
"""

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from turning_shop import WorkshopError
from turning_shop.catalogue.inserts import Insert, read_insert

from turning_env.files import read_regular

MAX_BYTES = 20_000_000  # of a file
MAX_TOOLS = 10_000  # of a file
TOLERANCE = 0.05  # share by which lengths of file and designation may differ [-]
MIN_TOLERANCE = 0.11  # the same in absolute terms: files round to 0.1 [mm]


@dataclass(frozen=True)
class LibraryTool:
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
FIELDS = tuple(item.name for item in fields(LibraryTool))
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


def read_tools(path: Path) -> list[LibraryTool]:
    """Return the tools of a CSV table, one per row, in the columns of ``NAMES``.

    Raises:
        WorkshopError: The file is no such table; a value is no number, or contradicts the
            designation.
        OSError: The file cannot be read.
    """
    if path.suffix.lower() != ".csv":
        raise WorkshopError(f"{path}: tools are read from .csv and a scenario's .toml")
    data = read_regular(path, MAX_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    try:
        return [completed(tool) for tool in _tools_of_csv(text)]
    except WorkshopError as error:
        raise WorkshopError(f"{path}: {error}") from error


def insert_of(tool: LibraryTool) -> Insert | None:
    """Return the insert of a tool's designation; None if it is the maker's own."""
    try:
        return read_insert(tool.designation)
    except WorkshopError:
        return None


def completed(tool: LibraryTool) -> LibraryTool:
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


def _tools_of_csv(text: str) -> Iterator[LibraryTool]:
    """Yield the tools of a table."""
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
        yield LibraryTool(**values)


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


def csv_of(tools: Sequence[LibraryTool]) -> str:
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
