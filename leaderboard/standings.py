"""From rows to ranks: what the board says of each policy."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from leaderboard.results import PolicyRecord, Result, ResultError
from leaderboard.statistics import CONFIDENCE, Bootstrap, Estimate, Floats, improvement, interquartile_mean
from turning_env import Scenario

FIXED = "fixed_tuned"
"""The best fixed parameters: the zero of the score."""
PAPER = "grid_search"
"""The published controller."""


@dataclass(frozen=True)
class Standing:
    """One policy's numbers. Comparisons are None where the policy to compare with has not played, or is this one."""

    name: str
    kind: str
    description: str
    training_seeds: tuple[int, ...]
    admissible: bool
    mean_return: Estimate  # [s]
    interquartile_return: Estimate  # [s]
    over_fixed: Estimate | None  # [s]
    over_paper: Estimate | None  # [s]
    best_rule: str | None  # of the other policies that are rules, the one with the highest mean return
    over_best_rule: Estimate | None  # [s]
    improves_on_paper: Estimate | None  # probability
    productivity: float  # [cm3/min]
    cost: float  # [min/dm3]
    overload_share: float  # of cutting time
    severe_share: float  # of cutting time
    severe_limit: float  # one-sided upper confidence limit of severe_share
    excess: float  # mean while cutting, relative
    broken_share: float  # of edges used up
    used_life: float  # at the end


def rank(results: Sequence[Result]) -> list[Standing]:
    """The policies of one task, admissible ones first, then by mean return; there must be a result.

    Raises:
        ResultError: agents of one name differ in more than the training seed.
    """
    check_alike([result.policy for result in results])
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(result.policy.name, []).append(result)
    rows = {name: _rows(group) for name, group in groups.items()}
    bootstrap = Bootstrap(len(results[0].task.draws))
    rules = {name: float(np.mean(rows[name]["return"])) for name, group in groups.items() if group[0].policy.kind == "rule"}
    standings = [_standing(group, rows, rules, bootstrap) for group in groups.values()]
    return sorted(standings, key=lambda standing: (not standing.admissible, -standing.mean_return.value, standing.name))


def highest(returns: Mapping[str, float]) -> str | None:
    """The policy of the highest return, of equal ones the first by name; None if there is no policy."""
    return min(returns, key=lambda name: (-returns[name], name), default=None)


def check_alike(policies: Sequence[PolicyRecord]) -> None:
    """See that policies of one name are one policy, trained with several seeds.

    Raises:
        ResultError: two of one name differ in more than the training seed and what follows from it.
    """
    first: dict[str, PolicyRecord] = {}
    for policy in policies:
        other = first.setdefault(policy.name, policy)
        for field in ("kind", "description", "parameters"):
            mine, its = getattr(policy, field), getattr(other, field)
            if mine != its:
                raise ResultError(
                    f"{other.label} and {policy.label} cannot be one policy, as they differ in {field}: {its!r}, {mine!r}"
                )


def _rows(group: Sequence[Result]) -> dict[str, Floats]:
    """Of each episode field, an array of shape (training seeds, draws)."""
    return {field: np.array([result.episodes[field] for result in group]) for field in group[0].episodes}


def _standing(
    group: Sequence[Result], rows: Mapping[str, dict[str, Floats]], rules: Mapping[str, float], bootstrap: Bootstrap
) -> Standing:
    """The standing of the policy of ``group``; ``rules`` are the mean returns [s] of all rules."""
    policy, scenario = group[0].policy, group[0].task.scenario
    name, episodes = policy.name, rows[policy.name]
    returns = episodes["return"]
    mean_returns = bootstrap.means(returns, name)

    best_rule = highest({rule: mean for rule, mean in rules.items() if rule != name})

    def difference(reference: str | None) -> Estimate | None:
        if reference is None or reference == name or reference not in rows:
            return None
        others = rows[reference]["return"]
        return Estimate.of(float(np.mean(returns) - np.mean(others)), mean_returns - bootstrap.means(others, reference))

    improves_on_paper = None
    if PAPER in rows and name != PAPER:
        wins = improvement(returns, rows[PAPER]["return"])
        improves_on_paper = Estimate.of(float(np.mean(wins)), bootstrap.means(wins, name))

    engaged, severe = episodes["engaged_time"], episodes["severe_overload_time"]
    severe_shares = _ratio(bootstrap.means(severe, name), bootstrap.means(engaged, name))
    severe_limit = float(np.quantile(severe_shares, CONFIDENCE))
    removed, minutes, edges = episodes["removed"], total_minutes(episodes, scenario), edges_used(episodes)
    return Standing(
        name=name,
        kind=policy.kind,
        description=policy.description,
        training_seeds=tuple(sorted(seed for result in group if (seed := result.policy.training_seed) is not None)),
        admissible=severe_limit <= scenario.limits.overload_allowance,
        mean_return=Estimate.of(float(np.mean(returns)), mean_returns),
        interquartile_return=Estimate.of(
            float(interquartile_mean(returns.ravel())), bootstrap.interquartile_means(returns, name)
        ),
        over_fixed=difference(FIXED),
        over_paper=difference(PAPER),
        best_rule=best_rule,
        over_best_rule=difference(best_rule),
        improves_on_paper=improves_on_paper,
        productivity=_share(removed, minutes),
        cost=_share(minutes + scenario.economics.edge_cost * edges, removed / 1000.0) if removed.any() else math.inf,
        overload_share=_share(episodes["overload_time"], engaged),
        severe_share=_share(severe, engaged),
        severe_limit=severe_limit,
        excess=_share(episodes["excess"], engaged),
        broken_share=_share(episodes["broken"], edges),
        used_life=float(np.mean(episodes["used_life"])),
    )


def edges_used(episodes: Mapping[str, Floats]) -> Floats:
    """Edges that each episode uses up: the used share of life, and the whole of a broken edge."""
    used: Floats = np.where(episodes["broken"] > 0.0, 1.0, np.minimum(episodes["used_life"], 1.0))
    return used


def total_minutes(episodes: Mapping[str, Floats], scenario: Scenario) -> Floats:
    """Time [min] of each episode, with the change of the edges that it uses up and the downtime of a breakage.

    An episode that the time limit cuts off has not used up its edge, so it is charged a like share of the change.
    """
    economics = scenario.economics
    change = economics.edge_change_time * edges_used(episodes)
    total: Floats = episodes["time"] / 60.0 + change + economics.breakage_downtime * episodes["broken"]
    return total


def _ratio(parts: Floats, wholes: Floats) -> Floats:
    """``parts / wholes``, and 0 where a whole is 0: a policy that never cuts overloads nothing."""
    return np.divide(parts, wholes, out=np.zeros(np.shape(parts)), where=wholes > 0.0)


def _share(parts: Floats, wholes: Floats) -> float:
    """Sum of ``parts`` over sum of ``wholes``, and 0 where that is 0."""
    whole = float(np.sum(wholes))
    return float(np.sum(parts)) / whole if whole > 0.0 else 0.0
