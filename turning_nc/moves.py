"""Run a part program as a control does: from blocks to the moves of the tool, with the feed and the speed in force.

Positions are Z and X, X as a radius. What is not understood is named with its line; nothing is skipped silently.
"""

import contextlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from turning_nc.blocks import Line, PartProgram, Problem, Word
from turning_nc.corners import Corner, break_corner
from turning_nc.cycles import FANUC_CYCLES, cycle95, cycle97, fanuc_cycle
from turning_nc.modal import HOME, Modal, Setting
from turning_nc.paths import Path, Point
from turning_nc.program import NcError

MAX_MOVES, MAX_BLOCKS, MAX_CALLS = 100_000, 200_000, 8
MAX_NAMED = 20
"""Largest number of lines that an error names."""

Kind = Literal["rapid", "feed", "thread", "dwell"]


@dataclass(frozen=True)
class Move:
    """A move of the tool, or a dwell."""

    kind: Kind
    path: Path
    line: int
    """Line of the file whose block moves the tool; for a pass of a cycle, that of the cycle."""
    line_end: int
    """Place in the text after this line's last word."""
    tool: str
    feed: Setting
    per_revolution: bool
    speed: Setting
    constant_cutting_speed: bool
    max_spindle_speed: float
    """[rev/min]; infinite if the program sets none."""
    cycle_pass: int = 0
    """Number of the pass within a cycle, from 1; 0 outside."""
    time: float = 0.0
    """Duration of a dwell [s]."""


@dataclass(frozen=True)
class Moves:
    """The moves of a program."""

    program: PartProgram
    moves: tuple[Move, ...]
    notes: tuple[str, ...]
    """What was assumed, or not understood but without effect on the tool's path, with lines."""


class _End(Exception):
    """The program's end."""


_MOTIONS = {0, 1, 2, 3, 32, 33}
_G = {
    "fanuc": {7, 8, 20, 21, 28, 30, 32, 50, 92, 98, 99, *FANUC_CYCLES}
    | {18, 22, 23, 25, 26, 40, 49, *range(54, 60), 61, 64, 67, 69, 80},
    "sinumerik": {25, 26, 70, 71, 74, 75, 700, 710}
    | {9, 18, 40, 60, 64, 290, 450, 451, 500, *range(54, 58), *range(505, 600), *range(601, 604), *range(641, 646)},
}
"""G functions of one dialect; those in the second lines are without effect on the path or on times."""
_G_OF_BOTH = {0, 1, 2, 3, 4, 33, 41, 42, 53, 90, 91, 94, 95, 96, 97}
_IGNORED_NAMES = {"SOFT", "BRISK", "DRIVE", "FFWON", "FFWOF", "CFC", "CFTCP", "CFIN", "COMPOF", "STOPRE", "NORM", "KONT", "G"}
_IGNORED_CALLS = {"MSG", "SETMS", "WORKPIECE"}
_CORNERS: dict[str, dict[str, Literal["legs", "chord", "radius"]]] = {
    "fanuc": {",C": "legs", ",R": "radius"},
    "sinumerik": {"CHR": "legs", "CHF": "chord", "RND": "radius"},
}
_WORDS = {
    "fanuc": {*"NGMTSFXZUWIKRPQDL", *_CORNERS["fanuc"]},
    "sinumerik": {*"NGMTSFXZIKDLP", "CR", "LIMS", "RNDM", "S1", "M1", "T1", *_CORNERS["sinumerik"]},
}


def run(program: PartProgram, go_on: bool = False) -> Moves:
    """Return the moves of a program.

    Args:
        program: the program's lines.
        go_on: leave out blocks that are not understood, and name them in the notes, instead of refusing the program.

    Raises:
        NcError: blocks are not understood; names each with its line.
    """
    control = Control(program)
    with contextlib.suppress(_End):
        control.run_lines(program.parts[program.main])
    control.end_corner()
    if control.problems and not go_on:
        listed = [f"line {line}: {reason}" for line, reason in sorted(control.problems.items())]
        more = [f"and {len(listed) - MAX_NAMED} more lines"] if len(listed) > MAX_NAMED else []
        raise NcError("not understood:\n  " + "\n  ".join(listed[:MAX_NAMED] + more))
    notes = control.notes | {line: f"left out: {reason}" for line, reason in control.problems.items()}
    if not any(move.kind == "feed" for move in control.moves):
        raise NcError("the program has no feed move, such as G1")
    return Moves(program, tuple(control.moves), tuple(f"line {line}: {note}" for line, note in sorted(notes.items())))


@dataclass
class Control(Modal):
    """A control that runs blocks."""

    moves: list[Move] = field(default_factory=list)
    problems: dict[int, str] = field(default_factory=dict)
    variables: dict[str, float] = field(default_factory=dict)
    motion: int | None = None
    corner: Corner | None = None
    """Between the last move and the next."""
    rounding: float = 0.0
    """Radius of all corners between moves at feed, RNDM [mm]."""
    depth: float = 0.0
    retraction: float = 0.5
    """What the first blocks of G71 and G72 say [mm]."""
    pattern: Point = (0.0, 0.0)
    repeats: int = 0
    """What the first block of G73 says: distance along Z and X of its first pass [mm], and number of passes."""
    thread: tuple[int, float, float, float] | None = None
    """What the first block of G76 says: finishing passes, angle [degrees], smallest depth and allowance [mm]."""
    cycle_pass: int = 0
    calls: int = 0
    radius_noted: bool = False
    blocks: list[int] = field(default_factory=lambda: [0])
    """Number of blocks run, also in contours."""

    def run_lines(self, lines: Sequence[Line], start: int = 0, end: int | None = None) -> None:
        """Run lines from an index to another; a cycle names the index at which the program goes on."""
        index = start
        end = len(lines) if end is None else end
        while index < end:
            self.line = line = lines[index]
            self.blocks[0] += 1
            if len(self.moves) > MAX_MOVES or self.blocks[0] > MAX_BLOCKS:
                raise NcError(
                    f"line {line.number}: more than {MAX_MOVES} moves or {MAX_BLOCKS} blocks are run; are calls repeated?"
                )
            try:
                follows = self._block(self._without_variables(line), lines, index)
            except Problem as problem:
                self._name(line, problem)
                follows = None
            if follows == -1:  # the end of a sub-program
                return
            index = index + 1 if follows is None else follows

    def _name(self, line: Line, problem: object) -> None:
        self.problems.setdefault(line.number, f"{problem} (in {line.text[:60]!r})")

    # One block.

    def _without_variables(self, line: Line) -> Line:
        """Return the line with computed values, and without the variables that it sets."""
        line = line.with_values(self.variables)
        if not any(_is_variable(word) for word in line.words):
            return line
        self.variables |= {word.address: word.value for word in line.words if _is_variable(word) and word.value is not None}
        return replace(line, words=tuple(word for word in line.words if not _is_variable(word)))

    def _block(self, line: Line, lines: Sequence[Line], index: int) -> int | None:
        if line.unknown:
            raise Problem(f"{line.unknown[:40]!r} is no word")
        if line.text.startswith("/"):
            self.note("the block with / is run")
        words = [word for word in line.words if not word.address.endswith(":")]
        codes = self._codes(words)
        self._names(words)
        self._check_use(words, codes)
        self.set_units_and_modes(codes)
        if self._dwell(codes, line):
            return None
        self.set_feed_and_speed(line, codes)
        self.set_tool(line)
        follows = self._cycle_or_reference(codes, line, lines, index)
        if follows == index:
            self._move(codes, line)
        ends = self._calls(line, words)
        return ends if ends is not None or follows == index else follows

    def _codes(self, words: Sequence[Word]) -> set[float]:
        """Return the block's G functions after a check of all its words."""
        known = _WORDS[self.program.dialect]
        codes = set()
        for word in words:
            if word.address == "G" and word.value is not None:
                codes.add(word.value)
            elif (word.value is not None or word.text) and word.address not in known:
                raise Problem(f"the address {word.address}{'=' if word.address[1:].isalnum() else ''} is not understood")
        for code in sorted(codes - _G_OF_BOTH - _G[self.program.dialect]):
            raise Problem(f"G{code:g} is not understood")
        if codes & {41, 42} and not self.radius_noted:
            self.radius_noted = True
            self.note("the tool's tip follows the contour, as with a nose radius that the control compensates")
        motions = codes & _MOTIONS
        if len(motions) > 1:
            raise Problem(f"{' and '.join(f'G{code:g}' for code in sorted(motions))} exclude each other")
        return codes

    def _names(self, words: Sequence[Word]) -> None:
        for word in words:
            if word.value is not None or word.text:
                continue
            name = word.address
            if name in ("DIAMON", "DIAMOF", "DIAM90"):
                self.diameter = {"DIAMON": "on", "DIAMOF": "off", "DIAM90": "90"}[name]
            elif name == "SUPA":
                pass
            elif not (
                name in _IGNORED_NAMES
                or (name in _IGNORED_CALLS and word.arguments is not None)
                or name in ("CYCLE95", "CYCLE97", "RET")
                or name in self.program.parts
            ):
                raise Problem(f"{name}{'()' if word.arguments is not None else ''} is not understood")

    def _check_use(self, words: Sequence[Word], codes: set[float]) -> None:
        """Refuse words that have no meaning in their block."""
        motion = min(codes & _MOTIONS, default=self.motion)
        used = {"I", "K", "R", "CR"} if motion in (2, 3) else {"I", "K", "Q"} if motion in (32, 33) else set()
        if self.fanuc:
            calls = any(word.address == "M" and word.value == 98 for word in words)
            if codes & FANUC_CYCLES:
                first = 76 in codes or not any(word.address == "P" for word in words)
                used |= {*"PQD"} | ({"R"} if first else set()) | ({*"IK"} if 73 in codes else set())
            used |= {*"PL"} if calls else {"P"} if codes & {4, 30} else {"D"} if 96 in codes else set()
        else:
            used |= {"D", "L"}
            used |= {"P"} if any(word.address == "L" or word.address in self.program.parts for word in words) else set()
        for word in words:
            if word.address in {*"IKRPQDL", "CR"} - used and word.value is not None:
                corner = "; write ,R for a radius between moves" if word.address == "R" else ""
                raise Problem(f"{word.address}{word.text} has no meaning in this block{corner}")

    def _dwell(self, codes: set[float], line: Line) -> bool:
        if 4 not in codes:
            return False
        if self.fanuc:
            word = line.first("X", "U", "P")
            if word is None or word.value is None:
                raise Problem("G4 needs its time: X, U or P")
            seconds = word.value / 1000.0 if word.address == "P" and "." not in word.text else word.value
        elif (word := line.first("F")) and word.value is not None:
            seconds = word.value
        elif (word := line.first("S")) and word.value is not None:
            seconds = 60.0 * word.value / self.spindle_speed()
        else:
            raise Problem("G4 needs its time: F or S")
        if seconds < 0.0:
            raise Problem(f"the dwell is {seconds:g} s, but must not be below 0")
        self.add(Path((self.z, self.x), (self.z, self.x)), "dwell", seconds)
        return True

    # Moves.

    def _move(self, codes: set[float], line: Line) -> None:
        motions = codes & _MOTIONS
        if motions:
            self.motion = int(min(motions))
        rounding = line.number_of("RNDM")
        if rounding is not None:
            self.rounding = rounding * self.length_scale
        if not (line.first("X", "Z", "U", "W") or (self.motion in (2, 3) and motions and line.first("I", "K"))):
            if line.first(*_CORNERS[self.program.dialect]):
                raise Problem("a chamfer or a radius needs a move to its corner in the same block")
            return
        if 53 in codes or line.first("SUPA"):
            self._go_home("machine coordinates")
            return
        if self.motion is None:
            raise Problem("coordinates stand before the first G0 or G1")
        start, end = (self.z, self.x), self.target(line)
        path = self._arc(line, start, end) if self.motion in (2, 3) else Path(start, end, rapid=self.motion == 0)
        if self.motion in (32, 33):
            lead = line.first("F", "K") if self.fanuc else line.first("K", "I")
            if lead is None or not lead.value:
                raise Problem(f"G{self.motion} needs its lead: {'F' if self.fanuc else 'K'}")
            self.note("a thread's load is not computed")
            kept = self.feed, self.per_revolution
            self.feed, self.per_revolution = Setting(lead.value * self.length_scale), True
            self.add(path, "thread")
            self.feed, self.per_revolution = kept
        else:
            self.add(path, "rapid" if self.motion == 0 else "feed")
        if self.moves and self.moves[-1].path.end == end:
            self.corner = self._corner(line)

    def _corner(self, line: Line) -> Corner | None:
        kinds = _CORNERS[self.program.dialect]
        word = line.first(*kinds)
        if word is not None and word.value:
            if self.motion != 1 or word.value < 0.0:
                raise Problem("a chamfer or a radius needs a size above 0, and straight moves at feed, G1")
            return Corner(kinds[word.address], word.value * self.length_scale, line.number)
        modal = self.rounding > 0.0 and self.motion in (1, 2, 3)
        return Corner("radius", self.rounding, line.number, modal=True) if modal else None

    def _arc(self, line: Line, start: Point, end: Point) -> Path:
        clockwise = self.motion == 2
        radius_word = line.first("R") if self.fanuc else line.first("CR")
        if radius_word is not None and radius_word.value is not None:
            radius = radius_word.value * self.length_scale
            chord = math.dist(start, end)
            if chord < 1e-9 or abs(radius) < 0.5 * chord - 1e-3:
                raise Problem(f"an arc of radius {abs(radius):g} mm cannot join points {chord:.3f} mm apart")
            height = math.sqrt(max(radius**2 - 0.25 * chord**2, 0.0))
            side = (1.0 if clockwise else -1.0) * math.copysign(1.0, radius)
            dz, dx = (end[0] - start[0]) / chord, (end[1] - start[1]) / chord
            middle = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])
            centre = middle[0] + side * height * dx, middle[1] - side * height * dz
            return Path(start, end, centre, clockwise)
        i, k = line.first("I"), line.first("K")
        if not (i or k):
            raise Problem(f"G{self.motion} needs a centre or a radius: I and K, or {'R' if self.fanuc else 'CR='}")
        if any(word is not None and word.mode == "AC" for word in (i, k)):
            raise Problem("a centre in absolute coordinates, I=AC or K=AC, is not understood")
        dx, dz = ((word.value or 0.0) * self.length_scale if word else 0.0 for word in (i, k))
        centre = start[0] + dz, start[1] + dx
        first, last = math.dist(start, centre), math.dist(end, centre)
        if abs(first - last) > max(0.01, 1e-3 * first):
            raise Problem(f"the arc's radius is {first:.3f} mm at its start, but {last:.3f} mm at its end")
        return Path(start, end, centre, clockwise)

    def _go_home(self, what: str) -> None:
        self.note(f"{what} are not in the program: Z{HOME[0]:g} X{2 * HOME[1]:g} is taken")
        self.add(Path((self.z, self.x), HOME, rapid=True), "rapid")

    def add(self, path: Path, kind: Kind, time: float = 0.0) -> None:
        """Add a move from where the tool stands, and the corner before it."""
        if kind in ("feed", "thread"):
            if path.length < 1e-9:
                return
            if self.feed.value <= 0.0:
                raise Problem("no feed is set: F")
            if self.speed.value <= 0.0:
                raise Problem("no speed is set: S")
        self.z, self.x = path.end
        if kind == "rapid" and path.length < 1e-9:
            return
        if self.corner and kind == "feed":
            corner, before, self.corner = self.corner, self.moves[-1], None
            first, between, path = break_corner(before.path, path, corner)
            self.moves[-1:] = [replace(before, path=each) for each in (first, between) if each and each.length > 1e-9]
            if path.length < 1e-9:
                return
        self.end_corner()
        self.moves.append(
            Move(
                *(kind, path, self.line.number, self.line.end, self.tool, self.feed, self.per_revolution, self.speed),
                *(self.constant_cutting_speed, self.max_spindle_speed, self.cycle_pass, time),
            )
        )

    def end_corner(self) -> None:
        """Name a chamfer or a radius that no move at feed follows."""
        if self.corner and not self.corner.modal:
            self.problems.setdefault(self.corner.line, "after a chamfer or a radius, a move at feed must follow")
        self.corner = None

    # Cycles, reference points and calls.

    def _cycle_or_reference(self, codes: set[float], line: Line, lines: Sequence[Line], index: int) -> int:
        """Return the index of the line that follows; the present one if the block holds none of these."""
        if codes & ({28, 30} if self.fanuc else {74, 75}):
            self._go_home("reference points")
        elif self.fanuc and codes & FANUC_CYCLES:
            return fanuc_cycle(self, codes, line, lines, index)
        elif (call := line.first("CYCLE95")) is not None:
            cycle95(self, call.arguments or (), lines)
        elif (call := line.first("CYCLE97")) is not None:
            cycle97(self, call.arguments or ())
        elif not codes & ({50, 92} if self.fanuc else {25, 26}):
            return index
        return index + 1

    def parts(self) -> str:
        """Return the names of the sub-programs."""
        return ", ".join(list(self.program.parts)[1:]) or "none"

    def _calls(self, line: Line, words: Sequence[Word]) -> int | None:
        codes = {word.value for word in words if word.address in ("M", "M1")}
        if codes & {2, 30}:
            raise _End
        if 99 in codes or 17 in codes or any(word.address == "RET" for word in words):
            if self.calls == 0 and 99 in codes:
                self.note("M99 in the main program repeats it; it is run once")
            return -1
        if self.fanuc and 98 in codes:
            word = line.first("P")
            if word is None:
                raise Problem("M98 needs the sub-program: P")
            digits = word.text.split(".")[0]
            if not digits.isdigit():
                raise Problem(f"P{word.text} is no sub-program")
            count, name = (int(digits[:-4]), digits[-4:]) if len(digits) > 4 else (self._count(line, "L"), digits)
            self._call(str(int(name)), count)
        elif not self.fanuc:
            for word in words:
                name = f"L{word.text}" if word.address == "L" else word.address
                if word.address == "L" or (word.value is None and not word.text and name in self.program.parts):
                    self._call(name, self._count(line, "P"))
        return None

    def go_deeper(self) -> None:
        """Count a call of lines, which must end."""
        if self.calls >= MAX_CALLS:
            raise NcError(f"line {self.line.number}: sub-programs or contours call each other more than {MAX_CALLS} deep")
        self.calls += 1

    def _count(self, line: Line, address: str) -> int:
        count = line.number_of(address)
        return 1 if count is None else int(count)

    def _call(self, name: str, count: int) -> None:
        if name not in self.program.parts or name == self.program.main:
            raise Problem(f"the sub-program {name} is not in this file; its sub-programs are {self.parts()}")
        if not 0 < count <= 9999:
            raise Problem(f"a sub-program is called {count} times, but must be called 1 to 9999 times")
        line = self.line
        self.go_deeper()
        for _ in range(count):
            self.run_lines(self.program.parts[name])
        self.calls -= 1
        self.line = line


def _is_variable(word: Word) -> bool:
    return re.fullmatch(r"#\d+|R\d+", word.address) is not None
