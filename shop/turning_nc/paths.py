"""Paths of a tool in Z and X: straight moves, arcs, and broken corners between straight moves."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from turning_nc.dialects import CornerKind
from turning_nc.words import Problem

Point = tuple[float, float]  # Z and X [mm]; X is a radius

CHORD = 0.01  # largest distance of an arc from its chords [mm]
MAX_RADIUS = 1e6  # of an arc [mm]; with a larger one it is straight


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
        return math.dist(self.start, self.centre) * abs(self._turn())

    @property
    def reach(self) -> Point:
        """X at start and end [mm]."""
        return self.start[1], self.end[1]

    @property
    def direction(self) -> Point:
        """Unit vector of a straight move."""
        return (self.end[0] - self.start[0]) / self.length, (
            self.end[1] - self.start[1]
        ) / self.length

    def _turn(self) -> float:
        assert self.centre is not None
        first, last = (
            math.atan2(point[1] - self.centre[1], point[0] - self.centre[0])
            for point in (self.start, self.end)
        )
        full = 2.0 * math.pi
        turn = (first - last) % full if self.clockwise else (last - first) % full
        turn = full if turn < 1e-9 or full - turn < 1e-9 else turn
        return -turn if self.clockwise else turn

    def points(self) -> list[Point]:
        """Return the ends of the chords: the end alone for a straight move."""
        if self.centre is None:
            return [self.end]
        (z, x), radius, turn = self.centre, math.dist(self.start, self.centre), self._turn()
        step = 2.0 * math.acos(max(1.0 - CHORD / radius, 0.0)) if radius > CHORD else math.pi
        count = max(math.ceil(abs(turn) / step), 2)
        first = math.atan2(self.start[1] - x, self.start[0] - z)
        angles = [first + turn * index / count for index in range(1, count)]
        return [
            *((z + radius * math.cos(angle), x + radius * math.sin(angle)) for angle in angles),
            self.end,
        ]

    def moved(self, dz: float, dx: float) -> "Path":
        """Return the path shifted."""
        centre = None if self.centre is None else shifted(self.centre, (dz, dx))
        return replace(
            self,
            start=shifted(self.start, (dz, dx)),
            end=shifted(self.end, (dz, dx)),
            centre=centre,
        )


@dataclass(frozen=True)
class Corner:
    """A chamfer or a radius that a block puts at the end of its move."""

    kind: CornerKind
    size: float  # [mm]
    line: int
    modal: bool = False  # whether it holds for all corners between moves at feed (RNDM)


def shifted(point: Point, direction: Point, length: float = 1.0) -> Point:
    """Return the point at a distance along a direction."""
    return point[0] + length * direction[0], point[1] + length * direction[1]


def joined(start: Point, *ends: tuple[Point, bool]) -> Iterator[Path]:
    """Yield straight moves to points that are apart; the flags mark rapid moves."""
    for end, rapid in ends:
        if math.dist(start, end) > 1e-9:
            yield Path(start, end, rapid=rapid)
            start = end


def arc_of_radius(start: Point, end: Point, radius: float, clockwise: bool) -> Path:
    """Return the arc of a radius [mm]: the shorter one, or the longer one if the radius is negative."""
    chord = math.dist(start, end)
    if abs(radius) > MAX_RADIUS:
        raise Problem(
            f"an arc of radius {abs(radius):g} mm is larger than {MAX_RADIUS:g} mm: is it straight?"
        )
    if chord < 1e-9 or abs(radius) < 0.5 * chord - 1e-3:
        raise Problem(
            f"an arc of radius {abs(radius):g} mm cannot join points {chord:.3f} mm apart"
        )
    height = math.sqrt(max(radius**2 - 0.25 * chord**2, 0.0))
    side = (1.0 if clockwise else -1.0) * math.copysign(1.0, radius)
    dz, dx = (end[0] - start[0]) / chord, (end[1] - start[1]) / chord
    middle = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])
    return Path(
        start, end, (middle[0] + side * height * dx, middle[1] - side * height * dz), clockwise
    )


def break_corner(before: Path, after: Path, corner: Corner) -> tuple[Path, Path | None, Path]:
    """Return two moves that end at a broken corner, and the chamfer or the arc between them."""
    if before.centre or after.centre:
        raise Problem("a chamfer or a radius beside an arc is not understood: write its points")
    first, second = before.direction, after.direction
    cross = first[0] * second[1] - first[1] * second[0]
    turn = math.atan2(cross, first[0] * second[0] + first[1] * second[1])
    if abs(turn) < 1e-6:
        return before, None, after
    half = 0.5 * abs(turn)
    cut = (
        corner.size
        * {"legs": 1.0, "chord": 0.5 / math.cos(half), "radius": math.tan(half)}[corner.kind]
    )
    if cut > min(before.length, after.length) + 1e-6:
        raise Problem(
            f"the chamfer or radius of line {corner.line} takes {cut:.3f} mm of a move that is shorter"
        )
    start, end = shifted(before.end, first, -cut), shifted(after.start, second, cut)
    centre = None
    if corner.kind == "radius":
        side = math.copysign(corner.size, turn)
        centre = start[0] - side * first[1], start[1] + side * first[0]
    return Path(before.start, start), Path(start, end, centre, turn < 0.0), Path(end, after.end)
