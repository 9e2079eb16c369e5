"""The move of one block: straight (G0, G1), along an arc (G2, G3), or of a thread (G32, G33).

The functions are those of ISO 6983, which Fanuc and SINUMERIK share. Arcs and broken corners
differ in their words.
"""

import math

from turning_nc.control import Control
from turning_nc.paths import MAX_RADIUS, Corner, Path, Point, arc_of_radius, shifted
from turning_nc.words import BlockError, Line

RAPID = 0
STRAIGHT = 1
ARCS = (2, 3)
THREADS = (32, 33)
MOTIONS = {RAPID, STRAIGHT, *ARCS, *THREADS}

# Largest difference of an arc's radii at its start and end: [mm], and over the radius [-]. A
# control has a parameter for it.
MAX_MISMATCH = 0.01
MAX_RELATIVE_MISMATCH = 1e-3


def move(control: Control, line: Line, codes: set[float]) -> None:
    """Run the move of a block, if it has one.

    Raises:
        BlockError: the move is not understood, or needs a word that is missing.
    """
    motions = codes & MOTIONS
    if motions:
        control.motion = int(min(motions))
    motion = control.motion
    rounding = line.number_of("RNDM")
    if rounding is not None:
        control.rounding = rounding * control.length_scale
    # A full circle may lack its end.
    is_circle = motion in ARCS and motions and line.first("I", "K")
    if not (line.first("X", "Z", "U", "W") or is_circle):
        if line.first(*control.dialect.corners):
            raise BlockError("a chamfer or a radius needs a move to its corner in the same block")
        return
    if control.is_drilling:
        raise BlockError(
            "the drilling cycle before it holds, and would drill here again, which is not "
            "understood: write the cycle again, or G80"
        )
    if codes & {53, 153} or line.first("SUPA"):
        control.go_home("machine coordinates", line)
        return
    end = control.target(line)
    if motion is None and end != control.here:
        raise BlockError("coordinates precede the first G0 or G1")
    if motion in THREADS:
        with control.thread_feed(_lead(control, line, end), start_angle(line)):
            control.add(Path(control.here, end), "thread")
    elif motion in ARCS:
        control.add(_arc(control, line, end), "feed")
    elif motion == RAPID:
        control.go_rapidly(end)
    else:
        control.add(Path(control.here, end), "feed")
    # A move that was too short to add has no corner.
    if control.moves and control.moves[-1].path.end == end:
        control.corner = _corner(control, line)


def start_angle(line: Line) -> float:
    """Return the angle at which a thread begins: Q of a Fanuc, SF of SINUMERIK [degrees]."""
    word = line.first("Q", "SF")
    if word is None or word.value is None:
        return 0.0
    # Q counts steps of 0.001 degrees.
    return word.value / 1000.0 if word.address == "Q" else word.value


def _lead(control: Control, line: Line, end: Point) -> float:
    """Return the lead of a thread that ends at a point, in the program's units.

    Raises:
        BlockError: the block does not state the lead, or not as its control reads it.
    """
    if not control.fanuc:
        return _lead_along_axis(control, line, end)
    name = f"G{control.motion}"
    # LinuxCNC states leads by K, beside which F is a feed.
    if line.number_of("F") and line.number_of("K") and not control.linuxcnc:
        raise BlockError(f"F and K of {name} both state its lead: leave one out")
    lead = line.number_of("K") or line.number_of("F")
    if lead:
        return lead
    feed = control.feed
    # F of a block before it is a lead unless it has a place, which only feeds have.
    if feed.span is None and feed.value:
        return feed.value / control.length_scale
    hint = ""
    if feed.value:
        hint = "; F of a block before it is read as a feed: write the lead beside it"
    raise BlockError(f"{name} needs its lead: F{hint}")


def _lead_along_axis(control: Control, line: Line, end: Point) -> float:
    """Return the lead of a thread of SINUMERIK: K along Z, or I along X, whichever is longer."""
    name = f"G{control.motion}"
    along_z = abs(end.z - control.z)
    along_x = abs(end.x - control.x)
    if line.first("I") and line.first("K"):
        raise BlockError(f"I and K of {name} both state its lead: leave one out")
    address = "K" if along_z >= along_x else "I"
    # At 45 degrees, both are right.
    lead = line.number_of("I", "K") if along_z == along_x else line.number_of(address)
    if not lead:
        axis = "Z" if address == "K" else "X"
        raise BlockError(f"{name} needs its lead: {address}, as it is longer along {axis}")
    return lead


def _corner(control: Control, line: Line) -> Corner | None:
    """Return the chamfer or the radius at the end of a block's move."""
    word = line.first(*control.dialect.corners)
    if word is not None and word.value:
        if control.motion != STRAIGHT or word.value < 0.0:
            raise BlockError(
                "a chamfer or a radius needs a size above 0, and straight moves at feed, G1"
            )
        kind = control.dialect.corners[word.address]
        return Corner(kind, control.in_mm(word), line=line.number)
    # RNDM of SINUMERIK rounds all corners between moves at feed until RNDM=0.
    if control.rounding > 0.0 and control.motion in (STRAIGHT, *ARCS):
        return Corner("radius", control.rounding, line=line.number, modal=True)
    return None


def _arc(control: Control, line: Line, end: Point) -> Path:
    """Return the path of G2 or G3, from its radius or from its centre."""
    start = control.here
    clockwise = control.motion == 2
    radius = line.first(control.dialect.arc_radius)
    if radius is not None and not control.fanuc and line.first("I", "K"):
        raise BlockError("CR= and a centre, I or K, exclude each other")
    # R of a Fanuc overrides I and K.
    if radius is not None and radius.value is not None:
        return arc_of_radius(start, end, radius=control.in_mm(radius), clockwise=clockwise)
    i = line.first("I")
    k = line.first("K")
    if not (i or k):
        if control.fanuc and not line.codes & {2, 3}:
            control.note(
                f"G{control.motion} holds, but without centre or radius: it moves straight, "
                "as on a Fanuc; is G1 missing?"
            )
            return Path(start, end)
        radius_word = "R" if control.fanuc else "CR="
        raise BlockError(f"G{control.motion} needs a centre or a radius: I and K, or {radius_word}")
    if (i and i.mode == "AC") or (k and k.mode == "AC"):
        raise BlockError("a centre in absolute coordinates, I=AC or K=AC, is not understood")
    # I and K are lengths from the start to the centre; I is a radius, whatever X is.
    to_centre = Point(z=control.in_mm(k), x=control.in_mm(i))
    centre = shifted(start, to_centre)
    first = math.dist(start, centre)
    last = math.dist(end, centre)
    if first > MAX_RADIUS:
        raise BlockError(
            f"an arc of radius {first:g} mm is larger than {MAX_RADIUS:g} mm: is it straight?"
        )
    if not _closes(first, last):
        hint = _hint_at_radius(control, end, to_centre=to_centre)
        raise BlockError(
            f"the arc's radius is {first:.3f} mm at its start, but {last:.3f} mm at its end{hint}"
        )
    return Path(start, end, centre=centre, clockwise=clockwise)


def _closes(first: float, last: float) -> bool:
    """Return whether the radii of an arc at its start and end agree [mm]."""
    allowed = max(MAX_MISMATCH, MAX_RELATIVE_MISMATCH * first)
    return abs(first - last) <= allowed


def _hint_at_radius(control: Control, end: Point, to_centre: Point) -> str:
    """Return a hint if an arc closes with X read as a radius instead of a diameter.

    The hint is the reverse in programs that read X as a radius.
    """
    as_diameter = control.diameter == "DIAMON"
    factor = 2.0 if as_diameter else 0.5
    start = Point(control.z, factor * control.x)
    end = Point(end.z, factor * end.x)
    centre = shifted(start, to_centre)
    if not _closes(math.dist(start, centre), math.dist(end, centre)):
        return ""
    if as_diameter:
        return "; with X as a radius it closes: is the machine set so, --radius?"
    return "; with X as a diameter it closes: is X a radius here?"
