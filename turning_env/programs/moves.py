"""Run a part program as a control does: from blocks to the moves of the tool, with the feed and the speed in force.

Positions are Z and X, X as a radius. What is not understood is named with its line; nothing is skipped silently.
"""

import contextlib
import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from turning_env.programs.blocks import Line, PartProgram, Word
from turning_env.programs.program import NcError
from turning_env.programs.roughing import Path, Point, Roughing, passes

MAX_MOVES, MAX_BLOCKS, MAX_CALLS = 100_000, 200_000, 8
MAX_NAMED = 20
"""Largest number of lines that an error names."""
HOME: Point = (200.0, 200.0)
"""Where the tool stands before the first move and at reference points [mm] (assumption)."""
INCH, FOOT = 25.4, 0.3048
RETRACTION_CYCLE95 = 1.0
"""Lift-off distance of CYCLE95 without its last argument [mm]."""

Kind = Literal["rapid", "feed", "thread", "dwell"]


@dataclass(frozen=True)
class Setting:
    """A feed or a speed in force."""

    value: float = 0.0
    """[mm/rev], [mm/min], [m/min] or [rev/min]."""
    span: tuple[int, int] | None = None
    """Place of the number in the program's text."""
    scale: float = 1.0
    """Its value in these units over the number as written."""


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


class _Problem(ValueError):
    """A block that is not understood."""


class _End(Exception):
    """The program's end."""


_IGNORED_G = {
    "fanuc": {18, 22, 23, 25, 26, 40, 49, *range(54, 60), 61, 64, 67, 69, 80},
    "sinumerik": {9, 18, 40, 60, 64, 290, 450, 451, 500, *range(54, 58), *range(505, 600), *range(601, 604), *range(641, 646)},
}
"""G functions without effect on the path or on times."""
_IGNORED_M = {*range(0, 2), *range(3, 10), *range(40, 46)}
_IGNORED_NAMES = {"SOFT", "BRISK", "DRIVE", "FFWON", "FFWOF", "CFC", "CFTCP", "CFIN", "COMPOF", "STOPRE", "NORM", "KONT", "G"}
_IGNORED_CALLS = {"MSG", "SETMS", "WORKPIECE"}
_WORDS = {
    "fanuc": set("NGMTSFXZUWIKRPQDLH"),
    "sinumerik": {*"NGMTSFXZIKDLP", "CR", "LIMS", "RNDM", "S1", "M1", "T1"},
}


def run(program: PartProgram, go_on: bool = False) -> Moves:
    """Return the moves of a program.

    Args:
        program: the program's lines.
        go_on: leave out blocks that are not understood, and name them in the notes, instead of refusing the program.

    Raises:
        NcError: blocks are not understood; names each with its line.
    """
    control = _Control(program)
    control.run_program()
    if control.problems and not go_on:
        listed = [f"line {line}: {reason}" for line, reason in sorted(control.problems.items())]
        more = [f"and {len(listed) - MAX_NAMED} more lines"] if len(listed) > MAX_NAMED else []
        raise NcError("not understood:\n  " + "\n  ".join(listed[:MAX_NAMED] + more))
    notes = control.notes | {line: f"left out: {reason}" for line, reason in control.problems.items()}
    if not any(move.kind == "feed" for move in control.moves):
        raise NcError("the program has no feed move, such as G1")
    return Moves(program, tuple(control.moves), tuple(f"line {line}: {note}" for line, note in sorted(notes.items())))


@dataclass
class _Control:
    """The modal state of a control."""

    program: PartProgram
    moves: list[Move] = field(default_factory=list)
    notes: dict[int, str] = field(default_factory=dict)
    problems: dict[int, str] = field(default_factory=dict)
    z: float = HOME[0]
    x: float = HOME[1]
    motion: int | None = None
    absolute: bool = True
    diameter: str = "on"
    length_scale: float = 1.0
    feed_scale: float = 1.0
    speed_scale: float = 1.0
    per_revolution: bool = True
    feed: Setting = Setting()
    constant_cutting_speed: bool = False
    speed: Setting = Setting()
    max_spindle_speed: float = math.inf
    tool: str = "T0"
    depth: float = 0.0
    retraction: float = 0.5
    calls: int = 0
    whole_noted: bool = False
    radius_noted: bool = False
    blocks: list[int] = field(default_factory=lambda: [0])
    """Number of blocks run, also in contours."""
    cycle_pass: int = 0
    line: Line = field(default_factory=lambda: Line(0, "", (), 0))

    @property
    def fanuc(self) -> bool:
        return self.program.dialect == "fanuc"

    def run_program(self) -> None:
        with contextlib.suppress(_End):
            self._run(self.program.parts[self.program.main])

    def _run(self, lines: Sequence[Line], start: int = 0, end: int | None = None) -> None:
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
                follows = self._block(line, lines, index)
            except _Problem as problem:
                self.problems.setdefault(line.number, f"{problem} (in {line.text[:60]!r})")
                follows = None
            if follows == -1:  # the end of a sub-program
                return
            index = index + 1 if follows is None else follows

    def _note(self, text: str) -> None:
        self.notes.setdefault(self.line.number, text)

    # One block.

    def _block(self, line: Line, lines: Sequence[Line], index: int) -> int | None:
        if line.unknown:
            raise _Problem(f"{line.unknown[:40]!r} is no word")
        if line.text.startswith("/"):
            self._note("the block with / is run")
        words = [word for word in line.words if not word.address.endswith(":")]
        codes = self._codes(words)
        self._names(words)
        self._units_and_modes(codes)
        if self._dwell(codes, line):
            return None
        self._feed_and_speed(line, codes)
        self._tool(line)
        follows = self._cycle_or_reference(codes, line, lines, index)
        if follows == index:
            self._motion(codes, line)
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
                raise _Problem(f"the address {word.address}{'=' if len(word.address) > 1 else ''} is not understood")
        for code in sorted(codes - self._understood()):
            raise _Problem(f"G{code:g} is not understood")
        if codes & {41, 42} and not self.radius_noted:
            self.radius_noted = True
            self._note("the tool's tip follows the contour, as with a nose radius that the control compensates")
        motions = codes & {0, 1, 2, 3, 32, 33}
        if len(motions) > 1:
            raise _Problem(f"{' and '.join(f'G{code:g}' for code in sorted(motions))} exclude each other")
        return codes

    def _understood(self) -> set[float]:
        common = {0, 1, 2, 3, 4, 33, 41, 42, 53, 90, 91, 94, 95, 96, 97}
        own = {7, 8, 20, 21, 28, 30, 32, 50, 70, 71, 72, 92, 98, 99} if self.fanuc else {25, 26, 70, 71, 74, 75, 700, 710}
        return common | own | _IGNORED_G[self.program.dialect]

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
                or name in ("CYCLE95", "RET")
                or name in self.program.parts
            ):
                raise _Problem(f"{name}{'()' if word.arguments is not None else ''} is not understood")

    def _units_and_modes(self, codes: set[float]) -> None:
        inch, metric = ({20}, {21}) if self.fanuc else ({70, 700}, {71, 710})
        if codes & (inch | metric) and (self.fanuc or not self.line.first("CYCLE95")):
            self.length_scale = INCH if codes & inch else 1.0
            if self.fanuc or codes & {700, 710}:
                self.feed_scale = self.length_scale
                self.speed_scale = FOOT if codes & inch else 1.0
        if self.fanuc and codes & {7, 8}:
            self.diameter = "on" if 7 in codes else "off"
        ambiguous = self.fanuc and not codes & {0, 1, 2, 3, 32, 33} and self.line.first("X", "Z", "U", "W")
        for code in codes & {90, 91, 92, 94}:
            if ambiguous:
                raise _Problem(f"G{code:g} with coordinates but without G0 or G1 is a cycle on some controls")
        if codes & {90, 91}:
            self.absolute = 90 in codes
        if codes & {94, 95, 98, 99}:
            per_revolution = bool(codes & {95, 99})
            if per_revolution != self.per_revolution:
                self.feed = Setting()
            self.per_revolution = per_revolution
            if not self.fanuc and self.constant_cutting_speed:  # one group with G96
                self.constant_cutting_speed, self.speed = False, Setting()

    def _dwell(self, codes: set[float], line: Line) -> bool:
        if 4 not in codes:
            return False
        if self.fanuc:
            word = line.first("X", "U", "P")
            if word is None or word.value is None:
                raise _Problem("G4 needs its time: X, U or P")
            seconds = word.value / 1000.0 if word.address == "P" and "." not in word.text else word.value
        elif (word := line.first("F")) and word.value is not None:
            seconds = word.value
        elif (word := line.first("S")) and word.value is not None:
            speed = self._spindle_speed()
            seconds = 60.0 * word.value / speed
        else:
            raise _Problem("G4 needs its time: F or S")
        if seconds < 0.0:
            raise _Problem(f"the dwell is {seconds:g} s, but must not be below 0")
        here = Path((self.z, self.x), (self.z, self.x))
        self._add(here, "dwell", seconds)
        return True

    def _feed_and_speed(self, line: Line, codes: set[float]) -> None:
        word = line.first("F")
        if word is not None and word.value is not None:
            if word.value < 0:
                raise _Problem(f"F{word.text} is negative")
            feed = Setting(word.value * self.feed_scale, word.span, self.feed_scale)
            if not (33 in codes or 32 in codes):
                self.feed = feed
        limits = codes & ({50, 92} if self.fanuc else {25, 26})
        spindle = line.first("S", "S1")
        lims = line.number_of("LIMS") or (line.number_of("D") if self.fanuc and 96 in codes else None)
        if limits and spindle is not None and spindle.value is not None and not line.first("X", "Z", "U", "W"):
            if 25 not in codes:
                lims = spindle.value
            spindle = None
        elif limits:
            raise _Problem(f"G{min(limits):g} is understood as a limit of the spindle alone: G{min(limits):g} S...")
        if lims is not None:
            if lims <= 0:
                raise _Problem(f"the limit of the spindle speed is {lims:g}, but must be above 0")
            self.max_spindle_speed = lims
        if codes & {96, 97}:
            constant = 96 in codes
            if constant != self.constant_cutting_speed:
                kept = self.speed.value > 0.0 and not constant  # G97 alone keeps the spindle at its present speed
                self.speed = Setting(self._spindle_speed()) if kept else Setting()
            self.constant_cutting_speed = constant
            if not self.fanuc and constant and not self.per_revolution:
                self.per_revolution, self.feed = True, Setting()
        if spindle is not None and spindle.value is not None:
            if spindle.value < 0:
                raise _Problem(f"S{spindle.text} is negative")
            scale = self.speed_scale if self.constant_cutting_speed else 1.0
            self.speed = Setting(spindle.value * scale, spindle.span, scale)

    def _tool(self, line: Line) -> None:
        word = line.first("T", "T1")
        cancels = word is not None and self.fanuc and len(word.text) >= 3 and word.text.endswith("00")  # the offset, not the tool
        if word is not None and not (cancels and self.tool.startswith(f"T{word.text[:-2]}")):
            self.tool = word.text if word.value is None else f"T{word.text}"
        for word in line.words:
            if word.address in ("M", "M1") and word.value is not None:
                self._machine_function(word.value)

    def _machine_function(self, code: float) -> None:
        if code not in _IGNORED_M and code not in (2, 17, 30, 98, 99):
            self._note(f"M{code:g} is not understood; it is taken as without effect on the path")

    # Moves.

    def _scaled_x(self, value: float, incremental: bool) -> float:
        halved = self.diameter == "on" or (self.diameter == "90" and not incremental)
        return value * self.length_scale * (0.5 if halved else 1.0)

    def _unit(self) -> str:
        return "mm" if self.length_scale == 1.0 else "inch"

    def _target(self, line: Line) -> Point:
        z, x = self.z, self.x
        for word in line.words:
            if word.value is None or word.address not in ("X", "Z", "U", "W"):
                continue
            if self.fanuc and "." not in word.text and word.value and not self.whole_noted:
                self.whole_noted = True
                self._note(
                    f"{word.address}{word.text} has no decimal point: whole numbers are read as {self._unit()}, not as 0.001"
                )
            incremental = word.address in ("U", "W") or (not self.absolute and word.mode != "AC") or word.mode == "IC"
            if word.address in ("X", "U"):
                x = self._scaled_x(word.value, incremental) + (x if incremental else 0.0)
            else:
                z = word.value * self.length_scale + (z if incremental else 0.0)
        return z, x

    def _motion(self, codes: set[float], line: Line) -> None:
        motions = codes & {0, 1, 2, 3, 32, 33}
        if motions:
            self.motion = int(min(motions))
        if not (line.first("X", "Z", "U", "W") or (self.motion in (2, 3) and motions and line.first("I", "K"))):
            return
        if 53 in codes or line.first("SUPA"):
            self._go_home("machine coordinates")
            return
        if self.motion is None:
            raise _Problem("coordinates stand before the first G0 or G1")
        start, end = (self.z, self.x), self._target(line)
        path = self._arc(line, start, end) if self.motion in (2, 3) else Path(start, end, rapid=self.motion == 0)
        if self.motion in (32, 33):
            lead = line.first("F", "K") if self.fanuc else line.first("K", "I")
            if lead is None or not lead.value:
                raise _Problem(f"G{self.motion} needs its lead: {'F' if self.fanuc else 'K'}")
            self._note("a thread's load is not computed")
            kept = self.feed, self.per_revolution
            self.feed, self.per_revolution = Setting(lead.value * self.length_scale), True
            self._add(path, "thread")
            self.feed, self.per_revolution = kept
        else:
            self._add(path, "rapid" if self.motion == 0 else "feed")

    def _arc(self, line: Line, start: Point, end: Point) -> Path:
        clockwise = self.motion == 2
        radius_word = line.first("R") if self.fanuc else line.first("CR")
        if radius_word is not None and radius_word.value is not None:
            radius = radius_word.value * self.length_scale
            chord = math.dist(start, end)
            if chord < 1e-9 or abs(radius) < 0.5 * chord - 1e-3:
                raise _Problem(f"an arc of radius {abs(radius):g} mm cannot join points {chord:.3f} mm apart")
            height = math.sqrt(max(radius**2 - 0.25 * chord**2, 0.0))
            side = (1.0 if clockwise else -1.0) * math.copysign(1.0, radius)
            dz, dx = (end[0] - start[0]) / chord, (end[1] - start[1]) / chord
            middle = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])
            centre = middle[0] + side * height * dx, middle[1] - side * height * dz
            return Path(start, end, centre, clockwise)
        i, k = line.first("I"), line.first("K")
        if not (i or k):
            raise _Problem(f"G{self.motion} needs a centre or a radius: I and K, or {'R' if self.fanuc else 'CR='}")
        if any(word is not None and word.mode == "AC" for word in (i, k)):
            raise _Problem("a centre in absolute coordinates, I=AC or K=AC, is not understood")
        dx, dz = ((word.value or 0.0) * self.length_scale if word else 0.0 for word in (i, k))
        centre = start[0] + dz, start[1] + dx
        first, last = math.dist(start, centre), math.dist(end, centre)
        if abs(first - last) > max(0.01, 1e-3 * first):
            raise _Problem(f"the arc's radius is {first:.3f} mm at its start, but {last:.3f} mm at its end")
        return Path(start, end, centre, clockwise)

    def _go_home(self, what: str) -> None:
        self._note(f"{what} are not in the program: Z{HOME[0]:g} X{2 * HOME[1]:g} is taken")
        self._add(Path((self.z, self.x), HOME, rapid=True), "rapid")

    def _add(self, path: Path, kind: Kind, time: float = 0.0) -> None:
        if kind in ("feed", "thread"):
            if path.length < 1e-9:
                return
            if self.feed.value <= 0.0:
                raise _Problem("no feed is set: F")
            if self.speed.value <= 0.0:
                raise _Problem("no speed is set: S")
        self.z, self.x = path.end
        if kind == "rapid" and path.length < 1e-9:
            return
        self.moves.append(
            Move(
                *(kind, path, self.line.number, self.line.end, self.tool, self.feed, self.per_revolution, self.speed),
                *(self.constant_cutting_speed, self.max_spindle_speed, self.cycle_pass, time),
            )
        )

    def _spindle_speed(self) -> float:
        if self.speed.value <= 0.0:
            raise _Problem("no speed is set: S")
        if not self.constant_cutting_speed:
            return self.speed.value
        return min(1000.0 * self.speed.value / (2.0 * math.pi * max(abs(self.x), 1e-6)), self.max_spindle_speed)

    # Cycles, reference points and calls.

    def _cycle_or_reference(self, codes: set[float], line: Line, lines: Sequence[Line], index: int) -> int:
        """Return the index of the line that follows; the present one if the block holds none of these."""
        if codes & ({28, 30} if self.fanuc else {74, 75}):
            self._go_home("reference points")
        elif self.fanuc and codes & {70, 71, 72}:
            return self._fanuc_cycle(codes, line, lines, index)
        elif (call := line.first("CYCLE95")) is not None:
            self._cycle95(call.arguments or (), lines)
        elif not codes & ({50, 92} if self.fanuc else {25, 26}):
            return index
        return index + 1

    def _fanuc_cycle(self, codes: set[float], line: Line, lines: Sequence[Line], index: int) -> int:
        facing = 72 in codes
        first, last = line.number_of("P"), line.number_of("Q")
        depth = line.first("D" if line.first("P") else "W" if facing else "U")
        if depth is not None and depth.value is not None and 70 not in codes:
            fine = depth.address == "D" and "." not in depth.text
            if fine:
                self._note(f"D{depth.text} without a decimal point is read as {depth.value / 1000.0:g} mm")
            self.depth = depth.value * (0.001 if fine else 1.0) * self.length_scale
        if first is None or last is None:
            if 70 in codes or depth is None:
                code = f"G{min(codes & {70, 71, 72}):g}"
                other = "" if 72 in codes else f"; in SINUMERIK programs {code} is a unit: --dialect sinumerik"
                raise _Problem(f"{code} needs the first and last block of the contour: P and Q{other}")
            if (retraction := line.number_of("R")) is not None:
                self.retraction = retraction * self.length_scale
            return index + 1
        begins = next((k for k in range(index + 1, len(lines)) if lines[k].number_of("N") == first), None)
        if 70 in codes and begins is None:
            begins = next((k for k in range(index) if lines[k].number_of("N") == first), None)
        ends = None if begins is None else next((k for k in range(begins, len(lines)) if lines[k].number_of("N") == last), None)
        if begins is None or ends is None:
            raise _Problem(f"the contour from N{first:g} to N{last:g} is not in the program")
        start = self.z, self.x
        if 70 in codes:
            self._finish(lines, begins, ends + 1, start)
            return max(index, ends) + 1
        if self.depth <= 0.0:
            raise _Problem(
                f"G{72 if facing else 71} needs the depth of its passes: a block before it with {'W' if facing else 'U'}"
            )
        contour = self._contour(lines, begins, ends + 1)
        u, w = line.number_of("U") or 0.0, line.number_of("W") or 0.0
        told = Roughing(self.depth, self.retraction, (w * self.length_scale, self._scaled_x(u, True)), facing)
        self._rough(contour, start, told)
        return ends + 1

    def _contour(self, lines: Sequence[Line], first: int, last: int) -> list[Path]:
        """Return the moves of contour blocks, without the one that leads to the contour."""
        inner = copy.copy(self)
        inner._go_deeper()
        inner.moves, inner.cycle_pass = [], 0
        inner.feed = Setting(inner.feed.value or 1.0)
        inner.speed = Setting(inner.speed.value or 1.0)
        inner._run(lines, first, last)
        paths = [move.path for move in inner.moves if move.kind in ("rapid", "feed")]
        if len(paths) < 2:
            raise _Problem("the contour has no moves after the one that leads to it")
        return [Path(path.start, path.end, path.centre, path.clockwise) for path in paths[1:]]

    def _rough(self, contour: Sequence[Path], start: Point, told: Roughing) -> None:
        try:
            made = passes(contour, start, told)
        except ValueError as error:
            raise _Problem(str(error)) from error
        for number, paths in enumerate(made, 1):
            self.cycle_pass = number
            for path in paths:
                self._add(path, "rapid" if path.rapid else "feed")
        self.cycle_pass = 0

    def _finish(self, lines: Sequence[Line], first: int, last: int, start: Point) -> None:
        line = self.line
        kept = self.feed, self.motion
        self._go_deeper()
        self._run(lines, first, last)
        self.calls -= 1
        self.line = line
        self.feed, self.motion = kept
        self._add(Path((self.z, self.x), start, rapid=True), "rapid")

    def _cycle95(self, arguments: Sequence[tuple[str, tuple[int, int]]], lines: Sequence[Line]) -> None:
        def number(index: int, default: float = 0.0) -> float:
            text = arguments[index][0] if index < len(arguments) else ""
            if not text:
                return default
            try:
                return float(text)
            except ValueError:
                raise _Problem(f"argument {index + 1} of CYCLE95 is {text!r}, but must be a number") from None

        def feed(index: int) -> Setting:
            value = number(index)
            return Setting(value * self.feed_scale, arguments[index][1], self.feed_scale) if value > 0 else self.feed

        if not arguments:
            raise _Problem('CYCLE95 needs its arguments: ("contour", depth, ...)')
        variant = int(number(8, 1.0))
        if not 1 <= variant <= 12:
            raise _Problem(f"the kind of machining of CYCLE95 is {variant}, but must be 1 to 12")
        facing, inside = variant % 2 == 0, (variant - 1) % 4 >= 2
        found, first, last = self._contour_lines(arguments[0][0].strip('"'), lines)
        contour = self._contour(found, first, last)
        away = number(11, RETRACTION_CYCLE95) * self.length_scale
        side = -1.0 if inside else 1.0
        both = number(4)
        allowance = (number(2) + both) * self.length_scale, side * (number(3) + both) * self.length_scale
        before = self.z, self.x
        head = contour[0].start
        start = (head[0] + allowance[0] + away, contour[-1].end[1] + allowance[1] + side * away)
        if facing:
            start = (contour[-1].end[0] + allowance[0] + away, head[1] + allowance[1] + side * away)
        kept = self.feed
        if variant not in (5, 6, 7, 8):
            self.feed = feed(5)
            self._add(Path(before, start, rapid=True), "rapid")
            depth = number(1) * self.length_scale
            self._rough(contour, start, Roughing(depth, away, allowance, facing, equal=True))
        if variant >= 5:
            self.feed = feed(7)
            self._add(Path((self.z, self.x), start, rapid=True), "rapid")
            lead = (start[0], head[1]) if not facing else (head[0], start[1])
            self._add(Path(start, lead, rapid=True), "rapid")
            self._add(Path(lead, head), "feed")
            for path in contour:
                self._add(path, "feed")
            end = contour[-1].end
            clear = (end[0], start[1]) if not facing else (start[0], end[1])
            for point in (clear, start):
                self._add(Path((self.z, self.x), point, rapid=True), "rapid")
        self.feed = kept

    def _contour_lines(self, name: str, lines: Sequence[Line]) -> tuple[Sequence[Line], int, int]:
        if ":" in name:
            labels = [label.strip() for label in name.upper().split(":")]
            places = [next((k for k, line in enumerate(lines) if line.first(f"{label}:")), None) for label in labels]
            if len(places) != 2 or places[0] is None or places[1] is None or places[1] <= places[0]:
                raise _Problem(f"the labels of the contour {name!r} are not in the program")
            return lines, places[0], places[1] + 1
        found = self.program.parts.get(name.upper())
        if found is None:
            raise _Problem(f"the contour {name!r} is not in this file; its sub-programs are {self._parts()}")
        return found, 0, len(found)

    def _parts(self) -> str:
        return ", ".join(list(self.program.parts)[1:]) or "none"

    def _calls(self, line: Line, words: Sequence[Word]) -> int | None:
        codes = {word.value for word in words if word.address in ("M", "M1")}
        if codes & {2, 30}:
            raise _End
        if 99 in codes or 17 in codes or any(word.address == "RET" for word in words):
            if self.calls == 0 and 99 in codes:
                self._note("M99 in the main program repeats it; it is run once")
            return -1
        if self.fanuc and 98 in codes:
            word = line.first("P")
            if word is None:
                raise _Problem("M98 needs the sub-program: P")
            digits = word.text.split(".")[0]
            if not digits.isdigit():
                raise _Problem(f"P{word.text} is no sub-program")
            count, name = (int(digits[:-4]), digits[-4:]) if len(digits) > 4 else (self._count(line, "L"), digits)
            self._call(str(int(name)), count)
        elif not self.fanuc:
            for word in words:
                name = f"L{word.text}" if word.address == "L" else word.address
                if word.address == "L" or (word.value is None and not word.text and name in self.program.parts):
                    self._call(name, self._count(line, "P"))
        return None

    def _go_deeper(self) -> None:
        if self.calls >= MAX_CALLS:
            raise NcError(f"line {self.line.number}: sub-programs or contours call each other more than {MAX_CALLS} deep")
        self.calls += 1

    def _count(self, line: Line, address: str) -> int:
        count = line.number_of(address)
        return 1 if count is None else int(count)

    def _call(self, name: str, count: int) -> None:
        if name not in self.program.parts or name == self.program.main:
            raise _Problem(f"the sub-program {name} is not in this file; its sub-programs are {self._parts()}")
        if not 0 < count <= 9999:
            raise _Problem(f"a sub-program is called {count} times, but must be called 1 to 9999 times")
        line = self.line
        self._go_deeper()
        for _ in range(count):
            self._run(self.program.parts[name])
        self.calls -= 1
        self.line = line
