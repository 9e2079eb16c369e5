"""Tunes the rules on tuning draws, with a stated budget, and writes what it found to ``baselines/tuned/``.

    python -m baselines.tune
    python -m baselines.tune --scenario forging

Every setting of a coarse grid plays a quarter of the draws, then the best tenth of the settings plays all of them, and the best
mean return wins. The budget, in episodes, is written down with the result. Interrupted, the same command goes on.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from tqdm import tqdm

from baselines import tuned
from baselines.catalogue import RULES, Parameters
from baselines.code import code_digest
from baselines.journal import Journal
from baselines.play import play
from turning_env import Scenario
from turning_env.draws import tuning_draws
from turning_env.files import replace_file


def candidates(rule: str, scenario: Scenario) -> list[Parameters]:
    """The settings that are tried for a rule."""
    machine = scenario.machine
    if rule == "fixed_tuned":
        speeds = np.linspace(machine.cutting_speed_min, machine.cutting_speed_max, 16)
        feeds = np.linspace(machine.feed_min, machine.feed_max, 19)
        return [{"cutting_speed": float(v), "feed": float(f)} for v, f in itertools.product(speeds, feeds)]
    if rule == "rescaled_grid_search":
        margins = np.linspace(0.80, 1.05, 11)
        smoothings = (0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0)
        return [{"margin": float(m), "smoothing": s} for m, s in itertools.product(margins, smoothings)]
    raise KeyError(f"{rule} has nothing to tune")


def mean_return(rule: str, scenario: Scenario, setting: Parameters, seeds: Sequence[int]) -> float:
    """Mean return [s] of a rule with a setting on given draws."""
    return float(play(lambda lanes: RULES[rule].build(scenario, lanes, setting), scenario, seeds)["return"].mean())


def open_journal(scenario: Scenario) -> Journal:
    """The scores found so far for a scenario by the present code."""
    return Journal(tuned.FOLDER / f".unfinished-{scenario.name}.json", [scenario.digest(), code_digest()])


def tune(rule: str, scenario: Scenario, draws: int, journal: Journal) -> tuple[Parameters, float, int]:
    """Find the best setting of a rule; return (setting, its mean return on all draws [s], episodes played)."""
    seeds = tuning_draws(draws)
    few = seeds[: max(1, draws // 4)]
    settings = candidates(rule, scenario)
    finalists = max(1, len(settings) // 10)
    with tqdm(total=len(settings) + finalists, desc=f"tuning {rule}", unit="setting") as bar:

        def scores(tried: list[Parameters], on: Sequence[int]) -> Iterator[float]:
            for setting in tried:
                yield journal.recall([rule, setting, len(on)], partial(mean_return, rule, scenario, setting, on))
                bar.update()

        first = list(scores(settings, few))
        kept = [settings[i] for i in np.argsort(first)[::-1][:finalists]]
        final = list(scores(kept, seeds))
    best = int(np.argmax(final))
    return kept[best], final[best], len(settings) * len(few) + finalists * len(seeds)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m baselines.tune", description="Tune the rules for a scenario.")
    parser.add_argument("--scenario", default="rough_turning", help="preset or TOML file")
    parser.add_argument("--draws", type=int, default=128, help="tuning draws")
    parsed = parser.parse_args(arguments)
    try:
        scenario = Scenario.load(parsed.scenario)
        tuning_draws(parsed.draws)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    journal = open_journal(scenario)
    rules = {}
    for name in (name for name, rule in RULES.items() if rule.fixed_parameters is None):
        try:
            setting, score, episodes = tune(name, scenario, parsed.draws, journal)
        except KeyboardInterrupt:
            print("interrupted: run the same command again to go on", file=sys.stderr)
            return 130
        rules[name] = {"parameters": setting, "mean_return": score, "episodes_played": episodes}
        print(f"{name}: {setting}, mean return {score:.1f} s over {parsed.draws} draws")
    target = tuned.path(scenario)
    values = {
        "command": f"python -m baselines.tune --scenario {parsed.scenario} --draws {parsed.draws}",
        "scenario_digest": scenario.digest(),
        "tuning_draws": parsed.draws,
        "rules": rules,
    }
    replace_file(target, lambda path: path.write_text(json.dumps(values, indent=1) + "\n", "utf-8"))
    journal.finish()
    print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
