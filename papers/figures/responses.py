"""What the grid search computes in one minute of its edge's life: at each cutting speed, and over the whole plane."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from baselines.grid_search import highest_feed, predict
from papers.reproduce.alaskari_oraby import PaperRun, whole_life

Array = NDArray[np.float64]
FINE = (76, 109)
"""Cutting speeds and feeds of the plane: two to a step of the search's grid, and the search's own."""


@cache
def paper_run() -> PaperRun:
    """Return the paper's grid, limits and models."""
    return PaperRun()


def wear_before(minute: int) -> float:
    """Return the wear of the grid search's edge [mm] at the start of a minute, 1 to 15, of its life."""
    return 0.0 if minute == 1 else whole_life()[minute - 2].wear


@dataclass(frozen=True)
class Responses:
    """Responses at the end of a minute, at pairs of cutting speed and feed; arrays of one shape."""

    speed: Array
    """[m/min]"""
    feed: Array
    """[mm/rev]"""
    wear: Array
    """[mm]"""
    thrust_force: Array
    """[N]"""
    power: Array
    """[kW]"""

    @property
    def removal_rate(self) -> Array:
        """Metal removal rate [cm3/min]."""
        return self.speed * self.feed * paper_run().scenario.workpiece.depth_of_cut

    @property
    def within(self) -> NDArray[np.bool_]:
        """Whether wear, force and power are all within their limits."""
        scenario = paper_run().scenario
        held = (self.thrust_force <= scenario.limits.thrust_force) & (self.power <= scenario.limits.power)
        return np.asarray(held & (self.wear <= scenario.tool.wear_criterion))


def responses(minute: int, speed: Array, feed: Array) -> Responses:
    """Return the responses if the minute is cut with pairs, arrays of one shape."""
    run, life = paper_run(), paper_run().used_life(wear_before(minute))
    found = [
        predict(run.parameters, float(v), float(f), life, minute - 1.0, float(minute))
        for v, f in zip(speed.flat, feed.flat, strict=True)
    ]
    used, force, power = (np.reshape(column, speed.shape) for column in zip(*found, strict=True))
    wear = run.scenario.tool.wear_criterion * used**run.scenario.material.wear.time
    return Responses(speed, feed, wear, force, power)


@cache
def best_at_each_speed(minute: int) -> Responses:
    """Return the search's pair at each of its cutting speeds: that of the highest feed which keeps all limits.

    Where wear allows none, the highest feed that keeps force and power; where they allow none either, the lowest.
    """
    run, life, feeds = paper_run(), paper_run().used_life(wear_before(minute)), []
    force_limit, power_limit, _ = run.limits
    for speed in run.speeds:
        for most_life in (1.0, math.inf):
            limits = (force_limit, power_limit, most_life)
            index = highest_feed(run.parameters, speed, run.feeds, life, minute - 1.0, float(minute), *limits)
            if index >= 0:
                break
        feeds.append(run.feeds[max(index, 0)])
    return responses(minute, run.speeds, np.array(feeds))


@cache
def plane(minute: int) -> Responses:
    """Return the whole plane, arrays of shape (feeds, cutting speeds)."""
    run = paper_run()
    speeds, feeds = (
        np.linspace(values[0], values[-1], count) for values, count in zip((run.speeds, run.feeds), FINE, strict=True)
    )
    return responses(minute, *np.meshgrid(speeds, feeds))


def sides(minute: int) -> int:
    """Return how many sides, and so corners, the feasible region of the plane has; 0 where nothing is feasible."""
    found, most = plane(minute), paper_run().scenario.limits
    columns = np.flatnonzero(found.within.any(axis=0))
    if not columns.size:
        return 0
    last = found.within.shape[0] - 1
    tops = (last - np.argmax(found.within[::-1], axis=0))[columns]
    force, power = (values[np.minimum(tops + 1, last), columns] for values in (found.thrust_force, found.power))
    # What ends the region upwards, in every column: the range of feeds, force, power or wear.
    above = np.select([tops == last, force > most.thrust_force, power > most.power], [0, 1, 2], 3)
    return int(2 + np.count_nonzero(np.diff(above)) + (tops[0] > 0) + (tops[-1] > 0))
