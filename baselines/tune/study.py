"""Search for the best parameters of rules with Optuna, with a journal on disk.

The first trial is the middle of every range; a tree-structured Parzen estimator chooses the others. All trials play the same
seeds. The best mean return wins among the feasible trials, or among all if none is feasible.

A trial's parameters depend only on its number and the trials before it. So an interrupted search finds the same parameters.
"""

import hashlib
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import optuna
from gymnasium.vector import AutoresetMode
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import TPESampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import FrozenTrial, TrialState
from tqdm import tqdm

from baselines.rule import Parameters, Range, Rule
from baselines.tune.journal import cut_off_half_line
from baselines.tuned import Task, first_scenario
from turning_env import MODEL_VERSION, Family, FamilyVectorEnv
from turning_env.scoring.play import play
from turning_env.scoring.seeds import tuning_seeds
from turning_env.scoring.statistics import severe_limit, severe_share
from turning_env.scoring.workers import Workers

_CANDIDATES = 128
"""Number of candidates from which the estimator picks. With Optuna's 24, it stays farther from the limit of feasibility."""

_OVERLOAD, _SEVERE_SHARE, _STEPS = "overload", "severe_share", "steps"  # names in the journal


@dataclass(frozen=True)
class Played:
    """Result of one trial."""

    mean_return: float
    """[s]"""
    severe_share: float
    """Share of cutting time more than the tolerance over a limit [-]."""
    severe_limit: float
    """Its one-sided upper confidence limit [-], which decides on feasibility."""
    steps: int
    """Steps played."""


@dataclass(frozen=True)
class Found:
    """Best parameters of a search, their result and the budget of all trials, as written to a file of tuned parameters."""

    version: int
    """The rule's."""
    parameters: Parameters
    mean_return: float
    """[s]"""
    severe_share: float
    """Share of cutting time more than the tolerance over a limit [-]."""
    feasible: bool
    episodes_played: int
    steps_played: int


def play_setting(rule: Rule, task: Task, setting: Parameters, seeds: Sequence[int]) -> Played:
    """Play a rule with some parameters on seeds; those of a family are of its training jobs."""
    if isinstance(task, Family):
        models: Any = [task.job(seed).scenario.nominal() for seed in seeds]
        played: Any = FamilyVectorEnv(len(seeds), task, context="hidden", autoreset_mode=AutoresetMode.SAME_STEP)
    else:
        models = played = task
    episodes = play(lambda num_envs: rule.build(models, num_envs, setting), played, seeds)
    severe, engaged = episodes["severe_overload_time"], episodes["engaged_time"]
    return Played(
        mean_return=float(episodes["return"].mean()),
        severe_share=severe_share(severe, engaged),
        severe_limit=severe_limit(severe, engaged),
        steps=int(episodes["steps"].sum()),
    )


class Search:
    """The search for the best parameters of a rule; continues one that was interrupted.

    ``next`` asks for a trial and ``tell`` takes its result, one after the other. Any process may play it.

    Args:
        name: name of the rule.
        rule: rule to tune.
        task: scenario or family to play.
        trials: number of trials.
        seeds: number of tuning seeds that each trial plays.
        journal: file that keeps the trials until the search is finished.
    """

    def __init__(self, name: str, rule: Rule, task: Task, trials: int, seeds: int, journal: Path) -> None:
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self.name, self._rule, self._task, self.trials = name, rule, task, trials
        self._allowance = first_scenario(task).limits.overload_allowance
        self._seeds = tuning_seeds(seeds)
        self._ranges: dict[str, BaseDistribution] = {
            key: FloatDistribution(value.low, value.high, log=value.logarithmic) for key, value in rule.ranges.items()
        }
        self._study = optuna.create_study(
            storage=_open(journal),
            study_name=_study_name(rule, task, trials, seeds),
            direction="maximize",
            load_if_exists=True,
        )
        for unfinished in self._study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            self._study.tell(unfinished.number, state=TrialState.FAIL)  # interrupted: hide it from the sampler
        if not self._study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.WAITING)):
            self._study.enqueue_trial({key: middle(value) for key, value in rule.ranges.items()})
        self._finished = _finished(self._study)
        self._trial: optuna.Trial | None = None

    @property
    def left(self) -> int:
        """Return the number of trials left."""
        return self.trials - len(self._finished)

    def next(self) -> tuple[str, Rule, Task, Parameters, list[int]]:
        """Return the next trial: the arguments of ``play_trial``."""
        # A sampler per trial, so that its random numbers do not depend on interruptions.
        self._study.sampler = TPESampler(seed=len(self._finished), n_ei_candidates=_CANDIDATES)
        self._trial = self._study.ask(self._ranges)
        return self.name, self._rule, self._task, self._rule.fixed | self._trial.params, self._seeds

    def tell(self, played: Played) -> None:
        """Take the result of the trial that ``next`` returned last."""
        assert self._trial is not None
        self._trial.set_constraint(_OVERLOAD, played.severe_limit - self._allowance)
        self._trial.set_user_attr(_SEVERE_SHARE, played.severe_share)
        self._trial.set_user_attr(_STEPS, played.steps)
        self._study.tell(self._trial, played.mean_return)
        self._finished = _finished(self._study)

    @property
    def best_so_far(self) -> str:
        """Return the best trial so far, for people."""
        best = max(self._finished, key=_merit)
        return f"best {best.value:.1f} s{'' if _feasible(best) else ', not feasible'}"

    def found(self) -> Found:
        """Return the best parameters of all trials."""
        best = max(self._finished, key=_merit)
        return Found(
            version=self._rule.version,
            parameters=best.params,
            mean_return=_merit(best)[1],
            severe_share=best.user_attrs[_SEVERE_SHARE],
            feasible=_feasible(best),
            episodes_played=len(self._finished) * len(self._seeds),
            steps_played=sum(trial.user_attrs[_STEPS] for trial in self._finished),
        )


def play_trial(name: str, rule: Rule, task: Task, setting: Parameters, seeds: Sequence[int]) -> Played:
    """Play a trial; note rule and parameters on an exception that it causes."""
    try:
        return play_setting(rule, task, setting, seeds)
    except Exception as error:
        error.add_note(f"while tuning {name} with {setting}")
        raise


def run_all(searches: Sequence[Search], over: Workers | None = None) -> None:
    """Play the searches' remaining trials: one search after the other, or with workers one trial of each search at a time.

    Raises:
        WorkersError: no workers are left.
        Exception: what a trial raised.
    """
    total = sum(search.trials for search in searches)
    done = total - sum(search.left for search in searches)
    with tqdm(total=total, initial=done, desc="tuning", unit="trial", dynamic_ncols=True, disable=None) as bar:

        def note(search: Search, played: Played) -> None:
            search.tell(played)
            bar.set_postfix_str(f"{search.name}: {search.best_so_far}", refresh=False)
            bar.update()

        unfinished = [search for search in searches if search.left]
        for search in unfinished:
            if over is not None:
                over.start(search, play_trial, *search.next())
            while over is None and search.left:
                note(search, play_trial(*search.next()))
        while over is not None and any(search.left for search in unfinished):
            search, played = over.finished()
            note(search, played)
            if search.left:
                over.start(search, play_trial, *search.next())


def middle(values: Range) -> float:
    """Return the middle of a range, geometric for a logarithmic one."""
    return math.sqrt(values.low * values.high) if values.logarithmic else 0.5 * (values.low + values.high)


def _study_name(rule: Rule, task: Task, trials: int, seeds: int) -> str:
    """Return a digest of what the trials depend on, except the rule's name; a journal's trials of other tasks are ignored."""
    return hashlib.sha256(json.dumps([MODEL_VERSION, rule.version, task.digest(), trials, seeds]).encode()).hexdigest()


def _open(path: Path) -> JournalStorage:
    """Open a journal; start a damaged one anew."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cut_off_half_line(path)
    try:
        lines = path.read_bytes().splitlines() if path.exists() else []
        if not all(json.loads(line) for line in lines):
            raise ValueError(f"{path} holds an empty line")
        return _storage(path)
    except (ArithmeticError, AssertionError, AttributeError, LookupError, RecursionError, TypeError, ValueError):
        print(f"{path} is damaged: the search starts again", file=sys.stderr)
        path.write_bytes(b"")  # not removed, as a process may hold a lock on it
        return _storage(path)


def _storage(path: Path) -> JournalStorage:
    return JournalStorage(JournalFileBackend(str(path), JournalFileOpenLock(str(path))))


def _finished(study: optuna.Study) -> list[FrozenTrial]:
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))


def _feasible(trial: FrozenTrial) -> bool:
    return trial.constraints[_OVERLOAD] <= 0.0


def _merit(trial: FrozenTrial) -> tuple[bool, float]:
    """Return a sort key: mean return, feasible trials above the others."""
    value = trial.value
    assert value is not None  # it has finished
    return _feasible(trial), value
