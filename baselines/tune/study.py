"""Searches the parameters of rules with Optuna, and keeps on disk what it has found until the search is used.

The first trial is the middle of every range; a tree-structured Parzen estimator chooses the others. All play the same draws. The
best mean return wins among the feasible settings; where none is feasible, among all.

What a trial tries follows from its number and the trials finished before it, and from nothing else. So the same search finds the
same setting, interrupted or not.
"""

import hashlib
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import TPESampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import FrozenTrial, TrialState
from tqdm import tqdm

from baselines import tuned
from baselines.rule import Parameters, Range, Rule
from baselines.tune.journal import cut_off_half_line
from turning_env import MODEL_VERSION, Scenario
from turning_env.score.overload import severe_limit, severe_share
from turning_env.score.play import play
from turning_env.score.seeds import tuning_seeds
from turning_env.score.workers import Workers

_CANDIDATES = 128
"""Settings from which the estimator picks a trial's. With Optuna's 24 it comes less near to the edge of the feasible."""

_OVERLOAD, _SEVERE_SHARE, _INTERVALS = "overload", "severe_share", "steps"  # names in the journal


@dataclass(frozen=True)
class Played:
    """What a setting did on the draws."""

    mean_return: float
    """[s]"""
    severe_share: float
    """Share of cutting time more than the tolerance over a limit."""
    severe_limit: float
    """Its one-sided upper confidence limit, which decides whether the setting is feasible."""
    steps: int
    """Control steps played."""


@dataclass(frozen=True)
class Found:
    """The best setting, what it did on the draws, and what all trials together played."""

    parameters: Parameters
    mean_return: float
    severe_share: float
    feasible: bool
    """Whether the setting is feasible."""
    episodes_played: int
    steps_played: int


def play_setting(rule: Rule, scenario: Scenario, setting: Parameters, seeds: Sequence[int]) -> Played:
    """Play a rule with a setting on given draws."""
    episodes = play(lambda num_envs: rule.build(scenario, num_envs, setting), scenario, seeds)
    severe, engaged = episodes["severe_overload_time"], episodes["engaged_time"]
    return Played(
        mean_return=float(episodes["return"].mean()),
        severe_share=severe_share(severe, engaged),
        severe_limit=severe_limit(severe, engaged),
        steps=int(episodes["steps"].sum()),
    )


class Search:
    """The search for the best setting of a rule, in so many trials on so many draws each.

    Goes on with one that was interrupted. Settings are asked for and told of one after the other; whoever plays them need not be
    this process.

    Args:
        name: of the rule, under which its trials are kept.
        rule: what is tuned.
        scenario: what is played.
        trials: how many settings are tried in all.
        draws: how many tuning draws each of them plays.
    """

    def __init__(self, name: str, rule: Rule, scenario: Scenario, trials: int, draws: int) -> None:
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self.name, self._rule, self._scenario, self._trials = name, rule, scenario, trials
        self._seeds = tuning_seeds(draws)
        self._ranges: dict[str, BaseDistribution] = {
            key: FloatDistribution(value.low, value.high, log=value.logarithmic) for key, value in rule.ranges.items()
        }
        self._study = optuna.create_study(
            storage=_open(journal(name, scenario)),
            study_name=_task(rule, scenario, trials, draws),
            direction="maximize",
            load_if_exists=True,
        )
        for unfinished in self._study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            self._study.tell(unfinished.number, state=TrialState.FAIL)  # interrupted; the sampler must not heed it
        if not self._study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.WAITING)):
            self._study.enqueue_trial({key: middle(value) for key, value in rule.ranges.items()})
        self._finished = _finished(self._study)
        self._trial: optuna.Trial | None = None

    @property
    def finished(self) -> int:
        """How many trials have been played."""
        return len(self._finished)

    @property
    def left(self) -> int:
        """How many trials are left."""
        return self._trials - len(self._finished)

    def next(self) -> tuple[str, Rule, Scenario, Parameters, list[int]]:
        """What is to be played next: what ``play_trial`` takes."""
        # A sampler per trial, as its random numbers must not depend on how often the search was interrupted.
        self._study.sampler = TPESampler(seed=len(self._finished), n_ei_candidates=_CANDIDATES)
        self._trial = self._study.ask(self._ranges)
        return self.name, self._rule, self._scenario, self._rule.fixed | self._trial.params, self._seeds

    def tell(self, played: Played) -> None:
        """What was asked for last has been played."""
        assert self._trial is not None
        self._trial.set_constraint(_OVERLOAD, played.severe_limit - self._scenario.limits.overload_allowance)
        self._trial.set_user_attr(_SEVERE_SHARE, played.severe_share)
        self._trial.set_user_attr(_INTERVALS, played.steps)
        self._study.tell(self._trial, played.mean_return)
        self._finished = _finished(self._study)

    @property
    def best_so_far(self) -> str:
        """The best of what has been played, for people."""
        best = max(self._finished, key=_merit)
        return f"best {best.value:.1f} s{'' if _feasible(best) else ', not feasible'}"

    def found(self) -> Found:
        """What came of all trials."""
        best = max(self._finished, key=_merit)
        return Found(
            parameters=best.params,
            mean_return=_merit(best)[1],
            severe_share=best.user_attrs[_SEVERE_SHARE],
            feasible=_feasible(best),
            episodes_played=len(self._finished) * len(self._seeds),
            steps_played=sum(trial.user_attrs[_INTERVALS] for trial in self._finished),
        )


def play_trial(name: str, rule: Rule, scenario: Scenario, setting: Parameters, seeds: Sequence[int]) -> Played:
    """Play a setting; an exception that it causes is passed on with a note that names rule and setting."""
    try:
        return play_setting(rule, scenario, setting, seeds)
    except Exception as error:
        error.add_note(f"while tuning {name} with {setting}")
        raise


def run_all(searches: Sequence[Search], over: Workers | None = None) -> None:
    """Play all trials that the searches have left, one search after the other, or side by side, a trial of each, over workers.

    Raises:
        WorkersError: there are no workers any more.
        Exception: what a setting caused.
    """
    finished, left = sum(search.finished for search in searches), sum(search.left for search in searches)
    with tqdm(total=finished + left, initial=finished, desc="tuning", unit="trial", dynamic_ncols=True, disable=None) as bar:

        def note(search: Search, played: Played) -> None:
            search.tell(played)
            bar.set_postfix_str(f"{search.name}: {search.best_so_far}", refresh=False)
            bar.update()

        unfinished = [search for search in searches if search.left]
        if over is None:
            for search in unfinished:
                while search.left:
                    note(search, play_trial(*search.next()))
            return
        for search in unfinished:
            over.start(search, play_trial, *search.next())
        while any(search.left for search in unfinished):
            search, played = over.finished()
            note(search, played)
            if search.left:
                over.start(search, play_trial, *search.next())


def journal(name: str, scenario: Scenario) -> Path:
    """The file in which the search for a rule's parameters is kept until it is used."""
    return tuned.FOLDER / f".unfinished-{scenario.name}-{name}.log"


def middle(values: Range) -> float:
    """The middle of a range: of its logarithms if it is searched on their scale."""
    return math.sqrt(values.low * values.high) if values.logarithmic else 0.5 * (values.low + values.high)


def _task(rule: Rule, scenario: Scenario, trials: int, draws: int) -> str:
    """Return what the trials depend on beside the rule's name. A journal's trials of another task are let be."""
    return hashlib.sha256(json.dumps([MODEL_VERSION, rule.version, scenario.digest(), trials, draws]).encode()).hexdigest()


def _open(path: Path) -> JournalStorage:
    """What a file keeps; one that is damaged is started anew."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cut_off_half_line(path)
    try:
        lines = path.read_bytes().splitlines() if path.exists() else []
        if not all(json.loads(line) for line in lines):
            raise ValueError(f"{path} holds a line that says nothing")
        return _storage(path)
    except (ArithmeticError, AssertionError, AttributeError, LookupError, RecursionError, TypeError, ValueError):
        print(f"{path} is damaged, so the search begins anew", file=sys.stderr)
        path.write_bytes(b"")  # and not removed: who works with it holds a lock on it
        return _storage(path)


def _storage(path: Path) -> JournalStorage:
    return JournalStorage(JournalFileBackend(str(path), JournalFileOpenLock(str(path))))


def _finished(study: optuna.Study) -> list[FrozenTrial]:
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))


def _feasible(trial: FrozenTrial) -> bool:
    return trial.constraints[_OVERLOAD] <= 0.0


def _merit(trial: FrozenTrial) -> tuple[bool, float]:
    """Sorts trials by mean return, feasible ones above the others."""
    value = trial.value
    assert value is not None  # it has finished
    return _feasible(trial), value
