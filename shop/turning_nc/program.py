"""Programs of the project: one cut along a bar at a constant cutting speed and feed.

An override law acts on the feed. The programs are SINUMERIK's, and are read as those of users are.
X is a diameter. Z is 0 at the bar's face and decreases towards the chuck.
"""

import math
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

from turning_nc.dialects import SINUMERIK
from turning_nc.law import Law
from turning_nc.moves import Move, run
from turning_nc.words import NcError, PartProgram, divide, naming, read_program_file

from turning_env import Scenario

# A control's resolution: 0.1 m/min, 0.001 mm/rev, 0.001 mm and 0.1 rev/min.
SPEED_DECIMALS = 1
FEED_DECIMALS = 3
LENGTH_DECIMALS = 3
LIMIT_DECIMALS = 1

# Radial distance by which the tool leaves the cut before it returns [mm] (assumption).
RETRACTION = 10.0
WARNING = "SIMULATION OUTPUT: NOT FOR A MACHINE WITHOUT REVIEW"

# Plane ZX; no tool radius compensation; first zero offset; no stop between blocks; absolute; feed
# per revolution; mm; X is a diameter. G95 must precede G96, which it would end.
SAFE_START = "G18 G40 G54 G64 G90 G95 G710 DIAMON"
UNITS = (
    "X: diameter in mm; Z: mm, 0 at the face of the bar; S: cutting speed in m/min (G96); "
    "F: feed in mm/rev; LIMS: highest spindle speed in rev/min"
)
COMMENT_WIDTH = 100  # characters of a line of comment


class _Range(NamedTuple):
    """A value of a program, and the range of a machine."""

    value: float
    low: float
    high: float


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
        program = cls(
            diameter=round(workpiece.diameter, LENGTH_DECIMALS),
            start=round(workpiece.approach, LENGTH_DECIMALS),
            end=round(-workpiece.bar_length, LENGTH_DECIMALS),
            max_spindle_speed=rounded_within(highest, 0.0, high=highest, decimals=LIMIT_DECIMALS),
            cutting_speed=cutting_speed,
            feed=feed,
            law=law,
        )
        program.check(scenario)
        return program

    def check(self, scenario: Scenario) -> None:
        """Check that a scenario's machine can run the program and that its bar is the program's.

        Raises:
            NcError: cutting speed, feed or spindle speed is outside the machine's range, or a
                position is not the scenario's.
        """
        workpiece = scenario.workpiece
        self._check_length(scenario, "diameter", self.diameter, workpiece.diameter)
        self._check_length(scenario, "first position", self.start, workpiece.approach)
        self._check_length(scenario, "last position", self.end, -workpiece.bar_length)
        machine = scenario.machine
        ranges = {
            "cutting speed": _Range(
                self.cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max
            ),
            "feed": _Range(self.feed, machine.feed_min, machine.feed_max),
            "LIMS": _Range(self.max_spindle_speed, 0.0, _highest_spindle_speed(scenario)),
        }
        for name, (value, low, high) in ranges.items():
            # Rounding errors may put a value at a limit beyond it.
            if not low * (1.0 - 1e-9) <= value <= high * (1.0 + 1e-9):
                raise NcError(
                    f"the program's {name} is {value}, "
                    f"but the machine's range is {low:g} to {high:g}"
                )

    def _check_length(self, scenario: Scenario, name: str, length: float, expected: float) -> None:
        """Check that a length is the scenario's, as far as the control resolves it."""
        if abs(length - expected) > 0.5 * 10.0**-LENGTH_DECIMALS + 1e-9:
            raise NcError(
                f"the program's {name} is {length} mm, "
                f"but that of scenario {scenario.name!r} is {expected} mm"
            )


def rounded_within(value: float, low: float, high: float, decimals: int) -> float:
    """Return the nearest value of a control's resolution within a range.

    Raises:
        NcError: the range holds none.
    """
    scale = 10.0**decimals
    first = math.ceil(low * scale - 1e-9)
    last = math.floor(high * scale + 1e-9)
    if first > last:
        raise NcError(f"the range {low} to {high} holds no value of {decimals} decimals")
    nearest = round(value * scale)
    steps = min(max(nearest, first), last)
    rounded = round(steps / scale, decimals)
    return float(rounded)


def _highest_spindle_speed(scenario: Scenario) -> float:
    """Return the spindle speed at the highest cutting speed [rev/min]."""
    return 1000.0 * scenario.machine.cutting_speed_max / (math.pi * scenario.workpiece.diameter)


# Read.


def read(text: str) -> Program:
    """Return the program of a text.

    Raises:
        NcError: the text is not understood, or is not one cut along a bar; names the line and the
            reason.
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
    if not last.has("M", 30):
        raise NcError(f"line {last.number}: the program must end with M30")
    cut, *others = [move for move in done.moves if move.kind != "rapid"]
    if others:
        raise NcError(f"line {others[0].line}: the cut must be one block, that of line {cut.line}")
    _check_cut(cut)
    # The first move comes from anywhere.
    for move in done.moves[1:]:
        if move is not cut:
            _check_retraction(move, cut.path.end.x)
    return Program(
        diameter=_in_resolution("X", 2.0 * cut.path.end.x, LENGTH_DECIMALS, cut),
        start=_in_resolution("Z", cut.path.start.z, LENGTH_DECIMALS, cut),
        end=_in_resolution("Z", cut.path.end.z, LENGTH_DECIMALS, cut),
        max_spindle_speed=_in_resolution("LIMS", cut.max_spindle_speed, LIMIT_DECIMALS, cut),
        cutting_speed=_in_resolution("S", cut.speed.value, SPEED_DECIMALS, cut),
        feed=_in_resolution("F", cut.feed.value, FEED_DECIMALS, cut),
        law=done.law,
    )


def _check_cut(cut: Move) -> None:
    """Check that a move is a cut along Z at a constant cutting speed."""
    path = cut.path
    is_straight = path.centre is None
    is_along_z = path.start.x == path.end.x
    is_to_chuck = path.end.z < path.start.z
    if not (cut.kind == "feed" and is_straight and is_along_z and is_to_chuck):
        raise NcError(f"line {cut.line}: feed must go along Z towards the chuck, with G01 Z...")
    is_limited = math.isfinite(cut.max_spindle_speed)
    if not (cut.constant_cutting_speed and cut.per_revolution and is_limited):
        raise NcError(f"line {cut.line}: feed must be under G95 and G96, with LIMS")


def _check_retraction(move: Move, radius: float) -> None:
    """Check that a rapid move keeps away from the bar, whose radius is that of the cut.

    Along X it may leave the bar, or go anywhere before its face.
    """
    start = move.path.start
    end = move.path.end
    is_away = min(start.x, end.x) >= radius + RETRACTION - 1e-9
    is_along_x = start.z == end.z and (end.x >= start.x or start.z >= 0.0)
    if not (is_away or is_along_x):
        raise NcError(
            f"line {move.line}: a rapid move along Z must keep to "
            f"X{2.0 * (radius + RETRACTION)} or beyond"
        )


def _in_resolution(address: str, value: float, decimals: int, move: Move) -> float:
    """Return a value that a control can hold."""
    if not abs(value - round(value, decimals)) < 1e-9:
        raise NcError(
            f"line {move.line}: {address}{value:g} is finer than the control's resolution, "
            f"which is {decimals} decimals"
        )
    # The sum with 0 turns -0.0 into 0.0.
    return round(value, decimals) + 0.0


# Write.


def write(program: Program, comments: Iterable[str] = ()) -> str:
    """Return the text of a program: warning, comments, units, and numbered blocks."""
    lines = []
    for comment in (WARNING, *comments, UNITS):
        # An empty comment is an empty line.
        wrapped = textwrap.wrap(_plain(comment), COMMENT_WIDTH) or [""]
        for line in wrapped:
            lines.append(f"; {line}")
    for number, block in enumerate(_blocks(program), 1):
        lines.append(f"N{10 * number} {block}")
    text = "\n".join(lines)
    return f"{text}\n"


def _blocks(program: Program) -> list[str]:
    """Return the blocks of a program, without their numbers."""
    diameter = _length(program.diameter)
    away = _length(program.diameter + 2.0 * RETRACTION)
    start = _length(program.start)
    end = _length(program.end)
    speed = f"{program.cutting_speed:.{SPEED_DECIMALS}f}"
    feed = f"{program.feed:.{FEED_DECIMALS}f}"
    limit = f"{program.max_spindle_speed:.{LIMIT_DECIMALS}f}"
    # Blocks are read ahead: STOPRE keeps the first values from being set too early.
    stop = ["STOPRE"] if program.law.first_values else []
    return [
        SAFE_START,
        "T1 D1",
        *stop,
        *program.law.lines,
        f"G96 S{speed} F{feed} LIMS={limit} M03",
        f"G00 X{away} Z{start}",
        f"G00 X{diameter}",
        f"G01 Z{end}",
        f"G00 X{away}",
        f"G00 Z{start}",
        "M05",
        "M30",
    ]


def _length(length: float) -> str:
    return f"{length:.{LENGTH_DECIMALS}f}"


def _plain(text: str) -> str:
    """Return a comment's text as one line of ASCII, which every control can show."""
    return " ".join(text.encode("ascii", "replace").decode().split())
