"""The numbers of each policy on one task, ranked.

Estimates, intervals and feasibility come from ``leaderboard.statistics``. Which results are
ranked together is the matter of ``leaderboard.ranking``.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from baselines.catalogue import RULES
from baselines.comparators import CAUSAL, comparators
from baselines.policy_spec import PolicySpec
from leaderboard.agents.agent_file import description_of_training
from leaderboard.inputs import Inputs, class_of
from leaderboard.policies import is_external
from leaderboard.result import ExcessShares, Result
from leaderboard.statistics import (
    Bootstrap,
    Estimate,
    Feasibility,
    Floats,
    Mean,
    RankKey,
    feasibility,
    interquartile_mean,
    rank_key,
    ratio,
    reason_not_to_rank,
    score_of,
)
from turning_env import SPLITS, Scenario
from turning_env.files import digest_of

LARGEST = 3
"""Number of the largest differences that a mean leaves out, to show whether a few seeds decide."""


@dataclass(frozen=True)
class Standing:
    """The numbers of one policy; a number is None if it does not apply to the task.

    A comparison is also None if the policy to compare with has not played or is this one.
    """

    name: str
    kind: str
    policy_class: str  # one of leaderboard.inputs.CLASSES
    inputs: Inputs | None  # of an agent
    description: str
    own: bool  # an agent or code that does not come with the project; ``show --json`` has the name
    training_seeds: tuple[int, ...]
    unranked: str | None  # why it has no rank; None if it has one
    feasible: bool
    # "not shown" if the allowance lies between the confidence limits of severe_share.
    feasibility: Feasibility
    mean_return: Estimate  # [s]
    interquartile_return: Estimate  # [s]
    severe_share: float  # of cutting time
    severe_lower_limit: float  # one-sided lower confidence limit of severe_share
    severe_limit: float  # one-sided upper confidence limit of severe_share
    # The feasible rule with the highest mean return among the others; the best if none is feasible.
    best_rule: str | None
    over_best_rule: Estimate | None  # [s]
    over_causal: Estimate | None  # [s]
    median_over_best_rule: float | None = None  # over seeds [s]
    # Mean over all seeds but the LARGEST with the largest differences [s].
    over_best_rule_without_largest: float | None = None
    beats_best_rule: float | None = None  # share of seeds
    # Among the policies of its class, by the same order; None if it is unranked.
    class_rank: int | None = None
    constraint_rank: int | None = None  # among feasible policies, by cost
    over_fixed: Estimate | None = None  # [s]
    over_published: Estimate | None = None  # [s]
    score: Estimate | None = None  # 0 the best fixed parameters, 100 the causal oracle
    # Overload included [min/dm3]; None if no metal is removed or a roughness is held.
    full_cost: Estimate | None = None
    minutes: float | None = None  # of an episode, with edge changes and downtime [min]
    part_cost: float | None = None  # edges included; None if no parts are turned [min]
    roughness_deviation: float | None = None  # mean, relative; None if no roughness is held
    removal_rate: float | None = None  # [cm3/min]
    cost: Estimate | None = None  # [min/dm3], overload excluded; None if no metal is removed
    over_least_cost: Estimate | None = None  # [min/dm3], of the other feasible policies
    overload_share: float | None = None  # of cutting time
    share_above_2_percent: float | None = None  # of cutting time; None if a result lacks it
    share_above_10_percent: float | None = None  # of cutting time; None if a result lacks it
    excess: float | None = None  # mean while cutting, relative
    edges: float | None = None  # used up in an episode
    broken_share: float | None = None  # of edges used up
    used_life: float | None = None  # at the end
    # The following are of families, whose volumes and edges do not add up.
    # Cost of time, edges, overload and breakage over the worth of the metal; None if some resample
    # of the jobs removes no metal.
    full_cost_share: Estimate | None = None
    over_truth: Estimate | None = None  # over the best rule with true laws [s]
    worst_return: float | None = None  # of a job [s]
    feasible_jobs: float | None = None  # share of jobs


def ranked_by(scenario: Scenario) -> str:
    """Return the field of ``Standing`` that ranks feasible policies on a scenario.

    It is the mean return, or on splits the full cost. Where metal does not pay, as on most splits,
    the return per edge is higher if the edge ends early.
    """
    return "full_cost" if scenario.name in SPLITS else "mean_return"


def rank(results: Sequence[Result]) -> list[Standing]:
    """Return the standings of all policies of one task, given at least one result.

    Feasible policies come first, in the order of ``ranked_by``. Policies without a rank follow the
    infeasible ones; oracles come last.
    """
    names = names_of([result.policy for result in results])
    results_by_name: dict[str, list[Result]] = {}
    for result in results:
        results_by_name.setdefault(names[result.policy.label], []).append(result)
    comparison = _Comparison(results_by_name)
    standings = [comparison.standing(name) for name in results_by_name]
    field = ranked_by(comparison.scenario)
    standings.sort(key=lambda standing: (_rank_key(standing, field), standing.name))
    return _with_ranks(standings, comparison.metal_costs)


def _rank_key(standing: Standing, field: str) -> RankKey:
    """Return the key by which standings are sorted."""
    if field == "mean_return":
        merit = standing.mean_return.value
    elif standing.full_cost is not None:
        merit = -standing.full_cost.value
    else:
        merit = -math.inf
    return rank_key(standing.kind, standing.feasible, merit=merit, unranked=standing.unranked)


def _with_ranks(standings: Sequence[Standing], metal_costs: Mapping[str, Mean]) -> list[Standing]:
    """Return sorted standings with their ranks within classes and on the constraint track."""
    # Oracles and, where learning games the task, agents are shown, but do not take part in the
    # ranking.
    ranked = [standing for standing in standings if standing.unranked is None]

    # The constraint track ranks feasible policies by the cost of their metal.
    by_cost = [
        standing.name for standing in ranked if standing.feasible and standing.name in metal_costs
    ]
    by_cost.sort(key=lambda name: metal_costs[name].value)

    with_ranks = []
    for standing in standings:
        same_class = [peer.name for peer in ranked if peer.policy_class == standing.policy_class]
        with_ranks.append(
            replace(
                standing,
                class_rank=_place(standing.name, same_class),
                constraint_rank=_place(standing.name, by_cost),
                over_least_cost=_over_cheapest_other(standing.name, by_cost, metal_costs),
            )
        )
    return with_ranks


def _place(name: str, order: Sequence[str]) -> int | None:
    """Return the place of a name in an order, from 1; None if it is not there."""
    return 1 + order.index(name) if name in order else None


def _over_cheapest_other(
    name: str, by_cost: Sequence[str], metal_costs: Mapping[str, Mean]
) -> Estimate | None:
    """Return the cost of a policy less that of the cheapest other feasible one [min/dm3]."""
    others = [other for other in by_cost if other != name]
    if name not in metal_costs or not others:
        return None
    cost = metal_costs[name]
    least = metal_costs[others[0]]
    return Estimate.of(cost.value - least.value, cost.replicates - least.replicates)


def names_of(policies: Sequence[PolicySpec]) -> dict[str, str]:
    """Return the name under which each policy is ranked, by its label.

    Agents that differ only in training seed share a name. If agents of one name differ in more, or
    only some come with the project, the first keeps the name, those of the project before others.
    The names of the others end in their training seeds.
    """
    trainings_by_title: dict[str, dict[str, list[PolicySpec]]] = {}
    for policy in sorted(policies, key=is_external):
        # Agents whose trainings differ only in their seed have the same digest.
        training = policy.model_dump(include={"kind", "tuned_for", "parameters"})
        digest = digest_of([is_external(policy), training])
        trainings = trainings_by_title.setdefault(policy.title, {})
        trainings.setdefault(digest, []).append(policy)

    names: dict[str, str] = {}
    for title, trainings in trainings_by_title.items():
        for place, same_training in enumerate(trainings.values()):
            name = title
            if place > 0:
                seeds = [str(policy.training_seed) for policy in same_training]
                name = f"{title}-seed{','.join(seeds)}"
            for policy in same_training:
                names[policy.label] = name
    return names


def _description(policy: PolicySpec) -> str:
    """Return the description of a policy.

    That of a policy of the project follows from the present code, as results may hold older words.
    """
    if policy.name in RULES:
        return RULES[policy.name].description
    if policy.kind == "agent" and not is_external(policy) and policy.tuned_for is not None:
        steps = policy.parameters.get("total_timesteps")
        return description_of_training(policy.parameters, steps, policy.tuned_for.name)
    return policy.description


def highest(returns: Mapping[str, float]) -> str | None:
    """Return the policy with the highest return, the first by name on a tie; None without any."""
    return min(returns, key=lambda name: (-returns[name], name), default=None)


def best_rule(standings: Sequence[Standing]) -> Standing | None:
    """Return the rule with the highest mean return, a feasible one if any is; None without any."""
    rules = {standing.name: standing for standing in standings if standing.kind == "rule"}
    returns = {name: rule.mean_return.value for name, rule in rules.items()}
    feasible = {name: value for name, value in returns.items() if rules[name].feasible}
    best = highest(feasible or returns)
    return None if best is None else rules[best]


class SevereLimits(NamedTuple):
    """One-sided confidence limits of the share of severe overload [-]."""

    lower: float
    upper: float


class _Played:
    """The episodes of one policy on a task, by its results: one per training seed; a rule has one.

    Arrays have shape (training seeds, seeds), bootstrap replicates shape (resamples,).
    """

    def __init__(self, name: str, results: Sequence[Result], bootstrap: Bootstrap) -> None:
        self.name = name
        self.results = results
        self.policy = results[0].policy
        self.scenario = results[0].task.scenario
        self.bootstrap = bootstrap
        self.episodes = {
            field: np.array([result.episodes[field] for result in results])
            for field in results[0].episodes
        }
        self.returns = self.episodes["return"]
        self.mean = Mean(float(np.mean(self.returns)), bootstrap.means(self.returns, name))
        severe_time = self.episodes["severe_overload_time"]
        engaged_time = self.episodes["engaged_time"]
        lower, upper = bootstrap.severe_limits(severe_time, engaged_time, name)
        self.severe_limits = SevereLimits(lower, upper)
        allowance = self.scenario.limits.overload_allowance
        self.feasibility: Feasibility = feasibility(self.severe_limits, allowance)

    @property
    def is_rule(self) -> bool:
        """Return whether others are compared with it as a rule; one that forgets is a variant."""
        return self.policy.kind == "rule" and not self.policy.forgets

    def share_of_cutting(self, field: str) -> float:
        """Return the sum of a field of the episodes over cutting time."""
        return _share(self.episodes[field], self.episodes["engaged_time"])

    def interquartile(self, values: Floats) -> Estimate:
        """Return the interquartile mean of values of shape (training seeds, seeds)."""
        # The bootstrap takes the name, as each policy has resamples of its training seeds of its
        # own: the training seeds of two policies are unrelated, even if they are equal numbers.
        mean = interquartile_mean(values.ravel()).item()
        return Estimate.of(mean, self.bootstrap.interquartile_means(values, self.name))

    def metal_cost(self, *, with_overload: bool) -> Mean:
        """Return the cost of the metal that the policy has removed."""
        minutes = _cost_minutes(self.episodes, self.scenario)
        if with_overload:
            # The reward of overload is negative, in seconds.
            minutes = minutes - self.episodes["reward_overload"] / 60.0
        minutes_replicates = self.bootstrap.means(minutes, self.name)
        cost = _share(minutes, self.volume)
        return Mean(cost, ratio(minutes_replicates, self.volume_replicates))

    @cached_property
    def volume(self) -> Floats:
        """The metal that each episode removed [dm3], shape (training seeds, seeds)."""
        return np.asarray(self.episodes["removed"] / 1000.0)  # cm3 to dm3

    @cached_property
    def volume_replicates(self) -> Floats:
        """The replicates of its mean, shape (resamples,)."""
        return self.bootstrap.means(self.volume, self.name)

    def excess_shares(self) -> ExcessShares | None:
        """Return the shares of cutting time over a limit; None if a result lacks them."""
        engaged_time = 0.0
        above_2_percent = 0.0
        above_10_percent = 0.0
        for result in self.results:
            if result.excess is None:
                return None
            engaged = float(np.sum(result.episodes["engaged_time"]))
            engaged_time += engaged
            above_2_percent += engaged * result.excess.above_2_percent
            above_10_percent += engaged * result.excess.above_10_percent
        if engaged_time <= 0.0:
            return ExcessShares(above_2_percent=0.0, above_10_percent=0.0)
        return ExcessShares(
            above_2_percent=above_2_percent / engaged_time,
            above_10_percent=above_10_percent / engaged_time,
        )


class _Comparison:
    """Policies on one task, and what is compared between them."""

    def __init__(self, results_by_name: Mapping[str, Sequence[Result]]) -> None:
        first = next(iter(results_by_name.values()))[0]
        self.task = first.task
        self.scenario = first.task.scenario
        on_family = self.task.of_family is not None
        self.comparators = comparators(self.scenario, on_family=on_family)
        bootstrap = Bootstrap(len(first.task.seeds))
        self.played = {
            name: _Played(name, results, bootstrap) for name, results in results_by_name.items()
        }
        self.metal_costs: dict[str, Mean] = {}
        if self.task.of_family is None:
            for name, played in self.played.items():
                if played.episodes["removed"].any():
                    self.metal_costs[name] = played.metal_cost(with_overload=False)

    def standing(self, name: str) -> Standing:
        """Return the standing of one policy, without its ranks."""
        played = self.played[name]
        standing = self._common_numbers(played)
        if standing.best_rule is not None:
            best_rule = self.played[standing.best_rule]
            standing = _with_leads(standing, played, best_rule)
        if self.task.of_family is not None:
            return self._with_job_numbers(standing, played)
        return self._with_episode_numbers(standing, played)

    def _common_numbers(self, played: _Played) -> Standing:
        """Return a standing with the numbers of all tasks."""
        policy = played.policy
        inputs = None
        if policy.kind == "agent":
            inputs = Inputs.of(policy.parameters).on(policy.trained_on or self.scenario)
        seeds = sorted(result.policy.training_seed or 0 for result in played.results)
        best_rule = self._best_other_rule(played.name)
        excess = played.excess_shares()
        # Older results on families lack the time over a limit.
        overload_share = None
        if "overload_time" in played.episodes:
            overload_share = played.share_of_cutting("overload_time")
        return Standing(
            name=played.name,
            kind=policy.kind,
            policy_class=class_of(policy),
            inputs=inputs,
            description=_description(policy),
            own=is_external(policy),
            training_seeds=tuple(seeds) if policy.kind == "agent" else (),
            unranked=reason_not_to_rank(policy.kind, self.scenario),
            feasible=played.feasibility == "feasible",
            feasibility=played.feasibility,
            mean_return=played.mean.estimate,
            interquartile_return=played.interquartile(played.returns),
            severe_share=played.share_of_cutting("severe_overload_time"),
            severe_lower_limit=played.severe_limits.lower,
            severe_limit=played.severe_limits.upper,
            best_rule=best_rule,
            over_best_rule=self._difference(played, best_rule),
            over_causal=self._difference(played, CAUSAL),
            score=self._score(played),
            overload_share=overload_share,
            share_above_2_percent=None if excess is None else excess.above_2_percent,
            share_above_10_percent=None if excess is None else excess.above_10_percent,
        )

    def _best_other_rule(self, name: str) -> str | None:
        """Return the other rule with the highest mean return, a feasible one if there is any."""
        returns = {}
        feasible = {}
        for rule, played in self.played.items():
            if rule == name or not played.is_rule:
                continue
            returns[rule] = played.mean.value
            if played.feasibility == "feasible":
                feasible[rule] = played.mean.value
        return highest(feasible or returns)

    def _difference(self, played: _Played, other_name: str | None) -> Estimate | None:
        """Return the difference of two policies' mean returns [s]."""
        if other_name is None or other_name == played.name or other_name not in self.played:
            return None
        other = self.played[other_name]
        replicates = played.mean.replicates - other.mean.replicates
        return Estimate.of(played.mean.value - other.mean.value, replicates)

    def _score(self, played: _Played) -> Estimate | None:
        """Return the place of the mean return between the best fixed parameters and the oracle."""
        fixed = self.played.get(self.comparators.fixed)
        causal = self.played.get(CAUSAL)
        if fixed is None or causal is None:
            return None
        score = score_of(played.mean, fixed=fixed.mean, oracle=causal.mean)
        return None if score is None else score.estimate

    def _with_episode_numbers(self, standing: Standing, played: _Played) -> Standing:
        """Add the numbers of tasks on one scenario."""
        control = self.scenario.control
        compared = self.comparators
        episodes = played.episodes
        edges = episodes["edges_used"]
        minutes = total_minutes(episodes, self.scenario)
        standing = replace(
            standing,
            over_fixed=self._difference(played, compared.fixed),
            over_published=self._difference(played, compared.published),
            minutes=float(np.mean(minutes)),
            removal_rate=_share(episodes["removed"], minutes),
            excess=played.share_of_cutting("excess"),
            edges=float(np.mean(edges)),
            broken_share=_share(episodes["edges_broken"], edges),
            used_life=float(np.mean(episodes["used_life"])),
        )
        if played.name in self.metal_costs:
            standing = replace(standing, cost=self.metal_costs[played.name].estimate)
        if played.name in self.metal_costs and control.aim == "removal":
            full_cost = played.metal_cost(with_overload=True)
            standing = replace(standing, full_cost=full_cost.estimate)
        if control.action == "part":  # a step is a part
            part_cost = _share(_cost_minutes(episodes, self.scenario), episodes["steps"])
            standing = replace(standing, part_cost=part_cost)
        if control.aim == "roughness":
            deviation = _share(episodes["roughness_deviation"], episodes["time"])
            standing = replace(standing, roughness_deviation=deviation)
        return standing

    def _with_job_numbers(self, standing: Standing, played: _Played) -> Standing:
        """Add the numbers of families."""
        episodes = played.episodes
        worth = episodes["reward_metal"]
        cost = worth - played.returns
        cost_replicates = played.bootstrap.means(cost, played.name)
        worth_replicates = played.bootstrap.means(worth, played.name)
        severe_share = ratio(episodes["severe_overload_time"], episodes["engaged_time"])
        is_feasible = severe_share <= self.scenario.limits.overload_allowance
        with_true_laws = {
            other.name: other.mean.value
            for other in self.played.values()
            if other.policy.knows == "true_laws"
        }
        full_cost_share = None
        # A resample without metal has no such share.
        if np.all(worth_replicates > 0.0):
            share = cost.mean() / worth.mean()
            full_cost_share = Estimate.of(share, cost_replicates / worth_replicates)
        return replace(
            standing,
            full_cost_share=full_cost_share,
            over_truth=self._difference(played, highest(with_true_laws)),
            worst_return=float(played.returns.min()),
            feasible_jobs=float(is_feasible.mean()),
        )


def _with_leads(standing: Standing, played: _Played, other: _Played) -> Standing:
    """Add the numbers of the lead over another policy, seed by seed."""
    leads = played.returns.mean(axis=0) - other.returns.mean(axis=0)
    largest_first = np.argsort(-np.abs(leads), kind="stable")
    without_largest = leads[largest_first[LARGEST:]]
    mean_without_largest = float(without_largest.mean()) if without_largest.size else None
    return replace(
        standing,
        median_over_best_rule=float(np.median(leads)),
        over_best_rule_without_largest=mean_without_largest,
        beats_best_rule=float((leads > 0.0).mean()),
    )


def total_minutes(episodes: Mapping[str, Floats], scenario: Scenario) -> Floats:
    """Return the time [min] of each episode, with edge changes and the downtime of breakages.

    If an episode ends with its edge, ``time`` does not hold them. An episode that the time limit
    cuts off is charged the used share of a change.
    """
    economics = scenario.economics
    total: Floats = episodes["time"] / 60.0
    if scenario.control.edge_changes != "end":
        return total
    stops = (
        economics.edge_change_time * episodes["edges_used"]
        + economics.breakage_downtime * episodes["edges_broken"]
    )
    return np.asarray(total + stops)


def _cost_minutes(episodes: Mapping[str, Floats], scenario: Scenario) -> Floats:
    """Return the cost [min] of each episode: time and edges."""
    return total_minutes(episodes, scenario) + scenario.economics.edge_cost * episodes["edges_used"]


def _share(parts: Floats, wholes: Floats) -> float:
    """Return the sum of ``parts`` over the sum of ``wholes``, and 0 if that is 0."""
    whole = float(np.sum(wholes))
    return float(np.sum(parts)) / whole if whole > 0.0 else 0.0
