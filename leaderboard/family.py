"""Play controllers on unseen jobs of a family, and print their returns.

Every controller is built for each job from its nominal model, with the parameters tuned for ``--tuned-on``. "predictive, told
the truth" is built from the true scenario, whose predictions it also observes. "held optimum" is the lower anchor.

    python -m leaderboard.family --jobs 16 --episodes 4
    python -m leaderboard.family --split unseen_materials --policies rescaled_grid_search predictive
"""

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from baselines.catalogue import spec
from leaderboard.table import aligned
from turning_env.console import described, exits, print_json
from turning_env.scenario import Scenario, ScenarioError
from turning_env.scenario.family import Family, Job
from turning_env.scoring.family import HeldOptimum, play_jobs
from turning_env.scoring.play import Episodes
from turning_env.scoring.policy import PolicyFactory

TRUTH = ", told the truth"
ANCHOR = "held optimum"


def told_the_truth(job: Job) -> Job:
    """Return the job with a nominal model that is right."""
    return job._replace(scenario=job.scenario.model_copy(update={"nominal_model": ()}))


def played(family: Family, jobs: Sequence[Job], name: str, episodes: int, tuned_on: Scenario) -> Episodes:
    """Return the episodes of a policy of the catalogue or of the anchor, fields of shape (jobs, episodes)."""

    def make(job: Job) -> PolicyFactory:
        if name == ANCHOR:
            return lambda num_envs: HeldOptimum(job)
        return spec(name.removesuffix(TRUTH), job.scenario, tuned_on).make

    chosen = [told_the_truth(job) for job in jobs] if name.endswith(TRUTH) else jobs
    return play_jobs(
        family, chosen, make, episodes, lambda count: print(f"\r{name}: job {count} of {len(jobs)}", end="", file=sys.stderr)
    )


@exits(ScenarioError, ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Play and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m leaderboard.family", **described(__doc__))
    parser.add_argument("--family", default="shop", help="family, or its TOML file (default: %(default)s)")
    parser.add_argument("--split", nargs="+", default=["unseen_jobs"], help="splits (default: unseen_jobs)")
    parser.add_argument("--jobs", type=int, default=16, help="jobs of each split (default: %(default)s)")
    parser.add_argument("--episodes", type=int, default=4, help="episodes of each job (default: %(default)s)")
    parser.add_argument("--policies", nargs="+", default=["rescaled_grid_search", "predictive", f"predictive{TRUTH}"],
                        help="controllers (default: rescaled_grid_search; predictive, also told the truth)")  # fmt: skip
    parser.add_argument("--tuned-on", default="shift", help="scenario of their tuned parameters (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print every episode's return as JSON")
    options = parser.parse_args(arguments)
    family, tuned_on = Family.load(options.family), Scenario.load(options.tuned_on)
    results: dict[str, dict[str, Episodes]] = {}
    for split in options.split:
        jobs = [family.job(number, split) for number in range(options.jobs)]
        results[split] = {name: played(family, jobs, name, options.episodes, tuned_on) for name in (ANCHOR, *options.policies)}
    print(file=sys.stderr)
    if options.json:
        print_json({split: {name: each["return"].tolist() for name, each in rows.items()} for split, rows in results.items()})
        return 0
    for split, rows in results.items():
        table = [["policy", "return [s]", "95 %", "worst job", "over a limit by more than 5 % [% of cutting time]", "most"]]
        for name, each in rows.items():
            by_job = each["return"].mean(axis=1)
            error = 1.96 * by_job.std(ddof=1) / np.sqrt(len(by_job)) if len(by_job) > 1 else np.nan
            shares = 100.0 * each["severe_overload_time"].sum(axis=1) / each["engaged_time"].sum(axis=1)
            table.append(
                [
                    name,
                    f"{by_job.mean():.0f}",
                    f"+-{error:.0f}",
                    f"{by_job.min():.0f}",
                    f"{shares.mean():.1f}",
                    f"{shares.max():.1f}",
                ]
            )
        print(f"{family.name}, {split}, {options.jobs} jobs of {options.episodes} episodes", aligned(table), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
