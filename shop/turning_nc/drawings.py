"""Read the contour of a stock from a DXF drawing or a CSV file of points.

``stock`` reads bars and tubes, and guesses a stock where none is given.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from turning_nc.paths import Point
from turning_nc.words import MAX_BYTES, NcError

from turning_env.extras import needed
from turning_env.files import read_regular

with needed():
    import shapely

MAX_DIAMETER = 1e4  # of a stock [mm]
MAX_LENGTH = 1e5  # of a stock [mm]
MAX_CHORD_ERROR = 0.005  # distance of a curve from its chords, in units of the drawing
JOINING_GRID = 1e-4  # ends of lines that are closer are joined [mm]
MIN_AREA = 1e-6  # of a stock [mm2]
MAX_BELOW_AXIS = 1e-6  # by which a contour may reach below the axis [mm]

MILLIMETRES = {0: 1.0, 1: 25.4, 4: 1.0, 5: 10.0, 6: 1000.0}
"""Length of the units of drawings [mm], by $INSUNITS: none, inch, mm, cm and m."""
ENTITIES = {"LINE", "ARC", "LWPOLYLINE", "POLYLINE", "SPLINE", "CIRCLE", "ELLIPSE"}
"""Types of entities of which a contour is made."""


def read_contour(path: Path) -> Any:
    """Return the polygon that a DXF drawing or the points of a CSV file enclose.

    Raises:
        NcError: the file is damaged, or encloses no area.
        OSError: the file cannot be read.
    """
    is_drawing = path.suffix.lower() == ".dxf"
    lines = _dxf_lines(path) if is_drawing else [_csv_points(path)]
    return _enclosed(lines, path)


def _csv_points(path: Path) -> list[Point]:
    text = read_regular(path, MAX_BYTES).decode("utf-8-sig", "replace")
    points: list[Point] = []
    for number, line in enumerate(text.splitlines(), 1):
        is_blank = not line.strip(" ,;\t")
        if is_blank or line.lstrip().startswith("#"):
            continue
        place = f"{path}: line {number}"
        try:
            z, diameter = map(float, re.split("[,;\t]", line))
        except ValueError:
            is_header = number == 1
            if is_header:
                continue
            raise NcError(
                f"{place}: {line[:40]!r} is not Z and the diameter in mm, such as -50,100.5; "
                "decimals have a point"
            ) from None
        if not (abs(z) <= MAX_LENGTH and 0.0 <= diameter <= MAX_DIAMETER):
            raise NcError(
                f"{place}: Z must be within {MAX_LENGTH:g} mm, "
                f"the diameter 0 to {MAX_DIAMETER:g} mm"
            )
        points.append(Point(z, diameter / 2.0))
    return points


def _dxf_lines(path: Path) -> list[list[Point]]:
    """Return the lines of a DXF drawing; its X is Z, its Y the radius."""
    with needed():
        import ezdxf
    read_regular(path, MAX_BYTES)  # refuses what has no end; the package reads the file itself
    try:
        drawing = ezdxf.readfile(path)
    except PermissionError:
        raise
    except Exception as error:  # the package raises errors of many types for damaged files
        raise NcError(f"{path}: is no DXF drawing: {error}") from None
    unit = MILLIMETRES.get(drawing.units)
    if unit is None:
        raise NcError(f"{path}: its unit ($INSUNITS {drawing.units}) is not mm, cm, m or inch")
    return [_entity_line(entity, unit, path=path) for entity in drawing.modelspace()]


def _entity_line(entity: Any, unit: float, path: Path) -> list[Point]:
    """Return the points of a line or curve of a drawing [mm]."""
    with needed():
        import ezdxf
        import ezdxf.path
        from ezdxf.lldxf.tagwriter import TagCollector
    kind = entity.dxftype()
    if kind not in ENTITIES:
        known = ", ".join(sorted(ENTITIES))
        raise NcError(f"{path}: a {kind} is not understood; a contour is made of {known}")

    # These are all coordinates and angles, checked before a curve is computed from them.
    tags = TagCollector.dxftags(entity)
    numbers = [tag.value for tag in tags if isinstance(tag.value, float)]
    if not all(abs(number) <= MAX_LENGTH for number in numbers):
        raise NcError(f"{path}: {entity} has a number that is not finite or above {MAX_LENGTH:g}")
    try:
        curve = ezdxf.path.make_path(entity)
        points = list(curve.flattening(MAX_CHORD_ERROR))
    except (ValueError, ArithmeticError, ezdxf.DXFError) as error:
        raise NcError(f"{path}: {entity} is no curve: {error}") from None
    line = [Point(unit * point.x, unit * point.y) for point in points]
    if any(max(abs(point.z), abs(point.x)) > MAX_LENGTH for point in line):
        raise NcError(
            f"{path}: {entity} reaches beyond {MAX_LENGTH:g} mm: is its unit ($INSUNITS) right?"
        )
    return line


def _enclosed(lines: Sequence[Sequence[Point]], path: Path) -> Any:
    """Return the area that lines enclose; the axis closes a line that does not close itself."""
    chains = [shapely.LineString(line) for line in lines if len(line) > 1]
    on_grid = shapely.set_precision(shapely.union_all(chains), JOINING_GRID)
    merged = shapely.line_merge(on_grid)
    areas = list(shapely.get_parts(shapely.polygonize([shapely.node(merged)])))
    is_one_line = isinstance(merged, shapely.LineString)
    if not areas and is_one_line and merged.length:
        points = list(merged.coords)
        below_last = (points[-1][0], 0.0)
        below_first = (points[0][0], 0.0)
        areas = [shapely.Polygon([*points, below_last, below_first])]
    area = shapely.union_all(areas)
    if not area.is_valid or area.area < MIN_AREA:
        raise NcError(
            f"{path}: its lines enclose no area: close the contour, or end it on the axis"
        )
    lowest_radius = area.bounds[1]
    if lowest_radius < -MAX_BELOW_AXIS:
        raise NcError(
            f"{path}: the contour reaches below the axis: "
            "draw only the half above it, with the axis at 0"
        )
    return area
