"""Stock minus the swept tool: depth of cut, diameter and removed volume along every move.

Polygons lie in the half plane of Z and X, X as a radius.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.kinds import DRILL, inside_solid, kinds_of
from turning_nc.metal import Metal, overlaps
from turning_nc.moves import Move, Moves
from turning_nc.paths import Point
from turning_nc.sweep import SAME, Removed, Sweep
from turning_nc.tool_shapes import tool_shape
from turning_nc.words import NcError
from turning_shop import Values

from turning_env.extras import needed

with needed():
    import shapely
    from tqdm import tqdm

MAX_SLICES, SLICE = 40, 1.0  # largest number of slices of a move; length of a slice below it [mm]
STEP, TOUCH = (
    0.02,
    1e-3,
)  # accuracy of the places where a move meets and leaves metal [mm], and the area that counts [mm2]
MIN_AREA = 1e-9  # area below which a cut is not divided into slices [mm2]
MIN_DEPTH = 1e-3  # depth of cut below which a move is taken as in air [mm]
COLLISION = 2.0  # area that a rapid move may sweep in metal without a warning [mm2]
GOUGE = 5.0  # area that the back of an insert may take from the part without a warning [mm2]


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
