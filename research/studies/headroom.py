"""Measure the gap from the best agent on RoughTurning-v0 to a bound on all fair policies.

    python -m research.studies.headroom
    python -m research.studies.headroom --seeds 8

It compares two bounds, the best agent that ships and the best rule on the same held-out seeds. The
belief-state bound (``belief_bound.py``) holds for policies that know a bar only by its readings;
the clairvoyant bound knows all bars.
"""

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from leaderboard.ranking import Leaderboard, read_leaderboard
from leaderboard.result import RESULTS, result_folder
from leaderboard.seeds import held_out_seeds
from leaderboard.statistics import Bootstrap, Estimate, Floats
from research.studies import belief_bound
from turning_env import IDS, Scenario
from turning_env.console import described, exits

ENV_ID = "RoughTurning-v0"
MAX_SEEDS = 256  # seeds that shipped results have played


def returns_of(name: str, leaderboard: Leaderboard, seeds: Sequence[int]) -> Floats:
    """Return a policy's returns [s] on seeds that it has played, means over its training seeds."""
    by_training = []
    for result in leaderboard.results:
        if leaderboard.names[result.policy.label] == name:
            returns = np.array(result.episodes["return"])
            places = [result.task.seeds.index(seed) for seed in seeds]
            by_training.append(returns[places])
    mean: Floats = np.mean(by_training, axis=0)
    return mean


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
    scenario = Scenario.load(IDS[ENV_ID])
    seeds = held_out_seeds(parsed.seeds)
    leaderboard = read_leaderboard(result_folder(RESULTS, ENV_ID, scenario.name))
    # Standings are in the order of their ranks.
    best_agent = next(row.name for row in leaderboard.standings if row.kind == "agent")
    best_rule = next(row.name for row in leaderboard.standings if row.kind == "rule")
    bounds = [belief_bound.bound(scenario, seed) for seed in seeds]
    agent_returns = returns_of(best_agent, leaderboard, seeds)
    rows = {
        "belief-state bound": np.array(bounds),
        "clairvoyant bound": returns_of("clairvoyant", leaderboard, seeds),
        f"best agent, {best_agent}": agent_returns,
        f"best rule, {best_rule}": returns_of(best_rule, leaderboard, seeds),
    }
    bootstrap = Bootstrap(len(seeds))
    print(f"{'':32}  {'return [s]':>10}  over the best agent [s]")
    for title, returns in sorted(rows.items(), key=lambda row: -row[1].mean()):
        over = returns - agent_returns
        replicates = bootstrap.means(over[np.newaxis], title)
        gap = Estimate.of(over.mean(), replicates)
        gap_text = f"{gap.value:.1f} ({gap.low:.1f} to {gap.high:.1f})"
        print(f"{title:32}  {returns.mean():10.1f}  {gap_text}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
