"""Kinds of tools as their moves show them: outside or inside, drills, grooving tools."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from turning_nc.moves import Move, Moves
from turning_nc.paths import Path
from turning_nc.words import NcError

from turning_env.extras import needed

with needed():
    import shapely

MAX_CUTTING_FEED = 1.5  # feed above which a tool is only placed [mm/rev] (assumption)
MAX_TOOLS = 200  # of a program; a turret has about twelve
GROOVE = 3.0  # width of a grooving tool whose width is not given [mm] (assumption)
DRILL = "drill"
MIN_WIDTH, MAX_WIDTH = 0.01, 500.0  # of a grooving tool or a drill [mm]
MARGIN = 0.5  # length around a cut in which a hole is looked for [mm]
SOLID = 0.99  # share of metal around the axis from which a stock has no hole [-]


def kinds_of(moves: Moves, given: Mapping[str, str]) -> dict[str, str]:
    """Return the kinds of all tools: as given, or as they move.

    A drill cuts along the axis alone, or pecks along Z at one diameter. A grooving tool plunges along X and returns the same way
    more often than it cuts along Z. A tool that roughs or finishes the contour of a cycle turns the side of that cycle; of
    others, one that returns nearer to the axis than it cut turns inside.

    Raises:
        NcError: a given tool is not in the program, or the program has too many tools.
    """
    habits = _habits(moves)
    for name in given:
        if name not in habits:
            raise NcError(f"tool {name!r} is not in the program, which has {', '.join(habits)}")
    if len(habits) > MAX_TOOLS:
        raise NcError(
            f"the program uses {len(habits)} tools, but {MAX_TOOLS} at most are played: are its T words tools?"
        )
    return {tool: given.get(tool) or seen.kind() for tool, seen in habits.items()}


def inside_solid(
    moves: Moves, kinds: Mapping[str, str], given: Mapping[str, str], stock: Any
) -> set[str]:
    """Return the tools that move as if they turned inside, but find no hole.

    A hole is in the stock (a polygon), or an earlier tool makes it: a drill, or one that cuts along Z nearer to the axis.
    """
    found: set[str] = set()
    nearest = math.inf  # radius of earlier cuts along Z [mm]
    for tool, seen in _habits(moves).items():
        guessed = tool not in given and kinds[tool].endswith("inside") and not seen.cycle_sides
        if guessed and nearest >= seen.nearest and not seen.has_hole(stock):
            found.add(tool)
        nearest = min(nearest, 0.0 if kinds[tool].startswith(DRILL) else seen.nearest)
    return found


def cuts(move: Move) -> bool:
    """Return whether a move is one at feed, and not so fast that it only places the tool."""
    return move.kind == "feed" and not (move.per_revolution and move.feed.value > MAX_CUTTING_FEED)


@dataclass
class _Habits:
    """How a tool moves."""

    along: int = 0  # cuts along Z
    pecks: int = 0  # cuts along Z that return the same way
    plunges: int = 0  # cuts towards the axis that return the same way
    plunges_inside: int = 0  # cuts away from the axis that return the same way
    returns: int = 0  # returns farther from the axis than the cut, less those nearer to it
    cycle_sides: set[str] = field(default_factory=set)  # sides of the cycles whose contours it cuts
    radii: set[float] = field(default_factory=set)  # at the ends of its cuts [mm]
    places: list[float] = field(default_factory=list)  # Z at the ends of its cuts [mm]
    nearest: float = math.inf  # least radius of its cuts along Z [mm]
    cut: Path | None = None  # the last cut along Z, while the tool has not returned

    def kind(self) -> str:
        """Return the kind of the tool."""
        if self.radii == {0.0}:
            return DRILL
        if len(self.radii) == 1 and self.pecks > 1:
            diameter = 2.0 * max(self.radii)
            if MIN_WIDTH <= diameter <= MAX_WIDTH:
                return f"{DRILL}:{diameter:g}"
        if self.plunges > self.along:
            return f"groove:{GROOVE:g}"
        if self.plunges_inside > self.along:
            return f"groove:{GROOVE:g}-inside"
        if self.cycle_sides:
            return "inside" if self.cycle_sides == {"inside"} else "outside"
        return "inside" if self.returns < 0 else "outside"

    def has_hole(self, stock: Any) -> bool:
        """Return whether a stock has a hole where the tool cuts."""
        low, high = min(self.places), min(max(self.places), float(stock.bounds[2]))
        radius = self.nearest if self.along else min(self.radii)
        core = shapely.box(low - MARGIN, 0.0, max(high, low + MARGIN), 0.5 * radius)
        return bool(shapely.intersection(stock, core).area < SOLID * core.area)

    def watch(self, move: Move, after: Move, sides: Mapping[int, Any]) -> None:
        """Take note of a move and of the one that follows it."""
        (z, x), (end, end_x) = move.path.start, move.path.end
        next_z, next_x = after.path.end
        length, height = abs(end - z), abs(end_x - x)
        if not cuts(move):
            if self.cut and length > 1.0:
                beside = 0.5 * (abs(x) + abs(end_x)) - abs(self.cut.end[1])
                self.returns += (beside > 1e-6) - (beside < -1e-6)
                self.cut = None
            return
        self.radii |= {round(abs(radius), 4) for radius in move.path.reach}
        self.places += (z, end)
        if length > max(5.0 * height, 1.0):
            self.cut, self.along = move.path, self.along + 1
            self.nearest = min(self.nearest, abs(x), abs(end_x))
        elif self.cut and height > self.cut.length:  # it faces
            self.cut = None
        if z == end == next_z < 0.0:
            self.plunges += abs(end_x) < min(abs(x), abs(next_x))
            self.plunges_inside += abs(end_x) > max(abs(x), abs(next_x))
        self.pecks += x == end_x == next_x and end < min(z, next_z)
        side = sides.get(move.finishes or (move.line if move.cycle_pass else 0))
        if side is not None:
            self.cycle_sides.add(side.name)


def _habits(moves: Moves) -> dict[str, _Habits]:
    """Return how each tool moves, in the order in which they are used."""
    by_tool: dict[str, list[Move]] = {}
    for move in moves.moves:
        own = by_tool.setdefault(move.tool, [])
        if move.kind != "dwell":
            own.append(move)
    habits = {}
    for tool, own in by_tool.items():
        habits[tool] = _Habits()
        for move, after in itertools.pairwise([*own, *own[-1:]]):
            habits[tool].watch(move, after, moves.sides)
    return habits
