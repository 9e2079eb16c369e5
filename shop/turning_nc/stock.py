"""The stock from which a program cuts: a bar, a tube, a contour of the user's, or a guess.

A stock is a polygon in the half plane of Z and X, X as a radius. ``removal`` takes metal from it.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.drawings import MAX_DIAMETER, MAX_LENGTH, read_contour
from turning_nc.kinds import DRILL, cuts, kinds_of
from turning_nc.modal import HOME
from turning_nc.moves import Move, Moves
from turning_nc.words import NcError
from turning_shop import Values

from turning_env.extras import needed

with needed():
    import shapely

CLEARANCE = 1.0  # distance from the metal at which cuts begin [mm] (assumption)
CLAMPED_LENGTH = 10.0  # by which a guessed bar is longer than its cuts [mm] (assumption)
ON_AXIS = 1e-6  # radius up to which a move is at the axis [mm]

_SIZE = r"(\d+\.?\d*)"
_BAR_OR_TUBE = re.compile(rf"(?:bar:{_SIZE}|tube:{_SIZE}x{_SIZE})x{_SIZE}(?:\+{_SIZE})?")


def read_stock(text: str) -> Any:
    """Return the polygon of a stock.

    Args:
        text: ``bar:DIAMETERxLENGTH`` or ``tube:OUTERxINNERxLENGTH`` [mm], each with ``+FACE`` for
            the metal before Z0; or a DXF file; or a CSV file with Z and the diameter in each row
            [mm].

    Raises:
        NcError: it is none of these, or encloses no area.
        OSError: the file cannot be read.
    """
    match = _BAR_OR_TUBE.fullmatch(text)
    if match is None:
        path = Path(text)
        if path.suffix.lower() in (".dxf", ".csv"):
            return read_contour(path)
        raise NcError(
            f"stock {text!r} is no bar:DIAMETERxLENGTH or tube:OUTERxINNERxLENGTH, in mm without a "
            "unit and with a decimal point, nor a .dxf or .csv file"
        )
    bar = float(match[1] or 0.0)
    tube = float(match[2] or 0.0)
    inner = float(match[3] or 0.0)
    length = float(match[4])
    face = float(match[5] or 0.0)
    outer = bar or tube
    diameters_fit = inner < outer <= MAX_DIAMETER
    lengths_fit = 0.0 < length <= MAX_LENGTH and face <= MAX_LENGTH
    if not (diameters_fit and lengths_fit):
        raise NcError(
            f"stock {text[:60]!r}: sizes must be above 0, and the inner diameter below the outer; "
            f"a diameter of {MAX_DIAMETER:g} mm and a length of {MAX_LENGTH:g} mm at most"
        )
    return shapely.box(-length, inner / 2.0, face, outer / 2.0)


def volume(polygon: Any) -> float:
    """Return the volume of a polygon's body of revolution [mm3] (Pappus's theorem)."""
    if not polygon.area:
        return 0.0
    return float(2.0 * math.pi * polygon.area * polygon.centroid.y)


def guessed_stock(moves: Moves, tools: Mapping[str, str] = {}) -> tuple[Any, str]:
    """Return a stock in which all feed moves lie, and its text as for ``read_stock``.

    It is a bar, or a tube if tools turn inside and no drill of a known diameter makes the hole. A
    cut that begins beyond the metal is taken to begin ``CLEARANCE`` from it.
    """
    kinds = kinds_of(moves, tools)
    turned = _turning_moves(moves, kinds)
    ends = _ends(turned)
    is_inside = np.array([kinds[move.tool].endswith("inside") for move in turned])

    # A bar reaches to the first face that a tool cuts down to the axis.
    face = 0.0
    if ends.radius.max() > ON_AXIS:
        nearer_to_chuck = ends.z.min(axis=1)
        faces = nearer_to_chuck[ends.reaches_axis]
        face = float(faces.max(initial=0.0))
    deepest = float(min(ends.z.min(), -1.0))
    length = CLAMPED_LENGTH - deepest
    radius = _outer_radius(ends)
    bore = 0.0
    is_drilled = any(kind.startswith(f"{DRILL}:") for kind in kinds.values())
    if not is_drilled:
        bore = _bore_radius(moves, ends, is_inside=is_inside, outer_radius=radius)

    diameter = f"{2.0 * radius:g}"
    name = f"bar:{diameter}x{length:g}"
    if bore:
        name = f"tube:{diameter}x{2.0 * bore:g}x{length:g}"
    if face:
        name += f"+{face:g}"
    return shapely.box(-length, bore, face, radius), name


class _Ends(NamedTuple):
    """Start and end (columns) of moves (rows)."""

    z: Values  # [mm]
    radius: Values  # [mm]
    reaches_axis: NDArray[np.bool_]  # of each move


def _turning_moves(moves: Moves, kinds: Mapping[str, str]) -> list[Move]:
    """Return the moves at feed that turn; if there are none, those that drill, or all moves."""
    fed = [move for move in moves.moves if cuts(move) or move.kind == "thread"]
    if not fed:
        fed = list(moves.moves)
    turned = [move for move in fed if not kinds[move.tool].startswith(DRILL)]
    return turned or fed


def _ends(turned: list[Move]) -> _Ends:
    points = np.array([(move.path.start, move.path.end) for move in turned])
    z = points[:, :, 0]
    x = points[:, :, 1]

    # A feed that comes from the reference point says nothing of the stock.
    at_home = (x == HOME[1]) & (z == HOME[0])
    z = np.where(at_home, 0.0, z)
    x = np.where(at_home, 0.0, x)
    radius = abs(x)
    touches_axis = radius.min(axis=1) < ON_AXIS
    crosses_axis = x.prod(axis=1) < 0.0

    # A plunge begins in the air, so only its end counts, if there are other moves.
    start_z = z[:, 0]
    end_z = z[:, 1]
    start_radius = radius[:, 0]
    end_radius = radius[:, 1]
    is_inwards = end_radius < start_radius
    is_plunge = (start_z == end_z) & (start_z < 0.0) & is_inwards
    if not is_plunge.all():
        radius[:, 0] = np.where(is_plunge, end_radius, start_radius)
    return _Ends(z, np.asarray(radius), reaches_axis=touches_axis | crosses_axis)


def _outer_radius(ends: _Ends) -> float:
    """Return the radius of the bar [mm]."""
    largest = ends.radius.max()
    is_within = ends.z < 0.0
    within_bar = ends.radius[is_within].max(initial=0.0)
    radius = float(max(within_bar, largest - CLEARANCE, 0.5 * largest, 1.0))

    # The first pass along Z cuts, too.
    start_radius = ends.radius[:, 0]
    end_radius = ends.radius[:, 1]
    is_along = (start_radius == end_radius) & (ends.z[:, 1] < 0.0)
    widest_pass = float(end_radius[is_along].max(initial=0.0))
    if widest_pass >= radius:
        radius = widest_pass + CLEARANCE
    return radius


def _bore_radius(
    moves: Moves, ends: _Ends, is_inside: NDArray[np.bool_], outer_radius: float
) -> float:
    """Return the radius of the hole in which tools turn [mm]; 0 if none does."""
    sides = moves.sides.values()
    starts = [abs(side.start[1]) for side in sides if side.name == "inside"]
    if starts:
        return min(starts) % outer_radius
    is_cut_inside = is_inside[:, np.newaxis] & (ends.z < 0.0)
    smallest = float(ends.radius[is_cut_inside].min(initial=outer_radius))
    if smallest >= outer_radius:
        return 0.0
    return max(smallest - CLEARANCE, 0.5 * smallest) % outer_radius
