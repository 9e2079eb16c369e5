"""Measure what each search of speed and feed gains over a plain grid with the same objective.

    python -m research.studies.searches

Rule 1 of the design allows a second implementation for a measured benefit. This study measures it
for three searches; each file states its result:

* ``scenario/plan.py`` factors the laws over its grid; against evaluating them at every point.
* ``baselines/two_limits.py`` finds the economic optimum in closed form; against a grid as fine as
  that of ``plan.py``.
* ``baselines/models/feed_search.py`` is Newton's method; against a grid of set points within reach.
"""

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from baselines.models.feed_search import SET_POINT, try_set_point
from baselines.models.process import Process
from baselines.optimiser import Optimiser
from baselines.rule import Array
from baselines.two_limits import ECONOMIC_OPTIMUM, set_point
from leaderboard.play import play
from leaderboard.seeds import tuning_seeds
from turning_env import Family, Reading, Scenario
from turning_env.console import Parser, described
from turning_env.numerics.compilation import compiled_entry
from turning_env.numerics.functions import exp, log
from turning_env.scenario.laws import capacity_at, load_shares, loads_at
from turning_env.scenario.plan import USED_LIVES, SetPointGrid, log_response_at
from turning_env.scenario.scenario_batch import ScenarioBatch

SIDE = 20  # speeds, and feeds, of a plain grid
REPEATS = 5
SEEDS = 64


class Timed(NamedTuple):
    """A result and the least time of several calls [s]."""

    value: Any
    seconds: float


def timed(function: Callable[[], Any]) -> Timed:
    """Return a function's result and its least time."""
    least = np.inf
    for _ in range(REPEATS):
        start = time.perf_counter()
        value = function()
        least = min(least, time.perf_counter() - start)
    return Timed(value, seconds=least)


def factored_grid() -> str:
    """Compare ``SetPointGrid`` with the laws at every point, on the first jobs of a family."""
    jobs = Family.load("shop").draw("train", 0).true
    grid = SetPointGrid(jobs)

    def by_factors() -> list[Any]:
        fresh_grid = SetPointGrid(jobs)
        return [fresh_grid.excess(used_life) for used_life in USED_LIVES]

    def by_points() -> list[Any]:
        return [excess_at_every_point(jobs, grid, used_life) for used_life in USED_LIVES]

    factored = timed(by_factors)
    direct = timed(by_points)
    difference = np.abs(np.array(direct.value) - np.array(factored.value)).max()
    return (
        f"plan: {1000 * factored.seconds:.1f} ms for {jobs.num_scenarios} jobs, laws at every "
        f"point {1000 * direct.seconds:.1f} ms; loads differ by {difference:.0e} at most"
    )


def excess_at_every_point(jobs: ScenarioBatch, grid: SetPointGrid, used_life: float) -> Any:
    """Return ``SetPointGrid.excess`` without products of factors."""
    log_speed = np.broadcast_to(log(grid.speed), grid.removal_rate.shape)
    log_feed = np.broadcast_to(log(grid.feed), grid.removal_rate.shape)

    def response(name: str) -> Any:
        law = getattr(jobs.material, name)
        at_one = log_response_at(jobs, name, used_life)
        log_load = column(at_one) + column(law.cutting_speed) * log_speed
        return log_load + column(law.feed) * log_feed

    force = exp(response("thrust_force")) / column(jobs.limits.thrust_force)
    cutting_power = exp(response("power")) / column(jobs.limits.power)
    idle_torque = column(jobs.spindle.idle_torque / (30.0 * jobs.workpiece.diameter))
    power = cutting_power + idle_torque * grid.speed / column(jobs.limits.power)
    base = np.maximum(column(jobs.base_cutting_speed), 1e-9)
    return np.maximum(force, power / np.minimum(grid.speed / base, 1.0)) - 1.0


def column(value: Any) -> Any:
    """Return numbers of scenarios in a shape that broadcasts to the grid."""
    return np.reshape(value, (-1, 1, 1))


def closed_form() -> str:
    """Compare the economic optimum with the cheapest point of a grid."""
    scenario = Scenario.load("rough_turning")
    process = Process.of(scenario)
    depth = scenario.workpiece.depth_of_cut
    exact = timed(lambda: set_point(ECONOMIC_OPTIMUM, process, depth))
    plain = timed(lambda: cheapest_of_grid(scenario, process))
    costs = []
    for speed, feed in (exact.value, plain.value):
        costs.append(float(cost_at(process, speed, feed, depth=depth)))
    exact_cost, plain_cost = costs
    return (
        f"two_limits: {1000 * exact.seconds:.2f} ms, a grid of {SIDE} x {SIDE} "
        f"{1000 * plain.seconds:.2f} ms and {100 * (plain_cost / exact_cost - 1):.1f} % more cost"
    )


def cost_at(process: Process, speed: Array, feed: Array, depth: float) -> Array:
    """Return the cost of metal [min/cm3]."""
    log_cost = process.log_cost(log(speed), log(feed), depth_of_cut=depth, hardness=1.0)
    return np.asarray(exp(log_cost))


def cheapest_of_grid(scenario: Scenario, process: Process) -> tuple[Array, Array]:
    """Return the cheapest speed and feed of a grid that keep force and power at mean wear."""
    speeds = np.geomspace(*process.cutting_speed_range, SIDE)[:, np.newaxis]
    feeds = np.geomspace(*process.feed_range, SIDE)
    depth = scenario.workpiece.depth_of_cut
    loads = loads_at(scenario, speeds, feeds, depth, wear=process.mean_wear)
    shares = load_shares(loads, scenario.limits, capacity=capacity_at(scenario, speeds))
    costs = np.where(shares.highest <= 1.0, cost_at(process, speeds, feeds, depth), np.inf)
    i, k = np.divmod(int(costs.argmin()), SIDE)
    return speeds[i, 0], feeds[k]


class GridOptimiser(Optimiser):
    """``Optimiser`` that tries a grid of set points within reach."""

    def _best_set_point(
        self, reading: Reading, used_life: Array, price: Array
    ) -> tuple[Array, Array]:
        points = self._points(self._ahead(reading), price)
        environments = self._environments(reading, used_life)
        best = np.empty(len(price), SET_POINT)
        try_grid(self._parameters, self._moments, environments, points, best)
        return exp(best["log_speed"]), exp(best["log_feed"])


@compiled_entry
def try_grid(parameters, moments, environments, points, best):  # type: ignore[no-untyped-def]
    """Fill in the best set points of a grid; arguments are those of ``feed_search.search``."""
    for i in range(len(best)):
        p = parameters[i % len(parameters)]
        times = moments[i % len(moments)]
        env = environments[i]
        most = -np.inf
        for j in range(SIDE):
            log_speed = env.min_log_speed + (env.max_log_speed - env.min_log_speed) * j / (SIDE - 1)
            for k in range(SIDE):
                log_feed = env.min_log_feed + (env.max_log_feed - env.min_log_feed) * k / (SIDE - 1)
                trial = try_set_point(p, times, env, points[i], log_speed, log_feed)
                if trial.gain > most:
                    most = trial.gain
                    best[i].log_speed = log_speed
                    best[i].log_feed = log_feed


def newton() -> str:
    """Compare Newton's method with a grid within reach, in return and time of whole episodes."""
    scenario = Scenario.load("rough_turning")
    seeds = tuning_seeds(SEEDS)
    results = []
    for optimiser in (Optimiser, GridOptimiser):
        make = partial(optimiser, scenario, severity=1.5, caution=1.0)
        play(make, scenario, seeds)  # compiles
        start = time.perf_counter()
        episodes = play(make, scenario, seeds)
        results.append((episodes["return"], time.perf_counter() - start))
    (returns, seconds), (grid_returns, grid_seconds) = results
    gain = returns - grid_returns
    error = gain.std(ddof=1) / np.sqrt(len(gain))
    return (
        f"feed_search: {seconds:.1f} s for {SEEDS} episodes, a grid of {SIDE} x {SIDE} within "
        f"reach {grid_seconds:.1f} s; Newton returns {gain.mean():.2f} s more (+- {error:.2f})"
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    Parser(prog="python -m research.studies.searches", **described(__doc__)).parse_args(arguments)
    print(factored_grid())
    print(closed_form())
    print(newton())
    return 0


if __name__ == "__main__":
    sys.exit(main())
