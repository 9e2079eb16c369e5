"""Modal state of a control: units, feed, speed and tool in force, and the tool's position."""

import math
from dataclasses import dataclass, field

from turning_nc.dialects import DIAMETERS, FANUC, INCH, foreign_sign
from turning_nc.paths import Point
from turning_nc.words import Line, PartProgram, Problem, Span, Word

HOME: Point = (
    200.0,
    200.0,
)  # tool position before the first move and at reference points [mm] (assumption)
FOOT = 0.3048
MAX_REACH = 1e5  # largest distance of the tool from the zero point along an axis [mm]; that of a stock's ends, too
MIN_RATE, MAX_RATE = 1e-6, 1e6  # of feeds and speeds, in any unit; a control's are far within
_KNOWN_M = {*range(10), 13, 14, 17, 30, *range(40, 46), 98, 99}
_COORDINATES = "X", "Z", "U", "W"
STEP_MM, STEP_INCH = 0.001, 0.0001  # least increments of a control, in units of the program
MIN_LARGE = 1000.0  # coordinate without a decimal point from which it looks like steps
MIN_STEPS = 20
"""Whole number in cycles from which a program counts steps of 0.001 mm or 0.0001 inch, if its coordinates have decimal points."""


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
    steps: bool = (
        False  # whether numbers without a decimal point count steps of 0.001 mm or 0.0001 inch
    )
    radius: bool = False  # whether X is a radius in a program that does not state it
    notes: dict[str, list[int]] = field(default_factory=dict)  # lines of each note
    z: float = HOME[0]
    x: float = HOME[1]
    absolute: bool = True
    diameter: str = "DIAMON"
    length_scale: float = 1.0
    feed_scale: float = 1.0
    speed_scale: float = 1.0
    per_revolution: bool = True
    feed: Setting = Setting()
    constant_cutting_speed: bool = False
    speed: Setting = Setting()
    max_spindle_speed: float = math.inf
    spindle_on: bool = False
    tool: str = "T0"
    large_numbers: dict[int, float] = field(default_factory=dict)
    """Largest coordinate without a decimal point in each line that has one of ``MIN_LARGE`` or more."""
    motion: int | None = None  # G function of the moves, or of the box cycle, in force
    line: Line = field(default_factory=lambda: Line(0, "", (), 0))

    def __post_init__(self) -> None:
        self.dialect = self.program.dialect
        self.fanuc = self.dialect.system != ""
        lines = [line for part in self.program.parts.values() for line in part]
        self.line = lines[0]
        words = [word for line in lines for word in line.words]
        codes = {word.value for word in words if word.address == "G" and word.value is not None}
        self.states_unit = bool(codes & self.dialect.units.keys())
        if not self.states_unit:
            inch = max(code for code, (scale, _) in self.dialect.units.items() if scale == INCH)
            self.set_units_and_modes({inch} if self.unit == "inch" else set())
            if self.unit is None:
                names = " nor ".join(f"G{code}" for code in self.dialect.units)
                self.note(
                    f"neither {names} states the unit of the program: mm is taken (assumption); --unit inch sets inches"
                )
        self.linuxcnc = self.fanuc and (
            bool(codes & {7, 8}) or any(word.address.startswith("#<") for word in words)
        )
        if self.linuxcnc and not codes & self.dialect.feed_modes.keys():
            self.per_revolution = False
            self.note(
                "neither G94 nor G95 states the kind of feed: feeds are per minute, as in LinuxCNC (assumption)"
            )
        states_diameter = (
            bool(codes & {7, 8}) if self.fanuc else any(word.address in DIAMETERS for word in words)
        )
        self._take_diameter(states_diameter)
        feeds = any(line.codes & {94, 95} and not line.first(*_COORDINATES) for line in lines)
        increments = any({91} == line.codes & {91, 28, 30} for line in lines)
        self.system_a = self.dialect is FANUC and not (feeds or self.linuxcnc or increments)
        lengths = [word for word in words if word.address in ("X", "Z") and word.value]
        cycles = [line for line in lines if line.codes & self.dialect.cycles.keys()]
        sizes = [word for line in cycles for word in line.words if word.address in {*"UWRDIK"}]
        whole = [abs(word.value or 0.0) for word in sizes if "." not in word.text]
        with_points = all("." in word.text for word in lengths)
        self.counts_steps = self.steps or (with_points and max(whole, default=0.0) >= MIN_STEPS)
        sign = foreign_sign(self.program.text) if self.fanuc else None
        self.tried = f" ({sign.found}; it is read as Fanuc's, with Fanuc's cycles)" if sign else ""
        if self.tried:
            self.note(self.tried.strip(" ()"))
        if self.dialect.system in ("B", "C"):
            self.note(f"it is read in G code system {self.dialect.system}; --dialect sets another")

    def _take_diameter(self, stated: bool) -> None:
        """Set whether X is a diameter before the program's first word."""
        if stated and self.radius:
            self.note("the program states whether X is a radius, so --radius has no effect")
        elif self.radius:
            self.diameter = "DIAMOF"
            self.note("X is taken as a radius, as --radius says")
        elif not stated:
            why = (
                "as usual"
                if self.fanuc
                else "since neither DIAMON nor DIAMOF nor DIAM90 is programmed"
            )
            self.note(f"X is taken as a diameter, {why} (assumption); --radius sets a radius")

    @property
    def here(self) -> Point:
        """Tool position."""
        return self.z, self.x

    def note(self, text: str) -> None:
        """Note something about the present line."""
        self.notes.setdefault(text, []).append(self.line.number)

    def function(self, codes: set[float]) -> int:
        """Return the cycle of a block as system A numbers it; 0 if it has none."""
        found = codes & self.dialect.cycles.keys()
        return self.dialect.cycles[min(found)] if found else 0

    def box_cycle(self, codes: set[float], line: Line) -> int | None:
        """Return the box cycle that a block runs, as system A numbers it: G90, G92 or G94. None if it runs none."""
        others = {0, 1, 2, 3, 4, 28, 30, 32, 33, 53} | self.dialect.cycles.keys()
        if codes & others or not (self.fanuc and line.first(*_COORDINATES)):
            return None
        stated = codes & self.dialect.boxes.keys()
        if self.dialect is FANUC and not self.system_a and (unclear := codes & {90, 91, 92, 94}):
            raise Problem(
                f"G{min(unclear):g} with coordinates but without G0 or G1 is a cycle on some controls"
            )
        if stated:
            return self.dialect.boxes[min(stated)]
        return self.motion if self.motion in (90, 92, 94) else None

    def set_units_and_modes(self, codes: set[float]) -> None:
        """Set units, modes of coordinates and the kind of feed."""
        for code in codes & self.dialect.units.keys():
            self.length_scale, feeds_too = self.dialect.units[code]
            if feeds_too:
                self.feed_scale = self.length_scale
                self.speed_scale = FOOT if self.length_scale == INCH else 1.0
        if self.fanuc and codes & {7, 8}:
            self.diameter = "DIAMON" if 7 in codes else "DIAMOF"
        if codes & {90, 91}:
            self.absolute = 90 in codes
        for code in codes & self.dialect.feed_modes.keys():
            per_revolution = self.dialect.feed_modes[code]
            if per_revolution != self.per_revolution:
                self.feed = Setting()
            self.per_revolution = per_revolution
            if not self.fanuc and self.constant_cutting_speed:  # one group with G96
                self.constant_cutting_speed, self.speed = False, Setting()

    def set_feed(self, line: Line, codes: set[float]) -> None:
        """Set the feed."""
        word = line.first("F")
        if word is None or word.value is None:
            return
        # The lead of a thread stays in force, but must not change.
        lead = self.fanuc and (
            codes & {32, 33} or self.function(codes) in (76, 84) or self.motion == 92
        )
        self.feed = Setting(
            _rate(word) * self.feed_scale, None if lead else word.span, self.feed_scale
        )

    def set_speed(self, line: Line, codes: set[float]) -> None:
        """Set the limit of the spindle, the kind of its speed, and the speed."""
        spindle = line.first("S", "S1")
        limit = line.number_of("LIMS") or (
            line.number_of("D") if self.fanuc and 96 in codes else None
        )
        if limiting := codes & self.dialect.spindle_limits:
            limit = self._limit_or_zero_point(line, min(limiting), spindle)
            spindle = None
        if limit is not None:
            if limit <= 0:
                raise Problem(f"the limit of the spindle speed is {limit:g}, but must be above 0")
            self.max_spindle_speed = limit
        if codes & {96, 97}:
            self._set_kind_of_speed(96 in codes)
        if spindle is not None and spindle.value is not None:
            scale = self.speed_scale if self.constant_cutting_speed else 1.0
            self.speed = Setting(_rate(spindle) * scale, spindle.span, scale)

    def _limit_or_zero_point(self, line: Line, code: float, spindle: Word | None) -> float | None:
        """Return the limit of the spindle that G50, G92, G25 or G26 states; set the zero point before the first move."""
        limit = (
            None if spindle is None or code == 25 else spindle.value
        )  # G25 states the lowest speed
        if line.first(*_COORDINATES):
            if not (self.fanuc and self.here == HOME and line.first("X", "Z")):
                raise Problem(
                    f"G{code:g} is understood as a limit of the spindle alone: G{code:g} S..."
                )
            self.z, self.x = self.target(line)
            self.note(f"G{code:g} sets the zero point from where the tool stands")
        elif spindle is None or spindle.value is None:
            raise Problem(
                f"G{code:g} is understood as a limit of the spindle alone: G{code:g} S..."
            )
        return limit

    def _set_kind_of_speed(self, constant: bool) -> None:
        """Set whether S is a cutting speed (G96) or a spindle speed (G97)."""
        if constant != self.constant_cutting_speed:
            kept = (
                self.speed.value > 0.0 and not constant
            )  # G97 alone keeps the spindle at its present speed
            self.speed = Setting(self.spindle_speed()) if kept else Setting()
        self.constant_cutting_speed = constant
        if not self.fanuc and constant and not self.per_revolution:
            self.per_revolution, self.feed = True, Setting()

    def spindle_speed(self) -> float:
        """Return the spindle speed at the tool's position [rev/min]."""
        if self.speed.value <= 0.0:
            raise Problem("no speed is set: S")
        if not self.constant_cutting_speed:
            return self.speed.value
        return min(
            1000.0 * self.speed.value / (2.0 * math.pi * max(abs(self.x), 1e-6)),
            self.max_spindle_speed,
        )

    def set_tool(self, line: Line) -> None:
        """Set tool and spindle, and note machine functions that are not understood."""
        word = line.first("T", "T1")
        if word is not None:
            cancels = (
                self.fanuc and len(word.text) >= 3 and word.text.endswith("00")
            )  # the offset, not the tool
            if not (cancels and self.tool.startswith(f"T{word.text[:-2]}")):
                self.tool = word.text if word.value is None else f"T{word.text}"
        for word in line.words:
            if word.address in ("M", "M1") and word.value is not None:
                if word.value in (3, 4, 5, 13, 14):
                    self.spindle_on = word.value != 5
                elif word.value not in _KNOWN_M:
                    self.note(
                        f"M{word.value:g} is not understood; it is taken as without effect on the path"
                    )

    def in_units(self, word: Word) -> float:
        """Return a length as it is written, in mm or inch; a number without a decimal point may count steps."""
        value = word.value or 0.0
        if not (self.fanuc and self.steps) or "." in word.text:
            return value
        return value * (STEP_INCH if self.length_scale == INCH else STEP_MM)

    def scaled_x(self, value: float, incremental: bool) -> float:
        """Return a value of X as a radius in mm."""
        halved = self.diameter == "DIAMON" or (self.diameter == "DIAM90" and not incremental)
        return value * self.length_scale * (0.5 if halved else 1.0)

    def length(self, word: Word | None, steps: bool = False) -> float:
        """Return the length of a cycle's word [mm]; a whole number counts steps if ``steps``, or if the program does so."""
        if word is None or not word.value:
            return 0.0
        if "." in word.text or not (steps or self.counts_steps):
            return word.value * self.length_scale
        inch = self.length_scale == INCH
        self.note(
            f"a cycle's words without a decimal point are read as steps of {'0.0001 inch' if inch else '0.001 mm'}"
        )
        return word.value * (STEP_INCH * INCH if inch else STEP_MM)

    def target(self, line: Line, start: Point | None = None) -> Point:
        """Return the point to which a block's coordinates lead, by default from the tool's position."""
        z, x = here = start or self.here
        given = set()
        for word in line.words:
            if word.value is None or word.address not in _COORDINATES:
                continue
            self._note_whole(word)
            incremental = (
                word.address in ("U", "W")
                or (not self.absolute and word.mode != "AC")
                or word.mode == "IC"
            )
            given.add("X" if word.address in ("X", "U") else "Z")
            if word.address in ("X", "U"):
                x = self.scaled_x(self.in_units(word), incremental) + (
                    self.x if incremental else 0.0
                )
            else:
                z = self.in_units(word) * self.length_scale + (self.z if incremental else 0.0)
        angle = line.number_of("A", ",A", "ANG") if len(given) == 1 else None
        if angle is not None:  # of the move, from the Z axis: it gives the other coordinate
            slope = math.tan(math.radians(angle))
            if given == {"Z"}:
                x = here[1] + (z - here[0]) * slope
            elif abs(slope) > 1e-9:
                z = here[0] + (x - here[1]) / slope
        try:
            return within_reach((z, x))
        except Problem as problem:
            hint = (
                "; are its numbers steps of 0.001, --steps?"
                if self.line.number in self.large_numbers
                else ""
            )
            raise Problem(f"{problem}{hint}") from None

    def _note_whole(self, word: Word) -> None:
        """Note how a coordinate without a decimal point is read."""
        if not self.fanuc or "." in word.text or not word.value:
            return
        inch = self.length_scale == INCH
        if self.steps:
            self.note(
                f"coordinates without a decimal point are read as steps of {'0.0001 inch' if inch else '0.001 mm'}"
            )
            return
        self.note(
            f"coordinates without a decimal point are read as {'inch' if inch else 'mm'}, not as steps of 0.001"
        )
        if abs(word.value) >= MIN_LARGE:
            number = self.line.number
            self.large_numbers[number] = max(abs(word.value), self.large_numbers.get(number, 0.0))


def within_reach(point: Point) -> Point:
    """Return a place of the tool.

    Raises:
        Problem: it is farther from the zero point than ``MAX_REACH``.
    """
    z, x = point
    if not (abs(z) <= MAX_REACH and abs(x) <= MAX_REACH):
        raise Problem(
            f"the tool would go to Z{z:g} X{2.0 * x:g} mm, but {MAX_REACH:g} mm from zero are allowed at most"
        )
    return point


def _rate(word: Word) -> float:
    """Return the value of a feed or a speed.

    Raises:
        Problem: it is negative, or beyond ``MIN_RATE`` and ``MAX_RATE``.
    """
    value = word.value or 0.0
    if value < 0.0:
        raise Problem(f"{word.address}{word.text} is negative")
    if value and not MIN_RATE <= value <= MAX_RATE:
        raise Problem(f"{word.address}{word.text} is beyond {MIN_RATE:g} to {MAX_RATE:g}")
    return value
