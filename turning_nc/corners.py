"""Chamfers and radii that a control puts between two straight moves."""

import math
from dataclasses import dataclass
from typing import Literal

from turning_nc.blocks import Problem
from turning_nc.paths import Path, Point


@dataclass(frozen=True)
class Corner:
    """What a block says of the corner at its end."""

    kind: Literal["legs", "chord", "radius"]
    """What ``size`` measures: a chamfer's legs, the chamfer itself, or a radius."""
    size: float  # [mm]
    line: int
    modal: bool = False
    """Whether it holds for all corners between moves at feed (RNDM)."""


def break_corner(before: Path, after: Path, corner: Corner) -> tuple[Path, Path | None, Path]:
    """Return two moves that end where a corner is broken, and the chamfer or the arc between them.

    Raises:
        Problem: a move is an arc, or too short for the corner.
    """
    if before.centre or after.centre:
        raise Problem("a chamfer or a radius beside an arc is not understood: write its points")
    first, second = _direction(before), _direction(after)
    cross = first[0] * second[1] - first[1] * second[0]
    turn = math.atan2(cross, first[0] * second[0] + first[1] * second[1])
    if abs(turn) < 1e-6:
        return before, None, after
    half = 0.5 * abs(turn)
    cut = corner.size * {"legs": 1.0, "chord": 0.5 / math.cos(half), "radius": math.tan(half)}[corner.kind]
    if cut > min(before.length, after.length) + 1e-6:
        raise Problem(f"the chamfer or radius of line {corner.line} takes {cut:.3f} mm of a move that is shorter")
    start, end = _along(before.end, first, -cut), _along(after.start, second, cut)
    centre = None
    if corner.kind == "radius":
        side = math.copysign(corner.size, turn)
        centre = start[0] - side * first[1], start[1] + side * first[0]
    return Path(before.start, start), Path(start, end, centre, turn < 0.0), Path(end, after.end)


def _direction(path: Path) -> Point:
    return (path.end[0] - path.start[0]) / path.length, (path.end[1] - path.start[1]) / path.length


def _along(point: Point, direction: Point, length: float) -> Point:
    return point[0] + length * direction[0], point[1] + length * direction[1]
