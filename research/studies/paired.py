"""Compare two policies job by job on results that exist.

    python -m research.studies.paired ppo_load_target reactive --scenarios unmodelled-unseen_jobs
    python -m research.studies.paired ppo predictive --env RoughTurning-v0 --scenarios rough_turning

The table has the mean difference of the returns with its 95 % interval over jobs and training
seeds, the median, the mean without the jobs on which the two differ most, and the share of jobs on
which the first returns more.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from leaderboard.result import RESULTS, read_results, result_folder
from leaderboard.standings import LARGEST
from leaderboard.statistics import Bootstrap, Estimate, Floats
from leaderboard.table import markdown
from turning_env import FAMILY_ID
from turning_env.console import UserError, described, exits


def returns_of(policy: str, folder: Path) -> Floats:
    """Return a policy's returns, shape (training seeds, jobs).

    Raises:
        UserError: the folder has none; the message lists its policies.
    """
    titles = set()
    returns = []
    for result in read_results(folder).values():
        titles.add(result.policy.title)
        if result.policy.title == policy:
            returns.append(result.episodes["return"])
    if not returns:
        known = ", ".join(sorted(titles)) or "none"
        raise UserError(f"{folder} has no policy {policy!r}; it has {known}")
    return np.array(returns)


def differences(first: str, second: str, folder: Path) -> dict[str, str]:
    """Return the cells of the differences of two policies in a folder of results, by heading."""
    returns = returns_of(first, folder)
    others = returns_of(second, folder)
    bootstrap = Bootstrap(returns.shape[1])
    replicates = bootstrap.means(returns, first) - bootstrap.means(others, second)
    leads = returns.mean(axis=0) - others.mean(axis=0)
    mean = Estimate.of(leads.mean(), replicates)

    by_size = np.argsort(-np.abs(leads), kind="stable")
    without_largest = leads[by_size[LARGEST:]]
    better = 100.0 * (leads > 0.0).mean()
    return {
        "Scenario": folder.name,
        "Difference [s]": f"{mean.value:.0f} ({mean.low:.0f} to {mean.high:.0f})",
        "Median [s]": f"{np.median(leads):.0f}",
        f"Without {LARGEST} largest [s]": f"{without_largest.mean():.0f}",
        "Better [% of jobs]": f"{better:.0f}",
    }


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m research.studies.paired", **described(__doc__))
    parser.add_argument("first", help="policy, as it is named on the leaderboard")
    parser.add_argument("second", help="policy whose returns are subtracted")
    parser.add_argument(
        "--results", type=Path, default=RESULTS, help="folder of results (default: those that ship)"
    )
    parser.add_argument("--env", default=FAMILY_ID, help="environment id (default: %(default)s)")
    parser.add_argument(
        "--scenarios",
        nargs="+",
        required=True,
        metavar="NAME",
        help="scenarios, or families with a split",
    )
    parsed = parser.parse_args(arguments)
    folders = [result_folder(parsed.results, parsed.env, name) for name in parsed.scenarios]
    print(markdown([differences(parsed.first, parsed.second, folder) for folder in folders]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
