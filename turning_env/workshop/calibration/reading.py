"""Reads a table of measurements: one cut per row, one quantity per column, CSV with a header."""

import csv
import difflib
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.workshop.calibration.columns import COLUMNS, EDGE, REQUIRED, MeasurementError

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_WITH_COMMA = re.compile(r"[+-]?[\d.]*,[\d.,]*", re.ASCII)
MAX_COMPLAINTS = 5
"""So many wrong cells are named before the rest are only counted."""


@dataclass(frozen=True)
class Measurements:
    """A table that has been read."""

    columns: dict[str, NDArray[np.float64]]
    """Values by the names of ``COLUMNS``, those that the file has, shape (rows,); NaN where a cell is empty."""
    lines: NDArray[np.int64]
    """Where each row stands in the file, the first line being 1, shape (rows,)."""
    ignored: tuple[str, ...] = ()
    """Columns of other names."""
    edges: NDArray[np.int64] | None = None
    """A number for the edge of each row, shape (rows,); None if the file does not name edges."""


def read_measurements(path: str | os.PathLike[str]) -> Measurements:
    """The measurements of a CSV file: commas between cells, points in decimals, UTF-8 with or without a byte order mark.

    Raises:
        MeasurementError: no such file; no table in it; a column is missing or there twice; a cell is not a number or lies
            outside of what is believed of its quantity (``COLUMNS``).
    """
    try:
        # Some writers end lines by "\r" alone; the csv module splits lines itself.
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            return _parse(csv.reader(file, strict=True), str(path))
    except OSError as error:
        raise MeasurementError(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        if isinstance(error, MeasurementError):
            raise
        if isinstance(error, UnicodeDecodeError):
            raise MeasurementError(f"{path} is not text in UTF-8: save the sheet as CSV, in UTF-8") from error
        raise MeasurementError(f"{str(path)!r} cannot be read: {error}") from error  # a zero byte in the path
    except csv.Error as error:
        raise MeasurementError(f"{path} is not CSV: {error}") from error


def _parse(reader: Any, source: str) -> Measurements:
    header = next((row for row in reader if any(cell.strip() for cell in row)), None)
    if header is None:
        raise MeasurementError(f"{source} is empty: a header and rows of measurements are needed")
    names = [cell.strip() for cell in header]
    _check_header(names, source)
    known = [(index, name) for index, name in enumerate(names) if name in COLUMNS]
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
        # A row that does not say is of an edge of its own, which no other text can name.
        edges.append((row[names.index(EDGE)].strip() if EDGE in names else "") or f"\n{len(lines)}")
        for index, name in known:
            try:
                values[name].append(_value(row[index].strip(), name))
            except ValueError as error:
                complaints.append(f"line {reader.line_num}, column {name}: {error}")
    if complaints:
        shown, more = complaints[:MAX_COMPLAINTS], len(complaints) - MAX_COMPLAINTS
        raise MeasurementError(f"{source}: " + "; ".join(shown) + (f"; and {more} more like these" if more > 0 else ""))
    if not lines:
        raise MeasurementError(f"{source} has a header but no rows of measurements")
    ignored = tuple(name for name in names if name not in COLUMNS and name != EDGE)
    numbered = np.unique(edges, return_inverse=True)[1] if EDGE in names else None
    return Measurements({name: np.array(column) for name, column in values.items()}, np.array(lines), ignored, numbered)


def _check_header(names: Sequence[str], source: str) -> None:
    missing = [name for name in REQUIRED if name not in names]
    if missing:
        text = ",".join(names)
        for separator, called in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
            if separator in text:
                raise MeasurementError(
                    f"{source}: cells are separated by {called}: save it with commas between cells, and points in decimals"
                )
        raise MeasurementError(f"{source}: no column {', '.join(missing)}; it has {_quoted(names)}, and {_allowed()}")
    twice = [name for name in (*COLUMNS, EDGE) if names.count(name) > 1]
    if twice:
        raise MeasurementError(f"{source}: there is more than one column {', '.join(twice)}")


def meant(name: str) -> str | None:
    """The column that somebody who wrote this name may have meant, if any is like it."""
    return next(iter(difflib.get_close_matches(name.lower(), COLUMNS, n=1, cutoff=0.75)), None)


def _quoted(names: Iterable[str]) -> str:
    shown = [repr(name[:40]) for name in names]
    return ", ".join(shown[:20]) + (", ..." if len(shown) > 20 else "")


def _allowed() -> str:
    return "the columns understood are " + ", ".join(f"{name} [{column.unit}]" for name, column in COLUMNS.items()) + f", {EDGE}"


def _value(cell: str, name: str) -> float:
    """The number in a cell, NaN if it is empty; ValueError says what is wrong."""
    if not cell:
        return float("nan")
    if _WITH_COMMA.fullmatch(cell):
        raise ValueError(f"{cell[:40]!r} has a comma: decimals are written with a point, and thousands without anything")
    column = COLUMNS[name]
    allowed = f"{column.low:g} to {column.high:g} {column.unit} ({column.meaning})"
    if not _NUMBER.fullmatch(cell):
        raise ValueError(f"{cell[:40]!r} is not a number; allowed is {allowed}, or nothing")
    value = float(cell)
    if not column.low <= value <= column.high:
        raise ValueError(f"{cell[:40]} is outside the allowed range {allowed}")
    return value
