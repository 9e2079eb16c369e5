"""The clairvoyant bound: the greatest return if all bars are known in advance and nothing lags.

It is the return of one edge or job, computed by dynamic programming over cells of the bars and used
shares D of the edge's life (docs/results.md). V is 0 when the edge is worn out or the job is done.
The transition's own functions give the seed's fields in the middle of each cell. Wear and loads are
those at the cell's start, where the edge is sharpest. All relaxations raise the bound, so no policy
earns more, except for the error of the grids (``TOLERANCE``) and a lag of the chip, which delays
overload. A time limit is ignored.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from baselines.oracles.cells import Options, best_return, start_episode_of, survey
from baselines.rule import Array
from turning_env import Scenario
from turning_env.numerics.functions import log
from turning_env.physics.records import block_records

TOLERANCE = 0.005
"""Error of the grids over the machine time [-]; the bound may be too low by that much."""
MIN_TIME_LIMIT = 30.0
"""Lowest time limit of an endless row of bars that is ignored [min].

An edge is assumed to last half of it.
"""
_BARS = 8  # of an endless row at first
_FEED_STEPS = np.array([-0.3, -0.1, 0.0, 0.03, 0.08, 0.16, 0.3])
"""Log steps from the feed at the limit."""


class StateGrid(NamedTuple):
    """Grid of the dynamic programming."""

    cell: float = 5.0  # greatest length of a cell [mm]
    lives: int = 240  # steps of the used share of the edge's life
    speeds: int = 16  # cutting speeds of the ladder


GRID = StateGrid()


def covers(scenario: Scenario) -> bool:
    """Return whether the clairvoyant bound holds for a scenario.

    It needs one edge, a reward for removal, actions that do not plan a whole part, wear by
    equivalent time, a constant power limit, and either a row of bars or a time limit of at least
    ``MIN_TIME_LIMIT``, which the bound ignores.
    """
    control = scenario.control
    conditions = (
        control.action != "part",
        control.edge_changes == "end",
        control.aim == "removal",
        scenario.tool.wear_rule == "equivalent_time",
        scenario.spindle.short_time_load == 1.0,
        scenario.workpiece.bars > 0 or control.time_limit >= MIN_TIME_LIMIT,
    )
    return all(conditions)


def bounds(
    scenario: Scenario,
    seeds: Sequence[int],
    grid: StateGrid = GRID,
    on_seed: Callable[[], None] = lambda: None,
    threads: int = 2,
) -> Array:
    """Return the bound [s] of each seed's first episode.

    Args:
        scenario: task.
        seeds: seeds of the episodes.
        grid: grid of the dynamic programming.
        on_seed: is called after each seed.
        threads: number of threads.

    Raises:
        ValueError: the scenario is not covered.
    """
    if not covers(scenario):
        raise ValueError(
            f"the clairvoyant bound does not cover scenario {scenario.name!r}: "
            f"see {__name__}.covers"
        )
    values = np.empty(len(seeds))
    with ThreadPoolExecutor(threads) as pool:
        results = pool.map(lambda seed: _bound(scenario, seed, grid), seeds)
        for place, value in enumerate(results):
            values[place] = value
            on_seed()
    return values


def _bound(scenario: Scenario, seed: int, grid: StateGrid) -> float:
    """Return the bound of one seed."""
    work = scenario.workpiece
    states, parameters, scratches = block_records(scenario)
    parameters["depth_ripple"] = 0.0
    states["seed"][0, 0] = seed
    start_episode_of(states, parameters, scratches)
    cells = int(np.ceil(work.bar_length / grid.cell))
    options = _options(scenario, grid)
    bars = work.bars or _BARS
    while True:
        fields = np.empty((3, bars * cells))
        survey(states, parameters, scratches, fields, cells)
        # Run-out depends on the spindle's turns. The bound takes the lowest load and most metal.
        value, end = best_return(
            states, parameters, fields, cells, options, work.depth_ripple, grid.lives
        )
        # The row is twice the length that is cut at best, so the value at its end hardly matters.
        if work.bars or end <= 0.5 * fields.shape[1]:
            return float(value)
        bars *= 2


def _options(scenario: Scenario, grid: StateGrid) -> Options:
    """Return the set points that are compared."""
    control = scenario.control
    machine = scenario.machine
    if control.action == "override":
        log_speeds = log([control.initial_cutting_speed])
        max_feed = min(machine.feed_max, control.override_max * control.initial_feed)
    else:
        log_speeds = np.linspace(
            log(machine.cutting_speed_min), log(machine.cutting_speed_max), grid.speeds
        )
        max_feed = machine.feed_max
    return Options(
        log_speeds=log_speeds,
        min_log_feed=float(log(machine.feed_min)),
        max_log_feed=float(log(max_feed)),
        feed_steps=_FEED_STEPS,
    )
