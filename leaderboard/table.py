"""The ranking as text."""

from collections.abc import Sequence

from leaderboard.columns import COMPARISONS, LIMITS, RETURNS, SCORE, WORKSHOP, Column, applying
from leaderboard.ranking import Leaderboard
from leaderboard.standings import Standing


def render(board: Leaderboard) -> str:
    """Tables by subject, as one would be too wide, under a line that says what was played."""
    task = board.task
    lines = [f"{task.env_id}, scenario {task.scenario.name}, {len(task.seeds)} seeds, task {task.digest[:12]}"]
    for group in (RETURNS, SCORE, COMPARISONS, LIMITS, WORKSHOP):
        if columns := applying(group, board.standings):
            lines += ["", *_table(board.standings, columns)]
    return "\n".join(lines)


def _table(standings: Sequence[Standing], columns: Sequence[Column]) -> list[str]:
    rows = [
        ["rank", "policy", "seeds", "feasible", *(column.heading for column in columns)],
        ["", "", "", "", *(f"[{column.unit}]" for column in columns)],
    ]
    for place, standing in enumerate(standings, 1):
        ranked = standing.kind != "oracle"
        feasible = "yes" if standing.feasible else "NO"
        seeds = str(len(standing.training_seeds) or "")
        row = [str(place) if ranked else "", standing.name, seeds, feasible if ranked else ""]
        for column in columns:
            cell = column.cell(standing)
            row.append(f"{cell.text} ({cell.interval})" if cell.interval else cell.text)
        rows.append(row)
    widths = [max(map(len, texts)) for texts in zip(*rows, strict=True)]
    return ["  ".join(_aligned(row, widths)).rstrip() for row in rows]


def _aligned(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    return [
        text.ljust(width) if place == 1 else text.rjust(width)
        for place, (text, width) in enumerate(zip(row, widths, strict=True))
    ]
