"""Cycles of Fanuc (G70 to G73, G76) and SINUMERIK (CYCLE95, CYCLE97): their words, and the moves that they make."""

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from turning_nc.dialects import INCH
from turning_nc.modal import Setting
from turning_nc.passes import Roughing, Thread, decreasing_depths, repeated_passes, roughing_passes, thread_passes
from turning_nc.paths import Path, Point, shifted
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


# Fanuc.


def fanuc_cycle(control: "Control", codes: set[float], line: Line, lines: Sequence[Line], index: int) -> int:
    """Run a cycle; return the index of the line that follows."""
    code = int(min(codes & control.dialect.cycles))
    if code == 76:
        _fanuc_thread(control, line)
        return index + 1
    if not (line.first("P") and line.first("Q")):
        if code == 70 or not line.first("U", "W", "D", "R"):
            other = "" if code in (72, 73) else f"; in SINUMERIK programs G{code} is a unit: --dialect sinumerik"
            raise Problem(f"G{code} needs the first and last block of the contour: P and Q{other}")
        _first_block(control, code, line)
        return index + 1
    begins, ends = _contour_blocks(line, lines, index, after=code != 70)
    start, state = control.here, control.cycle
    if code == 70:
        kept = control.feed, control.motion
        with control.deeper():
            control.run_lines(lines, begins, ends + 1)
        control.feed, control.motion = kept
        control.go_rapidly(start)
        return max(index, ends) + 1
    if line.first("D", "I", "K"):  # the older format, in one block
        _first_block(control, code, line)
    contour = _contour(control, lines, begins, ends + 1)
    allowance = (line.number_of("W") or 0.0) * control.length_scale, control.scaled_x(line.number_of("U") or 0.0, True)
    if code == 73:
        if state.repeats == 0:
            raise Problem("G73 needs a block before it that says how often it repeats its contour: R")
        _add_passes(control, repeated_passes(contour, start, allowance, state.pattern, state.repeats))
        return ends + 1
    if state.depth <= 0.0:
        raise Problem(f"G{code} needs the depth of its passes: a block before it with {'W' if code == 72 else 'U'}")
    _add_passes(control, roughing_passes(contour, start, Roughing(state.depth, state.retraction, allowance, code == 72)))
    return ends + 1


def _first_block(control: "Control", code: int, line: Line) -> None:
    """Keep the values of the first block of G71, G72 or G73, or of the one block in the older format."""
    state, scale = control.cycle, control.length_scale
    whole = line.first("P") is not None
    if code == 73:
        z, x = ((line.number_of(address) or 0.0) * scale for address in ("KI" if whole else "WU"))
        count = line.number_of("D" if whole else "R") or 0.0
        if not (count == int(count) and 1 <= count <= MAX_REPEATS):
            raise Problem(f"G73 repeats its contour {count:g} times, but must do so 1 to {MAX_REPEATS} times")
        state.pattern, state.repeats = (z, x), int(count)
        return
    depth = line.first("D" if whole else "W" if code == 72 else "U")
    if depth is not None:
        state.depth = _fine(control, depth) if whole else (depth.value or 0.0) * scale
    if not whole and (retraction := line.number_of("R")) is not None:
        state.retraction = retraction * scale


def _fine(control: "Control", word: Word | None) -> float:
    """Return the length of a word whose whole numbers count steps of 0.001 mm or 0.0001 inch [mm]."""
    if word is None or "." in word.text or not word.value:
        return ((word and word.value) or 0.0) * control.length_scale
    length = word.value * (0.001 if control.length_scale != INCH else 0.0001 * INCH)
    control.note(f"{word.address}{word.text} without a decimal point is read as {length:g} mm")
    return length


def _contour_blocks(line: Line, lines: Sequence[Line], index: int, after: bool) -> tuple[int, int]:
    first, last = line.number_of("P"), line.number_of("Q")
    places = [*range(index + 1, len(lines)), *([] if after else range(index))]
    begins = next((k for k in places if lines[k].number_of("N") == first), None)
    ends = None if begins is None else next((k for k in range(begins, len(lines)) if lines[k].number_of("N") == last), None)
    if begins is None or ends is None:
        raise Problem(f"the contour from N{first:g} to N{last:g} is not in the program")
    return begins, ends


def _fanuc_thread(control: "Control", line: Line) -> None:
    """Run G76: the first block holds finishing passes and angle, the second the thread."""
    p, q, r = line.first("P"), line.first("Q"), line.first("R")
    if not line.first("X", "Z", "U", "W"):
        digits = p.text.zfill(6) if p else ""
        if not (digits.isdigit() and len(digits) == 6):
            raise Problem("G76 needs its first block, such as G76 P020060 Q50 R0.02: P holds finishing passes, pull-out, angle")
        control.cycle.thread = int(digits[:2]), 0.5 * int(digits[4:]), _fine(control, q), _fine(control, r)
        return
    lead = line.number_of("F")
    if control.cycle.thread is None or not (p and q and lead):
        raise Problem("G76 is understood as two blocks: G76 P(finishing) Q R, then G76 X Z P(height) Q(first depth) F(lead)")
    finishing, angle, smallest, allowance = control.cycle.thread
    (end, root), height, taper = control.target(line), _fine(control, p), _fine(control, r)
    depths = decreasing_depths(height, _fine(control, q), smallest, allowance, finishing)
    with control.thread_feed(lead):
        _add_passes(control, thread_passes(Thread(control.here, end, (root + taper, root), height, angle), depths), "thread")


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
    paths = [move.path for move in inner.moves if move.kind in ("rapid", "feed")]
    if len(paths) < 2:
        raise Problem("the contour has no moves after the one that leads to it")
    return [Path(path.start, path.end, path.centre, path.clockwise) for path in paths[1:]]


def _add_passes(control: "Control", made: Iterable[Sequence[Path]], kind: "Kind" = "feed") -> None:
    for number, paths in enumerate(made, 1):
        control.cycle_pass = number
        for path in paths:
            control.add(path, "rapid" if path.rapid else kind)
    control.cycle_pass = 0


# SINUMERIK.


def _number(name: str, arguments: Arguments, index: int, default: float = 0.0) -> float:
    text = arguments[index][0] if index < len(arguments) else ""
    try:
        return float(text) if text else default
    except ValueError:
        raise Problem(f"argument {index + 1} of {name} is {text!r}, but must be a number") from None


def cycle95(control: "Control", arguments: Arguments, lines: Sequence[Line]) -> None:
    """Rough and finish a contour."""

    def number(index: int, default: float = 0.0) -> float:
        return _number("CYCLE95", arguments, index, default)

    def feed(index: int) -> Setting:
        value = number(index)
        return Setting(value * control.feed_scale, arguments[index][1], control.feed_scale) if value > 0 else control.feed

    if not arguments:
        raise Problem('CYCLE95 needs its arguments: ("contour", depth, ...)')
    variant = int(number(8, 1.0))
    if not 1 <= variant <= 12:
        raise Problem(f"the kind of machining of CYCLE95 is {variant}, but must be 1 to 12")
    facing, side = variant % 2 == 0, -1.0 if (variant - 1) % 4 >= 2 else 1.0  # of the contour: outside, or inside
    contour = _contour(control, *_contour_lines(control, arguments[0][0].strip('"'), lines))
    away = number(11, RETRACTION_CYCLE95) * control.length_scale
    both = number(4)
    allowance = (number(2) + both) * control.length_scale, side * (number(3) + both) * control.length_scale
    head, end = contour[0].start, contour[-1].end
    farthest = max((path.end for path in contour), key=lambda point: point[0] if facing else side * point[1])
    start = shifted((farthest[0], head[1]) if facing else (head[0], farthest[1]), allowance)
    start = start[0] + away, start[1] + side * away
    kept = control.feed
    if variant not in (5, 6, 7, 8):
        control.feed = feed(5)
        control.go_rapidly(start)
        cycle = Roughing(number(1) * control.length_scale, away, allowance, facing, equal=True)
        _add_passes(control, roughing_passes(contour, start, cycle))
    if variant >= 5:
        control.feed = feed(7)
        control.go_rapidly(start, (head[0], start[1]) if facing else (start[0], head[1]))
        for path in (Path(control.here, head), *contour):
            control.add(path, "feed")
        control.go_rapidly((start[0], end[1]) if facing else (end[0], start[1]), start)
    control.feed = kept


def _contour_lines(control: "Control", name: str, lines: Sequence[Line]) -> tuple[Sequence[Line], int, int]:
    if ":" in name:
        labels = [label.strip() for label in name.upper().split(":")]
        places = [next((k for k, line in enumerate(lines) if line.first(f"{label}:")), -1) for label in labels]
        if len(places) != 2 or not 0 <= places[0] < places[1]:
            raise Problem(f"the labels of the contour {name!r} are not in the program")
        return lines, places[0], places[1] + 1
    found = control.program.parts.get(name.upper())
    if found is None:
        raise Problem(f"the contour {name!r} is not in this file; its sub-programs are {control.program.sub_programs}")
    return found, 0, len(found)


def cycle97(control: "Control", arguments: Arguments) -> None:
    """Cut a thread."""
    lead, size, first, last, *diameters, run_in, run_out, height, allowance, angle, _, cuts, spare, variant, starts, clearance = (
        _number("CYCLE97", arguments, index, default)
        for index, default in enumerate((0.0,) * 12 + (1.0, 0.0, 1.0, 1.0, CLEARANCE_CYCLE97 / control.length_scale))
    )
    if lead <= 0.0:
        raise Problem(f"CYCLE97 needs its pitch as first argument; the size of a thread alone, {size:g}, is not understood")
    if variant not in (1, 2, 3, 4) or first == last or height <= 0.0:
        raise Problem("CYCLE97 needs a thread's start, another end, a depth above 0, and a kind of machining from 1 to 4")
    if not (1 <= cuts <= MAX_REPEATS and 0 <= spare <= MAX_REPEATS and 0.0 <= allowance < height):
        raise Problem(f"CYCLE97 needs 1 to {MAX_REPEATS} cuts, and a finishing allowance below the depth")
    outwards, scale = (1.0 if variant in (1, 3) else -1.0), control.length_scale
    along = 1.0 if last > first else -1.0
    begin, end = first - along * run_in, last + along * run_out
    slope = 0.5 * (diameters[1] - diameters[0]) / (last - first)
    crests = [0.5 * diameters[0] + slope * (z - first) for z in (begin, end)]
    clear = outwards * max(outwards * crest for crest in crests) + outwards * clearance
    roots = scale * (crests[0] - outwards * height), scale * (crests[1] - outwards * height)
    thread = Thread((scale * begin, scale * clear), scale * end, roots, scale * height, abs(angle))
    power = 1.0 if variant in (1, 2) else 0.5
    depths = [scale * (height - allowance) * ((number + 1) / cuts) ** power for number in range(int(cuts))]
    depths += [scale * height] * (int(spare) + (allowance > 0.0))
    control.go_rapidly(thread.start)
    with control.thread_feed(lead):
        for _ in range(max(int(starts), 1)):
            _add_passes(control, thread_passes(thread, depths), "thread")
