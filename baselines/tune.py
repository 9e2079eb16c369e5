"""Tune the rules for a scenario, all with the same budget, and write the best parameters beside its file.

    python -m baselines.tune --scenario my_mill.toml --quick
    python -m baselines.tune --scenario my_mill.toml --rules fixed_tuned rescaled_grid_search
    python -m baselines.tune --scenario forging --out my_forging.tuned.json

The parameters of ``my_mill.toml`` go to ``my_mill.tuned.json`` beside it, where all commands find them. Every rule gets the same
number of trials on the same tuning seeds, however many parameters it has. The file states this budget, also in episodes and
steps. An agent's budget is ``steps`` in ``train/hyperparameters/ppo.toml``. With ``--jobs``, rules are tuned in parallel, with
the same result.

The first trial is the middle of every range; a tree-structured Parzen estimator chooses the others. The best mean return wins
among the feasible trials, or among all if none is feasible. A trial's parameters depend only on its number and the trials before
it. So the same command resumes an interrupted tuning; it takes the trials that were played from a log.
"""

import argparse
import json
import math
import shlex
import sys
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
from baselines.rule import Parameters, Range, Rule
from turning_env import MODEL_VERSION, Scenario, presets
from turning_env.console import described, exits
from turning_env.files import file_lock, folder_lock, replace_file
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.seeds import tuning_seeds
from turning_env.scoring.statistics import Bootstrap, severe_share
from turning_env.scoring.workers import Workers, spread, workers

BUDGET = {"trials": 64, "seeds": 32}
QUICK = {"trials": 12, "seeds": 16}
_CANDIDATES = 128
"""Number of candidates from which the estimator picks. With Optuna's 24, it stays farther from the limit of feasibility."""


class Played(NamedTuple):
    """Result of a setting on the tuning seeds."""

    mean_return: float  # [s]
    severe_share: float  # share of cutting time more than the tolerance over a limit [-]
    severe_limit: float  # its one-sided upper confidence limit [-], which decides on feasibility
    steps: int  # number of steps played
    failed: str = ""  # why there is no result

    @classmethod
    def of(cls, *episodes: Episodes) -> Self:
        """Return the result of all these episodes."""
        names = ("return", "severe_overload_time", "engaged_time", "steps")
        returns, severe, engaged, steps = (
            np.concatenate([each[name] for each in episodes]) for name in names
        )
        limit = Bootstrap(len(severe)).severe_limit(severe[None], engaged[None], "")
        return cls(float(returns.mean()), severe_share(severe, engaged), limit, int(steps.sum()))


class Trial(NamedTuple):
    """A setting and its result."""

    setting: dict[str, Any]
    played: Played

    def merit(self, allowance: float) -> tuple[bool, float]:
        """Return whether the trial is feasible, and its mean return [s]: the highest merit wins."""
        return self.played.severe_limit <= allowance, self.played.mean_return


def trials(
    ranges: Mapping[str, BaseDistribution],
    first: Mapping[str, Any],
    count: int,
    log: Path,
    task: list[Any],
    allowance: float,
    play: Callable[[dict[str, Any]], Played],
    over: Workers | None = None,
    parallel: int = 1,
    **sampler: Any,
) -> Iterator[Trial]:
    """Yield the trials of a search as they end, after those of the same ``task`` that ``log`` holds, one in a line.

    ``play`` plays a setting, ``first`` before all others; ``over`` workers, ``parallel`` settings at the same time. A setting is
    feasible up to a ``severe_limit`` of ``allowance`` [-]. ``sampler`` are options of Optuna's ``TPESampler``.
    """
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study, running = optuna.create_study(direction="maximize"), list[optuna.Trial]()

    def told(trial: optuna.Trial, played: Played) -> Trial:
        if played.failed:
            study.tell(trial, state=TrialState.PRUNED)
        else:
            trial.set_constraint("overload", played.severe_limit - allowance)
            study.tell(trial, played.mean_return)
        return Trial(trial.params, played)

    known = _read(log, task)[:count]
    for setting, played in known:
        study.enqueue_trial(setting)
        yield told(study.ask(dict(ranges)), played)
    if not known:
        study.enqueue_trial(dict(first))
    for ended in range(len(known), count):
        while len(running) < min(parallel, count - ended):
            # A sampler per trial: its random numbers must not depend on interruptions.
            study.sampler = TPESampler(seed=ended + len(running), **sampler)
            running.append(study.ask(dict(ranges)))
            if over:
                over.start(running[-1], play, running[-1].params)
        trial, played = over.finished() if over else (running[0], play(running[0].params))
        running.remove(trial)
        with log.open("a", encoding="utf-8") as file:
            file.write(f"\n{json.dumps([task, trial.params, played])}\n")
        yield told(trial, played)


def _read(log: Path, task: list[Any]) -> list[Trial]:
    """Return the trials of a task that a log holds; lines that a killed process left incomplete are skipped."""
    found = []
    for line in log.read_text("utf-8", "replace").splitlines() if log.exists() else ():
        with suppress(ValueError, TypeError, RecursionError):
            about, setting, played = json.loads(line)
            if about == task:
                found.append(Trial(setting, Played(*played)))
    return found


def play_trial(
    name: str, rule: Rule, scenario: Scenario, setting: Parameters, seeds: Sequence[int]
) -> Played:
    """Play a rule with some parameters on seeds; note both on an exception."""
    try:
        return Played.of(
            play(lambda num_envs: rule.controller(scenario, num_envs, **setting), scenario, seeds)
        )
    except Exception as error:
        error.add_note(f"while tuning {name} with {setting}")
        raise


def search(
    name: str,
    rule: Rule,
    scenario: Scenario,
    budget: dict[str, int],
    log: Path,
    play: Callable[[str, Rule, Scenario, Parameters, Sequence[int]], Played] = play_trial,
) -> dict[str, Any]:
    """Return a rule's entry in a file of tuned parameters: the best trial and the budget of all."""
    seeds, allowance = tuning_seeds(budget["seeds"]), scenario.limits.overload_allowance
    ranges = {
        key: FloatDistribution(each.low, each.high, log=each.logarithmic)
        for key, each in rule.ranges.items()
    }
    first = {key: middle(each) for key, each in rule.ranges.items()}
    task = [MODEL_VERSION, rule.version, scenario.digest(), len(seeds), rule.fixed]

    def played_with(setting: Parameters) -> Played:
        return play(name, rule, scenario, rule.fixed | setting, seeds)

    played = [
        *trials(
            ranges,
            first,
            budget["trials"],
            log,
            task,
            allowance,
            played_with,
            n_ei_candidates=_CANDIDATES,
        )
    ]
    best = max(played, key=lambda trial: trial.merit(allowance))
    return {
        "version": rule.version,
        "parameters": best.setting,
        "mean_return": best.played.mean_return,
        "severe_share": best.played.severe_share,
        "feasible": best.merit(allowance)[0],
        "episodes_played": len(played) * len(seeds),
        "steps_played": sum(trial.played.steps for trial in played),
    }


def middle(values: Range) -> float:
    """Return the middle of a range, geometric for a logarithmic one."""
    return (
        math.sqrt(values.low * values.high)
        if values.logarithmic
        else 0.5 * (values.low + values.high)
    )


def chosen_rules(
    wanted: Sequence[str] | None, scenario: Scenario, quick: bool = False
) -> dict[str, Rule]:
    """Return the named rules, or all to tune on the scenario, or if ``quick`` the best of them; ValueError if one cannot be."""

    def tunes(rule: Rule) -> bool:
        return bool(rule.ranges) and (
            not rule.tuned_on or Scenario.load(rule.tuned_on).digest() == scenario.digest()
        )

    rules = {
        name: playable(name, scenario) for name in (names(scenario) if wanted is None else wanted)
    }
    if wanted is not None and (
        fixed := sorted(name for name, rule in rules.items() if not tunes(rule))
    ):
        raise ValueError(f"{', '.join(fixed)} has nothing to tune on scenario {scenario.name!r}")
    return {
        name: rule
        for name, rule in rules.items()
        if tunes(rule) and (rule.worth_tuning or wanted or not quick)
    }


def _target(scenario: Scenario, out: Path | None, shipped: bool) -> Path:
    """Return the file to write; ValueError unless it ends in .json, and if one that ships is written without ``shipped``."""
    target = out or tuned.path(scenario)
    ships = target.resolve().parent == tuned.FOLDER.resolve()
    if shipped and (out is not None or not ships):
        raise ValueError(
            f"--shipped rewrites the parameters of a preset, one of {', '.join(presets())}, without --out"
        )
    if ships and not shipped:
        said = f"{target} ships with the project: give the scenario as a TOML file of your own, or another --out FILE.json"
        raise ValueError(f"{said}; a maintainer rewrites it by --shipped")
    if target.suffix != ".json":
        raise ValueError(f"--out {target} must end in .json")
    return target


def _kept(
    chosen: Collection[str], scenario: Scenario, target: Path, budget: dict[str, int]
) -> dict[str, Any]:
    """Return a file's entries for the rules that are not tuned now; ValueError if they were tuned with another budget."""
    values = tuned.read(target)
    if values.get("scenario_digest") != scenario.digest():
        return {}
    kept = {
        name: values["rules"][name]
        for name in RULES
        if name in values["rules"] and name not in chosen
    }
    if kept and values.get("budget") != budget:
        raise ValueError(
            f"{target} keeps {', '.join(kept)}, tuned with another budget: tune all rules, or give another --out"
        )
    return kept


def log_of(name: str, target: Path) -> Path:
    """Return the path of the log of a rule's unfinished search, beside the file that will hold its result."""
    return target.with_name(f".unfinished-{target.stem}-{name}.log")


@exits(KeyError, ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m baselines.tune", **described(__doc__))
    parser.add_argument(
        "--scenario", required=True, metavar="PRESET_OR_TOML", help="scenario on which to tune"
    )
    parser.add_argument(
        "--rules",
        nargs="+",
        metavar="NAME",
        help="tune only these rules, and keep the others in the file",
    )
    which = ", ".join(name for name, rule in RULES.items() if rule.worth_tuning)
    quick = " and ".join(f"{number} {what}" for what, number in QUICK.items())
    parser.add_argument(
        "--quick", action="store_true", help=f"tune for about a minute: {quick}, and only {which}"
    )
    parser.add_argument(
        "--trials", type=int, metavar="N", help="parameter sets to try for each rule (default: 64)"
    )
    parser.add_argument(
        "--seeds",
        type=int,
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
        type=int,
        default=1,
        metavar="N",
        help="number of processes, one rule each (default: 1)",
    )
    parsed = parser.parse_args(arguments)
    budget = {
        what: getattr(parsed, what) or number
        for what, number in (QUICK if parsed.quick else BUDGET).items()
    }
    for what in ("trials", "seeds", "jobs"):
        if getattr(parsed, what) is not None and getattr(parsed, what) < 1:
            raise ValueError(
                f"{getattr(parsed, what)} {what} asked for, but there must be 1 or more"
            )
    scenario = Scenario.load(parsed.scenario)
    if scenario != scenario.nominal():
        raise ValueError(
            f"scenario {scenario.name!r} has a model mismatch: tune the rules on its nominal model"
        )
    target = _target(scenario, parsed.out, parsed.shipped)
    chosen = chosen_rules(parsed.rules, scenario, parsed.quick)
    some = parsed.quick or parsed.rules is not None
    _kept(
        chosen if some else RULES, scenario, target, budget
    )  # refuse before hours of playing, not after
    command = [
        "python",
        "-m",
        "baselines.tune",
        "--scenario",
        parsed.scenario,
        *["--shipped"] * parsed.shipped,
    ]
    command += [word for what, number in budget.items() for word in (f"--{what}", str(number))]
    values = {
        "command": shlex.join(command),
        "scenario_digest": scenario.digest(),
        "budget": budget,
    }
    logs = {name: log_of(name, target) for name in chosen}
    with workers(parsed.jobs, None) as over, ExitStack() as held:
        for path in logs.values():
            held.enter_context(file_lock(path))
        found = {}
        pieces = [
            (name, (name, rule, scenario, budget, logs[name])) for name, rule in chosen.items()
        ]
        work = spread(over, lambda piece: search(*piece), pieces)
        for name, best in tqdm(work, "tuning", len(pieces), unit="rule", disable=None):
            found[name] = best
            result = f"mean return {best['mean_return']:.1f} s over {budget['seeds']} seeds"
            tqdm.write(
                f"{name}: {best['parameters']}, {result}, {'' if best['feasible'] else 'not '}feasible"
            )
        with folder_lock(
            target.parent, wait=True
        ):  # read again: another process may have tuned another rule
            rules = found | (_kept(found, scenario, target, budget) if some else {})
            values["rules"] = {name: rules[name] for name in RULES if name in rules}
            replace_file(
                target, lambda path: path.write_text(json.dumps(values, indent=1) + "\n", "utf-8")
            )
        for path in logs.values():
            path.unlink(missing_ok=True)
    print(target)
    return 0


if __name__ == "__main__":
    from baselines import tune  # under the name that workers import

    sys.exit(tune.main())
