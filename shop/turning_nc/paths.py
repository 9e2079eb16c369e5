"""Paths of a tool in Z and X: straight moves, arcs, and broken corners between straight moves."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from turning_nc.dialects import CornerKind
from turning_nc.words import BlockError

CHORD = 0.01  # largest distance of an arc from its chords [mm]
MAX_RADIUS = 1e6  # of an arc [mm]; with a larger one it is straight
MIN_LENGTH = 1e-9  # length from which points are apart [mm]; rounding errors are below it
MIN_TURN = 1e-6  # angle between moves from which they make a corner [rad]
CORNER_TOLERANCE = 1e-6  # by which a broken corner may be longer than its move [mm]
RADIUS_TOLERANCE = 1e-3  # by which an arc may be short of half its chord [mm]


class Point(NamedTuple):
    """A place of the tool."""

    z: float  # [mm]
    x: float  # as a radius [mm]


@dataclass(frozen=True)
class Path:
    """A straight move or an arc."""

    start: Point
    end: Point
    centre: Point | None = None
    clockwise: bool = False  # seen with Z to the right and X upwards
    rapid: bool = False
    line: int = 0  # line of the block of a contour

    @property
    def length(self) -> float:
        """Length [mm]."""
        if self.centre is None:
            return math.dist(self.start, self.end)
        return math.dist(self.start, self.centre) * abs(self._turn(self.centre))

    @property
    def reach(self) -> tuple[float, float]:
        """X at start and end [mm]."""
        return self.start.x, self.end.x

    @property
    def direction(self) -> Point:
        """Unit vector of a straight move."""
        length = self.length
        dz = (self.end.z - self.start.z) / length
        dx = (self.end.x - self.start.x) / length
        return Point(dz, dx)

    def _turn(self, centre: Point) -> float:
        """Return the signed angle of an arc [rad], positive counter-clockwise."""
        first = _angle(centre, self.start)
        last = _angle(centre, self.end)
        full = 2.0 * math.pi
        turn = first - last if self.clockwise else last - first
        turn %= full
        # An arc that ends where it starts is a full circle (ISO 6983), whatever the rounding.
        if turn < 1e-9 or full - turn < 1e-9:
            turn = full
        return -turn if self.clockwise else turn

    def points(self) -> list[Point]:
        """Return the ends of the chords: the end alone for a straight move."""
        if self.centre is None:
            return [self.end]
        centre = self.centre
        radius = math.dist(self.start, centre)
        turn = self._turn(centre)

        # A chord that turns by an angle a is radius * (1 - cos(a / 2)) from its arc.
        step = math.pi
        if radius > CHORD:
            step = 2.0 * math.acos(max(1.0 - CHORD / radius, 0.0))
        count = max(math.ceil(abs(turn) / step), 2)
        first = _angle(centre, self.start)
        points = []
        for index in range(1, count):
            angle = first + turn * index / count
            z = centre.z + radius * math.cos(angle)
            x = centre.x + radius * math.sin(angle)
            points.append(Point(z, x))
        points.append(self.end)
        return points

    def moved(self, by: Point) -> "Path":
        """Return the path shifted."""
        return replace(
            self,
            start=shifted(self.start, by),
            end=shifted(self.end, by),
            centre=None if self.centre is None else shifted(self.centre, by),
        )


@dataclass(frozen=True)
class Corner:
    """A chamfer or a radius that a block puts at the end of its move."""

    kind: CornerKind
    size: float  # [mm]
    line: int
    modal: bool = False  # whether it holds for all corners between moves at feed (RNDM)


@dataclass(frozen=True)
class BrokenCorner:
    """Two moves that end at a broken corner, and the chamfer or the arc between them."""

    before: Path
    between: Path | None  # None if the moves make no corner
    after: Path


class Stop(NamedTuple):
    """A point to which the tool moves straight."""

    point: Point
    rapid: bool


def shifted(
    point: tuple[float, float], direction: tuple[float, float], length: float = 1.0
) -> Point:
    """Return the point at a distance along a direction."""
    z = point[0] + length * direction[0]
    x = point[1] + length * direction[1]
    return Point(z, x)


def _angle(centre: Point, point: Point) -> float:
    """Return the angle of a point around a centre, from Z to X [rad]."""
    return math.atan2(point.x - centre.x, point.z - centre.z)


def straight_paths(start: Point, *stops: Stop) -> Iterator[Path]:
    """Yield straight moves to the stops that are apart."""
    for stop in stops:
        if math.dist(start, stop.point) > MIN_LENGTH:
            yield Path(start, stop.point, rapid=stop.rapid)
            start = stop.point


def arc_of_radius(start: Point, end: Point, radius: float, clockwise: bool) -> Path:
    """Return the arc of a radius [mm].

    It is the shorter of the two arcs, or the longer one if the radius is negative, as ISO 6983,
    Fanuc (R) and SINUMERIK (CR=) have it.

    Raises:
        BlockError: the radius is too large for an arc, or too small to join the points.
    """
    size = abs(radius)
    chord = math.dist(start, end)
    if size > MAX_RADIUS:
        raise BlockError(
            f"an arc of radius {size:g} mm is larger than {MAX_RADIUS:g} mm: is it straight?"
        )
    least = 0.5 * chord - RADIUS_TOLERANCE
    if chord < MIN_LENGTH or size < least:
        raise BlockError(f"an arc of radius {size:g} mm cannot join points {chord:.3f} mm apart")
    # The centre lies on the chord's perpendicular bisector: of the shorter arc to the right of the
    # chord if it is clockwise, of the longer one to the left.
    square_height = radius**2 - 0.25 * chord**2
    height = math.sqrt(max(square_height, 0.0))
    side = math.copysign(1.0, radius)
    if not clockwise:
        side = -side
    offset = side * height
    dz = (end.z - start.z) / chord
    dx = (end.x - start.x) / chord
    middle_z = 0.5 * (start.z + end.z)
    middle_x = 0.5 * (start.x + end.x)
    centre = Point(middle_z + offset * dx, middle_x - offset * dz)
    return Path(start, end, centre=centre, clockwise=clockwise)


def break_corner(before: Path, after: Path, corner: Corner) -> BrokenCorner:
    """Return two straight moves with a chamfer or a radius between them.

    Raises:
        BlockError: a move is an arc, or is shorter than what the corner takes of it.
    """
    if before.centre or after.centre:
        raise BlockError("a chamfer or a radius beside an arc is not understood: write its points")
    first = before.direction
    second = after.direction
    cross = first.z * second.x - first.x * second.z
    dot = first.z * second.z + first.x * second.x
    turn = math.atan2(cross, dot)
    # The turn is positive from Z towards X.
    if abs(turn) < MIN_TURN:
        return BrokenCorner(before, None, after)
    cut = corner.size * _cut_per_size(corner.kind, 0.5 * abs(turn))
    if cut > min(before.length, after.length) + CORNER_TOLERANCE:
        raise BlockError(
            f"the chamfer or radius of line {corner.line} takes {cut:.3f} mm "
            "of a move that is shorter"
        )
    start = shifted(before.end, first, -cut)
    end = shifted(after.start, second, cut)
    centre = None
    if corner.kind == "radius":
        # The centre lies across the first move, on the side to which the tool turns.
        side = math.copysign(corner.size, turn)
        centre = Point(start.z - side * first.x, start.x + side * first.z)
    return BrokenCorner(
        before=Path(before.start, start),
        between=Path(start, end, centre=centre, clockwise=turn < 0.0),
        after=Path(end, after.end),
    )


def _cut_per_size(kind: CornerKind, half: float) -> float:
    """Return the length that a corner takes of each move, over its size.

    ``half`` is half the angle by which the moves turn [rad].
    """
    if kind == "chord":  # CHF of SINUMERIK is the length of the chamfer itself
        return 0.5 / math.cos(half)
    if kind == "radius":
        return math.tan(half)
    return 1.0  # CHR of SINUMERIK, and ,C of Fanuc, are its legs
