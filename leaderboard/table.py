"""Rankings as text, and as data for ``--json``."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from leaderboard.columns import COMPARISONS, LIMITS, RETURNS, SCORE, WORKSHOP, Column, applying
from leaderboard.ranking import Leaderboard
from leaderboard.standings import Standing

GROUPS = (RETURNS, SCORE, COMPARISONS, LIMITS, WORKSHOP)
UNITS = {column.field: column.unit if column.factor == 1.0 else "share" for group in GROUPS for column in group}
"""Units of the numbers of a standing."""


def as_data(leaderboards: Sequence[Leaderboard]) -> dict[str, Any]:
    """Return the leaderboards with all numbers of their standings in order of rank: see ``leaderboard.standings.Standing``.

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
                "standings": [asdict(standing) for standing in each.standings],
            }
            for each in leaderboards
        ],
    }


def render(leaderboard: Leaderboard) -> str:
    """Return a leaderboard as tables, one per subject, under a line that names the task."""
    task = leaderboard.task
    lines = [f"{task.env_id}, scenario {task.scenario.name}, {len(task.seeds)} seeds, task {task.digest[:12]}"]
    for group in GROUPS:
        if columns := applying(group, leaderboard.standings):
            lines += ["", aligned(_rows(leaderboard.standings, columns), left=1)]
    return "\n".join(lines)


def _rows(standings: Sequence[Standing], columns: Sequence[Column]) -> list[list[str]]:
    rows = [
        ["rank", "policy", "seeds", "feasible", *(column.heading for column in columns)],
        ["", "", "", "", *(f"[{column.unit}]" for column in columns)],
    ]
    for place, standing in enumerate(standings, 1):
        ranked = standing.kind != "oracle"
        feasible = "yes" if standing.feasible else "NO"
        seeds = str(len(standing.training_seeds) or "")
        cells = [column.cell(standing) for column in columns]
        row = [str(place) if ranked else "", standing.name, seeds, feasible if ranked else ""]
        rows.append(row + [f"{cell.text} ({cell.interval})" if cell.interval else cell.text for cell in cells])
    return rows


def aligned(rows: Sequence[Sequence[str]], left: int = 0) -> str:
    """Return rows of texts as lines, every column to the right but the one at place ``left``."""
    widths = [max(map(len, texts)) for texts in zip(*rows, strict=True)]
    sides: list[Callable[[str, int], str]] = [str.ljust if place == left else str.rjust for place in range(len(widths))]
    return "\n".join(
        "  ".join(side(*each) for side, each in zip(sides, zip(row, widths, strict=True), strict=True)).rstrip() for row in rows
    )
