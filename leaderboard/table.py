"""Rankings as text, and as data for ``--json``; and a table of full costs over a leaderboard and its splits."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from leaderboard.columns import FULL_COST, GROUPS, Cell, Column, Training, groups, ranking
from leaderboard.ranking import Leaderboard
from leaderboard.standings import Standing, by_cost, ranked_by
from turning_env import SPLITS
from turning_env.scoring.policy import ScenarioId

UNITS = {
    column.field: column.unit if column.factor == 1.0 else "share"
    for group in GROUPS.values()
    for column in group
    if not isinstance(column, Training)
}
"""Units of the numbers of a standing."""


TRACKS: dict[str, Callable[[Sequence[Standing]], Sequence[Standing]]] = {
    "penalty": lambda standings: standings,
    "constraint": by_cost,
}
"""The order of policies on each track: as ranked, by return or on splits by full cost; or feasible policies by cost."""


def as_data(leaderboards: Sequence[Leaderboard], track: str = "penalty") -> dict[str, Any]:
    """Return the leaderboards with all numbers of their standings in order of a track: see ``leaderboard.standings.Standing``.

    A number with an interval has ``value``, ``low`` and ``high``.
    """
    return {
        "units": UNITS,
        "leaderboards": [
            {
                "env_id": each.task.env_id,
                "scenario": each.task.scenario.name,
                "seeds": each.task.seeds,
                "task": each.task.digest,
                "ranked_by": "cost" if track == "constraint" else ranked_by(each.task.scenario),
                "standings": [asdict(standing) for standing in TRACKS[track](each.standings)],
            }
            for each in leaderboards
        ],
    }


def render(leaderboard: Leaderboard, track: str = "penalty") -> str:
    """Return a leaderboard as tables, one per subject, under a line that names the task."""
    task = leaderboard.task
    by = "cost" if track == "constraint" else ranking(task.scenario).heading
    about = f"{task.env_id}, scenario {task.scenario.name}, {len(task.seeds)} seeds, task {task.digest[:12]}"
    lines = [f"{about}, ranked by {by}"]
    standings = TRACKS[track](leaderboard.standings)
    for heading, columns in groups(standings).items():
        lines += ["", heading, "", aligned(_rows(standings, columns), left=1)]
    return "\n".join(lines)


def own_places(leaderboard: Leaderboard, labels: Collection[str]) -> list[str]:
    """Return a line on the place of each of one's own agents, if its label is one of these."""
    names = leaderboard.names
    asked = {names.get(label) for label in labels}
    ranked = [standing for standing in leaderboard.standings if standing.kind != "oracle"]
    lines = []
    for place, standing in enumerate(ranked, 1):
        if standing.own and standing.name in asked:
            task, column = leaderboard.task, ranking(leaderboard.task.scenario)
            cell = column.cell(standing)
            value = f"{cell.text} {column.unit} ({cell.interval})" if cell.text else "none"
            told = f"your agent: rank {place} of {len(ranked)}, {column.heading} {value}"
            lines.append(f"{told}: {standing.name} on {task.env_id}, scenario {task.scenario.name}")
    return lines


def _rows(standings: Sequence[Standing], columns: Sequence[Column]) -> list[list[str]]:
    rows = [
        ["rank", "policy", "seeds", "feasible", *(column.heading for column in columns)],
        ["", "", "", "", *(f"[{column.unit}]" if column.unit else "" for column in columns)],
    ]
    for place, standing in enumerate(standings, 1):
        ranked = standing.kind != "oracle"
        feasible = "yes" if standing.feasible else "NO"
        seeds = str(len(standing.training_seeds) or "")
        cells = [column.cell(standing) for column in columns]
        if not any(cell.text for cell in cells):
            continue
        name = f"{standing.name} (yours)" if standing.own else standing.name
        row = [str(place) if ranked else "", name, seeds, feasible if ranked else ""]
        rows.append(row + [f"{cell.text} ({cell.interval})" if cell.interval else cell.text for cell in cells])
    return rows


def aligned(rows: Sequence[Sequence[str]], left: int = 0) -> str:
    """Return rows of texts as lines, every column to the right but the one at place ``left``."""
    widths = [max(map(len, texts)) for texts in zip(*rows, strict=True)]
    sides: list[Callable[[str, int], str]] = [str.ljust if place == left else str.rjust for place in range(len(widths))]
    return "\n".join(
        "  ".join(side(*each) for side, each in zip(sides, zip(row, widths, strict=True), strict=True)).rstrip() for row in rows
    )


@dataclass(frozen=True)
class Across:
    """Policies over scenarios."""

    tuned_for: str
    """The scenario to which the rules are tuned and on which the agents are trained: the first column."""
    scenarios: list[str]
    rows: dict[str, dict[str, tuple[Cell, bool]]]
    """For each policy by name, its full cost and whether it is feasible, on each scenario on which it has played."""


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
        rows = {each.name: {home.name: _full_cost(each)} for each in base.standings if each.full_cost}
        for split in chosen:
            names, policies = split.names, [result.policy for result in split.results]
            counted = {names[policy.label] for policy in policies if policy.tuned_for == home or policy.kind == "oracle"}
            for standing in split.standings:
                if standing.name in rows and standing.name in counted:
                    rows[standing.name][split.task.scenario.name] = _full_cost(standing)
        return Across(home.name, [each.task.scenario.name for each in (base, *chosen)], rows)
    return None


def _full_cost(standing: Standing) -> tuple[Cell, bool]:
    return FULL_COST.cell(standing), standing.feasible


def render_across(table: Across) -> str:
    """Return the table as text."""
    rows = [["policy", *table.scenarios]]
    for policy, cells in table.rows.items():
        texts = {scenario: cell.text + ("" if feasible else " NO") for scenario, (cell, feasible) in cells.items()}
        rows.append([policy, *(texts.get(scenario, "") for scenario in table.scenarios)])
    head = f"full cost [min/dm3] of policies tuned for {table.tuned_for} on other scenarios; NO: not feasible"
    return f"{head}\n\n{aligned(rows)}"
