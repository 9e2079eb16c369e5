"""Shapes of tools: the corners of inserts, grooving tools and drills, relative to their tips.

A tool is a sharp convex insert whose tip follows the programmed path, as a control with tool radius
compensation makes it. Its nose radius is neglected (assumption).
"""

import math
import re
from collections.abc import Iterable

import numpy as np
from turning_nc.kinds import DRILL, MAX_WIDTH, MIN_WIDTH
from turning_nc.paths import shifted
from turning_nc.words import NcError
from turning_shop import Values

_EDGE = (
    25.0  # length of the insert's edges [mm]; longer than a real one's, as the holder follows it
)


ANGLES = {"outside": (5.0, 85.0), "copying": (52.0, 87.0), "neutral": (72.5, 107.5)}
"""Angles of an insert's edges from the Z axis [degrees]: corners of 80 degrees for turning and facing, of 35 for other work."""
KINDS = f"{', '.join(ANGLES)}, also with -left and -inside; inside, left, left-inside; groove:WIDTH(-inside), drill:DIAMETER"


def _insert(first: float, second: float, marks: Iterable[str]) -> Values:
    """Return the corners of an insert with its tip at the origin: right-hand and for outside, if it is not marked otherwise."""
    a, b = (
        (_EDGE * math.cos(math.radians(angle)), _EDGE * math.sin(math.radians(angle)))
        for angle in (first, second)
    )
    return np.array(((0.0, 0.0), a, shifted(a, b), b)) * (
        -1.0 if "left" in marks else 1.0,
        -1.0 if "inside" in marks else 1.0,
    )


def tool_shape(kind: str, slim: bool = False) -> Values | None:
    """Return the corners of a tool; None if it removes nothing, as a drill without a diameter.

    The tip of a grooving tool is its left corner. ``slim`` gives an insert of 80 degrees the back of a copying one.

    Raises:
        NcError: there is no such kind.
    """
    shape, *marks = (
        kind.split("-") if kind.split("-")[0] in ANGLES else ("outside", *kind.split("-"))
    )
    if set(marks) <= {"left", "inside"} and len(set(marks)) == len(marks):
        first, second = ANGLES[shape]
        return _insert(
            ANGLES["copying"][0] if slim and shape == "outside" else first, second, marks
        )
    match = re.fullmatch(r"(groove|drill):(\d+\.?\d*)(?:(?<=\d)(-inside))?", kind)
    if kind != DRILL and (match is None or not MIN_WIDTH <= float(match[2]) <= MAX_WIDTH):
        raise NcError(f"{kind!r} is no kind of tool: {KINDS}, {MIN_WIDTH:g} to {MAX_WIDTH:g} mm")
    if match is None:
        return None
    width = float(match[2])
    if match[1] == DRILL:  # with a flat end
        return np.array(
            ((0.0, -width / 2.0), (1000.0, -width / 2.0), (1000.0, width / 2.0), (0.0, width / 2.0))
        )
    return np.array(((0.0, 0.0), (width, 0.0), (width, _EDGE), (0.0, _EDGE))) * (
        1.0,
        -1.0 if match[3] else 1.0,
    )
