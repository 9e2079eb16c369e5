"""Read a sheet of measurements: CSV or XLSX with a header and one cut per row.

Lines above the header, a row of units below it and rows of means are recognised, and named in
``Measurements.readings``. ``headers.py`` recognises columns and units; ``plausibility.py`` checks
what the numbers mean.
"""

import csv
import importlib
import io
import itertools
import os
import re
import zipfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_shop import WorkshopError
from turning_shop.headers import (
    COLUMNS,
    CONVERSIONS,
    EDGE,
    MAX_NUMBERS,
    NAMES,
    Column,
    Heading,
    is_header,
    is_unit,
    plausible_units,
    read_heading,
)

from turning_env.extras import missing
from turning_env.files import read_regular

REQUIRED = ("cutting_speed", "feed", "depth_of_cut")  # columns that every sheet of cuts must have
FORCES = ("main_force", "feed_force", "back_force", "thrust_force")
# Largest size of a file, and of all parts of a workbook when unpacked [bytes].
MAX_BYTES = 50_000_000
MAX_ROWS = 100_000  # largest number of rows of a sheet
MAX_CELLS = 200  # largest number of cells of a row
MAX_TAGS = 3_000_000  # largest number of XML tags of a workbook, of which a cell has four
MAX_ABOVE = 20  # number of rows among which the header is looked for
STATISTICS = {
    "mean",
    "average",
    "avg",
    "mittel",
    "mittelwert",
    "durchschnitt",
    "ø",
    "sum",
    "summe",
    "total",
    "median",
    "std",
    "sd",
    "stdev",
    "std dev",
    "standard deviation",
    "standardabweichung",
    "stabw",
}
"""Cells, in small letters, of a row that sums up others."""
NOTHING = ("", "-", "\N{EN DASH}", "n/a", "n.a.", "k.a.", "k. a.", "na", "nan", "#n/a", "#nv")
"""Cells, in small letters, of numbers that were not measured."""
MAX_COMPLAINTS = 5  # number of wrong cells that an error lists; it only counts the others
MAX_SHOWN = 20  # number of headers that an error lists
MAX_LETTERS = 40  # number of letters of a header or cell that an error quotes
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d*([eE][+-]?\d+)?", re.ASCII)
_WITH_COMMA = re.compile(r"[+-]?[\d.]*,[\d.,]*", re.ASCII)
_SEPARATORS = ",;\t|"


class _Stated(NamedTuple):
    """Headers, units and constants that the user states, by the names of columns."""

    headers: Mapping[str, str]
    units: Mapping[str, str]
    constants: Mapping[str, float]  # in the units of ``COLUMNS``


class Row(NamedTuple):
    """A row of a sheet."""

    line: int  # in the file, counted from 1
    cells: list[str]


@dataclass(frozen=True)
class Measurements:
    """A sheet of measurements; arrays have the shape (rows,)."""

    columns: dict[str, NDArray[np.float64]]  # in the units of ``COLUMNS``; NaN for an empty cell
    lines: NDArray[np.int64]  # of the file, counted from 1
    ignored: tuple[str, ...] = ()  # unknown columns
    # Number of each row's edge; None if the file has no column ``EDGE``.
    edges: NDArray[np.int64] | None = None
    readings: tuple[str, ...] = ()  # how each column of the file was read


def read_measurements(
    path: str | os.PathLike[str],
    stated_headers: Mapping[str, str] = MappingProxyType({}),
    stated_units: Mapping[str, str] = MappingProxyType({}),
    constants: Mapping[str, float] = MappingProxyType({}),
) -> Measurements:
    """Read a sheet: XLSX, or text with cells between commas, semicolons, tabs or bars.

    Headers are names or symbols in English or German, with units or without (``headers.py``).
    ``stated_headers`` and ``stated_units`` hold the headers and the units of columns that the user
    states, where headers do not tell. ``constants`` are columns that the sheet lacks, which have
    one value in all rows, in the units of ``COLUMNS``.
    Decimals have a point, or a comma if text cells are not separated by commas. Text is UTF-8, or
    UTF-16 with a byte order mark, else Windows-1252.

    Raises:
        WorkshopError: The file cannot be read or is not a table; a column is missing or occurs
            twice; a cell is not a number or is outside its column's range.
    """
    source = str(path)
    stated = _Stated(stated_headers, units=stated_units, constants=constants)
    try:
        data = read_regular(Path(path), MAX_BYTES)
        if Path(path).suffix.lower() in (".xlsx", ".xlsm"):
            rows = _rows_of_workbook(data)
            return _parse(rows, source, stated, may_have_commas=False)
        text = _decoded(data)
        separator = max(_SEPARATORS, key=lambda mark: _most_understood(_rows(text, mark)))
        rows = _rows(text, separator)
        return _parse(rows, source, stated, may_have_commas=separator != ",")
    except OSError as error:
        raise WorkshopError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise WorkshopError(f"{path} is not text: save the sheet as CSV, in UTF-8") from error
    except csv.Error as error:
        raise WorkshopError(f"{path} is not CSV: {error}") from error


def _decoded(data: bytes) -> str:
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Windows-1252 decodes any bytes; text without a 0 byte probably is in it.
        if b"\0" in data:
            raise
        return data.decode("cp1252")


def _is_filled(cells: Sequence[str]) -> bool:
    return any(cell.strip() for cell in cells)


def _rows(text: str, separator: str) -> Iterator[Row]:
    """Yield the rows of a text that are not empty."""
    # newline="" is needed for files of old spreadsheets, whose lines end in "\r" alone.
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    for cells in reader:
        if _is_filled(cells):
            yield Row(reader.line_num, cells[:MAX_CELLS])


def _rows_of_workbook(data: bytes) -> Iterator[Row]:
    """Yield the rows of the first sheet of a workbook that are not empty."""
    try:
        openpyxl = importlib.import_module("openpyxl")
    except ModuleNotFoundError as error:
        raise WorkshopError(
            f"an XLSX sheet cannot be read, as {missing(error)}; or save it as CSV"
        ) from None
    try:
        _check_size(zipfile.ZipFile(io.BytesIO(data)))
        book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
        rows = book.worksheets[0].iter_rows(
            max_row=MAX_ROWS + 2, max_col=MAX_CELLS, values_only=True
        )
        table = [["" if cell is None else str(cell) for cell in row] for row in rows]
    # openpyxl lets through whatever zipfile, its parser of XML and its own checks raise.
    except Exception as error:
        raise WorkshopError(f"this is no workbook in XLSX: {error}") from error
    width = max((_filled_width(cells) for cells in table), default=0)
    for line, cells in enumerate(table, 1):
        padded = (cells + [""] * width)[:width]
        if _is_filled(padded):
            yield Row(line, padded)


def _check_size(parts: zipfile.ZipFile) -> None:
    """Raise an error if a workbook is too large when unpacked, as a small file may be."""
    unpacked = sum(part.file_size for part in parts.infolist())
    # The tags are counted last, as this unpacks the parts.
    if (
        unpacked > MAX_BYTES
        or sum(parts.read(part).count(b"<") for part in parts.infolist()) > MAX_TAGS
    ):
        megabytes = MAX_BYTES // 10**6
        millions = MAX_TAGS // 10**6
        raise ValueError(
            f"at most {megabytes} MB and {millions} million tags are read: save it as CSV"
        )


def _filled_width(cells: Sequence[str]) -> int:
    """Return the number of cells up to the last that is filled."""
    return max((place for place, cell in enumerate(cells, 1) if cell.strip()), default=0)


def _understood(cells: Sequence[str]) -> int:
    """Return how many columns a row names, also those that would be named with another unit."""
    names = set()
    for text in cells:
        try:
            names.add(read_heading(text).column)
        except WorkshopError:
            names.add(text)
    return len(names - {None})


def _most_understood(rows: Iterator[Row]) -> int:
    """Return how many columns the likeliest header of a sheet names."""
    first_rows = itertools.islice(rows, MAX_ABOVE)
    try:
        return max((_understood(row.cells) for row in first_rows), default=0)
    except csv.Error:
        return 0


@dataclass(frozen=True)
class _Table:
    """A header and the rows below it."""

    header: list[str]
    rows: list[Row]
    notes: list[str]  # how it was found


def _parse(
    rows: Iterator[Row], source: str, stated: _Stated, may_have_commas: bool
) -> Measurements:
    """Return the measurements in rows of cells, whose decimals may have commas."""
    # One row more than allowed, beside the header, is enough to tell that there are too many.
    filled = list(itertools.islice(rows, MAX_ROWS + 2))
    if len(filled) > MAX_ROWS + 1:
        raise WorkshopError(f"{source} has more than {MAX_ROWS} rows")
    table = _with_units(_below_header(filled))
    headings = _read_header(table, source, stated)
    table = _without_statistics(table)

    width = len(headings)
    complaints = []
    complete = []
    for row in table.rows:
        if len(row.cells) == width:
            complete.append(Row(row.line, [cell.strip() for cell in row.cells]))
        else:
            complaints.append(
                f"line {row.line} has {len(row.cells)} cells, but the header has {width}"
            )
    columns, wrong_cells = _numbers(complete, headings, may_have_commas)
    complaints += wrong_cells
    if complaints:
        is_crowded = any(len(row.cells) > width for row in table.rows)
        # Without quotes, a decimal comma between commas makes two cells of one number.
        hint = not may_have_commas and is_crowded
        listed = _listed(complaints, may_be_decimal_commas=hint)
        questions = "".join(_unit_questions(headings, complete))
        raise WorkshopError(f"{source}: {listed}{questions}")
    if not table.rows:
        raise WorkshopError(f"{source} has a header but no rows of measurements")

    for name, value in stated.constants.items():
        columns[name] = np.full(len(complete), value)
    notes = [*table.notes, *_constant_notes(stated.constants), *_add_resultants(columns)]
    # Columns that are not understood are in ``ignored``.
    readings = []
    for heading in headings:
        if heading.column or heading.other_meaning:
            readings.append(heading.describe())
    unknown = [heading.text for heading in headings if heading.column is None]
    return Measurements(
        columns=columns,
        lines=np.array([row.line for row in complete]),
        ignored=tuple(text for text in unknown if text),
        edges=_edges(complete, headings),
        readings=(*readings, *notes),
    )


def _constant_notes(constants: Mapping[str, float]) -> Iterator[str]:
    """Yield which columns are the same in all rows, as the user states."""
    for name, value in constants.items():
        yield f"{name} {value:g} {COLUMNS[name].unit} in all rows".replace(" -", "")


def _below_header(filled: Sequence[Row]) -> _Table:
    """Return the table below the row that names most columns; it is empty if there is no row."""
    if not filled:
        return _Table(header=[], rows=[], notes=[])
    understood = [_understood(row.cells) for row in filled[:MAX_ABOVE]]
    start = understood.index(max(understood))
    header = filled[start].cells
    width = len(header)
    notes = []
    if start:
        plural = "s" if start > 1 else ""
        notes.append(f"header in line {filled[start].line}, below {start} other row{plural}")
    rows = []
    for row in filled[start + 1 :]:
        # Empty cells beyond the header are left over from a separator at the end of the line.
        has_more = any(row.cells[width:])
        if not has_more:
            row = Row(row.line, row.cells[:width])
        rows.append(row)
    return _Table(header, rows, notes=notes)


def _with_units(table: _Table) -> _Table:
    """Return a table whose header holds the units that the row below it states, if this is one."""
    if not table.rows:
        return table
    line, cells = table.rows[0]
    if len(cells) != len(table.header):
        return table
    # A single unit may be a letter of another meaning, as the name of an edge, "s" or "h".
    number_of_units = sum(is_unit(cell) for cell in cells)
    if number_of_units < 2 or any(_is_number(cell) for cell in cells):
        return table
    header = []
    for text, cell in zip(table.header, cells, strict=True):
        unit = cell.strip(" []()")
        has_brackets = text.strip()[-1:] in tuple("])}>")
        if is_unit(unit) and not has_brackets:
            text = f"{text} [{unit}]"
        header.append(text)
    notes = [*table.notes, f"units in line {line}"]
    return _Table(header, table.rows[1:], notes=notes)


def _without_statistics(table: _Table) -> _Table:
    """Return a table without rows that sum up others, or hold no number at all."""
    kept = []
    lines = []
    for row in table.rows:
        if _sums_up(row.cells):
            lines.append(row.line)
        else:
            kept.append(row)
    if not lines:
        return table
    rows = f"{len(lines)} row{'s' if len(lines) > 1 else ''}"
    note = f"without {rows} of means, sums or text, the first in line {lines[0]}"
    return _Table(table.header, kept, notes=[*table.notes, note])


def _sums_up(cells: Sequence[str]) -> bool:
    """Return whether a row sums up others, or holds no number at all."""
    if not any(_is_number(cell) for cell in cells):
        return True
    for cell in cells:
        word = cell.strip(" :").casefold().replace(".", "")
        if word in STATISTICS:
            return True
    return False


def _is_number(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell.strip().replace(",", ".")))


def _numbers(
    rows: Sequence[Row], headings: Sequence[Heading], may_have_commas: bool
) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
    """Return each column's numbers, shape (rows,), and complaints about cells that hold none."""
    places = {}
    for place, heading in enumerate(headings):
        if heading.column in COLUMNS:
            places[place] = heading.column
    has_commas = may_have_commas and any(_has_decimal_comma(row.cells, places) for row in rows)
    columns = {name: np.empty(len(rows)) for name in places.values()}
    complaints = []
    for number, row in enumerate(rows):
        for place, name in places.items():
            heading = headings[place]
            try:
                columns[name][number] = _number(
                    row.cells[place], COLUMNS[name], factor=heading.factor, has_commas=has_commas
                )
            except ValueError as error:
                complaints.append(f"line {row.line}, column {heading.text}: {error}")
    return columns, complaints


def _has_decimal_comma(cells: Sequence[str], places: Collection[int]) -> bool:
    return any(_DECIMAL_COMMA.fullmatch(cells[place]) for place in places)


def _number(cell: str, column: Column, factor: float, has_commas: bool) -> float:
    """Return the number in a cell in the column's unit, NaN if it is empty.

    ``factor`` is the size of the sheet's unit in the column's; ``has_commas`` says whether decimals
    have a comma in this sheet.

    Raises:
        ValueError: The cell holds no number in the column's range; the message names the fault.
    """
    if cell.casefold() in NOTHING:
        return float("nan")
    quoted = repr(cell[:MAX_LETTERS])
    if has_commas and "." in cell:
        raise ValueError(
            f"{quoted} has a point, but other cells have decimal commas: "
            "write decimals in one way, and no thousands"
        )
    if has_commas and _DECIMAL_COMMA.fullmatch(cell):
        cell = cell.replace(",", ".")
    if _WITH_COMMA.fullmatch(cell):
        raise ValueError(
            f"{quoted} has a comma: write decimals with a point, and thousands without a separator"
        )
    allowed = f"{column.low:g} to {column.high:g} {column.unit} ({column.meaning})"
    if not _NUMBER.fullmatch(cell):
        raise ValueError(f"{quoted} is not a number; allowed is {allowed}, or nothing")
    value = float(cell) * factor
    if value == 0.0 and column.may_be_zero:
        return value
    if not column.low <= value <= column.high:
        in_unit = "" if factor == 1.0 else f", which is {value:.4g} {column.unit},"
        raise ValueError(f"{cell[:MAX_LETTERS]}{in_unit} is outside the allowed range {allowed}")
    return value


def _listed(complaints: Sequence[str], may_be_decimal_commas: bool) -> str:
    """Return the first complaints, the number of the others, and the likely cause."""
    listed = "; ".join(complaints[:MAX_COMPLAINTS])
    more = len(complaints) - MAX_COMPLAINTS
    if more > 0:
        listed += f"; and {more} more like these"
    if may_be_decimal_commas:
        listed += "; are decimals written with commas? Then separate cells by semicolons"
    return listed


def _unit_questions(headings: Sequence[Heading], rows: Sequence[Row]) -> Iterator[str]:
    """Yield questions on columns with numbers outside their range, and the units that they fit."""
    for place, heading in enumerate(headings):
        name = heading.column
        if name not in COLUMNS:
            continue
        magnitudes = [number for number in _magnitudes(rows, place) if number > 0.0]
        if not magnitudes:
            continue
        column = COLUMNS[name]
        low = min(magnitudes)
        high = max(magnitudes)
        if column.low <= heading.factor * low and heading.factor * high <= column.high:
            continue
        units = plausible_units(name, low, high)
        first_unit = units[0] if units else "UNIT"
        likely = f", such as {' or '.join(units)}" if units else ""
        example = f"--unit {name}={first_unit}"
        conversion = f"; {CONVERSIONS[name]}" if name in CONVERSIONS else ""
        yield f"; is {name} in another unit{likely}? Then say it: {example}{conversion}"


def _add_resultants(columns: dict[str, NDArray[np.float64]]) -> Iterator[str]:
    """Add the thrust force and the power that other forces give, if a sheet has none.

    Yield notes for the user.
    """
    if "thrust_force" not in columns:
        if {"feed_force", "back_force"} <= columns.keys():
            columns["thrust_force"] = np.hypot(columns["feed_force"], columns["back_force"])
            yield "thrust_force [N] as the resultant of feed_force and back_force"
        elif "feed_force" in columns:
            yield _no_thrust_force("feed_force", "back_force")
        elif "back_force" in columns:
            yield _no_thrust_force("back_force", "feed_force")
    if "power" not in columns and "main_force" in columns:
        # P [kW] = Fc [N] vc [m/min] / 60,000 (ISO 3002-4).
        columns["power"] = columns["main_force"] * columns["cutting_speed"] / 60e3
        yield "power [kW] as main_force times cutting_speed"


def _no_thrust_force(measured: str, not_measured: str) -> str:
    resultant = f"it is the resultant of {measured} and {not_measured}, which is not measured"
    return f"no thrust_force, as {resultant}"


def _edges(rows: Sequence[Row], headings: Sequence[Heading]) -> NDArray[np.int64] | None:
    """Return the number of each row's edge, shape (rows,); None if there is no column of edges."""
    columns = [heading.column for heading in headings]
    if EDGE not in columns:
        return None
    place = columns.index(EDGE)
    names = []
    for row in rows:
        # A row without a name gets an edge of its own, under a name that no cell can hold.
        names.append(row.cells[place] or f"\n{row.line}")
    _, numbers = np.unique(names, return_inverse=True)
    return numbers


def _read_header(table: _Table, source: str, stated: _Stated) -> list[Heading]:
    """Return how each column is read.

    Raises:
        WorkshopError: The table is empty, or a column is missing, occurs twice or cannot be told
            from another.
    """
    if not table.header:
        raise WorkshopError(f"{source} is empty: a header and rows of measurements are needed")
    stated_columns = _stated_columns(table.header, stated.headers, source)
    try:
        headings = []
        for place, text in enumerate(table.header):
            headings.append(read_heading(text, stated_columns.get(place), stated.units))
        headings = _decided_by_size(headings, table.rows)
    except WorkshopError as error:
        raise WorkshopError(f"{source}: {error}") from error
    for place, heading in enumerate(headings):
        # The user names another header for this quantity, so this column is not read.
        if heading.column in stated.headers and place not in stated_columns:
            headings[place] = Heading(heading.text, None)
    _refuse_missing(headings, source, stated.constants)
    _refuse_twice(headings, source)
    _refuse_superfluous(headings, source, stated)
    if not any(name in stated.headers for name in FORCES):
        _ask_for_axes(headings, table.rows, source)
    return headings


def _stated_columns(
    header: Sequence[str], stated_headers: Mapping[str, str], source: str
) -> dict[int, str]:
    """Return the columns that the user states, by their place in the header."""
    stated_columns: dict[int, str] = {}
    for column, name in stated_headers.items():
        places = [place for place, text in enumerate(header) if name.strip() == text.strip()]
        if not places:
            places = [place for place, text in enumerate(header) if is_header(name, text)]
        if len(places) != 1:
            present = ", ".join(repr(text.strip()[:MAX_LETTERS]) for text in header[:MAX_SHOWN])
            count = "no column" if not places else "more than one column"
            raise WorkshopError(
                f"{source}: --columns {column}={name}: {count} is headed {name!r}; "
                f"there are {present}"
            )
        place = places[0]
        if place in stated_columns:
            raise WorkshopError(
                f"{source}: --columns: {name!r} cannot be both {stated_columns[place]} and {column}"
            )
        stated_columns[place] = column
    return stated_columns


def _decided_by_size(headings: Sequence[Heading], rows: Sequence[Row]) -> list[Heading]:
    """Return headings in which the numbers below have decided between two meanings."""
    decided = []
    for place, heading in enumerate(headings):
        if not heading.other_meaning:
            decided.append(heading)
            continue
        certain = {other.column for other in headings if not other.other_meaning}
        decided.append(_by_size(heading, certain, _magnitudes(rows, place)))
    return decided


def _by_size(
    heading: Heading, certain: Collection[str | None], magnitudes: Sequence[float]
) -> Heading:
    """Return how a header is read that states no unit and has two meanings, such as F, T and P.

    If another header is certain to be the column, this one has its other meaning and is not read.
    Otherwise, the size of the numbers tells.

    Raises:
        WorkshopError: It does not.
    """
    column = str(heading.column)
    not_read = Heading(heading.text, None, other_meaning=heading.other_meaning)
    if column in certain:
        return not_read
    if not magnitudes or max(magnitudes) <= MAX_NUMBERS[column]:
        return heading
    # No feed is that large in any row, whereas a power or a time may be.
    if column == "feed" and min(magnitudes) > MAX_NUMBERS[column]:
        return not_read
    unit = COLUMNS[column].unit
    raise WorkshopError(
        f"column {heading.text!r} has numbers up to {max(magnitudes):g}: "
        f"is it {column} or {heading.other_meaning}? Write a unit into the "
        f"header, as in '{heading.text} [{unit}]', or say --columns {column}={heading.text}"
    )


def _magnitudes(rows: Sequence[Row], place: int) -> list[float]:
    """Return the absolute values of the numbers in a column."""
    magnitudes = []
    for row in rows:
        if place >= len(row.cells):
            continue
        cell = row.cells[place]
        if _is_number(cell):
            number = float(cell.strip().replace(",", "."))
            magnitudes.append(abs(number))
    return magnitudes


def _refuse_missing(
    headings: Sequence[Heading], source: str, constants: Mapping[str, float]
) -> None:
    """Raise an error if a column is missing that every sheet must have."""
    names = [*constants, *(heading.column for heading in headings)]
    absent = [name for name in REQUIRED if name not in names]
    if not absent:
        return
    texts = [repr(heading.text[:MAX_LETTERS]) for heading in headings[:MAX_SHOWN]]
    if len(headings) > MAX_SHOWN:
        texts.append("...")
    understood = []
    for name, column in COLUMNS.items():
        symbol = NAMES[name][1:2]
        understood.append(f"{' or '.join((name, *symbol))} [{column.unit}]")
    understood.append(EDGE)
    raise WorkshopError(
        f"{source}: no column {', '.join(absent)}; it has {', '.join(texts)}, "
        f"and the columns understood are {', '.join(understood)}; "
        f"name another header, as --columns {absent[0]}=HEADER, or state a value that is the same "
        f"in all rows, as --set {absent[0]}=X"
    )


def _refuse_twice(headings: Sequence[Heading], source: str) -> None:
    """Raise an error if two headers name one column."""
    for name in (*COLUMNS, EDGE):
        texts = [heading.text for heading in headings if heading.column == name]
        if len(texts) > 1:
            listed = " and ".join(repr(text) for text in texts)
            example = f"say which, as --columns {name}={texts[0]}"
            raise WorkshopError(
                f"{source}: there is more than one column {name}: {listed}; {example}"
            )


def _refuse_superfluous(headings: Sequence[Heading], source: str, stated: _Stated) -> None:
    """Raise an error if a constant has a column, or a unit has none."""
    texts = {heading.column: heading.text for heading in headings}
    for name in stated.constants:
        if name in texts:
            text = texts[name]
            raise WorkshopError(f"{source}: --set {name}: column {text!r} is {name} already")
    for name, unit in stated.units.items():
        if name not in texts:
            option = f"--unit {name}={unit}"
            raise WorkshopError(f"{source}: {option}: there is no column {name}")


def _ask_for_axes(headings: Sequence[Heading], rows: Sequence[Row], source: str) -> None:
    """Raise an error if forces are missing that columns along unknown axes may hold."""
    present = {heading.column for heading in headings}
    has_thrust = "thrust_force" in present or {"feed_force", "back_force"} <= present
    has_power = "power" in present or "main_force" in present
    if has_thrust and has_power:
        return
    typical = {}  # median of the numbers below each header of a force
    texts = []
    for place, heading in enumerate(headings):
        if heading.is_force:
            magnitudes = _magnitudes(rows, place)
            typical[heading.text] = float(np.median(magnitudes)) if magnitudes else 0.0
            texts.append(heading.text)
    if not texts:
        return
    by_size = sorted(typical, key=lambda text: -typical[text])
    stated = []
    for symbol, text in zip(("Fc", "Ff", "Fp"), by_size, strict=False):
        # A name without its unit is enough, and needs no quotes.
        stated.append(f"{symbol}={text.split()[0]}")
    names = ", ".join(repr(text) for text in texts)
    raise WorkshopError(
        f"{source}: {names}: which is the main (cutting) force Fc, the feed force Ff and the back "
        f"force Fp depends on how the dynamometer was mounted: say it, for example "
        f"--forces {','.join(stated)}; the largest here, {by_size[0]!r}, usually is Fc. "
        "Ff and Fp may be exchanged: only their resultant is used"
    )
