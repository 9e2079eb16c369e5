"""Read a sheet of measurements: a CSV file with a header, one cut or sample per row and one quantity per column."""

import csv
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turning_env.workshop import WorkshopError


class Column(NamedTuple):
    """A quantity and its range of plausible values [unit], ends included; a value outside is probably in another unit."""

    unit: str
    low: float
    high: float
    meaning: str


COLUMNS = {
    "cutting_speed": Column("m/min", 0.1, 5000, "cutting speed"),
    "feed": Column("mm/rev", 0.001, 10, "feed"),
    "depth_of_cut": Column("mm", 0.01, 50, "depth of cut"),
    "time": Column("min", 1e-4, 1e5, "cutting time since the edge was fresh, all at this speed, feed and depth"),
    "wear": Column("mm", 1e-4, 5, "flank wear of the edge since it was fresh"),
    "thrust_force": Column("N", 1e-3, 1e6, "thrust force"),
    "power": Column("kW", 1e-4, 1e4, "spindle power"),
    "hardness": Column("-", 0.1, 10, "hardness of the bar over nominal hardness: 1 is nominal"),
}
"""Every column of numbers of a sheet of cuts."""

EDGE = "edge"
"""A further, optional column: the name of the cutting edge. A row with an empty cell has an edge of its own."""

REQUIRED = ("cutting_speed", "feed", "depth_of_cut")
"""Columns that every sheet of cuts must have."""

MAX_COMPLAINTS = 5
"""Number of wrong cells that an error lists; it only counts the others."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_WITH_COMMA = re.compile(r"[+-]?[\d.]*,[\d.,]*", re.ASCII)


@dataclass(frozen=True)
class Measurements:
    """A sheet of measurements."""

    columns: dict[str, NDArray[np.float64]]
    """Values of the columns that the file has, in the units of ``COLUMNS``, shape (rows,); NaN for an empty cell."""
    lines: NDArray[np.int64]
    """Line of each row in the file, counted from 1, shape (rows,)."""
    ignored: tuple[str, ...] = ()
    """Unknown columns, which are ignored."""
    edges: NDArray[np.int64] | None = None
    """Number of each row's edge, shape (rows,); None if the file has no column ``edge``."""


def read_measurements(
    path: str | os.PathLike[str], columns: Mapping[str, Column] = COLUMNS, required: Sequence[str] = REQUIRED
) -> Measurements:
    """Read a CSV file: commas between cells, points in decimals, UTF-8 with or without a byte order mark.

    Args:
        path: The file.
        columns: Columns that are understood, by default those of cuts.
        required: Columns that the file must have.

    Raises:
        WorkshopError: The file cannot be read or is not a table; a column is missing or occurs twice; a cell is not a number or
            is outside its column's range.
    """
    try:
        # newline="" is needed for files of old spreadsheets, whose lines end in "\r" alone.
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            return _parse(csv.reader(file, strict=True), str(path), columns, required)
    except OSError as error:
        raise WorkshopError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise WorkshopError(f"{path} is not text in UTF-8: save the sheet as CSV, in UTF-8") from error
    except csv.Error as error:
        raise WorkshopError(f"{path} is not CSV: {error}") from error
    except ValueError as error:
        if isinstance(error, WorkshopError):
            raise
        raise WorkshopError(f"{str(path)!r} cannot be read: {error}") from error  # a zero byte in the path


def _parse(reader: Any, source: str, columns: Mapping[str, Column], required: Sequence[str]) -> Measurements:
    header = next((row for row in reader if any(cell.strip() for cell in row)), None)
    if header is None:
        raise WorkshopError(f"{source} is empty: a header and rows of measurements are needed")
    names = [cell.strip() for cell in header]
    _check_header(names, source, columns, required)
    known = [(index, name) for index, name in enumerate(names) if name in columns]
    values: dict[str, list[float]] = {name: [] for _, name in known}
    lines: list[int] = []
    edges: list[str] = []
    complaints: list[str] = []
    for row in reader:
        if not any(cell.strip() for cell in row):
            continue
        lines.append(reader.line_num)
        if len(row) != len(names):
            complaints.append(f"line {reader.line_num} has {len(row)} cells, but the header has {len(names)}")
            continue
        # A row without a name gets an edge of its own, under a name that no cell can hold.
        edges.append((row[names.index(EDGE)].strip() if EDGE in names else "") or f"\n{len(lines)}")
        for index, name in known:
            try:
                values[name].append(_number(row[index].strip(), columns[name]))
            except ValueError as error:
                complaints.append(f"line {reader.line_num}, column {name}: {error}")
    if complaints:
        more = len(complaints) - MAX_COMPLAINTS
        shown = "; ".join(complaints[:MAX_COMPLAINTS]) + (f"; and {more} more like these" if more > 0 else "")
        raise WorkshopError(f"{source}: {shown}")
    if not lines:
        raise WorkshopError(f"{source} has a header but no rows of measurements")
    ignored = tuple(name for name in names if name not in columns and name != EDGE)
    numbers = np.unique(edges, return_inverse=True)[1] if EDGE in names else None
    return Measurements({name: np.array(column) for name, column in values.items()}, np.array(lines), ignored, numbers)


def _check_header(names: Sequence[str], source: str, columns: Mapping[str, Column], required: Sequence[str]) -> None:
    if missing := [name for name in required if name not in names]:
        for separator, called in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
            if separator in ",".join(names):
                raise WorkshopError(
                    f"{source}: cells are separated by {called}: save it with commas between cells, and points in decimals"
                )
        present = ", ".join(repr(name[:40]) for name in names[:20]) + (", ..." if len(names) > 20 else "")
        understood = ", ".join(f"{name} [{column.unit}]" for name, column in columns.items())
        raise WorkshopError(
            f"{source}: no column {', '.join(missing)}; it has {present}, and the columns understood are {understood}"
            + (f", {EDGE}" if columns is COLUMNS else "")
        )
    if twice := [name for name in (*columns, EDGE) if names.count(name) > 1]:
        raise WorkshopError(f"{source}: there is more than one column {', '.join(twice)}")


def _number(cell: str, column: Column) -> float:
    """Return the number in a cell, NaN if it is empty; the ValueError says what is wrong."""
    if not cell:
        return float("nan")
    if _WITH_COMMA.fullmatch(cell):
        raise ValueError(f"{cell[:40]!r} has a comma: write decimals with a point, and thousands without a separator")
    allowed = f"{column.low:g} to {column.high:g} {column.unit} ({column.meaning})"
    if not _NUMBER.fullmatch(cell):
        raise ValueError(f"{cell[:40]!r} is not a number; allowed is {allowed}, or nothing")
    value = float(cell)
    if not column.low <= value <= column.high:
        raise ValueError(f"{cell[:40]} is outside the allowed range {allowed}")
    return value
