"""Threading cycles (G76, CYCLE97): the passes that a control makes.

Controls differ in where a pass begins and in how the tool leaves the thread; these moves are in air.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from turning_nc.blocks import Problem
from turning_nc.paths import Path, Point, joined

MAX_PASSES = 1000


@dataclass(frozen=True)
class Thread:
    """A thread, from its first turn to its last."""

    start: Point
    """Where passes begin along Z, and where the tool is clear of the thread along X."""
    end: float
    """Z at which passes end [mm]."""
    roots: tuple[float, float]
    """Radius at the root where passes begin and end [mm]."""
    height: float
    """Of the thread [mm]."""
    angle: float = 0.0
    """Angle by which the tool goes in aslant: half the thread's angle to cut with one flank [degrees]."""


def decreasing(height: float, first: float, smallest: float, allowance: float, finishing: int) -> list[float]:
    """Return the depths of all passes: first * sqrt(n), ``smallest`` apart at least, and the finishing passes [mm].

    Raises:
        Problem: there is no depth, or there are too many passes.
    """
    if not (first > 0.0 and height > allowance >= 0.0):
        raise Problem(f"a thread {height:g} mm high with a first pass of {first:g} mm and {allowance:g} mm left cannot be cut")
    depths = [min(first, height - allowance)]
    while depths[-1] < height - allowance - 1e-9:
        depths.append(min(max(first * math.sqrt(len(depths) + 1), depths[-1] + smallest), height - allowance))
        if len(depths) > MAX_PASSES:
            raise Problem(f"a thread of more than {MAX_PASSES} passes is not made: is the first depth right?")
    return depths + [height] * finishing


def thread_passes(thread: Thread, depths: list[float]) -> Iterator[list[Path]]:
    """Yield the moves of every pass, from the start back to it; the second or third is the cut."""
    outwards = math.copysign(1.0, thread.start[1] - thread.roots[0])
    along = math.copysign(1.0, thread.end - thread.start[0])
    clear = thread.start[1]
    for depth in depths:
        over = outwards * (thread.height - depth)
        begin = thread.start[0] + along * depth * math.tan(math.radians(thread.angle))
        yield list(
            joined(
                thread.start,
                ((begin, clear), True),
                ((begin, thread.roots[0] + over), True),
                ((thread.end, thread.roots[1] + over), False),
                ((thread.end, clear), True),
                (thread.start, True),
            )
        )
