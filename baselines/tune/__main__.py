"""Tune the rules on tuning seeds, all with the same budget, and write the best parameters to ``baselines/tuned/``.

    python -m baselines.tune
    python -m baselines.tune --scenario forging --rules fixed_tuned rescaled_grid_search

Every rule gets the same number of trials on the same seeds, however many parameters it has. The result states the budget in
episodes and steps; compare ``steps`` in ``train/hyperparameters/ppo.toml`` for an agent's. After an interruption, the same
command continues. With ``--jobs`` or ``--scheduler`` rules are tuned in parallel, with the same result (docs/scaling.md).
"""

import argparse
import json
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
from turning_env import Scenario
from turning_env.console import described, exits
from turning_env.files import exclusive_lock, file_lock, replace_file
from turning_env.score.seeds import tuning_seeds
from turning_env.score.workers import workers

Budget = dict[str, int]


def chosen_rules(wanted: Sequence[str] | None, scenario: Scenario) -> dict[str, Rule]:
    """Return the named rules, or all that can play the scenario and have parameters to tune.

    Raises:
        KeyError: there is no rule of that name.
        ValueError: a rule cannot play the scenario or has nothing to tune there.
    """
    rules = {name: playable(name, scenario) for name in (names(scenario) if wanted is None else wanted)}
    digest = scenario.digest()
    chosen = {
        name: rule
        for name, rule in rules.items()
        if rule.ranges and (rule.tuned_on is None or Scenario.load(rule.tuned_on).digest() == digest)
    }
    if wanted is not None and (fixed := rules.keys() - chosen.keys()):
        raise ValueError(f"{', '.join(sorted(fixed))} has nothing to tune on scenario {scenario.name!r}")
    return chosen


def kept_rules(chosen: Collection[str], scenario: Scenario, budget: Budget) -> dict[str, Any]:
    """Return the entries of the scenario's file for the rules that are not tuned now.

    Raises:
        ValueError: they were tuned with another budget, so that the file would mix budgets.
    """
    values = tuned.contents(scenario)
    if values.get("scenario_digest") != scenario.digest():
        return {}
    kept = {name: values["rules"][name] for name in RULES if name in values["rules"] and name not in chosen}
    if kept and values.get("budget") != budget:
        raise ValueError(f"{tuned.path(scenario)} keeps {', '.join(kept)}, tuned with another budget: tune all rules")
    return kept


@exits(KeyError, ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m baselines.tune", **described(__doc__))
    parser.add_argument("--scenario", default="rough_turning", metavar="PRESET_OR_TOML", help="default: rough_turning")
    parser.add_argument("--rules", nargs="+", metavar="NAME", help="tune only these, and keep the others in the scenario's file")
    parser.add_argument("--trials", type=int, default=64, help="parameter sets to try for each rule (default: 64)")
    parser.add_argument("--seeds", type=int, default=32, help="tuning seeds on which each trial plays (default: 32)")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes, one rule each (default: 1)")
    parser.add_argument("--scheduler", metavar="URL", help="play on the workers of this Dask cluster, such as tcp://host:8786")
    parsed = parser.parse_args(arguments)
    budget = {"trials": parsed.trials, "seeds": parsed.seeds}
    for what in ("trials", "jobs"):
        if (asked := getattr(parsed, what)) < 1:
            raise ValueError(f"{asked} {what} asked for, but there must be 1 or more")
    tuning_seeds(parsed.seeds)
    scenario = Scenario.load(parsed.scenario)
    if scenario != scenario.nominal():
        raise ValueError(f"scenario {scenario.name!r} has a model mismatch: tune the rules on its nominal model")
    chosen = chosen_rules(parsed.rules, scenario)
    if parsed.rules is not None:
        kept_rules(chosen, scenario, budget)  # refuse before hours of playing, not after
    with workers(parsed.jobs, parsed.scheduler) as over, ExitStack() as held:
        for name in chosen:
            held.enter_context(file_lock(study.journal(name, scenario)))
            # Optuna's own lock, left by a process that was killed while writing.
            study.journal(name, scenario).with_suffix(".log.lock").unlink(missing_ok=True)
        searches = [study.Search(name, rule, scenario, **budget) for name, rule in chosen.items()]
        study.run_all(searches, over)
        target = _write(searches, parsed.scenario, scenario, budget, parsed.rules is not None)
        for name in chosen:
            study.journal(name, scenario).unlink(missing_ok=True)
    print(target)
    return 0


def _write(searches: Sequence[study.Search], preset: str, scenario: Scenario, budget: Budget, some: bool) -> Path:
    """Write the best parameters; where only some rules were tuned, keep the others in the file."""
    found = {search.name: asdict(search.found()) for search in searches}
    for name, best in found.items():
        feasible = "feasible" if best["feasible"] else "not feasible"
        result = f"mean return {best['mean_return']:.1f} s over {budget['seeds']} seeds, {feasible}"
        print(f"{name}: {best['parameters']}, {result}")
    with exclusive_lock(tuned.FOLDER, wait=True):  # read again: another process may have tuned another rule
        rules = found | (kept_rules(found, scenario, budget) if some else {})
        values = {
            "command": f"python -m baselines.tune --scenario {preset} --trials {budget['trials']} --seeds {budget['seeds']}",
            "scenario_digest": scenario.digest(),
            "budget": budget,
            "rules": {name: rules[name] for name in RULES if name in rules},
        }
        target = tuned.path(scenario)
        replace_file(target, lambda path: path.write_text(json.dumps(values, indent=1) + "\n", "utf-8"))
    return target


if __name__ == "__main__":
    sys.exit(main())
