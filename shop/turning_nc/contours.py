"""Contours of cycles: the paths of their blocks, the side that is turned, and their passes."""

import copy
from collections.abc import Iterable, Sequence
from dataclasses import replace

from turning_nc.control import Control, Kind
from turning_nc.cycles import ContourLines, Side
from turning_nc.modal import Setting
from turning_nc.passes import Pass
from turning_nc.paths import Path, Point
from turning_nc.words import BlockError


def contour_of(control: Control, lines: ContourLines) -> list[Path]:
    """Return the moves of contour blocks, without the one that leads to the contour.

    Raises:
        BlockError: the blocks make fewer than two moves.
    """
    # A copy runs the blocks: they change modal state, but make no moves of the program's.
    inner = copy.copy(control)
    inner.moves = []
    inner.cycle_pass = 0
    inner.corner = None
    inner.feed = Setting(inner.feed.value or 1.0)
    inner.speed = Setting(inner.speed.value or 1.0)
    with inner.deeper():
        inner.run_lines(lines.part, lines.first, lines.end)
        inner.end_corner()
    paths = [
        replace(move.path, line=move.line) for move in inner.moves if move.kind in ("rapid", "feed")
    ]

    # The tool departs from the contour with a rapid move, or with one that ends the compensation.
    blocks = control.program.parts[lines.part][lines.first : lines.end]
    ends_of_compensation = {block.number for block in blocks if 40 in block.codes}
    while len(paths) > 2:
        last = paths[-1]
        departs = last.line in ends_of_compensation and _returns(paths)
        if not (last.rapid or departs):
            break
        paths.pop()
    if len(paths) < 2:
        raise BlockError("the contour has no moves after the one that leads to it")
    return [replace(path, rapid=False) for path in paths[1:]]


def _returns(paths: list[Path]) -> bool:
    """Return whether the last path leads back towards the begin of the contour."""
    begin = paths[1].start  # the first path leads to the contour
    # The corner between the contour and the last path.
    turn = paths[-1].start
    end = paths[-1].end
    back_z = end.z - turn.z
    back_x = end.x - turn.x
    way_z = turn.z - begin.z
    way_x = turn.x - begin.x
    # The scalar product of the way back and of the way from the contour's begin.
    return back_z * way_z + back_x * way_x < 0.0


def radius_per_x(control: Control) -> float:
    """Return the radius over a length along X as it is written: 0.5 if X is a diameter."""
    return control.scaled_x(1.0, incremental=True) / control.length_scale


def choose_side(
    control: Control, contour: Sequence[Path], allowance: Point, facing: bool, machining: str = ""
) -> Side:
    """Return and keep the side of a contour that a cycle turns.

    It is that which the user gives, or that of the kind of machining (CYCLE95). Otherwise it is
    that on which a Fanuc starts: it goes from the start point to the first point of the contour.

    Raises:
        BlockError: the sign of the allowance contradicts the side.
    """
    start = control.here
    line = control.line.number
    places = [contour[0].start]
    for path in contour:
        places.append(path.end)
    if facing:
        heights = [point.z for point in places]
        height = start.z
        stock = allowance.z
    else:
        heights = [point.x for point in places]
        height = start.x
        stock = allowance.x

    # If the tool starts at the height of the contour's first point, the allowance decides, and
    # then where most of the contour lies.
    infeed = height - heights[0]
    upwards = True
    middle = 0.5 * (min(heights) + max(heights))
    for step in (infeed, stock, height - middle):
        if abs(step) > 1e-6:
            upwards = step > 0.0
            break
    why = _way_to_contour(control, height, heights[0], facing=facing)
    given = control.given_sides.get(line)
    machined = given or machining
    if not facing and machined:
        upwards = (machined == "outside") == (start.x >= 0.0)
        why = "as given" if given else "by its kind of machining"
    elif infeed * stock < -1e-9:
        choice = f"correct it, or set --side {line}=outside or {line}=inside"
        if facing:
            choice = "correct the program"
        address = "W" if facing else "U"
        raise BlockError(f"it cuts {why}, but the sign of {address} says the other side: {choice}")
    along_z = [point.z for point in places]
    side = Side(
        upwards,
        why,
        facing=facing,
        start=start,
        reach=(min(along_z), max(along_z)),
        is_settable=not facing,
    )
    control.sides[line] = side
    return side


def _way_to_contour(control: Control, start: float, first: float, facing: bool) -> str:
    """Return the way from the start to the contour as text, with coordinates as written."""
    address = "Z" if facing else "X"
    scale = 1.0 if facing else 1.0 / radius_per_x(control)
    scale /= control.length_scale
    return (
        f"from its start at {address}{start * scale:g} "
        f"to the contour's first point at {address}{first * scale:g}"
    )


def add_passes(control: Control, passes: Iterable[Pass], kind: Kind = "feed") -> None:
    """Add the moves of passes, and number these."""
    for number, paths in enumerate(passes, 1):
        control.cycle_pass = number
        for path in paths:
            control.add(path, "rapid" if path.rapid else kind)
    control.cycle_pass = 0
