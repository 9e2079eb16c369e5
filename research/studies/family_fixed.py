"""Compare shares of the nominal optimum's speed and feed on training jobs of a family.

    python -m research.studies.family_fixed shop
    python -m research.studies.family_fixed unmodelled --jobs 64 --speeds 0.7 0.8 --feeds 0.6

The best feasible one has the score 0 on the family's leaderboards
(``baselines.nominal_optimum.FEASIBLE_SHARES``).
"""

import argparse
import sys
from collections.abc import Sequence

from baselines.nominal_optimum import FixedNominalOptimum, SetPointShares
from leaderboard.play import play_family
from leaderboard.statistics import Bootstrap, feasibility, severe_share
from leaderboard.table import markdown
from turning_env import Family
from turning_env.console import described, exits, positive


def row(family: Family, num_jobs: int, shares: SetPointShares) -> dict[str, str]:
    """Play shares on the first training jobs, and return the row of the table, by heading."""
    jobs = [family.job(number) for number in range(num_jobs)]
    episodes = play_family(
        family,
        "train",
        seeds=range(num_jobs),
        make_policy=lambda num_envs: FixedNominalOptimum(jobs, shares),
        context="hidden",
    )
    severe = episodes["severe_overload_time"]
    engaged = episodes["engaged_time"]
    limits = Bootstrap(num_jobs).severe_limits(severe[None], engaged[None], "fixed")
    allowance = jobs[0].scenario.limits.overload_allowance
    return {
        "Speed": f"{shares.cutting_speed:.2f}",
        "Feed": f"{shares.feed:.2f}",
        "Return [s]": f"{episodes['return'].mean():.0f}",
        "Severe overload [%]": f"{100.0 * severe_share(severe, engaged):.1f}",
        "Feasible": feasibility(limits, allowance),
    }


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.family_fixed", **described(__doc__)
    )
    add = parser.add_argument
    add("family", help="the family's preset or TOML file")
    add("--jobs", type=positive, default=128, help="training jobs (default: %(default)s)")
    add("--speeds", type=float, nargs="+", default=[0.75, 0.85, 0.92, 1.0], metavar="SHARE")
    add("--feeds", type=float, nargs="+", default=[0.6, 0.65, 0.7], metavar="SHARE")
    options = parser.parse_args(arguments)
    family = Family.load(options.family)
    rows = []
    for cutting_speed in options.speeds:
        for feed in options.feeds:
            shares = SetPointShares(cutting_speed=cutting_speed, feed=feed)
            rows.append(row(family, options.jobs, shares))
    print(markdown(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
