"""The clairvoyant bound: the most that one edge, or one job, can earn if every bar is known beforehand and nothing lags.

Dynamic programming over cells of the bars (Bellman 1957). The fields are the true ones of the draw, looked up in the middle of
each cell by the transition's own functions; commands take effect at once; no force breaks the edge. The volume of a cell is
fixed, so what is left of the state is the used share of the edge's life, D:

    V(i, D) = max over cutting speed and feed of  gain of cell i at D + V(i + 1, D + life used in the cell)

with V = 0 where the edge is worn out or the job is done. Per cell and D a ladder of cutting speeds is tried, each with feeds
around the one at which force or power reaches its limit: below it time is wasted, beyond it overload is paid. Wear, and hence the
loads, are those at the cell's start, when the edge is sharper than in the rest of it, which errs to the safe side. Air is crossed
at the highest speed and feed.

What is relaxed can only help, so no policy earns more, but for the steps of the grids: see ``TOLERANCE``. A time limit is not
looked at: it must be one that only policies reach which earn little.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.oracles.cells import best_return, start_episode_of, survey
from turning_env import Scenario
from turning_env.physics.records import STATE, new_records, scratch_records

Array = NDArray[np.float64]

TOLERANCE = 0.005
"""By which the grids may leave the bound too low, as a share of the machine time [-]."""
MIN_TIME_LIMIT = 30.0
"""Machine time [min] that an endless row of bars must be given for the limit to be ignored (assumption: where it earns most, an
edge is worn out in about a quarter of an hour)."""
_BARS = 8  # of an endless row that are looked at first
_FEEDS = np.array([-0.3, -0.1, 0.0, 0.03, 0.08, 0.16, 0.3])  # log steps from the feed at the limit


class Grid(NamedTuple):
    """How fine the bound is computed."""

    cell: float = 5.0
    """Length of a cell [mm], at most."""
    lives: int = 240
    """Steps of the used share of the edge's life."""
    speeds: int = 16
    """Cutting speeds of the ladder."""

    def halved(self) -> "Grid":
        """Every step half as long."""
        return Grid(0.5 * self.cell, 2 * self.lives, 2 * self.speeds)


GRID = Grid()


def covers(scenario: Scenario) -> bool:
    """Whether the bound is one for a scenario: one edge, removal as the aim, set by the interval, wear by equivalent time."""
    control = scenario.control
    enough_time = scenario.workpiece.bars > 0 or control.time_limit >= MIN_TIME_LIMIT
    return (
        control.action != "part"
        and control.aim == "removal"
        and control.edge_changes == "end"
        and scenario.tool.wear_rule == "equivalent_time"
        and enough_time
    )


def bounds(
    scenario: Scenario, seeds: Sequence[int], grid: Grid = GRID, on_draw: Callable[[], None] = lambda: None, threads: int = 2
) -> Array:
    """The bound on the return [s] of each draw's first episode, shape (len(seeds),).

    Args:
        scenario: what is played.
        seeds: the draws.
        grid: how fine.
        on_draw: called after each draw.
        threads: draws that are computed at a time; the values do not depend on it.

    Raises:
        ValueError: the scenario is not covered.
    """
    if not covers(scenario):
        raise ValueError(
            f"the clairvoyant bound does not cover scenario {scenario.name!r}: see baselines.oracles.clairvoyant.covers"
        )

    def bound(seed: int) -> float:
        value = _bound(scenario, seed, grid)
        on_draw()
        return value

    with ThreadPoolExecutor(threads) as pool:
        return np.array(list(pool.map(bound, seeds)))


def _bound(scenario: Scenario, seed: int, grid: Grid) -> float:
    """The bound of one draw."""
    work, control, machine = scenario.workpiece, scenario.control, scenario.machine
    scratch = scratch_records(scenario)
    # Run-out depends on how often the spindle has turned: no load is lower, and no metal more, than at its best.
    ripple = work.depth_ripple
    scratch["parameters"]["depth_ripple"] = 0.0
    states = new_records(STATE, 1)
    states["seed"][0, 0] = seed
    start_episode_of(states, scratch)
    cells = int(np.ceil(work.bar_length / grid.cell))
    if control.action == "override":
        log_speeds = np.log([control.initial_cutting_speed])
        feeds = machine.feed_min, min(machine.feed_max, control.override_max * control.initial_feed)
    else:
        log_speeds = np.linspace(np.log(machine.cutting_speed_min), np.log(machine.cutting_speed_max), grid.speeds)
        feeds = machine.feed_min, machine.feed_max
    bars = work.bars or _BARS
    while True:
        fields = np.empty((3, bars * cells))
        survey(states, scratch, fields, cells)
        value, end = best_return(states, scratch, fields, cells, log_speeds, np.log(feeds), _FEEDS, ripple, grid.lives)
        # Twice as far as is cut at best: what the end of the row is worth then hardly matters.
        if work.bars or end <= 0.5 * fields.shape[1]:
            return float(value)
        bars *= 2
