"""Tune an algorithm's hyperparameters, and print the best as a table of TOML.

    python -m train.tune agent --algorithm sac --trials 20 --total-timesteps 500000
    python -m train.tune agent --algorithm ppo --env RoughTurning-Family-v1 --trials 20

A trial trains one agent per training seed, and plays all of them on the same tuning seeds; on a
family, on all jobs of its split ``validation``. The best mean return wins among the feasible trials
(at the leaderboard's confidence limit), or among all if none is feasible. The first trial takes the
algorithm's values for the id and of ``--set``. A tree-structured Parzen estimator chooses the
others within the ranges that the algorithm's Python file declares (``SEARCH``).

Trials are kept in ``RUNS/tuning``. The same command resumes an interrupted study; with a larger
``--trials``, it extends the study. With ``--scheduler``, the workers of a Dask cluster train
(docs/scaling.md).

Copy the printed table to ``train/hyperparameters/ALGORITHM.toml``, with a comment on each value:
trainings on this id take these values in place of the algorithm's defaults.
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

from leaderboard.workers import Workers, cluster, processes
from train.run import ALGORITHMS, Run, hyperparameters, overrides, trained_on
from train.training import SEEDS, add_task, algorithm_of, play_agent, train
from train.tune_rules import SettingResult, Trial, TrialLog, trials
from turning_env import Family, Scenario
from turning_env.console import described, exits, whole_number
from turning_env.files import digest_of, file_lock
from turning_env.progress import progress

NUM_EPISODES = 64
"""Number of tuning seeds that each agent plays; on a family, it plays all jobs for validation."""
STARTUP_TRIALS = 5
"""Number of trials at random before the estimator chooses."""
MAX_OPTIONS = {
    "trials": 100_000,
    "seeds": SEEDS,
    "total_timesteps": 10**12,
    "workers": 1000,
}
"""Largest values of options; the smallest is 1."""


@dataclass(frozen=True)
class TuningTask:
    """A task of tuning: algorithm, environment and budget of a trial."""

    algorithm: str
    env_id: str
    scenario: Scenario | Family
    total_timesteps: int  # environment steps of each training
    seeds: int  # trainings per trial, with the training seeds 0, 1, ...
    runs: Path
    overrides: dict[str, Any] = field(default_factory=dict)
    """Hyperparameters of all trials in place of the file's."""

    @property
    def first_setting(self) -> dict[str, Any]:
        """Hyperparameters of the first trial.

        The others differ from it in those that are searched.
        """
        defaults = hyperparameters(self.algorithm, self.env_id)
        return defaults | self.overrides | {"total_timesteps": self.total_timesteps}

    @property
    def name(self) -> str:
        """Name of the study: a digest of everything that its trials have in common."""
        # Searched values differ between trials, all others must not.
        searched = algorithm_of(self.algorithm).search
        fixed = {name: value for name, value in self.first_setting.items() if name not in searched}
        common = [
            self.algorithm,
            self.env_id,
            self.scenario.digest(),
            fixed,
            self.seeds,
            NUM_EPISODES,
        ]
        return digest_of(common)[:16]

    @property
    def allowance(self) -> float:
        """Allowance of severe overload [-]."""
        scenario = self.scenario
        if isinstance(scenario, Family):
            scenario = scenario.job(0).scenario
        return scenario.limits.overload_allowance

    @property
    def folder(self) -> Path:
        """Folder of the trials."""
        return self.runs / "tuning" / self.algorithm


def evaluate(task: TuningTask, setting: dict[str, Any]) -> SettingResult:
    """Train with a setting and play the agents.

    A training may fail, for example because it diverges.
    """
    algorithm = algorithm_of(task.algorithm)
    # A folder per setting: an interrupted trial resumes its trainings.
    runs = task.folder / digest_of([task.name, setting])[:16]
    episodes = []
    for seed in range(task.seeds):
        run = Run.plan(
            algorithm=task.algorithm,
            env_id=task.env_id,
            scenario=task.scenario,
            seed=seed,
            runs=runs,
            command=f"a trial of python -m train.tune agent --algorithm {task.algorithm}",
            given=task.first_setting | setting,
        )
        try:
            folder = train(run, algorithm, wait=True).parent
            episodes.append(play_agent(folder, NUM_EPISODES))
        except ValueError as error:
            return SettingResult(
                mean_return=-math.inf,
                severe_share=1.0,
                severe_limit=1.0,
                steps=0,
                failed=str(error),
            )
    return SettingResult.of(*episodes)


def _report(number: int, trial: Trial) -> str:
    """Return a line on a trial that has ended."""
    played = trial.played
    if played.failed:
        outcome = f"failed: {played.failed}"
    else:
        outcome = (
            f"mean return {played.mean_return:.2f} s, in severe overload "
            f"for at most {100 * played.severe_limit:.2f} % of cutting time"
        )
    return f"trial {number}: {outcome}, with {trial.setting}"


def search(
    task: TuningTask,
    count: int,
    over: Workers | None = None,
    parallel: int = 1,
    evaluate: Callable[[TuningTask, dict[str, Any]], SettingResult] = evaluate,
) -> tuple[int, Trial]:
    """Resume or extend a study to ``count`` trials; return number and trial of the best.

    Args:
        task: what to tune.
        count: number of trials of the study, with those that have ended before.
        over: workers that evaluate trials; None: this process.
        parallel: number of trials at the same time.
        evaluate: function that returns the result of a setting.

    Raises:
        ValueError: all trials failed.
    """
    ranges = algorithm_of(task.algorithm).search
    first_setting = task.first_setting
    log = task.folder / f".{task.name}.log"
    ended: list[Trial] = []
    with file_lock(log):
        ending_trials = trials(
            ranges,
            {name: first_setting[name] for name in ranges},
            count=count,
            log=TrialLog(log, task=[]),
            allowance=task.allowance,
            play=partial(evaluate, task),
            over=over,
            parallel=parallel,
            n_startup_trials=STARTUP_TRIALS,
        )
        shown_trials = progress(
            ending_trials, f"tuning {task.algorithm}", total=count, unit="trial"
        )
        for trial in shown_trials:
            tqdm.write(_report(len(ended), trial), sys.stderr)
            ended.append(trial)

    # The first of equals wins.
    best = max(range(len(ended)), key=lambda number: ended[number].merit(task.allowance))
    if ended[best].played.failed:
        raise ValueError(f"all {count} trials failed")
    return best, ended[best]


def add_to(commands: Any) -> None:
    """Add the command ``agent`` to the subparsers of a command line."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "agent", help="tune the hyperparameters of an algorithm", **described(__doc__)
    )
    parser.set_defaults(command=tune_agent)
    parser.add_argument("--algorithm", required=True, choices=ALGORITHMS, help="algorithm to tune")
    add_task(parser)
    parser.add_argument(
        "--trials", type=int, default=20, help="total number of trials (default: 20)"
    )
    parser.add_argument("--seeds", type=int, default=1, help="trainings per trial (default: 1)")
    parser.add_argument(
        "--total-timesteps",
        "--steps",
        type=whole_number,
        metavar="N",
        help="environment steps per training (default: the algorithm's)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="set a hyperparameter of every trial, or that of the first if it is searched; "
        "repeat the option to set several",
    )
    parser.add_argument(
        "--workers", type=int, default=1, help="number of trials in parallel (default: 1)"
    )
    parser.add_argument(
        "--scheduler",
        metavar="URL",
        help="train on the workers of a Dask cluster, such as tcp://host:8786",
    )


@exits(ValueError, interrupted="interrupted: run the same command again to go on")
def tune_agent(parsed: argparse.Namespace) -> int:
    """Tune an algorithm as a command line asks; return the exit status."""
    for name, largest in MAX_OPTIONS.items():
        value = getattr(parsed, name)
        if value is not None and not 1 <= value <= largest:
            option = name.replace("_", "-")
            raise ValueError(f"--{option} is {value}, but must be 1 to {largest}")

    defaults = hyperparameters(parsed.algorithm, parsed.env)
    task = TuningTask(
        algorithm=parsed.algorithm,
        env_id=parsed.env,
        scenario=trained_on(parsed.env, parsed.scenario),
        total_timesteps=parsed.total_timesteps or defaults["total_timesteps"],
        seeds=parsed.seeds,
        runs=parsed.runs,
        overrides=overrides(parsed.algorithm, parsed.set),
    )
    # Find out whether the folder can be written before workers start.
    task.folder.mkdir(parents=True, exist_ok=True)
    workers = cluster(parsed.scheduler) if parsed.scheduler else processes(parsed.workers)
    with workers as over:
        number, best = search(task, parsed.trials, over=over, parallel=parsed.workers)

    feasible, mean_return = best.merit(task.allowance)
    verdict = "feasible" if feasible else "not feasible"
    print(f"# python -m train.tune {shlex.join(parsed.words)}")
    print(f"# trial {number}: mean return {mean_return:.1f} s, {verdict}")
    print(tomli_w.dumps({parsed.env: best.setting}), end="")
    return 0
