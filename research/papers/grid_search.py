"""The grid search of Alaskari and Oraby (2018) in each minute of its edge's life.

Grid and limits are the paper's, which calls a minute a time interval. ``baselines/grid_search.py``
holds the controller, ``reproduce/alaskari_oraby.py`` the comparison with the paper's numbers.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.grid_search import GridSearch, StepLimits, best_pair, grid, highest_feed, predict
from research.papers import record
from turning_env import Scenario
from turning_env.physics.records import parameter_records
from turning_env.scenario.laws import used_life_at

Array = NDArray[np.float64]

# The plane has two cutting speeds to a step of the search's grid, and the search's own feeds.
PLANE_SPEEDS = 76
PLANE_FEEDS = 109

SCENARIO = Scenario.load("paper")
LIMITS = StepLimits(
    force=SCENARIO.limits.thrust_force,
    power=SCENARIO.limits.power,
    used_life=1.0,
)
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
        return (
            (self.thrust_force <= LIMITS.force)
            & (self.power <= LIMITS.power)
            & (self.wear <= SCENARIO.tool.wear_criterion)
        )


class SpeedAndFeed(NamedTuple):
    """A pair of the grid."""

    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]


def used_life(wear: float) -> float:
    """Return the share of an edge's life that is used at a wear [mm]."""
    return float(used_life_at(SCENARIO, wear))


def chosen(wear: float, start: float) -> SpeedAndFeed | None:
    """Return the pair that the search chooses for the next minute, or None if none is feasible.

    Args:
        wear: wear of the edge [mm].
        start: cutting time of the edge [min].
    """
    pair = best_pair(
        _PARAMETERS,
        SPEEDS,
        feeds=FEEDS,
        used_life=used_life(wear),
        start=start,
        end=start + 1.0,
        limits=LIMITS,
    )
    if pair.speed < 0:
        return None
    return SpeedAndFeed(float(SPEEDS[pair.speed]), float(FEEDS[pair.feed]))


def responses(wear: float, start: float, speed: Array, feed: Array) -> Responses:
    """Return the responses if the next minute is cut at given speeds and feeds.

    Args:
        wear: wear of the edge [mm].
        start: cutting time of the edge [min].
        speed: cutting speeds [m/min].
        feed: feeds [mm/rev], of the same shape.
    """
    life, force, power = predict(
        _PARAMETERS, speed, feed, used_life=used_life(wear), start=start, end=start + 1.0
    )
    return Responses(
        speed=speed,
        feed=feed,
        wear=SCENARIO.tool.wear_criterion * life**SCENARIO.material.wear.time,
        thrust_force=force,
        power=power,
    )


def best_at_each_speed(wear: float, start: float) -> Responses:
    """Return the responses at each cutting speed of the grid with its best feed.

    The best feed is the highest that keeps all limits. Where wear allows none, it is the highest
    that keeps force and power. Where these allow none either, it is the lowest.
    """
    limits_without_wear = StepLimits(LIMITS.force, LIMITS.power, used_life=math.inf)
    feeds = np.empty(len(SPEEDS))
    for index, speed in enumerate(SPEEDS):
        for limits in (LIMITS, limits_without_wear):
            highest = highest_feed(
                _PARAMETERS,
                speed,
                feeds=FEEDS,
                used_life=used_life(wear),
                start=start,
                end=start + 1.0,
                limits=limits,
            )
            if highest >= 0:
                break
        feeds[index] = FEEDS[max(highest, 0)]
    return responses(wear, start, speed=SPEEDS, feed=feeds)


def plane(wear: float, start: float) -> Responses:
    """Return the responses on the whole plane, arrays of shape (feeds, cutting speeds)."""
    speeds = np.linspace(SPEEDS[0], SPEEDS[-1], num=PLANE_SPEEDS)
    feeds = np.linspace(FEEDS[0], FEEDS[-1], num=PLANE_FEEDS)
    speed, feed = np.meshgrid(speeds, feeds)
    return responses(wear, start, speed=speed, feed=feed)


class Minute(NamedTuple):
    """One minute of the edge's life: the environment's response to the controller's action."""

    pair: SpeedAndFeed
    removed: float  # [cm3]
    wear: float  # [mm]
    thrust_force: float  # [N]
    power: float  # [kW]
    finished: bool  # whether the edge was worn out or broken


@cache
def whole_life() -> tuple[Minute, ...]:
    """Return the edge's whole life, played on the environment until no pair is feasible."""
    recorded = record(GridSearch(SCENARIO, 1), SCENARIO, [0])
    minutes: list[Minute] = []
    wear = 0.0
    for step in range(len(recorded["wear"])):
        if chosen(wear, step) is None:
            break
        info = {name: values[step, 0] for name, values in recorded.items()}
        wear = float(info["wear"])
        minutes.append(
            Minute(
                pair=SpeedAndFeed(float(info["cutting_speed"]), float(info["feed"])),
                removed=float(info["removed"]),
                wear=wear,
                thrust_force=float(info["thrust_force"]),
                power=float(info["power"]),
                finished=bool(info["finished"]),
            )
        )
    return tuple(minutes)


def before(minute: int) -> tuple[float, float]:
    """Return wear [mm] and cutting time [min] of the edge at the start of a minute, 1 to 15."""
    wear = 0.0
    if minute > 1:
        wear = whole_life()[minute - 2].wear
    return wear, minute - 1.0


def sides(minute: int) -> int:
    """Return how many sides, and so corners, the feasible region of the plane has.

    It has 0 if nothing is feasible.
    """
    wear, start = before(minute)
    at_plane = plane(wear, start)
    within = at_plane.within
    columns = np.flatnonzero(within.any(axis=0))
    if not columns.size:
        return 0

    # The highest feasible feed at each cutting speed, and the responses one feed higher.
    last = within.shape[0] - 1
    below_last = np.argmax(within[::-1], axis=0)
    tops = (last - below_last)[columns]
    above_tops = np.minimum(tops + 1, last)
    force = at_plane.thrust_force[above_tops, columns]
    power = at_plane.power[above_tops, columns]

    # What ends the region upwards at each cutting speed: range of feeds, force, power or wear.
    conditions = [
        tops == last,
        force > LIMITS.force,
        power > LIMITS.power,
    ]
    ends = np.select(conditions, [0, 1, 2], default=3)

    # The upper side changes its direction where another limit ends the region.
    upper_sides = 1 + np.count_nonzero(np.diff(ends))
    # A region that is higher than one feed at its first or last speed ends there in a side.
    left_sides = tops[0] > 0
    right_sides = tops[-1] > 0
    lower_sides = 1
    return int(lower_sides + upper_sides + left_sides + right_sides)
