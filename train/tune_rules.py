"""Tune the rules for a scenario, all with the same budget, and write the best parameters to a file.

    python -m train.tune rules --scenario my_mill.toml --quick
    python -m train.tune rules --scenario my_mill.toml --rules fixed_tuned rescaled_grid_search
    python -m train.tune rules --scenario forging --out my_forging.tuned.json

The parameters of ``my_mill.toml`` go to ``my_mill.tuned.json`` beside it, where all commands find
them. Every rule gets the same number of trials on the same tuning seeds, however many parameters it
has. The file states this budget, also in episodes and steps. An agent's budget is
``total_timesteps`` in ``train/ppo.py``. With ``--jobs``, rules are tuned in parallel, with the same
result.

The first trial is the middle of every range; a tree-structured Parzen estimator chooses the others.
The best mean return wins among the feasible trials, or among all if none is feasible. A trial's
parameters depend only on its number and the trials before it. So the same command resumes an
interrupted tuning; it takes the trials that were played from a log.
"""

import argparse
import json
import math
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import TPESampler
from optuna.trial import TrialState
from tqdm import tqdm

from baselines import tuned
from baselines.catalogue import RULES, names, playable
from baselines.rule import Parameters, Rule, TuningRange
from leaderboard.play import Episodes, play
from leaderboard.seeds import tuning_seeds
from leaderboard.statistics import Bootstrap, severe_share
from leaderboard.workers import Workers, spread, workers
from turning_env import MODEL_VERSION, Scenario, presets
from turning_env.console import described, exits, positive
from turning_env.files import file_lock, folder_lock, read_regular, write_file
from turning_env.progress import progress

BUDGET = {"trials": 64, "seeds": 32}
QUICK = {"trials": 12, "seeds": 16}
_CANDIDATES = 128
"""Number of candidates from which the estimator picks.

With Optuna's 24, it stays farther from the limit of feasibility.
"""


class SettingResult(NamedTuple):
    """Result of a setting on the tuning seeds."""

    mean_return: float  # [s]
    severe_share: float  # share of cutting time more than the tolerance over a limit [-]
    severe_limit: float  # its one-sided upper confidence limit [-], which decides on feasibility
    steps: int  # number of steps played
    failed: str = ""  # why there is no result

    @classmethod
    def of(cls, *episodes: Episodes) -> Self:
        """Return the result of all these episodes."""

        def joined(name: str) -> Any:
            return np.concatenate([batch[name] for batch in episodes])

        severe = joined("severe_overload_time")
        engaged = joined("engaged_time")
        limit = Bootstrap(len(severe)).severe_limit(severe[None], engaged[None], "")
        return cls(
            mean_return=float(joined("return").mean()),
            severe_share=severe_share(severe, engaged),
            severe_limit=limit,
            steps=int(joined("steps").sum()),
        )


class Trial(NamedTuple):
    """A setting and its result."""

    setting: dict[str, Any]
    played: SettingResult

    def merit(self, allowance: float) -> tuple[bool, float]:
        """Return whether the trial is feasible, and its mean return [s]: the highest merit wins."""
        return self.played.severe_limit <= allowance, self.played.mean_return


class TrialLog:
    """The trials of a task that ended, in a file with one of them in a line.

    Args:
        path: the file, which may hold other tasks, too.
        task: what determines a trial beside its setting; values that JSON can hold.
    """

    def __init__(self, path: Path, task: list[Any]) -> None:
        self._path = path
        self._task = task

    def read(self) -> list[Trial]:
        """Return the trials; lines that a killed process left incomplete are skipped."""
        if not self._path.exists():
            return []
        trials = []
        content = read_regular(self._path)
        for line in content.decode("utf-8", "replace").splitlines():
            with suppress(ValueError, TypeError, RecursionError):
                task, setting, played = json.loads(line)
                if task == self._task:
                    trials.append(Trial(setting, SettingResult(*played)))
        return trials

    def append(self, trial: Trial) -> None:
        """Append a trial."""
        with self._path.open("a", encoding="utf-8") as file:
            file.write(f"\n{json.dumps([self._task, *trial])}\n")


def trials(
    ranges: Mapping[str, BaseDistribution],
    first: Mapping[str, Any],
    count: int,
    log: TrialLog,
    allowance: float,
    play: Callable[[dict[str, Any]], SettingResult],
    over: Workers | None = None,
    parallel: int = 1,
    **sampler: Any,
) -> Iterator[Trial]:
    """Yield the trials of a search as they end, after those that its log holds.

    Args:
        ranges: ranges of the parameters.
        first: the setting that is played before all others.
        count: number of trials.
        log: the log, to which trials are appended.
        allowance: highest ``severe_limit`` of a feasible setting [-].
        play: plays a setting.
        over: workers that play; None: this process.
        parallel: number of settings that are played at the same time.
        sampler: options of Optuna's ``TPESampler``.
    """
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(direction="maximize")

    def tell(trial: optuna.Trial, played: SettingResult) -> Trial:
        """Tell the study a result."""
        if played.failed:
            study.tell(trial, state=TrialState.PRUNED)
        else:
            trial.set_constraint("overload", played.severe_limit - allowance)
            study.tell(trial, played.mean_return)
        return Trial(trial.params, played)

    known = log.read()[:count]
    for setting, played in known:
        study.enqueue_trial(setting)
        yield tell(study.ask(dict(ranges)), played)
    if not known:
        study.enqueue_trial(dict(first))
    running: list[optuna.Trial] = []
    for ended in range(len(known), count):
        while len(running) < min(parallel, count - ended):
            # A sampler per trial: its random numbers must not depend on interruptions.
            study.sampler = TPESampler(seed=ended + len(running), **sampler)
            trial = study.ask(dict(ranges))
            running.append(trial)
            if over:
                over.start(trial, play, trial.params)
        if over:
            trial, played = over.finished()
        else:
            trial = running[0]
            played = play(trial.params)
        running.remove(trial)
        log.append(Trial(trial.params, played))
        yield tell(trial, played)


def play_trial(
    name: str, rule: Rule, scenario: Scenario, setting: Parameters, seeds: Sequence[int]
) -> SettingResult:
    """Play a rule with some parameters on seeds; note both on an exception."""

    def make(num_envs: int) -> Any:
        return rule.controller(scenario, num_envs, **setting)

    try:
        return SettingResult.of(play(make, scenario, seeds))
    except Exception as error:
        error.add_note(f"while tuning {name} with {setting}")
        raise


def search(
    name: str,
    rule: Rule,
    scenario: Scenario,
    budget: dict[str, int],
    log: Path,
    play: Callable[[str, Rule, Scenario, Parameters, Sequence[int]], SettingResult] = play_trial,
) -> dict[str, Any]:
    """Return a rule's entry in a file of tuned parameters: the best trial and the budget of all."""
    seeds = tuning_seeds(budget["seeds"])
    allowance = scenario.limits.overload_allowance
    ranges = {}
    first = {}
    for key, values in rule.ranges.items():
        ranges[key] = FloatDistribution(values.low, values.high, log=values.logarithmic)
        first[key] = middle(values)
    task = [MODEL_VERSION, rule.version, scenario.digest(), len(seeds), rule.fixed]

    def play_setting(setting: Parameters) -> SettingResult:
        return play(name, rule, scenario, rule.fixed | setting, seeds)

    played = list(
        trials(
            ranges,
            first,
            count=budget["trials"],
            log=TrialLog(log, task),
            allowance=allowance,
            play=play_setting,
            n_ei_candidates=_CANDIDATES,
        )
    )
    best = max(played, key=lambda trial: trial.merit(allowance))
    feasible, mean_return = best.merit(allowance)
    return {
        "version": rule.version,
        "parameters": best.setting,
        "mean_return": mean_return,
        "severe_share": best.played.severe_share,
        "feasible": feasible,
        "episodes_played": len(played) * len(seeds),
        "steps_played": sum(trial.played.steps for trial in played),
    }


def middle(values: TuningRange) -> float:
    """Return the middle of a range, geometric for a logarithmic one."""
    if values.logarithmic:
        return math.sqrt(values.low * values.high)
    return 0.5 * (values.low + values.high)


def chosen_rules(
    wanted: Sequence[str] | None, scenario: Scenario, quick: bool = False
) -> dict[str, Rule]:
    """Return the rules to tune on a scenario.

    Args:
        wanted: names of the rules; None: all that can be tuned.
        scenario: scenario on which they are tuned.
        quick: whether to leave out all but the best of them.

    Raises:
        ValueError: a wanted rule cannot be tuned on the scenario.
    """

    def is_tunable(rule: Rule) -> bool:
        """Return whether a rule has parameters to tune, and is tuned on this scenario."""
        if not rule.ranges:
            return False
        if rule.tuned_on is None:
            return True
        return Scenario.load(rule.tuned_on).digest() == scenario.digest()

    rules = {}
    fixed = []
    for name in names(scenario) if wanted is None else wanted:
        rule = playable(name, scenario)
        if is_tunable(rule):
            rules[name] = rule
        else:
            fixed.append(name)
    if wanted is not None and fixed:
        raise ValueError(
            f"{', '.join(sorted(set(fixed)))} has nothing to tune on scenario {scenario.name!r}"
        )
    if quick and not wanted:
        return {name: rule for name, rule in rules.items() if rule.worth_tuning}
    return rules


def _target(scenario: Scenario, out: Path | None, shipped: bool) -> Path:
    """Return the file to write.

    Raises:
        ValueError: it does not end in .json, or it ships and ``shipped`` is not set.
    """
    target = out or tuned.path(scenario)
    ships = target.resolve().parent == tuned.FOLDER.resolve()
    if shipped and (out is not None or not ships):
        raise ValueError(
            "--shipped rewrites the parameters of a preset, "
            f"one of {', '.join(presets())}, without --out"
        )
    if ships and not shipped:
        raise ValueError(
            f"{target} ships with the project: "
            "give the scenario as a TOML file of your own, or another --out FILE.json; "
            "a maintainer rewrites it by --shipped"
        )
    if target.suffix != ".json":
        raise ValueError(f"--out {target} must end in .json")
    return target


def _kept(
    chosen: Collection[str], scenario: Scenario, target: Path, budget: dict[str, int]
) -> dict[str, Any]:
    """Return a file's entries for the rules that are not tuned now.

    Raises:
        ValueError: they were tuned with another budget.
    """
    values = tuned.read(target)
    if values.get("scenario_digest") != scenario.digest():
        return {}
    kept = {}
    for name in RULES:
        if name in values["rules"] and name not in chosen:
            kept[name] = values["rules"][name]
    if kept and values.get("budget") != budget:
        raise ValueError(
            f"{target} keeps {', '.join(kept)}, tuned with another budget: "
            "tune all rules, or give another --out"
        )
    return kept


def log_of(name: str, target: Path) -> Path:
    """Return the path of the log of a rule's unfinished search, beside the file of its result."""
    return target.with_name(f".unfinished-{target.stem}-{name}.log")


def add_to(commands: Any) -> None:
    """Add the command ``rules`` to the subparsers of a command line."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "rules", help="tune the rules for a scenario", **described(__doc__)
    )
    parser.set_defaults(command=tune_rules)
    worth_tuning = ", ".join(name for name, rule in RULES.items() if rule.worth_tuning)
    quick = " and ".join(f"{number} {unit}" for unit, number in QUICK.items())
    parser.add_argument(
        "--scenario", required=True, metavar="PRESET_OR_TOML", help="scenario on which to tune"
    )
    parser.add_argument(
        "--rules",
        nargs="+",
        metavar="NAME",
        help="tune only these rules, and keep the others in the file",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help=f"tune for about a minute: {quick}, and only {worth_tuning}",
    )
    parser.add_argument(
        "--trials",
        type=positive,
        metavar="N",
        help="parameter sets to try for each rule (default: 64)",
    )
    parser.add_argument(
        "--seeds",
        type=positive,
        metavar="N",
        help="tuning seeds on which each trial plays (default: 32)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="JSON file to write (default: TOML.tuned.json beside the TOML)",
    )
    parser.add_argument(
        "--shipped",
        action="store_true",
        help="for maintainers: rewrite the parameters that ship for a preset",
    )
    parser.add_argument(
        "--jobs",
        type=positive,
        default=1,
        metavar="N",
        help="number of processes, one rule each (default: 1)",
    )


def _budget(parsed: argparse.Namespace) -> dict[str, int]:
    """Return the budget that a command line asks for."""
    budget = dict(QUICK if parsed.quick else BUDGET)
    if parsed.trials is not None:
        budget["trials"] = parsed.trials
    if parsed.seeds is not None:
        budget["seeds"] = parsed.seeds
    return budget


def _command(parsed: argparse.Namespace, budget: dict[str, int]) -> str:
    """Return the command that gives the same result for all rules."""
    words = ["python", "-m", "train.tune", "rules", "--scenario", parsed.scenario]
    if parsed.shipped:
        words.append("--shipped")
    for option, number in budget.items():
        words.append(f"--{option}")
        words.append(str(number))
    return shlex.join(words)


def _tune(
    chosen: Mapping[str, Rule],
    scenario: Scenario,
    budget: dict[str, int],
    logs: Mapping[str, Path],
    jobs: int,
) -> dict[str, Any]:
    """Return the entries of the chosen rules, and print them as they are found."""
    entries = {}
    pieces = []
    for name, rule in chosen.items():
        pieces.append((name, (name, rule, scenario, budget, logs[name])))
    with workers(jobs, None) as over:
        results = spread(over, lambda piece: search(*piece), pieces)
        for name, entry in progress(results, "tuning", total=len(pieces), unit="rule"):
            entries[name] = entry
            result = f"mean return {entry['mean_return']:.1f} s over {budget['seeds']} seeds"
            feasible = "feasible" if entry["feasible"] else "not feasible"
            tqdm.write(f"{name}: {entry['parameters']}, {result}, {feasible}")
    return entries


@exits(KeyError, ValueError, interrupted="interrupted: run the same command again to go on")
def tune_rules(parsed: argparse.Namespace) -> int:
    """Tune the rules as a command line asks; return the exit status."""
    budget = _budget(parsed)
    scenario = Scenario.load(parsed.scenario)
    if scenario != scenario.nominal():
        raise ValueError(
            f"scenario {scenario.name!r} has a model mismatch: tune the rules on its nominal model"
        )
    target = _target(scenario, parsed.out, shipped=parsed.shipped)
    chosen = chosen_rules(parsed.rules, scenario, quick=parsed.quick)
    keeps_others = parsed.quick or parsed.rules is not None
    # Refuse before hours of playing, not after.
    _kept(chosen if keeps_others else RULES, scenario, target, budget)
    logs = {name: log_of(name, target) for name in chosen}
    with ExitStack() as locks:
        for log in logs.values():
            locks.enter_context(file_lock(log))
        entries = _tune(chosen, scenario, budget, logs, jobs=parsed.jobs)
        with folder_lock(target.parent, wait=True):
            # Read the file again: another process may have tuned another rule meanwhile.
            if keeps_others:
                entries |= _kept(entries, scenario, target, budget)
            values = {
                "command": _command(parsed, budget),
                "scenario_digest": scenario.digest(),
                "budget": budget,
                "rules": {name: entries[name] for name in RULES if name in entries},
            }
            text = json.dumps(values, indent=1) + "\n"
            write_file(target, text)
        for log in logs.values():
            log.unlink(missing_ok=True)
    print(target)
    return 0
