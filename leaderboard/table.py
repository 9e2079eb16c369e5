"""The ranking as text."""

from collections.abc import Sequence

from leaderboard.board import Board
from leaderboard.columns import COMPARISONS, LIMITS, RETURNS, WORKSHOP, Column, applying
from leaderboard.standings import Standing


def render(board: Board) -> str:
    """Four tables, as one would be too wide, under a line that says what was played."""
    task, digests = board.task, board.results[0].digests
    return "\n".join(
        [
            f"{task.env_id}, scenario {task.scenario.name}, {len(task.draws)} draws, task {digests.task[:12]}",
            "",
            *_table(board.standings, RETURNS),
            "",
            *_table(board.standings, COMPARISONS),
            "",
            *_table(board.standings, LIMITS),
            "",
            *_table(board.standings, WORKSHOP),
        ]
    )


def _table(standings: Sequence[Standing], columns: Sequence[Column]) -> list[str]:
    columns = applying(columns, standings)
    rows = [
        ["rank", "policy", "seeds", "admissible", *(column.heading for column in columns)],
        ["", "", "", "", *(f"[{column.unit}]" for column in columns)],
    ]
    for place, standing in enumerate(standings, 1):
        row = [str(place), standing.name, str(len(standing.training_seeds) or ""), "yes" if standing.admissible else "NO"]
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
