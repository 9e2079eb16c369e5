"""Passes that a control makes of a contour or a thread in its cycles.

Roughing passes are parallel to the axis of the feed, from the stock to the contour, then into its
pockets, level by level. One along the contour follows. G73 repeats the contour instead.

Controls differ in escape moves, in where a pass of a thread begins and in how the tool leaves it;
these moves are in air. The words of the cycles are read in ``cycles_fanuc`` and
``cycles_sinumerik``.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

from turning_nc.paths import Path, Point, Stop, shifted, straight_paths
from turning_nc.words import BlockError

MAX_PASSES = 2000
TOLERANCE = 1e-6  # by which lengths may miss because of rounding [mm]

Pass = list[Path]
"""The moves of a pass."""


@dataclass(frozen=True)
class Roughing:
    """Parameters of a roughing cycle."""

    depth: float  # depth of cut per pass [mm]
    retraction: float  # distance by which the tool leaves the cut on both axes [mm]

    # Metal that stays for the finishing cut, with the contour's side as sign [mm].
    allowance: Point
    upwards: bool  # whether the metal lies beyond the contour along the axis of infeed
    facing: bool = False  # whether passes run along X
    equal: bool = False  # whether the depth is reduced so that all passes have the same (CYCLE95)


def roughing_passes(contour: Sequence[Path], start: Point, cycle: Roughing) -> list[Pass]:
    """Return the moves of every pass along a contour, from the start point and back to it.

    Raises:
        BlockError: the contour turns back along the feed, or no metal or too much is left.
    """
    if cycle.depth <= 0.0:
        raise BlockError(f"the depth of the passes is {cycle.depth:g} mm, but must be above 0")
    kept = [path.moved(cycle.allowance) for path in contour]
    view = _View.of(kept, cycle)
    profile = _profile(kept, view)
    top = _top(profile, view, cycle, start=start)
    levels = _levels(profile, top, cycle)
    roughing = _RoughingPasses(
        view,
        profile,
        start=start,
        retraction=cycle.retraction,
        step=levels.step,
    )
    return roughing.passes(levels.heights, kept)


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
        """Return the view of a tool that feeds from the contour's begin to its end."""
        first = contour[0].start
        last = contour[-1].end
        backwards = last.x < first.x if cycle.facing else last.z < first.z
        return cls(
            facing=cycle.facing,
            along=-1.0 if backwards else 1.0,
            upwards=1.0 if cycle.upwards else -1.0,
        )

    def seen(self, point: Point) -> _Seen:
        """Return a point as the tool sees it."""
        if self.facing:
            return _Seen(self.along * point.x, self.upwards * point.z)
        return _Seen(self.along * point.z, self.upwards * point.x)

    def point(self, along: float, height: float) -> Point:
        """Return the point that the tool sees at a place."""
        feed = self.along * along
        infeed = self.upwards * height
        return Point(infeed, feed) if self.facing else Point(feed, infeed)

    def rapid(self, along: float, height: float) -> Stop:
        """Return a stop of a rapid move."""
        return Stop(self.point(along, height), rapid=True)

    def feed(self, along: float, height: float) -> Stop:
        """Return a stop of a move at feed."""
        return Stop(self.point(along, height), rapid=False)


def _profile(contour: Sequence[Path], view: _View) -> list[_Seen]:
    """Return the corners of a contour, with arcs as chords.

    Raises:
        BlockError: the contour turns back along the feed. Fanuc's type I, and CYCLE95, refuse it.
    """
    profile = [view.seen(contour[0].start)]
    for path in contour:
        for point in path.points():
            seen = view.seen(point)
            if seen.along < profile[-1].along - TOLERANCE:
                axis = "X" if view.facing else "Z"
                raise BlockError(
                    f"the contour turns back along {axis}, which is not understood", path.line
                )
            profile.append(seen)
    return profile


class _Levels(NamedTuple):
    """Heights of passes."""

    heights: list[float]  # above the contour's lowest point, from the top [mm]
    step: float  # distance of the passes [mm]


def _top(profile: Sequence[_Seen], view: _View, cycle: Roughing, start: Point) -> float:
    """Return the height at which passes begin: that of the start point.

    Passes of CYCLE95 begin at the contour's top, where its blank ends.
    """
    if not cycle.equal:
        return view.seen(start).height
    return max(point.height for point in profile)


def _levels(profile: Sequence[_Seen], top: float, cycle: Roughing) -> _Levels:
    """Return the heights of the passes below a top."""
    lowest = min(point.height for point in profile)
    total = top - lowest
    if total <= TOLERANCE:
        raise BlockError(
            "the start point lies within the contour: no metal is left between them; "
            "is the side right?"
        )
    count = math.ceil(total / cycle.depth - TOLERANCE)
    if count > MAX_PASSES:
        raise BlockError(
            f"{count} passes of {cycle.depth:g} mm are needed, but {MAX_PASSES} at most are made"
        )
    step = total / count if cycle.equal else cycle.depth
    return _Levels([top - step * index for index in range(1, count)], step)


class _Stretch(NamedTuple):
    """Part of a contour below a level."""

    before: int  # index of the contour's point before it
    begin: _Seen
    end: float  # distance along at which it ends, at the level [mm]


@dataclass(frozen=True)
class _RoughingPasses:
    """The passes of a contour: from its front, into its pockets, then along it."""

    view: _View
    profile: Sequence[_Seen]
    start: Point
    retraction: float  # [mm]
    step: float  # distance of the passes [mm]

    def passes(self, levels: Sequence[float], contour: Sequence[Path]) -> list[Pass]:
        """Return all passes; ``contour`` has the paths of the profile."""
        view = self.view
        start = view.seen(self.start)
        top = max(seen.height for seen in self.profile)
        clear = max(start.height, top + self.retraction)
        passes: list[Pass] = []
        pockets: list[Pass] = []
        position = self.start
        for level in levels:
            stretches = self._below(level)
            if stretches and self._is_at_front(stretches[0]):
                front = stretches.pop(0)
                passes.append(self._from_front(position, level, front.end))
                position = passes[-1][-1].end
            for stretch in stretches:
                pockets.append(self._pocket(level, stretch, clear))
        for pocket in pockets:
            along = view.seen(position).along
            above = view.rapid(along, clear)
            begin = Stop(pocket[0].start, rapid=True)
            passes.append([*straight_paths(position, above, begin), *pocket])
            position = pocket[-1].end
        if pockets:
            above_start = view.rapid(start.along, clear)
            passes[-1] += straight_paths(position, above_start)
            position = passes[-1][-1].end
        passes.append(self._along(position, contour, clear))
        return passes

    def _is_at_front(self, stretch: _Stretch) -> bool:
        """Return whether a pass begins before the metal, at the contour's front."""
        return abs(stretch.begin.along - self.profile[0].along) < TOLERANCE

    def _along(self, position: Point, contour: Sequence[Path], clear: float) -> Pass:
        """Return the pass along the contour, and back to the start."""
        view = self.view
        begin = view.seen(self.start).along
        last = contour[-1].end
        lead = straight_paths(
            position,
            view.rapid(begin, self.profile[0].height),
            Stop(contour[0].start, rapid=False),
        )
        back = straight_paths(
            last,
            view.rapid(view.seen(last).along, clear),
            view.rapid(begin, clear),
            Stop(self.start, rapid=True),
        )
        return [*lead, *contour, *back]

    def _from_front(self, position: Point, level: float, end: float) -> Pass:
        """Return the pass of one level from the contour's front, and back aslant."""
        view = self.view
        begin = view.seen(self.start).along
        away = level + self.retraction
        return list(
            straight_paths(
                position,
                view.rapid(begin, level),
                view.feed(end, level),
                view.rapid(end - self.retraction, away),
                view.rapid(begin, away),
            )
        )

    def _pocket(self, level: float, stretch: _Stretch, clear: float) -> Pass:
        """Return the pass of one level in one pocket, from above it and back."""
        view = self.view
        wall = self._wall(level, stretch)
        begin = wall[0].along

        # The tool leaves the cut aslant, or straight up if the contour is in the way.
        left = max(stretch.end - self.retraction, begin)
        away = level + self.retraction
        if not self._is_free(_Seen(left, away), _Seen(stretch.end, level)):
            left = stretch.end
        near = max(level + self.step, wall[0].height) + self.retraction
        return list(
            straight_paths(
                view.point(begin, clear),
                view.rapid(begin, near),
                *(view.feed(corner.along, corner.height) for corner in wall),
                view.feed(stretch.end, level),
                view.rapid(left, away),
                view.rapid(left, clear),
            )
        )

    def _wall(self, level: float, stretch: _Stretch) -> list[_Seen]:
        """Return the corners down which the tool goes from the level above."""
        wall = [stretch.begin]
        before = stretch.before
        while (
            before >= 0
            and wall[0].height < level + self.step - 1e-9
            and self.profile[before].height > wall[0].height
        ):
            wall.insert(0, self.profile[before])
            before -= 1
        return wall

    def _is_free(self, left: _Seen, right: _Seen) -> bool:
        """Return whether a straight move between two points stays above the contour."""
        rise = right.height - left.height
        slope = rise / max(right.along - left.along, 1e-12)
        for before, after in itertools.pairwise(self.profile):
            low = max(before.along, left.along)
            high = min(after.along, right.along - 1e-9)
            if low > high:
                continue
            # Both are straight, so that their distance is least at an end.
            for along in (low, high):
                height = left.height + slope * (along - left.along)
                contour_height = _height(before, after, along)
                if contour_height > height + 1e-9:
                    return False
        return True

    def _below(self, level: float) -> list[_Stretch]:
        """Return the parts of the contour below a level.

        A contour that ends below it has no wall behind its end: the part goes on at the level to
        there.
        """
        profile = self.profile
        stretches: list[_Stretch] = []
        before = 0
        begin = profile[0] if profile[0].height < level else None
        for index, (point, next_point) in enumerate(itertools.pairwise(profile)):
            was_below = begin is not None
            is_below = next_point.height < level
            if is_below == was_below:
                continue
            rise = next_point.height - point.height
            share = (level - point.height) / rise
            share = min(max(share, 0.0), 1.0)
            crossing = point.along + share * (next_point.along - point.along)
            if begin is None:
                before = index
                begin = _Seen(crossing, point.height + share * rise)
            else:
                stretches.append(_Stretch(before, begin, end=crossing))
                begin = None
        if begin is not None:
            stretches.append(_Stretch(before, begin, end=profile[-1].along))
        return stretches


def _height(before: _Seen, after: _Seen, along: float) -> float:
    """Return the height of a straight piece of a contour; of a wall, that of its top."""
    length = after.along - before.along
    if length < 1e-9:
        return max(before.height, after.height)
    share = (along - before.along) / length
    return before.height + share * (after.height - before.height)


# Pecks of G74 and G75.


@dataclass(frozen=True)
class Pecking:
    """Parameters of Fanuc's G74 and G75."""

    along_x: bool  # whether the tool pecks along X (G75) instead of Z (G74)
    peck: float  # depth of a peck [mm]; 0 for one peck
    across: float  # distance of the places at which it pecks [mm]; 0 for none between the ends
    back: float  # distance by which it draws back after each peck [mm]

    def depth_of(self, point: Point) -> float:
        """Return the coordinate along which the tool pecks [mm]."""
        return point.x if self.along_x else point.z

    def place_of(self, point: Point) -> float:
        """Return the other coordinate [mm]."""
        return point.z if self.along_x else point.x

    def point(self, depth: float, place: float) -> Point:
        """Return the point at a depth in a place."""
        return Point(place, depth) if self.along_x else Point(depth, place)


def pecked(start: Point, end: Point, cycle: Pecking) -> list[Pass]:
    """Return the moves of G74 or G75: pecks to the end, again at steps across, and back.

    Raises:
        BlockError: there are more than ``MAX_PASSES`` pecks.
    """
    top = cycle.depth_of(start)
    bottom = cycle.depth_of(end)
    first_place = cycle.place_of(start)
    last_place = cycle.place_of(end)
    places = [first_place]
    if abs(last_place - first_place) > TOLERANCE:
        places += _spaced(first_place, last_place, cycle.across)
    depths = _spaced(top, bottom, cycle.peck)
    if len(places) * len(depths) > MAX_PASSES:
        raise BlockError(
            f"{len(depths)} pecks at each of {len(places)} places are needed, "
            f"but {MAX_PASSES} at most are made"
        )
    back = min(cycle.back, cycle.peck or cycle.back)
    drawn = math.copysign(back, bottom - top)
    passes = []
    position = start
    for place in places:
        above = Stop(cycle.point(top, place), rapid=True)
        stops = [above]
        for depth in depths[:-1]:
            stops.append(Stop(cycle.point(depth, place), rapid=False))
            stops.append(Stop(cycle.point(depth - drawn, place), rapid=True))
        stops.append(Stop(cycle.point(depths[-1], place), rapid=False))
        stops.append(above)
        passes.append(list(straight_paths(position, *stops)))
        position = above.point
    passes[-1] += straight_paths(position, Stop(start, rapid=True))
    return passes


def _spaced(first: float, last: float, step: float) -> list[float]:
    """Return values a step apart that follow the first one, up to the last."""
    distance = last - first
    count = 1
    if step > 0.0:
        count = math.ceil(abs(distance) / step - TOLERANCE)
    if count > MAX_PASSES:
        raise BlockError(
            f"{count} steps of {step:g} mm are needed, but {MAX_PASSES} at most are made"
        )
    signed_step = math.copysign(step, distance)
    values = []
    for number in range(1, count):
        values.append(first + number * signed_step)
    values.append(last)
    return values


# The repeated contour of G73.


@dataclass(frozen=True)
class Repeating:
    """Parameters of Fanuc's G73."""

    pattern: Point  # distance of the first pass beyond the allowance, along Z and X [mm]
    count: int  # number of passes


def repeated_passes(
    contour: Sequence[Path], start: Point, allowance: Point, cycle: Repeating
) -> list[Pass]:
    """Return the moves of G73: the contour, again and again, up to its allowance [mm]."""
    passes: list[Pass] = []
    position = start
    last = cycle.count - 1
    for number in range(cycle.count):
        # Share of the pattern that is left to cut after this pass.
        left = 0.0
        if last > 0:
            left = 1.0 - number / last
        shift = shifted(allowance, cycle.pattern, left)
        begin = shifted(start, shift)
        cut = [path.moved(shift) for path in contour]
        end = start if number == last else begin
        lead = straight_paths(position, Stop(begin, rapid=True), Stop(cut[0].start, rapid=True))
        back = straight_paths(cut[-1].end, Stop(end, rapid=True))
        passes.append([*lead, *cut, *back])
        position = passes[-1][-1].end
    return passes


# Threads.


@dataclass(frozen=True)
class Thread:
    """A thread, from its first turn to its last."""

    start: Point  # where passes begin along Z, and where the tool is clear of the thread along X
    end: float  # Z at which passes end [mm]
    first_root: float  # radius at the root where passes begin [mm]
    last_root: float  # radius at the root where passes end [mm]
    height: float  # height of the profile [mm]

    # Angle by which the tool goes in aslant [degrees]: half the thread's angle to cut with one
    # flank.
    angle: float = 0.0


def decreasing_depths(
    height: float, first: float, smallest: float, allowance: float, finishing: int
) -> list[float]:
    """Return the depths of all passes of Fanuc's G76 [mm].

    Pass n is first * sqrt(n) deep, so that all take the same area of chips; depths are at least
    ``smallest`` apart. The finishing passes follow.

    Raises:
        BlockError: no such thread can be cut, or it takes too many passes.
    """
    if not (first > 0.0 and height > allowance >= 0.0):
        raise BlockError(
            f"a thread {height:g} mm high with a first pass of {first:g} mm "
            f"and {allowance:g} mm left cannot be cut"
        )
    deepest = height - allowance
    depths = [min(first, deepest)]
    while depths[-1] < deepest - 1e-9:
        number = len(depths) + 1
        depth = max(first * math.sqrt(number), depths[-1] + smallest)
        depths.append(min(depth, deepest))
        if len(depths) > MAX_PASSES:
            raise BlockError(
                f"a thread of more than {MAX_PASSES} passes is not made: is the first depth right?"
            )
    return depths + [height] * finishing


def degressive_depths(height: float, first: float, degression: float) -> list[float]:
    """Return the depths of all passes of LinuxCNC's G76 [mm].

    Pass n is first * n^(1 / degression) deep: at a degression of 1 all steps are equal, at 2 all
    areas of chips.

    Raises:
        BlockError: no such thread can be cut, or it takes too many passes.
    """
    if not (0.0 < first <= height and degression >= 1.0):
        raise BlockError(
            f"a thread {height:g} mm high with a first pass of {first:g} mm and a degression of "
            f"{degression:g} cannot be cut"
        )
    depths: list[float] = []
    while not depths or depths[-1] < height:
        number = len(depths) + 1
        depths.append(min(first * number ** (1.0 / degression), height))
        if number > MAX_PASSES:
            raise BlockError(
                f"a thread of more than {MAX_PASSES} passes is not made: is the first depth right?"
            )
    return depths


def thread_passes(thread: Thread, depths: Sequence[float]) -> list[Pass]:
    """Return the moves of every pass, from the start back to it; the second or third is the cut.

    Raises:
        BlockError: the thread has no length, or its root is where the tool starts.
    """
    start = thread.start
    length = abs(thread.end - start.z)
    clearance = abs(start.x - thread.first_root)
    if length < 1e-9 or clearance < 1e-9:
        raise BlockError("the thread begins where it ends")
    slope = math.tan(math.radians(thread.angle))
    outwards = math.copysign(1.0, start.x - thread.first_root)
    along = math.copysign(1.0, thread.end - start.z)
    passes = []
    for depth in depths:
        over = outwards * (thread.height - depth)
        # The tool goes in along a flank: the deeper, the later it begins.
        begin = start.z + along * depth * slope
        moves = straight_paths(
            start,
            Stop(Point(begin, start.x), rapid=True),
            Stop(Point(begin, thread.first_root + over), rapid=True),
            Stop(Point(thread.end, thread.last_root + over), rapid=False),
            Stop(Point(thread.end, start.x), rapid=True),
            Stop(start, rapid=True),
        )
        passes.append(list(moves))
    return passes
