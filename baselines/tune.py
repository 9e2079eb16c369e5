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
from turning_env.scoring.workers import spread, workers

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


def search(
    name: str,
    rule: Rule,
    scenario: Scenario,
    budget: Budget,
    log: Path,
    play: Callable[[str, Rule, Scenario, Parameters, Sequence[int]], Played] = play_trial,
) -> dict[str, Any]:
    """Return a rule's entry in a file of tuned parameters: the best trial and the budget of all.

    ``log`` keeps the results of trials, one in a line; those that it holds are not played again.
    """
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    known, seeds = _read(log), tuning_seeds(budget["seeds"])
    ranges: dict[str, BaseDistribution] = {
        key: FloatDistribution(each.low, each.high, log=each.logarithmic) for key, each in rule.ranges.items()
    }
    study = optuna.create_study(direction="maximize")
    played: list[tuple[Parameters, Played]] = []
    study.enqueue_trial({key: middle(each) for key, each in rule.ranges.items()})
    for number in range(budget["trials"]):
        study.sampler = TPESampler(seed=number, n_ei_candidates=_CANDIDATES)
        trial = study.ask(ranges)
        setting = rule.fixed | trial.params
        about = json.dumps([MODEL_VERSION, rule.version, scenario.digest(), len(seeds), setting])
        if about not in known:
            known[about] = play(name, rule, scenario, setting, seeds)
            with log.open("a", encoding="utf-8") as file:
                file.write(f"\n{json.dumps([about, known[about]])}\n")
        played.append((trial.params, known[about]))
        trial.set_constraint("overload", known[about].severe_limit - scenario.limits.overload_allowance)
        study.tell(trial, known[about].mean_return)

    def feasible(result: Played) -> bool:
        return result.severe_limit <= scenario.limits.overload_allowance

    parameters, best = max(played, key=lambda each: (feasible(each[1]), each[1].mean_return))
    return {
        "version": rule.version,
        "parameters": parameters,
        "mean_return": best.mean_return,
        "severe_share": best.severe_share,
        "feasible": feasible(best),
        "episodes_played": len(played) * len(seeds),
        "steps_played": sum(result.steps for _, result in played),
    }


def _read(log: Path) -> dict[str, Played]:
    """Return the results that a log holds, by what they depend on; lines that a killed process left incomplete are skipped."""
    found = {}
    for line in log.read_text("utf-8", "replace").splitlines() if log.exists() else ():
        with suppress(ValueError, TypeError, RecursionError):
            about, values = json.loads(line)
            found[about] = Played(*values)
    return found


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


def log_of(name: str, target: Path) -> Path:
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
    command = ["python", "-m", "baselines.tune", "--scenario", parsed.scenario, *["--shipped"] * parsed.shipped]
    command += [word for what, number in budget.items() for word in (f"--{what}", str(number))]
    values = {"command": shlex.join(command), "scenario_digest": scenario.digest(), "budget": budget}
    logs = {name: log_of(name, target) for name in chosen}
    with workers(parsed.jobs, None) as over, ExitStack() as held:
        for path in logs.values():
            held.enter_context(file_lock(path))
        found = {}
        pieces = [(name, (name, rule, scenario, budget, logs[name])) for name, rule in chosen.items()]
        for name, best in tqdm(
            spread(over, lambda piece: search(*piece), pieces), "tuning", len(pieces), unit="rule", disable=None
        ):
            found[name] = best
            feasible = "feasible" if best["feasible"] else "not feasible"
            result = f"mean return {best['mean_return']:.1f} s over {budget['seeds']} seeds, {feasible}"
            tqdm.write(f"{name}: {best['parameters']}, {result}")
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
