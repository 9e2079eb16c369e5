"""Programs of the project: one cut along a bar at a constant cutting speed and feed, under an override law.

They are SINUMERIK programs, and are read as those of users are. X is a diameter. Z is 0 at the bar's face and decreases towards
the chuck.
"""

import math
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from turning_nc.dialects import SINUMERIK
from turning_nc.law import Law
from turning_nc.moves import Move, run
from turning_nc.words import NcError, PartProgram, divide, naming, read_program_file

from turning_env import Scenario

SPEED_DECIMALS, FEED_DECIMALS, LENGTH_DECIMALS, LIMIT_DECIMALS = 1, 3, 3, 1
"""A control's resolution: cutting speed 0.1 m/min, feed 0.001 mm/rev, lengths 0.001 mm, spindle speed 0.1 rev/min."""
RETRACTION = (
    10.0  # radial distance by which the tool leaves the cut before it returns [mm] (assumption)
)
WARNING = "SIMULATION OUTPUT: NOT FOR A MACHINE WITHOUT REVIEW"
SAFE_START = "G18 G40 G54 G64 G90 G95 G710 DIAMON"
"""Plane ZX; no tool radius compensation; first zero offset; no stop between blocks; absolute; feed per revolution; mm; X is a
diameter. G95 must precede G96, which it would end."""
UNITS = (
    "X: diameter in mm; Z: mm, 0 at the face of the bar; S: cutting speed in m/min (G96); F: feed in mm/rev; "
    "LIMS: highest spindle speed in rev/min"
)


@dataclass(frozen=True)
class Program:
    """A turning program of one cut along a bar."""

    diameter: float  # of the cut [mm]
    start: float  # Z at which the cut starts, in the air before the face [mm]
    end: float  # Z at which it ends [mm]
    max_spindle_speed: float  # [rev/min]
    cutting_speed: float  # [m/min]
    feed: float  # at an override of 100 % [mm/rev]
    law: Law  # from measured load to feed override

    @classmethod
    def of(cls, scenario: Scenario, cutting_speed: float, feed: float, law: Law) -> Self:
        """Return the program of a cut along a whole bar of a scenario."""
        workpiece = scenario.workpiece
        highest = _highest_spindle_speed(scenario)
        limit = rounded_within(highest, 0.0, highest, LIMIT_DECIMALS)
        lengths = workpiece.diameter, workpiece.approach, -workpiece.bar_length
        diameter, start, end = (round(length, LENGTH_DECIMALS) for length in lengths)
        program = cls(diameter, start, end, limit, cutting_speed, feed, law)
        program.check(scenario)
        return program

    def check(self, scenario: Scenario) -> None:
        """Check that a scenario's machine can run the program and that its bar is the program's.

        Raises:
            NcError: cutting speed, feed or spindle speed is outside the machine's range, or a position is not the scenario's.
        """
        workpiece, machine = scenario.workpiece, scenario.machine
        lengths = {
            "diameter": (self.diameter, workpiece.diameter),
            "first position": (self.start, workpiece.approach),
            "last position": (self.end, -workpiece.bar_length),
        }
        for what, (mine, its) in lengths.items():
            if abs(mine - its) > 0.5 * 10.0**-LENGTH_DECIMALS + 1e-9:
                raise NcError(
                    f"the program's {what} is {mine} mm, but that of scenario {scenario.name!r} is {its} mm"
                )
        ranges = {
            "cutting speed": (
                self.cutting_speed,
                machine.cutting_speed_min,
                machine.cutting_speed_max,
            ),
            "feed": (self.feed, machine.feed_min, machine.feed_max),
            "LIMS": (self.max_spindle_speed, 0.0, _highest_spindle_speed(scenario)),
        }
        for what, (value, low, high) in ranges.items():
            if not low * (1.0 - 1e-9) <= value <= high * (1.0 + 1e-9):
                raise NcError(
                    f"the program's {what} is {value}, but the machine's range is {low:g} to {high:g}"
                )


def rounded_within(value: float, low: float, high: float, decimals: int) -> float:
    """Return the nearest value of a control's resolution within a range.

    Raises:
        NcError: the range holds none.
    """
    scale = 10.0**decimals
    first, last = math.ceil(low * scale - 1e-9), math.floor(high * scale + 1e-9)
    if first > last:
        raise NcError(f"the range {low} to {high} holds no value of {decimals} decimals")
    return float(round(min(max(round(value * scale), first), last) / scale, decimals))


def _highest_spindle_speed(scenario: Scenario) -> float:
    return 1000.0 * scenario.machine.cutting_speed_max / (math.pi * scenario.workpiece.diameter)


# Read.


def read(text: str) -> Program:
    """Return the program of a text.

    Raises:
        NcError: the text is not understood, or is not one cut along a bar; names the line and the reason.
    """
    return _program(divide(text, SINUMERIK))


def read_file(path: Path) -> Program:
    """Return the program in a file."""
    program = read_program_file(path, SINUMERIK)
    with naming(path):
        return _program(program)


def _program(program: PartProgram) -> Program:
    """Return a part program as one cut: the only move at feed, along Z."""
    done = run(program)
    last = program.parts[program.main][-1]
    if not any(word.address == "M" and word.value == 30 for word in last.words):
        raise NcError(f"line {last.number}: the program must end with M30")
    cut, *others = [move for move in done.moves if move.kind != "rapid"]
    path, radius = cut.path, cut.path.end[1]
    if others:
        raise NcError(f"line {others[0].line}: the cut must be one block, that of line {cut.line}")
    if not (
        cut.kind == "feed"
        and path.centre is None
        and path.start[1] == radius
        and path.end[0] < path.start[0]
    ):
        raise NcError(f"line {cut.line}: feed must go along Z towards the chuck, with G01 Z...")
    if not (
        cut.constant_cutting_speed and cut.per_revolution and math.isfinite(cut.max_spindle_speed)
    ):
        raise NcError(f"line {cut.line}: feed must be under G95 and G96, with LIMS")
    for move in done.moves[1:]:  # the first comes from anywhere
        (z, x), (end, end_x) = move.path.start, move.path.end
        if (
            move is not cut
            and min(x, end_x) < radius + RETRACTION - 1e-9
            and not (z == end and (end_x >= x or z >= 0.0))
        ):
            raise NcError(
                f"line {move.line}: a rapid move along Z must keep to X{2.0 * (radius + RETRACTION)} or beyond"
            )
    return Program(
        _in_resolution("X", 2.0 * radius, LENGTH_DECIMALS, cut),
        _in_resolution("Z", path.start[0], LENGTH_DECIMALS, cut),
        _in_resolution("Z", path.end[0], LENGTH_DECIMALS, cut),
        _in_resolution("LIMS", cut.max_spindle_speed, LIMIT_DECIMALS, cut),
        _in_resolution("S", cut.speed.value, SPEED_DECIMALS, cut),
        _in_resolution("F", cut.feed.value, FEED_DECIMALS, cut),
        done.law,
    )


def _in_resolution(address: str, value: float, decimals: int, move: Move) -> float:
    if not abs(value - round(value, decimals)) < 1e-9:
        what = f"{address}{value:g} is finer than the control's resolution"
        raise NcError(f"line {move.line}: {what}, which is {decimals} decimals")
    return round(value, decimals) + 0.0  # no -0.0


# Write.


def write(program: Program, comments: Iterable[str] = ()) -> str:
    """Return the text of a program: warning, comments, units, and numbered blocks."""
    lines = [
        f"; {line}"
        for text in (WARNING, *comments, UNITS)
        for line in textwrap.wrap(_plain(text), 100) or [""]
    ]
    diameter, across, start, end = (
        f"{length:.{LENGTH_DECIMALS}f}"
        for length in (
            program.diameter,
            program.diameter + 2.0 * RETRACTION,
            program.start,
            program.end,
        )
    )
    set_points = f"S{program.cutting_speed:.{SPEED_DECIMALS}f} F{program.feed:.{FEED_DECIMALS}f}"
    blocks = (
        SAFE_START,
        "T1 D1",
        *(["STOPRE"] if program.law.first_values else []),
        *program.law.lines,
        f"G96 {set_points} LIMS={program.max_spindle_speed:.{LIMIT_DECIMALS}f} M03",
        f"G00 X{across} Z{start}",
        f"G00 X{diameter}",
        f"G01 Z{end}",
        f"G00 X{across}",
        f"G00 Z{start}",
        "M05",
        "M30",
    )
    lines += [f"N{10 * number} {block}" for number, block in enumerate(blocks, 1)]
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """Return a comment's text as one line of ASCII, which every control can show."""
    return " ".join(text.encode("ascii", "replace").decode().split())
