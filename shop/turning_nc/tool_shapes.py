"""Shapes of tools: the corners of inserts, grooving tools and drills, relative to their tips.

A tool is a sharp convex insert whose tip follows the programmed path, as a control with tool radius
compensation makes it. Its nose radius is neglected (assumption). ``kinds`` finds out which kind a
tool is.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from turning_nc.kinds import DRILL, FACE_GROOVE, MAX_WIDTH, MIN_WIDTH
from turning_nc.paths import shifted
from turning_nc.words import NcError
from turning_shop import Values

# Length of an insert's edges [mm]. It is longer than a real one's, as the holder follows it.
EDGE_LENGTH = 25.0
DRILL_LENGTH = 1000.0  # [mm]


@dataclass(frozen=True)
class EdgeAngles:
    """Angles of both edges of an insert from the Z axis [degrees]."""

    first: float
    second: float


ANGLES = {
    "outside": EdgeAngles(5.0, 85.0),
    "copying": EdgeAngles(52.0, 87.0),
    "neutral": EdgeAngles(72.5, 107.5),
}
"""Inserts with a corner of 80 degrees for turning and facing, of 35 degrees for other work."""
_MARKS = {"groove": "-inside", FACE_GROOVE: "-outer", DRILL: ""}
"""Marks that may follow tools with a width."""
_WITH_WIDTH = re.compile(r"(groove|face-groove|drill):(\d+(?:\.\d+)?)(-inside|-outer)?")
KINDS = (
    f"{', '.join(ANGLES)}, also with -left and -inside; inside, left, left-inside; "
    "groove:WIDTH(-inside), face-groove:WIDTH(-outer), drill:DIAMETER"
)


def tool_shape(kind: str, slim: bool = False) -> Values | None:
    """Return the corners of a tool; None if it removes nothing, as a drill without a diameter.

    The tip of a grooving tool is its left corner; of one for faces, its corner nearer to the axis,
    or the other one with -outer.

    Args:
        kind: one of ``KINDS``.
        slim: whether an insert of 80 degrees gets the back of a copying one.

    Returns:
        Z and radius relative to the tip [mm], shape (corners, 2).

    Raises:
        NcError: there is no such kind.
    """
    if kind == DRILL:
        return None
    name, *marks = kind.split("-")
    if name not in ANGLES:  # such as "left": an outside insert with that mark
        marks = [name, *marks]
        name = "outside"
    distinct = set(marks)
    is_marked_once = len(distinct) == len(marks)
    if is_marked_once and distinct <= {"left", "inside"}:
        angles = ANGLES[name]
        if slim and name == "outside":
            back = ANGLES["copying"].first
            angles = EdgeAngles(first=back, second=angles.second)
        return _insert(angles, marks)
    match = _WITH_WIDTH.fullmatch(kind)
    is_known = match is not None and match[3] in (None, _MARKS[match[1]])
    if match is None or not (is_known and MIN_WIDTH <= float(match[2]) <= MAX_WIDTH):
        raise NcError(
            f"{kind!r} is no kind of tool: {KINDS}, {MIN_WIDTH:g} to {MAX_WIDTH:g} mm; "
            "a scenario's name ends in .toml"
        )
    family = match[1]
    width = float(match[2])
    is_marked = match[3] is not None
    if family == DRILL:
        return _drill(diameter=width)
    if family == FACE_GROOVE:
        return _face_grooving_tool(width, is_outer=is_marked)
    return _grooving_tool(width, is_inside=is_marked)


def _insert(angles: EdgeAngles, marks: Sequence[str]) -> Values:
    """Return the corners of an insert: right-hand and for outside unless marked otherwise."""
    tip = (0.0, 0.0)
    first = _edge_end(angles.first)
    second = _edge_end(angles.second)
    opposite = shifted(first, second)
    corners = np.array((tip, first, opposite, second))
    along = -1.0 if "left" in marks else 1.0
    across = -1.0 if "inside" in marks else 1.0
    return corners * (along, across)


def _edge_end(angle: float) -> tuple[float, float]:
    """Return where an edge ends that leaves the tip at an angle from the Z axis [degrees]."""
    radians = math.radians(angle)
    return EDGE_LENGTH * math.cos(radians), EDGE_LENGTH * math.sin(radians)


def _drill(diameter: float) -> Values:
    """Return the corners of a drill with a flat end."""
    radius = diameter / 2.0
    return np.array(
        ((0.0, -radius), (DRILL_LENGTH, -radius), (DRILL_LENGTH, radius), (0.0, radius))
    )


def _grooving_tool(width: float, is_inside: bool) -> Values:
    """Return the corners of a grooving tool."""
    corners = np.array(((0.0, 0.0), (width, 0.0), (width, EDGE_LENGTH), (0.0, EDGE_LENGTH)))
    across = -1.0 if is_inside else 1.0
    return corners * (1.0, across)


def _face_grooving_tool(width: float, is_outer: bool) -> Values:
    """Return the corners of a tool that cuts grooves into faces."""
    corners = np.array(((0.0, 0.0), (EDGE_LENGTH, 0.0), (EDGE_LENGTH, width), (0.0, width)))
    across = -1.0 if is_outer else 1.0
    return corners * (1.0, across)
