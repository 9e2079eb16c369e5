"""The rankings for machines: what ``python -m leaderboard show --json`` prints."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from leaderboard.ranking import Leaderboard

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
"""Of the numbers of a standing."""


def as_data(boards: Sequence[Leaderboard]) -> dict[str, Any]:
    """The boards, with all numbers of their standings in order of rank: see ``leaderboard.standings.Standing``.

    A number with an interval has ``value``, ``low`` and ``high``.
    """
    return {
        "units": UNITS,
        "leaderboards": [
            {
                "env_id": board.task.env_id,
                "scenario": board.task.scenario.name,
                "seeds": board.task.seeds,
                "task": board.task.digest,
                "standings": [asdict(standing) for standing in board.standings],
            }
            for board in boards
        ],
    }
