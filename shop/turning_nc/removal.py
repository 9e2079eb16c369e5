"""Stock minus the swept tools: depth of cut, diameter and removed volume along every move.

Polygons lie in the half plane of Z and X, X as a radius. Moves are divided into slices, over which
the depth of cut is taken as constant. What a slice costs in time, load and wear is computed in
``cutting``.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.kinds import DRILL, ToolKinds, diameter_of_drill
from turning_nc.metal import Metal, overlaps
from turning_nc.moves import Move, Moves
from turning_nc.paths import Point
from turning_nc.surface import final_surface
from turning_nc.sweep import SAME, Removed, Sweep
from turning_nc.tool_shapes import tool_shape
from turning_nc.words import NcError
from turning_shop import Values

from turning_env.extras import needed

with needed():
    import shapely
    from tqdm import tqdm

MAX_SLICES = 40  # of a move through metal
SLICE_LENGTH = 1.0  # while a move has fewer slices [mm]
STEP = 0.02  # accuracy of the places where a move meets and leaves metal [mm]
TOUCH = 1e-3  # area from which a move counts as in metal [mm2]
MIN_AREA = 1e-9  # area below which a cut is not divided into slices [mm2]
MIN_DEPTH = 1e-3  # depth of cut below which a move is taken as in air [mm]
MAX_COLLISION = 2.0  # area that a rapid move may sweep in metal without a warning [mm2]
MAX_GOUGE = 5.0  # area that the back of an insert may take from the part without a warning [mm2]
# Radius beyond the axis, over the largest one on the tool's own side, that a facing tool may reach.
MAX_PAST_AXIS = 0.2
MAX_OFF_AXIS = 0.05  # distance of a drill from the axis that counts as none [mm]
FAR = 1e5  # radius beyond every stock [mm]


# Columns of ``Slices.start`` and ``Slices.end``.
Z = 0
RADIUS = 1


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
    surface: Values  # length of the finished part's surface that the slice leaves [mm]


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


def remove(moves: Moves, stock: Any, tools: Mapping[str, str] = {}) -> Removal:
    """Return the metal that a program's tools remove from a stock, slice by slice.

    Args:
        moves: the moves of the program.
        stock: a polygon.
        tools: kinds of tools by their words, such as ``{"T0303": "inside"}``; for all others see
            ``ToolKinds``.

    Raises:
        NcError: a kind is unknown, a tool is not in the program, or a cycle turns a side on which
            the stock has no metal.
    """
    moving = ToolKinds(moves, tools)
    in_solid = moving.without_hole(stock)
    kinds = moving.by_tool | dict.fromkeys(in_solid, "outside")
    mirrored = _tools_beyond_axis(moves)
    cutting = _Cutting(stock, kinds, mirrored=mirrored, threading=_threading_tools(moves))
    unchecked = set(moves.sides)
    progress = tqdm(moves.moves, "removing metal", unit="move", leave=False, disable=None)
    for index, move in enumerate(progress):
        if move.line in unchecked:
            unchecked.remove(move.line)
            _check_side(moves, move.line, left=cutting.left)
        corners = (move.path.start, *move.path.points())
        for start, end in itertools.pairwise(corners):
            cutting.run(index, move, start=start, end=end)
    part = cutting.left.polygon()
    return Removal(
        slices=cutting.slices(moves.moves, part),
        stock=stock,
        part=part,
        tools=kinds,
        rapids=cutting.rapids,
        gouged=cutting.gouged(part),
        notes=(
            *_notes(kinds, tools, mirrored=mirrored, in_solid=in_solid),
            *_notes_on_drills(cutting.at_corner),
        ),
    )


def _notes(
    kinds: Mapping[str, str], given: Mapping[str, str], mirrored: set[str], in_solid: set[str]
) -> tuple[str, ...]:
    """Return notes on the tools whose kinds or paths were assumed."""
    notes = []
    for name in kinds:
        if name in mirrored:
            notes.append(f"tool {name} works at negative X: its path is mirrored on the axis")
    for name, kind in kinds.items():
        if kind == DRILL:
            notes.append(
                f"tool {name} cuts along the axis alone and is taken as a drill that removes "
                "nothing: set --tool NAME=drill:DIAMETER"
            )
    for name, kind in kinds.items():
        if kind not in ("outside", DRILL) and name not in given:
            size = ", and its loads are those of this width" if "groove" in kind else ""
            notes.append(f"tool {name} is taken as {kind}{size}; --tool {name}=KIND sets it")
    for name in kinds:
        if name in in_solid:
            notes.append(
                f"tool {name} moves as if inside, but the stock has no hole there; so it is taken "
                f"as outside: give a tube, or set --tool {name}=KIND"
            )
    return tuple(notes)


def _notes_on_drills(at_corner: set[str]) -> list[str]:
    """Return notes on drills that are programmed at their corners."""
    return [
        f"drill {name} is programmed at its diameter, so X is taken as its corner (assumption)"
        for name in sorted(at_corner)
    ]


def _tools_beyond_axis(moves: Moves) -> set[str]:
    """Return the tools that work at negative X."""
    lowest: dict[str, float] = {}
    highest: dict[str, float] = {}
    for move in moves.moves:
        if move.kind == "feed":
            tool = move.tool
            low, high = sorted(move.path.reach)
            lowest[tool] = min(lowest.get(tool, low), low)
            highest[tool] = max(highest.get(tool, high), high)

    # A tool that faces runs a little past the axis, too.
    tools = set()
    for tool, high in highest.items():
        if high < -MAX_PAST_AXIS * lowest[tool]:
            tools.add(tool)
    return tools


def _threading_tools(moves: Moves) -> set[str]:
    return {move.tool for move in moves.moves if move.kind == "thread"}


class _Taken(NamedTuple):
    """Metal that a move takes."""

    line: int
    metal: NDArray[Any]  # polygons


class _RemovedMetal(NamedTuple):
    """Metal that a straight move removes, summed up to the end of each of its slices."""

    shares: Values  # of the move's length at which slices end [-]
    areas: Values  # [mm2]
    moments: Values  # first moments about the axis [mm3]


AIR = _RemovedMetal(shares=np.ones(1), areas=np.zeros(1), moments=np.zeros(1))


class _Cutting:
    """Tools that take metal from a stock, one straight move after another.

    To find gouges, a second piece of metal is cut by the same tools, but with slim backs. What only
    the first one loses, the backs have taken.
    """

    def __init__(
        self, stock: Any, kinds: Mapping[str, str], mirrored: set[str], threading: set[str]
    ) -> None:
        """Start with a stock.

        Args:
            stock: a polygon.
            kinds: kinds of the tools.
            mirrored: tools at negative X.
            threading: tools that cut threads.
        """
        self.left = Metal(stock)
        # Largest area of metal that a rapid move sweeps, by lines [mm2].
        self.rapids: dict[int, float] = {}
        self._mirrored = mirrored
        self._threading = threading
        self._shapes = {name: tool_shape(kind) for name, kind in kinds.items()}
        self._drills = _radii_of_drills(kinds)
        self.at_corner: set[str] = set()  # drills that cut where their corners are programmed
        self._slim_shapes = _slim_shapes(kinds)
        self._left_by_slim = Metal(stock) if self._slim_shapes else None
        self._taken: list[_Taken] = []

        # For each straight move: the index of the move to which it belongs, its ends, and its cut.
        self._moves: list[int] = []
        self._paths: list[tuple[Point, Point]] = []
        self._cuts: list[_RemovedMetal] = []

    def run(self, index: int, move: Move, start: Point, end: Point) -> None:
        """Run a straight move, which may be a chord of an arc."""
        cut = AIR
        if move.kind in ("feed", "rapid"):
            cut = self._cut(move, start, end=end)
        self._moves.append(index)
        self._paths.append((start, end))
        self._cuts.append(cut)

    def _cut(self, move: Move, start: Point, end: Point) -> _RemovedMetal:
        shape = self._shapes[move.tool]
        programmed = start
        start = self._placed(move.tool, start)
        end = self._placed(move.tool, end)
        # A drill whose corner goes to the axis stays in its place.
        if shape is None or math.dist(start, end) < SAME:
            return AIR
        if move.kind == "rapid":
            # A tool that withdraws to where it came from rubs along each ridge of a shoulder, which
            # would take long to compute.
            rise = end.x - start.x
            withdraws = start.z == end.z and rise * shape[2, 1] > 0.0
            if withdraws or move.tool in self._threading:
                return AIR
        sweep = Sweep(shape, start, end=end)
        places = self.left.meeting(sweep.area)
        if not len(places):
            return AIR
        metal = self.left.within(sweep.area, places)
        areas = shapely.area(metal)
        area = float(areas.sum())
        if area == 0.0:
            return AIR
        if move.kind == "rapid":
            if area > MAX_COLLISION:
                area_before = self.rapids.get(move.line, 0.0)
                self.rapids[move.line] = max(area_before, area)
            return AIR
        self._check_drill(move, start, end=end)
        if self._is_at_corner(move.tool, programmed):
            self.at_corner.add(move.tool)
        metal = metal[areas > 0.0]
        self.left.take(sweep.area, places)
        self._taken.append(_Taken(move.line, metal))
        if self._left_by_slim:
            slim_sweep = sweep
            slim_shape = self._slim_shapes.get(move.tool)
            if slim_shape is not None:
                slim_sweep = Sweep(slim_shape, start, end=end)
            slim_places = self._left_by_slim.meeting(slim_sweep.area)
            self._left_by_slim.take(slim_sweep.area, slim_places)
        return _sliced(sweep, metal, area=area)

    def _placed(self, tool: str, point: Point) -> Point:
        """Return where a tool is that is programmed at a point.

        One at negative X is mirrored. A drill may be programmed at its corner, as one of 10 mm at
        X10; then it is on the axis.
        """
        if self._is_at_corner(tool, point):
            return Point(point.z, 0.0)
        if tool in self._mirrored:
            return Point(point.z, -point.x)
        return point

    def _is_at_corner(self, tool: str, point: Point) -> bool:
        """Return whether a tool is a drill whose corner, on the axis, is at a point."""
        radius = self._drills.get(tool)
        return radius is not None and math.isclose(abs(point.x), radius, abs_tol=MAX_OFF_AXIS)

    def _check_drill(self, move: Move, start: Point, end: Point) -> None:
        """Check that a tool that cuts is no drill beside the axis.

        Raises:
            NcError: it is one.
        """
        if move.tool in self._drills and max(abs(start.x), abs(end.x)) > MAX_OFF_AXIS:
            raise NcError(
                f"line {move.line}: the drill {move.tool} cuts at X{2.0 * end.x:g} mm, but a fixed "
                "drill cuts on the axis, X0"
            )

    def slices(self, moves: Sequence[Move], part: Any) -> Slices:
        """Return the slices of all moves; ``part`` is the polygon after the last of them."""
        counts = np.array([len(cut.shares) for cut in self._cuts])
        path = np.repeat(np.arange(len(counts)), counts)
        firsts = np.cumsum(counts) - counts
        lasts = firsts + counts - 1
        shares = np.concatenate([cut.shares for cut in self._cuts])
        summed_areas = np.concatenate([cut.areas for cut in self._cuts])
        summed_moments = np.concatenate([cut.moments for cut in self._cuts])

        def increments(values: Values) -> Values:
            """Return by how much values rise over each slice, from 0 before a straight move."""
            rises = np.diff(values, prepend=0.0)
            rises[firsts] = values[firsts]
            return rises

        # Each slice ends where the next one starts; straight moves end exactly at their ends.
        paths = np.array(self._paths)  # of each straight move: start and end, Z and X
        path_starts = paths[:, 0]
        path_ends = paths[:, 1]
        starts_of_slices = path_starts[path]
        steps = path_ends[path] - starts_of_slices
        ends = starts_of_slices + shares[:, np.newaxis] * steps
        ends[lasts] = path_ends
        starts = np.concatenate((ends[:1], ends[:-1]))
        starts[firsts] = path_starts
        path_length = np.maximum(np.hypot(*steps.T), SAME)
        length = path_length * increments(shares)
        areas = increments(summed_areas)
        moments = increments(summed_moments)
        middle_radius = 0.5 * abs(starts + ends)[:, RADIUS]
        depth = np.maximum(areas / length, 0.0)
        move = np.array(self._moves)[path]
        names = np.array([move.tool for move in moves])[move]
        surface = np.zeros(len(depth))
        for tool, shape in self._shapes.items():
            cuts = np.flatnonzero((names == tool) & (depth > MIN_DEPTH))
            if shape is not None and len(cuts):
                side = -1.0 if tool in self._mirrored else 1.0
                signs = np.array((1.0, side))
                surface[cuts] = final_surface(shape, signs * starts[cuts], signs * ends[cuts], part)
        return Slices(
            move=move,
            length=np.maximum(length, 0.0),
            radius=middle_radius,
            depth=depth,
            volume=np.maximum(2.0 * math.pi * moments, 0.0),
            start=starts,
            end=ends,
            surface=surface,
        )

    def gouged(self, part: Any) -> dict[int, float]:
        """Return the areas of the part that the backs of inserts take, by lines [mm2].

        They are what the part lost against copying inserts that follow the same paths.
        """
        if self._left_by_slim is None:
            return {}
        lost = shapely.difference(self._left_by_slim.polygon(), part)
        if lost.area <= MAX_GOUGE:
            return {}
        metal = np.concatenate([taken.metal for taken in self._taken])
        lines = np.array([taken.line for taken in self._taken])
        counts = [len(taken.metal) for taken in self._taken]
        line_of_polygon = np.repeat(lines, counts)

        # A line that takes little metal, as those of a fine contour do, need not be compared.
        taken_areas = np.bincount(line_of_polygon, shapely.area(metal))
        may_gouge = taken_areas[line_of_polygon] > MAX_COLLISION
        gouged_areas = overlaps(metal[may_gouge], lost)
        areas = np.bincount(line_of_polygon[may_gouge], gouged_areas)
        gouging_lines = np.flatnonzero(areas > MAX_COLLISION)
        return {int(line): float(areas[line]) for line in gouging_lines}


def _radii_of_drills(kinds: Mapping[str, str]) -> dict[str, float]:
    """Return the radii of the drills whose diameters are known [mm]."""
    radii = {}
    for name, kind in kinds.items():
        diameter = diameter_of_drill(kind)
        if diameter is not None:
            radii[name] = 0.5 * diameter
    return radii


def _slim_shapes(kinds: Mapping[str, str]) -> dict[str, Values]:
    """Return the shapes with a slim back, of the tools that have another one."""
    slim_shapes = {}
    for name, kind in kinds.items():
        shape = tool_shape(kind)
        slim_shape = tool_shape(kind, slim=True)
        if shape is None or slim_shape is None:
            continue
        if not np.array_equal(shape, slim_shape):
            slim_shapes[name] = slim_shape
    return slim_shapes


def _sliced(sweep: Sweep, metal: NDArray[Any], area: float) -> _RemovedMetal:
    """Return the slices of a move through metal.

    They are of one length between the first metal and the last, with one of air on each side.
    """
    steps = math.ceil(sweep.length / STEP)
    if area < MIN_AREA or steps == 1:
        radii = shapely.get_y(shapely.centroid(metal))
        moments = shapely.area(metal) * radii
        return _RemovedMetal(
            shares=np.ones(1),
            areas=np.array([area]),
            moments=np.array([moments.sum()]),
        )
    removed = Removed(sweep, metal)
    touch = min(TOUCH, 0.1 * area)
    limits = np.array((touch, area - touch))
    first_steps = removed.first_steps(limits, sweep.length / steps, count=steps)
    first, last = first_steps / steps
    first = max(first - 1.0 / steps, 0.0)
    length = (last - first) * sweep.length
    count = min(math.ceil(length / SLICE_LENGTH), MAX_SLICES)
    shares = np.linspace(first, last, count + 1)
    shares = shares[shares > 0.0]
    if last < 1.0 or not len(shares):
        shares = np.append(shares, 1.0)
    distances = sweep.length * shares
    areas = removed.areas(distances)
    moments = removed.moments(distances)
    is_air = areas <= touch
    areas[is_air] = 0.0
    moments[is_air] = 0.0
    return _RemovedMetal(shares, areas, moments=moments)


def _check_side(moves: Moves, line: int, left: Metal) -> None:
    """Check that a cycle turns metal, and that there is a hole if it turns inside."""
    side = moves.sides[line]
    if side.facing:
        return
    radius = abs(side.start[1])
    low, high = side.reach
    # A cycle that turns inside needs a hole: most of the bar well within its start must be gone.
    core = 0.9 * radius
    metal_within = left.area_within(low, 0.0, high_z=high, high_x=core)
    begin = f"line {line}: the cycle turns {side.name} from X{2.0 * radius:g} mm, {side.why}"
    if side.name == "outside":
        metal_beyond = left.area_within(low, radius, high_z=high, high_x=FAR)
        if metal_within < 1e-6 < metal_beyond:
            raise NcError(
                f"{begin}, but the stock has metal beyond it alone: give another; "
                f"or set --side {line}=inside"
            )
    elif metal_within > 0.5 * core * (high - low):
        raise NcError(
            f"{begin}, but the stock has no hole there: give a tube, or the drill as "
            f"--tool NAME=drill:DIAMETER; or set --side {line}=outside"
        )
