"""Run a part program as a control does: from lines to the moves of the tool, with the feed and the speed in force.

Positions are Z and X, X as a radius. An error names lines that are not understood; nothing is skipped silently.
"""

import contextlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from turning_nc.cycles import CycleState, Side, box_cycle, cycle95, cycle97, fanuc_cycle
from turning_nc.law import Law
from turning_nc.modal import HOME, Modal, Setting
from turning_nc.paths import Corner, Path, Point, arc_of_radius, break_corner
from turning_nc.words import Line, NcError, PartProgram, Problem, Word, at_lines, evaluated

MAX_BLOCKS, MAX_CALLS = 100_000, 8
MAX_NAMED = 20  # largest number of lines that an error names

Kind = Literal["rapid", "feed", "thread", "dwell"]


@dataclass(frozen=True)
class Move:
    """A move of the tool, or a dwell."""

    kind: Kind
    path: Path
    line: int  # line of the file whose block moves the tool; for a pass of a cycle, that of the cycle
    line_end: int  # place in the text after this line's last word
    tool: str
    feed: Setting
    per_revolution: bool
    speed: Setting
    constant_cutting_speed: bool
    max_spindle_speed: float  # [rev/min]; infinite if the program sets none
    spindle_on: bool
    cycle_pass: int = 0  # number of the pass within a cycle, from 1; 0 outside
    time: float = 0.0  # duration of a dwell [s]


@dataclass(frozen=True)
class Reading:
    """Choices of the user in reading a program."""

    go_on: bool = False  # whether blocks that are not understood are left out, and named in the notes
    unit: str | None = None  # mm or inch, if the program states none
    sides: Mapping[int, str] = field(default_factory=dict)
    """Sides that roughing cycles turn, outside or inside, by their lines; by default those that a control takes."""


@dataclass(frozen=True)
class Moves:
    """The moves of a program."""

    program: PartProgram
    reading: Reading
    moves: tuple[Move, ...]
    law: Law  # its synchronized actions
    notes: tuple[str, ...]  # assumptions, and words that are not understood but do not change the tool's path, with lines
    states_unit: bool  # whether the program or the caller states the unit
    sides: dict[int, Side]  # sides that roughing cycles turn, by their lines


class _End(Exception):
    """The program's end."""


class _Return(Exception):
    """The end of a sub-program."""


_MOTIONS = {0, 1, 2, 3, 32, 33}


def run(program: PartProgram, reading: Reading = Reading()) -> Moves:
    """Return the moves of a program.

    Raises:
        NcError: blocks are not understood, and are not left out; names each with its line.
    """
    control = Control(program, reading.unit, given_sides=reading.sides, go_on=reading.go_on)
    with contextlib.suppress(_End):
        control.run_lines(program.parts[program.main])
    control.end_corner()
    if unused := reading.sides.keys() - control.sides.keys():
        raise NcError(f"--side is given for {at_lines(unused)}, which holds no G71 or CYCLE95 along Z")
    if control.problems and not reading.go_on:
        listed = [f"line {line}: {reason}" for line, reason in sorted(control.problems.items())]
        more = [f"and {len(listed) - MAX_NAMED} more lines"] if len(listed) > MAX_NAMED else []
        raise NcError(f"not understood{control.tried}:\n  " + "\n  ".join(listed[:MAX_NAMED] + more))
    if not any(move.kind in ("feed", "thread") for move in control.moves):
        raise NcError("the program has no feed move, such as G1")
    for line, reason in control.problems.items():
        control.notes.setdefault(f"left out: {reason}", []).append(line)
    named = tuple(f"{at_lines(lines)}: {note}" for note, lines in sorted(control.notes.items(), key=lambda item: min(item[1])))
    stated = control.states_unit or reading.unit is not None
    return Moves(program, reading, tuple(control.moves), control.law, named, stated, control.sides)


@dataclass
class Control(Modal):
    """A control that runs blocks."""

    moves: list[Move] = field(default_factory=list)
    law: Law = field(default_factory=Law)
    problems: dict[int, str] = field(default_factory=dict)
    variables: dict[str, float] = field(default_factory=dict)
    given_sides: Mapping[int, str] = field(default_factory=dict)
    go_on: bool = False
    sides: dict[int, Side] = field(default_factory=dict)
    corner: Corner | None = None  # between the last move and the next
    rounding: float = 0.0  # radius of all corners between moves at feed, RNDM [mm]
    cycle: CycleState = field(default_factory=CycleState)
    cycle_pass: int = 0
    calls: int = 0
    blocks: list[int] = field(default_factory=lambda: [0])  # number of blocks run, also in contours

    def run_lines(self, lines: Sequence[Line], start: int = 0, end: int | None = None) -> None:
        """Run lines from an index to another; a cycle names the index at which the program goes on."""
        index = start
        while index < (len(lines) if end is None else end):
            self.line = line = lines[index]
            self.blocks[0] += 1
            if max(len(self.moves), self.blocks[0]) > MAX_BLOCKS:
                raise NcError(f"line {line.number}: more than {MAX_BLOCKS} moves or blocks are run; are calls repeated?")
            try:
                follows = self._jump(line, lines, index) if line.flow else None
                index = self._block(self._without_variables(line), lines, index) if follows is None else follows
            except Problem as problem:
                mine = problem.line in (None, line.number)
                where = f" (in {line.text[:60]!r})" if mine else f" (contour of line {line.number})"
                self.problems.setdefault(problem.line or line.number, f"{problem}{where}")
                index += 1
            except _Return:
                return

    @contextlib.contextmanager
    def deeper(self) -> Iterator[None]:
        """Run other lines within a block, such as a sub-program's, and come back to it.

        Raises:
            NcError: lines call each other too deep.
        """
        line = self.line
        if self.calls >= MAX_CALLS:
            raise NcError(f"line {line.number}: sub-programs or contours call each other more than {MAX_CALLS} deep")
        self.calls += 1
        yield
        self.calls -= 1
        self.line = line

    def _jump(self, line: Line, lines: Sequence[Line], index: int) -> int | None:
        """Return the index of the line that follows a jump, a loop or a false condition; None if the block is run."""
        assert line.flow is not None
        word, condition, jump, target, then = (line.flow[name] for name in ("word", "condition", "jump", "target", "then"))
        true = condition is None or bool(evaluated(condition, self.variables))
        if word == "WHILE" or jump in ("DO", "END", "ENDWHILE"):
            ends = "END" in (jump or "")
            return index + 1 if true and not ends else _other_end(lines, index, -1 if ends else 1)
        if not jump:
            if not then:
                raise Problem("IF is understood with a jump to a block alone, such as GOTO")
            return None if true else index + 1
        if not true:
            return index + 1
        ahead, before = range(index + 1, len(lines)), range(index + 1)
        places: list[int] = [*(ahead if jump != "GOTOB" else ()), *(before if jump != "GOTOF" else ())]
        for place in places:
            if lines[place].first(f"{target}:") or (self.fanuc and lines[place].number_of("N") == float(target or 0)):
                return place
        raise Problem(f"the block {target} is not in this part of the program")

    # One block.

    def _without_variables(self, line: Line) -> Line:
        """Return the line with computed values, and without the variables that it sets."""
        if not any(word.expression or word.is_variable for word in line.words):
            return line
        words = [word.with_value(self.variables) for word in line.words]
        self.variables |= {word.address: word.value for word in words if word.is_variable and word.value is not None}
        return replace(line, words=tuple(word for word in words if not word.is_variable))

    def _block(self, line: Line, lines: Sequence[Line], index: int) -> int:
        """Run a block; return the index of the next."""
        for piece in line.unknown:
            hint = ": the decimal sign is a point" if re.search(r"\d,\d", piece) else ""
            raise Problem(f"{piece[:40]!r} is no word{hint}")
        if line.text.startswith("/"):
            self.note("the block with / is run")
        if any(word.address in ("ID", "FCTDEF") or word.address[0] == "$" for word in line.words):
            self.law.add(re.sub(r"^/?\s*N\d+\s*", "", line.text))
            self.note("synchronized actions are not played: the override is taken as 100 %")
            return index + 1
        words = [word for word in line.words if not word.address.endswith(":")]
        codes = self._codes(words)
        if (box := self.box_cycle(codes, line)) is not None:
            self.motion, codes = box, codes - {box}
        self._check_use(words, codes)
        self.set_units_and_modes(codes)
        if 4 in codes:
            self._dwell(line)
            return index + 1
        self.set_feed_and_speed(line, codes)
        self.set_tool(line)
        follows = index + 1
        if line.first("TRANS", "ATRANS"):
            if any(move.path.length for move in self.moves):
                raise Problem("TRANS after the first move is not understood")
            self.note("TRANS before the first move is taken as part of the zero offset")
        elif codes & self.dialect.references:
            if self.fanuc:
                self.go_rapidly(self.target(line))  # on the way
            self._go_home("reference points", line)
        elif box is not None:
            box_cycle(self, box, line)
        elif codes & self.dialect.cycles:
            follows = fanuc_cycle(self, codes, line, lines, index)
        elif (call := line.first("CYCLE95")) is not None:
            cycle95(self, call.arguments or (), lines)
        elif (call := line.first("CYCLE97")) is not None:
            cycle97(self, call.arguments or ())
        elif not codes & self.dialect.spindle_limits:
            self._move(codes, line)
        self._calls(line, words)
        return follows

    def _codes(self, words: Sequence[Word]) -> set[float]:
        """Return the block's G functions; refuse words that the dialect does not have."""
        codes = {word.value for word in words if word.address == "G" and word.value is not None}
        for word in words:
            name = word.address
            if word.value is not None or word.text:
                if name not in self.dialect.addresses:
                    raise Problem(f"the address {name}{'=' if name[1:].isalnum() else ''} is not understood")
            elif name not in self.dialect.names and name not in self.program.parts:
                raise Problem(f"{name}{'()' if word.arguments is not None else ''} is not understood")
            elif name.startswith("DIAM"):
                self.diameter = name
        for code in sorted(codes - self.dialect.codes):
            raise Problem(f"G{code:g} is not understood")
        if codes & {41, 42}:
            self.note("the tool's tip follows the contour, as with a nose radius that the control compensates")
        if len(codes & _MOTIONS) > 1:
            raise Problem(f"{' and '.join(f'G{code:g}' for code in sorted(codes & _MOTIONS))} exclude each other")
        return codes

    def _check_use(self, words: Sequence[Word], codes: set[float]) -> None:
        """Refuse words that have no meaning in their block."""
        motion = min(codes & _MOTIONS, default=self.motion)
        used = {"I", "K", self.dialect.arc_radius} if motion in (2, 3) else {*"IKQ"} if motion in (32, 33) else set()
        if self.fanuc:
            if codes & self.dialect.cycles:
                used |= {*"PQDRIK"} if codes & {73, 74, 75, 76, 81, 82, 83, 84} else {*"PQDR"}
            elif motion in (90, 92, 94):
                used = {"R"}
            if 76 in codes or sum(word.address in ("X", "Z", "U", "W") for word in words) == 1:
                used |= {"A"}
            calls = any(word.address == "M" and word.value == 98 for word in words)
            used |= {*"PL"} if calls else {"P"} if codes & {4, 30, 64, 103} else {"D"} if 96 in codes else set()
        else:
            calls = any(word.address == "L" or word.address in self.program.parts for word in words)
            used |= {*"DLP"} if calls else {*"DL"}
        for word in words:
            if word.address in {*"IKRPQDLA", "CR"} - used and word.value is not None:
                corner = "; write ,R for a radius between moves" if word.address == "R" else ""
                raise Problem(f"{word.address}{word.text} has no meaning in this block{corner}")

    def _dwell(self, line: Line) -> None:
        words = [word for word in line.words if word.address in ({*"XUP"} if self.fanuc else {*"FS"}) and word.value is not None]
        if not words:
            raise Problem(f"G4 needs its time: {'X, U or P' if self.fanuc else 'F or S'}")
        word, seconds = words[0], words[0].value or 0.0
        if word.address == "P" and "." not in word.text:
            seconds /= 1000.0
        elif word.address == "S":
            seconds *= 60.0 / self.spindle_speed()
        if seconds < 0.0:
            raise Problem(f"the dwell is {seconds:g} s, but must not be below 0")
        self.add(Path(self.here, self.here), "dwell", seconds)

    # Moves.

    def _move(self, codes: set[float], line: Line) -> None:
        motions = codes & _MOTIONS
        self.motion = int(min(motions)) if motions else self.motion
        rounding = line.number_of("RNDM")
        if rounding is not None:
            self.rounding = rounding * self.length_scale
        if not (line.first("X", "Z", "U", "W") or (self.motion in (2, 3) and motions and line.first("I", "K"))):
            if line.first(*self.dialect.corners):
                raise Problem("a chamfer or a radius needs a move to its corner in the same block")
            return
        if 53 in codes or line.first("SUPA"):
            self._go_home("machine coordinates", line)
            return
        end = self.target(line)
        if self.motion is None and end != self.here:
            raise Problem("coordinates precede the first G0 or G1")
        if self.motion in (32, 33):
            lead = line.number_of(*self.dialect.thread_lead)
            if not lead and self.fanuc and self.feed.span is None:  # that of a block before it
                lead = self.feed.value / self.length_scale
            if not lead:
                raise Problem(f"G{self.motion} needs its lead: {self.dialect.thread_lead[0]}")
            with self.thread_feed(lead):
                self.add(Path(self.here, end), "thread")
        else:
            path = self._arc(line, end) if self.motion in (2, 3) else Path(self.here, end, rapid=self.motion == 0)
            self.add(path, "rapid" if self.motion == 0 else "feed")
        if self.moves and self.moves[-1].path.end == end:
            self.corner = self._corner(line)

    @contextlib.contextmanager
    def thread_feed(self, lead: float) -> Iterator[None]:
        """Move with the lead of a thread, in the program's units per revolution."""
        self.note("the load of threads is not computed")
        kept = self.feed, self.per_revolution
        self.feed, self.per_revolution = Setting(lead * self.length_scale), True
        yield
        self.feed, self.per_revolution = kept

    def _corner(self, line: Line) -> Corner | None:
        word = line.first(*self.dialect.corners)
        if word is not None and word.value:
            if self.motion != 1 or word.value < 0.0:
                raise Problem("a chamfer or a radius needs a size above 0, and straight moves at feed, G1")
            return Corner(self.dialect.corners[word.address], word.value * self.length_scale, line.number)
        modal = self.rounding > 0.0 and self.motion in (1, 2, 3)
        return Corner("radius", self.rounding, line.number, modal=True) if modal else None

    def _arc(self, line: Line, end: Point) -> Path:
        start, clockwise = self.here, self.motion == 2
        if (radius := line.number_of(self.dialect.arc_radius)) is not None:
            return arc_of_radius(start, end, radius * self.length_scale, clockwise)
        i, k = line.first("I"), line.first("K")
        if not (i or k):
            if self.fanuc and not line.codes & {2, 3}:
                self.note(f"G{self.motion} holds, but without centre or radius: it moves straight, as on a Fanuc; is G1 missing?")
                return Path(start, end)
            raise Problem(f"G{self.motion} needs a centre or a radius: I and K, or {'R' if self.fanuc else 'CR='}")
        if any(word is not None and word.mode == "AC" for word in (i, k)):
            raise Problem("a centre in absolute coordinates, I=AC or K=AC, is not understood")
        dx, dz = ((word.value or 0.0) * self.length_scale if word else 0.0 for word in (i, k))
        centre = start[0] + dz, start[1] + dx
        first, last = math.dist(start, centre), math.dist(end, centre)
        if abs(first - last) > max(0.01, 1e-3 * first):
            raise Problem(f"the arc's radius is {first:.3f} mm at its start, but {last:.3f} mm at its end")
        return Path(start, end, centre, clockwise)

    def _go_home(self, what: str, line: Line) -> None:
        self.note(f"{what} are not in the program: Z{HOME[0]:g} X{2 * HOME[1]:g} is taken")
        z, x = (line.first(*addresses) is not None for addresses in ("ZW", "XU"))
        self.go_rapidly((HOME[0] if z or not x else self.z, HOME[1] if x or not z else self.x))

    def go_rapidly(self, *points: Point) -> None:
        """Add rapid moves to points."""
        for point in points:
            self.add(Path(self.here, point, rapid=True), "rapid")

    def add(self, path: Path, kind: Kind, time: float = 0.0) -> None:
        """Add a move from the tool's position, and the corner before it."""
        if kind in ("feed", "thread"):
            if path.length < 1e-9:
                return
            for setting, problem in ((self.feed, "no feed is set: F"), (self.speed, "no speed is set: S")):
                if setting.value <= 0.0 and (self.go_on or not self.problems):  # else a line that is not understood may set it
                    raise Problem(problem)
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
                *(self.constant_cutting_speed, self.max_spindle_speed, self.spindle_on, self.cycle_pass, time),
            )
        )

    def end_corner(self) -> None:
        """Name a chamfer or a radius that no move at feed follows."""
        if self.corner and not self.corner.modal:
            self.problems.setdefault(self.corner.line, "after a chamfer or a radius, a move at feed must follow")
        self.corner = None

    # Calls.

    def _calls(self, line: Line, words: Sequence[Word]) -> None:
        codes = {word.value for word in words if word.address in ("M", "M1")}
        if codes & {2, 30}:
            raise _End
        if 99 in codes or 17 in codes or any(word.address == "RET" for word in words):
            if self.calls == 0 and 99 in codes:
                self.note("M99 in the main program repeats it; it is run once")
            raise _Return
        if self.fanuc and 98 in codes:
            word = line.first("P")
            if word is None:
                raise Problem("M98 needs the sub-program: P")
            digits = word.text.split(".")[0]
            if not digits.isdigit():
                raise Problem(f"P{word.text} is no sub-program")
            times = int(digits[:-4]) if len(digits) > 4 else line.number_of("L")
            self._call(str(int(digits[-4:] if len(digits) > 4 else digits)), times)
        elif not self.fanuc:
            for word in words:
                name = f"L{word.text}" if word.address == "L" else word.address
                if word.address == "L" or (word.value is None and not word.text and name in self.program.parts):
                    self._call(name, line.number_of("P"))

    def _call(self, name: str, times: float | None) -> None:
        count = 1 if times is None else int(times)
        if name not in self.program.parts or name == self.program.main:
            raise Problem(f"the sub-program {name} is not in this file; its sub-programs are {self.program.sub_programs}")
        if not 0 < count <= 9999:
            raise Problem(f"a sub-program is called {count} times, but must be called 1 to 9999 times")
        with self.deeper():
            for _ in range(count):
                self.run_lines(self.program.parts[name])


def _other_end(lines: Sequence[Line], index: int, step: int) -> int:
    """Return the index of the line after a loop's end, or of its begin (``step`` -1)."""
    depth, mine = 0, lines[index].flow or {}
    for place in range(index, len(lines) if step > 0 else -1, step):
        flow = lines[place].flow or {}
        ends, begins = "END" in (flow.get("jump") or ""), flow.get("word") == "WHILE" or flow.get("jump") == "DO"
        if (ends or begins) and (flow["target"] or "") == (mine["target"] or ""):
            depth += -1 if ends else 1
            if depth == 0:
                return place + (step > 0)
    raise Problem("the loop has no other end")
