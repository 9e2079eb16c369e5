"""Geometry of the page's charts. The template draws; here it is decided where."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from leaderboard.board import Board
from leaderboard.standings import references
from leaderboard.trajectories import Trajectory
from turning_env import Scenario

ROW_HEIGHT = 30
PANEL_HEIGHT = 96
PANEL_PITCH = 128


@dataclass(frozen=True)
class Scale:
    """Maps low..high linearly onto the pixels start..end."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        return round(self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start), 1)

    def ticks(self, most: int) -> list[float]:
        """At most ``most`` round numbers within the scale."""
        span = self.high - self.low
        power: float = 10.0 ** math.floor(math.log10(span / most))
        step = next(factor * power for factor in (1, 2, 5, 10, 20) if span / (factor * power) < most)
        return [number * step for number in range(math.ceil(self.low / step), math.floor(self.high / step) + 1)]


def scale(values: Iterable[float], start: float, end: float) -> Scale:
    """A scale over all values, with a little room at both ends."""
    values = list(values)
    low, high = min(values), max(values)
    room = 0.04 * (high - low) or 1.0
    return Scale(low - room, high + room, start, end)


@dataclass(frozen=True)
class IntervalPlot:
    """Mean return of every policy with its interval, one row each."""

    board: Board
    x: Scale
    height: int
    row_height: int
    fixed: float | None
    """Return [s] of the fixed parameters."""


def interval_plot(board: Board) -> IntervalPlot:
    """The plot of one board."""
    returns = {standing.name: standing.mean_return for standing in board.standings}
    ends = [end for estimate in returns.values() for end in (estimate.low, estimate.high)]
    name = references(board.task.scenario).fixed
    fixed = returns[name].value if name in returns else None
    return IntervalPlot(board, scale(ends, 230, 880), ROW_HEIGHT * len(returns) + 44, ROW_HEIGHT, fixed)


@dataclass(frozen=True)
class _Subject:
    heading: str
    unit: str
    series: tuple[str, ...]
    limit: Callable[[Scenario], float | None] = lambda scenario: None
    applies: Callable[[Scenario], bool] = lambda scenario: True


SUBJECTS = (
    _Subject("cutting speed", "m/min", ("commanded_cutting_speed", "cutting_speed")),
    _Subject("feed", "mm/rev", ("commanded_feed", "feed")),
    _Subject("thrust force", "N", ("thrust_force",), lambda scenario: scenario.limits.thrust_force),
    _Subject("power", "kW", ("power",), lambda scenario: scenario.limits.power),
    _Subject(
        "roughness Ra", "um", ("roughness_reference", "roughness"), applies=lambda scenario: scenario.control.aim == "roughness"
    ),
    _Subject("flank wear", "mm", ("wear",), lambda scenario: scenario.tool.wear_criterion),
)
"""What is drawn of a trajectory. Where there are two series, the first is the command or the reference."""


@dataclass(frozen=True)
class Panel:
    """One subject over time."""

    heading: str
    y: Scale
    lines: list[str]
    """Points of polylines."""
    limit: float | None


@dataclass(frozen=True)
class Strip:
    """All subjects of one policy, one below the other."""

    trajectory: Trajectory
    x: Scale
    height: int
    panels: list[Panel]


def strips(episodes: Sequence[Trajectory], scenario: Scenario) -> list[Strip]:
    """Trajectories side by side, on common scales."""
    if not episodes:
        return []
    x = Scale(0.0, max(episode.series["minutes"][-1] for episode in episodes), 44, 352)
    panels: dict[int, list[Panel]] = {number: [] for number in range(len(episodes))}
    subjects = [subject for subject in SUBJECTS if subject.applies(scenario)]
    for row, subject in enumerate(subjects):
        limit = subject.limit(scenario)
        values = [value for episode in episodes for name in subject.series for value in episode.series[name]]
        top = 26 + row * PANEL_PITCH
        y = scale([*values, limit or 0.0, 0.0], top + PANEL_HEIGHT, top)
        for number, episode in enumerate(episodes):
            lines = [_points(episode.series["minutes"], episode.series[name], x, y) for name in subject.series]
            panels[number].append(Panel(f"{subject.heading} [{subject.unit}]", y, lines, limit))
    height = len(subjects) * PANEL_PITCH + 36
    return [Strip(episode, x, height, panels[number]) for number, episode in enumerate(episodes)]


def _points(xs: Sequence[float], ys: Sequence[float], x: Scale, y: Scale) -> str:
    # Every interval is drawn: thinning would hide the short overloads that matter.
    return " ".join(f"{x(across)},{y(up)}" for across, up in zip(xs, ys, strict=True))
