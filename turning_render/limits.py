"""Limits in the plane of log cutting speed and log feed: straight lines, as all models are power laws."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turning_env.scenario import Scenario
from turning_env.scenario.power_law import PowerLaw

Array = NDArray[np.float64]
Point = tuple[float, float]
"""Natural logarithms of cutting speed [m/min] and feed [mm/rev]."""


class HalfPlane(NamedTuple):
    """The allowed side of a limit: cutting_speed log vc + feed log f <= room."""

    cutting_speed: float
    feed: float
    room: float


class Cut(NamedTuple):
    """A cut: depth of cut [mm], relative hardness [-] and flank wear [mm]."""

    depth: float
    hardness: float
    wear: float


def bound(law: PowerLaw, most: float, cut: Cut) -> HalfPlane:
    """Return where a response does not exceed ``most``, in its unit."""
    rest = float(law(1.0, 1.0, cut.depth, 1.0, cut.wear, cut.hardness))
    return HalfPlane(law.cutting_speed, law.feed, math.log(most / rest))


def wear_bound(scenario: Scenario, cut: Cut, wear_factor: float, used_life: float, cutting_time: float) -> HalfPlane:
    """Return where the edge outlasts the next step; see ``turning_env.physics.wear``.

    ``cutting_time`` of the edge is in min.
    """
    law, criterion, minutes = scenario.material.wear, scenario.tool.wear_criterion, scenario.control.interval / 60.0
    if scenario.tool.wear_rule == "equivalent_time":
        left = max(1.0 - used_life, 1e-9)
        most = criterion * (left / minutes) ** law.time
    else:
        left = max(criterion * (1.0 - used_life**law.time), 1e-9)
        most = left / ((cutting_time + minutes) ** law.time - cutting_time**law.time)
    return bound(law, most / wear_factor, Cut(cut.depth, cut.hardness, 1.0))


def _clip(corners: Sequence[Point], limit: HalfPlane) -> tuple[list[Point], list[Point]]:
    """Return the corners of what a limit leaves of a convex polygon, and those of them that lie on its line."""
    kept: list[Point] = []
    crossings: list[Point] = []
    for before, after in zip([*corners[-1:], *corners[:-1]], corners, strict=True):
        ours, theirs = (limit.cutting_speed * x + limit.feed * y - limit.room for x, y in (before, after))  # negative within
        if (ours <= 0.0) != (theirs <= 0.0):
            share = ours / (ours - theirs)
            crossings.append((before[0] + share * (after[0] - before[0]), before[1] + share * (after[1] - before[1])))
            kept.append(crossings[-1])
        if theirs <= 0.0:
            kept.append(after)
    return kept, crossings


def region(corners: Sequence[Point], limits: Sequence[HalfPlane]) -> list[Point]:
    """Return the corners of what limits leave of a convex polygon, none if nothing (Sutherland and Hodgman 1974)."""
    left = list(corners)
    for limit in limits:
        left, _ = _clip(left, limit)
    return left


def border(corners: Sequence[Point], limit: HalfPlane) -> tuple[Point, Point] | None:
    """Return where the line of a limit enters and leaves a convex polygon, or None where it does not."""
    _, crossings = _clip(corners, limit)
    return (crossings[0], crossings[1]) if len(crossings) == 2 else None


def highest_feed(law: PowerLaw, most: float, cutting_speed: float, depth: Array, hardness: Array, wear: float) -> Array:
    """Return the feed [mm/rev] at which a response reaches ``most`` at depths [mm] and hardnesses [-]; infinite if none does."""
    if law.feed <= 0.0:
        return np.full(depth.shape, np.inf)
    rest = law(cutting_speed, 1.0, depth, 1.0, wear, hardness)
    feeds: Array = (most / rest) ** (1.0 / law.feed)
    return feeds
