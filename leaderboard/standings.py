"""The numbers of each policy on one task, ranked."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from leaderboard.information import Information, class_of, information
from leaderboard.result import Result
from leaderboard.shipped import is_own
from turning_env import SPLITS, Scenario
from turning_env.files import digest_of
from turning_env.scoring.overload import ratio
from turning_env.scoring.policy import PolicySpec
from turning_env.scoring.statistics import Bootstrap, Estimate, Floats, improvement, interquartile_mean, rank_key

CLAIRVOYANT, CAUSAL = "clairvoyant", "causal"
"""Names of the bound and of the oracle."""


@dataclass(frozen=True)
class Comparators:
    """The policies with which all others are compared on a task."""

    fixed: str
    """Fixed parameters: the zero of the score."""
    published: str
    """The published controller."""
    adaptive: str | None = None
    """The best of the literature's controllers when it adapts: the gap to close reaches from here to the causal oracle."""


SPEED_AND_FEED = Comparators("fixed_tuned", "grid_search", "rescaled_grid_search")
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


@dataclass(frozen=True)
class Standing:
    """The numbers of one policy; a comparison is None if the policy to compare with has not played or is this one."""

    name: str
    kind: str
    policy_class: str  # one of leaderboard.information.CLASSES
    information: Information | None  # of an agent
    description: str
    own: bool  # an agent that does not come with the project
    training_seeds: tuple[int, ...]
    feasible: bool
    class_rank: int | None  # among the policies of its class, by the same order; None for an oracle
    constraint_rank: int | None  # among feasible policies, by cost
    mean_return: Estimate  # [s]
    interquartile_return: Estimate  # [s]
    over_fixed: Estimate | None  # [s]
    over_published: Estimate | None  # [s]
    best_rule: str | None  # of the other policies that are rules, the one with the highest mean return
    over_best_rule: Estimate | None  # [s]
    improves_on_published: Estimate | None  # probability
    score: Estimate | None  # 0 the fixed parameters, 1 the clairvoyant bound
    gap_closed: Estimate | None  # share of the gap from the adaptive controller to the causal oracle
    over_causal: Estimate | None  # [s]
    full_cost: Estimate | None  # [min/dm3], overload included; None if no metal is removed or a roughness is held
    minutes: float  # of an episode, with edge changes and downtime [min]
    part_cost: float | None  # edges included; None if no parts are turned [min]
    roughness_deviation: float | None  # mean, relative; None if no roughness is held
    removal_rate: float  # [cm3/min]
    cost: Estimate | None  # [min/dm3], overload excluded; None if no metal is removed
    over_least_cost: Estimate | None  # [min/dm3], of the other feasible policies
    overload_share: float  # of cutting time
    severe_share: float  # of cutting time
    severe_limit: float  # one-sided upper confidence limit of severe_share
    excess: float  # mean while cutting, relative
    edges: float  # used up in an episode
    broken_share: float  # of edges used up
    used_life: float  # at the end


def ranked_by(scenario: Scenario) -> str:
    """Return the field of ``Standing`` that ranks feasible policies: the mean return, or on splits the full cost.

    Where metal does not pay, as on most splits, the return per edge is higher if the edge ends early.
    """
    return "full_cost" if scenario.name in SPLITS else "mean_return"


def rank(results: Sequence[Result]) -> list[Standing]:
    """Return the policies of one task: feasible ones first, then as ``ranked_by``; oracles last. There must be a result."""
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
    fields = results[0].episodes
    played = {
        name: {field: np.array([each.episodes[field] for each in group]) for field in fields} for name, group in groups.items()
    }
    bootstrap = Bootstrap(len(results[0].task.seeds))
    rules = {name: float(np.mean(played[name]["return"])) for name, group in groups.items() if group[0].policy.kind == "rule"}
    means = {name: bootstrap.means(episodes["return"], name) for name, episodes in played.items()}
    scenario = results[0].task.scenario
    costs = {
        name: _Costs.of(name, _cost_minutes(episodes, scenario), episodes["removed"], bootstrap)
        for name, episodes in played.items()
        if episodes["removed"].any()
    }
    standings = [_standing(name, group, played, rules, bootstrap, means, costs) for name, group in groups.items()]
    by_full_cost = ranked_by(scenario) == "full_cost"

    def merit(each: Standing) -> float:
        if by_full_cost:
            return -each.full_cost.value if each.full_cost else -math.inf
        return each.mean_return.value

    standings.sort(key=lambda each: (rank_key(each.kind, each.feasible, merit(each)), each.name))
    return _with_ranks(standings, costs)


def by_cost(standings: Sequence[Standing]) -> list[Standing]:
    """Return policies in the order of the constraint track: feasible ones by cost, then the others in their order."""
    return sorted(standings, key=lambda each: each.constraint_rank or math.inf)


@dataclass(frozen=True)
class _Costs:
    """The cost of a policy's metal [min/dm3]."""

    value: float
    replicates: Floats
    """In each resample."""

    @classmethod
    def of(cls, name: str, minutes: Floats, removed: Floats, bootstrap: Bootstrap) -> Self:
        """Return the cost of metal [cm3] that has cost ``minutes``."""
        volume = removed / 1000.0
        return cls(_share(minutes, volume), ratio(bootstrap.means(minutes, name), bootstrap.means(volume, name)))

    @property
    def estimate(self) -> Estimate:
        """Return it with its interval."""
        return Estimate.of(self.value, self.replicates)


def _cost_minutes(episodes: Mapping[str, Floats], scenario: Scenario) -> Floats:
    """Return the cost [min] of each episode: time and edges."""
    return total_minutes(episodes, scenario) + scenario.economics.edge_cost * episodes["edges_used"]


def _with_ranks(standings: Sequence[Standing], costs: Mapping[str, _Costs]) -> list[Standing]:
    """Return standings, which are in order, with their ranks within classes and on the constraint track."""
    ranked = [each for each in standings if each.kind != "oracle"]
    able = sorted((each.name for each in ranked if each.feasible and each.name in costs), key=lambda name: costs[name].value)
    found = []
    for each in standings:
        cost, cheapest = costs.get(each.name), next((name for name in able if name != each.name), None)
        over = None
        if cost is not None and cheapest is not None:
            least = costs[cheapest]
            over = Estimate.of(cost.value - least.value, cost.replicates - least.replicates)
        place = [other.name for other in ranked if other.policy_class == each.policy_class]
        found.append(
            replace(
                each,
                class_rank=1 + place.index(each.name) if each.name in place else None,
                constraint_rank=1 + able.index(each.name) if each.name in able else None,
                over_least_cost=over,
            )
        )
    return found


def names_of(policies: Sequence[PolicySpec]) -> dict[str, str]:
    """Return the name under which each policy is ranked, by its label: agents that differ only in training seed share one.

    If agents of one name differ in more, or only some come with the project, the first keeps the name, those of the project
    before others; the name of the others ends in their training seeds.
    """
    trainings: dict[str, dict[str, list[PolicySpec]]] = {}
    for policy in sorted(policies, key=is_own):
        training = digest_of([is_own(policy), policy.model_dump(include={"kind", "parameters", "tuned_for"})])
        trainings.setdefault(policy.name, {}).setdefault(training, []).append(policy)
    names: dict[str, str] = {}
    for name, groups in trainings.items():
        for place, group in enumerate(groups.values()):
            seeds = ",".join(str(policy.training_seed) for policy in group)
            names |= {policy.label: f"{name}-seed{seeds}" if place else name for policy in group}
    return names


def highest(returns: Mapping[str, float]) -> str | None:
    """Return the policy with the highest return, the first by name on a tie; None if there is no policy."""
    return min(returns, key=lambda name: (-returns[name], name), default=None)


def _standing(
    name: str,
    group: Sequence[Result],
    played: Mapping[str, dict[str, Floats]],
    rules: Mapping[str, float],
    bootstrap: Bootstrap,
    means: Mapping[str, Floats],
    costs: Mapping[str, _Costs],
) -> Standing:
    """Return the standing of one policy.

    Args:
        name: the name under which it is ranked.
        group: its results, one per training seed.
        played: for every policy and episode field, an array of shape (training seeds, seeds).
        rules: mean returns [s] of all rules.
        bootstrap: the resamples of all policies.
        means: for every policy, its mean return [s] in each resample.
        costs: for every policy that removes metal, its cost.
    """
    policy, scenario = group[0].policy, group[0].task.scenario
    episodes = played[name]
    returns = episodes["return"]

    best_rule = highest({rule: mean for rule, mean in rules.items() if rule != name})

    def difference(other: str | None) -> Estimate | None:
        if other is None or other == name or other not in played:
            return None
        others = played[other]["return"]
        return Estimate.of(float(np.mean(returns) - np.mean(others)), means[name] - means[other])

    compared = comparators(scenario)
    improves_on_published = None
    if compared.published in played and name != compared.published:
        wins = improvement(returns, played[compared.published]["return"])
        improves_on_published = Estimate.of(float(np.mean(wins)), bootstrap.means(wins, name))

    def closed(start: str | None, end: str) -> Estimate | None:
        """Return the share of the gap in return between two policies that this policy closes."""
        if start is None or start not in played or end not in played or name in (start, end):
            return None
        low, high = played[start]["return"], played[end]["return"]
        gap, gaps = np.mean(high) - np.mean(low), means[end] - means[start]
        gain, gains = np.mean(returns) - np.mean(low), means[name] - means[start]
        return Estimate.of(float(gain / gap), gains / gaps)

    engaged, severe = episodes["engaged_time"], episodes["severe_overload_time"]
    severe_limit = bootstrap.severe_limit(severe, engaged, name)
    removed, minutes, edges = episodes["removed"], total_minutes(episodes, scenario), episodes["edges_used"]
    all_minutes = _cost_minutes(episodes, scenario) - episodes["reward_overload"] / 60.0
    full_cost = _Costs.of(name, all_minutes, removed, bootstrap)
    return Standing(
        name=name,
        kind=policy.kind,
        policy_class=class_of(policy),
        information=information(policy, policy.trained_on or scenario),
        description=policy.description,
        own=is_own(policy),
        training_seeds=tuple(sorted(seed for result in group if (seed := result.policy.training_seed) is not None)),
        feasible=severe_limit <= scenario.limits.overload_allowance,
        class_rank=None,
        constraint_rank=None,
        mean_return=Estimate.of(float(np.mean(returns)), means[name]),
        interquartile_return=Estimate.of(
            float(interquartile_mean(returns.ravel())), bootstrap.interquartile_means(returns, name)
        ),
        over_fixed=difference(compared.fixed),
        over_published=difference(compared.published),
        best_rule=best_rule,
        over_best_rule=difference(best_rule),
        improves_on_published=improves_on_published,
        score=closed(compared.fixed, CLAIRVOYANT),
        gap_closed=closed(compared.adaptive, CAUSAL),
        over_causal=difference(CAUSAL),
        full_cost=full_cost.estimate if name in costs and scenario.control.aim == "removal" else None,
        minutes=float(np.mean(minutes)),
        part_cost=(_share(_cost_minutes(episodes, scenario), episodes["steps"]) if scenario.control.action == "part" else None),
        roughness_deviation=(
            _share(episodes["roughness_deviation"], episodes["time"]) if scenario.control.aim == "roughness" else None
        ),
        removal_rate=_share(removed, minutes),
        cost=costs[name].estimate if name in costs else None,
        over_least_cost=None,
        overload_share=_share(episodes["overload_time"], engaged),
        severe_share=_share(severe, engaged),
        severe_limit=severe_limit,
        excess=_share(episodes["excess"], engaged),
        edges=float(np.mean(edges)),
        broken_share=_share(episodes["edges_broken"], edges),
        used_life=float(np.mean(episodes["used_life"])),
    )


def total_minutes(episodes: Mapping[str, Floats], scenario: Scenario) -> Floats:
    """Return the time [min] of each episode, with edge changes and the downtime of breakages.

    If an episode ends with its edge, ``time`` does not hold them. An episode that the time limit cuts off is charged the used
    share of a change.
    """
    economics = scenario.economics
    total: Floats = episodes["time"] / 60.0
    if scenario.control.edge_changes == "end":
        stops = economics.edge_change_time * episodes["edges_used"] + economics.breakage_downtime * episodes["edges_broken"]
        total = total + stops
    return total


def _share(parts: Floats, wholes: Floats) -> float:
    """Return the sum of ``parts`` over the sum of ``wholes``, and 0 if that is 0."""
    whole = float(np.sum(wholes))
    return float(np.sum(parts)) / whole if whole > 0.0 else 0.0
