"""Tune the rules for a scenario, all with the same budget, and write the best parameters beside its file.

    python -m baselines.tune --scenario my_mill.toml --quick
    python -m baselines.tune --scenario my_mill.toml --rules fixed_tuned rescaled_grid_search
    python -m baselines.tune --scenario forging --out my_forging.tuned.json
    python -m baselines.tune --scenario shop --seeds 96 --shipped

The parameters of ``my_mill.toml`` go to ``my_mill.tuned.json`` beside it, where all commands find them. Every rule gets the same
number of trials on the same tuning seeds, however many parameters it has. The file states this budget, also in episodes and
steps. An agent's budget is ``steps`` in ``train/hyperparameters/ppo.toml``. The same command resumes an interrupted tuning. With
``--jobs`` or ``--scheduler``, rules are tuned in parallel, with the same result (docs/scaling.md).
"""

import argparse
import json
import shlex
import sys
from collections.abc import Collection, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

from baselines import tuned
from baselines.catalogue import RULES, names, playable
from baselines.rule import Rule
from baselines.tune import study
from baselines.tuned import Task
from turning_env import Scenario, presets
from turning_env.console import described, exits
from turning_env.files import exclusive_lock, file_lock, replace_file
from turning_env.scenario.family import families
from turning_env.scoring.seeds import tuning_seeds
from turning_env.scoring.workers import workers

Budget = dict[str, int]
BUDGET: Budget = {"trials": 64, "seeds": 32}
QUICK: Budget = {"trials": 12, "seeds": 16}


def chosen_rules(wanted: Sequence[str] | None, task: Task, quick: bool = False) -> dict[str, Rule]:
    """Return the named rules, or all that can play the task and have parameters to tune; if ``quick``, the best of them.

    Raises:
        KeyError: there is no rule of that name.
        ValueError: a rule cannot play the task or has nothing to tune there.
    """
    scenario = tuned.first_scenario(task)
    rules = {name: playable(name, scenario) for name in (names(scenario) if wanted is None else wanted)}
    digest = task.digest()

    def tunable(rule: Rule) -> bool:
        if rule.tuned_on is None:
            return isinstance(task, Scenario)
        return tuned.load(rule.tuned_on).digest() == digest

    chosen = {name: rule for name, rule in rules.items() if rule.ranges and tunable(rule)}
    if wanted is not None and (fixed := rules.keys() - chosen.keys()):
        raise ValueError(f"{', '.join(sorted(fixed))} has nothing to tune on scenario {task.name!r}")
    if quick and wanted is None:
        return {name: rule for name, rule in chosen.items() if rule.worth_tuning}
    return chosen


def target_of(task: Task, out: Path | None, shipped: bool) -> Path:
    """Return the file to write.

    Raises:
        ValueError: the file ships and ``shipped`` is false; ``shipped`` is given for a scenario that does not ship; or the file's
            name has another suffix.
    """
    if shipped and (tuned.own_file(task) is not None or out is not None):
        known = ", ".join((*presets(), *families()))
        raise ValueError(f"--shipped rewrites the parameters of a preset, one of {known}, without --out")
    target = out or tuned.path(task)
    if not shipped and target.resolve().parent == tuned.FOLDER.resolve():
        said = f"{target} ships with the project: give the scenario as a TOML file of your own, or another --out FILE.json"
        raise ValueError(f"{said}; a maintainer rewrites it by --shipped")
    if target.suffix != ".json":
        raise ValueError(f"--out {target} must end in .json")
    return target


def kept_rules(chosen: Collection[str], task: Task, target: Path, budget: Budget) -> dict[str, Any]:
    """Return the entries of a file of the task's tuned parameters for the rules that are not tuned now.

    Raises:
        ValueError: they were tuned with another budget, and a file must not mix budgets; or the file is damaged.
    """
    values = tuned.read(target)
    if values.get("scenario_digest") != task.digest():
        return {}
    kept = {name: values["rules"][name] for name in RULES if name in values["rules"] and name not in chosen}
    if kept and values.get("budget") != budget:
        raise ValueError(f"{target} keeps {', '.join(kept)}, tuned with another budget: tune all rules, or give another --out")
    return kept


def journal(name: str, target: Path) -> Path:
    """Return the path of the journal of a rule's unfinished search, beside the file that will hold its result."""
    return target.with_name(f".unfinished-{target.stem}-{name}.log")


@exits(KeyError, ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m baselines.tune", **described(__doc__))
    parser.add_argument("--scenario", required=True, metavar="PRESET_OR_TOML", help="scenario or family on which to tune")
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
    asked = {what: getattr(parsed, what) for what in BUDGET if getattr(parsed, what) is not None}
    budget = (QUICK if parsed.quick else BUDGET) | asked
    for what, number in (("trials", budget["trials"]), ("jobs", parsed.jobs)):
        if number < 1:
            raise ValueError(f"{number} {what} asked for, but there must be 1 or more")
    tuning_seeds(budget["seeds"])
    task = tuned.load(parsed.scenario)
    if isinstance(task, Scenario) and task != task.nominal():
        raise ValueError(f"scenario {task.name!r} has a model mismatch: tune the rules on its nominal model")
    target = target_of(task, parsed.out, parsed.shipped)
    chosen = chosen_rules(parsed.rules, task, parsed.quick)
    some = parsed.quick or parsed.rules is not None
    kept_rules(chosen if some else RULES, task, target, budget)  # refuse before hours of playing, not after
    with workers(parsed.jobs, parsed.scheduler) as over, ExitStack() as held:
        for name in chosen:
            held.enter_context(file_lock(journal(name, target)))
            # Optuna's own lock, left by a process that was killed while writing.
            journal(name, target).with_suffix(".log.lock").unlink(missing_ok=True)
        searches = [study.Search(name, rule, task, **budget, journal=journal(name, target)) for name, rule in chosen.items()]
        study.run_all(searches, over)
        found = {search.name: asdict(search.found()) for search in searches}
        for name, best in found.items():
            feasible = "feasible" if best["feasible"] else "not feasible"
            result = f"mean return {best['mean_return']:.1f} s over {budget['seeds']} seeds, {feasible}"
            print(f"{name}: {best['parameters']}, {result}")
        words = ["--shipped"] * parsed.shipped + [word for what, number in budget.items() for word in (f"--{what}", str(number))]
        values = {
            "command": shlex.join(["python", "-m", "baselines.tune", "--scenario", parsed.scenario, *words]),
            "scenario_digest": task.digest(),
            "budget": budget,
        }
        with exclusive_lock(target.parent, wait=True):  # read again: another process may have tuned another rule
            rules = found | (kept_rules(found, task, target, budget) if some else {})
            values["rules"] = {name: rules[name] for name in RULES if name in rules}
            replace_file(target, lambda path: path.write_text(json.dumps(values, indent=1) + "\n", "utf-8"))
        for name in chosen:
            journal(name, target).unlink(missing_ok=True)
    print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
