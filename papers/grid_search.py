"""The grid search of Alaskari and Oraby (2018) in every minute of its edge's life, with the paper's grid and limits.

The paper calls a minute a time interval.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.grid_search import GridSearch, best_pair, grid, highest_feed, predict
from papers import record
from turning_env import Scenario
from turning_env.physics.records import parameter_records

Array = NDArray[np.float64]
FINE = (76, 109)
"""Cutting speeds and feeds of the plane: two to a step of the search's grid, and the search's own."""


@dataclass(frozen=True)
class Responses:
    """Responses at the end of a minute, at pairs of cutting speed and feed; arrays of one shape."""

    scenario: Scenario
    speed: Array
    """Speed [m/min]."""
    feed: Array
    """Feed [mm/rev]."""
    wear: Array
    """Wear [mm]."""
    thrust_force: Array
    """Thrust force [N]."""
    power: Array
    """Power [kW]."""

    @property
    def removal_rate(self) -> Array:
        """Metal removal rate [cm3/min]."""
        return self.speed * self.feed * self.scenario.workpiece.depth_of_cut

    @property
    def within(self) -> NDArray[np.bool_]:
        """Whether wear, force and power are all within their limits."""
        limits = self.scenario.limits
        held = (self.thrust_force <= limits.thrust_force) & (self.power <= limits.power)
        return np.asarray(held & (self.wear <= self.scenario.tool.wear_criterion))


class PaperRun:
    """The paper's grid and limits on its nominal models; ``start`` is the edge's cutting time before a minute [min]."""

    def __init__(self) -> None:
        self.scenario = Scenario.load("paper")
        self.parameters = parameter_records(self.scenario)[0]
        self.speeds, self.feeds = grid(self.scenario)
        self.limits = (self.scenario.limits.thrust_force, self.scenario.limits.power, 1.0)

    def used_life(self, wear: float) -> float:
        """Return the used share of the life [-] at a wear [mm]."""
        return float((wear / self.scenario.tool.wear_criterion) ** (1.0 / self.scenario.material.wear.time))

    def chosen(self, wear: float, start: float) -> tuple[float, float] | None:
        """Return (cutting speed [m/min], feed [mm/rev]) for the next minute, or None if none is feasible."""
        life = self.used_life(wear)
        speed, feed = best_pair(self.parameters, self.speeds, self.feeds, life, start, start + 1.0, *self.limits)
        return None if speed < 0 else (float(self.speeds[speed]), float(self.feeds[feed]))

    def responses(self, wear: float, start: float, speed: Array, feed: Array) -> Responses:
        """Return the responses if the next minute is cut with pairs, arrays of one shape."""
        used, force, power = predict(self.parameters, speed, feed, self.used_life(wear), start, start + 1.0)
        worn = self.scenario.tool.wear_criterion * used**self.scenario.material.wear.time
        return Responses(self.scenario, speed, feed, worn, force, power)

    def best_at_each_speed(self, wear: float, start: float) -> Responses:
        """Return the responses at each of the grid's cutting speeds with the highest feed that keeps all limits.

        Where wear allows none, the highest feed that keeps force and power; where they allow none either, the lowest.
        """
        force, power, _ = self.limits
        now = self.used_life(wear), start, start + 1.0
        feeds = []
        for speed in self.speeds:
            found = (highest_feed(self.parameters, speed, self.feeds, *now, force, power, life) for life in (1.0, math.inf))
            feeds.append(self.feeds[next((index for index in found if index >= 0), 0)])
        return self.responses(wear, start, self.speeds, np.array(feeds))


class Minute(NamedTuple):
    """One minute of the edge's life: the grid's pair, and the environment's response to the controller's action."""

    pair: tuple[float, float]
    commanded: tuple[float, float]
    """Pair of cutting speed [m/min] and feed [mm/rev]."""
    removed: float
    """Removed [cm3]."""
    wear: float
    """Wear [mm]."""
    thrust_force: float
    """Thrust force [N]."""
    power: float
    """Power [kW]."""
    finished: bool
    """Whether the edge was worn out or broken."""


@cache
def paper_run() -> PaperRun:
    """Return the paper's grid, limits and models."""
    return PaperRun()


@cache
def whole_life() -> tuple[Minute, ...]:
    """Return the edge's whole life, played on the environment until no pair is feasible."""
    run, minutes = paper_run(), []
    kept = record(GridSearch(run.scenario, 1), run.scenario, [0])
    wear = 0.0
    for step in range(len(kept["wear"])):
        if (pair := run.chosen(wear, step)) is None:
            break
        now = {name: values[step, 0].item() for name, values in kept.items() if name != "observation"}
        wear = now["wear"]
        state = now["removed"], wear, now["thrust_force"], now["power"], now["finished"]
        minutes.append(Minute(pair, (now["cutting_speed"], now["feed"]), *state))
    return tuple(minutes)


def wear_before(minute: int) -> float:
    """Return the wear of the grid search's edge [mm] at the start of a minute, 1 to 15, of its life."""
    return 0.0 if minute == 1 else whole_life()[minute - 2].wear


def best_at_each_speed(minute: int) -> Responses:
    """Return the responses at the best feed of each cutting speed in a minute."""
    return paper_run().best_at_each_speed(wear_before(minute), minute - 1.0)


def responses(minute: int, speed: Array, feed: Array) -> Responses:
    """Return the responses if a minute is cut with pairs, arrays of one shape."""
    return paper_run().responses(wear_before(minute), minute - 1.0, speed, feed)


def plane(minute: int) -> Responses:
    """Return the responses on the whole plane in a minute, arrays of shape (feeds, cutting speeds)."""
    run = paper_run()
    axes = zip((run.speeds, run.feeds), FINE, strict=True)
    return responses(minute, *np.meshgrid(*(np.linspace(values[0], values[-1], count) for values, count in axes)))


def sides(minute: int) -> int:
    """Return how many sides, and so corners, the feasible region of the plane has; 0 if nothing is feasible."""
    found, limits = plane(minute), paper_run().scenario.limits
    columns = np.flatnonzero(found.within.any(axis=0))
    if not columns.size:
        return 0
    last = found.within.shape[0] - 1
    tops = (last - np.argmax(found.within[::-1], axis=0))[columns]
    force, power = (values[np.minimum(tops + 1, last), columns] for values in (found.thrust_force, found.power))
    # What ends the region upwards, in every column: the range of feeds, force, power or wear.
    above = np.select([tops == last, force > limits.thrust_force, power > limits.power], [0, 1, 2], 3)
    return int(2 + np.count_nonzero(np.diff(above)) + (tops[0] > 0) + (tops[-1] > 0))
