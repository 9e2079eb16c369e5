"""The words of a block that a control understands; it names all others, and goes on without them.

A word may be unknown to the dialect, or have no meaning beside the others of its block. Each
function returns the line with the words that stay.
"""

import re
from collections.abc import Callable

from turning_nc.control import Control
from turning_nc.dialects import NOT_READ, NOT_READ_CODES
from turning_nc.interpolation import ARCS, MOTIONS, THREADS
from turning_nc.modal import COORDINATES
from turning_nc.words import BlockError, Line, Word

DWELL = 4  # G4
LOCAL_SHIFT = 52  # G52

# Words that say how a block moves, beside its coordinates.
PARAMETERS = frozenset("IKRPQDLA") | {"CR", "ANG", ",A", ",C", ",R", "CHR", "CHF", "RND"}

# Addresses that stand once in a block.
ONCE = frozenset("XZUWIJKRPQDLFST") | {"CR", "ANG", "LIMS"}
SAME_AXIS = {"U": "X", "W": "Z"}  # increments of Fanuc's system A, by their axes

# Addresses of the parameters that have a meaning in some blocks only, such as I and K in an arc.
OF_SOME_BLOCKS = frozenset("IJKRPQDELA") | {
    "CR",
    "ANG",
    "SF",
    ",A",
    ",C",
    ",R",
    "CHR",
    "CHF",
    "RND",
}

# Axes of mill-turn machines; at 0 they do not change how a tool turns.
NULL_AXES = frozenset("YVCBA")

# Controls take such a label, A1:, for a word with a number.
_LABEL_LIKE_A_WORD = re.compile(r"[A-Z]\d\w*:")
MACHINE_AXES = frozenset({"X1", "Z1", "Y1", "C1"})
NULL_NOTE = "words of Y, V, C, B or A that are 0 have no effect in turning"


def _kept(line: Line, keeps: Callable[[Word], bool]) -> Line:
    """Return the line with the words that a function keeps."""
    words = [word for word in line.words if keeps(word)]
    return line if len(words) == len(line.words) else line.with_words(words)


# Words of the dialect.


def single_words(control: Control, line: Line) -> Line:
    """Return the line without the second word of an address that a block may hold once.

    Some controls stop at it; the others differ in which of the two words they take.
    """
    # The time of a dwell may be a second S or F.
    if DWELL in line.codes:
        return line
    known: set[str] = set()

    def is_first(word: Word) -> bool:
        if word.address not in ONCE or word.value is None:
            return True
        if word.address in known:
            control.refuse(f"{word.address}{word.text} is the second {word.address} of its block")
            return False
        axis = SAME_AXIS.get(word.address, "")
        if axis and line.first(axis) and control.fanuc:
            control.refuse(f"{axis} and {word.address} of one axis exclude each other")
            return False
        known.add(word.address)
        return True

    return _kept(line, is_first)


def known_words(control: Control, line: Line) -> Line:
    """Return the line without labels, null words, and words that the dialect does not have."""
    line = _without_null_shift(control, line)
    foreign = _foreign_functions(control, line)
    taken = _words_of(line, foreign)

    def is_known(word: Word) -> bool:
        if _LABEL_LIKE_A_WORD.match(word.address):
            control.refuse(
                f"the label {word.address} begins like a word: "
                "labels of SINUMERIK begin with two letters"
            )
        if word.address.endswith(":") or word in taken:
            return False
        if _is_null(control, word):
            control.note(NULL_NOTE)
            return False
        if _is_machine_axis(control, word, line):
            return False
        reason = _why_unknown(control, word, line)
        if reason:
            control.refuse(reason)
        return not reason

    known = _kept(line, is_known)
    if foreign:
        left_out = ""
        if control.go_on and len(taken) > 1:
            names = [f"{word.address}{word.text}" for word in taken]
            left_out = f", so {' and '.join(names)} are left out"
        code = min(foreign)
        reason = NOT_READ_CODES.get(code, "") if control.fanuc else ""
        control.refuse(f"G{code:g} is not understood{reason}{left_out}")
    return known


def _without_null_shift(control: Control, line: Line) -> Line:
    """Return the line without a local shift of the zero point, G52, by 0."""
    coordinates = [word for word in line.words if word.address in COORDINATES]
    shifts = any(word.value for word in coordinates)
    if not control.fanuc or line.codes != {LOCAL_SHIFT} or not coordinates or shifts:
        return line
    control.note("G52 with zeros does not shift the zero point")

    def stays(word: Word) -> bool:
        return word.address != "G" and word.address not in COORDINATES

    return _kept(line, stays)


def _is_null(control: Control, word: Word) -> bool:
    """Return whether a word is 0 and of an axis that turning does not use, such as Y0 or C0."""
    is_axis = word.address in NULL_AXES and word.address not in control.dialect.addresses
    return is_axis and word.value == 0.0


def _is_machine_axis(control: Control, word: Word, line: Line) -> bool:
    """Return whether a word only names an axis that goes to its reference point, such as X1=0.

    SINUMERIK writes machine axes so. Both axes go there, whichever the block names (assumption).
    """
    if control.fanuc or not line.codes & control.dialect.references:
        return False
    return word.address in MACHINE_AXES


def _foreign_functions(control: Control, line: Line) -> set[float]:
    """Return G functions that are not understood, but take the coordinates of their block.

    Coordinates beside a function that moves are that function's.
    """
    dialect = control.dialect
    understood = MOTIONS | dialect.references | dialect.cycles.keys()
    if line.codes & understood:
        return set()
    return line.codes & (dialect.takes_coordinates - dialect.codes)


def _words_of(line: Line, functions: set[float]) -> list[Word]:
    """Return the words of functions that are not understood, with the coordinates they take."""
    if not functions:
        return []
    taken = PARAMETERS | set(COORDINATES)
    # P and L are the sub-program's, and how often it is called.
    if line.has("M", 98):
        taken -= {"P", "L"}
    words = []
    for word in line.words:
        is_function = word.address == "G" and word.value in functions
        if is_function or word.address in taken:
            words.append(word)
    return words


def _why_unknown(control: Control, word: Word, line: Line) -> str:
    """Return why the dialect does not have a word; empty if it does."""
    name = word.address
    dialect = control.dialect
    if word.fault:
        return word.fault
    if word.is_call:
        if name in dialect.names or name in control.program.parts:
            return ""
        call = name if word.arguments is None else f"{name}()"
        return f"{call} is not understood{NOT_READ.get(name, '')}"
    if name not in dialect.addresses:
        equals = "=" if name[1:].isalnum() else ""
        hint = "" if control.fanuc else NOT_READ.get(name, "")
        # A chamfer is ,C on a Fanuc; C alone is a rotary axis.
        if control.fanuc and name == "C" and line.first(*COORDINATES):
            hint = "; write ,C for a chamfer between moves"
        return f"the address {name}{equals} is not understood{hint}"
    if name == "G" and word.value is not None and word.value not in dialect.codes:
        return f"G{word.value:g} is not understood"
    return ""


# Words that belong together.

# Modes of which a block may hold one: coordinates, feed, speed, compensation and X as a diameter.
_MODES = ({90, 91}, {94, 95}, {98, 99}, {96, 97}, {40, 41, 42}, {7, 8})


def with_one_mode(control: Control, line: Line) -> Line:
    """Return the line without the modes of a group of which it states several.

    Some controls stop at them; the others differ in which of them they take.
    """
    dialect = control.dialect
    for group in (*_MODES, dialect.units.keys(), dialect.cycles.keys() | dialect.references):
        stated = line.codes & group
        if len(stated) > 1:
            names = " and ".join(f"G{code:g}" for code in sorted(stated))
            control.refuse(f"{names} exclude each other")
            line = _without_functions(line, stated)
    return line


def _without_functions(line: Line, codes: set[float]) -> Line:
    """Return the line without some G functions."""
    return _kept(line, lambda word: word.address != "G" or word.value not in codes)


def with_one_motion(control: Control, line: Line) -> Line:
    """Return the line without its move if it states several kinds of moves.

    They are one group of ISO 6983, of which a block may hold one.
    """
    motions = line.codes & MOTIONS
    if len(motions) < 2:
        return line
    names = " and ".join(f"G{code:g}" for code in sorted(motions))
    control.refuse(f"{names} exclude each other")

    def is_beside_move(word: Word) -> bool:
        if word.address == "G":
            return word.value not in motions
        return word.address not in PARAMETERS and word.address not in COORDINATES

    return _kept(line, is_beside_move)


def meaningful_words(control: Control, line: Line, codes: set[float]) -> Line:
    """Return the line without words that have no meaning in it.

    Each of them is a problem of the program, except a rotary axis at 0: it turns nothing.
    """
    meaningless = OF_SOME_BLOCKS - _addresses_used(control, line, codes)

    def has_meaning(word: Word) -> bool:
        if word.address not in meaningless or word.value is None:
            return True
        if word.address == "A" and word.value == 0.0:
            control.note(NULL_NOTE)
            return False
        hint = _hint_at(word, line) if control.fanuc else ""
        control.refuse(f"{word.address}{word.text} has no meaning in this block{hint}")
        return False

    return _kept(line, has_meaning)


def _hint_at(word: Word, line: Line) -> str:
    """Return what to write for a word of a Fanuc that has no meaning in its block."""
    if word.address == "R":
        return "; write ,R for a radius between moves"
    if word.address in ("I", "K") and line.first(*COORDINATES):
        return "; write ,C for a chamfer between moves"
    if word.address == "P" and line.has("M", 99):
        return "; M99 returns behind its call, and to no other block: write GOTO"
    return ""


def _addresses_used(control: Control, line: Line, codes: set[float]) -> set[str]:
    """Return the addresses, of those that only some blocks use, that a block uses."""
    motion = min(codes & MOTIONS, default=control.motion)
    used: set[str] = set()
    if motion in ARCS:
        used = {"I", "K", control.dialect.arc_radius}
    elif motion in THREADS:
        # Q of a Fanuc is the angle at which one of several threads begins, SF that of SINUMERIK.
        used = {"K", "Q"} if control.fanuc else {"I", "K", "SF"}
    if _may_move(control, line, codes):
        # ``interpolation`` judges corners beside moves.
        used |= set(control.dialect.corners)
        # The angle of a move gives its other coordinate.
        coordinates = [word for word in line.words if word.address in COORDINATES]
        if len(coordinates) == 1 and motion not in ARCS:
            used |= {"A", ",A", "ANG"}
    if control.fanuc:
        return used | _addresses_used_by_fanuc(control, line, codes=codes, motion=motion)
    # L is a sub-program of SINUMERIK, D the tool's edge, P how often a sub-program is called.
    used |= {"D", "L"}
    for word in line.words:
        if word.address == "L" or word.address in control.program.parts:
            used.add("P")
    return used


def _may_move(control: Control, line: Line, codes: set[float]) -> bool:
    """Return whether a block's coordinates are those of a move, and not of a cycle or function."""
    dialect = control.dialect
    others = dialect.cycles.keys() | dialect.references | dialect.spindle_limits | {DWELL}
    is_box = control.fanuc and control.motion in (90, 92, 94) and not codes & MOTIONS
    return not (codes & others or is_box or line.first("CYCLE95", "CYCLE97", "TRANS", "ATRANS"))


def _addresses_used_by_fanuc(
    control: Control, line: Line, *, codes: set[float], motion: float | None
) -> set[str]:
    """Return the addresses that a Fanuc's cycles, calls and functions use in a block."""
    cycle = control.function(codes)
    used: set[str] = set()
    if cycle:
        used |= _addresses_of_cycle(control, line, cycle)
    elif motion in (90, 92, 94):
        # Boxes replace the motion in force: R is their taper; I or K are on some controls.
        used = {"R", "K" if motion == 94 else "I"}
        # Q of G92 is the angle at which one of several threads begins.
        if motion == 92:
            used.add("Q")
    if line.has("M", 98) or line.has("M", 97):
        used |= {"P", "L"}
    elif codes & {4, 30, 54, 54.1, 64, 103, 154, 187}:
        used.add("P")
    # The tolerances of LinuxCNC, G64 P0.01 Q0.01, change no path that is computed here.
    if 64 in codes:
        used.add("Q")
    # The corner's tolerance of Haas, G187 P1 E0.01, changes no path that is computed here.
    if 187 in codes:
        used.add("E")
    if 96 in codes:
        used.add("D")
    return used


def _addresses_of_cycle(control: Control, line: Line, cycle: int) -> set[str]:
    """Return the addresses, of those that only some blocks use, of a cycle as system A numbers it.

    Cycles of two blocks have words of their own in each; the second has coordinates, or P and Q.
    """
    if cycle == 76 and (control.linuxcnc or line.first("J")):
        return set("PQRIJKEL")
    if cycle == 70:
        return {"P", "Q", "D"}
    if cycle <= 73:
        names_contour = line.first("P") is not None and line.first("Q") is not None
        return set("PQDIK") if names_contour else {"R"}
    if cycle >= 81:
        return set("PQRK")
    if not line.first(*COORDINATES):
        return set("PQR") if cycle == 76 else {"R"}
    if cycle == 76:
        is_single = line.first("K") and line.first("D")
        return set("PQDIKA") if is_single else set("PQR")
    return set("PQRDIK")


def beside_cycle(control: Control, line: Line) -> Line:
    """Return the line without what a block with a cycle of SINUMERIK may not hold: a move."""
    cycle = line.first("CYCLE95", "CYCLE97")
    if cycle is None:
        return line

    def stays(word: Word) -> bool:
        if word.address not in COORDINATES and word.address != "F":
            return True
        shown = f"{word.address}{word.text}"
        control.refuse(f"{shown} beside {cycle.address} must be a block of its own")
        return False

    return _kept(line, stays)


# Dwells.


def dwell_word(control: Control, line: Line) -> Word | None:
    """Return the word that holds the time of G4.

    It is the first after G4 that can, else the last before it.
    """
    addresses = {"X", "U", "P"} if control.fanuc else {"F", "S"}
    is_dwell = [word.address == "G" and word.value == DWELL for word in line.words]
    place = is_dwell.index(True)
    before = line.words[:place]
    behind = line.words[place:]
    for word in (*behind, *reversed(before)):
        if word.address in addresses and word.value is not None:
            return word
    return None


def beside_dwell(control: Control, line: Line, codes: set[float], dwell: Word | None) -> Line:
    """Return the line without the word of its dwell.

    Coordinates have no meaning beside G4, but for LinuxCNC, where G4 with P and a move may share
    a block.
    """
    is_p = dwell is not None and dwell.address == "P"
    moves = control.fanuc and is_p and codes & MOTIONS

    def stays(word: Word) -> bool:
        if word is dwell:
            return False
        if word.address in COORDINATES and not moves:
            control.refuse(f"{word.address}{word.text} has no meaning beside G4")
            return False
        return True

    return _kept(line, stays)


def dwell_time(control: Control, word: Word | None) -> float:
    """Return the time of a dwell [s].

    On a Fanuc, P is in ms, and X and U are in s; on a SINUMERIK, F is in s, and S in revolutions.
    """
    if word is None or word.value is None:
        addresses = "X, U or P" if control.fanuc else "F or S"
        raise BlockError(f"G4 needs its time: {addresses}")
    seconds = word.value
    # P is always whole ms, X and U only if numbers without a point count steps.
    is_in_ms = word.is_whole and (word.address == "P" or control.steps)
    if word.address == "S":
        seconds *= 60.0 / control.spindle_speed()
    elif word.address == "P" and control.linuxcnc:
        control.note("P of G4 is in seconds, as in LinuxCNC")
    elif is_in_ms and word.address in ("P", "X", "U"):
        seconds /= 1000.0
    if seconds < 0.0:
        raise BlockError(f"the dwell is {seconds:g} s, but must not be below 0")
    return seconds
