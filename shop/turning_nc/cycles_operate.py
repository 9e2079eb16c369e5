"""Cycles of SINUMERIK Operate: CYCLE951 and CYCLE952 remove stock; CYCLE62 names a contour.

Their arguments are those of Siemens's programming manual for the 840D sl, "Programming cycles
externally". What is not read is refused with its argument. Docstrings give the manual's names,
such as _MID. ``cycles_sinumerik`` has the older cycles.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

from turning_nc.contours import contour_of
from turning_nc.control import Control
from turning_nc.cycles import ContourLines
from turning_nc.cycles_sinumerik import (
    StockRemoval,
    argument_number,
    feed_of_argument,
    labelled_lines,
    lines_of_sub_program,
    remove_stock,
    run_cycle95,
    run_cycle97,
)
from turning_nc.passes import TOLERANCE
from turning_nc.paths import Path, Point
from turning_nc.words import Argument, BlockError, Word

RETRACTION = 1.0  # distance by which the tool leaves the metal without _SC [mm]
MAX_ALLOWANCE = 10.0  # largest _XD that is an allowance, not a diameter [mm] (assumption)

CYCLES = ("CYCLE95", "CYCLE97", "CYCLE62", "CYCLE951", "CYCLE952")
"""Cycles of SINUMERIK that are read."""


def run_cycle_of_sinumerik(control: Control, call: Word, part: str) -> None:
    """Run a cycle that a block calls; labels of its contour are in ``part``.

    Raises:
        BlockError: its arguments, or those of its contour, are not understood.
    """
    arguments = call.arguments or ()
    if call.address == "CYCLE95":
        run_cycle95(control, arguments, part)
    elif call.address == "CYCLE97":
        run_cycle97(control, arguments)
    elif call.address == "CYCLE62":
        run_cycle62(control, arguments, part)
    elif call.address == "CYCLE951":
        run_cycle951(control, arguments)
    else:
        run_cycle952(control, arguments)


def _digit(number: float, place: int) -> int:
    """Return a decimal digit of a number; place 0 is that of the units."""
    shifted = int(number) // int(10**place)
    return shifted % 10


class _Call:
    """Arguments of a call."""

    def __init__(self, control: Control, name: str, arguments: Sequence[Argument]) -> None:
        if not arguments:
            raise BlockError(f"{name} needs its arguments")
        self.control = control
        self._name = name
        self._arguments = arguments

    def number(self, place: int) -> float:
        """Return the number of an argument; arguments are counted from 1, as in the manual."""
        return argument_number(self._name, self._arguments, place - 1)

    def length(self, place: int) -> float:
        """Return the length of an argument [mm]."""
        return self.number(place) * self.control.length_scale

    def text(self, place: int) -> str:
        """Return the string of an argument; empty if it is missing."""
        if place > len(self._arguments):
            return ""
        return self._arguments[place - 1].text.strip('" ')

    def refused(self, place: int, meaning: str) -> BlockError:
        """Return the error for an argument that is not read."""
        return BlockError(f"{self._name}: argument {place}, {meaning}, is not read")


# CYCLE951: the stock of a corner.


def run_cycle951(control: Control, arguments: Sequence[Argument]) -> None:
    """Rough or finish a corner between a cylinder and a face.

    Raises:
        BlockError: arguments are missing, contradict each other, or are not read.
    """
    call = _Call(control, "CYCLE951", arguments)
    contour = _corner(call)
    variant = call.number(11)  # _VARI: 1 or 2 for longitudinal or facing; 10 or 20 to finish
    is_known = variant in (11, 12, 21, 22)
    if not is_known:
        raise call.refused(11, f"machining {variant:g}")
    facing = variant in (12, 22)
    position = call.number(7)  # _LAGE: outside at the back or the front, inside likewise
    machining = "outside" if position in (0, 1) else "inside"
    goes_outside = contour[-1].end.x > contour[0].start.x
    if position not in (0, 1, 2, 3) or goes_outside != (machining == "outside"):
        raise BlockError(
            f"CYCLE951: position {position:g} is {machining}, but X goes from "
            f"{call.number(1):g} to {call.number(3):g}"
        )
    finishes = variant >= 20
    side = 1.0 if machining == "outside" else -1.0
    allowance = Point(call.length(10), side * call.length(9))
    feed = feed_of_argument(control, arguments, 15, name="CYCLE951")
    remove_stock(
        control,
        _reversed(contour) if facing else contour,
        StockRemoval(
            machining=machining,
            facing=facing,
            roughs=not finishes,
            finishes=finishes,
            depth=call.length(8),
            allowance=Point(0.0, 0.0) if finishes else allowance,
            roughing_feed=feed,
            finishing_feed=feed,
            retraction=call.length(15),
        ),
    )


def _corner(call: _Call) -> list[Path]:
    """Return the contour of CYCLE951: along the cylinder, then along the face.

    Between them may be one more point, as in stock removal 3.
    """
    modes = call.number(19)  # _AMODE: digits say which points are increments
    end_x_is_increment = _digit(modes, 0)
    end_z_is_increment = _digit(modes, 1)
    if end_x_is_increment:
        raise call.refused(19, "an end point X as an increment")
    start = Point(call.length(2), 0.5 * call.length(1))
    end = Point(call.length(4), 0.5 * call.length(3))
    if end_z_is_increment:
        end = Point(start.z + end.z, end.x)
    shape = call.number(17)  # _NR
    if shape not in (0, 1, 2):
        raise call.refused(17, f"shape {shape:g}")
    if shape and any(call.number(place) for place in (12, 13, 14)):
        raise call.refused(12, "chamfers and radii of the corners")
    if start.z == end.z or start.x == end.x:
        raise BlockError("CYCLE951: its start and its end must differ in X and in Z")

    before_end = Point(start.z, end.x)
    after_end = Point(end.z, start.x)
    points = [before_end, end, after_end]
    if shape == 2:
        if _digit(modes, 2) or _digit(modes, 3):
            raise call.refused(19, "an intermediate point as an increment or an angle")
        points[1] = Point(call.length(6), 0.5 * call.length(5))
    return [Path(before, after) for before, after in pairwise(points)]


def _reversed(contour: Sequence[Path]) -> list[Path]:
    """Return a contour from its end to its begin."""
    return [
        replace(path, start=path.end, end=path.start, clockwise=not path.clockwise)
        for path in reversed(contour)
    ]


# CYCLE62 and CYCLE952: the stock of a contour.


def run_cycle62(control: Control, arguments: Sequence[Argument], part: str) -> None:
    """Keep the contour that a later CYCLE952 turns.

    _TYPE 0 names a sub-program, 1 a contour of the editor, 2 two labels, 3 labels of a sub-program.

    Raises:
        BlockError: the contour is not in the program.
    """
    call = _Call(control, "CYCLE62", arguments)
    name = call.text(1)
    kind = call.number(2)
    if kind == 2:
        lines = labelled_lines(control, call.text(3), call.text(4), part=part)
    elif kind == 3:
        lines = labelled_lines(control, call.text(3), call.text(4), part=name)
    elif kind in (0, 1):
        lines = _named_contour(control, name, part)
    else:
        raise call.refused(2, f"kind {kind:g}")
    control.cycle.called.append(lines)


def _named_contour(control: Control, name: str, part: str) -> ContourLines:
    """Return the lines of a contour: between the labels of the editor, or a sub-program."""
    first = f"E_LAB_A_{name}"
    for place in (part, *control.program.parts):
        places = control.places(place)
        if places.label(first, places.lines) is not None:
            return labelled_lines(control, first, f"E_LAB_E_{name}", part=place)
    return lines_of_sub_program(control, name)


def run_cycle952(control: Control, arguments: Sequence[Argument]) -> None:
    """Rough or finish the contour that CYCLE62 named; if it named two, the first is the blank.

    Raises:
        BlockError: arguments are missing, or are not read; or no contour was named.
    """
    call = _Call(control, "CYCLE952", arguments)
    named = list(control.cycle.called)
    control.cycle.called.clear()
    if not named:
        raise BlockError("CYCLE952 needs CYCLE62 before it, which names its contour")
    machining = _machining(call)
    finishes = machining.finishes
    contour = contour_of(control, named[-1])
    first = contour[0].start
    last = contour[-1].end
    goes_down = last.x < first.x if machining.facing else last.z < first.z
    if goes_down != machining.feeds_down:
        contour = _reversed(contour)
    outline = contour_of(control, named[0]) if len(named) > 1 else contour
    feed = feed_of_argument(control, arguments, 4, name="CYCLE952")
    remove_stock(
        control,
        contour,
        StockRemoval(
            machining=machining.side,
            facing=machining.facing,
            roughs=not finishes,
            finishes=finishes,
            depth=call.length(8),
            allowance=Point(0.0, 0.0) if finishes else _allowance(call, machining.sign),
            roughing_feed=feed,
            finishing_feed=feed,
            retraction=call.length(27) or RETRACTION,
            blank=_blank(call, outline, machining),
        ),
    )


class _Machining(NamedTuple):
    """The kind of machining of CYCLE952."""

    facing: bool
    side: str  # outside or inside
    finishes: bool
    feeds_down: bool  # whether the tool feeds towards -X or -Z

    @property
    def sign(self) -> float:
        """Sign of the metal's side along X."""
        return -1.0 if self.side == "inside" else 1.0


def _machining(call: _Call) -> _Machining:
    """Return the kind of machining, from the digits of _VARI.

    From the units: 1 longitudinal, 2 facing; 1 roughing, 2 finishing; feed along 1 -X, 2 X, 3 -Z,
    4 Z; infeed 1 outside, 2 inside, 3 from the face. The seventh is 2 for stock removal.
    """
    variant = call.number(4)
    direction = _digit(variant, 0)
    process = _digit(variant, 1)
    feed = _digit(variant, 2)
    infeed = _digit(variant, 3)
    facing = direction == 2
    is_removal = direction in (1, 2) and process in (1, 2) and _digit(variant, 6) == 2
    feeds = feed in (1, 2) if facing else feed in (3, 4)
    fits = infeed == 3 if facing else infeed in (1, 2)
    if not (is_removal and feeds and fits):
        raise call.refused(4, f"machining {variant:.0f}")
    if call.text(2):
        raise call.refused(2, "removal of residual metal")
    if any(call.number(place) for place in (18, 19, 20, 21)):
        raise call.refused(18, "a limit of the machining area")
    return _Machining(
        facing=facing,
        side="inside" if infeed == 2 else "outside",
        finishes=process == 2,
        feeds_down=feed in (1, 3),
    )


def _blank(call: _Call, outline: Sequence[Path], machining: _Machining) -> Point:
    """Return the corner of the blank before a contour, from _BL, _XD and _ZD.

    _BL is 1 for a cylinder, 2 for an allowance on the contour, 3 for a contour of its own. _XD of a
    cylinder is its diameter, or if it is small an allowance (assumption).
    """
    points = [outline[0].start]
    for path in outline:
        points.append(path.end)
    farthest = max(points, key=lambda point: machining.sign * point.x)
    x = farthest.x
    z = max(point.z for point in points)
    kind = call.number(15)
    if kind == 3:
        return Point(z, x)
    size = call.length(16)
    is_beyond = machining.side == "outside" and 0.5 * size >= x - TOLERANCE
    is_diameter = is_beyond or size > MAX_ALLOWANCE
    if kind == 1 and is_diameter:
        x = 0.5 * size
    else:
        x += machining.sign * size
    corner = Point(z + call.length(17), x)
    place = f"X{2.0 * corner.x:g} Z{corner.z:g} mm"
    call.control.note(f"the blank of CYCLE952 is taken to begin at {place}")
    return corner


def _allowance(call: _Call, side: float) -> Point:
    """Return _UX and _UZ, or _U along both axes if these are 0 [mm]."""
    along_x = call.length(11)
    along_z = call.length(12)
    if not (along_x or along_z):
        along_x = along_z = call.length(13)
    return Point(along_z, side * along_x)
