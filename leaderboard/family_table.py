"""Policies compared on the jobs of a family's split: see ``python -m leaderboard.family --help`` for what the columns mean."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from leaderboard.family_play import ANCHOR, FORGETFUL, TRUTH
from leaderboard.family_result import FIELDS, FamilyResult, FamilyTask, columns
from leaderboard.information import Information, class_of, information
from leaderboard.result import ResultError, read_result, result_files, tell_once
from leaderboard.standings import CAUSAL, names_of
from leaderboard.table import aligned
from turning_env import FAMILY_ID
from turning_env.scoring.family import relative
from turning_env.scoring.overload import ratio
from turning_env.scoring.play import Episodes
from turning_env.scoring.policy import PolicySpec
from turning_env.scoring.statistics import Bootstrap, Estimate, Floats, interquartile_mean, rank_key


@dataclass(frozen=True)
class Comparison:
    """A policy on the jobs of a split."""

    name: str
    value: Estimate
    """Mean return over jobs [s]."""
    full_cost: Estimate
    """Cost of time, edges, overload and breakage over the worth of the metal, sums of all jobs."""
    worst: float
    """Lowest return of a job [s]."""
    score: Estimate
    """Interquartile mean over jobs of the return between the two anchors, 0 and 1; NaN if the oracle did not play."""
    lead: Estimate
    """Mean lead over the best controller that is told the nominal model [s]."""
    median: float
    """Median lead [s]."""
    wins: float
    """Share of jobs with a higher return than that controller's."""
    gap_closed: Estimate
    """Mean lead over that of the same controller told the truth; NaN if that did not play or is no better."""
    feasible: float
    """Share of jobs on which it is feasible."""
    overload: float
    """Mean share of cutting time in severe overload."""


def compare(rows: dict[str, Episodes], rules: Sequence[str], allowance: float) -> list[Comparison]:
    """Compare policies on the same jobs.

    Args:
        rows: episodes by policy, fields of shape (training seeds, jobs, episodes).
        rules: names of the controllers that are told the nominal model; leads are over the best of them.
        allowance: highest share of cutting time in severe overload of a feasible policy.
    """
    returns = {name: each["return"].mean(axis=2) for name, each in rows.items()}
    best = max(rules, key=lambda name: float(returns[name].mean()))
    bootstrap = Bootstrap(returns[best].shape[1])

    def mean(values: Floats, name: str) -> Estimate:
        return Estimate.of(values.mean(), bootstrap.means(values, name))

    def full_cost(name: str) -> Estimate:
        worth = rows[name]["reward_metal"].mean(axis=2)
        cost = worth - returns[name]
        return Estimate.of(cost.mean() / worth.mean(), bootstrap.means(cost, name) / bootstrap.means(worth, name))

    def score(name: str) -> Estimate:
        if not {ANCHOR, CAUSAL} <= returns.keys():
            return Estimate(np.nan, np.nan, np.nan)
        shares = relative(*(returns[each].T for each in (name, ANCHOR, CAUSAL))).T
        return Estimate.of(float(interquartile_mean(shares.ravel())), bootstrap.interquartile_means(shares, name))

    gap = returns.get(best + TRUTH, returns[best]) - returns[best]
    if gap.mean() <= 0.0:
        gap = np.full_like(gap, np.nan)
    gaps = bootstrap.means(gap, best)
    found = []
    for name, each in rows.items():
        lead = returns[name] - returns[best]
        shares = ratio(each["severe_overload_time"].sum(axis=2), each["engaged_time"].sum(axis=2))
        found.append(
            Comparison(
                name,
                mean(returns[name], name),
                full_cost(name),
                float(returns[name].min()),
                score(name),
                mean(lead, name),
                float(np.median(lead)),
                float((lead > 0.0).mean()),
                Estimate.of(lead.mean() / gap.mean(), bootstrap.means(lead, name) / gaps),
                float((shares <= allowance).mean()),
                float(shares.mean()),
            )
        )
    return found


_HEADINGS = (
    ("policy", "return", "95 %", "full cost", "95 %", "worst job", "score", "95 %", "lead", "95 %", "median", "better",
     "gap closed", "95 %", "feasible", "overload"),
    ("", "[s]", "[s]", "[%]", "[%]", "[s]", "[%]", "[%]", "[s]", "[s]", "[s]", "[% of jobs]",
     "[%]", "[%]", "[% of jobs]", "[% of time]"),
)  # fmt: skip


def table(comparisons: Sequence[Comparison]) -> str:
    """Return comparisons as text."""

    def cells(estimate: Estimate, factor: float = 1.0) -> Iterator[str]:
        known = np.isfinite(estimate.value)
        yield f"{factor * estimate.value:.0f}" if known else ""
        yield f"{factor * estimate.low:.0f} to {factor * estimate.high:.0f}" if known else ""

    rows: list[Sequence[str]] = list(_HEADINGS)
    for each in comparisons:
        shares = f"{100.0 * each.feasible:.0f}", f"{100.0 * each.overload:.1f}"
        rows.append(
            [each.name, *cells(each.value), *cells(each.full_cost, 100.0), f"{each.worst:.0f}", *cells(each.score, 100.0),
             *cells(each.lead), f"{each.median:.1f}", f"{100.0 * each.wins:.0f}", *cells(each.gap_closed, 100.0), *shares]
        )  # fmt: skip
    return aligned(rows)


@dataclass(frozen=True)
class Board:
    """Policies on a split, by return; oracles last."""

    task: FamilyTask
    rows: dict[str, Episodes]
    """Episodes by policy, fields of shape (training seeds, jobs, episodes)."""
    policies: dict[str, list[PolicySpec]]
    """Identities of the policies by name, one per training seed."""
    comparisons: list[Comparison]

    @classmethod
    def of(cls, results: Sequence[FamilyResult]) -> Self:
        """Compare results on one split, on the jobs that all policies have played.

        Raises:
            ResultError: there are none.
        """
        task, names = results[0].task, names_of([each.policy for each in results])
        of_job: dict[int, list[int]] = {}
        for seed in sorted(set[int].intersection(*(set(each.task.seeds) for each in results))):
            of_job.setdefault(seed % task.jobs, []).append(seed)
        if not of_job:
            raise ResultError(f"{task.scenario.name}: there is no job that all policies have played")
        shape = len(of_job), min(map(len, of_job.values()))
        seeds = [seed for _, known in sorted(of_job.items()) for seed in known[: shape[1]]]
        groups: dict[str, list[FamilyResult]] = {}
        for each in sorted(results, key=lambda each: each.policy.training_seed or 0):
            groups.setdefault(names[each.policy.label], []).append(each)
        rows = {}
        for name, group in groups.items():
            played = [columns(each.rows, seeds) for each in group]
            rows[name] = {field: np.array([each[field] for each in played]).reshape(-1, *shape) for field in FIELDS}
        policies = {name: [each.policy for each in group] for name, group in groups.items()}
        told = [
            name
            for name, (first, *_) in policies.items()
            if first.kind == "rule" and name != ANCHOR and not name.endswith(FORGETFUL)
        ]
        comparisons = compare(rows, told or [ANCHOR], task.scenario.limits.overload_allowance)
        comparisons.sort(key=lambda each: (rank_key(policies[each.name][0].kind, True, each.value.value), each.name))
        return cls(task.model_copy(update={"seeds": seeds}), rows, policies, comparisons)

    @property
    def jobs(self) -> int:
        """Return the number of jobs."""
        return len({seed % self.task.jobs for seed in self.task.seeds})

    @property
    def information(self) -> dict[str, Information]:
        """Return what each agent was given and sees that forgets nothing."""
        whole = {name: group[0] for name, group in self.policies.items() if not name.endswith(FORGETFUL)}
        known = {name: information(first, self.task.scenario) for name, first in whole.items()}
        return {name: each for name, each in known.items() if each is not None}

    def text(self) -> str:
        """Return the table under a line that names the task; agents with their class and number of training seeds."""
        agents = {name: group for name, group in self.policies.items() if group[0].kind == "agent"}
        names = {name: f"{name} ({class_of(group[0])}, seeds: {len(group)})" for name, group in agents.items()}
        shown = [replace(each, name=names.get(each.name, each.name)) for each in self.comparisons]
        episodes = len(self.task.seeds) // self.jobs
        return f"{self.task.family.name}, {self.task.split}, {self.jobs} jobs of {episodes} episodes\n\n{table(shown)}\n"

    def data(self) -> dict[str, Any]:
        """Return all numbers."""
        return {
            "env_id": self.task.env_id,
            "family": self.task.family.name,
            "split": self.task.split,
            "seeds": self.task.seeds,
            "task": self.task.digest,
            "policies": [asdict(each) for each in self.comparisons],
        }


def read_boards(results: Path, name: str = "*") -> list[Board]:
    """Compare the policies on every family and split that a folder of results holds, or on that of one name.

    Of each split, results on the same version of the family are compared; others are named on standard error and left out.
    """
    boards = []
    for folder in sorted((results / FAMILY_ID).glob(name)):
        found: dict[str, list[FamilyResult]] = {}
        for path in result_files(folder):
            try:
                result = read_result(path, FamilyResult)
                found.setdefault(result.task.model_copy(update={"seeds": []}).digest, []).append(result)
            except ResultError as error:
                tell_once(f"skipped: {error}: delete it, or play it again by python -m leaderboard.family")
        if found:
            boards.append(Board.of(max(found.values(), key=len)))
            if len(found) > 1:
                tell_once(f"{folder}: left out results on other versions of the family or the model")
    return boards
