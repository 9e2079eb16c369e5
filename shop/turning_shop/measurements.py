"""Read a sheet of measurements: CSV or XLSX with a header, one cut or sample per row and one quantity per column.

Lines above the header, a row of units below it and rows of means are recognised, and named in ``Measurements.readings``.
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

import numpy as np
from numpy.typing import NDArray
from turning_shop import WorkshopError, regular_file
from turning_shop.headers import (
    COLUMNS,
    EDGE,
    NAMES,
    SIZES,
    Column,
    Heading,
    is_header,
    is_unit,
    read_heading,
)

from turning_env.extras import missing

REQUIRED = ("cutting_speed", "feed", "depth_of_cut")  # columns that every sheet of cuts must have
MAX_BYTES = (
    50_000_000  # largest size of a file, and of all parts of a workbook when unpacked [bytes]
)
MAX_ROWS, MAX_CELLS, MAX_TAGS = 100_000, 200, 3_000_000
"""Largest number of rows of a sheet, of cells of a row, and of XML tags of a workbook, of which a cell has four."""
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
}
STATISTICS |= {"std", "sd", "stdev", "std dev", "standard deviation", "standardabweichung", "stabw"}
"""Cells, in small letters, of a row that sums up others."""
NOTHING = ("", "-", "\N{EN DASH}", "n/a", "n.a.", "k.a.", "k. a.", "na", "nan", "#n/a", "#nv")
"""Cells, in small letters, of numbers that were not measured."""
MAX_COMPLAINTS = 5  # number of wrong cells that an error lists; it only counts the others
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d*([eE][+-]?\d+)?", re.ASCII)
_WITH_COMMA = re.compile(r"[+-]?[\d.]*,[\d.,]*", re.ASCII)
_SEPARATORS = ",;\t|"

Row = tuple[int, list[str]]  # a row's line in the file, counted from 1, and its cells


@dataclass(frozen=True)
class Measurements:
    """A sheet of measurements; arrays have the shape (rows,)."""

    columns: dict[str, NDArray[np.float64]]  # in the units of ``COLUMNS``; NaN for an empty cell
    lines: NDArray[np.int64]  # of the file, counted from 1
    ignored: tuple[str, ...] = ()  # unknown columns
    edges: NDArray[np.int64] | None = (
        None  # number of each row's edge; None if the file has no column ``EDGE``
    )
    readings: tuple[str, ...] = ()  # how each column of the file was read


def read_measurements(
    path: str | os.PathLike[str], told: Mapping[str, str] = MappingProxyType({})
) -> Measurements:
    """Read a sheet: XLSX, or text with cells between commas, semicolons, tabs or bars.

    Headers are names or symbols in English or German, with units or without (``headers.py``). ``told`` are headers by the
    columns that they are, where headers do not tell. Decimals have a point, or a comma
    where text cells are not separated by commas. Text is UTF-8 or UTF-16 with a byte order mark, else Windows-1252.

    Raises:
        WorkshopError: The file cannot be read or is not a table; a column is missing or occurs twice; a cell is not a number or
            is outside its column's range.
    """
    try:
        data = regular_file(Path(path), MAX_BYTES).read_bytes()
        if Path(path).suffix.lower() in (".xlsx", ".xlsm"):
            return _parse(_rows_of_workbook(data), str(path), False, told)
        text = _decoded(data)
        separator = max(_SEPARATORS, key=lambda mark: _most_understood(_rows(text, mark)))
        return _parse(_rows(text, separator), str(path), separator != ",", told)
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
        if b"\0" in data:
            raise
        return data.decode("cp1252")


def _rows(text: str, separator: str) -> Iterator[Row]:
    # newline="" is needed for files of old spreadsheets, whose lines end in "\r" alone.
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    return (
        (reader.line_num, cells[:MAX_CELLS])
        for cells in reader
        if any(cell.strip() for cell in cells)
    )


def _rows_of_workbook(data: bytes) -> Iterator[Row]:
    """Yield the rows of the first sheet of a workbook."""
    try:
        openpyxl = importlib.import_module("openpyxl")
    except ModuleNotFoundError as error:
        raise WorkshopError(
            f"an XLSX sheet cannot be read, as {missing(error)}; or save it as CSV"
        ) from None
    try:
        parts = zipfile.ZipFile(io.BytesIO(data))
        unpacked = sum(part.file_size for part in parts.infolist())
        if (
            unpacked > MAX_BYTES
            or sum(parts.read(part).count(b"<") for part in parts.infolist()) > MAX_TAGS
        ):
            raise ValueError(
                f"at most {MAX_BYTES // 10**6} MB and {MAX_TAGS // 10**6} million tags are read: save it as CSV"
            )
        sheet = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True).worksheets[
            0
        ]
        rows = sheet.iter_rows(max_row=MAX_ROWS + 2, max_col=MAX_CELLS, values_only=True)
        table = [["" if cell is None else str(cell) for cell in row] for row in rows]
    except Exception as error:  # openpyxl lets through whatever zipfile, its parser of XML and its own checks raise
        raise WorkshopError(f"this is no workbook in XLSX: {error}") from error
    width = max(
        (index + 1 for row in table for index, cell in enumerate(row) if cell.strip()), default=0
    )
    filled = ((line, (cells + [""] * width)[:width]) for line, cells in enumerate(table, 1))
    return (row for row in filled if any(cell.strip() for cell in row[1]))


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
    try:
        return max(
            (_understood(cells) for _, cells in itertools.islice(rows, MAX_ABOVE)), default=0
        )
    except csv.Error:
        return 0


def _parse(
    rows: Iterator[Row], source: str, may_have_commas: bool, told: Mapping[str, str]
) -> Measurements:
    found = list(itertools.islice(rows, MAX_ROWS + 2))
    if len(found) > MAX_ROWS + 1:
        raise WorkshopError(f"{source} has more than {MAX_ROWS} rows")
    above = found[:MAX_ABOVE]
    start = max(range(len(above)), key=lambda index: _understood(above[index][1]), default=0)
    header, notes = found[start][1] if found else [], []
    if start:
        notes.append(
            f"header in line {found[start][0]}, below {start} other row{'s' * (start > 1)}"
        )
    table = [
        (line, row[: len(header)] if not any(row[len(header) :]) else row)
        for line, row in found[start + 1 :]
    ]
    below = table[0][1] if table else []
    if (
        len(below) == len(header)
        and not any(map(_is_number, below))
        and sum(map(is_unit, below)) >= 2
    ):
        notes.append(f"units in line {table.pop(0)[0]}")
        below = [cell.strip(" []()") for cell in below]
        header = [
            f"{text} [{unit}]" if is_unit(unit) and text.strip()[-1:] not in tuple("])}>") else text
            for text, unit in zip(header, below, strict=True)
        ]
    headings = _read_header(header, source, told, table)
    if summed := [line for line, row in table if _sums_up(row)]:
        notes.append(
            f"without {len(summed)} row{'s' * (len(summed) > 1)} of means, sums or text, the first in line {summed[0]}"
        )
        table = [each for each in table if each[0] not in summed]
    width = len(headings)
    complete = [(line, [cell.strip() for cell in row]) for line, row in table if len(row) == width]
    complaints = [
        f"line {line} has {len(row)} cells, but the header has {width}"
        for line, row in table
        if len(row) != width
    ]
    known = [
        (at, each, each.column, COLUMNS[each.column])
        for at, each in enumerate(headings)
        if each.column in COLUMNS
    ]
    commas = may_have_commas and any(
        _DECIMAL_COMMA.fullmatch(row[index]) for _, row in complete for index, *_ in known
    )
    values = {name: np.empty(len(complete)) for _, _, name, _ in known}
    for number, (line, row) in enumerate(complete):
        for index, heading, name, column in known:
            try:
                values[name][number] = _number(row[index], column, heading.factor, commas)
            except ValueError as error:
                complaints.append(f"line {line}, column {heading.text}: {error}")
    if complaints:
        more = len(complaints) - MAX_COMPLAINTS
        shown = "; ".join(complaints[:MAX_COMPLAINTS]) + (
            f"; and {more} more like these" if more > 0 else ""
        )
        shown += "; a header may state another unit, as in 'wear [um]'" * (
            "is outside the allowed" in shown
        )
        crowded = not may_have_commas and any(len(row) > width for _, row in table)
        shown += "; are decimals written with commas? Then separate cells by semicolons" * crowded
        raise WorkshopError(f"{source}: {shown}")
    if not table:
        raise WorkshopError(f"{source} has a header but no rows of measurements")
    notes += _resultants(values)
    # A row without a name gets an edge of its own, under a name that no cell can hold.
    edge = next((index for index, heading in enumerate(headings) if heading.column == EDGE), None)
    return Measurements(
        values,
        np.array([line for line, _ in complete]),
        tuple(heading.text for heading in headings if heading.column is None and heading.text),
        None
        if edge is None
        else np.unique([row[edge] or f"\n{line}" for line, row in complete], return_inverse=True)[
            1
        ],
        (*(heading.describe() for heading in headings if heading.text), *notes),
    )


def _sums_up(row: Sequence[str]) -> bool:
    """Return whether a row sums up others, or holds no number at all."""
    return any(
        cell.strip(" :").casefold().replace(".", "") in STATISTICS for cell in row
    ) or not any(map(_is_number, row))


def _is_number(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell.strip().replace(",", ".")))


def _resultants(values: dict[str, NDArray[np.float64]]) -> Iterator[str]:
    """Add the thrust force of feed and back force, and the power of main force, where a sheet has neither; yield notes."""
    if "thrust_force" not in values and {"feed_force", "back_force"} <= values.keys():
        values["thrust_force"] = np.hypot(values["feed_force"], values["back_force"])
        yield "thrust_force [N] as the resultant of feed_force and back_force"
    elif "thrust_force" not in values:
        for name, other in (("feed_force", "back_force"), ("back_force", "feed_force")):
            if name in values:
                yield f"no thrust_force, as it is the resultant of {name} and {other}, which is not measured"
    if "power" not in values and "main_force" in values:
        values["power"] = values["main_force"] * values["cutting_speed"] / 60e3
        yield "power [kW] as main_force times cutting_speed"


def _read_header(
    header: list[str], source: str, told: Mapping[str, str], table: Sequence[Row]
) -> list[Heading]:
    """Return how each column is read; raise an error if one is missing, occurs twice or cannot be told from another."""
    if not header:
        raise WorkshopError(f"{source} is empty: a header and rows of measurements are needed")
    said = _told_columns(header, told, source)
    try:
        headings = [read_heading(cell, said.get(index)) for index, cell in enumerate(header)]
        for index, heading in enumerate(headings):
            if heading.unlike:
                others = {
                    each.column for each in headings if each is not heading and not each.unlike
                }
                headings[index] = _by_size(
                    heading, others, [row[index] for _, row in table if len(row) > index]
                )
    except WorkshopError as error:
        raise WorkshopError(f"{source}: {error}") from error
    for index, heading in enumerate(headings):
        if heading.column in told and index not in said:  # the user says that it is another column
            headings[index] = Heading(heading.text, None)
    names = [heading.column for heading in headings]
    if missing := [name for name in REQUIRED if name not in names]:
        present = ", ".join(repr(heading.text[:40]) for heading in headings[:20]) + (
            ", ..." if len(names) > 20 else ""
        )
        understood = [
            " or ".join([name, *NAMES[name][1:2]]) + f" [{column.unit}]"
            for name, column in COLUMNS.items()
        ] + [EDGE]
        raise WorkshopError(
            f"{source}: no column {', '.join(missing)}; it has {present}, and the columns understood are {', '.join(understood)}"
        )
    for name in (*COLUMNS, EDGE):
        if names.count(name) > 1:
            twice = [heading.text for heading in headings if heading.column == name]
            listed = " and ".join(map(repr, twice))
            example = f"say which, as --columns {name}={twice[0]}"
            raise WorkshopError(
                f"{source}: there is more than one column {name}: {listed}; {example}"
            )
    _ask_for_axes(headings, source, told, table)
    return headings


def _told_columns(header: list[str], told: Mapping[str, str], source: str) -> dict[int, str]:
    """Return the columns that the user told, by their place in the header."""
    said: dict[int, str] = {}
    for column, name in told.items():
        places = [index for index, text in enumerate(header) if name.strip() == text.strip()]
        places = places or [index for index, text in enumerate(header) if is_header(name, text)]
        if len(places) != 1:
            present = ", ".join(repr(text.strip()[:40]) for text in header[:20])
            count = "no column" if not places else "more than one column"
            raise WorkshopError(
                f"{source}: --columns {column}={name}: {count} is headed {name!r}; there are {present}"
            )
        if places[0] in said:
            raise WorkshopError(
                f"{source}: --columns: {name!r} cannot be both {said[places[0]]} and {column}"
            )
        said[places[0]] = column
    return said


def _by_size(heading: Heading, others: Collection[str | None], cells: Sequence[str]) -> Heading:
    """Return how a header is read that states no unit and has two meanings, such as F, T and P.

    If another header names the column, this one has its other meaning and is not read. Otherwise, the size of the numbers tells.

    Raises:
        WorkshopError: It does not.
    """
    column = str(heading.column)
    if column in others:
        return Heading(heading.text, None, unlike=heading.unlike)
    numbers = _sizes_of(cells)
    if not numbers or max(numbers) <= SIZES[column]:
        return heading
    if column == "feed" and min(numbers) > SIZES[column]:
        return Heading(heading.text, None, unlike=heading.unlike)
    unit = COLUMNS[column].unit
    raise WorkshopError(
        f"column {heading.text!r} has numbers up to {max(numbers):g}: is it {column} or {heading.unlike}? Write a unit into the "
        f"header, as in '{heading.text} [{unit}]', or say --columns {column}={heading.text}"
    )


def _sizes_of(cells: Sequence[str]) -> list[float]:
    """Return the absolute values of the numbers in cells."""
    return [abs(float(cell.strip().replace(",", "."))) for cell in cells if _is_number(cell)]


def _ask_for_axes(
    headings: Sequence[Heading], source: str, told: Mapping[str, str], table: Sequence[Row]
) -> None:
    """Raise an error if forces are missing that columns along unknown axes may hold, and the user has not told any."""
    axes = [(index, heading.text) for index, heading in enumerate(headings) if heading.is_force]
    present = {heading.column for heading in headings}
    has_thrust = "thrust_force" in present or {"feed_force", "back_force"} <= present
    has_power = bool({"power", "main_force"} & present)
    if (
        not axes
        or (has_thrust and has_power)
        or set(told) & {"main_force", "feed_force", "back_force", "thrust_force"}
    ):
        return
    sizes = {}
    for index, text in axes:
        numbers = _sizes_of([row[index] for _, row in table if len(row) > index])
        sizes[text] = float(np.median(numbers)) if numbers else 0.0
    largest = max(sizes, key=lambda text: sizes[text])
    names = ", ".join(repr(text) for _, text in axes)
    symbols = dict(
        zip(sorted(sizes, key=lambda text: -sizes[text]), ("Fc", "Ff", "Fp"), strict=False)
    )
    example = " ".join(
        f"{symbol}={text!r}" if " " in text else f"{symbol}={text}"
        for text, symbol in symbols.items()
    )
    raise WorkshopError(
        f"{source}: {names}: which is the main (cutting) force Fc, the feed force Ff and the back force Fp depends on how the "
        f"dynamometer was mounted: say it, for example --columns {example}; the largest here, {largest!r}, usually is Fc"
    )


def _number(cell: str, column: Column, factor: float, commas: bool) -> float:
    """Return the number in a cell in the column's unit, NaN if it is empty; the ValueError names the fault.

    ``factor`` is the size of the sheet's unit in the column's; ``commas`` says whether decimals have a comma in this sheet.
    """
    if cell.casefold() in NOTHING:
        return float("nan")
    shown = repr(cell[:40])
    if commas and "." in cell:
        raise ValueError(
            f"{shown} has a point, but other cells have decimal commas: write decimals in one way, and no thousands"
        )
    if commas and _DECIMAL_COMMA.fullmatch(cell):
        cell = cell.replace(",", ".")
    if _WITH_COMMA.fullmatch(cell):
        raise ValueError(
            f"{shown} has a comma: write decimals with a point, and thousands without a separator"
        )
    allowed = f"{column.low:g} to {column.high:g} {column.unit} ({column.meaning})"
    if not _NUMBER.fullmatch(cell):
        raise ValueError(f"{shown} is not a number; allowed is {allowed}, or nothing")
    value = float(cell) * factor
    if value == 0.0 and column.may_be_zero:
        return value
    if not column.low <= value <= column.high:
        scaled = "" if factor == 1.0 else f", which is {value:.4g} {column.unit},"
        raise ValueError(f"{cell[:40]}{scaled} is outside the allowed range {allowed}")
    return value
