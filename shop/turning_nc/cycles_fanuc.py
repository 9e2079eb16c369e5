"""Cycles of Fanuc: G70 to G76, drilling G81 to G84, and the boxes G90, G92 and G94.

The numbers are those of G code system A; ``Dialect.cycles`` has the others'. The words are those
of Fanuc's operator's manuals for lathes: most cycles have two blocks, and one block in an older
format, which is known by its words D, I and K.
"""

import contextlib
import math
from dataclasses import dataclass

from turning_nc.blocks import dwell_time
from turning_nc.contours import (
    add_passes,
    choose_side,
    contour_of,
    radius_per_x,
)
from turning_nc.control import Control, Kind
from turning_nc.cycles import Box, ContourLines, ContourNames, ThreadSettings
from turning_nc.interpolation import start_angle
from turning_nc.modal import COORDINATES
from turning_nc.passes import (
    Pecking,
    Repeating,
    Roughing,
    Thread,
    decreasing_depths,
    degressive_depths,
    pecked,
    repeated_passes,
    roughing_passes,
    thread_passes,
)
from turning_nc.paths import Path, Point, Stop, shifted, straight_paths
from turning_nc.words import BlockError, Line, Word

MAX_REPEATS = 1000
MAX_OFF_AXIS = 0.05  # distance of a tap from the axis that counts as none [mm]


@dataclass(frozen=True)
class Block:
    """A block that calls a cycle, and its place in the program."""

    line: Line  # with the words that are understood
    part: str
    index: int


def run_cycle(control: Control, block: Block, code: int) -> int:
    """Run a cycle; return the index of the line that follows.

    Raises:
        BlockError: words are missing or contradict each other.
    """
    line = block.line
    if control.linuxcnc and code <= 75:
        raise BlockError(f"G{code} of LinuxCNC is not read: write its moves")
    _check_coordinates(control, line, code)
    if code == 76:
        _thread(control, line)
    elif code in (74, 75):
        _peck(control, line, code)
    elif code >= 81:
        _drill(control, line, code)
    elif line.first("P") and line.first("Q"):
        return _run_with_contour(control, block, code)
    elif code == 70 or not line.first("U", "W", "D", "R"):
        hint = ""
        if code in (70, 71):
            hint = (
                f"; in SINUMERIK programs, and in G code system C, G{code} is a unit: "
                "--dialect sinumerik or fanuc-c"
            )
        raise BlockError(f"G{code} needs the first and last block of the contour: P and Q{hint}")
    elif code == 73:
        _set_repeating(control, line)
    else:
        _set_depth(control, line, code)
    return block.index + 1


def _check_coordinates(control: Control, line: Line, code: int) -> None:
    """Refuse coordinates that a cycle of a contour does not have, such as X in G71.

    Raises:
        BlockError: the block has them.
    """
    if code > 73:
        return
    taken = {"U", "W"}
    # Programs of roughing cycles are copied for finishing: controls skip what G70 does not have.
    if code == 70 and line.first("U", "W", "D"):
        control.note("U, W and D of G70 are left out: it finishes on the contour itself")
    elif code in (71, 72) and not line.first("P", "Q"):
        # The first block holds the depth of the passes alone.
        taken = {"W"} if code == 72 else {"U"}
    for word in line.words:
        if word.address in COORDINATES and word.address not in taken:
            raise BlockError(f"{word.address}{word.text} has no meaning in this block of G{code}")


def end_of_contour(control: Control, block: Block, code: int) -> int:
    """Return the index of the line after a cycle and its contour, if it has one."""
    has_contour = block.line.first("P") and block.line.first("Q")
    if code > 73 or not has_contour:
        return block.index + 1
    try:
        contour = _contour_lines(control, block, code)
    except BlockError:
        return block.index + 1
    return max(block.index + 1, contour.end)


# Cycles with a contour: G70 to G73.


def _run_with_contour(control: Control, block: Block, code: int) -> int:
    """Run the block of G70, G71, G72 or G73 that names a contour."""
    line = block.line
    lines = _contour_lines(control, block, code)
    if code != 70 and lines.first > block.index + 1:
        control.note(
            f"the blocks between G{code} and its contour are not run: as on a control, the program "
            "goes on behind the contour"
        )
    if code == 70:
        _finish(control, line, lines)
        return max(block.index + 1, lines.end)
    control.cycle.roughed[_contour_names(line)] = line.number
    # The older format has no block before this one.
    is_single = line.first("D", "I", "K") is not None
    if code == 73:
        if is_single:
            _set_repeating(control, line)
        _repeat(control, line, lines)
    else:
        if is_single:
            _set_depth(control, line, code)
        _rough(control, line, lines, code=code)
    return lines.end


def _contour_names(line: Line) -> ContourNames:
    """Return the names of a cycle's contour."""
    return ContourNames(line.number_of("P") or 0.0, line.number_of("Q") or 0.0)


def _contour_lines(control: Control, block: Block, code: int) -> ContourLines:
    """Return the lines of a cycle's contour, which follows the cycle; G70 also finds it before.

    Raises:
        BlockError: the contour is not in the program.
    """
    names = _contour_names(block.line)
    places = control.places(block.part)
    behind = places.lines[block.index + 1 :]
    before = places.lines[: block.index]
    first = places.block(names.first, behind)
    if first is None and code == 70:
        first = places.block(names.first, before)
    last = None
    if first is not None:
        last = places.block(names.last, places.lines[first:])
    if first is None or last is None:
        raise BlockError(
            f"the contour from N{names.first:g} to N{names.last:g} is not in the program"
        )
    return ContourLines(block.part, first, end=last + 1)


def _finish(control: Control, line: Line, lines: ContourLines) -> None:
    """Run G70: the blocks of a contour, and back to the start."""
    start = control.here
    feed = control.feed
    motion = control.motion
    control.finishes = control.cycle.roughed.get(_contour_names(line), 0)
    try:
        with control.deeper():
            control.run_lines(lines.part, lines.first, lines.end)
        control.finishes = 0
        control.go_rapidly(start)
    finally:
        control.finishes = 0
        control.feed = feed
        control.motion = motion


def _allowance(control: Control, line: Line) -> Point:
    """Return the metal that W and U leave along Z and X; U is a diameter if X is [mm]."""
    along_z = control.length(line.first("W"))
    along_x = control.length(line.first("U")) * radius_per_x(control)
    return Point(along_z, along_x)


def _rough(control: Control, line: Line, lines: ContourLines, code: int) -> None:
    """Run the block of G71 or G72 that names a contour."""
    facing = code == 72
    start = control.here
    contour = contour_of(control, lines)
    allowance = _allowance(control, line)
    if control.cycle.depth <= 0.0:
        address = "W" if facing else "U"
        raise BlockError(f"G{code} needs the depth of its passes: a block before it with {address}")
    side = choose_side(control, contour, allowance=allowance, facing=facing)
    # I and K of Haas and of Fanuc's older format: metal that stays for a pass along the contour
    # before the cycle ends.
    semi_finishing = Point(control.length(line.first("K")), control.length(line.first("I")))
    cycle = Roughing(
        depth=control.cycle.depth,
        retraction=control.cycle.retraction,
        allowance=shifted(allowance, semi_finishing),
        upwards=side.upwards,
        facing=facing,
    )
    add_passes(control, roughing_passes(contour, start, cycle))
    if semi_finishing != Point(0.0, 0.0):
        once = Repeating(Point(0.0, 0.0), 1)
        add_passes(control, repeated_passes(contour, start, allowance=allowance, cycle=once))


def _set_depth(control: Control, line: Line, code: int) -> None:
    """Keep the depth and the retraction of G71 and G72.

    They are U or W, and R, of a first block; or D of the single block in the older format, which
    has P.
    """
    single = line.first("P") is not None
    address = "W" if code == 72 else "U"
    depth = line.first("D" if single else address)
    if depth is not None:
        control.cycle.depth = control.length(depth, steps=single)
    retraction = line.first("R")
    if retraction is not None and not single:
        control.cycle.retraction = control.length(retraction)


def _repeat(control: Control, line: Line, lines: ContourLines) -> None:
    """Run the block of G73 that names a contour."""
    start = control.here
    contour = contour_of(control, lines)
    allowance = _allowance(control, line)
    repeating = control.cycle.repeating
    if repeating is None:
        raise BlockError(
            "G73 needs a block before it that says how often it repeats its contour: R"
        )
    add_passes(control, repeated_passes(contour, start, allowance=allowance, cycle=repeating))


def _set_repeating(control: Control, line: Line) -> None:
    """Keep how G73 repeats its contour.

    That is W, U and R of a first block; or K, I and D of the single block in the older format,
    which has P.
    """
    single = line.first("P") is not None
    z = control.length(line.first("K" if single else "W"))
    x = control.length(line.first("I" if single else "U"))
    count = line.number_of("D" if single else "R") or 0.0
    if not (count == int(count) and 1 <= count <= MAX_REPEATS):
        raise BlockError(
            f"G73 repeats its contour {count:g} times, but must do so 1 to {MAX_REPEATS} times"
        )
    control.cycle.repeating = Repeating(Point(z, x), int(count))


# Threads, pecks and drilling: G74 to G76 and G81 to G84.


def _thread(control: Control, line: Line) -> None:
    """Run G76: the first of its two blocks, the second, or the only one with K and D."""
    if control.linuxcnc:
        _thread_of_linuxcnc(control, line)
        return
    if line.first("J"):
        raise BlockError(
            "G76 with J is that of LinuxCNC: write G7 (X is a diameter) or G8 (a radius) at the "
            "begin of the program, so that it is read as LinuxCNC's"
        )
    if not line.first("X", "Z", "U", "W"):
        _set_thread(control, line)
        return
    height = line.first("P")
    first_depth = line.first("Q")
    taper = line.first("R")
    settings = control.cycle.thread
    k = line.first("K")
    d = line.first("D")
    if k and d:
        height = k
        first_depth = d
        taper = line.first("I")
        angle = 0.5 * (line.number_of("A") or 0.0)
        settings = ThreadSettings(finishing=0, angle=angle, smallest=0.0, allowance=0.0)
        if line.first("P", "Q"):
            control.note("P and Q of G76 in one block, side of infeed and start, are left out")
    lead = line.number_of("F")
    if not (settings and height and first_depth and lead):
        raise BlockError(
            "G76 is understood as two blocks, G76 P(finishing) Q R, then G76 X Z P(height) "
            "Q(first depth) F(lead), or as one: G76 X Z K(height) D(first depth) F(lead)"
        )
    end = control.target(line)
    height_length = control.length(height, steps=True)
    taper_length = control.length(taper, steps=True)
    depths = decreasing_depths(
        height_length,
        control.length(first_depth, steps=True),
        smallest=settings.smallest,
        allowance=settings.allowance,
        finishing=settings.finishing,
    )
    thread = Thread(
        start=control.here,
        end=end.z,
        # R is the difference of the radii, negative for a thread that grows along -Z.
        first_root=end.x + taper_length,
        last_root=end.x,
        height=height_length,
        angle=settings.angle,
    )
    with control.thread_feed(lead):
        add_passes(control, thread_passes(thread, depths), "thread")


def _thread_of_linuxcnc(control: Control, line: Line) -> None:
    """Run G76 of LinuxCNC, from its drive line, the X of the tool.

    P is the pitch, Z the end, I the way from the drive line to the thread's crest, J the first
    depth, K the height, R the degression, Q the angle of infeed and H the number of spring passes.
    I, J and K are diameters if X is. E and L, tapers at the ends, are left out.
    """
    pitch = line.number_of("P")
    crest = line.first("I")
    first = line.first("J")
    height = line.first("K")
    if not (pitch and crest and first and height and line.first("Z")):
        raise BlockError(
            "G76 of LinuxCNC needs P (pitch), Z (end), I (crest), J (first depth) and K (height)"
        )
    if line.number_of("L"):
        control.note("tapers at the ends of the thread, E and L of G76, are left out")
    start = control.here
    scale = radius_per_x(control)
    peak = start.x + scale * control.in_mm(crest)
    full_depth = scale * control.in_mm(height)
    root = peak - math.copysign(full_depth, start.x - peak)
    springs = line.number_of("H") or 0.0
    if not (springs == int(springs) and 0 <= springs <= MAX_REPEATS):
        raise BlockError(f"G76 makes {springs:g} spring passes, but 0 to {MAX_REPEATS} are read")
    depths = degressive_depths(
        full_depth,
        scale * control.in_mm(first),
        degression=line.number_of("R") or 1.0,
    )
    depths += [full_depth] * int(springs)
    thread = Thread(
        start=start,
        end=control.target(line).z,
        first_root=root,
        last_root=root,
        height=full_depth,
        angle=line.number_of("Q") or 0.0,
    )
    with control.thread_feed(pitch):
        add_passes(control, thread_passes(thread, depths), "thread")


def _set_thread(control: Control, line: Line) -> None:
    """Keep the values of the first block of G76.

    P holds three numbers of two digits: finishing passes, pull-out and the thread's angle.
    """
    p = line.first("P")
    digits = p.text.zfill(6) if p else ""
    if not (digits.isdigit() and len(digits) == 6):
        raise BlockError(
            "G76 needs its first block, such as G76 P020060 Q50 R0.02: "
            "P holds finishing passes, pull-out, angle"
        )
    smallest = control.length(line.first("Q"), steps=True)
    allowance = control.length(line.first("R"), steps=True)
    control.cycle.thread = ThreadSettings(
        finishing=int(digits[:2]),
        angle=0.5 * int(digits[4:]),
        smallest=smallest,
        allowance=allowance,
    )


def _peck(control: Control, line: Line, code: int) -> None:
    """Run G74 along Z, or G75 along X: pecks to the end, again at steps across.

    P and Q are lengths along X and Z in steps; I and K of the older format may stand for them.
    """
    if not line.first("X", "Z", "U", "W"):
        control.cycle.pecking = control.length(line.first("R"), steps=True)
        return
    for steps, length in (("P", "I"), ("Q", "K")):
        if line.first(steps) and line.first(length):
            raise BlockError(f"{steps} and {length} of G{code} state one length: leave one out")
    length_x = abs(_length_or_steps(control, line.first("P", "I"), of_steps="P"))
    length_z = abs(_length_or_steps(control, line.first("Q", "K"), of_steps="Q"))
    along_x = code == 75
    cycle = Pecking(
        along_x=along_x,
        peck=length_x if along_x else length_z,
        across=length_z if along_x else length_x,
        back=control.cycle.pecking,
    )
    target = control.target(line)
    add_passes(control, pecked(control.here, target, cycle))


def _length_or_steps(control: Control, word: Word | None, of_steps: str) -> float:
    """Return the length of a word, which counts steps if it has an address [mm]."""
    counts_steps = word is not None and word.address == of_steps
    return control.length(word, steps=counts_steps)


def _drill(control: Control, line: Line, code: int) -> None:
    """Run G81, G82, G83 or G84: rapidly to the hole and to point R, one move along Z, and back."""
    repeats = line.first("K")
    if repeats is not None and repeats.value != 1.0:
        raise BlockError(f"G{code} with K{repeats.text}, repeats of a hole, is not understood")
    bottom = control.target(line)
    if code == 84 and abs(bottom.x) > MAX_OFF_AXIS:
        raise BlockError("a fixed tap cuts on the axis, X0")
    initial = Point(control.z, bottom.x)
    near = _point_near_hole(control, line.first("R"), initial, bottom)
    control.go_rapidly(initial, near)

    # G84 taps: F is the lead of its thread.
    is_thread = code == 84
    # A tap that is fed per minute turns as often as the spindle meanwhile.
    is_lead = is_thread and control.per_revolution
    with _feed_of(control, is_lead):
        control.add(Path(near, bottom), "thread" if is_thread else "feed")
    pause = line.first("P")
    if pause is not None:
        control.add(Path(bottom, bottom), "dwell", time=dwell_time(control, pause))
    control.go_rapidly(initial)
    control.is_drilling = True


def _point_near_hole(control: Control, word: Word | None, initial: Point, bottom: Point) -> Point:
    """Return point R, from which a drilling cycle feeds: the initial point without the word R.

    R of a Fanuc is the distance from the initial point. R of LinuxCNC and of Haas is a place along
    Z.

    Raises:
        BlockError: the tool would pass the bottom of the hole, or go away from it.
    """
    if word is None:
        return initial
    place = control.length(word)
    if control.linuxcnc and control.absolute:
        z = place
    elif control.linuxcnc or place * (bottom.z - initial.z) >= 0.0:
        z = initial.z + place
    else:
        z = place
        control.note(
            "R of the drilling cycle would lead away from the hole, so it is taken as a place "
            "along Z (assumption)"
        )
    inwards = math.copysign(1.0, bottom.z - initial.z)
    passes_bottom = (bottom.z - z) * inwards < 0.0
    goes_away = (z - initial.z) * inwards < 0.0
    # LinuxCNC goes to R first, also if it starts nearer to the hole.
    if passes_bottom or (goes_away and not control.linuxcnc):
        raise BlockError(
            f"R{word.text} is not between the start of the drilling cycle and the hole's bottom"
        )
    return Point(z, initial.x)


def _feed_of(
    control: Control, is_thread: bool, angle: float = 0.0
) -> contextlib.AbstractContextManager[None]:
    """Return a context in which the feed in force is a lead, if the cycle cuts a thread.

    The thread begins at an angle of the spindle [degrees].
    """
    if is_thread:
        return control.thread_feed(control.feed.value / control.length_scale, angle)
    return contextlib.nullcontext()


# Boxes: G90, G92 and G94 of system A.


def run_box(control: Control, code: int, line: Line) -> None:
    """Run G90, G92 or G94: a box from the tool's position and back.

    They are modal: words that are left out stay as in the block before.
    """
    start = control.here
    before = control.cycle.box
    if line.codes & control.dialect.boxes.keys():
        before = Box(start)
    target = control.target(line)
    z = target.z if line.first("Z", "W") else before.end.z
    x = target.x if line.first("X", "U") else before.end.x
    taper = before.taper
    # R, or I and K of Haas and of Fanuc's older format.
    taper_word = line.first("R", "K" if code == 94 else "I")
    if taper_word:
        taper = control.length(taper_word)
    control.cycle.box = Box(Point(z, x), taper)

    is_thread = code == 92
    end = Stop(Point(z, x), rapid=False)
    if code == 94:
        first = Stop(Point(z + taper, start.x), rapid=True)
        third = Stop(Point(start.z, x), rapid=False)
    else:
        first = Stop(Point(start.z, x + taper), rapid=True)
        # G92 leaves its thread rapidly, G90 its cylinder at feed.
        third = Stop(Point(z, start.x), rapid=is_thread)
    kind: Kind = "thread" if is_thread else "feed"
    with _feed_of(control, is_thread, start_angle(line)):
        box = list(straight_paths(start, first, end, third, Stop(start, rapid=True)))
        add_passes(control, [box], kind)
