"""Roughing cycles (G71, G72, CYCLE95): the passes that a control makes of a contour.

Passes are parallel to the axis of the feed, from the stock to the contour, followed by one along the contour. A control's own
escape and return moves differ in details; they are in air.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
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


@dataclass(frozen=True)
class Roughing:
    """What a roughing cycle is told."""

    depth: float
    """Depth of cut per pass [mm]."""
    retraction: float
    """Distance by which the tool leaves the cut on both axes [mm]."""
    allowance: Point
    """Metal that stays for the finishing cut, along Z and X with the contour's side as sign [mm]."""
    facing: bool = False
    """Whether passes run along X."""
    equal: bool = False
    """Whether the depth is reduced so that all passes have the same (CYCLE95)."""


def passes(contour: Sequence[Path], start: Point, told: Roughing) -> list[list[Path]]:
    """Return the moves of every pass, from the start point and back to it.

    Args:
        contour: the finished contour, without the move that leads to it.
        start: where the tool stands before the cycle.
        told: see ``Roughing``.

    Raises:
        ValueError: the contour has pockets, no extent, or too many passes; says which.
    """
    if told.depth <= 0.0:
        raise ValueError(f"the depth of the passes is {told.depth:g} mm, but must be above 0")
    shifted = [path.moved(*told.allowance) for path in contour]
    points = [shifted[0].start, *(point for path in shifted for point in path.points())]
    feed, infeed = (1, 0) if told.facing else (0, 1)  # axes
    along = -1.0 if points[-1][feed] < points[0][feed] else 1.0
    rise = points[-1][infeed] - points[0][infeed]
    down = -math.copysign(1.0, rise if abs(rise) > 1e-6 else start[infeed] - points[0][infeed])
    for first, second in itertools.pairwise(points):
        if (second[feed] - first[feed]) * along < -1e-6 or (second[infeed] - first[infeed]) * down > 1e-6:
            raise ValueError("the contour turns back on one axis: a contour with pockets or relief cuts is not understood")
    bottom, top = points[0][infeed], start[infeed]
    if told.equal:
        top = points[-1][infeed]
    total = (top - bottom) * -down
    if total <= 1e-6:
        raise ValueError("the start point lies on the wrong side of the contour: nothing is left to rough")
    count = math.ceil(total / told.depth - 1e-6)
    if count > 2000:
        raise ValueError(f"{count} passes of {told.depth:g} mm are needed, but 2000 at most are made")
    step = total / count if told.equal else told.depth

    def point(feed_value: float, infeed_value: float) -> Point:
        return (infeed_value, feed_value) if told.facing else (feed_value, infeed_value)

    made: list[list[Path]] = []
    here = start
    for index in range(1, count):
        level = top + down * step * index
        end = _reach(points, level, feed, infeed, down)
        away = level - down * told.retraction
        moves = list(
            _joined(
                here,
                (point(start[feed], level), True),
                (point(end, level), False),
                (point(end - along * told.retraction, away), True),
                (point(start[feed], away), True),
            )
        )
        made.append(moves)
        here = moves[-1].end
    last = list(_joined(here, (point(start[feed], points[0][infeed]), True), (points[0], False)))
    last += shifted
    end_point = points[-1]
    outside = min if down > 0 else max
    clear = outside(start[infeed], end_point[infeed] - down * told.retraction)
    last += _joined(end_point, (point(end_point[feed], clear), True), (point(start[feed], clear), True), (start, True))
    made.append(last)
    return made


def _reach(points: Sequence[Point], level: float, feed: int, infeed: int, down: float) -> float:
    """Return where a pass meets the contour, on the axis of the feed."""
    for first, second in itertools.pairwise(points):
        low, high = first[infeed], second[infeed]
        if (high - level) * -down >= 0.0:
            share = (level - low) / (high - low) if high != low else 0.0
            return first[feed] + max(share, 0.0) * (second[feed] - first[feed])
    return points[-1][feed]


def _joined(start: Point, *ends: tuple[Point, bool]) -> Iterator[Path]:
    for end, rapid in ends:
        if math.dist(start, end) > 1e-9:
            yield Path(start, end, rapid=rapid)
            start = end
