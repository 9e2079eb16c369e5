"""Where limits are reached in the plane of log cutting speed and log feed: straight lines, as all models are power laws."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turning_env.scenario import Scenario
from turning_env.scenario.power_law import PowerLaw

Point = tuple[float, float]
"""Natural logarithms of cutting speed [m/min] and feed [mm/rev]."""


@dataclass(frozen=True)
class HalfPlane:
    """Allowed is cutting_speed log V + feed log f <= room."""

    cutting_speed: float
    feed: float
    room: float

    def excess(self, point: Point) -> float:
        """By how much a point lies beyond, negative within."""
        return self.cutting_speed * point[0] + self.feed * point[1] - self.room


@dataclass(frozen=True)
class Cut:
    """What is cut, with what: depth of cut [mm], relative hardness [-] and flank wear [mm]."""

    depth: float
    hardness: float
    wear: float


def bound(law: PowerLaw, most: float, cut: Cut) -> HalfPlane:
    """Where a response does not exceed ``most``, in its unit."""
    rest = float(law(1.0, 1.0, cut.depth, 1.0, cut.wear, cut.hardness))
    return HalfPlane(law.cutting_speed, law.feed, math.log(most / rest))


def wear_bound(scenario: Scenario, cut: Cut, wear_factor: float, used_life: float, cutting_time: float) -> HalfPlane:
    """Where the edge outlasts the next interval: see ``turning_env.physics.wear``; ``cutting_time`` of the edge [min]."""
    law, criterion, interval = scenario.material.wear, scenario.tool.wear_criterion, scenario.control.interval / 60.0
    if scenario.tool.wear_rule == "equivalent_time":
        left = max(1.0 - used_life, 1e-9)
        most = criterion * (left / interval) ** law.time
    else:
        left = max(criterion * (1.0 - used_life**law.time), 1e-9)
        most = left / ((cutting_time + interval) ** law.time - cutting_time**law.time)
    return bound(law, most / wear_factor, Cut(cut.depth, cut.hardness, 1.0))


def region(corners: Sequence[Point], limits: Sequence[HalfPlane]) -> list[Point]:
    """What limits leave of a convex polygon: its corners, none where nothing is left (Sutherland and Hodgman 1974)."""
    left = list(corners)
    for limit in limits:
        kept: list[Point] = []
        for before, after in zip([*left[-1:], *left[:-1]], left, strict=True):
            ours, theirs = limit.excess(before), limit.excess(after)
            if (ours <= 0.0) != (theirs <= 0.0):
                share = ours / (ours - theirs)
                kept.append((before[0] + share * (after[0] - before[0]), before[1] + share * (after[1] - before[1])))
            if theirs <= 0.0:
                kept.append(after)
        left = kept
    return left


def border(corners: Sequence[Point], limit: HalfPlane) -> tuple[Point, Point] | None:
    """Where the line of a limit enters and leaves a convex polygon."""
    crossings = []
    for before, after in zip([*corners[-1:], *corners[:-1]], corners, strict=True):
        ours, theirs = limit.excess(before), limit.excess(after)
        if (ours <= 0.0) != (theirs <= 0.0):
            share = ours / (ours - theirs)
            crossings.append((before[0] + share * (after[0] - before[0]), before[1] + share * (after[1] - before[1])))
    return (crossings[0], crossings[1]) if len(crossings) == 2 else None


def highest_feed(
    law: PowerLaw, most: float, cutting_speed: float, depth: NDArray[np.float64], hardness: NDArray[np.float64], wear: float
) -> NDArray[np.float64]:
    """The feed [mm/rev] at which a response reaches ``most``, where a bar is so deep [mm] and hard [-]; infinite if none does."""
    if law.feed <= 0.0:
        return np.full(depth.shape, np.inf)
    rest = law(cutting_speed, 1.0, depth, 1.0, wear, hardness)
    feeds: NDArray[np.float64] = (most / rest) ** (1.0 / law.feed)
    return feeds
