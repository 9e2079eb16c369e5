"""Measure the gap from the best agent on RoughTurning-v0 to a bound on all policies that see observations only.

    python -m research.studies.headroom
    python -m research.studies.headroom --seeds 8

It compares two bounds, the best agent that ships and the best rule on the same held-out seeds. The belief-state bound
(``belief_bound.py``) holds for policies that know a bar only by its readings; the clairvoyant bound knows all bars.
"""

import argparse
import sys

import numpy as np

from leaderboard.ranking import read_leaderboard
from leaderboard.result import RESULTS, result_folder
from research.studies import belief_bound
from turning_env import IDS, Scenario
from turning_env.console import described, exits
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.statistics import Bootstrap, Estimate

ENV_ID = "RoughTurning-v0"
MAX_SEEDS = 256  # seeds that shipped results have played


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.headroom", **described(__doc__)
    )
    parser.add_argument(
        "--seeds",
        type=int,
        default=64,
        help="number of held-out seeds, at most 256 (default: %(default)s)",
    )
    parsed = parser.parse_args(arguments)
    if not 1 <= parsed.seeds <= MAX_SEEDS:
        parser.error(f"--seeds is {parsed.seeds}, but must be 1 to {MAX_SEEDS}")
    scenario, seeds = Scenario.load(IDS[ENV_ID]), held_out_seeds(parsed.seeds)
    leaderboard = read_leaderboard(result_folder(RESULTS, ENV_ID, scenario.name))
    best = {
        kind: next(each.name for each in leaderboard.standings if each.kind == kind)
        for kind in ("agent", "rule")
    }
    rows = {"belief-state bound": np.array([belief_bound.bound(scenario, seed) for seed in seeds])}
    for title, name in (
        ("clairvoyant bound", "clairvoyant"),
        *((f"best {kind}, {name}", name) for kind, name in best.items()),
    ):
        results = [
            each for each in leaderboard.results if leaderboard.names[each.policy.label] == name
        ]
        places = [results[0].task.seeds.index(seed) for seed in seeds]
        rows[title] = np.mean(
            [np.array(each.episodes["return"])[places] for each in results], axis=0
        )
    agent, bootstrap = rows[f"best agent, {best['agent']}"], Bootstrap(len(seeds))
    print(f"{'':32}  {'return [s]':>10}  over the best agent [s]")
    for title, returns in sorted(rows.items(), key=lambda row: -row[1].mean()):
        over = returns - agent
        gap = Estimate.of(over.mean(), bootstrap.means(over[np.newaxis], title))
        print(
            f"{title:32}  {returns.mean():10.1f}  {gap.value:.1f} ({gap.low:.1f} to {gap.high:.1f})"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
