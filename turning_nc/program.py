"""Programs of the project: blocks of one cutting speed and feed along Z, bar by bar, and optionally an override law.

They are SINUMERIK programs, and are read as those of users are. X is a diameter. Z is 0 at the bar's face and decreases towards
the chuck.
"""

import itertools
import math
import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from turning_env import Scenario
from turning_nc.dialects import SINUMERIK
from turning_nc.law import Law
from turning_nc.moves import Move, run
from turning_nc.words import NcError, PartProgram, divide, naming, read_program_file

SPEED_DECIMALS, FEED_DECIMALS, LENGTH_DECIMALS, LIMIT_DECIMALS = 1, 3, 3, 1
"""A control's resolution: cutting speed 0.1 m/min, feed 0.001 mm/rev, lengths 0.001 mm, spindle speed 0.1 rev/min."""
RETRACTION = 10.0  # radial distance by which the tool leaves the cut before it returns [mm] (assumption)
WARNING = "SIMULATION OUTPUT: NOT FOR A MACHINE WITHOUT REVIEW"
SAFE_START = "G18 G40 G54 G64 G90 G95 G710 DIAMON"
"""Plane ZX; no tool radius compensation; first zero offset; no stop between blocks; absolute; feed per revolution; mm; X is a
diameter. G95 must precede G96, which it would end."""
UNITS = (
    "X: diameter in mm; Z: mm, 0 at the face of the bar; S: cutting speed in m/min (G96); F: feed in mm/rev; "
    "LIMS: highest spindle speed in rev/min"
)


@dataclass(frozen=True)
class Block:
    """A feed block."""

    z: float  # position of its end [mm]
    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]


@dataclass(frozen=True)
class Program:
    """A turning program: the same cut on successive bars, each with its own blocks."""

    diameter: float  # diameter of the cut [mm]
    start: float  # Z at which every bar's first block starts, in the air before the face [mm]
    max_spindle_speed: float  # [rev/min]
    bars: tuple[tuple[Block, ...], ...]
    law: Law = field(default_factory=Law)  # law from measured load to feed override; without actions, there is none

    @classmethod
    def of(cls, scenario: Scenario, bars: tuple[tuple[Block, ...], ...], law: Law | None = None) -> Self:
        """Return a program for a scenario's machine and bars."""
        workpiece = scenario.workpiece
        highest = _spindle_speed(scenario.machine.cutting_speed_max, workpiece.diameter)
        limit = rounded_within(highest, 0.0, highest, LIMIT_DECIMALS)
        diameter, start = round(workpiece.diameter, LENGTH_DECIMALS), round(workpiece.approach, LENGTH_DECIMALS)
        program = cls(diameter, start, limit, bars, law or Law())
        program.check(scenario)
        return program

    def check(self, scenario: Scenario) -> None:
        """Check that a scenario's machine can run the program and that its bars are the program's.

        Raises:
            NcError: a speed or feed is outside the machine's range, or a position is not the scenario's. Names bar and block.
        """
        workpiece, machine = scenario.workpiece, scenario.machine
        lengths = {"diameter": (self.diameter, workpiece.diameter), "first position": (self.start, workpiece.approach)}
        for what, (mine, its) in lengths.items():
            if abs(mine - its) > 0.5 * 10.0**-LENGTH_DECIMALS + 1e-9:
                raise NcError(f"the program's {what} is {mine} mm, but that of scenario {scenario.name!r} is {its} mm")
        highest = _spindle_speed(machine.cutting_speed_max, workpiece.diameter)
        if self.max_spindle_speed > highest * (1.0 + 1e-9):
            raise NcError(f"LIMS is {self.max_spindle_speed} rev/min, but the machine's highest is {highest:.1f}")
        if not self.bars or not all(self.bars):
            raise NcError("a program must cut at least one bar, and every bar in at least one block")
        for number, blocks in enumerate(self.bars, 1):
            position = self.start
            for index, block in enumerate(blocks, 1):
                where = f"bar {number}, feed block {index}"
                speeds, feeds = (machine.cutting_speed_min, machine.cutting_speed_max), (machine.feed_min, machine.feed_max)
                for what, value, (low, high) in (("cutting speed", block.cutting_speed, speeds), ("feed", block.feed, feeds)):
                    if not low * (1.0 - 1e-9) <= value <= high * (1.0 + 1e-9):
                        raise NcError(f"{where}: {what} is {value}, but the machine's range is {low} to {high}")
                if not -workpiece.bar_length - 1e-3 <= block.z < position:
                    raise NcError(f"{where}: Z is {block.z}, but must lie below {position} and not below -{workpiece.bar_length}")
                position = block.z
            if number < len(self.bars) and abs(position + workpiece.bar_length) > 1e-3:
                raise NcError(f"bar {number} ends at Z{position}, but all but the last must end at -{workpiece.bar_length}")

    @property
    def blocks(self) -> int:
        """Number of feed blocks."""
        return sum(len(bar) for bar in self.bars)


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


def _spindle_speed(cutting_speed: float, diameter: float) -> float:
    return 1000.0 * cutting_speed / (math.pi * diameter)


# Read.


def read(text: str) -> Program:
    """Return the program of a text.

    Raises:
        NcError: the text is not understood, or is no turning of one diameter along bars; names the line and the reason.
    """
    return _program(divide(text, SINUMERIK))


def read_file(path: Path) -> Program:
    """Return the program in a file."""
    program = read_program_file(path, SINUMERIK)
    with naming(path):
        return _program(program)


def _program(program: PartProgram) -> Program:
    """Return a part program as bars: runs of moves at feed along Z, on one diameter and from one start."""
    done = run(program)
    last = program.parts[program.main][-1]
    if not (done.moves and any(word.address == "M" and word.value == 30 for word in last.words)):
        raise NcError(f"line {last.number}: the program must end with M30")
    first = next(move for move in done.moves if move.kind != "rapid")
    start, radius = first.path.start
    bars = []
    for rapid, group in itertools.groupby(done.moves, lambda move: move.kind == "rapid"):
        if rapid:
            _check_clear((move for move in group if move is not done.moves[0]), radius)  # the first comes from anywhere
            continue
        moves = list(group)
        if moves[0].path.start[0] != start:
            raise NcError(f"line {moves[0].line}: every bar must be approached at Z{start}, as the first")
        bars.append(tuple(_block(move, radius, first.max_spindle_speed) for move in moves))
    limit = _in_resolution("LIMS", first.max_spindle_speed, LIMIT_DECIMALS, first)
    diameter = _in_resolution("X", 2.0 * radius, LENGTH_DECIMALS, first)
    return Program(diameter, _in_resolution("Z", start, LENGTH_DECIMALS, first), limit, tuple(bars), done.law)


def _block(move: Move, radius: float, max_spindle_speed: float) -> Block:
    path = move.path
    along_z = path.centre is None and path.start[1] == path.end[1] == radius and path.end[0] < path.start[0]
    if move.kind != "feed" or not along_z:
        raise NcError(f"line {move.line}: feed must go towards the chuck with G01 Z..., at X{2.0 * radius}")
    if not (move.constant_cutting_speed and move.per_revolution and move.max_spindle_speed == max_spindle_speed):
        raise NcError(f"line {move.line}: feed must be under G95 and G96, with one LIMS")
    return Block(
        _in_resolution("Z", path.end[0], LENGTH_DECIMALS, move),
        _in_resolution("S", move.speed.value, SPEED_DECIMALS, move),
        _in_resolution("F", move.feed.value, FEED_DECIMALS, move),
    )


def _check_clear(moves: Iterable[Move], radius: float) -> None:
    """Check that rapid moves keep beside the bar, except for those out of it or before its face along X."""
    for move in moves:
        (z, x), (end, end_x) = move.path.start, move.path.end
        if min(x, end_x) < radius + RETRACTION - 1e-9 and not (z == end and (end_x >= x or z >= 0.0)):
            raise NcError(f"line {move.line}: a rapid move along Z must keep to X{2.0 * (radius + RETRACTION)} or beyond")


def _in_resolution(address: str, value: float, decimals: int, move: Move) -> float:
    if not abs(value - round(value, decimals)) < 1e-9:
        what = f"{address}{value:g} is finer than the control's resolution"
        raise NcError(f"line {move.line}: {what}, which is {decimals} decimals")
    return round(value, decimals) + 0.0  # no -0.0


# Write.


def write(program: Program, comments: Iterable[str] = ()) -> str:
    """Return the text of a program: warning, comments, units, and numbered blocks."""
    lines = [f"; {line}" for text in (WARNING, *comments, UNITS) for line in textwrap.wrap(_plain(text), 100) or [""]]
    for index, block in enumerate(_blocks(program), 1):
        lines.append(f"N{10 * index} {block}")
    return "\n".join(lines) + "\n"


def _blocks(program: Program) -> Iterator[str]:
    yield SAFE_START
    yield "T1 D1"
    if program.law.first_values:
        yield "STOPRE"
    yield from program.law.lines
    limit = f" LIMS={program.max_spindle_speed:.{LIMIT_DECIMALS}f}"
    across = f"{program.diameter + 2.0 * RETRACTION:.{LENGTH_DECIMALS}f}"
    start = f"{program.start:.{LENGTH_DECIMALS}f}"
    for number, blocks in enumerate(program.bars):
        set_points = [(f"S{block.cutting_speed:.{SPEED_DECIMALS}f}", f"F{block.feed:.{FEED_DECIMALS}f}") for block in blocks]
        yield f"G96 {' '.join(set_points[0])}{limit} M03 ; bar {number + 1}"
        limit = ""
        yield f"G00 X{across} Z{start}"
        yield f"G00 X{program.diameter:.{LENGTH_DECIMALS}f}"
        for block, before, words in zip(blocks, [set_points[0], *set_points], set_points, strict=False):
            new = [word for word in words if word not in before]
            yield " ".join((f"G01 Z{block.z:.{LENGTH_DECIMALS}f}", *new))
        yield f"G00 X{across}"
        yield f"G00 Z{start}"
        yield "M05"
        if number + 1 < len(program.bars):
            yield "M00 ; the next bar is put in"
    yield "M30"


def _plain(text: str) -> str:
    """Return a comment's text as one line of ASCII, which every control can show."""
    return " ".join(text.encode("ascii", "replace").decode().split())
