"""A control that moves its tool and keeps what it does not understand.

``Control`` is the base on which interpolation, cycles and blocks build. How it runs lines is left
to ``moves``, so that cycles can run the blocks of their contours without knowing how.
"""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

from turning_nc.cycles import CycleState, Side
from turning_nc.modal import HOME, Modal, Setting, within_reach
from turning_nc.paths import MIN_LENGTH, Corner, Path, Point, break_corner
from turning_nc.places import Places
from turning_nc.words import BlockError, Line, NcError

MAX_BLOCKS = 100_000
MAX_CALLS = 8  # depth of calls; controls allow four to eleven

Kind = Literal["rapid", "feed", "thread", "dwell"]


@dataclass(frozen=True)
class Move:
    """A move of the tool, or a dwell."""

    kind: Kind
    path: Path

    # Line of the file whose block moves the tool; for a pass of a cycle, that of the cycle.
    line: int
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

    # 41 or 42 if the nose radius is compensated to the left or to the right; 0 if not.
    compensation: int = 0
    finishes: int = 0  # line of the roughing cycle whose contour the move finishes; 0 if none
    start_angle: float = 0.0  # of the spindle at which a thread begins [degrees]


class ProblemPlace(NamedTuple):
    """A place with words that are not understood."""

    line: int
    where: str  # for messages


@dataclass
class BlockCount:
    """Number of blocks run, which a control shares with those that run its contours."""

    number: int = 0


@dataclass
class Control(Modal, ABC):
    """A control that runs blocks."""

    moves: list[Move] = field(default_factory=list)
    has_moved: bool = False  # whether a move is no dwell
    is_shifted: bool = False  # whether TRANS of SINUMERIK holds

    # Why words are not understood.
    problems: dict[ProblemPlace, list[str]] = field(default_factory=dict)
    variables: dict[str, float] = field(default_factory=dict)

    # Sides that the user gives to roughing cycles, and those that they turn, by their lines.
    given_sides: Mapping[int, str] = field(default_factory=dict)
    sides: dict[int, Side] = field(default_factory=dict)
    go_on: bool = False  # whether words that are not understood are left out
    corner: Corner | None = None  # between the last move and the next
    rounding: float = 0.0  # radius of all corners between moves at feed, RNDM [mm]
    compensation: int = 0
    finishes: int = 0
    start_angle: float = 0.0
    is_drilling: bool = False  # whether a drilling cycle of Fanuc holds
    cycle: CycleState = field(default_factory=CycleState)
    cycle_pass: int = 0
    calls: int = 0  # depth of calls
    block_count: BlockCount = field(default_factory=BlockCount)
    places_of_parts: dict[str, Places] = field(default_factory=dict)
    parts_run: set[str] = field(default_factory=set)  # that were begun

    @abstractmethod
    def run_lines(self, part: str, start: int = 0, end: int | None = None) -> None:
        """Run lines of a part from an index to before another."""

    def places(self, part: str) -> Places:
        """Return where a part of the program has its blocks, labels and loops."""
        if part not in self.places_of_parts:
            self.places_of_parts[part] = Places(self.program.parts[part])
        return self.places_of_parts[part]

    # Problems.

    @contextlib.contextmanager
    def naming_problems(self) -> Iterator[None]:
        """Keep what is not understood in the present line, and go on after it."""
        line = self.line
        try:
            yield
        except BlockError as error:
            self.line = line
            self.refuse(str(error), error.line)

    def refuse(self, reason: str, line: int | None = None) -> None:
        """Keep why words of the present line, or of the contour's line, are not understood."""
        present = self.line
        if line is None or line == present.number:
            place = ProblemPlace(present.number, f"(in {present.text[:60]!r})")
        else:
            place = ProblemPlace(line, f"(contour of line {present.number})")
        reasons = self.problems.setdefault(place, [])
        if reason not in reasons:
            reasons.append(reason)

    @contextlib.contextmanager
    def deeper(self) -> Iterator[None]:
        """Run other lines within a block, such as a sub-program's, and come back to it.

        Raises:
            NcError: lines call each other too deep.
        """
        line: Line = self.line
        if self.calls >= MAX_CALLS:
            raise NcError(
                f"line {line.number}: sub-programs or contours call each other "
                f"more than {MAX_CALLS} deep"
            )
        self.calls += 1
        try:
            yield
        finally:
            self.calls -= 1
            self.line = line

    # Moves.

    def go_rapidly(self, *points: Point) -> None:
        """Add rapid moves to points."""
        for point in points:
            self.add(Path(self.here, point, rapid=True), "rapid")

    def go_home(self, what: str, line: Line) -> None:
        """Go to ``HOME`` along the axes that a block names, or along both if it names none."""
        self.note(f"{what} are not in the program: Z{HOME.z:g} X{2 * HOME.x:g} is taken")
        along_z = line.first("Z", "W") is not None
        along_x = line.first("X", "U") is not None
        z = HOME.z
        x = HOME.x
        if along_x and not along_z:
            z = self.z
        elif along_z and not along_x:
            x = self.x
        self.go_rapidly(Point(z, x))

    @contextlib.contextmanager
    def thread_feed(self, lead: float, start_angle: float = 0.0) -> Iterator[None]:
        """Move with the lead of a thread, in the program's units per revolution.

        ``start_angle`` is that of the spindle at which it begins [degrees].
        """
        self.start_angle = start_angle
        feed = self.feed
        per_revolution = self.per_revolution
        self.feed = Setting(lead * self.length_scale)
        self.per_revolution = True
        try:
            yield
        finally:
            self.feed = feed
            self.per_revolution = per_revolution
            self.start_angle = 0.0

    def add(self, path: Path, kind: Kind, time: float = 0.0) -> None:
        """Add a move from the tool's position, and the corner before it.

        Raises:
            BlockError: the move has no feed or no speed, or leaves ``MAX_REACH``.
            NcError: the program makes too many moves.
        """
        if len(self.moves) >= MAX_BLOCKS:
            raise NcError(
                f"line {self.line.number}: more than {MAX_BLOCKS} moves are made; "
                "are calls or passes repeated?"
            )
        within_reach(path.end)
        if kind in ("feed", "thread"):
            if path.length < MIN_LENGTH:
                return
            self._check_settings()
        self.z, self.x = path.end
        if kind == "rapid" and path.length < MIN_LENGTH:
            return
        if self.corner and kind == "feed":
            path = self._break_corner(self.corner, path)
            if path.length < MIN_LENGTH:
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
                # Controls rough without compensation: they take the contour as the tip's path.
                compensation=0 if self.cycle_pass else self.compensation,
                finishes=self.finishes,
                start_angle=self.start_angle,
            )
        )

    def _check_settings(self) -> None:
        """Check that a feed and a speed are set.

        If something was not understood before, it may have set them.
        """
        if self.problems and not self.go_on:
            return
        if self.feed.value <= 0.0:
            raise BlockError("no feed is set: F")
        # A feed per minute needs no spindle, as that of a bar puller; the metal tells if it cuts.
        if self.speed.value <= 0.0 and self.per_revolution:
            raise BlockError("no speed is set: S")

    def _break_corner(self, corner: Corner, path: Path) -> Path:
        """Break the corner between the last move and a path; return what stays of the path."""
        before = self.moves[-1]
        self.corner = None
        broken = break_corner(before.path, path, corner)
        self.moves.pop()
        for piece in (broken.before, broken.between):
            if piece is not None and piece.length > MIN_LENGTH:
                self.moves.append(replace(before, path=piece))
        return broken.after

    def end_corner(self) -> None:
        """Name a chamfer or a radius that no move at feed follows."""
        if self.corner and not self.corner.modal:
            place = ProblemPlace(self.corner.line, "")
            self.problems[place] = ["after a chamfer or a radius, a move at feed must follow"]
        self.corner = None
