"""Read an insert's designation: ISO 1832, such as CNMG120408-PM, or ANSI B212.4, such as CNMG432.

It gives shape, size, nose radius, edge preparation and number of edges. The chip breaker after it
is the maker's own: ``breakers.py``.
"""

import math
import re
from typing import NamedTuple

from turning_shop import WorkshopError
from turning_shop.catalogue import breakers
from turning_shop.catalogue.breakers import BREAKERS, Window

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
    # A round insert is turned four times; it cuts up to a quarter of its diameter deep.
    "R": _Shape("round", 4, 1.0, usable=1 / 4),
}
"""Shapes by their letter. ``usable``: assumption, the rule of thumb of makers' guides."""
_CIRCLES = (3.97, 4.76, 5.56, 6.35, 7.94, 9.525, 12.7, 15.875, 19.05, 25.4, 31.75)
_ROUND = (5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 25.0, 32.0)  # metric diameters, as in RCMT1204M0
DOUBLE_SIDED = "GANFUQJC"
"""Letters of inserts whose both faces have edges, if their clearance angle is 0 (N)."""

FLAT_TYPES = "ANQW"
"""Letters of inserts without chip breaker on any face."""
PREPARATIONS = {
    "F": "sharp",
    "E": "rounded",
    "T": "chamfered",
    "S": "chamfered and rounded",
    "K": "double chamfered",
    "P": "double chamfered and rounded",
}
"""Edge preparations of ISO 1832 by their letter."""

_ISO = re.compile(r"([A-Z])([A-Z])([A-Z])([A-Z])(\d\d)([0-9T]\d)(\d\d|M0)(?!\d)(.*)")
_ANSI = re.compile(r"([A-Z])([A-Z])([A-Z])([A-Z])(\d)(\d(?:\.\d)?)(\d(?:\.\d)?)(?!\d)(.*)")
# Edge preparation and direction, and the chamfer: width in 1/100 mm, angle in degrees.
_EDGE = re.compile(r"([EFSTKP]?)([LRN]?)(?:(\d{3})(\d\d))?(?:[-_/](.*))?")


class Edge(NamedTuple):
    """How the cutting edge is prepared."""

    letter: str = ""  # of ISO 1832; empty if the designation states none
    chamfer: float = 0.0  # its width [mm]; 0 if the designation states none
    angle: float = 0.0  # of the chamfer [degree]

    def __str__(self) -> str:
        if not self.letter:
            return ""
        text = f"edge {PREPARATIONS[self.letter]} ({self.letter})"
        if self.chamfer:
            text += f", chamfer {self.chamfer:g} mm by {self.angle:g} degrees"
        return text


class Insert(NamedTuple):
    """An insert for turning."""

    name: str
    shape: _Shape
    edges: int  # usable edges
    edge_length: float  # [mm]
    nose_radius: float  # [mm]
    edge: Edge
    breaker: str  # empty if the designation states none
    cut: Window
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
    def is_round(self) -> bool:
        """Whether the edge is a circle."""
        return self.shape is SHAPES["R"]

    def entering_sine(self, angle: float, depth: float) -> float:
        """Return the sine of the entering angle [-]: depth of cut over length of edge in the cut.

        Args:
            angle: of the straight edge to the feed [degree].
            depth: of cut [mm], on which the mean angle of a round insert depends.
        """
        if not self.is_round:
            return math.sin(math.radians(angle))
        radius = self.nose_radius
        depth = min(depth, radius)
        length = radius * math.acos(1.0 - depth / radius)
        return depth / length

    @property
    def max_depth(self) -> float:
        """Largest depth of cut that the edge's length allows [mm]."""
        return self.shape.usable * self.edge_length


def read_insert(text: str) -> Insert:
    """Return the insert of a designation.

    Raises:
        WorkshopError: It is no designation of an insert for turning; the message says what is.
    """
    plain = re.sub(r"\s", "", text.upper())
    compact = re.sub(r"^([A-Z]{4})[-_/]", r"\1", plain)
    if match := _ISO.fullmatch(compact):
        circle = _circle(text, shape_of(text, match[1]), match[1], match[5])
        radius = 0.0 if match[7] == "M0" else int(match[7]) / 10.0
    elif match := _ANSI.fullmatch(compact):
        circle = int(match[5]) / 8.0 * INCH
        radius = round(float(match[7]) / 64.0 * INCH, 1)
    else:
        raise WorkshopError(
            f"--tool {text}: this is no designation of ISO 1832, such as CNMG120408-PM "
            "(shape, clearance, tolerance, type; edge length, thickness and nose radius in two "
            "digits each; then the maker's chip breaker), nor of ANSI, such as CNMG432"
        )
    shape = shape_of(text, match[1])
    if match[1] == "R":
        radius = circle / 2.0
    if radius == 0.0:
        raise WorkshopError(f"--tool {text}: the nose radius is 0, of a sharp insert")
    if circle == 0.0:
        raise WorkshopError(f"--tool {text}: the size of the edge is 0")
    is_positive = match[2] != "N"
    is_double = not is_positive and match[4] in DOUBLE_SIDED
    edge, breaker = _edge_and_breaker(match[8])
    cut, assumptions = _cut(breaker, is_flat=match[4] in FLAT_TYPES)
    return Insert(
        name=text.strip(),
        shape=shape,
        edges=shape.corners * (2 if is_double else 1),
        edge_length=shape.edge_per_circle * circle,
        nose_radius=radius,
        edge=edge,
        breaker=breaker,
        cut=breakers.scaled_window(cut, circle, radius, is_positive=is_positive),
        assumptions=assumptions,
    )


def _edge_and_breaker(tail: str) -> tuple[Edge, str]:
    """Return the edge preparation and the chip breaker after the nose radius.

    Makers write their breaker after a hyphen, or without one, as Kennametal's FN. Letters that are
    a breaker's count as one.
    """
    first = re.split(r"[-_/]", tail.strip("-_/"))[0]
    if first in BREAKERS:
        return Edge(), first
    if re.fullmatch(r"[EFSTKP][LRN]?\d{5}", first):
        tail = tail.lstrip("-_/")  # a chamfer that is written after a hyphen
    match = _EDGE.fullmatch(tail)
    if not match:
        return Edge(), first
    letter, _, width, angle, breaker = match.groups(default="")
    edge = Edge(letter)
    if letter and width:
        edge = Edge(letter, chamfer=int(width) / 100.0, angle=float(angle))
    return edge, re.split(r"[-_/]", breaker)[0]


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
    for circle in _ROUND if letter == "R" else _CIRCLES:
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


def _cut(breaker: str, is_flat: bool) -> tuple[Window, tuple[str, ...]]:
    """Return the window of a chip breaker, and what was assumed."""
    if breaker in BREAKERS:
        known = BREAKERS[breaker]
        source = f"{known.window.source}; chip breaker {breaker} of {known.makers}"
        return known.window._replace(source=source), ()
    if is_flat and not breaker:
        return breakers.FLAT, ()
    named = f"chip breaker {breaker} is unknown" if breaker else "no chip breaker is stated"
    assumption = (
        f"{named}: a window between finishing and medium cuts; "
        "--feeds LOW-HIGH states the window on the box of inserts"
    )
    return breakers.UNKNOWN, (assumption,)
