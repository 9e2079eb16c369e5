"""Compare rules that react to their edges with constants and with known forms, on `unmodelled`.

    python -m research.studies.unmodelled_reactions
    python -m research.studies.unmodelled_reactions --part search

The table plays jobs of ``validation`` or, with ``--split train``, training jobs. Its scores are 0
for the best fixed shares and 100 for ``causal``. The search of the numbers of
``baselines/reactive.py`` plays training jobs: sets of numbers, ten by hand and others at random, on
the first jobs, and the best four of them on further jobs, each with the constants beside them.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from baselines.comparators import CAUSAL, NOMINAL_SHARE
from baselines.reactive import START_SHARE, WINDOW_ALONE, Reactions, Reactive
from baselines.self_tuning import RULES, SelfTuning
from leaderboard.family import KNOWN_FORMS, family_task, rule_on_family
from leaderboard.play import EPISODE_FIELDS, Episodes, play_family
from leaderboard.statistics import (
    Bootstrap,
    Estimate,
    Floats,
    Mean,
    score_of,
    severe_share,
)
from leaderboard.table import markdown
from research.studies.edge_probe import chunks_of_similar_length
from research.studies.unmodelled_draw import PolicyRow, cells, given
from turning_env import Family, Scenario
from turning_env.console import described, exits, positive
from turning_env.numerics.functions import exp
from turning_env.policy import Policy

FAMILY = "unmodelled"
SPLITS = ("validation", "train")
CONSTANT = "constant"
REACTING = (CONSTANT, "chip_window", "reactive")
"""The rules, of which the one with the highest mean return is the strongest."""
TITLES = {
    NOMINAL_SHARE: "fixed shares of speed and feed",
    CONSTANT: "constant highest speed",
    "chip_window": "and the window of feeds from stops",
    "reactive": "and limits that react to edges",
    KNOWN_FORMS: "`self_tuning` with known forms",
    CAUSAL: "`causal`",
}
"""Policies of the table, and what it calls them."""
JOBS = 256  # of the table
SEARCH_JOBS = 32  # training jobs that all sets of numbers play
FURTHER_JOBS = 80  # training jobs that the best ones play, too
KEPT = 4  # sets of numbers that play the further jobs
RANDOM_SETS = 6
KEY = 58  # of the random sets
BATCH = 32  # jobs that are played together
FIXED: Any = RULES["self_tuning"].fixed

RANGES = {
    "speed": (-0.6, 0.0),
    "change_at": (0.6, 0.9),
    "slower": (0.0, 0.25),
    "sooner": (0.6, 1.3),
    "fast_wear": (0.8, 2.0),
    "faster": (0.1, 0.6),
    "bolder": (0.0, 0.1),
    "span": (0.1, 0.5),
}
"""Ranges of the random sets [-]."""
BY_HAND = (
    {"sooner": 0.8},
    {"sooner": 1.0, "slower": 0.05},
    {"bolder": 0.05, "slower": 0.1},
    {"bolder": 0.1, "slower": 0.15, "sooner": 1.2},
    {"fast_wear": 1.5, "faster": 0.3, "span": 0.3},
    {"fast_wear": 1.5, "faster": 0.5, "span": 0.2, "slower": 0.2, "sooner": 1.0},
    {"speed": -0.2, "slower": 0.15, "sooner": 1.0},
    {"speed": -0.43, "bolder": 0.05, "slower": 0.05},
    {"change_at": 0.65},
)
"""Changes of ``WINDOW_ALONE``."""

Maker = Callable[[Sequence[Scenario]], Policy]
"""Makes a policy for some nominal models."""


def reacting(reactions: Reactions) -> Maker:
    """Return the maker of ``Reactive`` with some numbers."""
    return lambda models: Reactive(models, len(models), reactions, **FIXED)


def at_constant_speed(models: Sequence[Scenario]) -> Policy:
    """Return ``self_tuning`` with the highest speed and the used life of ``WINDOW_ALONE``."""
    top_speed = START_SHARE * float(exp(WINDOW_ALONE.speed))
    change_at = WINDOW_ALONE.change_at
    return SelfTuning(models, len(models), top_speed=top_speed, change_at=change_at, **FIXED)


def played(family: Family, split: str, jobs: Sequence[int], make: Maker) -> Episodes:
    """Return the episodes of a policy on jobs, in chunks of jobs that last about as long."""
    models = {number: family.job(number, split).scenario.nominal() for number in jobs}
    limits = [models[number].control.time_limit for number in jobs]
    episodes: Episodes = {name: np.empty(len(jobs)) for name in EPISODE_FIELDS}
    for chunk in chunks_of_similar_length(limits, BATCH):
        numbers = [jobs[place] for place in chunk]
        policy = make([models[number] for number in numbers])
        ended = play_family(family, split, numbers, make_policy=given(policy), context="hidden")
        for name in EPISODE_FIELDS:
            episodes[name][chunk] = ended[name]
    return episodes


def policy_rows(num_jobs: int, split: str) -> list[dict[str, str]]:
    """Return the rows of the policies on the first jobs of a split."""
    task = family_task(FAMILY, split, num_jobs)
    bootstrap = Bootstrap(num_jobs)
    episodes = {}
    for name in TITLES:
        if name == CONSTANT:
            episodes[name] = played(Family.load(FAMILY), split, task.seeds, at_constant_speed)
            continue
        policy = rule_on_family(name, task)
        assert policy.compute is not None
        episodes[name] = policy.compute(task.scenario, task.seeds, lambda ended: None)
    means = {name: mean_of(ended["return"], bootstrap) for name, ended in episodes.items()}

    constant = PolicyRow(TITLES[CONSTANT], episodes[CONSTANT]["return"])
    rows = []
    for name, title in TITLES.items():
        ended = episodes[name]
        row = PolicyRow(title, ended["return"], ended["edges_broken"])
        # The constant, whichever rule is the strongest.
        line = cells(row, constant)
        line = {key.replace("the strongest rule", "the constant"): line[key] for key in line}
        score = score_of(means[name], fixed=means[NOMINAL_SHARE], oracle=means[CAUSAL])
        line["Score [-]"] = "" if score is None else shown(score.estimate, decimals=1)
        severe = severe_share(ended["severe_overload_time"], ended["engaged_time"])
        line["Severe overload [%]"] = f"{100.0 * severe:.2f}"
        rows.append(line)
    rows.append(worth_of_forms(means))
    return rows


def mean_of(returns: Floats, bootstrap: Bootstrap) -> Mean:
    """Return the mean of the returns of jobs [s], with its replicates."""
    return Mean(float(returns.mean()), bootstrap.means(returns[np.newaxis], "rule"))


def worth_of_forms(means: Mapping[str, Mean]) -> dict[str, str]:
    """Return the row of what known forms gain on the strongest rule, in seconds and in points."""
    known = means[KNOWN_FORMS]
    strongest = max((means[name] for name in REACTING), key=lambda mean: mean.value)
    lead = Mean(known.value - strongest.value, known.replicates - strongest.replicates)
    fixed = means[NOMINAL_SHARE]
    gap = Mean(
        means[CAUSAL].value - fixed.value,
        means[CAUSAL].replicates - fixed.replicates,
    )
    points = Mean(100.0 * lead.value / gap.value, 100.0 * lead.replicates / gap.replicates)
    return {
        "Policy": "known forms less the strongest rule",
        "Return [s]": shown(lead.estimate),
        "Score [-]": shown(points.estimate, decimals=1),
    }


def shown(estimate: Estimate, decimals: int = 0) -> str:
    """Return an estimate with its interval as text."""
    value = f"{estimate.value:.{decimals}f}"
    return f"{value} ({estimate.low:.{decimals}f} to {estimate.high:.{decimals}f})"


def random_sets() -> list[Reactions]:
    """Return sets of numbers from ``RANGES``."""
    generator = np.random.default_rng(KEY)
    sets = []
    for _ in range(RANDOM_SETS):
        numbers = {name: generator.uniform(low, high) for name, (low, high) in RANGES.items()}
        sets.append(Reactions(**numbers))
    return sets


def searched() -> list[dict[str, str]]:
    """Return the sets of numbers with their leads over ``WINDOW_ALONE`` on training jobs."""
    family = Family.load(FAMILY)
    # The first set is what the others are compared with.
    sets = [WINDOW_ALONE]
    for changes in BY_HAND:
        sets.append(WINDOW_ALONE._replace(**changes))
    sets += random_sets()
    returns = []
    for reactions in sets:
        episodes = played(family, "train", range(SEARCH_JOBS), reacting(reactions))
        returns.append(episodes["return"])

    # The best others play further jobs, and so does the first.
    losses = [-values.mean() for values in returns[1:]]
    kept = (1 + np.argsort(losses)[:KEPT]).tolist()
    further = range(SEARCH_JOBS, SEARCH_JOBS + FURTHER_JOBS)
    for index in (0, *kept):
        episodes = played(family, "train", further, reacting(sets[index]))
        returns[index] = np.concatenate([returns[index], episodes["return"]])

    rows = []
    for reactions, values in zip(sets, returns, strict=True):
        count = len(values)
        of_first = PolicyRow("", returns[0][:count])
        row_cells = cells(PolicyRow(numbers_of(reactions), values), of_first)
        rows.append(row_cells | {"Jobs": str(count)})
    return rows


def numbers_of(reactions: Reactions) -> str:
    """Return the numbers of a set as text."""
    numbers = reactions._asdict().items()
    return ", ".join(f"{name} {value:.2f}" for name, value in numbers)


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print a table; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.unmodelled_reactions", **described(__doc__)
    )
    add = parser.add_argument
    add(
        "--part",
        choices=("table", "search"),
        default="table",
        help="(default: %(default)s)",
    )
    add("--split", choices=SPLITS, default="validation", help="of the table (default: %(default)s)")
    add("--jobs", type=positive, default=JOBS, help="jobs of the table (default: %(default)s)")
    options = parser.parse_args(arguments)
    rows = policy_rows(options.jobs, options.split) if options.part == "table" else searched()
    print(markdown(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
