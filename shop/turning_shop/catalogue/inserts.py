"""Read an insert's designation: ISO 1832, such as CNMG120408-PM, or ANSI B212.4, such as CNMG432.

It gives shape, size, nose radius and number of edges. The chip breaker after it is the maker's own;
its last letter usually says for which cuts it is made.
"""

import math
import re
from typing import NamedTuple

from turning_shop import WorkshopError
from turning_shop.catalogue import Range

INCH = 25.4  # [mm]


class _Shape(NamedTuple):
    """A shape of ISO 1832."""

    name: str
    corners: int  # of one face
    edge_per_circle: float  # length of the edge over the diameter of the inscribed circle [-]
    usable: float  # largest depth of cut over the length of the edge [-]


def _rhombus(name: str, angle: float, usable: float) -> _Shape:
    edge_per_circle = 1.0 / math.sin(math.radians(angle))
    return _Shape(name, 2, edge_per_circle, usable=usable)


SHAPES = {
    "C": _rhombus("rhombic, 80 degrees", 80.0, usable=2 / 3),
    "D": _rhombus("rhombic, 55 degrees", 55.0, usable=1 / 2),
    "E": _rhombus("rhombic, 75 degrees", 75.0, usable=2 / 3),
    "V": _rhombus("rhombic, 35 degrees", 35.0, usable=1 / 4),
    "S": _Shape("square", 4, 1.0, usable=2 / 3),
    "T": _Shape("triangular", 3, math.sqrt(3.0), usable=1 / 2),
    "W": _Shape("trigon, 80 degrees", 3, 0.6844, usable=1 / 2),
}
"""Shapes by their letter. ``usable``: assumption, the rule of thumb of makers' guides."""
_CIRCLES = (3.97, 4.76, 5.56, 6.35, 7.94, 9.525, 12.7, 15.875, 19.05, 25.4, 31.75)
DOUBLE_SIDED = "GANFUQJC"
"""Letters of inserts whose both faces have edges, if their clearance angle is 0 (N)."""

_ISO = re.compile(
    r"([A-Z])([A-Z])([A-Z])([A-Z])(\d\d)([0-9T]\d)(\d\d)(?!\d)([EFSTKP]?)([LRN]?)(.*)"
)
_ANSI = re.compile(r"([A-Z])([A-Z])([A-Z])([A-Z])(\d)(\d(?:\.\d)?)(\d(?:\.\d)?)(?!\d)(.*)")


class Insert(NamedTuple):
    """An insert for turning."""

    name: str
    shape: _Shape
    edges: int  # usable edges
    edge_length: float  # [mm]
    nose_radius: float  # [mm]
    cut: "Cut"
    assumptions: tuple[str, ...] = ()

    @property
    def feeds(self) -> tuple[float, float]:
        """Lowest and highest feed of the chip breaker [mm/rev]."""
        return self.cut.feed.low, self.cut.feed.high

    @property
    def depths(self) -> tuple[float, float]:
        """Smallest and largest depth of cut [mm]: of the chip breaker, and of the edge."""
        return self.cut.depth.low, min(self.cut.depth.high, self.max_depth)

    @property
    def max_depth(self) -> float:
        """Largest depth of cut that the edge's length allows [mm]."""
        return self.shape.usable * self.edge_length


class Cut(NamedTuple):
    """The cuts for which chip breakers are made."""

    name: str
    feed: Range  # [mm/rev]
    depth: Range  # [mm]


CUTS = {
    "F": Cut("finishing", Range(0.1, 0.25, 0.4), Range(0.5, 1.0, 1.5)),
    "M": Cut("medium cuts", Range(0.2, 0.35, 0.5), Range(1.0, 2.5, 4.0)),
    "R": Cut("roughing", Range(0.3, 0.45, 0.6), Range(1.5, 4.0, 6.0)),
}
"""Windows of feed and depth by the breaker's last letter."""
CUTS_SOURCE = "Sumitomo general catalogue 2019-2020, p. 13 (chip breakers for steel)"


def read_insert(text: str) -> Insert:
    """Return the insert of a designation.

    Raises:
        WorkshopError: It is no designation of an insert for turning; the message says what is.
    """
    plain = re.sub(r"\s", "", text.upper())
    if re.match(r"R[A-Z]{3}\d", plain):
        raise WorkshopError(
            f"--tool {text}: round inserts are not covered, as their chip is thinner than the "
            "feed: measure cuts, and use calibrate"
        )
    compact = re.sub(r"^([A-Z]{4})[-_/]", r"\1", plain)
    if match := _ISO.fullmatch(compact):
        circle = _circle(text, shape_of(text, match[1]), match[1], match[5])
        radius = int(match[7]) / 10.0
        breaker = match[10]
    elif match := _ANSI.fullmatch(compact):
        circle = int(match[5]) / 8.0 * INCH
        radius = round(float(match[7]) / 64.0 * INCH, 1)
        breaker = match[8]
    else:
        raise WorkshopError(
            f"--tool {text}: this is no designation of ISO 1832, such as CNMG120408-PM "
            "(shape, clearance, tolerance, type; edge length, thickness and nose radius in two "
            "digits each; then the maker's chip breaker), nor of ANSI, such as CNMG432"
        )
    shape = shape_of(text, match[1])
    if radius == 0.0:
        raise WorkshopError(f"--tool {text}: the nose radius is 0, of a sharp insert")
    if circle == 0.0:
        raise WorkshopError(f"--tool {text}: the size of the edge is 0")
    is_double = match[2] == "N" and match[4] in DOUBLE_SIDED
    cut, assumptions = _cut(breaker.strip("-_/"))
    return Insert(
        name=text.strip(),
        shape=shape,
        edges=shape.corners * (2 if is_double else 1),
        edge_length=shape.edge_per_circle * circle,
        nose_radius=radius,
        cut=cut,
        assumptions=assumptions,
    )


def shape_of(text: str, letter: str) -> _Shape:
    """Return the shape of a designation's first letter."""
    if letter not in SHAPES:
        known = ", ".join(f"{key} {shape.name}" for key, shape in SHAPES.items())
        raise WorkshopError(f"--tool {text}: the shape {letter} is not known; known are {known}")
    return SHAPES[letter]


def _circle(text: str, shape: _Shape, letter: str, code: str) -> float:
    """Return the diameter of the inscribed circle [mm] of a size's two digits.

    The digits are the length of the edge in whole millimetres, without decimals.
    """
    circles = {}
    for circle in _CIRCLES:
        edge = int(shape.edge_per_circle * circle)
        circles[f"{edge:02d}"] = circle
    if code not in circles:
        sizes = ", ".join(sorted(circles))
        near = min(circles, key=lambda other: abs(int(other) - int(code)))
        raise WorkshopError(
            f"--tool {text}: shape {letter} has no size {code}; did you mean {near}? "
            f"Its sizes are {sizes}"
        )
    return circles[code]


def _cut(breaker: str) -> tuple[Cut, tuple[str, ...]]:
    """Return the cuts of a chip breaker, and what was assumed.

    Makers put a letter for the material before that for the cut: -PM, -MF, -KR.
    """
    letters = breaker.split("-")[0]
    if re.fullmatch(r"W?[PMKNS]?[FMR]\d?", letters):
        return CUTS[letters.rstrip("0123456789")[-1]], ()
    named = f"chip breaker {letters}" if letters else "no chip breaker"
    assumption = (
        f"{named}: taken as one for medium cuts; "
        "--feeds LOW-HIGH states the window on the box of inserts"
    )
    return CUTS["M"], (assumption,)
