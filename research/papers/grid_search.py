"""The grid search of Alaskari and Oraby (2018) in every minute of its edge's life, with the paper's grid and limits.

The paper calls a minute a time interval.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.grid_search import GridSearch, Limits, best_pair, grid, highest_feed, predict
from research.papers import record
from turning_env import Scenario
from turning_env.physics.records import parameter_records

Array = NDArray[np.float64]
FINE = (
    76,
    109,
)  # cutting speeds and feeds of the plane: two to a step of the search's grid, and the search's own


SCENARIO = Scenario.load("paper")
LIMITS = Limits(SCENARIO.limits.thrust_force, SCENARIO.limits.power, used_life=1.0)
SPEEDS, FEEDS = grid(SCENARIO)
_PARAMETERS = parameter_records(SCENARIO)[0]


class Responses(NamedTuple):
    """Responses at the end of a minute, at pairs of cutting speed and feed; arrays of one shape."""

    speed: Array  # [m/min]
    feed: Array  # [mm/rev]
    wear: Array  # [mm]
    thrust_force: Array  # [N]
    power: Array  # [kW]

    @property
    def removal_rate(self) -> Array:
        """Metal removal rate [cm3/min]."""
        return self.speed * self.feed * SCENARIO.workpiece.depth_of_cut

    @property
    def within(self) -> NDArray[np.bool_]:
        """Whether wear, force and power are all within their limits."""
        force, power, _ = LIMITS
        return (
            (self.thrust_force <= force)
            & (self.power <= power)
            & (self.wear <= SCENARIO.tool.wear_criterion)
        )


def _now(wear: float, start: float) -> tuple[float, float, float]:
    """Return the used share of life [-] at a wear [mm], and the cutting times [min] at which a minute begins and ends."""
    return (
        float((wear / SCENARIO.tool.wear_criterion) ** (1.0 / SCENARIO.material.wear.time)),
        start,
        start + 1.0,
    )


def chosen(wear: float, start: float) -> tuple[float, float] | None:
    """Return (cutting speed [m/min], feed [mm/rev]) for the next minute, or None if none is feasible.

    Args:
        wear: of the edge [mm].
        start: cutting time of the edge [min].
    """
    speed, feed = best_pair(_PARAMETERS, SPEEDS, FEEDS, *_now(wear, start), LIMITS)
    return None if speed < 0 else (float(SPEEDS[speed]), float(FEEDS[feed]))


def responses(wear: float, start: float, speed: Array, feed: Array) -> Responses:
    """Return the responses if the next minute is cut with pairs, arrays of one shape: see ``chosen``."""
    used, force, power = predict(_PARAMETERS, speed, feed, *_now(wear, start))
    return Responses(
        speed, feed, SCENARIO.tool.wear_criterion * used**SCENARIO.material.wear.time, force, power
    )


def best_at_each_speed(wear: float, start: float) -> Responses:
    """Return the responses at each of the grid's cutting speeds with the highest feed that keeps all limits.

    Where wear allows none, the highest feed that keeps force and power; where they allow none either, the lowest.
    """
    now, (force, power, _) = _now(wear, start), LIMITS
    feeds = []
    for speed in SPEEDS:
        found = (
            highest_feed(_PARAMETERS, speed, FEEDS, *now, Limits(force, power, life))
            for life in (1.0, math.inf)
        )
        feeds.append(FEEDS[next((index for index in found if index >= 0), 0)])
    return responses(wear, start, SPEEDS, np.array(feeds))


def plane(wear: float, start: float) -> Responses:
    """Return the responses on the whole plane, arrays of shape (feeds, cutting speeds)."""
    axes = (
        np.linspace(values[0], values[-1], count)
        for values, count in zip((SPEEDS, FEEDS), FINE, strict=True)
    )
    return responses(wear, start, *np.meshgrid(*axes))


class Minute(NamedTuple):
    """One minute of the edge's life: the environment's response to the controller's action."""

    pair: tuple[float, float]  # pair of cutting speed [m/min] and feed [mm/rev]
    removed: float  # [cm3]
    wear: float  # [mm]
    thrust_force: float  # [N]
    power: float  # [kW]
    finished: bool  # whether the edge was worn out or broken


@cache
def whole_life() -> tuple[Minute, ...]:
    """Return the edge's whole life, played on the environment until no pair is feasible."""
    minutes = []
    kept = record(GridSearch(SCENARIO, 1), SCENARIO, [0])
    wear = 0.0
    for step in range(len(kept["wear"])):
        if chosen(wear, step) is None:
            break
        now = {
            name: values[step, 0].item() for name, values in kept.items() if name != "observation"
        }
        wear = now["wear"]
        state = now["removed"], wear, now["thrust_force"], now["power"], now["finished"]
        minutes.append(Minute((now["cutting_speed"], now["feed"]), *state))
    return tuple(minutes)


def before(minute: int) -> tuple[float, float]:
    """Return wear [mm] and cutting time [min] of the grid search's edge at the start of a minute, 1 to 15, of its life."""
    return (0.0 if minute == 1 else whole_life()[minute - 2].wear), minute - 1.0


def sides(minute: int) -> int:
    """Return how many sides, and so corners, the feasible region of the plane has; 0 if nothing is feasible."""
    found = plane(*before(minute))
    columns = np.flatnonzero(found.within.any(axis=0))
    if not columns.size:
        return 0
    last = found.within.shape[0] - 1
    tops = (last - np.argmax(found.within[::-1], axis=0))[columns]
    force, power = (
        values[np.minimum(tops + 1, last), columns] for values in (found.thrust_force, found.power)
    )
    # What ends the region upwards, in every column: the range of feeds, force, power or wear.
    above = np.select([tops == last, force > LIMITS[0], power > LIMITS[1]], [0, 1, 2], 3)
    return int(2 + np.count_nonzero(np.diff(above)) + (tops[0] > 0) + (tops[-1] > 0))
