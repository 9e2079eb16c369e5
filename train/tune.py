"""Tune an algorithm's hyperparameters on tuning seeds, and print the best as a table for its hyperparameter file.

    python -m train.tune --algorithm sac --trials 20 --total-timesteps 500000
    python -m train.tune --algorithm ppo --env RoughTurning-Family-v0 --trials 20 --set belief=true

A trial trains one agent per training seed, and plays all of them on the same tuning seeds; on a family, on all jobs of its split
``validation``. The best mean return wins among the feasible trials (at the leaderboard's confidence limit), or among all if none
is feasible. The first trial takes the values of the hyperparameter file and of ``--set``. A tree-structured Parzen estimator
chooses the others within the ranges that the algorithm's Python file declares (``SEARCH``).

Trials are kept in ``RUNS/tuning``. The same command resumes an interrupted study; with a larger ``--trials``, it extends the
study. With ``--scheduler``, the workers of a Dask cluster train (docs/scaling.md).

The command prints the table; copy it to the hyperparameter file yourself, with a comment on each value.
"""

import argparse
import math
import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import tomli_w
from tqdm import tqdm

from baselines.tune import Played, Trial, trials
from train.run import Run, hyperparameters, overrides, trained_on
from train.training import SEEDS, add_task, algorithm_of, play_agent, train
from turning_env import Family, Scenario
from turning_env.console import described, exits
from turning_env.files import digest_of, file_lock
from turning_env.scoring.workers import Workers, cluster, processes

ALGORITHMS = ("ppo", "sac", "tqc", "recurrent_ppo", "lagrangian_ppo", "analytic_gradient")
NUM_EPISODES = 64  # number of tuning seeds that each agent plays; of a family, it plays all jobs for validation


@dataclass(frozen=True)
class Task:
    """A task of tuning: algorithm, environment and budget of a trial."""

    algorithm: str
    env_id: str
    scenario: Scenario | Family
    total_timesteps: int  # environment steps of each training
    seeds: int  # trainings per trial, with the training seeds 0, 1, ...
    runs: Path
    overrides: dict[str, Any] = field(
        default_factory=dict
    )  # hyperparameters of all trials in place of the file's

    @property
    def known(self) -> dict[str, Any]:
        """Hyperparameters of the first trial. The others differ from it in those that are searched."""
        return (
            hyperparameters(self.algorithm, self.env_id)
            | self.overrides
            | {"total_timesteps": self.total_timesteps}
        )

    @property
    def name(self) -> str:
        """Name of the study: a digest of everything that its trials have in common."""
        searched = algorithm_of(self.algorithm).search
        fixed = {name: value for name, value in self.known.items() if name not in searched}
        return digest_of(
            [self.algorithm, self.env_id, self.scenario.digest(), fixed, self.seeds, NUM_EPISODES]
        )[:16]

    @property
    def allowance(self) -> float:
        """Allowance of severe overload [-]."""
        scenario = (
            self.scenario if isinstance(self.scenario, Scenario) else self.scenario.job(0).scenario
        )
        return scenario.limits.overload_allowance

    @property
    def folder(self) -> Path:
        """Folder of the trials."""
        return self.runs / "tuning" / self.algorithm


def evaluate(task: Task, setting: dict[str, Any]) -> Played:
    """Train with a setting and play the agents; a training may fail, for example because it diverges."""
    algorithm = algorithm_of(task.algorithm)
    runs = task.folder / digest_of([task.name, setting])[:16]
    command = f"a trial of python -m train.tune --algorithm {task.algorithm}"
    episodes = []
    for seed in range(task.seeds):
        run = Run.plan(
            task.algorithm, task.env_id, task.scenario, seed, runs, command, task.known | setting
        )
        try:
            episodes.append(play_agent(train(run, algorithm, wait=True).parent, NUM_EPISODES))
        except ValueError as error:
            return Played(-math.inf, 1.0, 1.0, 0, str(error))
    return Played.of(*episodes)


def search(
    task: Task,
    count: int,
    over: Workers | None = None,
    parallel: int = 1,
    evaluate: Callable[[Task, dict[str, Any]], Played] = evaluate,
) -> tuple[int, Trial]:
    """Return number and trial of the best, after resuming or extending a study to ``count`` trials; ValueError if all failed."""
    log, ranges = task.folder / f".{task.name}.log", algorithm_of(task.algorithm).search
    first = {name: task.known[name] for name in ranges}
    ended: list[Trial] = []
    with file_lock(log):
        found = trials(
            ranges,
            first,
            count,
            log,
            [],
            task.allowance,
            partial(evaluate, task),
            over,
            parallel,
            n_startup_trials=5,
        )
        for trial in tqdm(found, f"tuning {task.algorithm}", count, unit="trial", disable=None):
            played = trial.played
            share = (
                f"severely overloaded for at most {100 * played.severe_limit:.2f} % of cutting time"
            )
            said = (
                f"failed: {played.failed}"
                if played.failed
                else f"mean return {played.mean_return:.1f} s, {share}"
            )
            tqdm.write(f"trial {len(ended)}: {said}, with {trial.setting}", sys.stderr)
            ended.append(trial)
    number, best = max(enumerate(ended), key=lambda each: each[1].merit(task.allowance))
    if best.played.failed:
        raise ValueError(f"all {count} trials failed")
    return number, best


@exits(ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m train.tune", **described(__doc__))
    parser.add_argument("--algorithm", required=True, choices=ALGORITHMS, help="algorithm to tune")
    add_task(parser)
    parser.add_argument(
        "--trials", type=int, default=20, help="total number of trials (default: 20)"
    )
    parser.add_argument("--seeds", type=int, default=1, help="trainings per trial (default: 1)")
    parser.add_argument(
        "--total-timesteps",
        "--steps",
        type=int,
        metavar="N",
        help="environment steps per training (default: from the hyperparameter file)",
    )
    set_help = "set a hyperparameter of every trial, or that of the first if it is searched; repeat the option to set several"
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=set_help)
    parser.add_argument(
        "--workers", type=int, default=1, help="number of trials in parallel (default: 1)"
    )
    parser.add_argument(
        "--scheduler",
        metavar="URL",
        help="train on the workers of a Dask cluster, such as tcp://host:8786",
    )
    parsed = parser.parse_args(arguments)
    for name, largest in (
        ("trials", 100_000),
        ("seeds", SEEDS),
        ("total_timesteps", 10**12),
        ("workers", 1000),
    ):
        value = getattr(parsed, name)
        if value is not None and not 1 <= value <= largest:
            parser.error(f"--{name.replace('_', '-')} is {value}, but must be 1 to {largest}")
    command = "python -m train.tune " + shlex.join(sys.argv[1:] if arguments is None else arguments)
    scenario = trained_on(parsed.env, parsed.scenario)
    known = hyperparameters(parsed.algorithm, parsed.env)
    steps = parsed.total_timesteps or known["total_timesteps"]
    given = overrides(parsed.algorithm, parsed.set)
    task = Task(parsed.algorithm, parsed.env, scenario, steps, parsed.seeds, parsed.runs, given)
    task.folder.mkdir(
        parents=True, exist_ok=True
    )  # find out whether it can be written before workers start
    with cluster(parsed.scheduler) if parsed.scheduler else processes(parsed.workers) as over:
        number, best = search(task, parsed.trials, over, parsed.workers)
    feasible, mean_return = best.merit(task.allowance)
    print(f"# {command}")
    print(
        f"# trial {number}: mean return {mean_return:.1f} s, {'' if feasible else 'not '}feasible"
    )
    print(tomli_w.dumps({parsed.env: best.setting}), end="")
    return 0


if __name__ == "__main__":
    from train import tune  # under the name that workers import

    sys.exit(tune.main())
