"""Paths of a tool: straight moves and arcs, in Z and X."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

Point = tuple[float, float]
"""Z and X [mm]; X is a radius."""

CHORD = 0.01
"""Largest distance of an arc from its chords [mm]."""


@dataclass(frozen=True)
class Path:
    """A straight move or an arc."""

    start: Point
    end: Point
    centre: Point | None = None
    clockwise: bool = False
    """Seen with Z to the right and X upwards."""
    rapid: bool = False

    @property
    def length(self) -> float:
        """Length [mm]."""
        if self.centre is None:
            return math.dist(self.start, self.end)
        return math.dist(self.start, self.centre) * abs(self._turn())

    def _turn(self) -> float:
        assert self.centre is not None
        first, last = (math.atan2(point[1] - self.centre[1], point[0] - self.centre[0]) for point in (self.start, self.end))
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
        return [*((z + radius * math.cos(angle), x + radius * math.sin(angle)) for angle in angles), self.end]

    def moved(self, dz: float, dx: float) -> "Path":
        """Return the path shifted."""
        start, end, centre = ((point[0] + dz, point[1] + dx) if point else None for point in (self.start, self.end, self.centre))
        assert start is not None
        assert end is not None
        return replace(self, start=start, end=end, centre=centre)


def joined(start: Point, *ends: tuple[Point, bool]) -> Iterator[Path]:
    """Yield straight moves to points that are apart; the flags mark rapid moves."""
    for end, rapid in ends:
        if math.dist(start, end) > 1e-9:
            yield Path(start, end, rapid=rapid)
            start = end
