"""Recognise the columns of a sheet by their headers: names and symbols in English and German, and units."""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from turning_shop import WorkshopError

UNITS = {
    "m/min": ("speed", 1.0),
    "m/s": ("speed", 60.0),
    "ft/min": ("speed", 0.3048),
    "sfm": ("speed", 0.3048),
    "mm/rev": ("feed", 1.0),
    "mm/r": ("feed", 1.0),
    "mm/u": ("feed", 1.0),
    "mm/umdr": ("feed", 1.0),
    "um/rev": ("feed", 0.001),
    "in/rev": ("feed", 25.4),
    "ipr": ("feed", 25.4),
    "mm": ("length", 1.0),
    "um": ("length", 0.001),
    "in": ("length", 25.4),
    "inch": ("length", 25.4),
    "min": ("time", 1.0),
    "s": ("time", 1 / 60),
    "sec": ("time", 1 / 60),
    "sek": ("time", 1 / 60),
    "ms": ("time", 1 / 60e3),
    "h": ("time", 60.0),
    "n": ("force", 1.0),
    "kn": ("force", 1000.0),
    "dan": ("force", 10.0),
    "lbf": ("force", 4.4482216),
    "kw": ("power", 1.0),
    "w": ("power", 0.001),
    "hp": ("power", 0.745700),
    "ps": ("power", 0.735499),
    "a": ("current", 1.0),
    "ma": ("current", 0.001),
    "n m": ("torque", 1.0),
    "nm": ("torque", 1.0),
    "-": ("ratio", 1.0),
    "1": ("ratio", 1.0),
    "%": ("ratio", 0.01),
}
"""Dimension of each unit, in small letters, and its size in that dimension's first unit."""

NAMES = {
    "cutting_speed": ("cutting speed", "vc", "v c", "surface speed", "schnittgeschwindigkeit"),
    "feed": ("feed", "f", "fn", "f n", "feed per revolution", "feed per rev", "vorschub", "vorschub pro umdrehung"),
    "depth_of_cut": ("depth of cut", "ap", "a p", "doc", "cutting depth", "schnitttiefe", "zustellung"),
    "time": ("time", "t", "tc", "cutting time", "zeit", "schnittzeit", "eingriffszeit", "eingriffzeit"),
    "wear": ("wear", "vb", "v b", "vbb", "flank wear", "verschleiss", "freiflaechenverschleiss", "verschleissmarkenbreite"),
    "thrust_force": ("thrust force", "feed force", "ff", "f f", "vorschubkraft"),
    "power": ("power", "p", "pc", "cutting power", "spindle power", "leistung", "schnittleistung", "spindelleistung"),
    "hardness": ("hardness", "relative hardness", "haerte", "relative haerte"),
    "edge": ("edge", "cutting edge", "edge id", "insert", "schneide", "wendeplatte", "platte"),
    "current": ("current", "i", "motor current", "strom", "motorstrom"),
    "torque": ("torque", "m", "load torque", "moment", "drehmoment", "lastmoment"),
}
"""Headers of each column without units and in small letters, "_" and "." as spaces, umlauts as two letters."""

_COLUMN = {name: column for column, names in NAMES.items() for name in names}
_BRACKETS = re.compile(r"(.*?)\s*[\[({<]\s*(.*?)\s*[\])}>]\s*", re.DOTALL)
_MICRO = str.maketrans("µμ·*", "uu  ")
_LETTERS = dict(zip(map(ord, "äöüßµμ·_."), ("ae", "oe", "ue", "ss", "u", "u", " ", " ", " "), strict=True))


class Heading(NamedTuple):
    """How a column of a sheet is read."""

    text: str
    """The header as it stands in the sheet."""
    column: str | None
    """The column that it is; None if it is not understood."""
    factor: float = 1.0
    """Size of the sheet's unit in the column's."""
    unit: str = ""
    """The sheet's unit, as it stands there; empty if there is none."""


def read_heading(text: str, units: Mapping[str, str]) -> Heading:
    """Return how a column with this header is read, among the columns of which ``units`` gives the units.

    Raises:
        WorkshopError: The column is known, but its unit is not, or is one of another quantity.
    """
    text = text.strip()
    bracketed = _BRACKETS.fullmatch(text)
    name, unit = (bracketed[1], bracketed[2]) if bracketed else (text, "")
    column = _column(name, units)
    if column is None and not bracketed:  # as in "ap_mm", "VB in mm", "P kW" and "time, s"
        for parted in re.finditer(r"[\s_,/]+(?:in\s+)?", text):
            column, unit = _column(text[: parted.start()], units), text[parted.end() :]
            if column and (known := _unit(unit)) in UNITS and (column == "edge" or _same(known, units[column])):
                break
            column = None
    if column is None or column == "edge" or not unit:
        return Heading(text, column)
    known = _unit(unit)
    if known not in UNITS or not _same(known, units[column]):
        dimension = UNITS[_unit(units[column])][0]
        allowed = ", ".join(name for name, (what, _) in UNITS.items() if what == dimension)
        raise WorkshopError(
            f"column {text!r}: {column} in {unit!r} is not understood: allowed are {allowed}, or no unit, {units[column]}"
        )
    return Heading(text, column, UNITS[known][1] / UNITS[_unit(units[column])][1], unit)


def describe(headings: Iterable[Heading], units: Mapping[str, str]) -> Iterator[str]:
    """Yield how each column that has a header is read."""
    for heading in headings:
        if heading.column:
            unit = f" [{units[heading.column]}]" if heading.column in units else ""
            source = "" if heading.text == heading.column else f" from {heading.text!r}"
            scaled = f" times {heading.factor:.6g}" if heading.factor != 1.0 else ""
            yield f"{heading.column}{unit}{source}{scaled}"
        elif heading.text:
            yield f"nothing from {heading.text!r}"


def _column(name: str, units: Mapping[str, str]) -> str | None:
    plain = re.sub(r"\s+", " ", name.casefold().translate(_LETTERS)).strip()
    column = plain.replace(" ", "_") if plain.replace(" ", "_") in units else _COLUMN.get(plain)
    return column if column in units or column == "edge" else None


def _unit(text: str) -> str:
    plain = re.sub(r"\s*/\s*", "/", re.sub(r"\s+", " ", text.casefold().translate(_MICRO)).strip())
    return re.sub(r" ?min(\^?-1)$", "/min", plain)


def _same(first: str, second: str) -> bool:
    return UNITS[first][0] == UNITS[_unit(second)][0]
