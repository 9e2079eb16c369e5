"""Tunes an algorithm's hyperparameters on tuning draws, and prints the winner as a table for its hyperparameter file.

    python -m train.tune --algorithm sac --trials 20 --steps 500000

A trial trains an agent for each of some training seeds, and plays them all on the same tuning draws. The best mean return wins
among the settings that are feasible at the leaderboard's confidence limit; where none is, among all. The first trial is what
the hyperparameter file says; a tree-structured Parzen estimator chooses the others, within ``SEARCH`` in the algorithm's file.

The trials are kept in ``RUNS/tuning``, so that the same command goes on where it stopped, and one with more trials adds to them.
With ``--storage`` they are kept where several such commands, on one machine or on many, work on the same search at the same time;
with ``--scheduler`` the workers of a Dask cluster train (docs/scaling.md).

The table is printed and not written: the files are kept by hand, with what is to be said of each value.
"""

import argparse
import hashlib
import importlib
import json
import shlex
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import tomli_w
from optuna.exceptions import StorageInternalError
from optuna.samplers import TPESampler
from optuna.storages import BaseStorage
from optuna.trial import FrozenTrial, TrialState
from sqlalchemy.exc import SQLAlchemyError
from tqdm import tqdm

from baselines.tune.journal import cut_off_half_line
from train.actor import ActorPolicy
from train.run import Run, hyperparameters
from train.storage import opened, shown
from train.training import SEEDS, Algorithm, train
from turning_env import IDS, Scenario
from turning_env.console import described, exits
from turning_env.files import exclusive_lock, file_lock
from turning_env.score.overload import severe_limit
from turning_env.score.play import play
from turning_env.score.seeds import tuning_seeds
from turning_env.score.workers import cluster, processes

ALGORITHMS = ("ppo", "sac", "tqc", "recurrent_ppo", "lagrangian_ppo", "analytic_gradient")
"""Those that can be tuned."""
DRAWS = 64
"""Tuning draws that each agent plays."""

_OVERLOAD = "overload"  # name of the constraint in the journal
_ENDED = (TrialState.COMPLETE, TrialState.PRUNED)


@dataclass(frozen=True)
class Task:
    """What is tuned, and on what."""

    algorithm: str
    env_id: str
    scenario: Scenario
    steps: int
    """Of each training."""
    seeds: int
    """Trainings per trial: those of the training seeds 0, 1, ..."""
    runs: Path

    @property
    def known(self) -> dict[str, Any]:
        """The hyperparameter file's values."""
        return hyperparameters(self.algorithm, self.env_id) | {"steps": self.steps}

    @property
    def name(self) -> str:
        """Of all that the trials have in common; a journal's trials of another task are let be."""
        searched = algorithm_of(self.algorithm).search
        fixed = {name: value for name, value in self.known.items() if name not in searched}
        return _digest([self.algorithm, self.env_id, self.scenario.digest(), fixed, self.seeds, DRAWS])

    @property
    def folder(self) -> Path:
        """Where the trials are kept."""
        return self.runs / "tuning" / self.algorithm


@dataclass(frozen=True)
class Played:
    """What a setting reached on the tuning draws."""

    mean_return: float
    """[s], over draws and training seeds."""
    severe_limit: float
    """Upper confidence limit of the severely overloaded share of cutting time: see ``turning_env/score/overload.py``."""


def algorithm_of(name: str) -> Algorithm:
    """The algorithm of a name."""
    algorithm: Algorithm = importlib.import_module(f"train.{name}").ALGORITHM
    return algorithm


def evaluate(task: Task, setting: dict[str, Any]) -> Played | str:
    """Train with a setting and play the agents; the reason, if that comes to nothing, as when a number is not finite any more."""
    algorithm = algorithm_of(task.algorithm)
    runs = task.folder / _digest([task.name, setting])
    episodes = []
    for seed in range(task.seeds):
        command = f"a trial of python -m train.tune --algorithm {task.algorithm}"
        run = Run.plan(task.algorithm, task.env_id, task.scenario, seed, runs, command, task.known | setting)
        with exclusive_lock(run.folder, wait=True):
            run.begin()  # a folder of other settings is no matter of the setting
        try:
            make = partial(ActorPolicy, algorithm.actor(train(run, algorithm, wait=True)).eval())
            episodes.append(play(make, task.scenario, tuning_seeds(DRAWS)))
        except ValueError as error:
            return str(error)
    returns, severe, engaged = (
        np.concatenate([each[name] for each in episodes]) for name in ("return", "severe_overload_time", "engaged_time")
    )
    return Played(float(returns.mean()), severe_limit(severe, engaged))


def search(task: Task, trials: int, side_by_side: int, scheduler: str | None = None, storage: str | None = None) -> FrozenTrial:
    """Find the best setting in so many trials; goes on with a search that was interrupted.

    Args:
        task: what is tuned.
        trials: how many trials end in all; of searches that share a storage a few more, as none gives up what it has begun.
        side_by_side: how many of them run at a time, each in a process of its own.
        scheduler: address of a Dask cluster whose workers train; without, processes of this machine do.
        storage: where the trials are kept and shared with other searches, see ``train/storage.py``; without, in the task's
            folder, and not shared.

    Raises:
        ValueError: every training came to nothing, the storage cannot be used, there are no workers, or another process works
            on this search, which is not shared.
    """
    if storage:
        return _search(task, trials, side_by_side, scheduler, opened(storage), shared=True)
    journal = task.folder / "journal.log"
    with file_lock(task.folder / f".{task.name}.lock"):
        cut_off_half_line(journal)
        return _search(task, trials, side_by_side, scheduler, opened(str(journal)), shared=False)


def _search(task: Task, trials: int, side_by_side: int, scheduler: str | None, kept: BaseStorage, shared: bool) -> FrozenTrial:
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(storage=kept, study_name=task.name, direction="maximize", load_if_exists=True)
    distributions = dict(algorithm_of(task.algorithm).search)
    if not shared:
        for unfinished in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            study.tell(unfinished.number, state=TrialState.FAIL)  # killed; the sampler must not heed it
    if not study.get_trials(deepcopy=False, states=(*_ENDED, TrialState.WAITING, TrialState.RUNNING)):
        study.enqueue_trial({name: task.known[name] for name in distributions})
    ended = _ended(study)
    running: list[optuna.Trial] = []
    with (
        cluster(scheduler) if scheduler else processes(side_by_side) as over,
        tqdm(total=max(trials, ended), initial=ended, desc=f"tuning {task.algorithm}", unit="trial", disable=None) as bar,
    ):
        try:
            while running or ended < trials:
                while len(running) < min(side_by_side, trials - ended):
                    # A sampler per trial, as its random numbers must not depend on how often the search was interrupted.
                    # Those of searches that share their trials must differ.
                    study.sampler = TPESampler(seed=None if shared else ended + len(running), n_startup_trials=5)
                    running.append(study.ask(distributions))
                    over.start(running[-1], evaluate, task, running[-1].params)
                trial, played = over.finished()
                running.remove(trial)
                _tell(study, trial, played, task)
                ended = _ended(study)
                bar.update(ended - bar.n)
        finally:
            for trial in running:
                study.tell(trial, state=TrialState.FAIL)  # interrupted
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    if not complete:
        raise ValueError(f"none of {ended} trials came to anything")
    return max(complete, key=_merit)


def _tell(study: optuna.Study, trial: optuna.Trial, played: Played | str, task: Task) -> None:
    if isinstance(played, str):
        study.tell(trial, state=TrialState.PRUNED)
        tqdm.write(f"trial {trial.number}: came to nothing with {trial.params}: {played}", sys.stderr)
        return
    trial.set_constraint(_OVERLOAD, played.severe_limit - task.scenario.limits.overload_allowance)
    study.tell(trial, played.mean_return)
    share = f"severely overloaded for at most {100 * played.severe_limit:.2f} % of cutting time"
    tqdm.write(f"trial {trial.number}: mean return {played.mean_return:.1f} s, {share}, with {trial.params}", sys.stderr)


def feasible(trial: FrozenTrial) -> bool:
    """Whether a trial's setting holds the allowance of overload."""
    return trial.constraints[_OVERLOAD] <= 0.0


def _merit(trial: FrozenTrial) -> tuple[bool, float]:
    assert trial.value is not None  # it has finished
    return feasible(trial), trial.value


def _ended(study: optuna.Study) -> int:
    return len(study.get_trials(deepcopy=False, states=_ENDED))


def _digest(values: list[Any]) -> str:
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()[:16]


@exits(ValueError, StorageInternalError, SQLAlchemyError, interrupted="interrupted: run the same command again to go on")
def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m train.tune", **described(__doc__))
    parser.add_argument("--algorithm", required=True, choices=ALGORITHMS, help="what is tuned")
    parser.add_argument("--env", default="RoughTurning-v0", choices=list(IDS), help="environment id (default: %(default)s)")
    parser.add_argument("--scenario", help="preset or TOML file (default: the id's preset)")
    parser.add_argument("--trials", type=int, default=20, help="settings tried in all (default: 20)")
    parser.add_argument("--seeds", type=int, default=1, help="trainings per trial (default: 1)")
    parser.add_argument("--steps", type=int, help="environment steps per training (default: the hyperparameter file's)")
    parser.add_argument("--workers", type=int, default=1, help="trials side by side (default: 1)")
    parser.add_argument("--scheduler", metavar="URL", help="have the workers of a Dask cluster train, such as tcp://host:8786")
    kept = "journal file or database URL that several searches share (default: a journal in RUNS/tuning, not shared)"
    parser.add_argument("--storage", metavar="FILE_OR_URL", help=kept)
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)")
    parsed = parser.parse_args(arguments)
    for name, most in (("trials", 100_000), ("seeds", SEEDS), ("steps", 10**12), ("workers", 1000)):
        value = getattr(parsed, name)
        if value is not None and not 1 <= value <= most:
            parser.error(f"--{name} is {value}, but must be 1 to {most}")
    command = "python -m train.tune " + shlex.join(sys.argv[1:] if arguments is None else arguments)
    if parsed.storage:
        command = command.replace(shlex.quote(parsed.storage), shlex.quote(shown(parsed.storage)))
    scenario = Scenario.load(parsed.scenario or IDS[parsed.env])
    steps = parsed.steps or hyperparameters(parsed.algorithm, parsed.env)["steps"]
    task = Task(parsed.algorithm, parsed.env, scenario, steps, parsed.seeds, parsed.runs)
    best = search(task, parsed.trials, parsed.workers, parsed.scheduler, parsed.storage)
    print(f"# {command}")
    print(f"# trial {best.number}: mean return {best.value:.1f} s, {'' if feasible(best) else 'not '}feasible")
    print(tomli_w.dumps({parsed.env: best.params}), end="")
    return 0


if __name__ == "__main__":
    from train import tune  # under the name by which workers know it

    sys.exit(tune.main())
