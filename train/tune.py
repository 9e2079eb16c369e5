"""Tune an algorithm's hyperparameters on tuning seeds, and print the best as a table for its hyperparameter file.

    python -m train.tune --algorithm sac --trials 20 --steps 500000
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
import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import optuna
import tomli_w
from optuna.samplers import TPESampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import FrozenTrial, TrialState
from tqdm import tqdm

from train.run import Run, hyperparameters, overrides, trained_on
from train.training import SEEDS, Algorithm, add_task, play_agent, train
from turning_env import Family, Scenario
from turning_env.console import described, exits
from turning_env.files import digest_of, file_lock
from turning_env.scoring.statistics import severe_limit
from turning_env.scoring.workers import Workers, cluster, processes

ALGORITHMS = ("ppo", "sac", "tqc", "recurrent_ppo", "lagrangian_ppo", "analytic_gradient")
NUM_EPISODES = 64
"""Number of tuning seeds that each agent plays; of a family, it plays all jobs for validation."""
_OVERLOAD = "severe_overload"
_ENDED = (TrialState.COMPLETE, TrialState.PRUNED)


@dataclass(frozen=True)
class Task:
    """A task of tuning: algorithm, environment and budget of a trial."""

    algorithm: str
    env_id: str
    scenario: Scenario | Family
    steps: int
    """Environment steps of each training."""
    seeds: int
    """Trainings per trial, with the training seeds 0, 1, ..."""
    runs: Path
    overrides: dict[str, Any] = field(default_factory=dict)
    """Hyperparameters of all trials in place of the file's."""

    @property
    def known(self) -> dict[str, Any]:
        """Hyperparameters of the first trial. The others differ from it in those that are searched."""
        return hyperparameters(self.algorithm, self.env_id) | self.overrides | {"steps": self.steps}

    @property
    def name(self) -> str:
        """Name of the study: a digest of everything that its trials have in common."""
        searched = algorithm_of(self.algorithm).search
        fixed = {name: value for name, value in self.known.items() if name not in searched}
        return digest_of([self.algorithm, self.env_id, self.scenario.digest(), fixed, self.seeds, NUM_EPISODES])[:16]

    @property
    def folder(self) -> Path:
        """Folder of the trials."""
        return self.runs / "tuning" / self.algorithm


class Evaluation(NamedTuple):
    """Result of a setting on the tuning seeds."""

    mean_return: float
    """Mean return over tuning seeds and training seeds [s]."""
    severe_limit: float
    """Upper confidence limit of the severely overloaded share of cutting time [-], see ``turning_env/scoring/overload.py``."""


def algorithm_of(name: str) -> Algorithm:
    """Return the algorithm with a name."""
    algorithm: Algorithm = import_module(f"train.{name}").ALGORITHM
    return algorithm


def evaluate(task: Task, setting: dict[str, Any]) -> Evaluation | str:
    """Train with a setting and play the agents; if training fails, for example because it diverges, return the reason."""
    algorithm = algorithm_of(task.algorithm)
    runs = task.folder / digest_of([task.name, setting])[:16]
    command = f"a trial of python -m train.tune --algorithm {task.algorithm}"
    episodes = []
    for seed in range(task.seeds):
        run = Run.plan(task.algorithm, task.env_id, task.scenario, seed, runs, command, task.known | setting)
        try:
            episodes.append(play_agent(train(run, algorithm, wait=True).parent, NUM_EPISODES))
        except ValueError as error:
            return str(error)
    returns, severe, engaged = (
        np.concatenate([each[name] for each in episodes]) for name in ("return", "severe_overload_time", "engaged_time")
    )
    return Evaluation(float(returns.mean()), severe_limit(severe, engaged))


def search(
    task: Task,
    trials: int,
    over: Workers,
    parallel: int = 1,
    evaluate: Callable[[Task, dict[str, Any]], Evaluation | str] = evaluate,
) -> FrozenTrial:
    """Return the best trial of a study, after resuming or extending it to ``trials`` trials.

    Args:
        task: task of tuning.
        trials: number of ended trials.
        over: workers that train.
        parallel: number of trials at a time, each of one worker.
        evaluate: function that trains and plays.

    Raises:
        ValueError: all trainings failed, there are no workers, or another process works on this study.
    """
    path = task.folder / f"{task.name}.log"
    with file_lock(path):
        content = path.read_bytes()  # Optuna would append to half a line that a killed process left
        path.write_bytes(content[: content.rfind(b"\n") + 1])
        storage = JournalStorage(JournalFileBackend(str(path), JournalFileOpenLock(str(path))))
        study = optuna.create_study(storage=storage, study_name=task.name, direction="maximize", load_if_exists=True)
        distributions = dict(algorithm_of(task.algorithm).search)
        for unfinished in study.get_trials(states=[TrialState.RUNNING]):
            study.tell(unfinished.number, state=TrialState.FAIL)  # killed; the sampler must ignore it
        if not study.get_trials(states=[*_ENDED, TrialState.WAITING]):
            study.enqueue_trial({name: task.known[name] for name in distributions})
        ended = len(study.get_trials(states=_ENDED))
        running: list[optuna.Trial] = []
        bar = tqdm(total=max(trials, ended), initial=ended, desc=f"tuning {task.algorithm}", unit="trial", disable=None)
        try:
            while running or ended < trials:
                while len(running) < min(parallel, trials - ended):
                    # A sampler per trial: its random numbers must not depend on interruptions.
                    study.sampler = TPESampler(seed=ended + len(running), n_startup_trials=5)
                    running.append(study.ask(distributions))
                    over.start(running[-1], evaluate, task, running[-1].params)
                trial, evaluation = over.finished()
                running.remove(trial)
                _tell(study, trial, evaluation, task)
                ended = len(study.get_trials(states=_ENDED))
                bar.update(ended - bar.n)
        finally:
            bar.close()
            for trial in running:
                study.tell(trial, state=TrialState.FAIL)  # interrupted
    complete = study.get_trials(states=[TrialState.COMPLETE])
    if not complete:
        raise ValueError(f"all {ended} trials failed")
    return max(complete, key=lambda trial: (feasible(trial), trial.value))


def _tell(study: optuna.Study, trial: optuna.Trial, evaluation: Evaluation | str, task: Task) -> None:
    if isinstance(evaluation, str):
        study.tell(trial, state=TrialState.PRUNED)
        tqdm.write(f"trial {trial.number}: failed with {trial.params}: {evaluation}", sys.stderr)
        return
    scenario = task.scenario if isinstance(task.scenario, Scenario) else task.scenario.job(0).scenario
    trial.set_constraint(_OVERLOAD, evaluation.severe_limit - scenario.limits.overload_allowance)
    study.tell(trial, evaluation.mean_return)
    share = f"severely overloaded for at most {100 * evaluation.severe_limit:.2f} % of cutting time"
    tqdm.write(f"trial {trial.number}: mean return {evaluation.mean_return:.1f} s, {share}, with {trial.params}", sys.stderr)


def feasible(trial: FrozenTrial) -> bool:
    """Return whether a trial's setting is feasible."""
    return trial.constraints[_OVERLOAD] <= 0.0


@exits(ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m train.tune", **described(__doc__))
    parser.add_argument("--algorithm", required=True, choices=ALGORITHMS, help="algorithm to tune")
    add_task(parser)
    parser.add_argument("--trials", type=int, default=20, help="total number of trials (default: 20)")
    parser.add_argument("--seeds", type=int, default=1, help="trainings per trial (default: 1)")
    parser.add_argument("--steps", type=int, help="environment steps per training (default: from the hyperparameter file)")
    set_help = "set a hyperparameter of every trial, or that of the first if it is searched; repeat the option to set several"
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=set_help)
    parser.add_argument("--workers", type=int, default=1, help="number of trials in parallel (default: 1)")
    parser.add_argument("--scheduler", metavar="URL", help="train on the workers of a Dask cluster, such as tcp://host:8786")
    parsed = parser.parse_args(arguments)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    for name, largest in (("trials", 100_000), ("seeds", SEEDS), ("steps", 10**12), ("workers", 1000)):
        value = getattr(parsed, name)
        if value is not None and not 1 <= value <= largest:
            parser.error(f"--{name} is {value}, but must be 1 to {largest}")
    command = "python -m train.tune " + shlex.join(sys.argv[1:] if arguments is None else arguments)
    scenario = trained_on(parsed.env, parsed.scenario)
    steps = parsed.steps or hyperparameters(parsed.algorithm, parsed.env)["steps"]
    given = overrides(parsed.algorithm, parsed.set)
    task = Task(parsed.algorithm, parsed.env, scenario, steps, parsed.seeds, parsed.runs, given)
    task.folder.mkdir(parents=True, exist_ok=True)  # find out whether it can be written before workers start
    with cluster(parsed.scheduler) if parsed.scheduler else processes(parsed.workers) as over:
        best = search(task, parsed.trials, over, parsed.workers)
    print(f"# {command}")
    print(f"# trial {best.number}: mean return {best.value:.1f} s, {'' if feasible(best) else 'not '}feasible")
    print(tomli_w.dumps({parsed.env: best.params}), end="")
    return 0


if __name__ == "__main__":
    from train import tune  # under the name that workers import

    sys.exit(tune.main())
