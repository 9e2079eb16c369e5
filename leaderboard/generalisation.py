"""The full cost of policies on scenarios that they were not tuned for: one table over a leaderboard and those of its splits."""

from collections.abc import Sequence
from dataclasses import dataclass

from leaderboard.columns import FULL_COST, Cell
from leaderboard.ranking import Leaderboard
from leaderboard.standings import Standing
from leaderboard.table import aligned
from turning_env import SPLITS
from turning_env.scoring.policy import ScenarioId


@dataclass(frozen=True)
class Across:
    """Policies over scenarios."""

    tuned_for: str
    """The scenario to which the rules are tuned and on which the agents are trained: the first column."""
    scenarios: list[str]
    rows: dict[str, dict[str, Standing]]
    """For each policy by name, its standing on each scenario on which it has played."""

    def cell(self, policy: str, scenario: str) -> Cell | None:
        """Return the policy's full cost on a scenario, None if it has not played there."""
        standing = self.rows[policy].get(scenario)
        return None if standing is None else FULL_COST.cell(standing)

    def feasible(self, policy: str, scenario: str) -> bool:
        """Return whether the policy is feasible on a scenario, or has not played there."""
        standing = self.rows[policy].get(scenario)
        return standing is None or standing.feasible


def across(leaderboards: Sequence[Leaderboard]) -> Across | None:
    """Return the table over the first leaderboard that others are splits of, and these; None if there is none.

    A policy counts on a split if it was tuned for the first leaderboard's scenario, and so does an oracle.
    """
    splits = {each.task.scenario.name: each for each in leaderboards if each.task.scenario.name in SPLITS}
    tuned_for = [result.policy.tuned_for for each in splits.values() for result in each.results]
    for base in leaderboards:
        home = ScenarioId.of(base.task.scenario)
        if home not in tuned_for or home.name in splits:
            continue
        chosen = [each for name in SPLITS if (each := splits.get(name)) and each.task.env_id == base.task.env_id]
        rows: dict[str, dict[str, Standing]] = {each.name: {home.name: each} for each in base.standings if each.full_cost}
        for split in chosen:
            names, policies = split.names, [result.policy for result in split.results]
            counted = {names[policy.label] for policy in policies if policy.tuned_for == home or policy.kind == "oracle"}
            for standing in split.standings:
                if standing.name in rows and standing.name in counted:
                    rows[standing.name][split.task.scenario.name] = standing
        return Across(home.name, [each.task.scenario.name for each in (base, *chosen)], rows)
    return None


def render(table: Across) -> str:
    """Return the table as text."""
    rows = [["policy", *table.scenarios]]
    for policy in table.rows:
        cells = [(table.cell(policy, scenario), table.feasible(policy, scenario)) for scenario in table.scenarios]
        rows.append([policy, *("" if cell is None else cell.text + ("" if feasible else " NO") for cell, feasible in cells)])
    head = f"full cost [min/dm3] of policies tuned for {table.tuned_for} on other scenarios; NO: not feasible"
    return f"{head}\n\n{aligned(rows)}"
