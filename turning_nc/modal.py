"""Modal state of a control: units, feed, speed and tool in force, and the tool's position."""

import math
from dataclasses import dataclass, field

from turning_nc.dialects import FANUC, INCH
from turning_nc.paths import Point
from turning_nc.words import Line, PartProgram, Problem, Span

HOME: Point = (200.0, 200.0)
"""Tool position before the first move and at reference points [mm] (assumption)."""
FOOT = 0.3048
_KNOWN_M = {*range(10), 17, 30, *range(40, 46), 98, 99}


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
    notes: dict[int, str] = field(default_factory=dict)
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
    tool: str = "T0"
    noted_once: set[str] = field(default_factory=set)
    line: Line = field(default_factory=lambda: Line(0, "", (), 0))

    def __post_init__(self) -> None:
        self.dialect = self.program.dialect
        self.fanuc = self.dialect is FANUC

    @property
    def here(self) -> Point:
        """Tool position."""
        return self.z, self.x

    def note(self, text: str, once: str = "") -> None:
        """Note something about the present line; of the notes with the same ``once``, the first alone."""
        noted = self.notes.get(self.line.number, "")
        if text not in noted and once not in self.noted_once:
            self.notes[self.line.number] = f"{noted}; {text}" if noted else text
        self.noted_once |= {once} - {""}

    def set_units_and_modes(self, codes: set[float]) -> None:
        """Set units, modes of coordinates and the kind of feed."""
        for code in codes & self.dialect.units.keys():
            self.length_scale, feeds_too = self.dialect.units[code]
            if feeds_too:
                self.feed_scale = self.length_scale
                self.speed_scale = FOOT if self.length_scale == INCH else 1.0
        if self.fanuc and codes & {7, 8}:
            self.diameter = "DIAMON" if 7 in codes else "DIAMOF"
        if self.fanuc and not codes & {0, 1, 2, 3, 32, 33} and self.line.first("X", "Z", "U", "W"):
            for code in codes & {90, 91, 92, 94}:
                raise Problem(f"G{code:g} with coordinates but without G0 or G1 is a cycle on some controls")
        if codes & {90, 91}:
            self.absolute = 90 in codes
        if codes & {94, 95, 98, 99}:
            per_revolution = bool(codes & {95, 99})
            if per_revolution != self.per_revolution:
                self.feed = Setting()
            self.per_revolution = per_revolution
            if not self.fanuc and self.constant_cutting_speed:  # one group with G96
                self.constant_cutting_speed, self.speed = False, Setting()

    def set_feed_and_speed(self, line: Line, codes: set[float]) -> None:
        """Set feed, speed and the limit of the spindle."""
        word = line.first("F")
        if word is not None and word.value is not None:
            if word.value < 0:
                raise Problem(f"F{word.text} is negative")
            lead = self.fanuc and bool(codes & {32, 33, 76})  # of a thread: it stays in force, but must not change
            self.feed = Setting(word.value * self.feed_scale, None if lead else word.span, self.feed_scale)
        spindle = line.first("S", "S1")
        limit = line.number_of("LIMS") or (line.number_of("D") if self.fanuc and 96 in codes else None)
        for code in codes & self.dialect.spindle_limits:
            if spindle is None or spindle.value is None or line.first("X", "Z", "U", "W"):
                raise Problem(f"G{code:g} is understood as a limit of the spindle alone: G{code:g} S...")
            limit = limit if code == 25 else spindle.value  # G25 is the lowest speed
        if codes & self.dialect.spindle_limits:
            spindle = None
        if limit is not None:
            if limit <= 0:
                raise Problem(f"the limit of the spindle speed is {limit:g}, but must be above 0")
            self.max_spindle_speed = limit
        if codes & {96, 97}:
            constant = 96 in codes
            if constant != self.constant_cutting_speed:
                kept = self.speed.value > 0.0 and not constant  # G97 alone keeps the spindle at its present speed
                self.speed = Setting(self.spindle_speed()) if kept else Setting()
            self.constant_cutting_speed = constant
            if not self.fanuc and constant and not self.per_revolution:
                self.per_revolution, self.feed = True, Setting()
        if spindle is not None and spindle.value is not None:
            if spindle.value < 0:
                raise Problem(f"S{spindle.text} is negative")
            scale = self.speed_scale if self.constant_cutting_speed else 1.0
            self.speed = Setting(spindle.value * scale, spindle.span, scale)

    def spindle_speed(self) -> float:
        """Return the spindle speed at the tool's position [rev/min]."""
        if self.speed.value <= 0.0:
            raise Problem("no speed is set: S")
        if not self.constant_cutting_speed:
            return self.speed.value
        return min(1000.0 * self.speed.value / (2.0 * math.pi * max(abs(self.x), 1e-6)), self.max_spindle_speed)

    def set_tool(self, line: Line) -> None:
        """Set the tool, and note machine functions that are not understood."""
        word = line.first("T", "T1")
        if word is not None:
            cancels = self.fanuc and len(word.text) >= 3 and word.text.endswith("00")  # the offset, not the tool
            if not (cancels and self.tool.startswith(f"T{word.text[:-2]}")):
                self.tool = word.text if word.value is None else f"T{word.text}"
        for word in line.words:
            if word.address in ("M", "M1") and word.value not in (*_KNOWN_M, None):
                self.note(f"M{word.value:g} is not understood; it is taken as without effect on the path")

    def scaled_x(self, value: float, incremental: bool) -> float:
        """Return a value of X as a radius in mm."""
        halved = self.diameter == "DIAMON" or (self.diameter == "DIAM90" and not incremental)
        return value * self.length_scale * (0.5 if halved else 1.0)

    def target(self, line: Line) -> Point:
        """Return the point to which a block's coordinates lead."""
        z, x = self.here
        for word in line.words:
            if word.value is None or word.address not in ("X", "Z", "U", "W"):
                continue
            if self.fanuc and "." not in word.text and word.value:
                unit = "mm" if self.length_scale == 1.0 else "inch"
                number = f"{word.address}{word.text}"
                self.note(f"{number} has no decimal point: whole numbers are read as {unit}, not as 0.001", once="whole numbers")
            incremental = word.address in ("U", "W") or (not self.absolute and word.mode != "AC") or word.mode == "IC"
            if word.address in ("X", "U"):
                x = self.scaled_x(word.value, incremental) + (x if incremental else 0.0)
            else:
                z = word.value * self.length_scale + (z if incremental else 0.0)
        return z, x
