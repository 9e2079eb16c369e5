"""Scores over the tasks: the best policies of each task, means over tasks, and comparisons.

A score is 0 for the best fixed speed and feed, and 100 for the oracle of the state
(``leaderboard.statistics.score_of``). The numbers are those of Agarwal et al. (2021, "Deep
reinforcement learning at the edge of the statistical precipice", arXiv 2108.13264): interquartile
means over tasks, performance profiles and probabilities of improvement.

The score of a policy on a task, with its bootstrap replicates, is that of its standing. Over tasks
the bootstrap is stratified: the replicates of each task are put into an order of its own, so that
those of two tasks are independent, and every interval on one task is the leaderboard's.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np

from baselines.catalogue import RULES
from baselines.comparators import CAUSAL, comparators
from leaderboard.notices import notify_once
from leaderboard.ranking import Leaderboard, read_leaderboard
from leaderboard.result import ResultError, result_files, result_folder
from leaderboard.scoring import SPLIT
from leaderboard.standings import Standing
from leaderboard.statistics import (
    KEY,
    RESAMPLES,
    Bootstrap,
    Estimate,
    Feasibility,
    Floats,
    Mean,
    interquartile_mean,
    reason_not_to_rank,
)
from turning_env import FAMILY_ID, IDS
from turning_env.scenario.family import families

SIMPLE_SEARCHES = ("linear_cma_es", "load_loop", "load_loop_jobs")
"""Agents without a network, found by a search over a handful of numbers."""
LEVELS = (0.0, 50.0, 90.0)
"""Scores at which the table gives the performance profile."""
BEST_RULE = "best rule"
BEST_AGENT = "best unprivileged agent"
_BETTER = f"better than {BEST_RULE} [%]"
WHAT_IT_ASKS = {
    "shop": "memory and foresight: the lathe's model is wrong",
    "unmodelled": "finding out which laws the model lacks",
    "RoughTurning-Shift-v0": "foresight over many edges",
    "RoughTurning-Batch-v0": "a plan for uncertain blanks",
    "RoughTurning-v0": "estimating a hidden load",
    "RoughTurning-Override-v1": "holding the spindle load against a lag",
    "RoughTurning-Surface-v1": "holding a roughness against a lag",
}
"""Words on what a task asks of a policy, by its label, in the order of the table of tasks.

It has the tasks on which agents are ranked.
"""
LETTERS = {
    "model-free agent": "M",
    "agent on a belief": "B",
    "student of a rule": "S",
    "privileged agent": "P",
    "other agent": "O",
}
"""Letter of an agent's class (``leaderboard.inputs.CLASSES``) in the table of tasks."""
NOBODY = "none"
"""Cell of the table of tasks for a kind that nobody represents."""


@dataclass(frozen=True)
class Kind:
    """A kind of policies; on each task, the best of them represents it."""

    title: str
    holds: Callable[[Standing, str], bool]
    """Returns whether a standing is of this kind; also takes the name of the fixed parameters."""


def _is_published(standing: Standing, fixed: str) -> bool:
    return standing.name in RULES and RULES[standing.name].published


def _is_unprivileged(standing: Standing, fixed: str) -> bool:
    is_learned = standing.kind == "agent" and standing.name not in SIMPLE_SEARCHES
    return is_learned and standing.about.policy_class != "privileged agent"


def _is_rule(standing: Standing, fixed: str) -> bool:
    return standing.about.policy_class == "rule"


def _of_class(title: str, policy_class: str) -> Kind:
    """Return the kind of a class of agents, without simple searches."""

    def holds(standing: Standing, fixed: str) -> bool:
        return standing.about.policy_class == policy_class and standing.name not in SIMPLE_SEARCHES

    return Kind(title, holds)


RANDOM = Kind("random", lambda standing, fixed: standing.name == "random")
PUBLISHED = Kind("best published", _is_published)
RULE = Kind(BEST_RULE, _is_rule)
LEARNER = Kind("best learner", lambda standing, fixed: standing.kind == "agent")
ORACLE = Kind("oracle", lambda standing, fixed: standing.name == CAUSAL)
BY_TASK = (RANDOM, PUBLISHED, RULE, LEARNER, ORACLE)
"""Kinds of policies in the table of tasks."""
KINDS = (
    RANDOM,
    Kind("best simple search", lambda standing, fixed: standing.name in SIMPLE_SEARCHES),
    Kind("best fixed", lambda standing, fixed: standing.name == fixed),
    PUBLISHED,
    RULE,
    _of_class("best model-free agent", "model-free agent"),
    _of_class("best agent on a belief", "agent on a belief"),
    _of_class("best student of a rule", "student of a rule"),
    # No class of agents plays all tasks, but these do together.
    Kind(BEST_AGENT, _is_unprivileged),
    _of_class("best privileged agent", "privileged agent"),
    ORACLE,
)
"""Kinds of policies in the table of means over tasks."""


class TaskScores:
    """The standings of a task that has scores, for numbers over tasks.

    Args:
        leaderboard: ranked results of the task.

    Raises:
        ResultError: the best fixed parameters or the oracle of the state have not played, or the
            oracle is not certainly better.
    """

    def __init__(self, leaderboard: Leaderboard) -> None:
        task = leaderboard.task
        self.label = task.of_family.family.name if task.of_family else task.env_id
        self.ranks_agents = reason_not_to_rank("agent", task.scenario) is None
        compared = comparators(task.scenario, on_family=task.of_family is not None)
        self.fixed = compared.fixed
        self._standings = {standing.name: standing for standing in leaderboard.standings}
        self._bootstrap = Bootstrap(len(task.seeds))
        shuffle = np.random.default_rng([KEY, crc32(self.label.encode())])
        self._order = shuffle.permutation(RESAMPLES)
        for end in (self.fixed, CAUSAL):
            if end not in self._standings:
                raise ResultError(f"{self.label} has no scores: {end} has not played")
        if self._standings[CAUSAL].score is None:
            raise ResultError(
                f"{self.label} has no scores: {CAUSAL} is no better than {self.fixed}"
            )

    def best(self, kind: Kind) -> str | None:
        """Return the best policy of a kind: the first one that is ranked, or an oracle."""
        for name, standing in self._standings.items():
            is_shown = standing.unranked is None or name == CAUSAL
            if is_shown and kind.holds(standing, self.fixed):
                return name
        return None

    def has(self, name: str) -> bool:
        """Return whether a policy has played and is ranked."""
        return name in self._standings and self._standings[name].unranked is None

    def feasibility(self, name: str) -> Feasibility:
        """Return whether a policy is feasible; every oracle counts as feasible."""
        standing = self._standings[name]
        return "feasible" if standing.kind == "oracle" else standing.overload.feasibility

    def letter(self, name: str) -> str:
        """Return the letter of an agent's class; it is empty for other policies."""
        return LETTERS.get(self._standings[name].about.policy_class, "")

    def score(self, name: str) -> Mean:
        """Return the score of a policy, with replicates that are independent of other tasks'."""
        score = self._standings[name].score
        assert score is not None  # as the oracle has one
        return Mean(score.value, score.replicates[self._order])

    def episode_scores(self, name: str) -> Floats:
        """Return the score of each episode of a policy, shape (training seeds, seeds).

        It is 100 less the distance from the oracle on the same seed in hundredths of the mean gap,
        so the mean of all episodes is the policy's score.
        """
        oracle = self._standings[CAUSAL]
        gap = oracle.mean_return.value - self._standings[self.fixed].mean_return.value
        behind = oracle.returns.mean(axis=0) - self._standings[name].returns
        return np.asarray(100.0 - 100.0 * behind / gap)

    def share_above(self, name: str, level: float) -> Mean:
        """Return the share of a policy's episodes with a score above a level."""
        return self._mean_of(np.asarray(self.episode_scores(name) > level, np.float64), name)

    def shares_above(self, name: str, levels: Floats) -> Floats:
        """Return replicates of the share of episodes above levels, shape (levels, resamples)."""
        shares = self._bootstrap.shares_above(self.episode_scores(name), levels, name)
        return shares[:, self._order]

    def wins(self, name: str, other: str) -> Mean:
        """Return the share of seeds on which a policy returns more than another; a tie is half.

        Every training of one is compared with every training of the other.
        """
        returns = self._standings[name].returns
        others = self._standings[other].returns
        wins = np.zeros(returns.shape)
        for training in others:
            wins += np.where(returns == training, 0.5, returns > training)
        return self._mean_of(wins / len(others), name)

    def _mean_of(self, values: Floats, name: str) -> Mean:
        """Return a mean over episodes, with replicates that are independent of other tasks'."""
        replicates = self._bootstrap.means(values, name)
        return Mean(float(np.mean(values)), replicates[self._order])


def read(results: Path) -> list[TaskScores]:
    """Return the scores of every task: all ids on their own presets, and the families' unseen jobs.

    A notice on stderr names each task that has no scores. Raise ResultError if none has.
    """
    folders = [result_folder(results, env_id, preset) for env_id, preset in IDS.items()]
    for family in families():
        folders.append(result_folder(results, FAMILY_ID, f"{family}-{SPLIT}"))
    tasks = []
    for folder in folders:
        if not result_files(folder):
            continue
        try:
            tasks.append(TaskScores(read_leaderboard(folder)))
        except ResultError as error:
            notify_once(f"skipped: {error}")
    if not tasks:
        raise ResultError(f"{results} holds no task on which {CAUSAL} and fixed parameters played")
    return tasks


def by_task(tasks: Sequence[TaskScores]) -> list[dict[str, str]]:
    """Return the table of tasks: a row for each, with the best policy of each kind, as texts.

    It leaves out tasks on which agents are not ranked, and so have no best learner. Raise
    ResultError if no task is left.
    """
    rows = []
    for task in _in_order(tasks):
        row = {"task": _short(task.label), "what it asks": WHAT_IT_ASKS[task.label]}
        for kind in BY_TASK:
            row[kind.title] = _cell(task, kind)
        rows.append(row)
    if not rows:
        raise ResultError("agents are ranked on none of these tasks")
    return rows


def _short(label: str) -> str:
    """Return the label of a task without what all ids begin with."""
    return label.removeprefix("RoughTurning-")


def _in_order(tasks: Sequence[TaskScores]) -> list[TaskScores]:
    """Return the tasks on which agents are ranked, in the order of the table of tasks."""
    task_by_label = {task.label: task for task in tasks if task.ranks_agents}
    return [task_by_label[label] for label in WHAT_IT_ASKS if label in task_by_label]


def _cell(task: TaskScores, kind: Kind) -> str:
    """Return the name, score and letter of the best policy of a kind.

    Names of random actions and of the oracle are left out, as their columns' headings say the same.
    """
    name = task.best(kind)
    if name is None:
        return NOBODY
    # A score between -0.5 and 0 is 0, not -0.
    score = str(round(task.score(name).value) + 0)
    if kind in (RANDOM, ORACLE):
        return score
    return " ".join([f"`{name}`", score, task.letter(name)]).rstrip()


def not_feasible(tasks: Sequence[TaskScores]) -> list[str]:
    """Return sentences on the policies in the table of tasks that are not certainly feasible."""
    tasks_by_policy: dict[Feasibility, dict[str, list[str]]] = {"infeasible": {}, "not shown": {}}
    for task in _in_order(tasks):
        # A policy may be the best of several kinds.
        for name in dict.fromkeys(task.best(kind) for kind in BY_TASK):
            if name is None or task.feasibility(name) == "feasible":
                continue
            places = tasks_by_policy[task.feasibility(name)]
            places.setdefault(name, []).append(_short(task.label))
    sentences = []
    for heading, feasibility in _HEADINGS.items():
        named = []
        for name, labels in tasks_by_policy[feasibility].items():
            named.append(f"`{name}` on {', '.join(labels)}")
        if named:
            sentences.append(f"{heading}: {'; '.join(named)}.")
    return sentences


_HEADINGS: dict[str, Feasibility] = {
    "Infeasible": "infeasible",
    "Feasibility not shown": "not shown",
}


Entry = dict[TaskScores, str]
"""The policy that stands for a kind, or the policy itself, by the task that it plays."""


def entries(tasks: Sequence[TaskScores], policies: Collection[str] = ()) -> dict[str, Entry]:
    """Return the kinds, and policies, by title, with the policy that plays each task.

    Tasks on which agents are not ranked do not count: they would favour kinds that cannot play them
    well. Raise ResultError if a policy plays none of the others.
    """
    counted = [task for task in tasks if task.ranks_agents]
    entry_by_title: dict[str, Entry] = {}
    for kind in KINDS:
        entry = {}
        for task in counted:
            name = task.best(kind)
            if name is not None:
                entry[task] = name
        if entry:
            entry_by_title[kind.title] = entry
    for policy in policies:
        entry = {task: policy for task in counted if task.has(policy)}
        if not entry:
            raise ResultError(f"no policy is called {policy}")
        entry_by_title[policy] = entry
    return entry_by_title


def mean_score(entry: Entry) -> Mean:
    """Return the interquartile mean over tasks of the score.

    Of fewer than four tasks it is their mean: quarters are rounded down.
    """
    scores = [task.score(name) for task, name in entry.items()]
    replicates = np.stack([score.replicates for score in scores], axis=-1)
    values = np.array([score.value for score in scores])
    return Mean(interquartile_mean(values).item(), interquartile_mean(replicates))


def profile(entry: Entry, level: float) -> Mean:
    """Return the share of episodes with a score above a level, each task with the same weight."""
    return _mean_over_tasks([task.share_above(name, level) for task, name in entry.items()])


def improvement(entry: Entry, other: Entry) -> Mean | None:
    """Return the probability that an episode returns more than the other's on the same seed.

    It is the mean over the tasks that both play; None if there is none.
    """
    common = [task for task in entry if task in other]
    if not common:
        return None
    return _mean_over_tasks([task.wins(entry[task], other[task]) for task in common])


def _mean_over_tasks(means: Sequence[Mean]) -> Mean:
    value = float(np.mean([mean.value for mean in means]))
    return Mean(value, np.mean([mean.replicates for mean in means], axis=0))


def over_tasks(tasks: Sequence[TaskScores], policies: Collection[str] = ()) -> list[dict[str, str]]:
    """Return a row per kind, and per policy, with numbers over the tasks, as texts.

    Args:
        tasks: the scores.
        policies: policies that have a row beside the kinds.
    """
    listed = entries(tasks, policies)
    rows = []
    for title, entry in listed.items():
        row = {"policy": title, "tasks": str(len(entry))}
        row["score"] = _text(mean_score(entry).estimate)
        for level in LEVELS:
            share = profile(entry, level).estimate
            row[f"episodes above {level:.0f} [%]"] = _text(share, factor=100.0)
        row[_BETTER] = ""
        wins = improvement(entry, listed.get(BEST_RULE, {}))
        if wins is not None and title != BEST_RULE:
            row[_BETTER] = _text(wins.estimate, factor=100.0)
        rows.append(row)
    return rows


def _text(estimate: Estimate, factor: float = 1.0) -> str:
    """Return an estimate with its interval."""
    decimals = min(estimate.decimals(factor), 1)
    value = f"{factor * estimate.value:.{decimals}f}"
    low = f"{factor * estimate.low:.{decimals}f}"
    high = f"{factor * estimate.high:.{decimals}f}"
    return f"{value} ({low} to {high})"


def levels_and_shares(entry: Entry, levels: Floats) -> Mapping[str, Floats]:
    """Return the performance profile of an entry at many levels: shares with their intervals."""
    values = []
    replicates = []
    for task, name in entry.items():
        above = task.episode_scores(name) > levels[:, np.newaxis, np.newaxis]
        values.append(above.mean(axis=(1, 2)))
        replicates.append(task.shares_above(name, levels))
    shares = np.mean(replicates, axis=0)
    estimates = []
    for value, share in zip(np.mean(values, axis=0), shares, strict=True):
        estimates.append(Estimate.of(value, share))
    return {
        "value": np.array([estimate.value for estimate in estimates]),
        "low": np.array([estimate.low for estimate in estimates]),
        "high": np.array([estimate.high for estimate in estimates]),
    }
