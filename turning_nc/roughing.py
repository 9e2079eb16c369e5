"""Roughing cycles (G71, G72, G73, CYCLE95): the passes that a control makes of a contour.

Passes are parallel to the axis of the feed, from the stock to the contour, then into its pockets, level by level. One along the
contour follows. G73 repeats the contour instead. A control's own escape and return moves differ in details; they are in air.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from turning_nc.blocks import Problem
from turning_nc.paths import Path, Point, joined


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
        Problem: the contour turns back along the axis of the feed, has no extent, or too many passes; says which.
    """
    if told.depth <= 0.0:
        raise Problem(f"the depth of the passes is {told.depth:g} mm, but must be above 0")
    shifted = [path.moved(*told.allowance) for path in contour]
    points = [shifted[0].start, *(point for path in shifted for point in path.points())]
    feed, infeed = (1, 0) if told.facing else (0, 1)  # axes
    along = -1.0 if points[-1][feed] < points[0][feed] else 1.0
    rise = points[-1][infeed] - points[0][infeed]
    down = -math.copysign(1.0, rise if abs(rise) > 1e-6 else start[infeed] - points[0][infeed])
    if any((second[feed] - first[feed]) * along < -1e-6 for first, second in itertools.pairwise(points)):
        raise Problem(f"the contour turns back along {'X' if told.facing else 'Z'}, which is not understood")
    heights = [-down * point[infeed] for point in points]
    bottom = min(heights)
    top = max(heights) if told.equal else -down * start[infeed]
    total = top - bottom
    if total <= 1e-6:
        raise Problem("the start point lies on the wrong side of the contour: nothing is left to rough")
    count = math.ceil(total / told.depth - 1e-6)
    if count > 2000:
        raise Problem(f"{count} passes of {told.depth:g} mm are needed, but 2000 at most are made")
    step = total / count if told.equal else told.depth
    clear = -down * max(-down * start[infeed], max(heights) + told.retraction)

    def point(feed_value: float, infeed_value: float) -> Point:
        return (infeed_value, feed_value) if told.facing else (feed_value, infeed_value)

    made: list[list[Path]] = []
    pockets: list[list[Path]] = []
    here = start
    for index in range(1, count):
        height = top - step * index
        level, away = -down * height, -down * (height + told.retraction)
        cuts = _below(points, heights, height)
        if heights[0] < height:
            end = cuts.pop(0)[2][feed]
            moves = list(
                joined(
                    here,
                    (point(start[feed], level), True),
                    (point(end, level), False),
                    (point(end - along * told.retraction, away), True),
                    (point(start[feed], away), True),
                )
            )
            made.append(moves)
            here = moves[-1].end
        for first, entry, exit_ in cuts:
            wall = [entry]  # down which the tool goes from the level above
            while first >= 0 and -down * wall[0][infeed] < height + step - 1e-9 and heights[first] > -down * wall[0][infeed]:
                wall.insert(0, points[first])
                first -= 1
            begin = wall[0][feed]
            back = max(exit_[feed] - along * told.retraction, begin) if along > 0 else min(exit_[feed] + told.retraction, begin)
            near = -down * (max(height + step, -down * wall[0][infeed]) + told.retraction)
            cut = [(corner, False) for corner in (*wall, exit_)]
            around = [(point(begin, near), True), *cut, (point(back, away), True), (point(back, clear), True)]
            pockets.append(list(joined(point(begin, clear), *around)))
    for moves in pockets:
        made.append([*joined(here, (point(here[feed], clear), True), (moves[0].start, True)), *moves])
        here = moves[-1].end
    if pockets:
        made[-1] += joined(here, (point(start[feed], clear), True))
        here = made[-1][-1].end
    last = list(joined(here, (point(start[feed], points[0][infeed]), True), (points[0], False)))
    last += shifted
    end_point = points[-1]
    last += joined(end_point, (point(end_point[feed], clear), True), (point(start[feed], clear), True), (start, True))
    made.append(last)
    return made


def _below(points: Sequence[Point], heights: Sequence[float], height: float) -> list[tuple[int, Point, Point]]:
    """Return where a contour lies below a height: index of the point before each stretch, its first and its last point."""
    found: list[tuple[int, Point, Point]] = []
    begun: tuple[int, Point] | None = (0, points[0]) if heights[0] < height else None
    for index, (low, high) in enumerate(itertools.pairwise(heights)):
        if (high >= height) == (begun is None):
            continue
        share = min(max((height - low) / (high - low), 0.0), 1.0) if high != low else 0.0
        before, after = points[index : index + 2]
        crossing = before[0] + share * (after[0] - before[0]), before[1] + share * (after[1] - before[1])
        if begun is not None:
            found.append((*begun, crossing))
            begun = None
        else:
            begun = index, crossing
    return found if begun is None else [*found, (*begun, points[-1])]


def repeated(contour: Sequence[Path], start: Point, allowance: Point, most: Point, count: int) -> list[list[Path]]:
    """Return the moves of G73: the contour ``count`` times, from ``most`` beyond the allowance to the allowance [mm]."""
    made: list[list[Path]] = []
    here = start
    for number in range(count):
        left = 1.0 - number / (count - 1) if count > 1 else 0.0
        shift = tuple(more * left + kept for more, kept in zip(most, allowance, strict=True))
        begin = start[0] + shift[0], start[1] + shift[1]
        shifted = [path.moved(*shift) for path in contour]
        lead = joined(here, (begin, True), (shifted[0].start, True))
        back = joined(shifted[-1].end, (start if number == count - 1 else begin, True))
        made.append([*lead, *shifted, *back])
        here = made[-1][-1].end
    return made
