"""Measure how much the clairvoyant bound moves when its grids are refined.

    python -m studies.bound
    python -m studies.bound --scenario forging --seeds 4

On tuning seeds, it halves each grid step in turn, then all of them together.
"""

import argparse
import sys
import time

import numpy as np

from baselines.oracles.clairvoyant import GRID, TOLERANCE, bounds, covers
from turning_env import Scenario
from turning_env.console import described, exits
from turning_env.scoring.seeds import tuning_seeds


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.bound", **described(__doc__))
    parser.add_argument("--scenario", default="rough_turning", help="preset or TOML file (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=8, help="number of tuning seeds (default: %(default)s)")
    parsed = parser.parse_args(arguments)
    scenario, seeds = Scenario.load(parsed.scenario), tuning_seeds(parsed.seeds)
    if not covers(scenario):
        raise ValueError(f"the bound does not cover scenario {scenario.name!r}")
    finer = GRID.halved()
    grids = {"as used": GRID} | {f"{name} halved": GRID._replace(**{name: getattr(finer, name)}) for name in GRID._fields}
    used = bounds(scenario, seeds, GRID)
    print(f"{'steps':>14}  {'bound [s]':>9}  {'mean move [s]':>13}  {'largest [s]':>11}  {'per seed [s]':>12}")
    for name, grid in (grids | {"all halved": finer}).items():
        start = time.process_time()
        found = bounds(scenario, seeds, grid)
        seconds, moves = (time.process_time() - start) / len(seeds), found - used
        print(f"{name:>14}  {found.mean():9.2f}  {moves.mean():13.2f}  {np.abs(moves).max():11.2f}  {seconds:12.2f}", flush=True)
    print(f"Tolerance: {TOLERANCE:.1%} of an episode's machine time.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
