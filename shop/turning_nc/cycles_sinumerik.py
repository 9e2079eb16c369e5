"""Cycles of SINUMERIK: CYCLE95 roughs and finishes a contour, CYCLE97 cuts a thread.

Their arguments are those of Siemens's manual of cycles for the 840D. Docstrings give the manual's
names, such as MID.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

from turning_nc.contours import add_passes, choose_side, contour_of
from turning_nc.control import Control
from turning_nc.cycles import ContourLines
from turning_nc.dialects import NUMBER
from turning_nc.expression import MAX_SHOWN
from turning_nc.modal import Setting
from turning_nc.passes import Roughing, Thread, roughing_passes, thread_passes
from turning_nc.paths import Path, Point, shifted
from turning_nc.words import Argument, BlockError, Word

# Distance by which the tool leaves the metal without _VRT, the last argument [mm].
RETRACTION_CYCLE95 = 1.0
CLEARANCE_CYCLE97 = 1.0
MAX_REPEATS = 1000


def _argument_number(
    name: str, arguments: Sequence[Argument], index: int, default: float = 0.0
) -> float:
    """Return the number of a cycle's argument; arguments may be empty or missing.

    Raises:
        BlockError: it is not a number, or is too large.
    """
    text = arguments[index].text if index < len(arguments) else ""
    if not text:
        return default
    if not re.fullmatch(NUMBER, text):
        raise BlockError(
            f"argument {index + 1} of {name} is {text[:MAX_SHOWN]!r}, but must be a number"
        )
    word = Word(f"argument {index + 1} of {name}: ", float(text), text=text)
    if word.fault:
        raise BlockError(word.fault)
    return float(text)


def _feed_of_argument(
    control: Control, arguments: Sequence[Argument], index: int, name: str
) -> Setting:
    """Return the feed of an argument; the one in force if it is missing or 0."""
    value = _argument_number(name, arguments, index)
    if value <= 0:
        return control.feed
    scale = control.feed_scale
    return Setting(value * scale, arguments[index].span, scale=scale)


# CYCLE95: stock removal.


@dataclass(frozen=True)
class StockRemoval:
    """How a cycle removes the stock before a contour."""

    machining: str  # outside or inside
    facing: bool  # whether passes run along X
    roughs: bool
    finishes: bool
    depth: float  # largest depth of a pass [mm]
    allowance: Point  # metal that stays for finishing, with the sign of the contour's side [mm]
    roughing_feed: Setting
    finishing_feed: Setting
    retraction: float  # distance by which the tool leaves the metal [mm]


def _remove_stock(control: Control, contour: Sequence[Path], removal: StockRemoval) -> None:
    """Rough and finish a contour, from before its blank and back to there.

    Raises:
        BlockError: the contour is not understood, or the depth of the passes is not above 0.
    """
    facing = removal.facing
    start = _start(contour, removal)
    feed = control.feed
    control.go_rapidly(start)
    side = choose_side(
        control,
        contour,
        allowance=removal.allowance,
        facing=facing,
        machining=removal.machining,
    )
    if removal.roughs:
        control.feed = removal.roughing_feed
        cycle = Roughing(
            depth=removal.depth,
            retraction=removal.retraction,
            allowance=removal.allowance,
            upwards=side.upwards,
            facing=facing,
            equal=True,
        )
        add_passes(control, roughing_passes(contour, start, cycle))
    if removal.finishes:
        control.feed = removal.finishing_feed
        head = contour[0].start
        end = contour[-1].end
        # The tool goes to and from the contour along the infeed.
        before = Point(head.z, start.x) if facing else Point(start.z, head.x)
        behind = Point(start.z, end.x) if facing else Point(end.z, start.x)
        control.go_rapidly(start, before)
        control.add(Path(control.here, head), "feed")
        for path in contour:
            control.add(path, "feed")
        control.go_rapidly(behind, start)
    control.feed = feed


def _start(contour: Sequence[Path], removal: StockRemoval) -> Point:
    """Return where a cycle begins.

    It is before the contour along the feed, and beyond its farthest point along the infeed.
    """
    head = contour[0].start
    end = contour[-1].end
    away = removal.retraction
    side = 1.0 if removal.machining == "outside" else -1.0
    points = [head]
    for path in contour:
        points.append(path.end)
    all_z = [point.z for point in points]
    all_x = [point.x for point in points]

    if removal.facing:
        z = max(all_z)
        distance_z = away
        if end.x <= head.x:
            x = max(all_x)
            distance_x = away
        else:
            x = min(all_x)
            distance_x = -away
    else:
        x = side * max(side * point_x for point_x in all_x)
        distance_x = side * away
        if end.z <= head.z:
            z = max(all_z)
            distance_z = away
        else:
            z = min(all_z)
            distance_z = -away
    corner = shifted(Point(z, x), removal.allowance)
    return shifted(corner, Point(distance_z, distance_x))


class RoughingCall:
    """Arguments of CYCLE95; each is read, and checked, where the cycle uses it."""

    def __init__(self, control: Control, arguments: Sequence[Argument]) -> None:
        """Read the kind of machining.

        Raises:
            BlockError: there are no arguments, or there is no such kind.
        """
        if not arguments:
            raise BlockError('CYCLE95 needs its arguments: ("contour", depth, ...)')
        self._control = control
        self._arguments = arguments
        self.variant = int(self._number(8, default=1.0))
        if not 1 <= self.variant <= 12:
            raise BlockError(
                f"the kind of machining of CYCLE95 is {self.variant}, but must be 1 to 12"
            )

    def _number(self, index: int, default: float = 0.0) -> float:
        return _argument_number("CYCLE95", self._arguments, index, default)

    def _length(self, index: int, default: float = 0.0) -> float:
        return self._number(index, default) * self._control.length_scale

    def _feed(self, index: int) -> Setting:
        return _feed_of_argument(self._control, self._arguments, index, name="CYCLE95")

    # VARI, the kind of machining, counts: lengthwise or facing, outside or inside; and roughs (1
    # to 4), finishes (5 to 8) or does both (9 to 12).

    @property
    def facing(self) -> bool:
        """Whether passes run along X."""
        return self.variant % 2 == 0

    @property
    def machining(self) -> str:
        """Whether the cycle turns outside or inside."""
        return "inside" if (self.variant - 1) % 4 >= 2 else "outside"

    @property
    def roughs(self) -> bool:
        """Whether the cycle makes roughing passes."""
        return self.variant not in (5, 6, 7, 8)

    @property
    def finishes(self) -> bool:
        """Whether the cycle finishes the contour."""
        return self.variant >= 5

    @property
    def contour(self) -> str:
        """NPP: name of the contour, or its first and last label."""
        return self._arguments[0].text.strip('"')

    @property
    def depth(self) -> float:
        """MID: largest depth of a pass [mm]."""
        return self._length(1)

    def allowance(self, side: float) -> Point:
        """Return FALZ and FALX, each with FAL added [mm]; ``side`` is the sign along X."""
        scale = self._control.length_scale
        both = self._number(4)
        along_z = (self._number(2) + both) * scale
        along_x = side * (self._number(3) + both) * scale
        return Point(along_z, along_x)

    @property
    def roughing_feed(self) -> Setting:
        """FF1."""
        return self._feed(5)

    @property
    def finishing_feed(self) -> Setting:
        """FF3."""
        return self._feed(7)

    @property
    def retraction(self) -> float:
        """_VRT: distance by which the tool leaves the cut [mm]."""
        return self._length(11, default=RETRACTION_CYCLE95)


def run_cycle95(control: Control, arguments: Sequence[Argument], part: str) -> None:
    """Rough and finish a contour; labels of the contour are in ``part``.

    Raises:
        BlockError: arguments are missing or wrong, or the contour is not understood.
    """
    call = RoughingCall(control, arguments)
    given_side = control.given_sides.get(control.line.number, call.machining)
    contour = contour_of(control, _contour_lines(control, call.contour, part))
    removal = StockRemoval(
        machining=given_side,
        facing=call.facing,
        roughs=call.roughs,
        finishes=call.finishes,
        depth=call.depth if call.roughs else 0.0,
        allowance=call.allowance(1.0 if given_side == "outside" else -1.0),
        roughing_feed=call.roughing_feed,
        finishing_feed=call.finishing_feed,
        retraction=call.retraction,
    )
    _remove_stock(control, contour, removal)


def _contour_lines(control: Control, name: str, part: str) -> ContourLines:
    """Return the lines of a contour: those from a label to another, or a sub-program."""
    if ":" not in name:
        return _lines_of_sub_program(control, name)
    labels = [label.strip() for label in name.upper().split(":")]
    if len(labels) != 2:
        raise BlockError(f"the contour {name!r} must be a sub-program or two labels")
    first, last = labels
    return _labelled_lines(control, first, last, part=part)


def _labelled_lines(control: Control, first: str, last: str, part: str) -> ContourLines:
    """Return the lines from a label to another.

    Raises:
        BlockError: they are not in this part of the program.
    """
    begin = end = None
    if part in control.program.parts:
        places = control.places(part)
        begin = places.label(first, places.lines)
        end = places.label(last, places.lines)
    if begin is None or end is None or begin >= end:
        raise BlockError(f"the labels of the contour '{first}:{last}' are not in the program")
    return ContourLines(part, begin, end=end + 1)


def _lines_of_sub_program(control: Control, name: str) -> ContourLines:
    """Return the lines of a sub-program that describes a contour.

    Raises:
        BlockError: it is not in the program.
    """
    program = control.program
    lines = program.parts.get(name.upper())
    if lines is None:
        raise BlockError(
            f"the contour {name!r} is neither in this file nor in a file beside it, such as "
            f"{name[:30]}.SPF; the sub-programs here are {program.sub_programs}"
        )
    return ContourLines(name.upper(), 0, end=len(lines))


# CYCLE97: thread cutting.


@dataclass(frozen=True)
class ThreadCall:
    """Arguments of CYCLE97, in their order; lengths are in the program's units."""

    lead: float = 0.0  # PIT
    size: float = 0.0  # MPIT: size of the thread, in place of the lead
    first: float = 0.0  # SPL: Z of its begin
    last: float = 0.0  # FPL: Z of its end
    first_diameter: float = 0.0  # DM1
    last_diameter: float = 0.0  # DM2
    run_in: float = 0.0  # APP
    run_out: float = 0.0  # ROP
    height: float = 0.0  # TDEP
    allowance: float = 0.0  # FAL
    angle: float = 0.0  # IANG: angle of infeed [degrees]
    start_angle: float = 0.0  # NSP: where the first thread starts [degrees]; not used
    cuts: float = 1.0  # NRC
    spare: float = 0.0  # NID: passes without infeed

    # VARI: outside (1, 3) or inside (2, 4); passes of equal depth (1, 2) or equal chips (3, 4).
    variant: float = 1.0
    starts: float = 1.0  # NUMT
    clearance: float = CLEARANCE_CYCLE97  # _VRT

    @classmethod
    def of(cls, arguments: Sequence[Argument], length_scale: float) -> Self:
        """Return the arguments of a call.

        Raises:
            BlockError: an argument is not a number, or the cycle cannot be run with them.
        """
        defaults = cls(clearance=CLEARANCE_CYCLE97 / length_scale)
        values = {}
        for index, argument in enumerate(fields(cls)):
            default = getattr(defaults, argument.name)
            values[argument.name] = _argument_number("CYCLE97", arguments, index, default)
        call = cls(**values)
        call.check()
        return call

    def check(self) -> None:
        """Raise BlockError if the cycle cannot be run."""
        if self.lead <= 0.0:
            raise BlockError(
                "CYCLE97 needs its pitch as first argument; "
                f"the size of a thread alone, {self.size:g}, is not understood"
            )
        is_kind = self.variant in (1, 2, 3, 4)
        if not is_kind or self.first == self.last or self.height <= 0.0:
            raise BlockError(
                "CYCLE97 needs a thread's start, another end, a depth above 0, "
                "and a kind of machining from 1 to 4"
            )
        if self.starts > MAX_REPEATS:
            raise BlockError(
                f"CYCLE97 cuts {self.starts:g} starts of a thread, "
                f"but {MAX_REPEATS} at most are made"
            )
        counts = 1 <= self.cuts <= MAX_REPEATS and 0 <= self.spare <= MAX_REPEATS
        if not (counts and 0.0 <= self.allowance < self.height):
            raise BlockError(
                f"CYCLE97 needs 1 to {MAX_REPEATS} cuts, and a finishing allowance below the depth"
            )

    def thread(self, scale: float) -> Thread:
        """Return the thread; ``scale`` is the length of the program's unit [mm]."""
        outwards = 1.0 if self.variant in (1, 3) else -1.0
        along = 1.0 if self.last > self.first else -1.0
        begin = self.first - along * self.run_in
        end = self.last + along * self.run_out

        # The tool runs in and out along the cone of the crests.
        rise = 0.5 * (self.last_diameter - self.first_diameter)
        slope = rise / (self.last - self.first)
        first_radius = 0.5 * self.first_diameter
        first_crest = first_radius + slope * (begin - self.first)
        last_crest = first_radius + slope * (end - self.first)
        highest = max(outwards * first_crest, outwards * last_crest)
        clear = outwards * highest + outwards * self.clearance
        to_root = outwards * self.height
        return Thread(
            start=Point(scale * begin, scale * clear),
            end=scale * end,
            first_root=scale * (first_crest - to_root),
            last_root=scale * (last_crest - to_root),
            height=scale * self.height,
            angle=abs(self.angle),
        )

    def depths(self, scale: float) -> list[float]:
        """Return the depths of all passes [mm]."""
        # The area of chips grows with the square of the depth.
        power = 1.0 if self.variant in (1, 2) else 0.5
        roughed = scale * (self.height - self.allowance)
        depths = []
        for number in range(1, int(self.cuts) + 1):
            share = (number / self.cuts) ** power
            depths.append(roughed * share)
        finishing = int(self.spare)
        # The allowance is cut by a pass of its own.
        if self.allowance > 0.0:
            finishing += 1
        return depths + [scale * self.height] * finishing


def run_cycle97(control: Control, arguments: Sequence[Argument]) -> None:
    """Cut a thread.

    Raises:
        BlockError: arguments are missing or wrong.
    """
    call = ThreadCall.of(arguments, control.length_scale)
    thread = call.thread(control.length_scale)
    depths = call.depths(control.length_scale)
    control.go_rapidly(thread.start)
    with control.thread_feed(call.lead):
        for _ in range(max(int(call.starts), 1)):
            add_passes(control, thread_passes(thread, depths), "thread")
