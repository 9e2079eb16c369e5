"""Tune the rules for a scenario, all with the same budget, and write the best parameters beside its file.

    python -m baselines.tune --scenario my_mill.toml --quick
    python -m baselines.tune --scenario my_mill.toml --rules fixed_tuned rescaled_grid_search
    python -m baselines.tune --scenario forging --out my_forging.tuned.json

The parameters of ``my_mill.toml`` go to ``my_mill.tuned.json`` beside it, where all commands find them. Every rule gets the same
number of trials on the same tuning seeds, however many parameters it has. The file states this budget, also in episodes and
steps. An agent's budget is ``steps`` in ``train/hyperparameters/ppo.toml``. With ``--jobs`` or ``--scheduler``, rules are tuned
in parallel, with the same result (docs/scaling.md).

The first trial is the middle of every range; a tree-structured Parzen estimator chooses the others. The best mean return wins
among the feasible trials, or among all if none is feasible. A trial's parameters depend only on its number and the trials before
it. So the same command resumes an interrupted tuning: it searches again, and takes the results of trials that were played from a
log.
"""

import argparse
import json
import math
import shlex
import sys
from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

import optuna
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import TPESampler
from tqdm import tqdm

from baselines import tuned
from baselines.catalogue import RULES, names, playable
from baselines.rule import Parameters, Range, Rule
from turning_env import MODEL_VERSION, Scenario, presets
from turning_env.console import described, exits
from turning_env.files import exclusive_lock, file_lock, replace_file
from turning_env.scoring.play import play
from turning_env.scoring.seeds import tuning_seeds
from turning_env.scoring.statistics import severe_limit, severe_share
from turning_env.scoring.workers import Workers, workers

Budget = dict[str, int]
BUDGET: Budget = {"trials": 64, "seeds": 32}
QUICK: Budget = {"trials": 12, "seeds": 16}

_CANDIDATES = 128
"""Number of candidates from which the estimator picks. With Optuna's 24, it stays farther from the limit of feasibility."""


class Played(NamedTuple):
    """Result of one trial."""

    mean_return: float  # [s]
    severe_share: float  # share of cutting time more than the tolerance over a limit [-]
    severe_limit: float  # its one-sided upper confidence limit [-], which decides on feasibility
    steps: int  # number of steps played


def play_trial(name: str, rule: Rule, scenario: Scenario, setting: Parameters, seeds: Sequence[int]) -> Played:
    """Play a rule with some parameters on seeds; note both on an exception."""
    try:
        episodes = play(lambda num_envs: rule.build(scenario, num_envs, setting), scenario, seeds)
    except Exception as error:
        error.add_note(f"while tuning {name} with {setting}")
        raise
    times = episodes["severe_overload_time"], episodes["engaged_time"]
    return Played(float(episodes["return"].mean()), severe_share(*times), severe_limit(*times), int(episodes["steps"].sum()))


class Search:
    """The search for the best parameters of a rule; any process may play its trials, one after the other.

    Args:
        name: name of the rule.
        rule: rule to tune.
        scenario: scenario to play.
        trials: number of trials.
        seeds: number of tuning seeds that each trial plays.
        log: file with the results of trials, one in a line, which are not played again.
    """

    def __init__(self, name: str, rule: Rule, scenario: Scenario, trials: int, seeds: int, log: Path) -> None:
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self.name, self._rule, self._scenario, self._trials = name, rule, scenario, trials
        self._seeds, self._log, self._known = tuning_seeds(seeds), log, {}
        for line in log.read_text("utf-8", "replace").splitlines() if log.exists() else ():
            with suppress(ValueError, TypeError, RecursionError):  # the process was killed while writing it
                about, values = json.loads(line)
                self._known[about] = Played(*values)
        self._ranges: dict[str, BaseDistribution] = {
            key: FloatDistribution(each.low, each.high, log=each.logarithmic) for key, each in rule.ranges.items()
        }
        self._study = optuna.create_study(direction="maximize")
        self._study.enqueue_trial({key: middle(each) for key, each in rule.ranges.items()})
        self._played: list[tuple[Parameters, Played]] = []
        self._ask()

    def _ask(self) -> None:
        """Go on to the next trial whose result is not known."""
        while self.left:
            self._study.sampler = TPESampler(seed=len(self._played), n_ei_candidates=_CANDIDATES)
            self._trial = self._study.ask(self._ranges)
            about = [MODEL_VERSION, self._rule.version, self._scenario.digest(), len(self._seeds), self._setting]
            self._about = json.dumps(about)
            if self._about not in self._known:
                break
            self._take(self._known[self._about])

    def _take(self, played: Played) -> None:
        self._trial.set_constraint("overload", played.severe_limit - self._scenario.limits.overload_allowance)
        self._study.tell(self._trial, played.mean_return)
        self._played.append((self._trial.params, played))

    @property
    def _setting(self) -> Parameters:
        return self._rule.fixed | self._trial.params

    @property
    def left(self) -> int:
        """Return the number of trials left."""
        return self._trials - len(self._played)

    def next(self) -> tuple[str, Rule, Scenario, Parameters, list[int]]:
        """Return the next trial: the arguments of ``play_trial``."""
        return self.name, self._rule, self._scenario, self._setting, self._seeds

    def tell(self, played: Played) -> None:
        """Take the result of the next trial and log it."""
        with self._log.open("a", encoding="utf-8") as file:
            file.write(f"\n{json.dumps([self._about, played])}\n")
        self._take(played)
        self._ask()

    def found(self) -> dict[str, Any]:
        """Return the rule's entry in a file of tuned parameters: the best trial so far and the budget of all."""

        def feasible(played: Played) -> bool:
            return played.severe_limit <= self._scenario.limits.overload_allowance

        parameters, best = max(self._played, key=lambda trial: (feasible(trial[1]), trial[1].mean_return))
        return {
            "version": self._rule.version,
            "parameters": parameters,
            "mean_return": best.mean_return,
            "severe_share": best.severe_share,
            "feasible": feasible(best),
            "episodes_played": len(self._played) * len(self._seeds),
            "steps_played": sum(played.steps for _, played in self._played),
        }


def run_all(searches: Sequence[Search], over: Workers | None = None, play: Callable[..., Played] = play_trial) -> None:
    """Play the searches' remaining trials: one search after the other, or with workers one trial of each search at a time.

    Raises:
        WorkersError: no workers are left.
        Exception: what a trial raised.
    """
    with tqdm(total=sum(search.left for search in searches), desc="tuning", unit="trial", disable=None) as bar:

        def note(search: Search, played: Played) -> None:
            search.tell(played)
            best = search.found()
            infeasible = "" if best["feasible"] else ", not feasible"
            bar.set_postfix_str(f"{search.name}: best {best['mean_return']:.1f} s{infeasible}", refresh=False)
            bar.update()

        for search in searches:
            if over is not None and search.left:
                over.start(search, play, *search.next())
            while over is None and search.left:
                note(search, play(*search.next()))
        while over is not None and any(search.left for search in searches):
            search, played = over.finished()
            note(search, played)
            if search.left:
                over.start(search, play, *search.next())


def middle(values: Range) -> float:
    """Return the middle of a range, geometric for a logarithmic one."""
    return math.sqrt(values.low * values.high) if values.logarithmic else 0.5 * (values.low + values.high)


def chosen_rules(wanted: Sequence[str] | None, scenario: Scenario, quick: bool = False) -> dict[str, Rule]:
    """Return the named rules, or all that can play the scenario and have parameters to tune; if ``quick``, the best of them.

    Raises:
        KeyError: there is no rule of that name.
        ValueError: a rule cannot play the scenario or has nothing to tune there.
    """
    rules = {name: playable(name, scenario) for name in (names(scenario) if wanted is None else wanted)}
    fixed = [
        name
        for name, rule in rules.items()
        if not rule.ranges or (rule.tuned_on and Scenario.load(rule.tuned_on).digest() != scenario.digest())
    ]
    if wanted is not None and fixed:
        raise ValueError(f"{', '.join(sorted(fixed))} has nothing to tune on scenario {scenario.name!r}")
    return {name: rule for name, rule in rules.items() if name not in fixed and (rule.worth_tuning or wanted or not quick)}


def _target(scenario: Scenario, out: Path | None, shipped: bool) -> Path:
    """Return the file to write; only ``shipped`` may overwrite one that ships.

    Raises:
        ValueError: another file is asked for, or the file's name has another suffix.
    """
    target = out or tuned.path(scenario)
    ships = target.resolve().parent == tuned.FOLDER.resolve()
    if shipped and (out is not None or not ships):
        known = ", ".join(presets())
        raise ValueError(f"--shipped rewrites the parameters of a preset, one of {known}, without --out")
    if ships and not shipped:
        said = f"{target} ships with the project: give the scenario as a TOML file of your own, or another --out FILE.json"
        raise ValueError(f"{said}; a maintainer rewrites it by --shipped")
    if target.suffix != ".json":
        raise ValueError(f"--out {target} must end in .json")
    return target


def _kept(chosen: Collection[str], scenario: Scenario, target: Path, budget: Budget) -> dict[str, Any]:
    """Return the entries of a file of the scenario's tuned parameters for the rules that are not tuned now.

    Raises:
        ValueError: they were tuned with another budget, and a file must not mix budgets; or the file is damaged.
    """
    values = tuned.read(target)
    if values.get("scenario_digest") != scenario.digest():
        return {}
    kept = {name: values["rules"][name] for name in RULES if name in values["rules"] and name not in chosen}
    if kept and values.get("budget") != budget:
        raise ValueError(f"{target} keeps {', '.join(kept)}, tuned with another budget: tune all rules, or give another --out")
    return kept


def log(name: str, target: Path) -> Path:
    """Return the path of the log of a rule's unfinished search, beside the file that will hold its result."""
    return target.with_name(f".unfinished-{target.stem}-{name}.log")


@exits(KeyError, ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m baselines.tune", **described(__doc__))
    parser.add_argument("--scenario", required=True, metavar="PRESET_OR_TOML", help="scenario on which to tune")
    parser.add_argument("--rules", nargs="+", metavar="NAME", help="tune only these rules, and keep the others in the file")
    which = ", ".join(name for name, rule in RULES.items() if rule.worth_tuning)
    quick = " and ".join(f"{number} {what}" for what, number in QUICK.items())
    parser.add_argument("--quick", action="store_true", help=f"tune for about a minute: {quick}, and only {which}")
    parser.add_argument("--trials", type=int, metavar="N", help="parameter sets to try for each rule (default: 64)")
    parser.add_argument("--seeds", type=int, metavar="N", help="tuning seeds on which each trial plays (default: 32)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="JSON file to write (default: TOML.tuned.json beside the TOML)")
    parser.add_argument("--shipped", action="store_true", help="for maintainers: rewrite the parameters that ship for a preset")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="number of processes, one rule each (default: 1)")
    parser.add_argument("--scheduler", metavar="URL", help="play on the workers of this Dask cluster, such as tcp://host:8786")
    parsed = parser.parse_args(arguments)
    budget = {what: getattr(parsed, what) or number for what, number in (QUICK if parsed.quick else BUDGET).items()}
    for what in ("trials", "seeds", "jobs"):
        if getattr(parsed, what) is not None and getattr(parsed, what) < 1:
            raise ValueError(f"{getattr(parsed, what)} {what} asked for, but there must be 1 or more")
    scenario = Scenario.load(parsed.scenario)
    if scenario != scenario.nominal():
        raise ValueError(f"scenario {scenario.name!r} has a model mismatch: tune the rules on its nominal model")
    target = _target(scenario, parsed.out, parsed.shipped)
    chosen = chosen_rules(parsed.rules, scenario, parsed.quick)
    some = parsed.quick or parsed.rules is not None
    _kept(chosen if some else RULES, scenario, target, budget)  # refuse before hours of playing, not after
    logs = {name: log(name, target) for name in chosen}
    with workers(parsed.jobs, parsed.scheduler) as over, ExitStack() as held:
        for path in logs.values():
            held.enter_context(file_lock(path))
        searches = [Search(name, rule, scenario, **budget, log=logs[name]) for name, rule in chosen.items()]
        run_all(searches, over)
        found = {search.name: search.found() for search in searches}
        for name, best in found.items():
            feasible = "feasible" if best["feasible"] else "not feasible"
            result = f"mean return {best['mean_return']:.1f} s over {budget['seeds']} seeds, {feasible}"
            print(f"{name}: {best['parameters']}, {result}")
        words = ["--shipped"] * parsed.shipped + [word for what, number in budget.items() for word in (f"--{what}", str(number))]
        values = {
            "command": shlex.join(["python", "-m", "baselines.tune", "--scenario", parsed.scenario, *words]),
            "scenario_digest": scenario.digest(),
            "budget": budget,
        }
        with exclusive_lock(target.parent, wait=True):  # read again: another process may have tuned another rule
            rules = found | (_kept(found, scenario, target, budget) if some else {})
            values["rules"] = {name: rules[name] for name in RULES if name in rules}
            replace_file(target, lambda path: path.write_text(json.dumps(values, indent=1) + "\n", "utf-8"))
        for path in logs.values():
            path.unlink(missing_ok=True)
    print(target)
    return 0


if __name__ == "__main__":
    from baselines import tune  # under the name that workers import

    sys.exit(tune.main())
