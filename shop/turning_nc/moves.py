"""Run a part program as a control does: from lines to the moves of the tool.

Each move has the feed and the speed in force. Positions are Z and X, X as a radius. An error names
lines that are not understood; nothing is skipped silently.
"""

import contextlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from turning_nc.blocks import (
    DWELL,
    NULL_AXES,
    beside_cycle,
    beside_dwell,
    dwell_time,
    dwell_word,
    known_words,
    meaningful_words,
    single_words,
    with_one_mode,
    with_one_motion,
)
from turning_nc.control import MAX_BLOCKS, Control, Kind, Move
from turning_nc.cycles import Side
from turning_nc.cycles_fanuc import Block, end_of_contour, run_box, run_cycle
from turning_nc.cycles_sinumerik import run_cycle95, run_cycle97
from turning_nc.dialects import DIAMETERS, NUMBERED_OFFSETS, STATEMENTS, ZERO_OFFSETS
from turning_nc.interpolation import MOTIONS, move
from turning_nc.modal import COORDINATES
from turning_nc.paths import Path
from turning_nc.places import Places
from turning_nc.words import (
    BlockError,
    Flow,
    Line,
    NcError,
    PartProgram,
    Word,
    at_lines,
    evaluated,
)

__all__ = ["Kind", "Move", "Moves", "ReadingChoices", "run"]

END_OF_DRILLING = 80  # G function of Fanuc
MAX_NAMED = 20  # largest number of lines that an error names
MAX_TIMES = 9999  # how often a sub-program is called at most; P and L of controls have four digits


@dataclass(frozen=True)
class ReadingChoices:
    """Choices of the user in reading a program."""

    # Whether words that are not understood are left out, and named in the notes.
    go_on: bool = False
    unit: str | None = None  # mm or inch, if the program states none

    # Whether numbers without a decimal point count steps of 0.001 mm or 0.0001 inch.
    steps: bool = False
    radius: bool = False  # whether X is a radius, if the program does not state it

    # Sides that roughing cycles turn, outside or inside, by their lines. By default they are
    # those that a control takes.
    sides: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Moves:
    """The moves of a program."""

    program: PartProgram
    reading: ReadingChoices
    moves: tuple[Move, ...]

    # Assumptions, and words that are not understood but do not change the tool's path, with lines.
    notes: tuple[str, ...]
    states_unit: bool  # whether the program or the user states the unit
    in_inches: bool  # whether lengths are in inches at its end
    sides: dict[int, Side]  # sides that roughing cycles turn, by their lines

    # Largest coordinates that look like steps but are read as mm or inch, by lines.
    large_numbers: dict[int, float]


class ProgramEnd(Exception):  # noqa: N818 - it ends the run, but is no error
    """The program's end."""


class PartEnd(Exception):  # noqa: N818 - it ends a part's run, but is no error
    """The end of a sub-program."""


def run(program: PartProgram, reading: ReadingChoices = ReadingChoices()) -> Moves:
    """Return the moves of a program.

    Raises:
        NcError: blocks are not understood, and are not left out; names each with its line.
    """
    control = ProgramControl(
        program,
        unit=reading.unit,
        steps=reading.steps,
        radius=reading.radius,
        given_sides=reading.sides,
        go_on=reading.go_on,
    )
    with contextlib.suppress(ProgramEnd):
        control.run_lines(program.main)
    control.end_corner()
    _note_parts_not_run(control)
    _check(control, reading)
    return Moves(
        program,
        reading,
        moves=tuple(control.moves),
        notes=_notes(control),
        states_unit=control.states_unit or reading.unit is not None,
        in_inches=control.in_inches,
        sides=control.sides,
        large_numbers=control.large_numbers,
    )


def _note_parts_not_run(control: Control) -> None:
    """Note the parts of the file that nothing calls."""
    for name, lines in control.program.parts.items():
        if name not in control.parts_run:
            shown = f"O{name}" if control.fanuc else name
            control.line = lines[0]
            control.note(f"{shown} begins here, but is not called: its blocks are not run")


def _check(control: Control, reading: ReadingChoices) -> None:
    """Check that a program is understood and cuts.

    Raises:
        NcError: it is not, or does not; or a side is given for another line than a cycle's.
    """
    unused = reading.sides.keys() - control.sides.keys()
    if unused:
        raise NcError(
            f"--side is given for {at_lines(unused)}, which holds no G71 or CYCLE95 along Z"
        )
    if control.problems and not reading.go_on:
        raise NcError(f"not understood{control.tried}:\n  " + "\n  ".join(_listed(control)))
    if not any(done.kind in ("feed", "thread") for done in control.moves):
        beside = ""
        if control.problems:
            left_out = at_lines(place.line for place in control.problems)
            beside = f" beside what is left out: {left_out}"
        raise NcError(f"the program has no feed move, such as G1{beside}")


def _listed(control: Control) -> list[str]:
    """Return what is not understood as text, a line of the program each."""
    listed = []
    for place, reasons in sorted(control.problems.items()):
        text = f"line {place.line}: {'; '.join(reasons)} {place.where}"
        listed.append(text.rstrip())
    further = len(listed) - MAX_NAMED
    if further > 0:
        listed[MAX_NAMED:] = [f"and {further} more lines"]
    return listed


def _notes(control: Control) -> tuple[str, ...]:
    """Return the notes, and what is left out, with their lines, in the order of these."""
    notes = control.notes
    for place, reasons in control.problems.items():
        for reason in reasons:
            note = f"left out: {reason} {place.where}".rstrip()
            notes.setdefault(note, []).append(place.line)
    in_order = sorted(notes.items(), key=lambda item: min(item[1]))
    notes_on_lines = [f"{at_lines(lines)}: {note}" for note, lines in in_order]
    return (*control.program.notes, *notes_on_lines)


class ProgramControl(Control):
    """A control that runs the lines of a program."""

    def run_lines(self, part: str, start: int = 0, end: int | None = None) -> None:
        """Run lines of a part from an index to before another.

        Raises:
            NcError: more than ``MAX_BLOCKS`` blocks are run.
        """
        lines = self.program.parts[part]
        self.parts_run.add(part)
        index = start
        while index < (len(lines) if end is None else end):
            line = lines[index]
            self.line = line
            self.block_count.number += 1
            if max(len(self.moves), self.block_count.number) > MAX_BLOCKS:
                raise NcError(
                    f"line {line.number}: more than {MAX_BLOCKS} moves or blocks are run; "
                    "are calls repeated?"
                )
            follows = None
            with self.naming_problems():
                try:
                    follows = self._run_line(Block(line, part, index))
                except PartEnd:
                    return
            index = index + 1 if follows is None else follows

    def _run_line(self, block: Block) -> int:
        """Run a line; return the index of the next."""
        statement = self._unread_statement(block.line)
        if statement:
            self.refuse(f"{statement} is not read: it {STATEMENTS[statement]}")
            return block.index + 1
        if block.line.flow is not None:
            self._refuse_words_before(block.line.flow)
            self._refuse_pieces(block.line)
            follows = self._after_flow(block.line.flow, block)
            # A program that is refused need not repeat its loops, which may not end now.
            repeats = follows is not None and follows <= block.index
            if repeats and self.problems and not self.go_on:
                return block.index + 1
            if follows is not None:
                return follows
        return self._run_block(block)

    def _unread_statement(self, line: Line) -> str:
        """Return the statement of SINUMERIK that a line holds and that is not read, if any."""
        if self.fanuc:
            return ""
        for word in line.words:
            is_place = word.address == "N" or word.address.endswith(":")
            if not is_place:
                is_statement = word.address in STATEMENTS and word.value is None
                return word.address if is_statement else ""
        return ""

    # Jumps and loops.

    def _refuse_words_before(self, flow: Flow) -> None:
        """Name the words of a block before its jump or loop, which controls do not take."""
        before = []
        for word in flow.before:
            if word.address != "N" and not word.address.endswith(":"):
                before.append(f"{word.address}{word.text or word.expression}")
        if before:
            behind = flow.word or flow.jump
            self.refuse(f"{' '.join(before)} before {behind} must be a block of its own")

    def _after_flow(self, flow: Flow, block: Block) -> int | None:
        """Return the index of the line that follows a jump, a loop or a false condition.

        It is None if the rest of the block is run.

        Raises:
            BlockError: the condition has no value, the loop is not whole, the jump has no target,
                or an IF has neither a jump, nor THEN, nor ENDIF.
        """
        places = self.places(block.part)
        following = block.index + 1
        if flow.jump == "ENDFOR":
            return self._after_round(places.begin_of_loop(block.index), block)
        if flow.word == "FOR":
            self.variables[flow.counter] = self._first_count(flow)
        holds = not flow.condition or bool(evaluated(flow.condition, self.variables))
        if flow.jump in ("END", "ENDWHILE"):
            return places.begin_of_loop(block.index)
        # Fanuc begins a loop with WHILE [...] DO or DO alone, SINUMERIK with WHILE or FOR.
        if flow.word in ("WHILE", "FOR") or flow.jump == "DO":
            end = places.end_of_loop(block.index)
            return following if holds else end + 1

        if flow.jump == "ENDIF":
            return following
        # A branch that has been run goes on behind ENDIF.
        if flow.jump == "ELSE":
            return places.end_of_branch(block.index) + 1
        if not flow.jump and not flow.then:
            end = places.end_of_branch(block.index)
            return following if holds else end + 1
        if not holds:
            return following
        if flow.jump:
            return self._target_of_jump(flow, places, following)
        return None

    def _first_count(self, flow: Flow) -> float:
        """Return the first value of a FOR loop's counter."""
        first = evaluated(flow.start, self.variables)
        if first != round(first):
            raise BlockError(f"FOR counts from {first:g}, but must count from a whole number")
        return first

    def _after_round(self, begin: int, block: Block) -> int:
        """Count up a FOR loop at its end; return the index of the line that follows."""
        flow = self.program.parts[block.part][begin].flow
        assert flow is not None
        if flow.counter not in self.variables:
            raise BlockError("the FOR of this loop was not run")
        self.variables[flow.counter] += 1.0
        goes_on = bool(evaluated(flow.condition, self.variables))
        return begin + 1 if goes_on else block.index + 1

    def _target_of_jump(self, flow: Flow, places: Places, following: int) -> int:
        """Return the index of the line to which a block jumps.

        GOTOF of SINUMERIK looks ahead, GOTOB back. GOTO looks ahead first.

        Raises:
            BlockError: the target is not in this part of the program.
        """
        target = None
        if flow.jump != "GOTOB":
            target = self._place_of(flow.target, places, places.lines[following:])
        if target is None and flow.jump != "GOTOF":
            target = self._place_of(flow.target, places, places.lines[:following])
        if target is None:
            raise BlockError(f"the block {flow.target} is not in this part of the program")
        return target

    def _place_of(self, target: str, places: Places, within: range) -> int | None:
        """Return the first of some lines with a label or the number of a block."""
        label = places.label(target, within)
        # SINUMERIK writes a jump to a block with its N, Fanuc without it.
        digits = target
        is_number = self.fanuc
        if not self.fanuc:
            digits = target.removeprefix("N")
            is_number = target.startswith("N")
        if not is_number or not digits.isdigit():
            return label
        number = places.block(float(digits), within)
        if label is None:
            return number
        if number is None:
            return label
        return min(label, number)

    # One block.

    def _run_block(self, block: Block) -> int:
        """Run a block; return the index of the next.

        Words that are not understood are named; all others act.
        """
        self.cycle_pass = 0
        self._refuse_pieces(block.line)
        line = self._without_variables(block.line)
        if line.text.startswith("/"):
            self.note("the block with / is run")
        if any(word.address in ("ID", "FCTDEF") or word.address[0] == "$" for word in line.words):
            self.refuse("synchronized actions and system variables are not read")
            return block.index + 1
        # G28 V0 alone moves an axis that does not turn, but G28 alone moves X and Z.
        other_axes = line.first(*NULL_AXES, "H") and not line.first(*COORDINATES)
        line = known_words(self, single_words(self, line))
        line = with_one_mode(self, with_one_motion(self, line))
        line = beside_cycle(self, line)
        codes = line.codes
        box = None
        with self.naming_problems():
            box = self.box_cycle(codes, line)
        if box is not None:
            # In system A, G90 is a box here, and no mode of coordinates.
            self.motion = box
            codes = codes - self.dialect.boxes.keys()
        line = meaningful_words(self, line, codes)
        self._set_modes(line, codes)
        line = self._set_values(line, codes)
        follows = block.index + 1
        with self.naming_problems():
            block = replace(block, line=line)
            cycle = self.function(codes)
            if box is not None:
                run_box(self, box, line)
            elif cycle:
                # If the cycle is left out, so is its contour.
                follows = end_of_contour(self, block, cycle)
                follows = run_cycle(self, block, cycle)
            elif not (codes & self.dialect.references and other_axes):
                self._move(block, codes)
        self._call_sub_programs(line, block.part)
        return follows

    def _refuse_pieces(self, line: Line) -> None:
        """Name the pieces of a line that are no words."""
        for piece in line.unknown:
            hint = ""
            if re.search(r"\d,\d", piece):
                hint = ": the decimal sign is a point"
            elif not self.fanuc and re.match(r"\w+\[", piece):
                hint = ": an index in brackets is read as a number alone, such as R[1]"
            self.refuse(f"{piece[:40]!r} is no word{hint}")

    def _without_variables(self, line: Line) -> Line:
        """Return the line with computed values, and without the variables that it sets."""
        if not any(word.expression or word.is_variable for word in line.words):
            return line
        words: list[Word] = []
        for word in line.words:
            with self.naming_problems():
                words.append(word.with_value(self.variables))
        # All values of a block are computed before its first variable is set.
        for word in words:
            if word.is_variable and word.value is not None:
                self.variables[word.address] = word.value
        return line.with_words(word for word in words if not word.is_variable)

    def _set_modes(self, line: Line, codes: set[float]) -> None:
        """Set the modes that a block states.

        They are units, coordinates, kind of feed, diameters, zero offsets and compensation.
        """
        self.set_units_and_modes(codes)
        self._note_zero_offsets(line, codes)
        for word in line.words:
            if word.address in DIAMETERS:
                self.diameter = word.address
        if codes & (MOTIONS | {END_OF_DRILLING}):
            self.is_drilling = False
        # G0 holds also beside a function that moves otherwise, such as G28.
        if codes & MOTIONS:
            self.motion = int(min(codes & MOTIONS))
        if 40 in codes:
            self.compensation = 0
        for side in codes & {41, 42}:
            self.compensation = int(side)
            self.note(
                "the tool's tip follows the contour, "
                "as with a nose radius that the control compensates"
            )

    def _note_zero_offsets(self, line: Line, codes: set[float]) -> None:
        """Note that a program changes its zero offset after a move."""
        for code in codes & ZERO_OFFSETS:
            number = line.number_of("P")
            if code in NUMBERED_OFFSETS and number is None:
                self.refuse(f"G{code:g} needs the number of its zero offset: P")
            name = f"G{code:g}" if number is None else f"G{code:g} P{number:g}"
            if self.zero_offset not in ("", name) and self.has_moved:
                self.note(
                    f"{name} after {self.zero_offset}: zero offsets are not in the "
                    "program, so one zero point is taken for all (assumption)"
                )
            self.zero_offset = name

    def _set_values(self, line: Line, codes: set[float]) -> Line:
        """Set feed, speed and tool, and dwell; return the line without its dwell."""
        dwells = DWELL in codes
        dwell = dwell_word(self, line) if dwells else None
        # F or S may be the time of a dwell, and set nothing then.
        if dwells:
            line = beside_dwell(self, line, codes=codes, dwell=dwell)
        with self.naming_problems():
            self.set_feed(line, codes)
        with self.naming_problems():
            self.set_speed(line, codes)
        self.set_tool(line)
        if dwells:
            with self.naming_problems():
                self.add(Path(self.here, self.here), "dwell", time=dwell_time(self, dwell))
        return line

    def _move(self, block: Block, codes: set[float]) -> None:
        """Run a block's move, its cycle of SINUMERIK or its shift of the zero point."""
        line = block.line
        if shift := line.first("TRANS", "ATRANS"):
            self._shift(shift.address, line)
        elif codes & self.dialect.references:
            # G28 of a Fanuc goes by way of its coordinates; G74 of SINUMERIK only names its axes.
            if self.fanuc:
                self.go_rapidly(self.target(line))
            self.go_home("reference points", line)
        elif cycle := line.first("CYCLE95"):
            run_cycle95(self, cycle.arguments or (), block.part)
        elif cycle := line.first("CYCLE97"):
            run_cycle97(self, cycle.arguments or ())
        elif not codes & self.dialect.spindle_limits:
            move(self, line, codes)

    def _shift(self, name: str, line: Line) -> None:
        """Take TRANS or ATRANS as part of the zero offset before the first move.

        Raises:
            BlockError: it shifts along X, or after the first move.
        """
        shifts = any(word.value for word in line.words if word.address in COORDINATES)
        if not shifts and not self.is_shifted:
            self.note(f"{name} without a shift has no effect")
            return
        if self.has_moved:
            raise BlockError(
                f"{name} after the first move is not understood: "
                "write the coordinates from one zero point"
            )
        if line.number_of("X"):
            raise BlockError(f"{name} along X, which would shift the axis, is not understood")
        self.is_shifted = shifts
        self.note(f"{name} before the first move is taken as part of the zero offset")

    # Ends and calls.

    def _call_sub_programs(self, line: Line, part: str) -> None:
        """End the program or the part, or call sub-programs, if the block says so."""
        codes = {word.value for word in line.words if word.address in ("M", "M1")}
        if codes & {2, 30}:
            raise ProgramEnd
        # M99 of Fanuc; M17 and RET of SINUMERIK.
        if (99 if self.fanuc else 17) in codes or line.first("RET"):
            if self.calls == 0 and 99 in codes:
                self.note("M99 in the main program repeats it; it is run once")
            raise PartEnd
        if not self.fanuc:
            self._call_by_name(line)
        elif 98 in codes:
            self._call_by_number(line)
        elif 97 in codes and line.first("P"):
            self._call_block(line, part)

    def _call_by_number(self, line: Line) -> None:
        """Call a sub-program of Fanuc: M98 P0007 L3, or M98 P30007 for three times O7."""
        word = line.first("P")
        if word is None:
            raise BlockError("M98 needs the sub-program: P")
        digits = word.text.split(".")[0]
        if not digits.isdigit():
            raise BlockError(f"P{word.text} is no sub-program")
        repeats: float | None
        if len(digits) > 4:
            name = digits[-4:]
            repeats = int(digits[:-4])
        else:
            name = digits
            repeats = line.number_of("L")
        self._call(str(int(name)), repeats)

    def _call_block(self, line: Line, part: str) -> None:
        """Call a sub-program within this part, as Haas does: M97 P100 L2 runs N100 to M99."""
        number = line.number_of("P") or 0.0
        places = self.places(part)
        first = places.block(number, places.lines)
        if first is None:
            raise BlockError(f"M97 calls N{number:g}, which is not in this part of the program")
        times = self._times(line.number_of("L"))
        with self.deeper():
            for _ in range(times):
                self.run_lines(part, first)

    def _call_by_name(self, line: Line) -> None:
        """Call sub-programs of SINUMERIK: L7 P3, or their names."""
        for word in line.words:
            if word.address == "L":
                self._call(f"L{word.text}", line.number_of("P"))
            elif word.is_call and word.address in self.program.parts:
                self._call(word.address, line.number_of("P"))

    def _call(self, name: str, times: float | None) -> None:
        if name not in self.program.parts or name == self.program.main:
            raise BlockError(
                f"the sub-program {name} is neither in this file nor in one of its name beside it; "
                f"the sub-programs here are {self.program.sub_programs}"
            )
        count = self._times(times)
        with self.deeper():
            for _ in range(count):
                self.run_lines(name)

    def _times(self, times: float | None) -> int:
        """Return how often a sub-program is called."""
        count = 1 if times is None else int(times)
        if not 0 < count <= MAX_TIMES:
            raise BlockError(
                f"a sub-program is called {count} times, but must be called 1 to {MAX_TIMES} times"
            )
        return count
