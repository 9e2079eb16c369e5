"""Passes that a control makes of a contour or a thread in its cycles.

Roughing passes are parallel to the axis of the feed, from the stock to the contour, then into its pockets, level by level. One
along the contour follows. G73 repeats the contour instead. Controls differ in escape moves, in where a pass of a thread begins
and in how the tool leaves it; these moves are in air.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

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
    view = _View.of(kept, cycle)
    profile = [view.seen(kept[0].start)]
    for path in kept:
        profile += [view.seen(point) for point in path.points()]
        if any(after.along < before.along - 1e-6 for before, after in itertools.pairwise(profile)):
            raise Problem(
                f"the contour turns back along {'X' if cycle.facing else 'Z'}, which is not understood",
                path.line,
            )
    levels, step = _levels(profile, view.seen(start).height, cycle)
    return _Roughing(view, profile, start, cycle.retraction, step).passes(levels, kept)


class _Seen(NamedTuple):
    """A point as the tool sees it: it feeds along, and the metal lies above the contour."""

    along: float  # [mm]
    height: float  # [mm]


@dataclass(frozen=True)
class _View:
    """The axes and signs of the feed and the infeed."""

    facing: bool
    along: float  # sign of the feed
    upwards: float  # sign of the metal's side

    @classmethod
    def of(cls, contour: Sequence[Path], cycle: Roughing) -> Self:
        feed = 1 if cycle.facing else 0
        along = -1.0 if contour[-1].end[feed] < contour[0].start[feed] else 1.0
        return cls(cycle.facing, along, 1.0 if cycle.upwards else -1.0)

    def seen(self, point: Point) -> _Seen:
        z, x = point
        return (
            _Seen(self.along * x, self.upwards * z)
            if self.facing
            else _Seen(self.along * z, self.upwards * x)
        )

    def point(self, along: float, height: float) -> Point:
        feed, infeed = self.along * along, self.upwards * height
        return (infeed, feed) if self.facing else (feed, infeed)


def _levels(profile: Sequence[_Seen], start: float, cycle: Roughing) -> tuple[list[float], float]:
    """Return the heights of the passes above the contour's lowest point, and their distance [mm]."""
    lowest = min(point.height for point in profile)
    top = max(point.height for point in profile) if cycle.equal else start
    total = top - lowest
    if total <= 1e-6:
        raise Problem(
            "the start point lies within the contour: no metal is left between them; is the side right?"
        )
    count = math.ceil(total / cycle.depth - 1e-6)
    if count > MAX_PASSES:
        raise Problem(
            f"{count} passes of {cycle.depth:g} mm are needed, but {MAX_PASSES} at most are made"
        )
    step = total / count if cycle.equal else cycle.depth
    return [top - step * index for index in range(1, count)], step


class _Stretch(NamedTuple):
    """Part of a contour below a level."""

    before: int  # index of the contour's point before it
    begin: _Seen
    end: float  # distance along at which it ends, at the level [mm]


@dataclass(frozen=True)
class _Roughing:
    """The passes of a contour: from its front, into its pockets, then along it."""

    view: _View
    profile: Sequence[_Seen]
    start: Point
    retraction: float  # [mm]
    step: float  # distance of the passes [mm]

    def passes(self, levels: Sequence[float], contour: Sequence[Path]) -> list[list[Path]]:
        point, start = self.view.point, self.view.seen(self.start)
        clear = max(start.height, max(seen.height for seen in self.profile) + self.retraction)
        made: list[list[Path]] = []
        pockets: list[list[Path]] = []
        here = self.start
        for level in levels:
            stretches = self._below(level)
            # At the contour's front the pass begins before the metal.
            if stretches and abs(stretches[0].begin.along - self.profile[0].along) < 1e-6:
                made.append(self._from_front(here, level, stretches.pop(0).end))
                here = made[-1][-1].end
            pockets += [self._pocket(level, stretch, clear) for stretch in stretches]
        for moves in pockets:
            above = point(self.view.seen(here).along, clear)
            made.append([*joined(here, (above, True), (moves[0].start, True)), *moves])
            here = moves[-1].end
        if pockets:
            made[-1] += joined(here, (point(start.along, clear), True))
            here = made[-1][-1].end
        first, last = contour[0].start, contour[-1].end
        lead = joined(here, (point(start.along, self.profile[0].height), True), (first, False))
        above = point(self.view.seen(last).along, clear)
        back = joined(last, (above, True), (point(start.along, clear), True), (self.start, True))
        return [*made, [*lead, *contour, *back]]

    def _from_front(self, here: Point, level: float, end: float) -> list[Path]:
        point, begin = self.view.point, self.view.seen(self.start).along
        away = level + self.retraction
        cut = (point(begin, level), True), (point(end, level), False)
        back = (point(end - self.retraction, away), True), (point(begin, away), True)
        return list(joined(here, *cut, *back))

    def _pocket(self, level: float, stretch: _Stretch, clear: float) -> list[Path]:
        """Return the pass of one level in one pocket, from above it and back."""
        point = self.view.point
        wall = [stretch.begin]  # down which the tool goes from the level above
        before = stretch.before
        while (
            before >= 0
            and wall[0].height < level + self.step - 1e-9
            and self.profile[before].height > wall[0].height
        ):
            wall.insert(0, self.profile[before])
            before -= 1
        begin = wall[0].along
        left = max(stretch.end - self.retraction, begin)
        if not self._is_free(_Seen(left, level + self.retraction), _Seen(stretch.end, level)):
            left = stretch.end
        near = max(level + self.step, wall[0].height) + self.retraction
        cut = [(point(*corner), False) for corner in (*wall, _Seen(stretch.end, level))]
        back = (point(left, level + self.retraction), True), (point(left, clear), True)
        return list(joined(point(begin, clear), (point(begin, near), True), *cut, *back))

    def _is_free(self, left: _Seen, right: _Seen) -> bool:
        """Return whether a straight move between two points stays above the contour."""
        slope = (right.height - left.height) / max(right.along - left.along, 1e-12)
        for before, after in itertools.pairwise(self.profile):
            low, high = max(before.along, left.along), min(after.along, right.along - 1e-9)
            if low > high:
                continue
            for along in (low, high):
                if (
                    _height(before, after, along)
                    > left.height + slope * (along - left.along) + 1e-9
                ):
                    return False
        return True

    def _below(self, level: float) -> list[_Stretch]:
        """Return the parts of the contour below a level.

        A contour that ends below it has no wall behind its end: the part goes on at the level to there.
        """
        profile = self.profile
        found: list[_Stretch] = []
        before = 0
        begin = profile[0] if profile[0].height < level else None
        for index, (here, after) in enumerate(itertools.pairwise(profile)):
            if (after.height < level) == (begin is not None):
                continue
            share = min(max((level - here.height) / (after.height - here.height), 0.0), 1.0)
            crossing = here.along + share * (after.along - here.along)
            if begin is None:
                before, begin = (
                    index,
                    _Seen(crossing, here.height + share * (after.height - here.height)),
                )
            else:
                found.append(_Stretch(before, begin, crossing))
                begin = None
        if begin is not None:
            found.append(_Stretch(before, begin, profile[-1].along))
        return found


def _height(before: _Seen, after: _Seen, along: float) -> float:
    """Return the height of a straight piece of a contour; of a wall, that of its top."""
    length = after.along - before.along
    if length < 1e-9:
        return max(before.height, after.height)
    return before.height + (along - before.along) / length * (after.height - before.height)


def _spaced(first: float, last: float, step: float) -> list[float]:
    """Return values a step apart that follow the first one, up to the last."""
    count = math.ceil(abs(last - first) / step - 1e-6) if step > 0.0 else 1
    if count > MAX_PASSES:
        raise Problem(f"{count} steps of {step:g} mm are needed, but {MAX_PASSES} at most are made")
    return [
        *(first + math.copysign(number * step, last - first) for number in range(1, count)),
        last,
    ]


def pecked(
    start: Point, end: Point, along: int, peck: float, across: float, back: float
) -> list[list[Path]]:
    """Return the moves of G74 or G75: pecks along an axis (0: Z, 1: X), again at steps across, and back to the start [mm]."""
    made, here = [], start
    first, last = start[1 - along], end[1 - along]
    places = [first, *(_spaced(first, last, across) if abs(last - first) > 1e-6 else ())]
    depths = _spaced(start[along], end[along], peck)
    if len(places) * len(depths) > MAX_PASSES:
        raise Problem(
            f"{len(depths)} pecks at each of {len(places)} places are needed, but {MAX_PASSES} at most are made"
        )
    for place in places:
        ends = [(start[along], True)]
        for depth in depths:
            drawn = math.copysign(min(back, peck or back), end[along] - start[along])
            ends += [(depth, False), (depth - drawn, True)]
        points = [
            ((value, place) if along == 0 else (place, value), rapid)
            for value, rapid in (*ends[:-1], ends[0])
        ]
        made.append(list(joined(here, *points)))
        here = points[-1][0]
    made[-1] += joined(here, (start, True))
    return made


def repeated_passes(
    contour: Sequence[Path], start: Point, allowance: Point, most: Point, count: int
) -> list[list[Path]]:
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


def decreasing_depths(
    height: float, first: float, smallest: float, allowance: float, finishing: int
) -> list[float]:
    """Return the depths of all passes: first * sqrt(n), ``smallest`` apart at least, and the finishing passes [mm]."""
    if not (first > 0.0 and height > allowance >= 0.0):
        raise Problem(
            f"a thread {height:g} mm high with a first pass of {first:g} mm and {allowance:g} mm left cannot be cut"
        )
    depths = [min(first, height - allowance)]
    while depths[-1] < height - allowance - 1e-9:
        depths.append(
            min(max(first * math.sqrt(len(depths) + 1), depths[-1] + smallest), height - allowance)
        )
        if len(depths) > MAX_PASSES:
            raise Problem(
                f"a thread of more than {MAX_PASSES} passes is not made: is the first depth right?"
            )
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
        cut = [
            ((begin, thread.roots[0] + over), True),
            ((thread.end, thread.roots[1] + over), False),
        ]
        made.append(
            list(
                joined(
                    thread.start,
                    ((begin, clear), True),
                    *cut,
                    ((thread.end, clear), True),
                    (thread.start, True),
                )
            )
        )
    return made
