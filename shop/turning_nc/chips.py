"""Chips of drills and threads, as the turning cut that takes the same power.

Kienzle's law gives all of them from one specific cutting force: Pc = kc A vc / 60000 [kW], with the
area A [mm2] of a chip that is h thick and b wide, and kc = kc1.1 h^-mc [N/mm2]. A scenario's law of
power is that of a turning cut with the feed h and the depth of cut b. So a chip's thickness and
width are all that drills and threads need of their own; ``cutting`` computes the power.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from turning_nc.moves import Move
from turning_nc.paths import Point
from turning_shop import Values

from turning_env.extras import needed

with needed():
    import shapely

SINE_OF_POINT = math.sin(math.radians(59.0))
"""Sine of the angle of a drill's edges to its axis: a point of 118 degrees (assumption)."""
EDGES_OF_DRILL = 2  # (assumption)
HALF_THREAD_ANGLE = math.radians(30.0)  # ISO metric and unified threads (assumption)
SAMPLES = 17  # places along a pass of a thread at which the stock is looked for
FAR = 1e5  # radius beyond every stock [mm]
SAME_PHASE = 0.01  # difference of the starts of passes, in turns, below which they count as one
SAME_RADIUS = 1e-6  # difference of radii below which they count as the same [mm]


def drilled_width(volume: Values, length: Values, diameter: Values) -> Values:
    """Return the width b of the chip of a drill with two edges [mm].

    Each edge cuts a chip of thickness h = f / 2 sin(kappa). A drill in solid metal needs
    Mc = kc f D^2 / 8000 [N m] and Pc = kc f D vc / 240000 [kW], with the speed vc [m/min] at its
    diameter D [mm] and the feed f [mm/rev] (ISCAR, rotating tools catalogue 2017, p. 601, and
    Sandvik Coromant's formulas of drilling, both with kc at the chip's thickness). This is
    Pc = kc h b vc / 60000 with h b = f D / 4, or f Q / (pi D) with the removed volume Q per length,
    which also holds for a hole that is drilled before.

    Args:
        volume: removed metal [mm3].
        length: of the path on which it is removed [mm].
        diameter: of the drill [mm].
    """
    area_per_feed = volume / (math.pi * diameter * length)
    return np.asarray(area_per_feed * EDGES_OF_DRILL / SINE_OF_POINT)


def drilled_thickness(feed: Values) -> Values:
    """Return the thickness h = f / 2 sin(kappa) of a drill's chip at a feed f [mm/rev], in mm."""
    return np.asarray(feed / EDGES_OF_DRILL * SINE_OF_POINT)


class Chip(NamedTuple):
    """A chip of constant thickness and width."""

    thickness: float  # [mm]
    width: float  # [mm]


NO_CHIP = Chip(thickness=0.0, width=0.0)


def thread_chip(before: float, after: float) -> Chip:
    """Return the chip of a pass that deepens a thread from one depth to another [mm].

    The profile is sharp, with 60 degrees between its flanks, and the tool goes in radially: the
    area is tan(30) (after^2 - before^2), and both flanks cut over their whole length. A tool that
    goes in along a flank cuts a thicker chip of the same area, which takes less power.
    """
    if after <= before:
        return NO_CHIP
    area = math.tan(HALF_THREAD_ANGLE) * (after**2 - before**2)
    width = 2.0 * after / math.cos(HALF_THREAD_ANGLE)
    return Chip(thickness=area / width, width=width)


@dataclass
class _Thread:
    """A thread that is being cut."""

    tool: str
    is_inside: bool
    low: float  # least Z [mm]
    high: float  # largest Z [mm]
    depth: float  # [mm]
    phase: float  # angle of the spindle at which the tool passes Z0, in turns from 0 to 1

    def apart(self, other: "_Thread") -> float:
        """Return the angle between the starts of two passes, in turns up to a half."""
        turns = abs(self.phase - other.phase)
        return min(turns, 1.0 - turns)

    def is_start_of(self, other: "_Thread") -> bool:
        """Return whether a pass of this thread may deepen to another: it is of the same start.

        Passes that go in along a flank begin a little later, the deeper they are. One of the same
        depth that begins elsewhere is of another start.
        """
        is_same_depth = abs(self.depth - other.depth) < SAME_RADIUS
        return not is_same_depth or self.apart(other) < SAME_PHASE

    def has(self, other: "_Thread") -> bool:
        """Return whether a pass belongs to the thread: at the same place, and no less deep.

        A pass that is less deep begins another start of a thread.
        """
        is_same_tool = self.tool == other.tool and self.is_inside == other.is_inside
        is_same_place = self.low < other.high and other.low < self.high
        is_as_deep = other.depth > self.depth - SAME_RADIUS
        return is_same_tool and is_same_place and is_as_deep


def thread_chips(moves: Sequence[Move], part: Any) -> dict[int, Chip | None]:
    """Return the chips of the passes of all threads, by the indices of their moves.

    A pass is as deep as its root lies below the surface of the part. It cuts the difference to the
    last pass at the same place; a pass that is no deeper cuts nothing. The chip is None if no pass
    of the tool meets metal, and for taps, which move along the axis.

    Args:
        moves: the moves of the program.
        part: the polygon of Z and radius after the last move; threads take nothing from it.
    """
    chips: dict[int, Chip | None] = {}
    threads: list[_Thread] = []
    in_metal: set[str] = set()  # tools
    for index, move in enumerate(moves):
        if move.kind != "thread":
            continue
        is_inside = _withdraws_inwards(moves, index)
        depth = _depth_below_surface(move, part, is_inside=is_inside)
        if depth is None:
            chips[index] = None
            continue
        in_metal.add(move.tool)
        start = move.path.start.z
        end = move.path.end.z
        cut = _Thread(
            move.tool,
            is_inside,
            low=min(start, end),
            high=max(start, end),
            depth=depth,
            phase=_phase(move),
        )
        same = [thread for thread in threads if thread.has(cut)]
        # Of a thread of several starts, the pass deepens the one that begins nearest to it.
        deepened = min(same, key=cut.apart, default=None)
        before = 0.0
        if deepened is not None and deepened.is_start_of(cut):
            before = deepened.depth
            threads.remove(deepened)
        threads.append(cut)
        chips[index] = thread_chip(before, depth)
    for index, chip in chips.items():
        # The first passes of a tool may be in air above the thread.
        if chip is None and moves[index].tool in in_metal:
            chips[index] = NO_CHIP
    return chips


def _phase(move: Move) -> float:
    """Return the angle of the spindle at which a thread's tool would pass Z0, in turns."""
    begin = move.path.start.z
    towards = math.copysign(1.0, move.path.end.z - begin)
    turns = move.start_angle / 360.0 - towards * begin / move.feed.value
    return turns % 1.0


def _withdraws_inwards(moves: Sequence[Move], index: int) -> bool:
    """Return whether the tool leaves the thread towards the axis, as inside a hole."""
    root = abs(moves[index].path.end.x)
    for move in moves[index + 1 :]:
        step = abs(move.path.end.x) - root
        if abs(step) > SAME_RADIUS:
            return step < 0.0
    return False


def _depth_below_surface(move: Move, part: Any, is_inside: bool) -> float | None:
    """Return how deep the root of a thread lies in the part [mm]; None if it is in air.

    The path of a tap, along the axis, counts as in air.
    """
    depths = []
    for share in np.linspace(0.0, 1.0, SAMPLES):
        start = move.path.start
        end = move.path.end
        place = Point(start.z + share * (end.z - start.z), start.x + share * (end.x - start.x))
        root = abs(place.x)
        ray = shapely.LineString(((place.z, 0.0), (place.z, FAR)))
        for piece in shapely.get_parts(shapely.intersection(part, ray)):
            _, low, _, high = piece.bounds
            if low <= root <= high and root > SAME_RADIUS:
                depths.append(root - low if is_inside else high - root)
    return max(depths, default=None)
