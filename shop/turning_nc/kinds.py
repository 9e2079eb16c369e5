"""Kinds of tools as their moves show them: outside or inside, drills, grooving tools.

A program names its tools by numbers alone. What shape a kind has is left to ``tool_shapes``.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from turning_nc.cycles import Side
from turning_nc.moves import Move, Moves
from turning_nc.paths import Path
from turning_nc.words import NcError
from turning_shop.catalogue import nearest

from turning_env.extras import needed

with needed():
    import shapely

MAX_CUTTING_FEED = 1.5  # feed above which a tool is only placed [mm/rev] (assumption)
MAX_TOOLS = 200  # of a program; a turret has about twelve
GROOVE = 3.0  # width of a grooving tool whose width is not given [mm] (assumption)
DRILL = "drill"
FACE_GROOVE = "face-groove"

# Of a grooving tool or a drill [mm].
MIN_WIDTH = 0.01
MAX_WIDTH = 500.0
MARGIN = 0.5  # length around a cut in which a hole is looked for [mm]
SOLID = 0.99  # share of metal around the axis from which a stock has no hole [-]

# A cut along Z is longer than this [mm], and than this many times its height (assumptions).
MIN_CUT = 1.0
MIN_SLENDERNESS = 5.0
SAME_RADIUS = 1e-6  # difference of radii below which a tool returns as it cut [mm]


def kinds_of(moves: Moves, given: Mapping[str, str]) -> dict[str, str]:
    """Return the kinds of all tools: as given, or as they move; see ``ToolKinds``."""
    return ToolKinds(moves, given).by_tool


class ToolKinds:
    """Kinds of a program's tools: as given, or as they move.

    A drill cuts along the axis alone, or pecks along Z at one diameter. A grooving tool plunges
    along X and returns the same way more often than it cuts along Z. A tool that roughs or
    finishes the contour of a cycle turns the side of that cycle. Of others, one that returns
    nearer to the axis than it cut turns inside.
    """

    def __init__(self, moves: Moves, given: Mapping[str, str]) -> None:
        """Look through the moves once.

        Raises:
            NcError: a given tool is not in the program, or the program has too many tools.
        """
        self._uses = _uses_of_tools(moves)
        self._given = given
        check_called(given, self._uses)
        if len(self._uses) > MAX_TOOLS:
            raise NcError(
                f"the program uses {len(self._uses)} tools, but {MAX_TOOLS} at most are played: "
                "are its T words tools?"
            )
        self.by_tool: dict[str, str] = {}
        for tool, use in self._uses.items():
            self.by_tool[tool] = given.get(tool) or use.kind()

    def without_hole(self, stock: Any) -> set[str]:
        """Return the tools that move as if they turned inside, but find no hole.

        A hole is in the stock (a polygon), or an earlier tool makes it: a drill, or one that cuts
        along Z nearer to the axis.
        """
        tools: set[str] = set()
        nearest = math.inf  # radius of earlier cuts along Z [mm]
        for tool, use in self._uses.items():
            kind = self.by_tool[tool]
            is_guessed = tool not in self._given and not use.cycle_sides
            needs_hole = kind.endswith("inside") and nearest >= use.nearest
            if is_guessed and needs_hole and not use.has_hole(stock):
                tools.add(tool)
            nearest = min(nearest, 0.0 if kind.startswith(DRILL) else use.nearest)
        return tools


def check_called(names: Iterable[str], tools: Collection[str]) -> None:
    """Check that a program calls tools by their names.

    Raises:
        NcError: it does not call one of them.
    """
    for name in names:
        if name in tools:
            continue
        text = f"tool {name!r} is not in the program, which calls {', '.join(tools)}"

        # T1 stands for T0101, as people say it.
        digits = name.replace("0", "")
        spoken = [tool for tool in tools if tool.replace("0", "").startswith(digits)]
        similar = nearest(name, tools) or ", ".join(spoken)
        if similar:
            text += f": is it {similar}?"
        raise NcError(text)


def diameter_of_drill(kind: str) -> float | None:
    """Return the diameter of a drill [mm]; None if it is not known, or the tool is no drill."""
    family, _, diameter = kind.partition(":")
    return float(diameter) if family == DRILL and diameter else None


def cuts(move: Move) -> bool:
    """Return whether a move is one at feed, and not so fast that it only places the tool."""
    is_fast = move.per_revolution and move.feed.value > MAX_CUTTING_FEED
    return move.kind == "feed" and not is_fast


@dataclass
class ToolUse:
    """How a tool moves."""

    along: int = 0  # cuts along Z
    pecks: int = 0  # cuts along Z that return the same way
    plunges: int = 0  # cuts towards the axis that return the same way
    plunges_inside: int = 0  # cuts away from the axis that return the same way
    returns_outside: int = 0  # returns farther from the axis than the cut
    returns_inside: int = 0  # returns nearer to the axis than the cut
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
        return "inside" if self.returns_inside > self.returns_outside else "outside"

    def has_hole(self, stock: Any) -> bool:
        """Return whether a stock has a hole where the tool cuts."""
        low = min(self.places)
        stock_end = float(stock.bounds[2])
        high = min(max(self.places), stock_end)
        high = max(high, low + MARGIN)
        radius = self.nearest if self.along else min(self.radii)
        core = shapely.box(low - MARGIN, 0.0, high, 0.5 * radius)
        metal = shapely.intersection(stock, core)
        return bool(metal.area < SOLID * core.area)

    def watch(self, move: Move, after: Move, sides: Mapping[int, Side]) -> None:
        """Take note of a move and of the one that follows it.

        ``sides`` are those of the program's roughing cycles, by their lines.
        """
        if not cuts(move):
            self._watch_return(move.path)
            return
        self._watch_cut(move.path)
        self._watch_way_back(move.path, after.path.end.z, after.path.end.x)
        # The line of the cycle to whose contour the move belongs; 0 if there is none.
        cycle = move.finishes
        if move.cycle_pass:
            cycle = move.line
        if cycle in sides:
            self.cycle_sides.add(sides[cycle].name)

    def _watch_return(self, path: Path) -> None:
        """Take note of a move along Z after a cut: beside it, or on its other side."""
        length = abs(path.end.z - path.start.z)
        if self.cut is None or length <= MIN_CUT:
            return
        mean_radius = 0.5 * (abs(path.start.x) + abs(path.end.x))
        beside = mean_radius - abs(self.cut.end.x)
        if beside > SAME_RADIUS:
            self.returns_outside += 1
        elif beside < -SAME_RADIUS:
            self.returns_inside += 1
        self.cut = None

    def _watch_cut(self, path: Path) -> None:
        """Take note of a cut, and whether it is along Z."""
        start = path.start
        end = path.end
        self.radii |= {round(abs(radius), 4) for radius in path.reach}
        self.places += (start.z, end.z)
        length = abs(end.z - start.z)
        height = abs(end.x - start.x)
        if length > max(MIN_SLENDERNESS * height, MIN_CUT):
            self.cut = path
            self.along += 1
            self.nearest = min(self.nearest, abs(start.x), abs(end.x))
        # A tool that faces a shoulder after its cut says nothing about the side by its return.
        elif self.cut is not None and height > self.cut.length:
            self.cut = None

    def _watch_way_back(self, path: Path, next_z: float, next_x: float) -> None:
        """Take note of a cut that returns the same way: a plunge along X, or a peck along Z.

        A plunge is behind the face, where Z is below 0.
        """
        start = path.start
        end = path.end
        if start.z == end.z == next_z < 0.0:
            bottom = abs(end.x)
            before = abs(start.x)
            after = abs(next_x)
            if bottom < min(before, after):
                self.plunges += 1
            if bottom > max(before, after):
                self.plunges_inside += 1
        stays_at_x = start.x == end.x == next_x
        if stays_at_x and end.z < min(start.z, next_z):
            self.pecks += 1


def _uses_of_tools(moves: Moves) -> dict[str, ToolUse]:
    """Return how each tool moves, in the order in which they are used."""
    moves_of_tools: dict[str, list[Move]] = {}
    for move in moves.moves:
        moves_of_tool = moves_of_tools.setdefault(move.tool, [])
        if move.kind != "dwell":
            moves_of_tool.append(move)
    uses = {}
    for tool, moves_of_tool in moves_of_tools.items():
        use = ToolUse()
        # Nothing follows the last move: it stands for the move after it.
        followers = [*moves_of_tool[1:], *moves_of_tool[-1:]]
        for move, after in zip(moves_of_tool, followers, strict=True):
            use.watch(move, after, sides=moves.sides)
        uses[tool] = use
    return uses
