"""The recorded trajectories of a board as data for the page's charts, packed: two characters a value."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from leaderboard.ranking import Leaderboard
from leaderboard.standings import comparators
from leaderboard.trajectories import Trajectory
from turning_env import Scenario

ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
LEVELS = len(ALPHABET) ** 2 - 2
"""A packed value is one of 0 to LEVELS, over the series' range, with the more significant character first."""
GAP = LEVELS + 1
"""Stands for a value that is not there: the load of a tool in air."""
AXES = {"minutes": "machine time [min]", "path": "path [mm]"}
"""What a chart is drawn along."""


@dataclass(frozen=True)
class Subject:
    """One panel."""

    series: str
    heading: str
    unit: str
    limit: Callable[[Scenario], float | None] = lambda scenario: None
    from_zero: bool = True
    in_metal: bool = False
    """Whether it is nothing in air."""
    reference: str | None = None
    """The series to be followed."""
    applies: Callable[[Scenario], bool] = lambda scenario: True


SUBJECTS = (
    Subject("cutting_speed", "cutting speed", "m/min", from_zero=False),
    Subject("feed", "feed", "mm/rev"),
    Subject("thrust_force", "thrust force", "N", lambda scenario: scenario.limits.thrust_force, in_metal=True),
    Subject("power", "power", "kW", lambda scenario: scenario.limits.power, in_metal=True),
    Subject(
        "roughness",
        "roughness Ra",
        "um",
        from_zero=False,
        in_metal=True,
        reference="roughness_reference",
        applies=lambda scenario: scenario.control.aim == "roughness",
    ),
    Subject("wear", "flank wear", "mm", lambda scenario: scenario.tool.wear_criterion),
)


def chart_data(board: Leaderboard) -> dict[str, Any] | None:
    """All that the charts of a board need, as JSON can hold it; None if nothing was recorded.

    Policies stand in the order of the standings, each with a course, or None, for each draw.
    """
    if board.trajectories is None:
        return None
    scenario, episodes = board.task.scenario, board.trajectories.episodes
    subjects = [subject for subject in SUBJECTS if subject.applies(scenario)]
    names = [*AXES, *(name for subject in subjects for name in (subject.series, subject.reference) if name is not None)]
    ranges = {name: _range(episodes, name) for name in names}
    draws = [draw for draw in board.task.seeds if any(episode.seed == draw for episode in episodes)]
    # After a whole part the tool may be in air, but force and power are the part's.
    gaps = {subject.series for subject in subjects if subject.in_metal and scenario.control.action != "part"}
    by_place = {(episode.policy.name, episode.seed): episode for episode in episodes}
    policies = []
    for standing in board.standings:
        courses = [by_place.get((standing.name, draw)) for draw in draws]
        label = next((course.policy.label for course in courses if course is not None), None)
        packed = [None if course is None else _course(course, ranges, gaps) for course in courses]
        policies.append(None if label is None else {"label": label, "courses": packed})
    published = comparators(scenario).published
    return {
        "axes": AXES,
        "draws": draws,
        "ranges": ranges,
        "subjects": [
            {
                "series": subject.series,
                "heading": subject.heading,
                "unit": subject.unit.replace("um", "\N{MICRO SIGN}m"),
                "limit": subject.limit(scenario),
                "fromZero": subject.from_zero,
                "reference": subject.reference,
            }
            for subject in subjects
        ],
        "policies": policies,
        "second": next((place for place, standing in enumerate(board.standings) if standing.name == published), None),
    }


def _range(episodes: Sequence[Trajectory], name: str) -> tuple[float, float]:
    values = [value for episode in episodes for value in episode.series[name]]
    return min(values), max(values)


def _course(episode: Trajectory, ranges: dict[str, tuple[float, float]], gaps: set[str]) -> dict[str, Any]:
    air = np.array(episode.series["depth_of_cut"]) == 0.0
    series = {
        name: pack(np.where(air, math.nan, episode.series[name]) if name in gaps else episode.series[name], *ends)
        for name, ends in ranges.items()
    }
    return {"steps": episode.steps, "series": series}


def pack(values: Sequence[float] | np.ndarray[Any, np.dtype[np.float64]], low: float, high: float) -> str:
    """Values between ``low`` and ``high``, with NaN for gaps, as text."""
    share = (np.asarray(values, np.float64) - low) / ((high - low) or 1.0)
    levels = np.where(np.isnan(share), GAP, np.rint(share * LEVELS)).astype(int)
    return "".join(ALPHABET[level // len(ALPHABET)] + ALPHABET[level % len(ALPHABET)] for level in levels.tolist())
