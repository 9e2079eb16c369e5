"""Stock minus the swept tool: depth of cut, diameter and removed volume along every move.

Polygons lie in the half plane of Z and X, X as a radius. The tool is a sharp convex insert whose tip follows the programmed path,
as a control with tool radius compensation makes it; its nose radius is neglected (assumption).
"""

import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.kinds import DRILL, MAX_WIDTH, MIN_WIDTH, cuts, inside_solid, kinds_of
from turning_nc.metal import Metal, overlaps
from turning_nc.modal import HOME
from turning_nc.moves import Move, Moves
from turning_nc.paths import Point, shifted
from turning_nc.sweep import SAME, Removed, Sweep
from turning_nc.words import MAX_BYTES, NcError
from turning_shop import regular_file

from turning_env.extras import needed

with needed():
    import shapely
    from tqdm import tqdm

Values = NDArray[np.float64]

MAX_SLICES, SLICE = 40, 1.0  # largest number of slices of a move; length of a slice below it [mm]
STEP, TOUCH = (
    0.02,
    1e-3,
)  # accuracy of the places where a move meets and leaves metal [mm], and the area that counts [mm2]
MIN_AREA = 1e-9  # area below which a cut is not divided into slices [mm2]
MIN_DEPTH = 1e-3  # depth of cut below which a move is taken as in air [mm]
CLEARANCE = 1.0  # distance from the metal at which cuts begin [mm] (assumption)
COLLISION = 2.0  # area that a rapid move may sweep in metal without a warning [mm2]
MAX_DIAMETER, MAX_LENGTH = 1e4, 1e5  # of a stock [mm]
GOUGE = 5.0  # area that the back of an insert may take from the part without a warning [mm2]
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
    rapids: Mapping[int, float]  # largest area of metal that a rapid move sweeps, by lines [mm2]
    gouged: Mapping[int, float]  # area of the part that the back of an insert takes, by lines [mm2]
    notes: tuple[str, ...]


def volume(polygon: Any) -> float:
    """Return the volume of a polygon's body of revolution [mm3], by Pappus."""
    return float(2.0 * math.pi * polygon.area * polygon.centroid.y) if polygon.area else 0.0


def remove(moves: Moves, stock: Any, tools: Mapping[str, str] = {}) -> Removal:
    """Return the metal that a program's tools remove from a stock (a polygon), slice by slice.

    ``tools`` holds kinds of tools by their words, such as ``{"T0303": "inside"}``; for all others see ``kinds_of``.

    Raises:
        NcError: a kind is unknown, a tool is not in the program, or a cycle turns a side on which the stock has no metal.
    """
    kinds = kinds_of(moves, tools)
    solid = inside_solid(moves, kinds, tools, stock)
    kinds |= dict.fromkeys(solid, "outside")
    beyond = _beyond_the_axis(moves)
    cutting = _Cutting(
        stock, kinds, beyond, {move.tool for move in moves.moves if move.kind == "thread"}
    )
    unchecked = set(moves.sides)
    for index, move in enumerate(
        tqdm(moves.moves, "removing metal", unit="move", leave=False, disable=None)
    ):
        if move.line in unchecked:
            unchecked.remove(move.line)
            _check_side(moves, move.line, cutting.left)
        for start, end in itertools.pairwise((move.path.start, *move.path.points())):
            cutting.run(index, move, start, end)
    notes = [
        f"tool {name} works at negative X: its path is mirrored on the axis"
        for name in kinds
        if name in beyond
    ]
    drill = "cuts along the axis alone and is taken as a drill that removes nothing: set --tool NAME=drill:DIAMETER"
    notes += [f"tool {name} {drill}" for name, kind in kinds.items() if kind == DRILL]
    notes += [
        f"tool {name} is taken as {kind}; --tool {name}=KIND sets it"
        for name, kind in kinds.items()
        if kind not in ("outside", DRILL) and name not in tools
    ]
    hole = "moves as if inside, but the stock has no hole there; so it is taken as outside"
    notes += [
        f"tool {name} {hole}: give a tube, or set --tool {name}=KIND"
        for name in kinds
        if name in solid
    ]
    part = cutting.left.polygon()
    return Removal(
        cutting.slices(), stock, part, kinds, cutting.rapids, cutting.gouged(part), tuple(notes)
    )


def _beyond_the_axis(moves: Moves) -> set[str]:
    """Return the tools that work at negative X."""
    lowest: dict[str, float] = {}
    highest: dict[str, float] = {}
    for move in moves.moves:
        if move.kind == "feed":
            low, high = sorted(move.path.reach)
            lowest[move.tool] = min(lowest.get(move.tool, low), low)
            highest[move.tool] = max(highest.get(move.tool, high), high)
    return {tool for tool, high in highest.items() if high < -0.2 * lowest[tool]}


class _Cutting:
    """Tools that take metal from a stock, one straight move after another."""

    def __init__(
        self, stock: Any, kinds: Mapping[str, str], beyond: set[str], threading: set[str]
    ) -> None:
        """Start with a stock; ``beyond`` are tools at negative X, ``threading`` those whose metal is not computed."""
        self.left = Metal(stock)
        self.rapids: dict[
            int, float
        ] = {}  # largest area of metal that a rapid move sweeps, by lines [mm2]
        self._stock, self._beyond, self._threading = stock, beyond, threading
        self._shapes = {name: tool_shape(kind) for name, kind in kinds.items()}
        self._slim_shapes: dict[
            str, Values
        ] = {}  # shapes with a slim back, of the tools that have another one
        for name, kind in kinds.items():
            shape, slim_shape = self._shapes[name], tool_shape(kind, slim=True)
            if (
                shape is not None
                and slim_shape is not None
                and not np.array_equal(shape, slim_shape)
            ):
                self._slim_shapes[name] = slim_shape
        self._slim = (
            Metal(stock) if self._slim_shapes else None
        )  # what tools with a slim back would leave
        self._taken: list[
            tuple[int, NDArray[Any]]
        ] = []  # lines, and the metal that their moves take
        self._moves: list[int] = []  # index of the move to which each straight move belongs
        self._paths: list[tuple[Point, Point]] = []  # straight moves
        self._cuts: list[_Cut] = []  # what each of them removes

    def run(self, index: int, move: Move, start: Point, end: Point) -> None:
        """Run a straight move, which may be a chord of an arc."""
        self._moves.append(index)
        self._paths.append((start, end))
        self._cuts.append(self._cut(move, start, end) if move.kind in ("feed", "rapid") else AIR)

    def _cut(self, move: Move, start: Point, end: Point) -> "_Cut":
        shape = self._shapes[move.tool]
        if shape is None or math.dist(start, end) < SAME:
            return AIR
        if move.tool in self._beyond:
            start, end = (start[0], -start[1]), (end[0], -end[1])
        withdraws = (
            start[0] == end[0] and (end[1] - start[1]) * shape[2, 1] > 0.0
        )  # from where it came
        if move.kind == "rapid" and (withdraws or move.tool in self._threading):
            return AIR  # it rubs along each ridge of a shoulder, which would take long to compute
        sweep = Sweep(shape, start, end)
        places = self.left.meeting(sweep.area)
        if not len(places):
            return AIR
        metal = self.left.within(sweep.area, places)
        areas = shapely.area(metal)
        metal, area = metal[areas > 0.0], float(areas.sum())
        if area == 0.0:
            return AIR
        if move.kind == "rapid":
            if area > COLLISION:
                self.rapids[move.line] = max(self.rapids.get(move.line, 0.0), area)
            return AIR
        self.left.take(sweep.area, places)
        self._taken.append((move.line, metal))
        if self._slim:
            slim_shape = self._slim_shapes.get(move.tool)
            slim_area = sweep.area if slim_shape is None else Sweep(slim_shape, start, end).area
            self._slim.take(slim_area, self._slim.meeting(slim_area))
        return _sliced(sweep, metal, area)

    def slices(self) -> Slices:
        """Return the slices of all moves."""
        counts = np.array([len(cut.shares) for cut in self._cuts])
        path = np.repeat(np.arange(len(counts)), counts)
        firsts = np.cumsum(counts) - counts
        shares = np.concatenate([cut.shares for cut in self._cuts])
        paths = np.array(self._paths)  # start and end, Z and X
        starts, steps = paths[path, 0], paths[path, 1] - paths[path, 0]

        def increments(values: Values) -> Values:
            """Return by how much values rise over each slice, from 0 before a straight move."""
            rises = np.diff(values, prepend=0.0)
            rises[firsts] = values[firsts]
            return rises

        ends = starts + shares[:, np.newaxis] * steps
        ends[firsts + counts - 1] = paths[:, 1]
        begins = np.concatenate((ends[:1], ends[:-1]))
        begins[firsts] = paths[:, 0]
        length = np.maximum(np.hypot(*steps.T), SAME) * increments(shares)
        areas = increments(np.concatenate([cut.areas for cut in self._cuts]))
        moments = increments(np.concatenate([cut.moments for cut in self._cuts]))
        return Slices(
            move=np.array(self._moves)[path],
            length=np.maximum(length, 0.0),
            radius=0.5 * abs(begins + ends)[:, 1],
            depth=np.maximum(areas / length, 0.0),
            volume=np.maximum(2.0 * math.pi * moments, 0.0),
            start=begins,
            end=ends,
        )

    def gouged(self, part: Any) -> dict[int, float]:
        """Return the areas by lines of what is lost of the part, against a copying insert that follows the same path [mm2]."""
        if self._slim is None:
            return {}
        lost = shapely.difference(self._slim.polygon(), part)
        if lost.area <= GOUGE:
            return {}
        lines = np.array([line for line, metal in self._taken for _ in metal])
        metal = np.concatenate([metal for _, metal in self._taken])
        areas = np.bincount(lines, overlaps(metal, lost))
        return {int(line): float(areas[line]) for line in np.flatnonzero(areas > COLLISION)}


class _Cut(NamedTuple):
    """Metal that a straight move removes, summed up to the end of each of its slices."""

    shares: Values  # of the move's length at which slices end [-]
    areas: Values  # [mm2]
    moments: Values  # first moments about the axis [mm3]


AIR = _Cut(np.ones(1), np.zeros(1), np.zeros(1))


def _sliced(sweep: Sweep, metal: NDArray[Any], area: float) -> _Cut:
    """Return the slices of a move through metal: equal ones between the first metal and the last, and one of air on each side."""
    steps = math.ceil(sweep.length / STEP)
    if area < MIN_AREA or steps == 1:
        moments = shapely.area(metal) * shapely.get_y(shapely.centroid(metal))
        return _Cut(np.ones(1), np.array([area]), np.array([moments.sum()]))
    removed = Removed(sweep, metal)
    touch = min(TOUCH, 0.1 * area)
    first, last = (
        removed.first_steps(np.array((touch, area - touch)), sweep.length / steps, steps) / steps
    )
    first = max(first - 1.0 / steps, 0.0)
    count = min(math.ceil((last - first) * sweep.length / SLICE), MAX_SLICES)
    shares = np.linspace(first, last, count + 1)
    shares = shares[shares > 0.0]
    if last < 1.0 or not len(shares):
        shares = np.append(shares, 1.0)
    areas, moments = removed.areas(sweep.length * shares), removed.moments(sweep.length * shares)
    air = areas <= touch
    areas[air] = moments[air] = 0.0
    return _Cut(shares, areas, moments)


def _check_side(moves: Moves, line: int, left: Metal) -> None:
    """Check that a cycle turns metal, and that there is a hole if it turns inside."""
    side = moves.sides[line]
    outside, radius, (low, high) = side.name == "outside", abs(side.start[1]), side.reach
    within, beyond = (
        left.area_within(low, *ends) for ends in ((0.0, high, 0.9 * radius), (radius, high, 1e5))
    )
    if not side.facing and (
        within < 1e-6 < beyond if outside else within > 0.45 * radius * (high - low)
    ):
        hole = "no hole there: give a tube, or the drill as --tool NAME=drill:DIAMETER"
        found, other = (
            ("metal beyond it alone: give another", "inside") if outside else (hole, "outside")
        )
        begin = f"line {line}: the cycle turns {side.name} from X{2.0 * radius:g} mm, {side.why}"
        raise NcError(f"{begin}, but the stock has {found}; or set --side {line}={other}")
