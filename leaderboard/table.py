"""Rankings as text, and as data for ``--json``."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from leaderboard.columns import COMPARISONS, LIMITS, RETURNS, SCORE, WORKSHOP, Column, applying
from leaderboard.ranking import Leaderboard
from leaderboard.standings import Standing

UNITS: Mapping[str, str] = {
    **dict.fromkeys(("mean_return", "interquartile_return"), "s"),
    **dict.fromkeys(("over_fixed", "over_published", "over_best_rule", "over_causal"), "s"),
    **dict.fromkeys(("minutes", "part_cost"), "min"),
    "removal_rate": "cm3/min",
    "cost": "min/dm3",
    "edges": "1",
    **dict.fromkeys(("improves_on_published", "score", "gap_closed", "roughness_deviation", "overload_share"), "share"),
    **dict.fromkeys(("severe_share", "severe_limit", "excess", "broken_share", "used_life"), "share"),
}
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
    for group in (RETURNS, SCORE, COMPARISONS, LIMITS, WORKSHOP):
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
