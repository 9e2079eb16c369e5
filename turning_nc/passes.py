"""Passes that a control makes of a contour or a thread in its cycles.

Roughing passes are parallel to the axis of the feed, from the stock to the contour, then into its pockets, level by level. One
along the contour follows. G73 repeats the contour instead. Controls differ in escape moves, in where a pass of a thread begins
and in how the tool leaves it; these moves are in air.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from turning_nc.paths import Path, Point, joined, shifted
from turning_nc.words import Problem

MAX_PASSES = 2000


@dataclass(frozen=True)
class Roughing:
    """Parameters of a roughing cycle."""

    depth: float  # depth of cut per pass [mm]
    retraction: float  # distance by which the tool leaves the cut on both axes [mm]
    allowance: Point  # metal that stays for the finishing cut, along Z and X with the contour's side as sign [mm]
    upwards: bool  # whether the metal lies beyond the contour along the axis of infeed
    facing: bool = False  # whether passes run along X
    equal: bool = False  # whether the depth is reduced so that all passes have the same (CYCLE95)


def roughing_passes(contour: Sequence[Path], start: Point, cycle: Roughing) -> list[list[Path]]:
    """Return the moves of every pass along a contour, from the start point and back to it."""
    if cycle.depth <= 0.0:
        raise Problem(f"the depth of the passes is {cycle.depth:g} mm, but must be above 0")
    kept = [path.moved(*cycle.allowance) for path in contour]
    points = [kept[0].start, *(point for path in kept for point in path.points())]
    feed, infeed = (1, 0) if cycle.facing else (0, 1)  # axes
    along = -1.0 if points[-1][feed] < points[0][feed] else 1.0
    down = -1.0 if cycle.upwards else 1.0
    for path in kept:
        steps = itertools.pairwise((path.start, *path.points()))
        if any((second[feed] - first[feed]) * along < -1e-6 for first, second in steps):
            raise Problem(f"the contour turns back along {'X' if cycle.facing else 'Z'}, which is not understood", path.line)
    heights = [-down * point[infeed] for point in points]
    top = max(heights) if cycle.equal else -down * start[infeed]
    total = top - min(heights)
    if total <= 1e-6:
        raise Problem("the start point lies within the contour: no metal is left between them; is the side right?")
    count = math.ceil(total / cycle.depth - 1e-6)
    if count > MAX_PASSES:
        raise Problem(f"{count} passes of {cycle.depth:g} mm are needed, but {MAX_PASSES} at most are made")
    step = total / count if cycle.equal else cycle.depth
    clear = -down * max(-down * start[infeed], max(heights) + cycle.retraction)

    def point(feed_value: float, infeed_value: float) -> Point:
        return (infeed_value, feed_value) if cycle.facing else (feed_value, infeed_value)

    made: list[list[Path]] = []
    pockets: list[list[Path]] = []
    here = start
    for height in (top - step * index for index in range(1, count)):
        level, away = -down * height, -down * (height + cycle.retraction)
        cuts = _below(points, heights, height)
        if cuts and abs(cuts[0][1][feed] - points[0][feed]) < 1e-6:  # at the contour's front the pass begins before the metal
            end = cuts.pop(0)[2][feed]
            back = [(point(end - along * cycle.retraction, away), True), (point(start[feed], away), True)]
            made.append(list(joined(here, (point(start[feed], level), True), (point(end, level), False), *back)))
            here = made[-1][-1].end
        for first, entry, exit_ in cuts:
            wall = [entry]  # down which the tool goes from the level above
            while first >= 0 and -down * wall[0][infeed] < height + step - 1e-9 and heights[first] > -down * wall[0][infeed]:
                wall.insert(0, points[first])
                first -= 1
            begin = wall[0][feed]
            left = exit_[feed] - along * cycle.retraction
            left = max(left, begin) if along > 0 else min(left, begin)
            near = -down * (max(height + step, -down * wall[0][infeed]) + cycle.retraction)
            cut = [(corner, False) for corner in (*wall, exit_)]
            around = [(point(begin, near), True), *cut, (point(left, away), True), (point(left, clear), True)]
            pockets.append(list(joined(point(begin, clear), *around)))
    for moves in pockets:
        made.append([*joined(here, (point(here[feed], clear), True), (moves[0].start, True)), *moves])
        here = moves[-1].end
    if pockets:
        made[-1] += joined(here, (point(start[feed], clear), True))
        here = made[-1][-1].end
    lead = joined(here, (point(start[feed], points[0][infeed]), True), (points[0], False))
    end_point = points[-1]
    back = [(point(end_point[feed], clear), True), (point(start[feed], clear), True), (start, True)]
    return [*made, [*lead, *kept, *joined(end_point, *back)]]


def _below(points: Sequence[Point], heights: Sequence[float], height: float) -> list[tuple[int, Point, Point]]:
    """Return the stretches of a contour below a height: index of the point before each stretch, its first and its last point."""
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


def _spaced(first: float, last: float, step: float) -> list[float]:
    """Return values a step apart that follow the first one, up to the last."""
    count = math.ceil(abs(last - first) / step - 1e-6) if step > 0.0 else 1
    if count > MAX_PASSES:
        raise Problem(f"{count} steps of {step:g} mm are needed, but {MAX_PASSES} at most are made")
    return [*(first + math.copysign(number * step, last - first) for number in range(1, count)), last]


def pecked(start: Point, end: Point, along: int, peck: float, across: float, back: float) -> list[list[Path]]:
    """Return the moves of G74 or G75: pecks along an axis (0: Z, 1: X), again at steps across, and back to the start [mm]."""
    made, here = [], start
    first, last = start[1 - along], end[1 - along]
    for place in (first, *(_spaced(first, last, across) if abs(last - first) > 1e-6 else ())):
        ends = [(start[along], True)]
        for depth in _spaced(start[along], end[along], peck):
            drawn = math.copysign(min(back, peck or back), end[along] - start[along])
            ends += [(depth, False), (depth - drawn, True)]
        points = [((value, place) if along == 0 else (place, value), rapid) for value, rapid in (*ends[:-1], ends[0])]
        made.append(list(joined(here, *points)))
        here = points[-1][0]
    made[-1] += joined(here, (start, True))
    return made


def repeated_passes(contour: Sequence[Path], start: Point, allowance: Point, most: Point, count: int) -> list[list[Path]]:
    """Return the moves of G73: the contour ``count`` times, from ``most`` beyond the allowance to the allowance [mm]."""
    made: list[list[Path]] = []
    here = start
    for number in range(count):
        left = 1.0 - number / (count - 1) if count > 1 else 0.0
        shift = most[0] * left + allowance[0], most[1] * left + allowance[1]
        begin = shifted(start, shift)
        cut = [path.moved(*shift) for path in contour]
        back = joined(cut[-1].end, (start if number == count - 1 else begin, True))
        made.append([*joined(here, (begin, True), (cut[0].start, True)), *cut, *back])
        here = made[-1][-1].end
    return made


@dataclass(frozen=True)
class Thread:
    """A thread, from its first turn to its last."""

    start: Point  # where passes begin along Z, and where the tool is clear of the thread along X
    end: float  # Z at which passes end [mm]
    roots: tuple[float, float]  # radius at the root where passes begin and end [mm]
    height: float  # height of the profile [mm]
    angle: float = 0.0  # angle by which the tool goes in aslant: half the thread's angle to cut with one flank [degrees]


def decreasing_depths(height: float, first: float, smallest: float, allowance: float, finishing: int) -> list[float]:
    """Return the depths of all passes: first * sqrt(n), ``smallest`` apart at least, and the finishing passes [mm]."""
    if not (first > 0.0 and height > allowance >= 0.0):
        raise Problem(f"a thread {height:g} mm high with a first pass of {first:g} mm and {allowance:g} mm left cannot be cut")
    depths = [min(first, height - allowance)]
    while depths[-1] < height - allowance - 1e-9:
        depths.append(min(max(first * math.sqrt(len(depths) + 1), depths[-1] + smallest), height - allowance))
        if len(depths) > MAX_PASSES:
            raise Problem(f"a thread of more than {MAX_PASSES} passes is not made: is the first depth right?")
    return depths + [height] * finishing


def thread_passes(thread: Thread, depths: list[float]) -> list[list[Path]]:
    """Return the moves of every pass, from the start back to it; the second or third is the cut."""
    if abs(thread.end - thread.start[0]) < 1e-9 or abs(thread.start[1] - thread.roots[0]) < 1e-9:
        raise Problem("the thread begins where it ends")
    outwards = math.copysign(1.0, thread.start[1] - thread.roots[0])
    along = math.copysign(1.0, thread.end - thread.start[0])
    clear = thread.start[1]
    made = []
    for depth in depths:
        over = outwards * (thread.height - depth)
        begin = thread.start[0] + along * depth * math.tan(math.radians(thread.angle))
        cut = [((begin, thread.roots[0] + over), True), ((thread.end, thread.roots[1] + over), False)]
        made.append(list(joined(thread.start, ((begin, clear), True), *cut, ((thread.end, clear), True), (thread.start, True))))
    return made
