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
    may_be_zero: bool = False  # whether 0 is a measurement too


EDGE = "edge"  # an optional column that holds no numbers: the name of the cutting edge

COLUMNS = {
    "cutting_speed": Column("m/min", 0.1, 5000, "cutting speed"),
    "feed": Column("mm/rev", 0.001, 10, "feed"),
    "depth_of_cut": Column("mm", 0.01, 50, "depth of cut"),
    "time": Column(
        "min",
        1e-4,
        1e5,
        "cutting time since the edge was fresh, all at this speed, feed and depth",
        True,
    ),
    "wear": Column(
        "mm", 1e-4, 5, "flank wear of the edge since it was fresh; 0: a fresh edge", True
    ),
    "thrust_force": Column("N", 1e-3, 1e6, "thrust force: the resultant of feed and back force"),
    "power": Column("kW", 1e-4, 1e4, "spindle power"),
    "main_force": Column(
        "N", 1e-3, 1e6, "main cutting force Fc (ISO 3002), which gives the power if no column does"
    ),
    "feed_force": Column(
        "N", 1e-3, 1e6, "feed force Ff (ISO 3002), which with the back force gives the thrust force"
    ),
    "back_force": Column(
        "N", 1e-3, 1e6, "back force Fp (ISO 3002), also called passive or radial force"
    ),
    "hardness": Column("-", 0.1, 10, "hardness of the bar over nominal hardness: 1 is nominal"),
}
"""Columns of numbers of a sheet of cuts; a row with an empty cell in the column ``EDGE`` has an edge of its own."""

UNITS = {
    "speed": {
        "m/min": 1.0,
        "m/s": 60.0,
        "ft/min": 0.3048,
        "sfm": 0.3048,
        "sfpm": 0.3048,
        "fpm": 0.3048,
    },
    "length": (LENGTH := {"mm": 1.0, "um": 0.001, "in": 25.4, "inch": 25.4}),
    "feed": {
        "mm/rev": 1.0,
        "mm/r": 1.0,
        "mm/u": 1.0,
        "mm/umdr": 1.0,
        "um/rev": 0.001,
        "in/rev": 25.4,
        "ipr": 25.4,
    }
    | LENGTH,
    "time": {"min": 1.0, "s": 1 / 60, "sec": 1 / 60, "sek": 1 / 60, "ms": 1 / 60e3, "h": 60.0},
    "force": {"n": 1.0, "kn": 1000.0, "dan": 10.0, "lbf": 4.4482216},
    "power": {"kw": 1.0, "w": 0.001, "hp": 0.745700, "ps": 0.735499},
    "ratio": {"-": 1.0, "1": 1.0, "%": 0.01},
}
TEMPERATURES = ("\N{DEGREE SIGN}c", "c", "k", "degc", "deg c", "\N{DEGREE SIGN}f", "grad c")
"""Units of temperatures, in small letters: no column holds any."""
"""Units of each dimension, in small letters, and their sizes; a feed in mm is one per revolution (DIN 6580)."""

SPOKEN = (
    "cutting_speed",
    "feed",
    "power",
)  # columns that a header may name by a unit alone, as in "SFM", "IPR" and "HP"

NAMES = {
    "cutting_speed": ("cutting speed", "vc", "v c", "surface speed", "schnittgeschwindigkeit"),
    "feed": (
        "feed",
        "f",
        "fn",
        "f n",
        "feed per revolution",
        "feed per rev",
        "feed rate",
        "vorschub",
        "vorschub pro umdrehung",
    ),
    "depth_of_cut": (
        "depth of cut",
        "ap",
        "a p",
        "doc",
        "depth",
        "cutting depth",
        "schnitttiefe",
        "zustellung",
    ),
    "time": (
        "time",
        "t",
        "tc",
        "cutting time",
        "machining time",
        "contact time",
        "zeit",
        "schnittzeit",
        "eingriffszeit",
    ),
    "wear": (
        *(
            "wear",
            "vb",
            "v b",
            "vbb",
            "vb b",
            "vbmax",
            "vb max",
            "flank wear",
            "flank wear vb",
            "tool wear",
        ),
        *("verschleiss", "freiflaechenverschleiss", "verschleissmarkenbreite"),
    ),
    "thrust_force": ("thrust force", "resultant of feed and back force"),
    "main_force": ("main force", "fc", "f c", "cutting force", "schnittkraft", "hauptschnittkraft"),
    "feed_force": ("feed force", "ff", "f f", "vorschubkraft"),
    "back_force": ("back force", "fp", "f p", "passive force", "radial force", "passivkraft"),
    "power": (
        "power",
        "p",
        "pc",
        "cutting power",
        "spindle power",
        "leistung",
        "schnittleistung",
        "spindelleistung",
    ),
    "hardness": ("hardness", "relative hardness", "haerte", "relative haerte"),
    EDGE: (
        "edge",
        "cutting edge",
        "insert",
        "tool",
        "schneide",
        "wendeplatte",
        "platte",
        "werkzeug",
        "wkz",
    ),
}
"""Headers of each column without units and in small letters, "_" and "." as spaces, umlauts as two letters."""

BY_UNIT: dict[str, dict[str, str | None]] = {
    "F": {"force": None},  # the resultant of all forces
    "P": {"force": "back_force"},
    "p": {"force": "back_force"},
}
"""Columns of symbols that are another quantity in a unit of another dimension; None: one that is not read."""
BY_SIZE = {
    "F": ("feed", "a force"),
    "P": ("power", "the passive (back) force"),
    "T": ("time", "a temperature"),
}
"""Symbols that, without a unit, mean a column or something else."""
SIZES = {"feed": 10.0, "power": 30.0, "time": 100.0}
"""Largest numbers that such a symbol may hold to be the column: forces are larger in N, and temperatures in any unit."""
_AXES = re.compile(
    r"f ?([xyztra]|[123]|ax|rad|tan)", re.IGNORECASE
)  # forces along axes of a dynamometer, or of a drawing

_COLUMN = {name: column for column, names in NAMES.items() for name in names}
_BRACKETS = re.compile(r"(.*?)\s*[\[({<]\s*([^\[({<]*?)\s*[\])}>]\s*", re.DOTALL)
_NUMBERED = re.compile(r" ?(#|id|no|nr|number|nummer)$")  # end of an edge's header
_GAP = re.compile(r"[\s_,/]+(?:in\s+)?")
_MICRO = str.maketrans("µμ·*", "uu  ")
_LETTERS = dict(
    zip(map(ord, "äöüßµμ·_."), ("ae", "oe", "ue", "ss", "u", "u", " ", " ", " "), strict=True)
)


class Heading(NamedTuple):
    """The reading of a sheet's header: its column, and the factor to the column's unit."""

    text: str  # header as written
    column: str | None  # of a sheet of cuts; None if it is not understood
    factor: float = 1.0  # size of the sheet's unit in the column's
    unlike: str = (
        ""  # what else the header may mean, as it states no unit; its numbers tell, see ``SIZES``
    )
    is_force: bool = False  # whether it is a force that cannot be told from the header

    def describe(self) -> str:
        """Return how the column is read, for people."""
        if not self.column:
            return f"nothing from {self.text!r}" + f", taken as {self.unlike}" * bool(self.unlike)
        unit = f" [{COLUMNS[self.column].unit}]" if self.column in COLUMNS else ""
        source = "" if self.text == self.column else f" from {self.text!r}"
        scaled = f" times {self.factor:.6g}" if self.factor != 1.0 else ""
        return f"{self.column}{unit}{source}{scaled}"


def read_heading(text: str, told: str | None = None) -> Heading:
    """Return how a column with this header is read; ``told`` is the column that the user says it is.

    A unit that only one of ``SPOKEN`` has names it. F, P and T are other quantities in other units.

    Raises:
        WorkshopError: The column is known, but its unit is not, or is one of another quantity.
    """
    text = text.strip()
    column, name, unit = _split(text)
    if told is not None:
        column = told
        unit = unit or _unit_after_gap(text, told)
    elif column is None:
        return Heading(
            text,
            None,
            is_force=bool(_AXES.fullmatch(_plain(name)))
            and (not unit or _unit(unit) in UNITS["force"]),
        )
    if column == EDGE or _column(unit) == column:  # as in "Vorschub (f)"
        return Heading(text, column)
    if not unit:
        unlike = BY_SIZE[name][1] if told is None and name in BY_SIZE else ""
        return Heading(text, column, unlike=unlike)
    sizes = _sizes(own := COLUMNS[column].unit)
    if _unit(unit) in sizes:
        return Heading(text, column, sizes[_unit(unit)] / sizes[_unit(own)])
    for dimension, other in BY_UNIT.get(name, {}).items() if told is None else ():
        if size := UNITS[dimension].get(_unit(unit)):
            return Heading(
                text, other, size / UNITS[dimension][_unit(COLUMNS[other].unit)] if other else 1.0
            )
    if column == "time" and told is None and _unit(unit) in TEMPERATURES:
        return Heading(text, None)
    others = " or ".join(name for name, each in COLUMNS.items() if _unit(unit) in _sizes(each.unit))
    allowed = (
        f"allowed are {', '.join(sizes)}, or no unit, which means {own}"
        + f"; is it {others}?" * bool(others)
    )
    raise WorkshopError(f"column {text!r}: {column} in {unit!r} is not understood: {allowed}")


def _split(text: str) -> tuple[str | None, str, str]:
    """Return the column that a header names, without regard to its unit, its name and its unit; empty if it has none."""
    bracketed = _BRACKETS.fullmatch(text)
    name, unit = bracketed.groups() if bracketed else (text, "")
    column = _column(name)
    if column is None and not bracketed:  # as in "ap_mm", "VB in mm", "P kW" and "time, s"
        for gap in _GAP.finditer(text):
            likely, rest = _column(text[: gap.start()]), text[gap.end() :]
            if likely and likely != EDGE and _is_unit_of(text[: gap.start()], likely, rest):
                return likely, text[: gap.start()], rest
    if column is None and not bracketed and _unit(text) not in LENGTH:
        column, unit = (
            next((each for each in SPOKEN if _unit(text) in _sizes(COLUMNS[each].unit)), None),
            text,
        )
        return (column, text, unit) if column else (None, text, "")
    return column, name, unit


def _is_unit_of(name: str, column: str, unit: str) -> bool:
    """Return whether a unit may follow the name of a column."""
    if _unit(unit) in _sizes(COLUMNS[column].unit):
        return True
    if column == "time" and _unit(unit) in TEMPERATURES:
        return True
    return any(_unit(unit) in UNITS[dimension] for dimension in BY_UNIT.get(name, ()))


def _unit_after_gap(text: str, column: str) -> str:
    """Return the unit of a column at the end of a header, as in "Fx N"; empty if there is none."""
    for gap in _GAP.finditer(text):
        if _unit(text[gap.end() :]) in _sizes(COLUMNS[column].unit):
            return text[gap.end() :]
    return ""


def named_column(name: str) -> str | None:
    """Return the column that a name or symbol means, as Fc; None if there is none."""
    return name if name in COLUMNS or name == EDGE else _column(name)


def is_header(name: str, text: str) -> bool:
    """Return whether a name is that of a header, with its unit or without."""
    text = text.strip()
    bracketed = _BRACKETS.fullmatch(text)
    return name.strip() in (text, bracketed[1] if bracketed else text, _GAP.split(text)[0])


def is_unit(text: str) -> bool:
    """Return whether a cell holds a unit, in brackets or not."""
    bracketed = _BRACKETS.fullmatch(text.strip())
    return any(_unit(bracketed[2] if bracketed else text) in sizes for sizes in UNITS.values())


def _plain(name: str) -> str:
    return re.sub(r"\s+", " ", name.casefold().translate(_LETTERS)).strip()


def _column(name: str) -> str | None:
    plain = _plain(name)
    twice = {
        _COLUMN.get(part.strip(" ,:=()[]")) for part in plain.rpartition(" ")[::2]
    }  # as in "Vorschub f" and "feed, f"
    return (
        EDGE
        if _COLUMN.get(_NUMBERED.sub("", plain)) == EDGE
        else _COLUMN.get(plain, twice.pop() if len(twice) == 1 else None)
    )


def _unit(text: str) -> str:
    plain = re.sub(r"\s*/\s*", "/", re.sub(r"\s+", " ", text.casefold().translate(_MICRO)).strip())
    return re.sub(r" ?min(\^?-1)$", "/min", plain)


def _sizes(unit: str) -> dict[str, float]:
    """Return the sizes of all units of a unit's dimension."""
    return next(sizes for sizes in UNITS.values() if _unit(unit) in sizes)
