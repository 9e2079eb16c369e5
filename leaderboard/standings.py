"""The standing of each policy among those that have played the same seeds.

``rank`` computes every number once. Tables, the page, model cards, scores over tasks and
``leaderboard.score`` show the same record, ``Standing``. Estimates, intervals and feasibility come
from ``leaderboard.statistics``. Which results are ranked together belongs to
``leaderboard.ranking``.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from baselines.comparators import CAUSAL, Comparators, comparators
from baselines.policy_spec import Knowledge
from leaderboard.inputs import Inputs
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
from turning_env.scenario.laws import machining_cost

LARGEST = 3
"""Number of the largest differences that a mean leaves out, to show whether a few seeds decide."""


@dataclass(frozen=True)
class About:
    """What a policy is, and what it is given."""

    policy_class: str = ""  # one of leaderboard.inputs.CLASSES
    inputs: Inputs | None = None  # of an agent
    description: str = ""
    # An agent or code that does not come with the project; ``show --json`` has the name.
    own: bool = False
    training_seeds: tuple[int, ...] = ()  # of an agent
    knows: Knowledge = "nominal"
    forgets: bool = False


@dataclass(frozen=True)
class Played:
    """The episodes of one policy on the seeds of a task, by all its trainings."""

    name: str
    kind: str  # rule, agent or oracle
    # By name of the field, as in ``leaderboard.play.EPISODE_FIELDS``; shape (training seeds,
    # seeds), with one row for a rule. Shipped files hold few fields.
    episodes: Mapping[str, Floats]
    about: About | None = None
    """None: only the name is known. Then the standing has no leads, costs and operation."""
    # Shares of cutting time above a limit by more than 2 % and 10 % [-]; None: not recorded.
    share_above_2_percent: float | None = None
    share_above_10_percent: float | None = None

    @property
    def returns(self) -> Floats:
        """Return of each episode [s], shape (training seeds, seeds)."""
        return self.episodes["return"]


@dataclass(frozen=True)
class Overload:
    """Shares of cutting time over a limit [-], and whether they are feasible."""

    # "not shown" if the allowance lies between the confidence limits of severe_share.
    feasibility: Feasibility
    severe_share: float  # above a limit by more than its tolerance
    severe_lower_limit: float  # one-sided lower confidence limit of severe_share
    severe_limit: float  # one-sided upper confidence limit of severe_share
    overload_share: float | None  # above a limit; None if a result lacks it, as those below
    share_above_2_percent: float | None
    share_above_10_percent: float | None
    excess: float | None  # mean excess over the limits while cutting, relative


@dataclass(frozen=True)
class Leads:
    """Returns less those of other policies on the same seeds [s].

    A lead is None if the other has not played or is this policy.
    """

    # The feasible rule with the highest mean return among the others; the best if none is feasible.
    best_rule: str | None = None
    over_best_rule: Estimate | None = None
    median_over_best_rule: float | None = None  # over seeds
    # Mean over all seeds but the LARGEST with the largest differences.
    over_best_rule_without_largest: float | None = None
    beats_best_rule: float | None = None  # share of seeds
    over_causal: Estimate | None = None
    over_fixed: Estimate | None = None
    over_published: Estimate | None = None
    over_truth: Estimate | None = None  # on a family, over the best rule with true laws


@dataclass(frozen=True)
class Costs:
    """Costs of metal in machine time. A cost is None if it does not apply to the task."""

    cost: Mean | None = None  # [min/dm3], overload excluded; None if no metal is removed
    over_least_cost: Estimate | None = None  # [min/dm3], over the cheapest other feasible policy
    full_cost: Mean | None = None  # [min/dm3], overload included; None if a roughness is held
    # On a family, whose volumes do not add up: cost of time, edges, overload and breakage over the
    # worth of the metal; None if some resample of the jobs removes no metal.
    full_cost_share: Estimate | None = None
    part_cost: float | None = None  # [min], edges included; None if no parts are turned


@dataclass(frozen=True)
class Operation:
    """What happens at the machine. A number is None if it does not apply to the task."""

    minutes: float | None = None  # of an episode, with edge changes and downtime [min]
    removal_rate: float | None = None  # [cm3/min]
    roughness_deviation: float | None = None  # mean, relative; None if no roughness is held
    edges: float | None = None  # used up in an episode
    broken_share: float | None = None  # of edges used up
    used_life: float | None = None  # at the end of an episode
    worst_return: float | None = None  # of a family's job [s]
    feasible_jobs: float | None = None  # share of a family's jobs


@dataclass(frozen=True)
class Standing:
    """The numbers of one policy among those that have played the same seeds."""

    name: str
    kind: str  # rule, agent or oracle
    about: About
    unranked: str | None  # why it has no rank; None if it has one
    returns: Floats = field(repr=False)  # [s], shape (training seeds, seeds)
    mean_return: Mean  # [s]
    overload: Overload
    interquartile_return: Estimate | None = None  # [s]
    score: Mean | None = None  # 0 the best fixed parameters, 100 the causal oracle
    leads: Leads = Leads()
    costs: Costs = Costs()
    operation: Operation = Operation()
    rank: int | None = None  # None if it is unranked
    # Among the policies of its class, by the same order; None if it is unranked.
    class_rank: int | None = None
    constraint_rank: int | None = None  # among feasible policies, by cost

    @property
    def feasible(self) -> bool:
        """Whether the policy is shown to be feasible."""
        return self.overload.feasibility == "feasible"

    @property
    def is_rule(self) -> bool:
        """Whether others are compared with it as a rule; one that forgets is a variant."""
        return self.kind == "rule" and not self.about.forgets

    def ahead_of(self, other: "Standing") -> Estimate:
        """Return this policy's mean return less another's on the same seeds [s]."""
        return Estimate.of(
            self.mean_return.value - other.mean_return.value,
            self.mean_return.replicates - other.mean_return.replicates,
        )


def ranked_by(scenario: Scenario) -> str:
    """Return the number of a standing that ranks feasible policies on a scenario.

    It is the mean return, or on splits the full cost. Where metal does not pay, as on most splits,
    the return per edge is higher if the edge ends early.
    """
    return "full_cost" if scenario.name in SPLITS else "mean_return"


def rank_together(
    policies: Sequence[Played], scenario: Scenario, *, on_family: bool
) -> list[Standing]:
    """Return the standings of all policies that have played the same seeds.

    Feasible policies come first, in the order of ``ranked_by``. Policies without a rank follow the
    infeasible ones; oracles come last.

    Args:
        policies: episodes of each policy, by different names; at least one.
        scenario: the scenario that they play, or that of a family's task.
        on_family: whether each seed is a job of a family.
    """
    bootstrap = Bootstrap(policies[0].returns.shape[1])
    by_name: dict[str, Standing] = {}
    for played in policies:
        by_name[played.name] = _alone(played, scenario, bootstrap, on_family=on_family)

    compared = comparators(scenario, on_family=on_family)
    standings = []
    for played in policies:
        standing = by_name[played.name]
        score = _score(standing, by_name.get(compared.fixed), by_name.get(CAUSAL))
        leads = Leads()
        if played.about is not None:
            leads = _leads(standing, by_name, compared, on_family=on_family)
        standings.append(replace(standing, score=score, leads=leads))

    order = ranked_by(scenario)
    standings.sort(key=lambda standing: (_rank_key(standing, order), standing.name))
    return _with_ranks(standings)


def _alone(
    played: Played, scenario: Scenario, bootstrap: Bootstrap, *, on_family: bool
) -> Standing:
    """Return a standing with the numbers that do not depend on other policies."""
    standing = Standing(
        name=played.name,
        kind=played.kind,
        about=played.about or About(),
        unranked=reason_not_to_rank(played.kind, scenario),
        returns=played.returns,
        mean_return=_mean(played.returns, bootstrap, played.name),
        overload=_overload(played, scenario, bootstrap),
    )
    if played.about is None:
        return standing
    # The bootstrap takes the name, as each policy has resamples of its training seeds of its
    # own: the training seeds of two policies are unrelated, even if they are equal numbers.
    interquartile_return = Estimate.of(
        interquartile_mean(played.returns.ravel()).item(),
        bootstrap.interquartile_means(played.returns, played.name),
    )
    standing = replace(standing, interquartile_return=interquartile_return)
    if on_family:
        costs = Costs(full_cost_share=_full_cost_share(played, bootstrap))
        return replace(standing, costs=costs, operation=_operation_on_jobs(played, scenario))
    costs = _costs(played, scenario, bootstrap)
    return replace(standing, costs=costs, operation=_operation(played, scenario))


def _mean(values: Floats, bootstrap: Bootstrap, name: str) -> Mean:
    return Mean(float(np.mean(values)), bootstrap.means(values, name))


def _overload(played: Played, scenario: Scenario, bootstrap: Bootstrap) -> Overload:
    """Return the shares of cutting time over a limit, and the verdict."""
    severe_time = played.episodes["severe_overload_time"]
    engaged_time = played.episodes["engaged_time"]
    limits = bootstrap.severe_limits(severe_time, engaged_time, played.name)
    lower, upper = limits
    return Overload(
        feasibility=feasibility(limits, scenario.limits.overload_allowance),
        severe_share=_share(severe_time, engaged_time),
        severe_lower_limit=lower,
        severe_limit=upper,
        overload_share=_share_of_cutting(played, "overload_time"),
        share_above_2_percent=played.share_above_2_percent,
        share_above_10_percent=played.share_above_10_percent,
        excess=_share_of_cutting(played, "excess"),
    )


def _share_of_cutting(played: Played, field: str) -> float | None:
    """Return the sum of a field of the episodes over cutting time; None if they lack it."""
    if field not in played.episodes:
        return None
    return _share(played.episodes[field], played.episodes["engaged_time"])


def _costs(played: Played, scenario: Scenario, bootstrap: Bootstrap) -> Costs:
    """Return the costs of the metal that a policy has removed on one scenario."""
    episodes = played.episodes
    minutes = _cost_minutes(episodes, scenario)
    cost = None
    full_cost = None
    if episodes["removed"].any():
        volume = np.asarray(episodes["removed"] / 1000.0)  # cm3 to dm3
        volume_replicates = bootstrap.means(volume, played.name)

        def per_volume(minutes: Floats) -> Mean:
            replicates = bootstrap.means(minutes, played.name)
            return Mean(_share(minutes, volume), ratio(replicates, volume_replicates))

        cost = per_volume(minutes)
        if scenario.control.aim == "removal":
            # The reward of overload is negative, in seconds.
            full_cost = per_volume(minutes - episodes["reward_overload"] / 60.0)
    part_cost = None
    if scenario.control.action == "part":  # a step is a part
        part_cost = _share(minutes, episodes["steps"])
    return Costs(cost=cost, full_cost=full_cost, part_cost=part_cost)


def _full_cost_share(played: Played, bootstrap: Bootstrap) -> Estimate | None:
    """Return the cost of a family's jobs over the worth of their metal."""
    worth = played.episodes["reward_metal"]
    cost = worth - played.returns
    cost_replicates = bootstrap.means(cost, played.name)
    worth_replicates = bootstrap.means(worth, played.name)
    # A resample without metal has no such share.
    if not np.all(worth_replicates > 0.0):
        return None
    return Estimate.of(cost.mean() / worth.mean(), cost_replicates / worth_replicates)


def _operation(played: Played, scenario: Scenario) -> Operation:
    """Return what happens at the machine on one scenario."""
    episodes = played.episodes
    edges = episodes["edges_used"]
    minutes = total_minutes(episodes, scenario)
    roughness_deviation = None
    if scenario.control.aim == "roughness":
        roughness_deviation = _share(episodes["roughness_deviation"], episodes["time"])
    return Operation(
        minutes=float(np.mean(minutes)),
        removal_rate=_share(episodes["removed"], minutes),
        roughness_deviation=roughness_deviation,
        edges=float(np.mean(edges)),
        broken_share=_share(episodes["edges_broken"], edges),
        used_life=float(np.mean(episodes["used_life"])),
    )


def _operation_on_jobs(played: Played, scenario: Scenario) -> Operation:
    """Return the numbers over the jobs of a family, whose volumes and edges do not add up."""
    severe_time = played.episodes["severe_overload_time"]
    severe_share = ratio(severe_time, played.episodes["engaged_time"])
    is_feasible = severe_share <= scenario.limits.overload_allowance
    return Operation(
        worst_return=float(played.returns.min()), feasible_jobs=float(is_feasible.mean())
    )


def _score(standing: Standing, fixed: Standing | None, causal: Standing | None) -> Mean | None:
    """Return the place of the mean return between the best fixed parameters and the oracle."""
    if fixed is None or causal is None:
        return None
    return score_of(standing.mean_return, fixed=fixed.mean_return, oracle=causal.mean_return)


def _leads(
    standing: Standing,
    by_name: Mapping[str, Standing],
    compared: Comparators,
    *,
    on_family: bool,
) -> Leads:
    """Return the leads of a policy over others by name."""
    others = {name: other for name, other in by_name.items() if name != standing.name}

    def over(name: str | None) -> Estimate | None:
        return standing.ahead_of(others[name]) if name in others else None

    leads = Leads(over_causal=over(CAUSAL))
    if on_family:
        with_true_laws = {
            other.name: other.mean_return.value
            for other in by_name.values()
            if other.about.knows == "true_laws"
        }
        leads = replace(leads, over_truth=over(highest(with_true_laws)))
    else:
        leads = replace(
            leads, over_fixed=over(compared.fixed), over_published=over(compared.published)
        )
    rule = best_rule(others.values())
    if rule is None:
        return leads
    seed_leads = standing.returns.mean(axis=0) - rule.returns.mean(axis=0)
    largest_first = np.argsort(-np.abs(seed_leads), kind="stable")
    without_largest = seed_leads[largest_first[LARGEST:]]
    return replace(
        leads,
        best_rule=rule.name,
        over_best_rule=over(rule.name),
        median_over_best_rule=float(np.median(seed_leads)),
        over_best_rule_without_largest=(
            float(without_largest.mean()) if without_largest.size else None
        ),
        beats_best_rule=float((seed_leads > 0.0).mean()),
    )


def highest(returns: Mapping[str, float]) -> str | None:
    """Return the policy with the highest return, the first by name on a tie; None without any."""
    return min(returns, key=lambda name: (-returns[name], name), default=None)


def best_rule(standings: Iterable[Standing]) -> Standing | None:
    """Return the rule with the highest mean return, a feasible one if any is; None without any.

    A rule that forgets is a variant, and does not count.
    """
    rules = {standing.name: standing for standing in standings if standing.is_rule}
    returns = {name: rule.mean_return.value for name, rule in rules.items()}
    feasible = {name: value for name, value in returns.items() if rules[name].feasible}
    best = highest(feasible or returns)
    return None if best is None else rules[best]


def _rank_key(standing: Standing, order: str) -> RankKey:
    """Return the key by which standings are sorted."""
    if order == "mean_return":
        merit = standing.mean_return.value
    elif standing.costs.full_cost is not None:
        merit = -standing.costs.full_cost.value
    else:
        merit = -math.inf
    return rank_key(standing.kind, standing.feasible, merit=merit, unranked=standing.unranked)


def _with_ranks(standings: Sequence[Standing]) -> list[Standing]:
    """Return sorted standings with their ranks, also within classes and on the constraint track."""
    # Oracles and, where learning games the task, agents are shown, but do not take part in the
    # ranking.
    ranked = [standing for standing in standings if standing.unranked is None]

    # The constraint track ranks feasible policies by the cost of their metal.
    metal_costs = {}
    for standing in standings:
        if standing.costs.cost is not None:
            metal_costs[standing.name] = standing.costs.cost
    by_cost = [
        standing.name for standing in ranked if standing.feasible and standing.name in metal_costs
    ]
    by_cost.sort(key=lambda name: metal_costs[name].value)

    with_ranks = []
    for standing in standings:
        policy_class = standing.about.policy_class
        same_class = [peer.name for peer in ranked if peer.about.policy_class == policy_class]
        over_least_cost = _over_cheapest_other(standing.name, by_cost, metal_costs)
        with_ranks.append(
            replace(
                standing,
                rank=_place(standing.name, [peer.name for peer in ranked]),
                class_rank=_place(standing.name, same_class),
                constraint_rank=_place(standing.name, by_cost),
                costs=replace(standing.costs, over_least_cost=over_least_cost),
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
    return np.asarray(
        machining_cost(
            total_minutes(episodes, scenario),
            episodes["edges_used"],
            scenario.economics.edge_cost,
        )
    )


def _share(parts: Floats, wholes: Floats) -> float:
    """Return the sum of ``parts`` over the sum of ``wholes``, and 0 if that is 0."""
    whole = float(np.sum(wholes))
    return float(np.sum(parts)) / whole if whole > 0.0 else 0.0
