"""Rankings as text, and as data for ``--json``."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict
from typing import Any

from leaderboard.columns import GROUPS, Column, Count, Mark, groups, ranking
from leaderboard.ranking import Leaderboard
from leaderboard.standings import Standing, by_cost, ranked_by

UNITS = {
    column.field: column.unit if column.factor == 1.0 else "share"
    for group in GROUPS.values()
    for column in group
    if not isinstance(column, Mark | Count)
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
