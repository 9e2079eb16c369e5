"""Stock minus the swept tool: depth of cut, diameter and removed volume along every move.

Polygons lie in the half plane of Z and X, X as a radius. The tool is a sharp convex insert whose tip follows the programmed path,
as a control with tool radius compensation makes it; its nose radius is neglected (assumption).
"""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from turning_nc.kinds import DRILL, cuts, kinds_of
from turning_nc.modal import HOME
from turning_nc.moves import Moves
from turning_nc.paths import Point
from turning_nc.words import MAX_BYTES, NcError
from turning_shop import regular_file

from turning_env.extras import needed

with needed():
    import shapely


CLEARANCE = 1.0  # distance from the metal at which cuts begin [mm] (assumption)
MAX_DIAMETER, MAX_LENGTH = 1e4, 1e5  # of a stock [mm]


def read_stock(text: str) -> Any:
    """Return the polygon of a stock.

    Its text is ``bar:DIAMETERxLENGTH`` or ``tube:OUTERxINNERxLENGTH``, each with ``+FACE`` for the metal before Z0; or a DXF
    file, or a CSV file with Z and the diameter in each row [mm].

    Raises:
        NcError: it is none of these, or encloses no area; says which.
        OSError: the file cannot be read.
    """
    size = r"(\d+\.?\d*)"
    if match := re.fullmatch(rf"(?:bar:{size}|tube:{size}x{size})x{size}(?:\+{size})?", text):
        bar, tube, inner, length, face = (float(found or 0.0) for found in match.groups())
        outer = bar or tube
        if not (
            inner < outer <= MAX_DIAMETER and 0.0 < length <= MAX_LENGTH and face <= MAX_LENGTH
        ):
            largest = f"a diameter of {MAX_DIAMETER:g} mm and a length of {MAX_LENGTH:g} mm at most"
            raise NcError(
                f"stock {text[:60]!r}: sizes must be above 0, and the inner diameter below the outer; {largest}"
            )
        return shapely.box(-length, inner / 2.0, face, outer / 2.0)
    path = Path(text)
    if path.suffix.lower() not in (".dxf", ".csv"):
        raise NcError(
            f"stock {text!r} is no bar:DIAMETERxLENGTH, tube:OUTERxINNERxLENGTH, nor a .dxf or .csv file"
        )
    return _closed(_dxf_lines(path) if path.suffix.lower() == ".dxf" else [_csv_points(path)], path)


def _csv_points(path: Path) -> list[Point]:
    points: list[Point] = []
    for number, line in enumerate(
        regular_file(path, MAX_BYTES).read_text("utf-8-sig", "replace").splitlines(), 1
    ):
        if not line.strip(" ,") or line.lstrip().startswith("#"):
            continue
        try:
            z, diameter = map(float, line.split(","))
        except ValueError:
            if number == 1:  # a header
                continue
            raise NcError(
                f"{path}: line {number}: {line[:40]!r} is not Z and the diameter in mm"
            ) from None
        if not (abs(z) <= MAX_LENGTH and 0.0 <= diameter <= MAX_DIAMETER):
            raise NcError(
                f"{path}: line {number}: Z must be within {MAX_LENGTH:g} mm, the diameter 0 to {MAX_DIAMETER:g} mm"
            )
        points.append((z, diameter / 2.0))
    return points


def _dxf_lines(path: Path) -> list[list[Point]]:
    """Return the lines of a DXF drawing; its X is Z, its Y the radius."""
    with needed():
        import ezdxf
        import ezdxf.path
        from ezdxf.lldxf.tagwriter import TagCollector
    regular_file(path, MAX_BYTES)
    try:
        drawing = ezdxf.readfile(path)
    except Exception as error:  # the package raises errors of many types for damaged files
        raise NcError(f"{path}: is no DXF drawing: {error}") from None
    units = {0: 1.0, 1: 25.4, 4: 1.0, 5: 10.0, 6: 1000.0}.get(drawing.units)
    if units is None:
        raise NcError(f"{path}: its unit ($INSUNITS {drawing.units}) is not mm, cm, m or inch")
    kinds = {"LINE", "ARC", "LWPOLYLINE", "POLYLINE", "SPLINE", "CIRCLE", "ELLIPSE"}
    lines = []
    for entity in drawing.modelspace():
        if entity.dxftype() not in kinds:
            raise NcError(
                f"{path}: a {entity.dxftype()} is not understood; a contour is made of {', '.join(sorted(kinds))}"
            )
        numbers = [
            tag.value for tag in TagCollector.dxftags(entity) if isinstance(tag.value, float)
        ]
        if not all(abs(number) <= MAX_LENGTH for number in numbers):
            raise NcError(
                f"{path}: {entity} has a number that is not finite or above {MAX_LENGTH:g}"
            )
        try:
            points = list(ezdxf.path.make_path(entity).flattening(0.005))
        except (ValueError, ArithmeticError, ezdxf.DXFError) as error:
            raise NcError(f"{path}: {entity} is no curve: {error}") from None
        line = [(units * point.x, units * point.y) for point in points]
        if any(max(abs(z), abs(x)) > MAX_LENGTH for z, x in line):
            raise NcError(
                f"{path}: {entity} reaches beyond {MAX_LENGTH:g} mm: is its unit ($INSUNITS) right?"
            )
        lines.append(line)
    return lines


def _closed(lines: Sequence[Sequence[Point]], path: Path) -> Any:
    """Return the area that lines enclose, closed along the axis if they do not close themselves."""
    chains = [shapely.LineString(line) for line in lines if len(line) > 1]
    merged = shapely.line_merge(shapely.set_precision(shapely.union_all(chains), 1e-4))
    areas = list(shapely.get_parts(shapely.polygonize([shapely.node(merged)])))
    if not areas and isinstance(merged, shapely.LineString) and merged.length:
        points = list(merged.coords)
        areas = [shapely.Polygon([*points, (points[-1][0], 0.0), (points[0][0], 0.0)])]
    area = shapely.union_all(areas)
    if not area.is_valid or area.area < 1e-6:
        raise NcError(
            f"{path}: its lines enclose no area: close the contour, or end it on the axis"
        )
    if area.bounds[1] < -1e-6:
        raise NcError(
            f"{path}: the contour reaches below the axis: draw only the half above it, with the axis at 0"
        )
    return area


def guessed_stock(moves: Moves, tools: Mapping[str, str] = {}) -> tuple[Any, str]:
    """Return a bar that all feed moves lie in, or a tube if cycles turn inside a hole of no known drill; and its name.

    A cut that begins beyond the metal is taken to begin ``CLEARANCE`` from it.
    """
    kinds = kinds_of(moves, tools)
    fed = [move for move in moves.moves if cuts(move) or move.kind == "thread"] or list(moves.moves)
    turned = [move for move in fed if not kinds[move.tool].startswith(DRILL)] or fed
    z, x = np.array([point for move in turned for point in (move.path.start, move.path.end)]).T
    z, x = np.where((x == HOME[1]) & (z == HOME[0]), 0.0, (z, x))  # a feed from the reference point
    inside = np.repeat([kinds[move.tool].endswith("inside") for move in turned], 2)
    ends = np.array([x[::2], x[1::2]])
    axial = np.repeat(
        (abs(ends).min(axis=0) < 1e-6) | (ends.prod(axis=0) < 0.0), 2
    )  # moves that reach the axis
    x = abs(x)
    plunges = (z[::2] == z[1::2]) & (z[::2] < 0.0) & (x[1::2] < x[::2])  # which begin in the air
    if not plunges.all():
        x[::2] = np.where(plunges, x[1::2], x[::2])
    lower = np.repeat(np.minimum(z[::2], z[1::2]), 2)
    face = (
        float(lower[axial].max(initial=0.0)) if x.max() > 1e-6 else 0.0
    )  # of the bar, if the tool goes to its axis
    length = 10.0 - float(min(z.min(), -1.0))
    radius = float(max(x[z < 0.0].max(initial=0.0), x.max() - CLEARANCE, 0.5 * x.max(), 1.0))
    cut = float(x[1::2][(x[::2] == x[1::2]) & (z[1::2] < 0.0)].max(initial=0.0))
    radius = cut + CLEARANCE if cut >= radius else radius  # the first pass along Z cuts, too
    drilled = any(kind.startswith(f"{DRILL}:") for kind in kinds.values())
    starts = [abs(side.start[1]) for side in moves.sides.values() if side.name == "inside"]
    least = float(x[inside & (z < 0.0)].min(initial=radius))
    bore = (
        0.0
        if drilled
        else min(starts or [max(least - CLEARANCE, 0.5 * least) if least < radius else 0.0])
        % radius
    )
    name = (
        f"tube:{2.0 * radius:g}x{2.0 * bore:g}x{length:g}"
        if bore
        else f"bar:{2.0 * radius:g}x{length:g}"
    )
    return shapely.box(-length, bore, face, radius), name + (f"+{face:g}" if face else "")


def volume(polygon: Any) -> float:
    """Return the volume of a polygon's body of revolution [mm3], by Pappus."""
    return float(2.0 * math.pi * polygon.area * polygon.centroid.y) if polygon.area else 0.0
