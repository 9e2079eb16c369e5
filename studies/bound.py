"""Measure how much the clairvoyant bound moves when its grids are refined.

    python -m studies.bound
    python -m studies.bound --scenario forging --seeds 4 --json

On tuning seeds, it halves each grid step in turn, then all of them together.
"""

import argparse
import sys
import time

import numpy as np

from baselines.oracles.clairvoyant import GRID, TOLERANCE, Grid, bounds, covers
from turning_env import Scenario
from turning_env.console import described, exits, print_json
from turning_env.scoring.seeds import tuning_seeds

Row = tuple[str, float, float, float, float]


def measure(scenario: Scenario, num_seeds: int) -> list[Row]:
    """Return per grid: name, mean bound [s], mean and largest move from the bound as used [s], time per seed [s]."""
    finer = GRID.halved()
    grids: dict[str, Grid] = {"as used": GRID}
    grids |= {f"{name} halved": GRID._replace(**{name: getattr(finer, name)}) for name in GRID._fields}
    grids |= {"all halved": finer}
    rows, used = [], np.zeros(num_seeds)
    for name, grid in grids.items():
        start = time.process_time()
        bound = bounds(scenario, tuning_seeds(num_seeds), grid)
        used = bound if name == "as used" else used
        moves = bound - used
        seconds = (time.process_time() - start) / num_seeds
        rows.append((name, float(bound.mean()), float(moves.mean()), float(np.abs(moves).max()), seconds))
    return rows


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.bound", **described(__doc__))
    parser.add_argument("--scenario", default="rough_turning", help="preset or TOML file (default: rough_turning)")
    parser.add_argument("--seeds", type=int, default=8, help="number of tuning seeds (default: 8)")
    parser.add_argument("--json", action="store_true", help="print the table as JSON")
    parsed = parser.parse_args(arguments)
    scenario = Scenario.load(parsed.scenario)
    num_seeds = len(tuning_seeds(parsed.seeds))
    if not covers(scenario):
        raise ValueError(f"the bound does not cover scenario {scenario.name!r}")
    bounds(scenario, tuning_seeds(1), Grid(50.0, 10, 4))  # compiles
    rows = measure(scenario, num_seeds)
    if parsed.json:
        print_json(
            [dict(zip(("steps", "bound", "mean_move", "largest_move", "seconds_per_seed"), row, strict=True)) for row in rows]
        )
        return 0
    print(f"{'steps':>14}  {'bound [s]':>9}  {'mean move [s]':>13}  {'largest [s]':>11}  {'per seed [s]':>12}")
    for name, bound, mean, largest, seconds in rows:
        print(f"{name:>14}  {bound:9.2f}  {mean:13.2f}  {largest:11.2f}  {seconds:12.2f}")
    print(f"Tolerance: {TOLERANCE:.1%} of an episode's machine time.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
