"""Modal state of a control: units, feed, speed and tool in force, and the tool's position.

It reads the words of a block that set values. Moves and cycles are left to ``control`` and above.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from turning_nc.dialects import DIAMETERS, FANUC, INCH, foreign_sign
from turning_nc.paths import Point
from turning_nc.words import BlockError, Line, PartProgram, Span, Word

from turning_env.numerics.conversions import spindle_speed_at

# Tool position before the first move and at reference points [mm] (assumption).
HOME = Point(z=200.0, x=200.0)
FOOT = 0.3048  # [m]; the cutting speed of programs in inch is in feet per minute

# Largest distance of the tool from the zero point along an axis [mm]; that of a stock's ends, too.
MAX_REACH = 1e5

# Bounds of feeds and speeds, in any unit; a control's are far within.
MIN_RATE = 1e-6
MAX_RATE = 1e6

# Machine functions that do not change the path, or are read elsewhere (ISO 6983 and Fanuc).
_KNOWN_M = {*range(10), 13, 14, 30, *range(40, 46)}
_CALLS_OF_FANUC = {98, 99}
_ENDS_OF_SINUMERIK = {17}
COORDINATES = ("X", "Z", "U", "W")
FEED_MODES_OF_LINUXCNC: Mapping[float, bool] = {94: False, 95: True}
"""G functions of feeds there, and whether these are per revolution."""
_SIZES = frozenset("UWRDIK")  # addresses of lengths in cycles

# Functions of Fanuc whose coordinates are none of a box cycle.
_MOVING = frozenset({0, 1, 2, 3, 4, 28, 30, 32, 33, 53})

# Least increments of a control, in units of the program (Fanuc's IS-B).
STEP_MM = 0.001
STEP_INCH = 0.0001
MIN_LARGE = 1000.0  # coordinate without a decimal point from which it looks like steps

# Whole number in cycles from which a program counts steps, if its coordinates have decimal points.
MIN_STEPS = 20


@dataclass(frozen=True)
class Setting:
    """A feed or a speed in force."""

    value: float = 0.0  # [mm/rev], [mm/min], [m/min] or [rev/min]
    span: Span | None = None  # place of the number in the program's text
    scale: float = 1.0  # its value in these units over the number as written


@dataclass
class Modal:
    """Modal state: values that apply until a later word replaces them."""

    program: PartProgram
    unit: str | None = None  # unit of a program that states none: mm or inch

    # Whether numbers without a decimal point count steps of 0.001 mm or 0.0001 inch.
    steps: bool = False
    radius: bool = False  # whether X is a radius in a program that does not state it
    notes: dict[str, list[int]] = field(default_factory=dict)  # lines of each note
    z: float = HOME.z
    x: float = HOME.x
    absolute: bool = True
    diameter: str = "DIAMON"
    length_scale: float = 1.0
    feed_scale: float = 1.0
    speed_scale: float = 1.0
    per_revolution: bool = True
    feed: Setting = Setting()
    constant_cutting_speed: bool = False
    speed: Setting = Setting()
    max_spindle_speed: float = math.inf  # [rev/min]
    spindle_on: bool = False
    tool: str = "T0"

    # Largest coordinate without a decimal point in each line that has one of ``MIN_LARGE`` or more.
    large_numbers: dict[int, float] = field(default_factory=dict)
    zero_offset: str = ""  # the last zero offset, such as G54; empty if there was none
    motion: int | None = None  # G function of the moves, or of the box cycle, in force
    line: Line = field(default_factory=lambda: Line(0, "", words=(), end=0))

    def __post_init__(self) -> None:
        """Look through the program for what it states anywhere, and note assumptions."""
        self.dialect = self.program.dialect
        self.feed_modes: Mapping[float, bool] = self.dialect.feed_modes
        self.fanuc = self.dialect.system != ""
        lines = list(itertools.chain.from_iterable(self.program.parts.values()))
        self.line = lines[0]
        words = list(itertools.chain.from_iterable(line.words for line in lines))
        codes: set[float] = set()
        for line in lines:
            codes |= line.codes

        self.states_unit = bool(codes & self.dialect.units.keys())
        if not self.states_unit:
            self._take_unit()
        self.linuxcnc = self._is_of_linuxcnc(words, codes)
        if self.linuxcnc:
            # There, G98 and G99 are the levels to which drilling cycles return.
            self.feed_modes = FEED_MODES_OF_LINUXCNC
        if self.linuxcnc and not codes & self.feed_modes.keys():
            # LinuxCNC starts with G94, Fanuc's lathes with G99.
            self.per_revolution = False
            self.note(
                "neither G94 nor G95 states the kind of feed: "
                "feeds are per minute, as in LinuxCNC (assumption)"
            )
        self._take_diameter(self._states_diameter(words, codes))
        self.system_a = self._is_surely_system_a(lines)
        self.counts_steps = self.steps or self._has_steps_in_cycles(lines, words)
        self._note_control()

    # Assumptions about a program.

    def _take_unit(self) -> None:
        """Set the unit of a program that states none."""
        units = self.dialect.units
        if self.unit == "inch":
            inches = [code for code, unit in units.items() if unit.length == INCH]
            # G700 of SINUMERIK changes feeds, too, unlike G70.
            self.set_units_and_modes({max(inches)})
        if self.unit is None:
            names = " nor ".join(f"G{code}" for code in units)
            self.note(
                f"neither {names} states the unit of the program: mm is taken (assumption); "
                "--unit inch sets inches"
            )

    def _is_of_linuxcnc(self, words: Sequence[Word], codes: set[float]) -> bool:
        """Return whether a program has words that only LinuxCNC has: G7, G8, #<name>."""
        has_names = any(word.address.startswith("#<") for word in words)
        return self.fanuc and (bool(codes & {7, 8}) or has_names)

    def _states_diameter(self, words: Sequence[Word], codes: set[float]) -> bool:
        """Return whether a program states if X is a diameter."""
        if self.fanuc:
            return bool(codes & {7, 8})
        return any(word.address in DIAMETERS for word in words)

    def _take_diameter(self, stated: bool) -> None:
        """Set whether X is a diameter before the program's first word."""
        if stated and self.radius:
            self.note("the program states whether X is a radius, so --radius has no effect")
        elif self.radius:
            self.diameter = "DIAMOF"
            self.note("X is taken as a radius, as --radius says")
        elif not stated:
            why = "since neither DIAMON nor DIAMOF nor DIAM90 is programmed"
            if self.fanuc:
                why = "as usual"
            self.note(f"X is taken as a diameter, {why} (assumption); --radius sets a radius")

    def _is_surely_system_a(self, lines: Sequence[Line]) -> bool:
        """Return whether G90, G92 and G94 are box cycles, as in Fanuc's system A.

        In systems B and C, and in LinuxCNC, they are modes, and so are G91 and G95.
        """
        if self.dialect is not FANUC or self.linuxcnc:
            return False
        for line in lines:
            sets_feed_mode = line.codes & {94, 95} and not line.first(*COORDINATES)
            sets_increments = line.codes & {91, 28, 30} == {91}
            if sets_feed_mode or sets_increments:
                return False
        return True

    def _has_steps_in_cycles(self, lines: Sequence[Line], words: Sequence[Word]) -> bool:
        """Return whether sizes in cycles are steps: whole, large, beside others with a point."""
        for word in words:
            if word.address in ("X", "Z") and word.value and word.is_whole:
                return False
        for line in lines:
            if not line.codes & self.dialect.cycles.keys():
                continue
            sizes = [word for word in line.words if word.address in _SIZES]
            for word in sizes:
                if word.is_whole and abs(word.value or 0.0) >= MIN_STEPS:
                    return True
        return False

    def _note_control(self) -> None:
        """Note the control and the G code system as which a program is read."""
        sign = foreign_sign(self.program.text) if self.fanuc else None
        self.tried = ""
        if sign is not None:
            note = f"{sign.found}; it is read as Fanuc's, with Fanuc's cycles"
            self.tried = f" ({note})"
            self.note(note)
        if self.dialect.system in ("B", "C"):
            self.note(f"it is read in G code system {self.dialect.system}; --dialect sets another")

    # What other modules ask.

    @property
    def here(self) -> Point:
        """Tool position."""
        return Point(self.z, self.x)

    @property
    def in_inches(self) -> bool:
        """Whether lengths are in inches."""
        return self.length_scale == INCH

    def note(self, text: str) -> None:
        """Note something about the present line."""
        self.notes.setdefault(text, []).append(self.line.number)

    def function(self, codes: set[float]) -> int:
        """Return the cycle of a block as system A numbers it; 0 if it has none."""
        cycles = codes & self.dialect.cycles.keys()
        return self.dialect.cycles[min(cycles)] if cycles else 0

    def box_cycle(self, codes: set[float], line: Line) -> int | None:
        """Return the box cycle that a block runs, as system A numbers it: G90, G92 or G94.

        It is None if the block runs none.

        Raises:
            BlockError: the functions are cycles on some controls and modes on others.
        """
        others = _MOVING | self.dialect.cycles.keys()
        has_place = self.fanuc and line.first(*COORDINATES)
        # LinuxCNC has no boxes: G90 and G94 are modes there, and G92 sets the zero point.
        if codes & others or not has_place or self.linuxcnc:
            return None
        stated = codes & self.dialect.boxes.keys()
        unclear = codes & {90, 92, 94}
        if unclear and self.dialect is FANUC and not self.system_a:
            raise BlockError(
                f"G{min(unclear):g} with coordinates but without G0 or G1 is a cycle on some "
                "controls"
            )
        if len(stated) > 1:
            names = " and ".join(f"G{code:g}" for code in sorted(stated))
            raise BlockError(f"{names} exclude each other")
        if stated:
            return self.dialect.boxes[min(stated)]
        return self.motion if self.motion in (90, 92, 94) else None

    # Words that set values.

    def set_units_and_modes(self, codes: set[float]) -> None:
        """Set units, modes of coordinates and the kind of feed."""
        for code in codes & self.dialect.units.keys():
            unit = self.dialect.units[code]
            self.length_scale = unit.length
            if unit.with_feeds:
                self.feed_scale = self.length_scale
                self.speed_scale = FOOT if self.in_inches else 1.0
        # G7 and G8 of LinuxCNC: X is a diameter, or a radius.
        if self.fanuc and codes & {7, 8}:
            self.diameter = "DIAMON" if 7 in codes else "DIAMOF"
        if codes & {90, 91}:
            self.absolute = 90 in codes
        for code in codes & self.feed_modes.keys():
            per_revolution = self.feed_modes[code]
            # A feed per minute is none per revolution: the next F must follow.
            if per_revolution != self.per_revolution:
                self.feed = Setting()
            self.per_revolution = per_revolution
            # G94, G95 and G96 are one group of SINUMERIK's, so that G95 ends G96.
            if not self.fanuc and self.constant_cutting_speed:
                self.constant_cutting_speed = False
                self.speed = Setting()

    def set_feed(self, line: Line, codes: set[float]) -> None:
        """Set the feed."""
        word = line.first("F")
        if word is None or word.value is None:
            return
        # On a Fanuc, the lead of a thread stays in force as the feed. It must not change, so it
        # has no place in the text.
        is_move = codes & {32, 33} or self.motion == 92
        is_cycle = self.function(codes) in (76, 84)
        is_lead = self.fanuc and (is_move or is_cycle)
        self.feed = Setting(
            _rate(word) * self.feed_scale,
            span=None if is_lead else word.span,
            scale=self.feed_scale,
        )

    def set_speed(self, line: Line, codes: set[float]) -> None:
        """Set the limit of the spindle, the kind of its speed, and the speed."""
        spindle = line.first("S", "S1")
        limit = line.number_of("LIMS") or None
        # D of LinuxCNC's G96 limits the spindle.
        if limit is None and self.fanuc and 96 in codes:
            limit = line.number_of("D")
        limiting = codes & self.dialect.spindle_limits
        if limiting:
            limit = self._limit_or_zero_point(line, min(limiting), spindle)
            spindle = None
        if limit is not None:
            if limit <= 0:
                raise BlockError(
                    f"the limit of the spindle speed is {limit:g}, but must be above 0"
                )
            self.max_spindle_speed = limit
        if codes & {96, 97}:
            self._set_kind_of_speed(96 in codes)
        if spindle is not None and spindle.value is not None:
            scale = self.speed_scale if self.constant_cutting_speed else 1.0
            self.speed = Setting(_rate(spindle) * scale, spindle.span, scale=scale)

    def _limit_or_zero_point(self, line: Line, code: float, spindle: Word | None) -> float | None:
        """Return the limit of the spindle that G50, G92, G25 or G26 states.

        With coordinates, G50 of Fanuc's system A, or G92 of B and C, sets the zero point instead.
        That is understood before the first move.
        """
        misuse = f"G{code:g} is understood as a limit of the spindle alone: G{code:g} S..."
        if line.first(*COORDINATES):
            is_at_start = self.fanuc and self.here == HOME
            if not (is_at_start and line.first("X", "Z")):
                raise BlockError(misuse)
            self.z, self.x = self.target(line)
            self.note(f"G{code:g} sets the zero point from where the tool stands")
        elif spindle is None or spindle.value is None:
            raise BlockError(misuse)
        # G25 of SINUMERIK states the lowest speed.
        if spindle is None or code == 25:
            return None
        return spindle.value

    def _set_kind_of_speed(self, constant: bool) -> None:
        """Set whether S is a cutting speed (G96) or a spindle speed (G97)."""
        if constant != self.constant_cutting_speed:
            # G97 alone keeps the spindle at its present speed.
            is_kept = self.speed.value > 0.0 and not constant
            self.speed = Setting(self.spindle_speed()) if is_kept else Setting()
        self.constant_cutting_speed = constant
        # G96 of SINUMERIK includes G95.
        if not self.fanuc and constant and not self.per_revolution:
            self.per_revolution = True
            self.feed = Setting()

    def spindle_speed(self) -> float:
        """Return the spindle speed at the tool's position [rev/min]."""
        if self.speed.value <= 0.0:
            raise BlockError("no speed is set: S")
        if not self.constant_cutting_speed:
            return self.speed.value
        # At the axis, the spindle runs at its highest speed.
        diameter = 2.0 * max(abs(self.x), 1e-6)
        turns: float = spindle_speed_at(self.speed.value, diameter)
        return min(turns, self.max_spindle_speed)

    def set_tool(self, line: Line) -> None:
        """Set tool and spindle, and note machine functions that are not understood."""
        word = line.first("T", "T1")
        if word is not None:
            # T0100 of Fanuc cancels the offset of T0101, not the tool.
            tool = word.text if word.value is None else f"T{word.text}"
            cancels = self.fanuc and len(word.text) >= 3 and tool.endswith("00")
            if not (cancels and self.tool.startswith(tool[:-2])):
                self.tool = tool
        known = _KNOWN_M | (_CALLS_OF_FANUC if self.fanuc else _ENDS_OF_SINUMERIK)
        for word in line.words:
            if word.address not in ("M", "M1") or word.value is None:
                continue
            # M3, M4 and M5, and M13 and M14 with coolant.
            if word.value in (3, 4, 5, 13, 14):
                self.spindle_on = word.value != 5
            elif word.value not in known and not self._calls_block(word, line):
                self.note(
                    f"M{word.value:g} is not understood; it is taken as without effect on the path"
                )

    def _calls_block(self, word: Word, line: Line) -> bool:
        """Return whether a word is M97 of Haas, which calls the block that P names."""
        return self.fanuc and word.value == 97 and line.first("P") is not None

    # Lengths and coordinates.

    def in_units(self, word: Word) -> float:
        """Return a length as it is written, in mm or inch.

        A number without a decimal point may count steps.
        """
        value = word.value or 0.0
        if self.fanuc and self.steps and word.is_whole:
            return value * (STEP_INCH if self.in_inches else STEP_MM)
        return value

    def in_mm(self, word: Word | None) -> float:
        """Return a length as it is written [mm]; 0 without a word."""
        return 0.0 if word is None else self.in_units(word) * self.length_scale

    def scaled_x(self, value: float, incremental: bool) -> float:
        """Return a value of X as a radius in mm."""
        # With DIAM90 of SINUMERIK, absolute values are diameters and increments are radii.
        halved = self.diameter == "DIAMON" or (self.diameter == "DIAM90" and not incremental)
        return value * self.length_scale * (0.5 if halved else 1.0)

    def length(self, word: Word | None, steps: bool = False) -> float:
        """Return the length of a cycle's word [mm].

        A whole number counts steps if ``steps``, or if the program does so.
        """
        if word is None or not word.value:
            return 0.0
        if not (word.is_whole and (steps or self.counts_steps)):
            return word.value * self.length_scale
        step = STEP_MM
        step_text = "0.001 mm"
        if self.in_inches:
            step = STEP_INCH * INCH
            step_text = "0.0001 inch"
        self.note(f"a cycle's words without a decimal point are read as steps of {step_text}")
        return word.value * step

    def target(self, line: Line) -> Point:
        """Return the point to which a block's coordinates lead from the tool's position.

        Raises:
            BlockError: it is beyond ``MAX_REACH``.
        """
        z = self.z
        x = self.x
        axes = set()
        for word in line.words:
            if word.value is None or word.address not in COORDINATES:
                continue
            self._note_whole(word)
            incremental = self._is_incremental(word)
            if word.address in ("X", "U"):
                axes.add("X")
                value = self.scaled_x(self.in_units(word), incremental)
                x = value + (self.x if incremental else 0.0)
            else:
                axes.add("Z")
                value = self.in_mm(word)
                z = value + (self.z if incremental else 0.0)
        # The angle of the move from the Z axis, A, ,A or ANG=, gives the other coordinate.
        angle = line.number_of("A", ",A", "ANG")
        if angle is not None and len(axes) == 1:
            slope = math.tan(math.radians(angle))
            if axes == {"Z"}:
                x = self.x + (z - self.z) * slope
            elif abs(slope) > 1e-9:
                z = self.z + (x - self.x) / slope
        try:
            return within_reach(Point(z, x))
        except BlockError as error:
            if self.line.number not in self.large_numbers:
                raise
            raise BlockError(f"{error}; are its numbers steps of 0.001, --steps?") from None

    def _is_incremental(self, word: Word) -> bool:
        """Return whether a coordinate counts from the tool's position."""
        # U and W are the increments of Fanuc's system A; IC and AC are SINUMERIK's.
        if word.address in ("U", "W") or word.mode == "IC":
            return True
        return not self.absolute and word.mode != "AC"

    def _note_whole(self, word: Word) -> None:
        """Note how a coordinate without a decimal point is read."""
        if not (self.fanuc and word.is_whole and word.value):
            return
        if self.steps:
            step = "0.0001 inch" if self.in_inches else "0.001 mm"
            self.note(f"coordinates without a decimal point are read as steps of {step}")
            return
        unit = "inch" if self.in_inches else "mm"
        self.note(f"coordinates without a decimal point are read as {unit}, not as steps of 0.001")
        if abs(word.value) >= MIN_LARGE:
            largest = self.large_numbers.get(self.line.number, 0.0)
            self.large_numbers[self.line.number] = max(abs(word.value), largest)


def within_reach(point: Point) -> Point:
    """Return a place of the tool.

    Raises:
        BlockError: it is farther from the zero point than ``MAX_REACH``.
    """
    if not (abs(point.z) <= MAX_REACH and abs(point.x) <= MAX_REACH):
        raise BlockError(
            f"the tool would go to Z{point.z:g} X{2.0 * point.x:g} mm, "
            f"but {MAX_REACH:g} mm from zero are allowed at most"
        )
    return point


def _rate(word: Word) -> float:
    """Return the value of a feed or a speed.

    Raises:
        BlockError: it is negative, or beyond ``MIN_RATE`` and ``MAX_RATE``.
    """
    value = word.value or 0.0
    text = f"{word.address}{word.text}"
    if value < 0.0:
        raise BlockError(f"{text} is negative")
    if value and not MIN_RATE <= value <= MAX_RATE:
        raise BlockError(f"{text} is beyond {MIN_RATE:g} to {MAX_RATE:g}")
    return value
