"""Searches the parameters of one rule with Optuna, and keeps on disk what it has found until the search is used.

The first trial is the middle of every range; a tree-structured Parzen estimator chooses the others. All play the same draws. The
best mean return wins among the admissible settings; where none is admissible, among all.

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
from baselines.code import code_digest
from baselines.overload import severe_limit, severe_share
from baselines.play import play
from baselines.rule import Parameters, Range, Rule
from turning_env import Scenario
from turning_env.draws import tuning_draws

_CANDIDATES = 128
"""Settings from which the estimator picks a trial's. With Optuna's 24 it comes less near to the edge of the admissible."""

_OVERLOAD, _SEVERE_SHARE, _INTERVALS = "overload", "severe_share", "intervals"  # names in the journal


@dataclass(frozen=True)
class Played:
    """What a setting did on the draws."""

    mean_return: float
    """[s]"""
    severe_share: float
    """Share of cutting time more than the tolerance over a limit."""
    severe_limit: float
    """Its one-sided upper confidence limit, which decides whether the setting is admissible."""
    intervals: int
    """Control intervals played."""


@dataclass(frozen=True)
class Found:
    """The best setting, what it did on the draws, and what all trials together played."""

    parameters: Parameters
    mean_return: float
    severe_share: float
    feasible: bool
    """Whether the setting is admissible."""
    episodes_played: int
    intervals_played: int


def play_setting(rule: Rule, scenario: Scenario, setting: Parameters, seeds: Sequence[int]) -> Played:
    """Play a rule with a setting on given draws."""
    episodes = play(lambda lanes: rule.build(scenario, lanes, setting), scenario, seeds)
    severe, engaged = episodes["severe_overload_time"], episodes["engaged_time"]
    return Played(
        mean_return=float(episodes["return"].mean()),
        severe_share=severe_share(severe, engaged),
        severe_limit=severe_limit(severe, engaged),
        intervals=int(episodes["intervals"].sum()),
    )


def search(name: str, rule: Rule, scenario: Scenario, trials: int, draws: int) -> Found:
    """Find the best setting of a rule, in so many trials on so many draws each; goes on with a search that was interrupted.

    An exception that a setting causes is passed on with a note that names rule and setting.
    """
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    seeds = tuning_draws(draws)
    ranges: dict[str, BaseDistribution] = {
        key: FloatDistribution(value.low, value.high, log=value.logarithmic) for key, value in rule.ranges.items()
    }
    study = optuna.create_study(
        storage=_open(journal(name, scenario)),
        study_name=_task(scenario, trials, draws),
        direction="maximize",
        load_if_exists=True,
    )
    for unfinished in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        study.tell(unfinished.number, state=TrialState.FAIL)  # interrupted; the sampler must not heed it
    if not study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.WAITING)):
        study.enqueue_trial({key: middle(value) for key, value in rule.ranges.items()})
    finished = _finished(study)
    with tqdm(total=trials, initial=len(finished), desc=f"tuning {name}", unit="trial", dynamic_ncols=True, disable=None) as bar:
        while len(finished) < trials:
            # A sampler per trial, as its random numbers must not depend on how often the search was interrupted.
            study.sampler = TPESampler(seed=len(finished), n_ei_candidates=_CANDIDATES)
            trial = study.ask(ranges)
            setting = rule.fixed | trial.params
            try:
                played = play_setting(rule, scenario, setting, seeds)
            except Exception as error:
                error.add_note(f"while tuning {name} with {setting}")
                raise
            trial.set_constraint(_OVERLOAD, played.severe_limit - scenario.limits.overload_allowance)
            trial.set_user_attr(_SEVERE_SHARE, played.severe_share)
            trial.set_user_attr(_INTERVALS, played.intervals)
            study.tell(trial, played.mean_return)
            finished = _finished(study)
            best = max(finished, key=_merit)
            bar.set_postfix_str(f"best {best.value:.1f} s{'' if _feasible(best) else ', not admissible'}", refresh=False)
            bar.update()
    best = max(finished, key=_merit)
    return Found(
        parameters=best.params,
        mean_return=_merit(best)[1],
        severe_share=best.user_attrs[_SEVERE_SHARE],
        feasible=_feasible(best),
        episodes_played=trials * draws,
        intervals_played=sum(trial.user_attrs[_INTERVALS] for trial in finished),
    )


def journal(name: str, scenario: Scenario) -> Path:
    """The file in which the search for a rule's parameters is kept until it is used."""
    return tuned.FOLDER / f".unfinished-{scenario.name}-{name}.log"


def middle(values: Range) -> float:
    """The middle of a range: of its logarithms if it is searched on their scale."""
    return math.sqrt(values.low * values.high) if values.logarithmic else 0.5 * (values.low + values.high)


def _task(scenario: Scenario, trials: int, draws: int) -> str:
    """What the trials depend on beside the rule. A journal's trials of another task are let be."""
    return hashlib.sha256(json.dumps([scenario.digest(), code_digest(), trials, draws]).encode()).hexdigest()


def _open(path: Path) -> JournalStorage:
    """What a file keeps; one that is damaged is started anew."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        # Optuna passes over a last line that is damaged, and is then at odds with what it writes after it.
        lines = path.read_bytes().splitlines(keepends=True) if path.exists() else []
        if not all(line.endswith(b"\n") and json.loads(line) for line in lines):
            raise ValueError(f"{path} ends within a line")
        return _storage(path)
    except (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError):
        print(f"{path} is damaged, so the search begins anew", file=sys.stderr)
        path.unlink()
        return _storage(path)


def _storage(path: Path) -> JournalStorage:
    return JournalStorage(JournalFileBackend(str(path), JournalFileOpenLock(str(path))))


def _finished(study: optuna.Study) -> list[FrozenTrial]:
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))


def _feasible(trial: FrozenTrial) -> bool:
    return trial.constraints[_OVERLOAD] <= 0.0


def _merit(trial: FrozenTrial) -> tuple[bool, float]:
    """Sorts trials by mean return, admissible ones above the others."""
    value = trial.value
    assert value is not None  # it has finished
    return _feasible(trial), value
