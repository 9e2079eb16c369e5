"""Stock minus the swept tool: depth of cut, diameter and removed volume along every move.

Polygons lie in the half plane of Z and X, X as a radius. The tool is a sharp convex insert whose tip follows the programmed path,
as a control with tool radius compensation makes it; its nose radius is neglected (assumption).
"""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.extras import needed
from turning_nc.moves import Moves
from turning_nc.paths import Point, shifted
from turning_nc.words import NcError

with needed():
    import shapely

Values = NDArray[np.float64]

MAX_SLICES, SLICE = 40, 1.0  # largest number of slices of a move; length of a slice below it [mm]
MIN_DEPTH = 1e-3  # depth of cut below which a move is taken as in air [mm]
COLLISION = 0.5  # area that a rapid move may sweep in metal without a note [mm2]
_EDGE = 25.0  # length of the insert's edges [mm]; longer than a real one's, as the holder follows it


def _insert(first: float, second: float) -> tuple[Point, ...]:
    """Return the corners of an insert with its tip at the origin; angles of its edges from the Z axis [degrees]."""
    a, b = ((_EDGE * math.cos(math.radians(angle)), _EDGE * math.sin(math.radians(angle))) for angle in (first, second))
    return (0.0, 0.0), a, shifted(a, b), b


TOOLS: dict[str, tuple[Point, ...]] = {
    "outside": _insert(5.0, 85.0),
    "inside": _insert(-5.0, -85.0),
    "copying": _insert(52.0, 87.0),
}
"""Inserts by the kind of work: corners of 80 degrees for turning towards the chuck and facing; 35 degrees for copying."""
DEFAULT_TOOL = "outside"


def tool_shape(kind: str) -> tuple[Point, ...]:
    """Return the corners of a tool: a name of ``TOOLS``, or ``groove:WIDTH`` with its left corner as tip [mm].

    Raises:
        NcError: there is no such kind.
    """
    if kind in TOOLS:
        return TOOLS[kind]
    match = re.fullmatch(r"groove:(\d+\.?\d*)", kind)
    if match is None or not 0.0 < float(match[1]) <= 100.0:
        raise NcError(f"{kind!r} is no kind of tool: {', '.join(TOOLS)}, or groove:WIDTH with a width above 0 and up to 100 mm")
    width = float(match[1])
    return (0.0, 0.0), (width, 0.0), (width, _EDGE), (0.0, _EDGE)


def read_stock(text: str) -> Any:
    """Return the polygon of a stock.

    Its text is ``bar:DIAMETERxLENGTH`` or ``tube:OUTERxINNERxLENGTH``, each with ``+FACE`` for the metal before Z0; or a DXF
    file, or a CSV file with Z and the diameter in each row [mm].

    Raises:
        NcError: it is none of these, or encloses no area; says which.
        OSError: the file cannot be read.
    """
    match = re.fullmatch(r"(bar|tube):([\d.]+(?:x[\d.]+)*)(?:\+([\d.]+))?", text)
    if match is not None:
        try:
            sizes = [float(size) for size in match[2].split("x")]
            face = float(match[3] or 0.0)
        except ValueError:
            raise NcError(f"stock {text!r}: its sizes must be numbers in mm") from None
        if len(sizes) != (2 if match[1] == "bar" else 3):
            raise NcError(f"stock {text!r}: a bar has bar:DIAMETERxLENGTH, a tube tube:OUTERxINNERxLENGTH")
        outer, inner, length = sizes[0], 0.0 if match[1] == "bar" else sizes[1], sizes[-1]
        if not (0.0 <= inner < outer <= 10_000.0 and 0.0 < length <= 100_000.0):
            raise NcError(f"stock {text!r}: sizes must be above 0, and the inner diameter below the outer")
        return shapely.box(-length, inner / 2.0, face, outer / 2.0)
    path = Path(text)
    if path.suffix.lower() not in (".dxf", ".csv"):
        raise NcError(f"stock {text!r} is no bar:DIAMETERxLENGTH, tube:OUTERxINNERxLENGTH, nor a .dxf or .csv file")
    return _closed(_dxf_lines(path) if path.suffix.lower() == ".dxf" else [_csv_points(path)], path)


def _csv_points(path: Path) -> list[Point]:
    points: list[Point] = []
    for number, line in enumerate(path.read_text("utf-8-sig").splitlines(), 1):
        if not line.strip(" ,") or line.lstrip().startswith("#"):
            continue
        try:
            z, diameter = map(float, line.split(","))
        except ValueError:
            if number == 1:  # a header
                continue
            raise NcError(f"{path}: line {number}: {line!r} is not Z and the diameter in mm") from None
        if not (math.isfinite(z) and 0.0 <= diameter <= 10_000.0):
            raise NcError(f"{path}: line {number}: the diameter is {diameter:g} mm, but must be 0 to 10000")
        points.append((z, diameter / 2.0))
    return points


def _dxf_lines(path: Path) -> list[list[Point]]:
    """Return the lines of a DXF drawing; its X is Z, its Y the radius."""
    with needed():
        import ezdxf
        import ezdxf.path
    path.stat()
    try:
        drawing = ezdxf.readfile(path)
    except (ezdxf.DXFError, OSError) as error:
        raise NcError(f"{path}: is no DXF drawing: {error}") from None
    units = {0: 1.0, 1: 25.4, 4: 1.0, 5: 10.0, 6: 1000.0}.get(drawing.units)
    if units is None:
        raise NcError(f"{path}: its unit ($INSUNITS {drawing.units}) is not mm, cm, m or inch")
    kinds = {"LINE", "ARC", "LWPOLYLINE", "POLYLINE", "SPLINE", "CIRCLE", "ELLIPSE"}
    lines = []
    for entity in drawing.modelspace():
        if entity.dxftype() not in kinds:
            raise NcError(f"{path}: a {entity.dxftype()} is not understood; a contour is made of {', '.join(sorted(kinds))}")
        lines.append([(units * p.x, units * p.y) for p in ezdxf.path.make_path(entity).flattening(0.005)])
    return lines


def _closed(lines: Sequence[Sequence[Point]], path: Path) -> Any:
    """Return the area that lines enclose, closed along the axis if they do not close themselves."""
    chains = [shapely.LineString(line) for line in lines if len(line) > 1]
    snapped = shapely.set_precision(shapely.union_all(chains), 1e-4) if chains else None
    merged = shapely.line_merge(snapped) if snapped is not None else None
    areas = [] if merged is None else list(shapely.get_parts(shapely.polygonize([shapely.node(merged)])))
    if not areas and isinstance(merged, shapely.LineString):
        points = list(merged.coords)
        areas = [shapely.Polygon([*points, (points[-1][0], 0.0), (points[0][0], 0.0)])]
    area = shapely.union_all(areas) if areas else None
    if area is None or area.is_empty or not area.is_valid or area.area < 1e-6:
        raise NcError(f"{path}: its lines enclose no area: close the contour, or end it on the axis")
    if area.bounds[1] < -1e-6:
        raise NcError(f"{path}: the contour reaches below the axis: draw only the half above it, with the axis at 0")
    return area


def guessed_stock(moves: Moves) -> tuple[Any, str]:
    """Return a bar that all feed moves lie in, and the words that name it."""
    z, x = np.array([point for move in moves.moves if move.kind == "feed" for point in (move.path.start, move.path.end)]).T
    face = float(z[x < 1e-6].max(initial=0.0))  # of the bar, if the tool goes to its axis
    length = 10.0 - float(min(z.min(), -1.0))
    radius = float(max(x[z < 0.0].max() if (z < 0.0).any() else x.max(), 1.0))
    name = f"bar:{2.0 * radius:g}x{length:g}" + (f"+{face:g}" if face else "")
    return shapely.box(-length, 0.0, face, radius), name


@dataclass(frozen=True)
class Slices:
    """Pieces of all moves, in their order: arrays of one length."""

    move: NDArray[np.int64]  # index of the move
    length: Values  # [mm]
    radius: Values  # mean radius of the tip [mm]
    depth: Values  # depth of cut: removed area per length [mm]
    volume: Values  # removed metal [mm3]
    start: Values  # Z and radius of the tip at the start [mm], shape (slices, 2)
    end: Values  # Z and radius of the tip at the end [mm], shape (slices, 2)


@dataclass(frozen=True)
class Removal:
    """The metal that a program's tools remove from a stock."""

    slices: Slices
    stock: Any  # the polygon before the first move
    part: Any  # the polygon after the last move
    tools: Mapping[str, str]  # kinds of the tools
    notes: tuple[str, ...]


def volume(polygon: Any) -> float:
    """Return the volume of a polygon's body of revolution [mm3], by Pappus."""
    return float(2.0 * math.pi * polygon.area * polygon.centroid.y) if polygon.area else 0.0


def remove(moves: Moves, stock: Any, tools: Mapping[str, str] = {}) -> Removal:
    """Return the metal that a program's tools remove from a stock (a polygon), slice by slice.

    ``tools`` holds kinds of tools by their words, such as ``{"T0303": "inside"}``; all others turn outside.

    Raises:
        NcError: a kind is unknown, or a tool is not in the program.
    """
    known = list(dict.fromkeys(move.tool for move in moves.moves))
    for name in tools:
        if name not in known:
            raise NcError(f"tool {name!r} is not in the program, which has {', '.join(known)}")
    shapes = {name: np.array(tool_shape(tools.get(name, DEFAULT_TOOL))) for name in known}
    rows: list[Values] = []
    notes = []
    left = stock
    threading = {move.tool for move in moves.moves if move.kind == "thread"}  # the metal that they cut is not computed
    for index, move in enumerate(moves.moves):
        for start, end in itertools.pairwise((move.path.start, *move.path.points())):
            length = max(math.dist(start, end), 1e-9)
            count = min(math.ceil(length / SLICE), MAX_SLICES) if move.kind == "feed" else 1
            shares = np.arange(1, count + 1) / count
            areas = moments = np.zeros(count)
            if move.kind in ("feed", "rapid"):
                areas, moments, swept = _swept(left, shapes[move.tool], start, end, shares)
            if move.kind == "feed" and areas[-1] > 0.0:
                left = shapely.difference(left, swept)
            if move.kind == "rapid":
                if areas[-1] > COLLISION and move.tool not in threading:
                    notes.append(f"line {move.line}: a rapid move sweeps {areas[-1]:.2f} mm2 of metal")
                areas = moments = np.zeros(count)
            cut, moment = np.diff(areas, prepend=0.0), np.diff(moments, prepend=0.0)
            middles = start[1] + (shares - 0.5 / count) * (end[1] - start[1])
            ends = np.add(start, shares[:, np.newaxis] * np.subtract(end, start))
            ends[-1] = end
            columns = np.full(count, index), np.full(count, length / count), abs(middles), cut * count / length
            rows.append(np.column_stack((*columns, 2.0 * math.pi * moment, np.vstack((start, ends[:-1])), ends)))
    table = np.concatenate(rows)
    lengths, radii, depths, volumes = np.maximum(table[:, 1:5], 0.0).T
    slices = Slices(table[:, 0].astype(np.int64), lengths, radii, depths, volumes, table[:, 5:7], table[:, 7:9])
    kinds = {name: tools.get(name, DEFAULT_TOOL) for name in known}
    return Removal(slices, stock, left, kinds, tuple(dict.fromkeys(notes)))


def _swept(stock: Any, shape: Values, start: Point, end: Point, shares: Values) -> tuple[Values, Values, Any]:
    """Return area and first moment of the stock swept up to each share of a straight move, and the whole swept polygon."""
    shift = np.subtract(end, start)
    corners = shape + start
    ends = corners + shares[:, np.newaxis, np.newaxis] * shift
    both = np.concatenate((np.broadcast_to(corners, ends.shape), ends), axis=1)
    whole = shapely.convex_hull(shapely.multipoints(shapely.points(both[-1])))
    near = shapely.intersection(stock, whole)
    if near.area < 1e-9:
        return np.zeros(len(shares)), np.zeros(len(shares)), whole
    if len(shares) == 1:
        cut = np.array([near])
    else:
        cut = shapely.intersection(near, shapely.convex_hull(shapely.multipoints(shapely.points(both))))
    areas = shapely.area(cut)
    moments = np.zeros(len(shares))
    moments[areas > 0.0] = areas[areas > 0.0] * shapely.get_y(shapely.centroid(cut[areas > 0.0]))
    return areas, moments, whole
