"""The numbers of each policy on one task, ranked."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from baselines.catalogue import RULES
from leaderboard.family import CAUSAL, NOMINAL_OPTIMUM
from leaderboard.information import Information, class_of, information
from leaderboard.policies import is_own
from leaderboard.result import Result
from train.agents.agent_file import description_of_training
from train.run import TERMS
from turning_env import SPLITS, Scenario
from turning_env.files import digest_of
from turning_env.scoring.policy import PolicySpec
from turning_env.scoring.statistics import (
    Bootstrap,
    Estimate,
    Feasibility,
    Floats,
    feasibility,
    interquartile_mean,
    rank_key,
    ratio,
    reason_not_to_rank,
)


@dataclass(frozen=True)
class Comparators:
    """The policies with which all others are compared on a task."""

    fixed: str  # fixed parameters: the zero of the score
    published: str  # the published controller


SPEED_AND_FEED = Comparators("fixed_tuned", "grid_search")
OVERRIDE = Comparators("programmed_feed", "modified_fuzzy_override")
ROUGHNESS = Comparators("programmed_feed", "constant_force")
PARTS = Comparators("parts_fixed_tuned", "parts_app_pt")


def comparators(scenario: Scenario) -> Comparators:
    """Return the comparators of a scenario."""
    if scenario.control.action == "part":
        return PARTS
    if scenario.control.action == "override":
        return ROUGHNESS if scenario.control.aim == "roughness" else OVERRIDE
    return SPEED_AND_FEED


LARGEST = 3  # number of the largest differences that a mean leaves out, to show whether a few seeds make a lead


@dataclass(frozen=True)
class Standing:
    """The numbers of one policy; a number is None if it does not apply to the task.

    A comparison is also None if the policy to compare with has not played or is this one.
    """

    name: str
    kind: str
    policy_class: str  # one of leaderboard.information.CLASSES
    information: Information | None  # of an agent
    description: str
    own: bool  # an agent that does not come with the project
    training_seeds: tuple[int, ...]
    unranked: str | None  # why it has no rank; None if it has one
    feasible: bool
    feasibility: Feasibility  # "not shown" if the allowance lies between the confidence limits of severe_share
    mean_return: Estimate  # [s]
    interquartile_return: Estimate  # [s]
    severe_share: float  # of cutting time
    severe_lower_limit: float  # one-sided lower confidence limit of severe_share
    severe_limit: float  # one-sided upper confidence limit of severe_share
    best_rule: (
        str | None
    )  # of the other policies that are rules, the feasible one with the highest mean return, if any is
    over_best_rule: Estimate | None  # [s]
    over_causal: Estimate | None  # [s]
    median_over_best_rule: float | None = None  # over seeds [s]
    over_best_rule_without_largest: float | None = (
        None  # mean over seeds but the ``LARGEST`` with the largest differences [s]
    )
    beats_best_rule: float | None = None  # share of seeds
    class_rank: int | None = (
        None  # among the policies of its class, by the same order; None for an oracle
    )
    constraint_rank: int | None = None  # among feasible policies, by cost
    over_fixed: Estimate | None = None  # [s]
    over_published: Estimate | None = None  # [s]
    score: Estimate | None = None  # 0 the fixed parameters, 1 the causal oracle
    full_cost: Estimate | None = (
        None  # [min/dm3], overload included; None if no metal is removed or a roughness is held
    )
    minutes: float | None = None  # of an episode, with edge changes and downtime [min]
    part_cost: float | None = None  # edges included; None if no parts are turned [min]
    roughness_deviation: float | None = None  # mean, relative; None if no roughness is held
    removal_rate: float | None = None  # [cm3/min]
    cost: Estimate | None = None  # [min/dm3], overload excluded; None if no metal is removed
    over_least_cost: Estimate | None = None  # [min/dm3], of the other feasible policies
    overload_share: float | None = None  # of cutting time
    share_above_2_percent: float | None = None  # of cutting time; None if a result lacks it
    share_above_10_percent: float | None = None  # likewise
    excess: float | None = None  # mean while cutting, relative
    edges: float | None = None  # used up in an episode
    broken_share: float | None = None  # of edges used up
    used_life: float | None = None  # at the end
    # Of families, whose volumes and edges do not add up:
    full_cost_share: Estimate | None = (
        None  # cost of time, edges, overload and breakage over the worth of the metal
    )
    job_score: Estimate | None = None  # 0 the fixed nominal optimum, 1 the causal oracle
    over_truth: Estimate | None = None  # over the best rule with true laws [s]
    worst_return: float | None = None  # of a job [s]
    feasible_jobs: float | None = None  # share of jobs


def ranked_by(scenario: Scenario) -> str:
    """Return the field of ``Standing`` that ranks feasible policies: the mean return, or on splits the full cost.

    Where metal does not pay, as on most splits, the return per edge is higher if the edge ends early.
    """
    return "full_cost" if scenario.name in SPLITS else "mean_return"


def rank(results: Sequence[Result]) -> list[Standing]:
    """Return the policies of one task: feasible ones first, then as ``ranked_by``; those without a rank last, and oracles last.

    There must be a result.
    """
    key = tuple((each.checksum, each.policy.description, is_own(each.policy)) for each in results)
    if key not in _ranked:  # a run asks several times
        _ranked[key] = _rank(results)
    return list(_ranked[key])


_ranked: dict[tuple[tuple[str, str, bool], ...], list[Standing]] = {}


def _rank(results: Sequence[Result]) -> list[Standing]:
    names = names_of([result.policy for result in results])
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(names[result.policy.label], []).append(result)
    board = _Board(groups)
    standings = [board.standing(name) for name in groups]
    by_full_cost = ranked_by(board.scenario) == "full_cost"

    def merit(each: Standing) -> float:
        if by_full_cost:
            return -each.full_cost.value if each.full_cost else -math.inf
        return each.mean_return.value

    standings.sort(
        key=lambda each: (rank_key(each.kind, each.feasible, merit(each), each.unranked), each.name)
    )
    return _with_ranks(standings, board.costs)


def _cost_minutes(episodes: Mapping[str, Floats], scenario: Scenario) -> Floats:
    """Return the cost [min] of each episode: time and edges."""
    return total_minutes(episodes, scenario) + scenario.economics.edge_cost * episodes["edges_used"]


def _metal_cost(
    name: str, minutes: Floats, removed: Floats, bootstrap: Bootstrap
) -> tuple[float, Floats]:
    """Return the cost of metal [cm3] that has cost ``minutes``, and that in each resample [min/dm3]."""
    volume = removed / 1000.0
    return _share(minutes, volume), ratio(
        bootstrap.means(minutes, name), bootstrap.means(volume, name)
    )


def _with_ranks(
    standings: Sequence[Standing], costs: Mapping[str, tuple[float, Floats]]
) -> list[Standing]:
    """Return standings, which are in order, with their ranks within classes and on the constraint track."""
    # Oracles and, where learning games the task, agents are shown, but do not take part in the ranking.
    contestants = [standing for standing in standings if standing.unranked is None]

    # The constraint track ranks feasible policies by the cost of their metal.
    by_cost = [
        standing.name for standing in contestants if standing.feasible and standing.name in costs
    ]
    by_cost.sort(key=lambda name: costs[name][0])

    ranked = []
    for standing in standings:
        peers = [other.name for other in contestants if other.policy_class == standing.policy_class]
        ranked.append(
            replace(
                standing,
                class_rank=_place(standing.name, peers),
                constraint_rank=_place(standing.name, by_cost),
                over_least_cost=_over_cheapest_other(standing.name, by_cost, costs),
            )
        )
    return ranked


def _place(name: str, order: Sequence[str]) -> int | None:
    """Return the place of a name in an order, from 1; None if it is not there."""
    return 1 + order.index(name) if name in order else None


def _over_cheapest_other(
    name: str, by_cost: Sequence[str], costs: Mapping[str, tuple[float, Floats]]
) -> Estimate | None:
    """Return the cost of a policy less that of the cheapest other on the constraint track [min/dm3]."""
    others = [other for other in by_cost if other != name]
    if name not in costs or not others:
        return None
    cost, replicates = costs[name]
    least, least_replicates = costs[others[0]]
    return Estimate.of(cost - least, replicates - least_replicates)


def names_of(policies: Sequence[PolicySpec]) -> dict[str, str]:
    """Return the name under which each policy is ranked, by its label: agents that differ only in training seed share one.

    If agents of one name differ in more, or only some come with the project, the first keeps the name, those of the project
    before others; the name of the others ends in their training seeds. What a training does not name has its value in ``TERMS``.
    """
    trainings: dict[str, dict[str, list[PolicySpec]]] = {}
    for policy in sorted(policies, key=is_own):
        alike = policy.model_dump(include={"kind", "tuned_for"}), TERMS | policy.parameters
        training = digest_of([is_own(policy), *alike])
        trainings.setdefault(policy.title, {}).setdefault(training, []).append(policy)
    names: dict[str, str] = {}
    for name, groups in trainings.items():
        for place, group in enumerate(groups.values()):
            seeds = ",".join(str(policy.training_seed) for policy in group)
            names |= {policy.label: f"{name}-seed{seeds}" if place else name for policy in group}
    return names


def _description(policy: PolicySpec) -> str:
    """Return what a policy is: of the project's own by the present code, as results may hold older words."""
    if policy.name in RULES:
        return RULES[policy.name].description
    if policy.kind == "agent" and not is_own(policy) and policy.tuned_for is not None:
        return description_of_training(
            policy.parameters, policy.parameters.get("steps"), policy.tuned_for.name
        )
    return policy.description


def highest(returns: Mapping[str, float]) -> str | None:
    """Return the policy with the highest return, the first by name on a tie; None if there is no policy."""
    return min(returns, key=lambda name: (-returns[name], name), default=None)


def best_rule(standings: Sequence[Standing]) -> Standing | None:
    """Return the rule with the highest mean return, a feasible one if there is any; None without a rule."""
    rules = {standing.name: standing for standing in standings if standing.kind == "rule"}
    feasible = {
        name: standing.mean_return.value for name, standing in rules.items() if standing.feasible
    }
    best = highest(
        feasible or {name: standing.mean_return.value for name, standing in rules.items()}
    )
    return None if best is None else rules[best]


class _Board:
    """Policies on one task: the results of each by its name, one per training seed."""

    def __init__(self, groups: Mapping[str, Sequence[Result]]) -> None:
        self.groups, self.task = groups, next(iter(groups.values()))[0].task
        self.scenario = self.task.scenario
        self.played = {
            name: {
                field: np.array([each.episodes[field] for each in group])
                for field in group[0].episodes
            }
            for name, group in groups.items()
        }  # arrays of shape (training seeds, seeds)
        self.bootstrap = Bootstrap(len(self.task.seeds))
        self.means = {
            name: self.bootstrap.means(each["return"], name) for name, each in self.played.items()
        }
        policies = {name: group[0].policy for name, group in groups.items()}
        self.severe_limits = {name: self._severe_limits(name) for name in groups}
        self.rules = {
            name: float(np.mean(self.played[name]["return"]))
            for name, policy in policies.items()
            if policy.kind == "rule" and not policy.forgets
        }
        self.costs = {} if self.task.of_family else {
            name: _metal_cost(name, _cost_minutes(episodes, self.scenario), episodes["removed"], self.bootstrap)
            for name, episodes in self.played.items()
            if episodes["removed"].any()
        }  # fmt: skip

    def _severe_limits(self, name: str) -> tuple[float, float]:
        """Return the lower and upper confidence limits of a policy's share of severe overload."""
        episodes = self.played[name]
        return self.bootstrap.severe_limits(
            episodes["severe_overload_time"], episodes["engaged_time"], name
        )

    def _feasibility(self, name: str) -> Feasibility:
        return feasibility(self.severe_limits[name], self.scenario.limits.overload_allowance)

    def _best_other_rule(self, name: str) -> str | None:
        """Return the other rule with the highest mean return, a feasible one if there is any."""
        others = {rule: mean for rule, mean in self.rules.items() if rule != name}
        feasible = {
            rule: mean for rule, mean in others.items() if self._feasibility(rule) == "feasible"
        }
        return highest(feasible or others)

    def _excess_share(self, name: str, field: str) -> float | None:
        """Return the share of cutting time with an excess above a threshold, a field of ``ExcessShares``; None if unknown."""
        excess_time, engaged_time = 0.0, 0.0
        for result in self.groups[name]:
            if result.excess is None:
                return None
            engaged = float(np.sum(result.episodes["engaged_time"]))
            engaged_time += engaged
            excess_time += engaged * getattr(result.excess, field)
        return excess_time / engaged_time if engaged_time > 0.0 else 0.0

    def standing(self, name: str) -> Standing:
        """Return the standing of one policy."""
        policy, episodes, scenario = self.groups[name][0].policy, self.played[name], self.scenario
        returns, engaged, severe = (
            episodes["return"],
            episodes["engaged_time"],
            episodes["severe_overload_time"],
        )
        best_rule = self._best_other_rule(name)
        severe_lower_limit, severe_limit = self.severe_limits[name]
        interquartile = self.bootstrap.interquartile_means(returns, name)
        return Standing(
            name=name,
            kind=policy.kind,
            policy_class=class_of(policy),
            information=information(policy, policy.trained_on or scenario),
            description=_description(policy),
            own=is_own(policy),
            training_seeds=tuple(
                sorted(
                    each.policy.training_seed or 0
                    for each in self.groups[name]
                    if policy.kind == "agent"
                )
            ),
            unranked=reason_not_to_rank(policy.kind, scenario),
            feasible=self._feasibility(name) == "feasible",
            feasibility=self._feasibility(name),
            mean_return=Estimate.of(float(np.mean(returns)), self.means[name]),
            interquartile_return=Estimate.of(
                interquartile_mean(returns.ravel()).item(), interquartile
            ),
            severe_share=_share(severe, engaged),
            severe_lower_limit=severe_lower_limit,
            severe_limit=severe_limit,
            best_rule=best_rule,
            over_best_rule=self._difference(name, best_rule),
            over_causal=self._difference(name, CAUSAL),
            overload_share=_share(episodes["overload_time"], engaged)
            if "overload_time" in episodes
            else None,
            share_above_2_percent=self._excess_share(name, "above_2_percent"),
            share_above_10_percent=self._excess_share(name, "above_10_percent"),
            **self._leads(name, best_rule),
            **(self._of_jobs(name) if self.task.of_family else self._of_episodes(name)),
        )

    def _difference(self, name: str, other: str | None) -> Estimate | None:
        """Return the difference of two policies' mean returns."""
        if other is None or other == name or other not in self.played:
            return None
        value = float(np.mean(self.played[name]["return"]) - np.mean(self.played[other]["return"]))
        return Estimate.of(value, self.means[name] - self.means[other])

    def _leads(self, name: str, other: str | None) -> dict[str, Any]:
        """Return the numbers of the differences of two policies' returns, seed by seed, that a few seeds cannot decide."""
        if other is None:
            return {}
        leads = self.played[name]["return"].mean(axis=0) - self.played[other]["return"].mean(axis=0)
        few = leads[np.argsort(-np.abs(leads), kind="stable")[LARGEST:]]
        return {
            "median_over_best_rule": float(np.median(leads)),
            "over_best_rule_without_largest": float(few.mean()) if few.size else None,
            "beats_best_rule": float((leads > 0.0).mean()),
        }

    def _score(self, name: str, start: str) -> Estimate | None:
        """Return the share of the gap in return from a policy to the causal oracle that another closes."""
        if not {start, CAUSAL} <= self.played.keys() or name in (start, CAUSAL):
            return None
        low, high, mean = (
            float(np.mean(self.played[each]["return"])) for each in (start, CAUSAL, name)
        )
        means, least = self.means, self.means[start]
        return Estimate.of(
            (mean - low) / (high - low), (means[name] - least) / (means[CAUSAL] - least)
        )

    def _of_episodes(self, name: str) -> dict[str, Any]:
        """Return the numbers for tasks on one scenario."""
        episodes, scenario, compared = self.played[name], self.scenario, comparators(self.scenario)
        engaged, removed, edges = (
            episodes["engaged_time"],
            episodes["removed"],
            episodes["edges_used"],
        )
        minutes, cost_minutes = total_minutes(episodes, scenario), _cost_minutes(episodes, scenario)
        found: dict[str, Any] = {
            "over_fixed": self._difference(name, compared.fixed),
            "over_published": self._difference(name, compared.published),
            "score": self._score(name, compared.fixed),
            "minutes": float(np.mean(minutes)),
            "removal_rate": _share(removed, minutes),
            "excess": _share(episodes["excess"], engaged),
            "edges": float(np.mean(edges)),
            "broken_share": _share(episodes["edges_broken"], edges),
            "used_life": float(np.mean(episodes["used_life"])),
        }
        if name in self.costs:
            found["cost"] = Estimate.of(*self.costs[name])
        if name in self.costs and scenario.control.aim == "removal":
            all_minutes = cost_minutes - episodes["reward_overload"] / 60.0
            found["full_cost"] = Estimate.of(
                *_metal_cost(name, all_minutes, removed, self.bootstrap)
            )
        if scenario.control.action == "part":
            found["part_cost"] = _share(cost_minutes, episodes["steps"])
        if scenario.control.aim == "roughness":
            found["roughness_deviation"] = _share(episodes["roughness_deviation"], episodes["time"])
        return found

    def _of_jobs(self, name: str) -> dict[str, Any]:
        """Return the numbers for families."""
        episodes, returns = (
            self.played[name],
            {each: played["return"] for each, played in self.played.items()},
        )
        worth = episodes["reward_metal"]
        cost = worth - returns[name]
        costs = self.bootstrap.means(cost, name) / self.bootstrap.means(worth, name)
        overload = ratio(episodes["severe_overload_time"], episodes["engaged_time"])
        found: dict[str, Any] = {
            "full_cost_share": Estimate.of(cost.mean() / worth.mean(), costs),
            "worst_return": float(returns[name].min()),
            "feasible_jobs": float((overload <= self.scenario.limits.overload_allowance).mean()),
        }
        if {NOMINAL_OPTIMUM, CAUSAL} <= returns.keys():
            low, high = returns[NOMINAL_OPTIMUM].mean(axis=0), returns[CAUSAL].mean(axis=0)
            scores = (returns[name] - low) / (high - low)
            middle = self.bootstrap.interquartile_means(scores, name)
            found["job_score"] = Estimate.of(interquartile_mean(scores.ravel()).item(), middle)
        true = {
            each: float(returns[each].mean())
            for each, group in self.groups.items()
            if group[0].policy.knows == "true_laws"
        }
        return found | {"over_truth": self._difference(name, highest(true))}


def total_minutes(episodes: Mapping[str, Floats], scenario: Scenario) -> Floats:
    """Return the time [min] of each episode, with edge changes and the downtime of breakages.

    If an episode ends with its edge, ``time`` does not hold them. An episode that the time limit cuts off is charged the used
    share of a change.
    """
    economics = scenario.economics
    total: Floats = episodes["time"] / 60.0
    if scenario.control.edge_changes == "end":
        stops = (
            economics.edge_change_time * episodes["edges_used"]
            + economics.breakage_downtime * episodes["edges_broken"]
        )
        total = total + stops
    return total


def _share(parts: Floats, wholes: Floats) -> float:
    """Return the sum of ``parts`` over the sum of ``wholes``, and 0 if that is 0."""
    whole = float(np.sum(wholes))
    return float(np.sum(parts)) / whole if whole > 0.0 else 0.0
