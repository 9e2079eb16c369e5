"""Cycles of Fanuc (G70 to G76, G81 to G84, G90, G92, G94) and SINUMERIK (CYCLE95, CYCLE97): their words and moves."""

import contextlib
import copy
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from turning_nc.dialects import NUMBER
from turning_nc.expression import MAX_SHOWN
from turning_nc.modal import Setting
from turning_nc.passes import (
    Roughing,
    Thread,
    decreasing_depths,
    pecked,
    repeated_passes,
    roughing_passes,
    thread_passes,
)
from turning_nc.paths import Path, Point, joined, shifted
from turning_nc.words import Line, Problem, Span, Word

if TYPE_CHECKING:
    from turning_nc.moves import Control, Kind

RETRACTION_CYCLE95 = CLEARANCE_CYCLE97 = 1.0
"""Distance by which the tool leaves the metal in these cycles without their last argument [mm]."""
MAX_REPEATS = 1000

Arguments = Sequence[tuple[str, Span]]


@dataclass
class CycleState:
    """Values that the first blocks of Fanuc's cycles set for the second."""

    depth: float = 0.0  # depth of the passes of G71 and G72 [mm]
    retraction: float = 0.5  # [mm]
    pattern: Point = (0.0, 0.0)  # distance along Z and X of the first pass of G73 [mm]
    repeats: int = 0  # number of passes of G73
    thread: tuple[int, float, float, float] | None = None
    """Finishing passes, angle [degrees], smallest depth and allowance [mm] of G76."""
    pecking: float = 0.0  # distance by which G74 and G75 draw back [mm]
    box: tuple[Point, float] = ((0.0, 0.0), 0.0)  # end and taper of the last G90, G92 or G94 [mm]
    roughed: dict[tuple[float, float], int] = field(default_factory=dict)
    """Lines of the last roughing cycles, by the numbers of the first and the last block of their contours."""


@dataclass(frozen=True)
class Side:
    """Side of its contour that a roughing cycle turns."""

    upwards: bool  # whether the metal lies beyond the contour along the axis of infeed
    why: str
    facing: bool
    start: Point  # [mm]
    reach: tuple[float, float]  # least and largest Z of the contour [mm]

    @property
    def name(self) -> str:
        """Name of the side; the tool may work beyond the axis, at negative X."""
        if self.facing:
            return "to the right" if self.upwards else "to the left"
        return "outside" if self.upwards == (self.start[1] >= 0.0) else "inside"


# Fanuc.


def fanuc_cycle(
    control: "Control", codes: set[float], line: Line, lines: Sequence[Line], index: int
) -> int:
    """Run a cycle; return the index of the line that follows."""
    code = control.function(codes)
    if code in (74, 75, 76, 81, 82, 83, 84):
        run = _fanuc_thread if code == 76 else _pecking if code in (74, 75) else _drilling
        run(control, line, code)
        return index + 1
    if not (line.first("P") and line.first("Q")):
        if code == 70 or not line.first("U", "W", "D", "R"):
            other = (
                ""
                if code in (72, 73)
                else f"; in SINUMERIK programs G{code} is a unit: --dialect sinumerik"
            )
            raise Problem(f"G{code} needs the first and last block of the contour: P and Q{other}")
        _first_block(control, code, line)
        return index + 1
    begins, ends = _contour_blocks(control, line, lines, index, after=code != 70)
    if code == 70:
        _finish(control, line, lines, begins, ends)
        return max(index, ends) + 1
    start, state = control.here, control.cycle
    state.roughed[_contour_names(line)] = line.number
    if line.first("D", "I", "K"):  # the older format, in one block
        _first_block(control, code, line)
    contour = _contour(control, lines, begins, ends + 1)
    allowance = control.length(line.first("W")), control.length(line.first("U")) * _halved(control)
    if code == 73:
        if state.repeats == 0:
            raise Problem(
                "G73 needs a block before it that says how often it repeats its contour: R"
            )
        _add_passes(
            control, repeated_passes(contour, start, allowance, state.pattern, state.repeats)
        )
        return ends + 1
    if state.depth <= 0.0:
        raise Problem(
            f"G{code} needs the depth of its passes: a block before it with {'W' if code == 72 else 'U'}"
        )
    side = _side(control, contour, allowance, code == 72)
    cycle = Roughing(state.depth, state.retraction, allowance, side.upwards, code == 72)
    _add_passes(control, roughing_passes(contour, start, cycle))
    return ends + 1


def _contour_names(line: Line) -> tuple[float, float]:
    """Return the numbers of the first and the last block of a cycle's contour."""
    return line.number_of("P") or 0.0, line.number_of("Q") or 0.0


def _finish(control: "Control", line: Line, lines: Sequence[Line], begins: int, ends: int) -> None:
    """Run G70: the blocks of a contour, and back to the start."""
    start = control.here
    kept = control.feed, control.motion
    control.finishes = control.cycle.roughed.get(_contour_names(line), 0)
    try:
        with control.deeper():
            control.run_lines(lines, begins, ends + 1)
        control.finishes = 0
        control.go_rapidly(start)
    finally:
        control.finishes = 0
        control.feed, control.motion = kept


def end_of_contour(control: "Control", line: Line, lines: Sequence[Line], index: int) -> int:
    """Return the index of the line after a cycle and its contour, or after the cycle if it has none."""
    code = control.function(line.codes)
    if code > 73 or not (line.first("P") and line.first("Q")):
        return index + 1
    try:
        return max(index, _contour_blocks(control, line, lines, index, after=code != 70)[1]) + 1
    except Problem:
        return index + 1


def _halved(control: "Control") -> float:
    """Return the radius over a length along X as it is written."""
    return control.scaled_x(1.0, True) / control.length_scale


def _side(
    control: "Control", contour: Sequence[Path], allowance: Point, facing: bool, machining: str = ""
) -> Side:
    """Return and keep the side of a contour that a cycle turns.

    It is that which the caller gives, that of the kind of machining, or that on which a control starts: it goes from the start
    point to the first point of the contour.
    """
    axis, start, line, first = (
        (0 if facing else 1),
        control.here,
        control.line.number,
        contour[0].start,
    )
    heights = [first[axis], *(path.end[axis] for path in contour)]
    steps = (
        start[axis] - first[axis],
        allowance[axis],
        start[axis] - 0.5 * (min(heights) + max(heights)),
    )
    upwards = next((step for step in steps if abs(step) > 1e-6), 1.0) > 0.0
    word, scale = "ZX"[axis], (1.0 if facing else 1.0 / _halved(control)) / control.length_scale
    why = f"from its start at {word}{start[axis] * scale:g} to the contour's first point at {word}{first[axis] * scale:g}"
    given = control.given_sides.get(line)
    if not facing and (given or machining):
        upwards = ((given or machining) == "outside") == (start[1] >= 0.0)
        why = "as given" if given else "by its kind of machining"
    elif steps[0] * allowance[axis] < -1e-9:
        choice = (
            "correct the program"
            if facing
            else f"correct it, or set --side {line}=outside or {line}=inside"
        )
        raise Problem(
            f"it cuts {why}, but the sign of {'UW'[facing]} says the other side: {choice}"
        )
    reach = [first[0], *(path.end[0] for path in contour)]
    control.sides[line] = side = Side(upwards, why, facing, start, (min(reach), max(reach)))
    return side


def _first_block(control: "Control", code: int, line: Line) -> None:
    """Keep the values of the first block of G71, G72 or G73, or of the one block in the older format."""
    state = control.cycle
    whole = line.first("P") is not None
    if code == 73:
        z, x = (control.length(line.first(address)) for address in ("KI" if whole else "WU"))
        count = line.number_of("D" if whole else "R") or 0.0
        if not (count == int(count) and 1 <= count <= MAX_REPEATS):
            raise Problem(
                f"G73 repeats its contour {count:g} times, but must do so 1 to {MAX_REPEATS} times"
            )
        state.pattern, state.repeats = (z, x), int(count)
        return
    depth = line.first("D" if whole else "W" if code == 72 else "U")
    if depth is not None:
        state.depth = control.length(depth, steps=whole)
    if not whole and (retraction := line.first("R")):
        state.retraction = control.length(retraction)


def _contour_blocks(
    control: "Control", line: Line, lines: Sequence[Line], index: int, after: bool
) -> tuple[int, int]:
    """Return the first and the last line of a cycle's contour, which follows the cycle if ``after``."""
    first, last = line.number_of("P"), line.number_of("Q")
    places = control.places(lines)
    begins = places.block(first, index + 1)
    if begins is None and not after:
        begins = places.block(first, 0, index)
    ends = None if begins is None else places.block(last, begins)
    if begins is None or ends is None:
        raise Problem(f"the contour from N{first:g} to N{last:g} is not in the program")
    return begins, ends


def _fanuc_thread(control: "Control", line: Line, code: int) -> None:
    """Run G76: the first block holds finishing passes and angle, the second the thread; or one block with K and D."""
    p, q, r = line.first("P"), line.first("Q"), line.first("R")
    if not line.first("X", "Z", "U", "W"):
        digits = p.text.zfill(6) if p else ""
        if not (digits.isdigit() and len(digits) == 6):
            raise Problem(
                "G76 needs its first block, such as G76 P020060 Q50 R0.02: P holds finishing passes, pull-out, angle"
            )
        smallest, allowance = control.length(q, steps=True), control.length(r, steps=True)
        control.cycle.thread = int(digits[:2]), 0.5 * int(digits[4:]), smallest, allowance
        return
    lead, thread = line.number_of("F"), control.cycle.thread
    if (k := line.first("K")) and (d := line.first("D")):
        p, q, r, thread = k, d, line.first("I"), (0, 0.5 * (line.number_of("A") or 0.0), 0.0, 0.0)
    if not (thread and p and q and lead):
        raise Problem(
            "G76 is understood as two blocks, G76 P(finishing) Q R, then G76 X Z P(height) Q(first depth) F(lead), or as one: "
            "G76 X Z K(height) D(first depth) F(lead)"
        )
    finishing, angle, smallest, allowance = thread
    (end, root), height, taper = (
        control.target(line),
        control.length(p, steps=True),
        control.length(r, steps=True),
    )
    depths = decreasing_depths(
        height, control.length(q, steps=True), smallest, allowance, finishing
    )
    with control.thread_feed(lead):
        _add_passes(
            control,
            thread_passes(Thread(control.here, end, (root + taper, root), height, angle), depths),
            "thread",
        )


def _pecking(control: "Control", line: Line, code: int) -> None:
    """Run G74 along Z, or G75 along X: pecks to the end, again at steps across; I and K may stand for P and Q."""
    if not line.first("X", "Z", "U", "W"):
        control.cycle.pecking = control.length(line.first("R"), steps=True)
        return
    words = line.first("P", "I"), line.first("Q", "K")  # along X and Z
    x, z = (
        abs(control.length(word, steps=word is not None and word.address in "PQ")) for word in words
    )
    peck, across = (z, x) if code == 74 else (x, z)
    _add_passes(
        control,
        pecked(control.here, control.target(line), code - 74, peck, across, control.cycle.pecking),
    )


def _drilling(control: "Control", line: Line, code: int) -> None:
    """Run G81, G82, G83 or G84 as one move along Z and back."""
    start = control.here
    path = Path(start, (control.target(line)[0], start[1]))
    with (
        control.thread_feed(control.feed.value / control.length_scale)
        if code == 84
        else contextlib.nullcontext()
    ):
        control.add(path, "thread" if code == 84 else "feed")
    control.go_rapidly(start)


def box_cycle(control: "Control", code: int, line: Line) -> None:
    """Run G90, G92 or G94 of system A: a box from the tool's position and back; words that are left out stay as before."""
    start, (end, taper) = control.here, control.cycle.box
    if line.codes & control.dialect.boxes.keys():
        end, taper = start, 0.0
    taken = control.target(line)
    z, x = (
        taken[0] if line.first("Z", "W") else end[0],
        taken[1] if line.first("X", "U") else end[1],
    )
    taper = control.length(line.first("R")) if line.first("R") else taper
    control.cycle.box = (z, x), taper
    if code == 94:
        ends = [
            ((z + taper, start[1]), True),
            ((z, x), False),
            ((start[0], x), False),
            (start, True),
        ]
    else:
        ends = [
            ((start[0], x + taper), True),
            ((z, x), False),
            ((z, start[1]), code == 92),
            (start, True),
        ]
    with (
        control.thread_feed(control.feed.value / control.length_scale)
        if code == 92
        else contextlib.nullcontext()
    ):
        _add_passes(control, [list(joined(start, *ends))], "thread" if code == 92 else "feed")


# Both.


def _contour(control: "Control", lines: Sequence[Line], first: int, last: int) -> list[Path]:
    """Return the moves of contour blocks, without the one that leads to the contour."""
    inner = copy.copy(control)
    inner.moves, inner.cycle_pass, inner.corner = [], 0, None
    inner.feed = Setting(inner.feed.value or 1.0)
    inner.speed = Setting(inner.speed.value or 1.0)
    with inner.deeper():
        inner.run_lines(lines, first, last)
        inner.end_corner()
    paths = [
        replace(move.path, line=move.line) for move in inner.moves if move.kind in ("rapid", "feed")
    ]
    ends = {line.number for line in lines[first:last] if 40 in line.codes}  # of compensation
    while len(paths) > 2 and (
        paths[-1].rapid or (paths[-1].line in ends and _returns(paths))
    ):  # the tool departs
        paths.pop()
    if len(paths) < 2:
        raise Problem("the contour has no moves after the one that leads to it")
    return [replace(path, rapid=False) for path in paths[1:]]


def _returns(paths: Sequence[Path]) -> bool:
    """Return whether the last path leads back towards the first."""
    (z, x), (end, end_x), (begin, begin_x) = paths[-1].start, paths[-1].end, paths[1].start
    return (end - z) * (z - begin) + (end_x - x) * (x - begin_x) < 0.0


def _add_passes(control: "Control", made: Iterable[Sequence[Path]], kind: "Kind" = "feed") -> None:
    for number, paths in enumerate(made, 1):
        control.cycle_pass = number
        for path in paths:
            control.add(path, "rapid" if path.rapid else kind)
    control.cycle_pass = 0


# SINUMERIK.


def _number(name: str, arguments: Arguments, index: int, default: float = 0.0) -> float:
    text = arguments[index][0] if index < len(arguments) else ""
    if not text:
        return default
    if not re.fullmatch(NUMBER, text):
        raise Problem(
            f"argument {index + 1} of {name} is {text[:MAX_SHOWN]!r}, but must be a number"
        )
    word = Word(f"argument {index + 1} of {name}: ", float(text), text)
    if word.fault:
        raise Problem(word.fault)
    return float(text)


def cycle95(control: "Control", arguments: Arguments, lines: Sequence[Line]) -> None:
    """Rough and finish a contour."""

    def number(index: int, default: float = 0.0) -> float:
        return _number("CYCLE95", arguments, index, default)

    def feed(index: int) -> Setting:
        value = number(index)
        return (
            Setting(value * control.feed_scale, arguments[index][1], control.feed_scale)
            if value > 0
            else control.feed
        )

    if not arguments:
        raise Problem('CYCLE95 needs its arguments: ("contour", depth, ...)')
    variant = int(number(8, 1.0))
    if not 1 <= variant <= 12:
        raise Problem(f"the kind of machining of CYCLE95 is {variant}, but must be 1 to 12")
    facing, machining = variant % 2 == 0, "inside" if (variant - 1) % 4 >= 2 else "outside"
    side = 1.0 if control.given_sides.get(control.line.number, machining) == "outside" else -1.0
    contour = _contour(control, *_contour_lines(control, arguments[0][0].strip('"'), lines))
    away = number(11, RETRACTION_CYCLE95) * control.length_scale
    both = number(4)
    allowance = (
        (number(2) + both) * control.length_scale,
        side * (number(3) + both) * control.length_scale,
    )
    head, end = contour[0].start, contour[-1].end
    farthest = max(
        (head, *(path.end for path in contour)),
        key=lambda point: point[0] if facing else side * point[1],
    )
    start = shifted((farthest[0], head[1]) if facing else (head[0], farthest[1]), allowance)
    # Before the contour along the feed, and beyond it along the infeed.
    feed_axis = 1 if facing else 0
    before = away if end[feed_axis] <= head[feed_axis] else -away
    start = shifted(start, (away, before) if facing else (before, side * away))
    kept = control.feed
    control.go_rapidly(start)
    upwards = _side(control, contour, allowance, facing, machining).upwards
    if variant not in (5, 6, 7, 8):
        control.feed = feed(5)
        cycle = Roughing(
            number(1) * control.length_scale, away, allowance, upwards, facing, equal=True
        )
        _add_passes(control, roughing_passes(contour, start, cycle))
    if variant >= 5:
        control.feed = feed(7)
        control.go_rapidly(start, (head[0], start[1]) if facing else (start[0], head[1]))
        for path in (Path(control.here, head), *contour):
            control.add(path, "feed")
        control.go_rapidly((start[0], end[1]) if facing else (end[0], start[1]), start)
    control.feed = kept


def _contour_lines(
    control: "Control", name: str, lines: Sequence[Line]
) -> tuple[Sequence[Line], int, int]:
    if ":" in name:
        labels = [label.strip() for label in name.upper().split(":")]
        places = [
            next((k for k, line in enumerate(lines) if line.first(f"{label}:")), -1)
            for label in labels
        ]
        if len(places) != 2 or not 0 <= places[0] < places[1]:
            raise Problem(f"the labels of the contour {name!r} are not in the program")
        return lines, places[0], places[1] + 1
    found = control.program.parts.get(name.upper())
    if found is None:
        raise Problem(
            f"the contour {name!r} is not in this file; its sub-programs are {control.program.sub_programs}"
        )
    return found, 0, len(found)


def cycle97(control: "Control", arguments: Arguments) -> None:
    """Cut a thread."""
    (
        lead,
        size,
        first,
        last,
        *diameters,
        run_in,
        run_out,
        height,
        allowance,
        angle,
        _,
        cuts,
        spare,
        variant,
        starts,
        clearance,
    ) = (
        _number("CYCLE97", arguments, index, default)
        for index, default in enumerate(
            (0.0,) * 12 + (1.0, 0.0, 1.0, 1.0, CLEARANCE_CYCLE97 / control.length_scale)
        )
    )
    if lead <= 0.0:
        raise Problem(
            f"CYCLE97 needs its pitch as first argument; the size of a thread alone, {size:g}, is not understood"
        )
    if variant not in (1, 2, 3, 4) or first == last or height <= 0.0:
        raise Problem(
            "CYCLE97 needs a thread's start, another end, a depth above 0, and a kind of machining from 1 to 4"
        )
    if starts > MAX_REPEATS:
        raise Problem(
            f"CYCLE97 cuts {starts:g} starts of a thread, but {MAX_REPEATS} at most are made"
        )
    if not (1 <= cuts <= MAX_REPEATS and 0 <= spare <= MAX_REPEATS and 0.0 <= allowance < height):
        raise Problem(
            f"CYCLE97 needs 1 to {MAX_REPEATS} cuts, and a finishing allowance below the depth"
        )
    outwards, scale = (1.0 if variant in (1, 3) else -1.0), control.length_scale
    along = 1.0 if last > first else -1.0
    begin, end = first - along * run_in, last + along * run_out
    slope = 0.5 * (diameters[1] - diameters[0]) / (last - first)
    crests = [0.5 * diameters[0] + slope * (z - first) for z in (begin, end)]
    clear = outwards * max(outwards * crest for crest in crests) + outwards * clearance
    roots = scale * (crests[0] - outwards * height), scale * (crests[1] - outwards * height)
    thread = Thread((scale * begin, scale * clear), scale * end, roots, scale * height, abs(angle))
    power = 1.0 if variant in (1, 2) else 0.5
    depths = [
        scale * (height - allowance) * ((number + 1) / cuts) ** power for number in range(int(cuts))
    ]
    depths += [scale * height] * (int(spare) + (allowance > 0.0))
    control.go_rapidly(thread.start)
    with control.thread_feed(lead):
        for _ in range(max(int(starts), 1)):
            _add_passes(control, thread_passes(thread, depths), "thread")
