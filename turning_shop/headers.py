"""Recognise the columns of a sheet by their headers: names and symbols in English and German, and units."""

import re
from typing import NamedTuple

from turning_shop import WorkshopError


class Column(NamedTuple):
    """A quantity and its range of plausible values [unit], ends included; a value outside is probably in another unit."""

    unit: str
    low: float
    high: float
    meaning: str


EDGE = "edge"  # an optional column that holds no numbers: the name of the cutting edge

COLUMNS = {
    "cutting_speed": Column("m/min", 0.1, 5000, "cutting speed"),
    "feed": Column("mm/rev", 0.001, 10, "feed"),
    "depth_of_cut": Column("mm", 0.01, 50, "depth of cut"),
    "time": Column("min", 1e-4, 1e5, "cutting time since the edge was fresh, all at this speed, feed and depth"),
    "wear": Column("mm", 1e-4, 5, "flank wear of the edge since it was fresh"),
    "thrust_force": Column("N", 1e-3, 1e6, "thrust force: the resultant of feed and back force"),
    "power": Column("kW", 1e-4, 1e4, "spindle power"),
    "main_force": Column("N", 1e-3, 1e6, "main cutting force Fc (ISO 3002), which gives the power if no column does"),
    "feed_force": Column("N", 1e-3, 1e6, "feed force Ff (ISO 3002), which with the back force gives the thrust force"),
    "back_force": Column("N", 1e-3, 1e6, "back force Fp (ISO 3002), also called passive or radial force"),
    "hardness": Column("-", 0.1, 10, "hardness of the bar over nominal hardness: 1 is nominal"),
}
"""Columns of numbers of a sheet of cuts; a row with an empty cell in the column ``EDGE`` has an edge of its own."""

UNITS = {
    "speed": {"m/min": 1.0, "m/s": 60.0, "ft/min": 0.3048, "sfm": 0.3048, "sfpm": 0.3048, "fpm": 0.3048},
    "length": (LENGTH := {"mm": 1.0, "um": 0.001, "in": 25.4, "inch": 25.4}),
    "feed": {"mm/rev": 1.0, "mm/r": 1.0, "mm/u": 1.0, "mm/umdr": 1.0, "um/rev": 0.001, "in/rev": 25.4, "ipr": 25.4} | LENGTH,
    "time": {"min": 1.0, "s": 1 / 60, "sec": 1 / 60, "sek": 1 / 60, "ms": 1 / 60e3, "h": 60.0},
    "force": {"n": 1.0, "kn": 1000.0, "dan": 10.0, "lbf": 4.4482216},
    "power": {"kw": 1.0, "w": 0.001, "hp": 0.745700, "ps": 0.735499},
    "ratio": {"-": 1.0, "1": 1.0, "%": 0.01},
}
"""Units of each dimension, in small letters, and their sizes; a feed in mm is one per revolution (DIN 6580)."""

SPOKEN = ("cutting_speed", "feed", "power")  # columns that a header may name by a unit alone, as in "SFM", "IPR" and "HP"

NAMES = {
    "cutting_speed": ("cutting speed", "vc", "v c", "surface speed", "schnittgeschwindigkeit"),
    "feed": ("feed", "f", "fn", "f n", "feed per revolution", "feed per rev", "feed rate", "vorschub", "vorschub pro umdrehung"),
    "depth_of_cut": ("depth of cut", "ap", "a p", "doc", "depth", "cutting depth", "schnitttiefe", "zustellung"),
    "time": ("time", "t", "tc", "cutting time", "machining time", "contact time", "zeit", "schnittzeit", "eingriffszeit"),
    "wear": (
        *("wear", "vb", "v b", "vbb", "vb b", "vbmax", "vb max", "flank wear", "flank wear vb", "tool wear"),
        *("verschleiss", "freiflaechenverschleiss", "verschleissmarkenbreite"),
    ),
    "thrust_force": ("thrust force", "resultant of feed and back force"),
    "main_force": ("main force", "fc", "f c", "cutting force", "schnittkraft", "hauptschnittkraft"),
    "feed_force": ("feed force", "ff", "f f", "vorschubkraft"),
    "back_force": ("back force", "fp", "f p", "passive force", "radial force", "passivkraft"),
    "power": ("power", "p", "pc", "cutting power", "spindle power", "leistung", "schnittleistung", "spindelleistung"),
    "hardness": ("hardness", "relative hardness", "haerte", "relative haerte"),
    EDGE: ("edge", "cutting edge", "insert", "tool", "schneide", "wendeplatte", "platte", "werkzeug", "wkz"),
}
"""Headers of each column without units and in small letters, "_" and "." as spaces, umlauts as two letters."""

_COLUMN = {name: column for column, names in NAMES.items() for name in names}
_BRACKETS = re.compile(r"(.*?)\s*[\[({<]\s*([^\[({<]*?)\s*[\])}>]\s*", re.DOTALL)
_NUMBERED = re.compile(r" ?(#|id|no|nr|number|nummer)$")  # end of an edge's header
_GAP = re.compile(r"[\s_,/]+(?:in\s+)?")
_MICRO = str.maketrans("µμ·*", "uu  ")
_LETTERS = dict(zip(map(ord, "äöüßµμ·_."), ("ae", "oe", "ue", "ss", "u", "u", " ", " ", " "), strict=True))


class Heading(NamedTuple):
    """The reading of a sheet's header: its column, and the factor to the column's unit."""

    text: str  # header as written
    column: str | None  # of a sheet of cuts; None if it is not understood
    factor: float = 1.0  # size of the sheet's unit in the column's

    def describe(self) -> str:
        """Return how the column is read, for people."""
        if not self.column:
            return f"nothing from {self.text!r}"
        unit = f" [{COLUMNS[self.column].unit}]" if self.column in COLUMNS else ""
        source = "" if self.text == self.column else f" from {self.text!r}"
        scaled = f" times {self.factor:.6g}" if self.factor != 1.0 else ""
        return f"{self.column}{unit}{source}{scaled}"


def read_heading(text: str) -> Heading:
    """Return how a column with this header is read.

    A unit that only one of ``SPOKEN`` has names it.

    Raises:
        WorkshopError: The column is known, but its unit is not, or is one of another quantity.
    """
    text = text.strip()
    bracketed = _BRACKETS.fullmatch(text)
    name, unit = bracketed.groups() if bracketed else (text, "")
    column = _column(name)
    if column is None and not bracketed:  # as in "ap_mm", "VB in mm", "P kW" and "time, s"
        for gap in _GAP.finditer(text):
            likely, unit = _column(text[: gap.start()]), text[gap.end() :]
            if likely and likely != EDGE and _unit(unit) in _sizes(COLUMNS[likely].unit):
                column = likely
                break
    if column is None and not bracketed and _unit(text) not in LENGTH:
        column, unit = next((each for each in SPOKEN if _unit(text) in _sizes(COLUMNS[each].unit)), None), text
    if column is None or column == EDGE or not unit or _column(unit) == column:  # as in "Vorschub (f)"
        return Heading(text, column)
    sizes = _sizes(own := COLUMNS[column].unit)
    if _unit(unit) not in sizes:
        others = " or ".join(name for name, each in COLUMNS.items() if _unit(unit) in _sizes(each.unit))
        allowed = f"allowed are {', '.join(sizes)}, or no unit, which means {own}" + f"; is it {others}?" * bool(others)
        raise WorkshopError(f"column {text!r}: {column} in {unit!r} is not understood: {allowed}")
    return Heading(text, column, sizes[_unit(unit)] / sizes[_unit(own)])


def is_unit(text: str) -> bool:
    """Return whether a cell holds a unit, in brackets or not."""
    bracketed = _BRACKETS.fullmatch(text.strip())
    return any(_unit(bracketed[2] if bracketed else text) in sizes for sizes in UNITS.values())


def _column(name: str) -> str | None:
    plain = re.sub(r"\s+", " ", name.casefold().translate(_LETTERS)).strip()
    twice = {_COLUMN.get(part.strip(" ,:=()[]")) for part in plain.rpartition(" ")[::2]}  # as in "Vorschub f" and "feed, f"
    return EDGE if _COLUMN.get(_NUMBERED.sub("", plain)) == EDGE else _COLUMN.get(plain, twice.pop() if len(twice) == 1 else None)


def _unit(text: str) -> str:
    plain = re.sub(r"\s*/\s*", "/", re.sub(r"\s+", " ", text.casefold().translate(_MICRO)).strip())
    return re.sub(r" ?min(\^?-1)$", "/min", plain)


def _sizes(unit: str) -> dict[str, float]:
    """Return the sizes of all units of a unit's dimension."""
    return next(sizes for sizes in UNITS.values() if _unit(unit) in sizes)
