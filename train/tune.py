"""Tune an algorithm's hyperparameters on tuning seeds, and print the best as a table for its hyperparameter file.

    python -m train.tune --algorithm sac --trials 20 --steps 500000

A trial trains one agent per training seed, and plays all of them on the same tuning seeds. The best mean return wins among the
feasible trials (at the leaderboard's confidence limit), or among all if none is feasible. The first trial takes the values of
the hyperparameter file and of ``--set``. A tree-structured Parzen estimator chooses the others within the ranges that the
algorithm's Python file declares (``SEARCH``).

Trials are kept in ``RUNS/tuning``. The same command resumes an interrupted study; with a larger ``--trials``, it extends the
study. With ``--storage``, several such commands, on one machine or on many, work on the same study. With ``--scheduler``, the
workers of a Dask cluster train (docs/scaling.md).

The command prints the table; copy it to the hyperparameter file yourself, with a comment on each value.
"""

import argparse
import hashlib
import importlib
import json
import shlex
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import optuna
import tomli_w
from optuna.exceptions import StorageInternalError
from optuna.samplers import TPESampler
from optuna.storages import BaseStorage, JournalStorage, RDBStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import FrozenTrial, TrialState
from sqlalchemy import URL, make_url
from sqlalchemy.exc import ArgumentError, IntegrityError, SQLAlchemyError
from tqdm import tqdm

from baselines.tune import cut_off_half_line
from train.actor import ActorPolicy
from train.run import Run, hyperparameters, overrides
from train.training import SEEDS, Algorithm, train
from turning_env import IDS, Scenario
from turning_env.console import described, exits
from turning_env.files import file_lock
from turning_env.scoring.play import play
from turning_env.scoring.seeds import tuning_seeds
from turning_env.scoring.statistics import severe_limit
from turning_env.scoring.workers import Workers, cluster, processes

ALGORITHMS = ("ppo", "sac", "tqc", "recurrent_ppo", "lagrangian_ppo", "analytic_gradient")
NUM_EPISODES = 64
"""Number of tuning seeds that each agent plays."""
_SQLITE_TIMEOUT = 60.0  # for another process that writes the file [s]
_ATTEMPTS = 3  # to open a database
_OVERLOAD = "severe_overload"
_ENDED = (TrialState.COMPLETE, TrialState.PRUNED)


@dataclass(frozen=True)
class Task:
    """A task of tuning: algorithm, environment and budget of a trial."""

    algorithm: str
    env_id: str
    scenario: Scenario
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
        return _digest([self.algorithm, self.env_id, self.scenario.digest(), fixed, self.seeds, NUM_EPISODES])

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
    algorithm: Algorithm = importlib.import_module(f"train.{name}").ALGORITHM
    return algorithm


def evaluate(task: Task, setting: dict[str, Any]) -> Evaluation | str:
    """Train with a setting and play the agents; if training fails, for example because it diverges, return the reason."""
    algorithm = algorithm_of(task.algorithm)
    runs = task.folder / _digest([task.name, setting])
    command = f"a trial of python -m train.tune --algorithm {task.algorithm}"
    episodes = []
    for seed in range(task.seeds):
        run = Run.plan(task.algorithm, task.env_id, task.scenario, seed, runs, command, task.known | setting)
        try:
            make = partial(ActorPolicy, algorithm.actor(train(run, algorithm, wait=True)))
            episodes.append(play(make, task.scenario, tuning_seeds(NUM_EPISODES)))
        except ValueError as error:
            return str(error)
    returns, severe, engaged = (
        np.concatenate([each[name] for each in episodes]) for name in ("return", "severe_overload_time", "engaged_time")
    )
    return Evaluation(float(returns.mean()), severe_limit(severe, engaged))


def open_storage(where: str) -> BaseStorage:
    """Open a database by its URL (``sqlite:///trials.db``, ``postgresql://host/name``), or a journal by its file.

    Raises:
        ValueError: the storage cannot be reached, read or written. The message says why, without the password.
    """
    if "://" not in where:
        try:
            Path(where).parent.mkdir(parents=True, exist_ok=True)
            return JournalStorage(JournalFileBackend(where, JournalFileOpenLock(where)))
        except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:  # the last three: it is no journal
            raise ValueError(f"a study cannot be kept in {where}: {error}") from error
    url = _url(where)
    # A database closes connections that are not used while an agent is trained.
    is_sqlite = url.get_backend_name() == "sqlite"
    options: dict[str, Any] = {"connect_args": {"timeout": _SQLITE_TIMEOUT}} if is_sqlite else {"pool_pre_ping": True}
    for attempt in range(1, _ATTEMPTS + 1):
        try:
            return RDBStorage(where, options)
        except (SQLAlchemyError, StorageInternalError, ImportError, RuntimeError) as error:
            # Two processes that open an empty database at the same time both create its tables, and one of them fails.
            created_meanwhile = isinstance(error, IntegrityError) or "already exists" in str(error)
            if not created_meanwhile or attempt == _ATTEMPTS:
                raise ValueError(f"a study cannot be kept in {url}: {str(error).strip().splitlines()[0]}") from error
    raise AssertionError


def _url(where: str) -> URL:
    try:
        return make_url(where)
    except (ArgumentError, ValueError) as error:
        raise ValueError("a study cannot be kept there: it is not the URL of a database") from error


def search(
    task: Task,
    trials: int,
    over: Workers,
    parallel: int = 1,
    storage: str | None = None,
    evaluate: Callable[[Task, dict[str, Any]], Evaluation | str] = evaluate,
) -> FrozenTrial:
    """Return the best trial of a study, after resuming or extending it to ``trials`` trials.

    Args:
        task: task of tuning.
        trials: number of ended trials; processes that share a storage may add a few more, because each finishes its trials.
        over: workers that train.
        parallel: number of trials at a time, each of one worker.
        storage: storage to share with other processes, see ``open_storage``; None: a journal in the task's folder.
        evaluate: function that trains and plays.

    Raises:
        ValueError: all trainings failed, the storage cannot be used, there are no workers, or another process works on this
            study, which is not shared.
    """
    journal = task.folder / "journal.log"
    with nullcontext() if storage else file_lock(task.folder / f".{task.name}.lock"):
        if not storage:
            cut_off_half_line(journal)
        opened = open_storage(storage or str(journal))
        study = optuna.create_study(storage=opened, study_name=task.name, direction="maximize", load_if_exists=True)
        distributions = dict(algorithm_of(task.algorithm).search)
        if not storage:
            for unfinished in _trials(study, TrialState.RUNNING):
                study.tell(unfinished.number, state=TrialState.FAIL)  # killed; the sampler must ignore it
        if not _trials(study, *_ENDED, TrialState.WAITING, TrialState.RUNNING):
            study.enqueue_trial({name: task.known[name] for name in distributions})
        ended = len(_trials(study, *_ENDED))
        running: list[optuna.Trial] = []
        bar = tqdm(total=max(trials, ended), initial=ended, desc=f"tuning {task.algorithm}", unit="trial", disable=None)
        try:
            while running or ended < trials:
                while len(running) < min(parallel, trials - ended):
                    # A sampler per trial: its random numbers must not depend on interruptions.
                    # Those of processes that share a study must differ.
                    study.sampler = TPESampler(seed=None if storage else ended + len(running), n_startup_trials=5)
                    running.append(study.ask(distributions))
                    over.start(running[-1], evaluate, task, running[-1].params)
                trial, evaluation = over.finished()
                running.remove(trial)
                _tell(study, trial, evaluation, task)
                ended = len(_trials(study, *_ENDED))
                bar.update(ended - bar.n)
        finally:
            bar.close()
            for trial in running:
                study.tell(trial, state=TrialState.FAIL)  # interrupted
    complete = _trials(study, TrialState.COMPLETE)
    if not complete:
        raise ValueError(f"all {ended} trials failed")
    return max(complete, key=lambda trial: (feasible(trial), trial.value))


def _tell(study: optuna.Study, trial: optuna.Trial, evaluation: Evaluation | str, task: Task) -> None:
    if isinstance(evaluation, str):
        study.tell(trial, state=TrialState.PRUNED)
        tqdm.write(f"trial {trial.number}: failed with {trial.params}: {evaluation}", sys.stderr)
        return
    trial.set_constraint(_OVERLOAD, evaluation.severe_limit - task.scenario.limits.overload_allowance)
    study.tell(trial, evaluation.mean_return)
    share = f"severely overloaded for at most {100 * evaluation.severe_limit:.2f} % of cutting time"
    tqdm.write(f"trial {trial.number}: mean return {evaluation.mean_return:.1f} s, {share}, with {trial.params}", sys.stderr)


def _trials(study: optuna.Study, *states: TrialState) -> list[FrozenTrial]:
    return study.get_trials(deepcopy=False, states=states)


def feasible(trial: FrozenTrial) -> bool:
    """Return whether a trial's setting is feasible."""
    return trial.constraints[_OVERLOAD] <= 0.0


def _digest(values: list[Any]) -> str:
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()[:16]


@exits(ValueError, StorageInternalError, SQLAlchemyError, interrupted="interrupted: run the same command again to go on")
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m train.tune", **described(__doc__))
    parser.add_argument("--algorithm", required=True, choices=ALGORITHMS, help="algorithm to tune")
    parser.add_argument("--env", default="RoughTurning-v0", choices=list(IDS), help="environment id (default: %(default)s)")
    parser.add_argument("--scenario", help="preset or TOML file (default: the id's preset)")
    parser.add_argument("--trials", type=int, default=20, help="total number of trials (default: 20)")
    parser.add_argument("--seeds", type=int, default=1, help="trainings per trial (default: 1)")
    parser.add_argument("--steps", type=int, help="environment steps per training (default: from the hyperparameter file)")
    set_help = "set a hyperparameter of every trial, or that of the first if it is searched; repeat the option to set several"
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=set_help)
    parser.add_argument("--workers", type=int, default=1, help="number of trials in parallel (default: 1)")
    parser.add_argument("--scheduler", metavar="URL", help="train on the workers of a Dask cluster, such as tcp://host:8786")
    shared = "journal file or database URL shared by several processes (default: a journal in RUNS/tuning, not shared)"
    parser.add_argument("--storage", metavar="FILE_OR_URL", help=shared)
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)")
    parsed = parser.parse_args(arguments)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    for name, largest in (("trials", 100_000), ("seeds", SEEDS), ("steps", 10**12), ("workers", 1000)):
        value = getattr(parsed, name)
        if value is not None and not 1 <= value <= largest:
            parser.error(f"--{name} is {value}, but must be 1 to {largest}")
    command = "python -m train.tune " + shlex.join(sys.argv[1:] if arguments is None else arguments)
    if parsed.storage and "://" in parsed.storage:  # without the password
        command = command.replace(shlex.quote(parsed.storage), shlex.quote(str(_url(parsed.storage))))
    scenario = Scenario.load(parsed.scenario or IDS[parsed.env])
    steps = parsed.steps or hyperparameters(parsed.algorithm, parsed.env)["steps"]
    given = overrides(parsed.algorithm, parsed.set)
    task = Task(parsed.algorithm, parsed.env, scenario, steps, parsed.seeds, parsed.runs, given)
    task.folder.mkdir(parents=True, exist_ok=True)  # find out whether it can be written before workers start
    with cluster(parsed.scheduler) if parsed.scheduler else processes(parsed.workers) as over:
        best = search(task, parsed.trials, over, parsed.workers, parsed.storage)
    print(f"# {command}")
    print(f"# trial {best.number}: mean return {best.value:.1f} s, {'' if feasible(best) else 'not '}feasible")
    print(tomli_w.dumps({parsed.env: best.params}), end="")
    return 0


if __name__ == "__main__":
    from train import tune  # under the name that workers import

    sys.exit(tune.main())
