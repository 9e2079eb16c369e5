"""Run a part program as a control does: from lines to the moves of the tool, with the feed and the speed in force.

Positions are Z and X, X as a radius. An error names lines that are not understood; nothing is skipped silently.
"""

import contextlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from turning_nc.cycles import (
    CycleState,
    Side,
    box_cycle,
    cycle95,
    cycle97,
    end_of_contour,
    fanuc_cycle,
)
from turning_nc.dialects import DIAMETERS, NOT_READ
from turning_nc.law import Law
from turning_nc.modal import HOME, Modal, Setting, within_reach
from turning_nc.paths import MAX_RADIUS, Corner, Path, Point, arc_of_radius, break_corner
from turning_nc.places import Places
from turning_nc.words import Line, NcError, PartProgram, Problem, Word, at_lines, evaluated

MAX_BLOCKS, MAX_CALLS = 100_000, 8
MAX_NAMED = 20  # largest number of lines that an error names

Kind = Literal["rapid", "feed", "thread", "dwell"]


@dataclass(frozen=True)
class Move:
    """A move of the tool, or a dwell."""

    kind: Kind
    path: Path
    line: (
        int  # line of the file whose block moves the tool; for a pass of a cycle, that of the cycle
    )
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
    compensation: int = (
        0  # 41 or 42 if the nose radius is compensated to the left or to the right; 0 if not
    )
    finishes: int = 0  # line of the roughing cycle whose contour the move finishes; 0 if none


@dataclass(frozen=True)
class Reading:
    """Choices of the user in reading a program."""

    go_on: bool = (
        False  # whether words that are not understood are left out, and named in the notes
    )
    unit: str | None = None  # mm or inch, if the program states none
    steps: bool = (
        False  # whether numbers without a decimal point count steps of 0.001 mm or 0.0001 inch
    )
    radius: bool = False  # whether X is a radius, if the program does not state it
    sides: Mapping[int, str] = field(default_factory=dict)
    """Sides that roughing cycles turn, outside or inside, by their lines; by default those that a control takes."""


@dataclass(frozen=True)
class Moves:
    """The moves of a program."""

    program: PartProgram
    reading: Reading
    moves: tuple[Move, ...]
    law: Law  # its synchronized actions
    notes: tuple[
        str, ...
    ]  # assumptions, and words that are not understood but do not change the tool's path, with lines
    states_unit: bool  # whether the program or the caller states the unit
    sides: dict[int, Side]  # sides that roughing cycles turn, by their lines
    large_numbers: dict[
        int, float
    ]  # largest coordinates that look like steps but are read as mm or inch, by lines


class _End(Exception):
    """The program's end."""


class _Return(Exception):
    """The end of a sub-program."""


_MOTIONS = {0, 1, 2, 3, 32, 33}
_PLACES = {"X", "Z", "U", "W"}
_PARAMETERS = {
    "I",
    "K",
    "R",
    "P",
    "Q",
    "D",
    "L",
    "A",
    "CR",
    "ANG",
    ",A",
    ",C",
    ",R",
    "CHR",
    "CHF",
    "RND",
}
"""Words that say how a block moves, beside its coordinates."""
NULL_NOTE = "words of Y, V, C, B or A that are 0 have no effect in turning"
_NULL_AXES = {
    "Y",
    "V",
    "C",
    "B",
    "A",
}  # of mill-turn machines; at 0 they do not change how a tool turns


def run(program: PartProgram, reading: Reading = Reading()) -> Moves:
    """Return the moves of a program.

    Raises:
        NcError: blocks are not understood, and are not left out; names each with its line.
    """
    control = Control(
        program,
        unit=reading.unit,
        steps=reading.steps,
        radius=reading.radius,
        given_sides=reading.sides,
        go_on=reading.go_on,
    )
    with contextlib.suppress(_End):
        control.run_lines(program.parts[program.main])
    control.end_corner()
    if unused := reading.sides.keys() - control.sides.keys():
        raise NcError(
            f"--side is given for {at_lines(unused)}, which holds no G71 or CYCLE95 along Z"
        )
    if control.problems and not reading.go_on:
        raise NcError(f"not understood{control.tried}:\n  " + "\n  ".join(_listed(control)))
    if not any(move.kind in ("feed", "thread") for move in control.moves):
        left_out = at_lines(line for line, _ in control.problems)
        beside = f" beside what is left out: {left_out}" if control.problems else ""
        raise NcError(f"the program has no feed move, such as G1{beside}")
    for (line, where), reasons in control.problems.items():
        for reason in reasons:
            note = f"left out: {reason} {where}".rstrip()
            control.notes.setdefault(note, []).append(line)
    named = tuple(
        f"{at_lines(lines)}: {note}"
        for note, lines in sorted(control.notes.items(), key=lambda item: min(item[1]))
    )
    stated = control.states_unit or reading.unit is not None
    return Moves(
        program,
        reading,
        tuple(control.moves),
        control.law,
        named,
        stated,
        control.sides,
        control.large_numbers,
    )


def _listed(control: "Control") -> list[str]:
    """Return what is not understood as text, a line of the program each."""
    listed = []
    for (line, where), reasons in sorted(control.problems.items()):
        listed.append(f"line {line}: {'; '.join(reasons)} {where}".rstrip())
    if len(listed) > MAX_NAMED:
        listed[MAX_NAMED:] = [f"and {len(listed) - MAX_NAMED} more lines"]
    return listed


@dataclass
class Control(Modal):
    """A control that runs blocks."""

    moves: list[Move] = field(default_factory=list)
    has_moved: bool = False  # whether a move is no dwell
    law: Law = field(default_factory=Law)
    problems: dict[tuple[int, str], list[str]] = field(default_factory=dict)
    """Why words are not understood, by their line and its text."""
    variables: dict[str, float] = field(default_factory=dict)
    given_sides: Mapping[int, str] = field(default_factory=dict)
    go_on: bool = False
    sides: dict[int, Side] = field(default_factory=dict)
    corner: Corner | None = None  # between the last move and the next
    rounding: float = 0.0  # radius of all corners between moves at feed, RNDM [mm]
    compensation: int = 0
    finishes: int = 0
    cycle: CycleState = field(default_factory=CycleState)
    cycle_pass: int = 0
    calls: int = 0
    blocks: list[int] = field(default_factory=lambda: [0])  # number of blocks run, also in contours
    places_of_parts: dict[int, Places] = field(
        default_factory=dict
    )  # by the identity of a part's lines

    def run_lines(self, lines: Sequence[Line], start: int = 0, end: int | None = None) -> None:
        """Run lines from an index to another; a cycle names the index at which the program goes on."""
        index = start
        while index < (len(lines) if end is None else end):
            self.line = line = lines[index]
            self.blocks[0] += 1
            if max(len(self.moves), self.blocks[0]) > MAX_BLOCKS:
                raise NcError(
                    f"line {line.number}: more than {MAX_BLOCKS} moves or blocks are run; are calls repeated?"
                )
            follows = None
            with self.naming_problems():
                try:
                    follows = self._jump(line, lines, index) if line.flow else None
                    if follows is None:
                        follows = self._block(line, lines, index)
                except _Return:
                    return
            index = index + 1 if follows is None else follows

    @contextlib.contextmanager
    def naming_problems(self) -> Iterator[None]:
        """Keep what is not understood in the present line, and go on after it."""
        line = self.line
        try:
            yield
        except Problem as problem:
            self.line = line
            self.refuse(problem)

    def refuse(self, problem: Problem) -> None:
        """Keep a problem of the present line, or of the line that it names."""
        line = self.line
        elsewhere = problem.line not in (None, line.number)
        where = f"(contour of line {line.number})" if elsewhere else f"(in {line.text[:60]!r})"
        reasons = self.problems.setdefault((problem.line or line.number, where), [])
        if str(problem) not in reasons:
            reasons.append(str(problem))

    @contextlib.contextmanager
    def deeper(self) -> Iterator[None]:
        """Run other lines within a block, such as a sub-program's, and come back to it.

        Raises:
            NcError: lines call each other too deep.
        """
        line = self.line
        if self.calls >= MAX_CALLS:
            raise NcError(
                f"line {line.number}: sub-programs or contours call each other more than {MAX_CALLS} deep"
            )
        self.calls += 1
        try:
            yield
        finally:
            self.calls -= 1
            self.line = line

    def _jump(self, line: Line, lines: Sequence[Line], index: int) -> int | None:
        """Return the index of the line that follows a jump, a loop or a false condition; None if the block is run."""
        assert line.flow is not None
        word, condition, jump, target, then = (
            line.flow[name] for name in ("word", "condition", "jump", "target", "then")
        )
        true = condition is None or bool(evaluated(condition, self.variables))
        places = self.places(lines)
        if jump in ("END", "ENDWHILE"):
            return places.begin_of_loop(index)
        if word == "WHILE" or jump == "DO":
            end = places.end_of_loop(index)
            return index + 1 if true else end + 1
        if not jump:
            if not then:
                raise Problem("IF is understood with a jump to a block alone, such as GOTO")
            return None if true else index + 1
        if not true:
            return index + 1
        ahead = self._target_of_jump(places, target, index + 1, len(lines))
        before = self._target_of_jump(places, target, 0, index + 1)
        found = {"GOTOF": ahead, "GOTOB": before}.get(jump, before if ahead is None else ahead)
        if found is None:
            raise Problem(f"the block {target} is not in this part of the program")
        return found

    def places(self, lines: Sequence[Line]) -> Places:
        """Return where a part of the program has its blocks, labels and loops."""
        if id(lines) not in self.places_of_parts:
            self.places_of_parts[id(lines)] = Places(lines)
        return self.places_of_parts[id(lines)]

    def _target_of_jump(
        self, places: Places, target: str | None, first: int, end: int
    ) -> int | None:
        """Return the first of some lines that has a label, or on a Fanuc also the number of a block."""
        found = [places.label(target, first, end)]
        if self.fanuc:
            found.append(places.block(float(target or 0), first, end))
        return min((index for index in found if index is not None), default=None)

    # One block.

    def _block(self, line: Line, lines: Sequence[Line], index: int) -> int:
        """Run a block; return the index of the next.

        Words that are not understood are named; all others act.
        """
        self.cycle_pass = 0
        for piece in line.unknown:
            hint = ": the decimal sign is a point" if re.search(r"\d,\d", piece) else ""
            self.refuse(Problem(f"{piece[:40]!r} is no word{hint}"))
        line = self._without_variables(line)
        if line.text.startswith("/"):
            self.note("the block with / is run")
        if any(word.address in ("ID", "FCTDEF") or word.address[0] == "$" for word in line.words):
            self.law.add(re.sub(r"^/?\s*N\d+\s*", "", line.text))
            self.note("synchronized actions are not played: the override is taken as 100 %")
            return index + 1
        # G28 V0 alone moves an axis that does not turn, but G28 alone moves X and Z.
        other_axes = line.first(*_NULL_AXES, "H") and not line.first(*_PLACES)
        line = self._one_motion(self._known(line))
        box = None
        with self.naming_problems():
            box = self.box_cycle(line.codes, line)
        codes = line.codes
        if box is not None:
            self.motion = box
            codes = codes - self.dialect.boxes.keys()
        line = self._meaningful(line, codes)
        self._set_modes(line, codes)
        dwell = self._dwell_word(line) if 4 in codes else None
        if 4 in codes:
            line = self._beside_dwell(line, codes, dwell)
        with self.naming_problems():
            self.set_feed(line, codes)
        with self.naming_problems():
            self.set_speed(line, codes)
        self.set_tool(line)
        if 4 in codes:
            with self.naming_problems():
                self._dwell(dwell)
        follows = index + 1
        with self.naming_problems():
            if box is not None:
                box_cycle(self, box, line)
            elif codes & self.dialect.cycles.keys():
                follows = end_of_contour(
                    self, line, lines, index
                )  # in case that the cycle is left out
                follows = fanuc_cycle(self, codes, line, lines, index)
            elif not (codes & self.dialect.references and other_axes):
                self._run(codes, line, lines)
        self._calls(line)
        return follows

    def _set_modes(self, line: Line, codes: set[float]) -> None:
        """Set the modes that a block states: units, coordinates, kind of feed, diameters, compensation."""
        self.set_units_and_modes(codes)
        for word in line.words:
            if word.address in DIAMETERS:
                self.diameter = word.address
        if 40 in codes:
            self.compensation = 0
        for side in codes & {41, 42}:
            self.compensation = int(side)
            self.note(
                "the tool's tip follows the contour, as with a nose radius that the control compensates"
            )

    def _run(self, codes: set[float], line: Line, lines: Sequence[Line]) -> None:
        """Run a block's move, its cycle of SINUMERIK or its shift of the zero point."""
        if line.first("TRANS", "ATRANS"):
            if self.has_moved:
                raise Problem("TRANS after the first move is not understood")
            self.note("TRANS before the first move is taken as part of the zero offset")
        elif codes & self.dialect.references:
            if self.fanuc:
                self.go_rapidly(self.target(line))  # on the way
            self._go_home("reference points", line)
        elif (call := line.first("CYCLE95")) is not None:
            cycle95(self, call.arguments or (), lines)
        elif (call := line.first("CYCLE97")) is not None:
            cycle97(self, call.arguments or ())
        elif not codes & self.dialect.spindle_limits:
            self._move(codes, line)

    # The words of a block that are understood.

    def _without_variables(self, line: Line) -> Line:
        """Return the line with computed values, and without the variables that it sets."""
        if not any(word.expression or word.is_variable for word in line.words):
            return line
        words = []
        for word in line.words:
            with self.naming_problems():
                words.append(word.with_value(self.variables))
        self.variables |= {
            word.address: word.value
            for word in words
            if word.is_variable and word.value is not None
        }
        return replace(line, words=tuple(word for word in words if not word.is_variable))

    def _is_null(self, word: Word) -> bool:
        """Return whether a word is 0 and belongs to an axis that turning does not use, such as Y0 or C0."""
        return (
            word.value == 0.0
            and word.address in _NULL_AXES
            and word.address not in self.dialect.addresses
        )

    def _known(self, line: Line) -> Line:
        """Return the line without labels, null words, and words that the dialect does not have."""
        others = self._words_of_others(line)
        words = []
        for word in line.words:
            if word.address.endswith(":") or word in others:
                continue
            if self._is_null(word):
                self.note(NULL_NOTE)
                continue
            reason = self._unknown(word, line)
            if reason:
                self.refuse(Problem(reason))
            else:
                words.append(word)
        if others:
            names = [f"{word.address}{word.text}" for word in others]
            went = (
                f", so {' and '.join(names)} are left out" if self.go_on and len(names) > 1 else ""
            )
            functions = [
                word.value for word in others if word.address == "G" and word.value is not None
            ]
            self.refuse(Problem(f"G{min(functions):g} is not understood{went}"))
        return line if len(words) == len(line.words) else replace(line, words=tuple(words))

    def _words_of_others(self, line: Line) -> list[Word]:
        """Return G functions that are not understood but take the coordinates of their block, and the words they take."""
        unread = self.dialect.takes_coordinates - self.dialect.codes
        functions = [word for word in line.words if word.address == "G" and word.value in unread]
        understood = _MOTIONS | self.dialect.references | self.dialect.cycles.keys()
        if not functions or line.codes & understood:
            return []
        belong = _PLACES | _PARAMETERS
        if any(word.address == "M" and word.value == 98 for word in line.words):
            belong = belong - {"P", "L"}
        return [word for word in line.words if word in functions or word.address in belong]

    def _unknown(self, word: Word, line: Line) -> str:
        """Return why the dialect does not have a word; empty if it does."""
        name = word.address
        if word.fault:
            return word.fault
        if word.value is None and not word.text:  # a call or a name
            if name in self.dialect.names or name in self.program.parts:
                return ""
            return f"{name}{'()' if word.arguments is not None else ''} is not understood{NOT_READ.get(name, '')}"
        if name not in self.dialect.addresses:
            equals = "=" if name[1:].isalnum() else ""
            corner = self.fanuc and name == "C" and line.first(*_PLACES)
            hint = "; write ,C for a chamfer between moves" if corner else ""
            return f"the address {name}{equals} is not understood{hint}"
        if name == "G" and word.value is not None and word.value not in self.dialect.codes:
            return f"G{word.value:g} is not understood"
        return ""

    def _one_motion(self, line: Line) -> Line:
        """Return the line without its move if it states several kinds of moves."""
        motions = line.codes & _MOTIONS
        if len(motions) < 2:
            return line
        self.refuse(
            Problem(f"{' and '.join(f'G{code:g}' for code in sorted(motions))} exclude each other")
        )
        words = []
        for word in line.words:
            moves = word.address in _PLACES | _PARAMETERS or (
                word.address == "G" and word.value in motions
            )
            if not moves:
                words.append(word)
        return line if len(words) == len(line.words) else replace(line, words=tuple(words))

    def _meaningful(self, line: Line, codes: set[float]) -> Line:
        """Return the line without words that have no meaning in it."""
        used = self._used(line, codes)
        words = []
        for word in line.words:
            if word.address not in {*"IKRPQDLA", "CR"} - used or word.value is None:
                words.append(word)
            elif word.address == "A" and word.value == 0.0:
                self.note(NULL_NOTE)
            else:
                corner = "; write ,R for a radius between moves" if word.address == "R" else ""
                self.refuse(
                    Problem(f"{word.address}{word.text} has no meaning in this block{corner}")
                )
        return line if len(words) == len(line.words) else replace(line, words=tuple(words))

    def _used(self, line: Line, codes: set[float]) -> set[str]:
        """Return the addresses, of those that only some blocks use, that a block uses."""
        motion = min(codes & _MOTIONS, default=self.motion)
        used: set[str] = set()
        if motion in (2, 3):
            used = {"I", "K", self.dialect.arc_radius}
        elif motion in (32, 33):
            used = {"I", "K", "Q"}
        if not self.fanuc:
            calls = any(
                word.address == "L" or word.address in self.program.parts for word in line.words
            )
            return used | ({"D", "L", "P"} if calls else {"D", "L"})
        function = self.function(codes)
        if function:
            used |= {"P", "Q", "D", "R"}
            if function >= 73:
                used |= {"I", "K"}
        elif motion in (90, 92, 94):
            used = {"R"}
        if function == 76 or sum(word.address in _PLACES for word in line.words) == 1:
            used |= {"A"}
        if any(word.address == "M" and word.value == 98 for word in line.words):
            used |= {"P", "L"}
        elif codes & {4, 30, 64, 103}:
            used |= {"P"}
        elif 96 in codes:
            used |= {"D"}
        return used

    # Dwells.

    def _dwell_word(self, line: Line) -> Word | None:
        """Return the word that holds the time of G4: the first after G4 that can, else the last before it."""
        addresses = {"X", "U", "P"} if self.fanuc else {"F", "S"}
        place = next(
            index
            for index, word in enumerate(line.words)
            if word.address == "G" and word.value == 4.0
        )
        for word in (*line.words[place:], *reversed(line.words[:place])):
            if word.address in addresses and word.value is not None:
                return word
        return None

    def _beside_dwell(self, line: Line, codes: set[float], dwell: Word | None) -> Line:
        """Return the line without the word of its dwell, and without coordinates that have no meaning beside it."""
        moves = self.fanuc and dwell is not None and dwell.address == "P" and bool(codes & _MOTIONS)
        words = []
        for word in line.words:
            if word is dwell:
                continue
            if word.address in _PLACES and not moves:
                self.refuse(Problem(f"{word.address}{word.text} has no meaning beside G4"))
                continue
            words.append(word)
        return line if len(words) == len(line.words) else replace(line, words=tuple(words))

    def _dwell(self, word: Word | None) -> None:
        """Let the tool stand for the time that a word gives."""
        if word is None or word.value is None:
            raise Problem(f"G4 needs its time: {'X, U or P' if self.fanuc else 'F or S'}")
        seconds = word.value
        if word.address == "S":
            seconds *= 60.0 / self.spindle_speed()
        elif word.address == "P" and self.linuxcnc:
            self.note("P of G4 is in seconds, as in LinuxCNC")
        elif "." not in word.text and (
            word.address == "P" or (self.steps and word.address in ("X", "U"))
        ):
            seconds /= 1000.0
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
        if not (
            line.first("X", "Z", "U", "W")
            or (self.motion in (2, 3) and motions and line.first("I", "K"))
        ):
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
            path = (
                self._arc(line, end)
                if self.motion in (2, 3)
                else Path(self.here, end, rapid=self.motion == 0)
            )
            self.add(path, "rapid" if self.motion == 0 else "feed")
        if self.moves and self.moves[-1].path.end == end:
            self.corner = self._corner(line)

    @contextlib.contextmanager
    def thread_feed(self, lead: float) -> Iterator[None]:
        """Move with the lead of a thread, in the program's units per revolution."""
        self.note("the load of threads is not computed")
        kept = self.feed, self.per_revolution
        self.feed, self.per_revolution = Setting(lead * self.length_scale), True
        try:
            yield
        finally:
            self.feed, self.per_revolution = kept

    def _corner(self, line: Line) -> Corner | None:
        word = line.first(*self.dialect.corners)
        if word is not None and word.value:
            if self.motion != 1 or word.value < 0.0:
                raise Problem(
                    "a chamfer or a radius needs a size above 0, and straight moves at feed, G1"
                )
            size = self.in_units(word) * self.length_scale
            return Corner(self.dialect.corners[word.address], size, line.number)
        modal = self.rounding > 0.0 and self.motion in (1, 2, 3)
        return Corner("radius", self.rounding, line.number, modal=True) if modal else None

    def _arc(self, line: Line, end: Point) -> Path:
        start, clockwise = self.here, self.motion == 2
        radius = line.first(self.dialect.arc_radius)
        if radius is not None and radius.value is not None:
            return arc_of_radius(start, end, self.in_units(radius) * self.length_scale, clockwise)
        i, k = line.first("I"), line.first("K")
        if not (i or k):
            if self.fanuc and not line.codes & {2, 3}:
                self.note(
                    f"G{self.motion} holds, but without centre or radius: it moves straight, as on a Fanuc; is G1 missing?"
                )
                return Path(start, end)
            raise Problem(
                f"G{self.motion} needs a centre or a radius: I and K, or {'R' if self.fanuc else 'CR='}"
            )
        if any(word is not None and word.mode == "AC" for word in (i, k)):
            raise Problem("a centre in absolute coordinates, I=AC or K=AC, is not understood")
        dx = self.in_units(i) * self.length_scale if i else 0.0
        dz = self.in_units(k) * self.length_scale if k else 0.0
        centre = start[0] + dz, start[1] + dx
        first, last = math.dist(start, centre), math.dist(end, centre)
        if first > MAX_RADIUS:
            raise Problem(
                f"an arc of radius {first:g} mm is larger than {MAX_RADIUS:g} mm: is it straight?"
            )
        if abs(first - last) > max(0.01, 1e-3 * first):
            hint = self._hint_at_radius(start, end, (dz, dx))
            raise Problem(
                f"the arc's radius is {first:.3f} mm at its start, but {last:.3f} mm at its end{hint}"
            )
        return Path(start, end, centre, clockwise)

    def _hint_at_radius(self, start: Point, end: Point, to_centre: Point) -> str:
        """Return a hint if an arc closes with X read the other way, as a radius or as a diameter."""
        as_diameter = self.diameter == "DIAMON"
        factor = 2.0 if as_diameter else 0.5
        begin = start[0], factor * start[1]
        centre = begin[0] + to_centre[0], begin[1] + to_centre[1]
        first = math.dist(begin, centre)
        last = math.dist((end[0], factor * end[1]), centre)
        if abs(first - last) > max(0.01, 1e-3 * first):
            return ""
        if as_diameter:
            return "; with X as a radius it closes: is the machine set so, --radius?"
        return "; with X as a diameter it closes: is X a radius here?"

    def _go_home(self, what: str, line: Line) -> None:
        self.note(f"{what} are not in the program: Z{HOME[0]:g} X{2 * HOME[1]:g} is taken")
        z, x = (line.first(*addresses) is not None for addresses in ("ZW", "XU"))
        self.go_rapidly((HOME[0] if z or not x else self.z, HOME[1] if x or not z else self.x))

    def go_rapidly(self, *points: Point) -> None:
        """Add rapid moves to points."""
        for point in points:
            self.add(Path(self.here, point, rapid=True), "rapid")

    def add(self, path: Path, kind: Kind, time: float = 0.0) -> None:
        """Add a move from the tool's position, and the corner before it.

        Raises:
            Problem: the move has no feed or no speed, or leaves ``MAX_REACH``.
            NcError: the program makes too many moves.
        """
        if len(self.moves) >= MAX_BLOCKS:
            raise NcError(
                f"line {self.line.number}: more than {MAX_BLOCKS} moves are made; are calls or passes repeated?"
            )
        within_reach(path.end)
        if kind in ("feed", "thread"):
            if path.length < 1e-9:
                return
            for setting, problem in (
                (self.feed, "no feed is set: F"),
                (self.speed, "no speed is set: S"),
            ):
                if setting.value <= 0.0 and (
                    self.go_on or not self.problems
                ):  # else a line that is not understood may set it
                    raise Problem(problem)
        self.z, self.x = path.end
        if kind == "rapid" and path.length < 1e-9:
            return
        if self.corner and kind == "feed":
            corner, before, self.corner = self.corner, self.moves[-1], None
            first, between, path = break_corner(before.path, path, corner)
            self.moves[-1:] = [
                replace(before, path=each)
                for each in (first, between)
                if each and each.length > 1e-9
            ]
            if path.length < 1e-9:
                return
        self.end_corner()
        self.has_moved = self.has_moved or kind != "dwell"
        self.moves.append(
            Move(
                kind=kind,
                path=path,
                line=self.line.number,
                line_end=self.line.end,
                tool=self.tool,
                feed=self.feed,
                per_revolution=self.per_revolution,
                speed=self.speed,
                constant_cutting_speed=self.constant_cutting_speed,
                max_spindle_speed=self.max_spindle_speed,
                spindle_on=self.spindle_on,
                cycle_pass=self.cycle_pass,
                time=time,
                compensation=0 if self.cycle_pass else self.compensation,
                finishes=self.finishes,
            )
        )

    def end_corner(self) -> None:
        """Name a chamfer or a radius that no move at feed follows."""
        if self.corner and not self.corner.modal:
            self.problems[self.corner.line, ""] = [
                "after a chamfer or a radius, a move at feed must follow"
            ]
        self.corner = None

    # Calls.

    def _calls(self, line: Line) -> None:
        words = line.words
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
                if word.address == "L" or (
                    word.value is None and not word.text and name in self.program.parts
                ):
                    self._call(name, line.number_of("P"))

    def _call(self, name: str, times: float | None) -> None:
        count = 1 if times is None else int(times)
        if name not in self.program.parts or name == self.program.main:
            raise Problem(
                f"the sub-program {name} is not in this file; its sub-programs are {self.program.sub_programs}"
            )
        if not 0 < count <= 9999:
            raise Problem(
                f"a sub-program is called {count} times, but must be called 1 to 9999 times"
            )
        with self.deeper():
            for _ in range(count):
                self.run_lines(self.program.parts[name])
