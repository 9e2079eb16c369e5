"""The clairvoyant bound: the greatest return of one edge or job if all bars are known in advance and nothing lags.

It is computed by dynamic programming over cells of the bars and used shares D of the edge's life (docs/bounds.md). V is 0 when
the edge is worn out or the job is done. The transition's own functions give the seed's fields in the middle of each cell. Wear
and loads are those at the cell's start, where the edge is sharpest. All relaxations raise the bound, so no policy earns more,
except for the error of the grids (``TOLERANCE``) and a lag of the chip, which delays overload. A time limit is ignored.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from baselines.oracles.cells import best_return, start_episode_of, survey
from baselines.rule import Array
from turning_env import Scenario
from turning_env.numerics.functions import log
from turning_env.physics.records import block_records

TOLERANCE = (
    0.005  # error of the grids over the machine time [-]; the bound may be too low by that much
)
MIN_TIME_LIMIT = 30.0  # least ignored time limit of an endless row of bars [min] (assumption: an edge lasts half of it)
_BARS = 8  # of an endless row at first
_FEEDS = np.array([-0.3, -0.1, 0.0, 0.03, 0.08, 0.16, 0.3])  # log steps from the feed at the limit


class Grid(NamedTuple):
    """Grid of the dynamic programming."""

    cell: float = 5.0  # greatest length of a cell [mm]
    lives: int = 240  # steps of the used share of the edge's life
    speeds: int = 16  # cutting speeds of the ladder


GRID = Grid()


def covers(scenario: Scenario) -> bool:
    """Return whether the bound holds: one edge, removal, actions per step, wear by equivalent time, a constant power limit."""
    control = scenario.control
    one_edge = (
        control.action != "part" and control.aim == "removal" and control.edge_changes == "end"
    )
    constant = (
        scenario.tool.wear_rule == "equivalent_time" and scenario.spindle.short_time_load == 1.0
    )
    return (
        one_edge
        and constant
        and (scenario.workpiece.bars > 0 or control.time_limit >= MIN_TIME_LIMIT)
    )


def bounds(
    scenario: Scenario,
    seeds: Sequence[int],
    grid: Grid = GRID,
    on_seed: Callable[[], None] = lambda: None,
    threads: int = 2,
) -> Array:
    """Return the bound [s] of each seed's first episode; call ``on_seed`` after each. ValueError if a scenario is not covered."""
    if not covers(scenario):
        raise ValueError(
            f"the clairvoyant bound does not cover scenario {scenario.name!r}: see {__name__}.covers"
        )
    values = np.empty(len(seeds))
    with ThreadPoolExecutor(threads) as pool:
        for place, value in enumerate(pool.map(lambda seed: _bound(scenario, seed, grid), seeds)):
            values[place] = value
            on_seed()
    return values


def _bound(scenario: Scenario, seed: int, grid: Grid) -> float:
    """Return the bound of one seed."""
    work, control, machine = scenario.workpiece, scenario.control, scenario.machine
    states, parameters, _ = records = block_records(scenario)
    parameters["depth_ripple"] = 0.0
    states["seed"][0, 0] = seed
    start_episode_of(*records)
    cells = int(np.ceil(work.bar_length / grid.cell))
    if control.action == "override":
        log_speeds = log([control.initial_cutting_speed])
        feeds = machine.feed_min, min(machine.feed_max, control.override_max * control.initial_feed)
    else:
        log_speeds = np.linspace(
            log(machine.cutting_speed_min), log(machine.cutting_speed_max), grid.speeds
        )
        feeds = machine.feed_min, machine.feed_max
    bars = work.bars or _BARS
    while True:
        fields = np.empty((3, bars * cells))
        survey(*records, fields, cells)
        # Run-out depends on the spindle's turns. The bound takes the lowest load and the most metal.
        value, end = best_return(
            *records, fields, cells, log_speeds, log(feeds), _FEEDS, work.depth_ripple, grid.lives
        )
        # Twice the length that is cut at best, so the value at the end of the row hardly matters.
        if work.bars or end <= 0.5 * fields.shape[1]:
            return float(value)
        bars *= 2
