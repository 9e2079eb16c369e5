"""Recognise the columns of a sheet by headers: English and German names, symbols and units.

The cells below the headers are read by ``measurements.py``.
"""

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from turning_shop import WorkshopError


class Column(NamedTuple):
    """A quantity and its range of plausible values, ends included.

    A value outside the range is probably in another unit.
    """

    unit: str
    low: float  # [unit]
    high: float  # [unit]
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
        meaning="cutting time since the edge was fresh, all at this speed, feed and depth",
        may_be_zero=True,
    ),
    "wear": Column(
        "mm",
        1e-4,
        5,
        meaning="flank wear of the edge since it was fresh; 0: a fresh edge",
        may_be_zero=True,
    ),
    "thrust_force": Column("N", 1e-3, 1e6, "thrust force: the resultant of feed and back force"),
    "power": Column("kW", 1e-4, 1e4, "spindle power"),
    "main_force": Column(
        "N",
        1e-3,
        1e6,
        meaning="main cutting force Fc (ISO 3002), which gives the power if no column does",
    ),
    "feed_force": Column(
        "N",
        1e-3,
        1e6,
        meaning="feed force Ff (ISO 3002), which with the back force gives the thrust force",
    ),
    "back_force": Column(
        "N",
        1e-3,
        1e6,
        meaning="back force Fp (ISO 3002), also called passive or radial force",
    ),
    "hardness": Column("-", 0.1, 10, "hardness of the bar over nominal hardness: 1 is nominal"),
}
"""Columns of numbers of a sheet of cuts.

A row with an empty cell in the column ``EDGE`` has an edge of its own.
"""

LENGTHS = {"mm": 1.0, "um": 0.001, "in": 25.4, "inch": 25.4}

UNITS = {
    "speed": {
        "m/min": 1.0,
        "m/s": 60.0,
        "ft/min": 0.3048,
        "sfm": 0.3048,
        "sfpm": 0.3048,
        "fpm": 0.3048,
    },
    "length": LENGTHS,
    # A feed in mm is one per revolution (DIN 6580).
    "feed": {
        "mm/rev": 1.0,
        "mm/r": 1.0,
        "mm/u": 1.0,
        "mm/umdr": 1.0,
        "um/rev": 0.001,
        "in/rev": 25.4,
        "ipr": 25.4,
        **LENGTHS,
    },
    "time": {"min": 1.0, "s": 1 / 60, "sec": 1 / 60, "sek": 1 / 60, "ms": 1 / 60e3, "h": 60.0},
    "force": {"n": 1.0, "kn": 1000.0, "dan": 10.0, "lbf": 4.4482216},
    "power": {"kw": 1.0, "w": 0.001, "hp": 0.745700, "ps": 0.735499},
    "ratio": {"-": 1.0, "1": 1.0, "%": 0.01},
}
"""Units of each dimension, in small letters, and their sizes."""
CONVERSIONS = {
    "cutting_speed": "a spindle speed n [rev/min] is pi d n / 1000 m/min at a diameter d [mm]",
    "feed": "a feed in mm/min is first divided by the spindle speed [rev/min]",
}
"""How other quantities become these columns, for people."""
TEMPERATURES = ("\N{DEGREE SIGN}c", "c", "k", "degc", "deg c", "\N{DEGREE SIGN}f", "grad c")
"""Units of temperatures, in small letters: no column holds any."""

NAMED_BY_UNIT = ("cutting_speed", "feed", "power")
"""Columns that a header may name by a unit alone, as in "SFM", "IPR" and "HP"."""

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
        "verschleiss",
        "freiflaechenverschleiss",
        "verschleissmarkenbreite",
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
"""Headers of each column without units and in small letters.

They have spaces for "_" and ".", and two letters for an umlaut.
"""

FORCE_SYMBOLS = {"F": None, "P": "back_force", "p": "back_force"}
"""Columns of symbols that mean a force if their unit is one.

None stands for the resultant of all forces, which is not read.
"""
OTHER_MEANINGS = {"F": "a force", "P": "the passive (back) force", "T": "a temperature"}
"""Meanings of symbols that, without a unit, stand for a column or for something else."""
MAX_NUMBERS = {"feed": 10.0, "power": 30.0, "time": 100.0}
"""Largest numbers with which such a symbol still stands for the column.

Forces are larger in N, and temperatures are larger in any unit.
"""

# Forces along the axes of a dynamometer, or of a drawing.
_AXES = re.compile(r"f ?([xyztra]|[123]|ax|rad|tan)", re.IGNORECASE)
_COLUMN = {name: column for column, names in NAMES.items() for name in names}
_BRACKETS = re.compile(r"(.*?)\s*[\[({<]\s*([^\[({<]*?)\s*[\])}>]\s*", re.DOTALL)
_NUMBERED = re.compile(r" ?(#|id|no|nr|number|nummer)$")  # end of an edge's header
_GAP = re.compile(r"[\s_,/]+(?:in\s+)?")
_PUNCTUATION = " ,:=()[]"
_MICRO = str.maketrans("µμ·*", "uu  ")
_LETTERS = str.maketrans(
    {
        "ä": "ae",
        "ö": "oe",
        "ü": "ue",
        "ß": "ss",
        "µ": "u",
        "μ": "u",
        "·": " ",
        "_": " ",
        ".": " ",
    }
)


class Heading(NamedTuple):
    """The reading of a sheet's header: its column, and the factor to the column's unit."""

    text: str  # header as written
    column: str | None  # of a sheet of cuts; None if it is not understood
    factor: float = 1.0  # size of the sheet's unit in the column's
    # What else the header may mean, as it states no unit; the numbers tell: see ``MAX_NUMBERS``.
    other_meaning: str = ""
    is_force: bool = False  # whether it is a force along an unknown axis

    def describe(self) -> str:
        """Return how the column is read, for people."""
        if not self.column:
            taken_as = f", taken as {self.other_meaning}" if self.other_meaning else ""
            return f"nothing from {self.text!r}{taken_as}"
        description = self.column
        if self.column in COLUMNS:
            description += f" [{COLUMNS[self.column].unit}]"
        if self.text != self.column:
            description += f" from {self.text!r}"
        if self.factor != 1.0:
            description += f" times {self.factor:.6g}"
        return description


def read_heading(
    text: str,
    stated_column: str | None = None,
    stated_units: Mapping[str, str] = MappingProxyType({}),
) -> Heading:
    """Return how a column with this header is read.

    The user may state the column, and the units of columns by their names. A unit that only one of
    ``NAMED_BY_UNIT`` has names it. F, P and T are other quantities in other units.

    Raises:
        WorkshopError: The column is known, but its unit is not, or is one of another quantity.
    """
    text = text.strip()
    parts = _split(text)
    unit = parts.unit
    if stated_column is not None:
        column = stated_column
        unit = unit or _unit_after_gap(text, stated_column)
    elif parts.column is None:
        return Heading(text, None, is_force=_is_force_along_axis(parts))
    else:
        column = parts.column
    unit = stated_units.get(column, unit)

    # The brackets may hold the symbol instead of a unit, as in "Vorschub (f)".
    if column == EDGE or _column(unit) == column:
        return Heading(text, column)
    if not unit:
        other_meaning = OTHER_MEANINGS.get(parts.name, "") if stated_column is None else ""
        return Heading(text, column, other_meaning=other_meaning)

    column_unit = COLUMNS[column].unit
    sizes = _sizes(column_unit)
    if _unit(unit) in sizes:
        return Heading(text, column, factor=sizes[_unit(unit)] / sizes[_unit(column_unit)])
    heading = None if stated_column is not None else _other_quantity(text, parts)
    if heading is None:
        raise WorkshopError(_not_understood(text, column, unit))
    return heading


class _Parts(NamedTuple):
    """The parts of a header."""

    column: str | None  # that the name means, whatever the unit; None if there is none
    name: str
    unit: str  # empty if the header states none


def _split(text: str) -> _Parts:
    """Return the parts of a header."""
    bracketed = _BRACKETS.fullmatch(text)
    if bracketed:
        name, unit = bracketed.groups()
        return _Parts(_column(name), name, unit)
    column = _column(text)
    if column is not None:
        return _Parts(column, text, unit="")

    # The unit may follow after a gap, as in "ap_mm", "VB in mm", "P kW" and "time, s".
    for gap in _GAP.finditer(text):
        name = text[: gap.start()]
        unit = text[gap.end() :]
        column = _column(name)
        if column is None or column == EDGE:
            continue
        if _is_unit_of(name, column, unit):
            return _Parts(column, name, unit)

    # Lengths are units of several columns, so that a length alone names none.
    if _unit(text) not in LENGTHS:
        for column in NAMED_BY_UNIT:
            if _unit(text) in _sizes(COLUMNS[column].unit):
                return _Parts(column, text, unit=text)
    return _Parts(None, text, unit="")


def _is_force_along_axis(parts: _Parts) -> bool:
    """Return whether a header names a force along an axis, such as Fx, and no other unit."""
    if not _AXES.fullmatch(_plain(parts.name)):
        return False
    return not parts.unit or _unit(parts.unit) in UNITS["force"]


def _other_quantity(text: str, parts: _Parts) -> Heading | None:
    """Return the reading of a symbol in a unit of another quantity; None if it has none."""
    unit = _unit(parts.unit)
    forces = UNITS["force"]
    if parts.name in FORCE_SYMBOLS and unit in forces:
        force = FORCE_SYMBOLS[parts.name]
        if force is None:
            return Heading(text, None)
        return Heading(text, force, factor=forces[unit] / forces[_unit(COLUMNS[force].unit)])
    if parts.column == "time" and unit in TEMPERATURES:
        return Heading(text, None)
    return None


def _not_understood(text: str, column: str, unit: str) -> str:
    """Return the message on a column in a unit that it cannot have."""
    column_unit = COLUMNS[column].unit
    allowed = ", ".join(_sizes(column_unit))
    message = (
        f"column {text!r}: {column} in {unit!r} is not understood: "
        f"allowed are {allowed}, or no unit, which means {column_unit}"
    )
    likely = [name for name, other in COLUMNS.items() if _unit(unit) in _sizes(other.unit)]
    if likely:
        message += f"; is it {' or '.join(likely)}?"
    elif column in CONVERSIONS:
        message += f"; {CONVERSIONS[column]}"
    return message


def _is_unit_of(name: str, column: str, unit: str) -> bool:
    """Return whether a unit may follow the name of a column."""
    if _unit(unit) in _sizes(COLUMNS[column].unit):
        return True
    if column == "time" and _unit(unit) in TEMPERATURES:
        return True
    return name in FORCE_SYMBOLS and _unit(unit) in UNITS["force"]


def _unit_after_gap(text: str, column: str) -> str:
    """Return a column's unit at the end of a header, as in "Fx N"; empty if there is none."""
    for gap in _GAP.finditer(text):
        unit = text[gap.end() :]
        if _unit(unit) in _sizes(COLUMNS[column].unit):
            return unit
    return ""


def plausible_units(column: str, low: float, high: float) -> list[str]:
    """Return the units in which numbers from ``low`` to ``high`` may be of a column."""
    allowed = COLUMNS[column]
    sizes = _sizes(allowed.unit)
    size_of_unit = sizes[_unit(allowed.unit)]
    plausible = []
    for unit, size in sizes.items():
        factor = size / size_of_unit
        if allowed.low <= factor * low and factor * high <= allowed.high:
            plausible.append(unit)
    return plausible


def is_unit_of(unit: str, column: str) -> bool:
    """Return whether a column may be in a unit."""
    return _unit(unit) in _sizes(COLUMNS[column].unit)


def units_of(column: str) -> list[str]:
    """Return the units in which a column may be."""
    return list(_sizes(COLUMNS[column].unit))


def named_column(name: str) -> str | None:
    """Return the column that a name or symbol means, as Fc; None if there is none."""
    return name if name in COLUMNS or name == EDGE else _column(name)


def is_header(name: str, text: str) -> bool:
    """Return whether a name is that of a header, with its unit or without."""
    text = text.strip()
    bracketed = _BRACKETS.fullmatch(text)
    without_unit = bracketed[1] if bracketed else text
    return name.strip() in (text, without_unit, _GAP.split(text)[0])


def is_unit(text: str) -> bool:
    """Return whether a cell holds a unit, in brackets or not."""
    bracketed = _BRACKETS.fullmatch(text.strip())
    unit = _unit(bracketed[2] if bracketed else text)
    return any(unit in sizes for sizes in UNITS.values())


def _plain(name: str) -> str:
    """Return a name as in ``NAMES``."""
    return re.sub(r"\s+", " ", name.casefold().translate(_LETTERS)).strip()


def _column(name: str) -> str | None:
    """Return the column that a name without a unit means; None if there is none."""
    plain = _plain(name)
    if _COLUMN.get(_NUMBERED.sub("", plain)) == EDGE:
        return EDGE
    if plain in _COLUMN:
        return _COLUMN[plain]
    # A name and its symbol may stand side by side, as in "Vorschub f" and "feed, f".
    first, last = plain.rpartition(" ")[::2]
    column = _COLUMN.get(first.strip(_PUNCTUATION))
    return column if column == _COLUMN.get(last.strip(_PUNCTUATION)) else None


def _unit(text: str) -> str:
    """Return a unit as in ``UNITS``: "mm / U" is "mm/u", and "m min-1" is "m/min"."""
    spaced = re.sub(r"\s+", " ", text.casefold().translate(_MICRO)).strip()
    plain = re.sub(r"\s*/\s*", "/", spaced)
    return re.sub(r" ?min(\^?-1)$", "/min", plain)


def _sizes(unit: str) -> dict[str, float]:
    """Return the sizes of all units of a unit's dimension."""
    return next(sizes for sizes in UNITS.values() if _unit(unit) in sizes)
