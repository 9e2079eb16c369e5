"""How policies made for one scenario do on others: one table over the boards of the splits."""

from collections.abc import Sequence
from dataclasses import dataclass

from leaderboard.columns import RETURNS, Cell
from leaderboard.ranking import Leaderboard
from leaderboard.standings import Standing
from turning_env import SPLITS
from turning_env.score.policy import ScenarioId

NOT_ADMISSIBLE = "NO"


@dataclass(frozen=True)
class Across:
    """Policies over scenarios."""

    tuned_for: str
    """The scenario to which the rules are tuned and on which the agents are trained: the first column."""
    scenarios: list[str]
    rows: dict[str, dict[str, Standing]]
    """Of each policy by name, its standing on each scenario on which it has played."""

    def cell(self, policy: str, scenario: str) -> Cell | None:
        """The policy's return [s] there, if it has played."""
        standing = self.rows[policy].get(scenario)
        return None if standing is None else RETURNS[0].cell(standing)

    def feasible(self, policy: str, scenario: str) -> bool:
        """Whether the policy is so there; as well if it has not played."""
        standing = self.rows[policy].get(scenario)
        return standing is None or standing.feasible


def across(boards: Sequence[Leaderboard]) -> Across | None:
    """The table over the boards that are splits of another one among them; None if there are none.

    A policy counts on a split if it was made for the other board's scenario; so does a reference, which is made for none.
    """
    splits = {board.task.scenario.name: board for board in boards if board.task.scenario.name in SPLITS}
    stamps = [result.policy.tuned_for for board in splits.values() for result in board.results]
    for base in boards:
        stamp = ScenarioId.of(base.task.scenario)
        if stamp not in stamps or base.task.scenario.name in splits:
            continue
        chosen = [board for name in SPLITS if (board := splits.get(name)) and board.task.env_id == base.task.env_id]
        rows: dict[str, dict[str, Standing]] = {standing.name: {} for standing in base.standings}
        for board in (base, *chosen):
            counted = {
                each.policy.name for each in board.results if each.policy.tuned_for == stamp or each.policy.kind == "oracle"
            }
            for standing in board.standings:
                if standing.name in rows and (board is base or standing.name in counted):
                    rows[standing.name][board.task.scenario.name] = standing
        return Across(stamp.name, [board.task.scenario.name for board in (base, *chosen)], rows)
    return None


def render(table: Across) -> str:
    """The table as text."""
    head = f"return [s] of policies made for {table.tuned_for} where they were not made for; {NOT_ADMISSIBLE}: not feasible"
    rows = [["policy", *table.scenarios]]
    for policy in table.rows:
        row = [policy]
        for scenario in table.scenarios:
            cell = table.cell(policy, scenario)
            verdict = "" if table.feasible(policy, scenario) else f" {NOT_ADMISSIBLE}"
            row.append("" if cell is None else cell.text + verdict)
        rows.append(row)
    widths = [max(map(len, texts)) for texts in zip(*rows, strict=True)]
    lines = [[row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])] for row in rows]
    return "\n".join([head, "", *("  ".join(line).rstrip() for line in lines)])
