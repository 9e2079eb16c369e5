"""The columns of the ranking: heading, unit, definition and value, for the terminal and the page alike."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from leaderboard.standings import FIXED, PAPER, Standing
from leaderboard.statistics import Estimate

Value = Estimate | float | None


@dataclass(frozen=True)
class Cell:
    """A value as text; ``number`` is what to sort by, None for no number or an infinite one."""

    text: str
    interval: str
    number: float | None


@dataclass(frozen=True)
class Column:
    """One number of a standing."""

    heading: str
    unit: str
    definition: str
    value: Callable[[Standing], Value]
    decimals: int
    factor: float = 1.0

    def cell(self, standing: Standing) -> Cell:
        """The standing's value in this column's unit, with its interval if it has one."""
        value = self.value(standing)
        if value is None:
            return Cell("", "", None)
        if isinstance(value, Estimate):
            return Cell(self._text(value.value), f"{self._text(value.low)} to {self._text(value.high)}", value.value)
        return Cell(self._text(value), "", value if math.isfinite(value) else None)

    def _text(self, value: float) -> str:
        return f"{self.factor * value:.{self.decimals}f}"


RETURNS = (
    Column("return", "s", "Mean over draws and training seeds of the sum of an episode's rewards.", lambda s: s.mean_return, 0),
    Column(
        "interquartile return",
        "s",
        "The same without the lowest and the highest quarter of all episodes.",
        lambda s: s.interquartile_return,
        0,
    ),
)

COMPARISONS = (
    Column(
        f"over {FIXED}",
        "s",
        f"Return less that of {FIXED}, the best fixed parameters, on the same draws. {FIXED} is the zero of the score.",
        lambda s: s.over_fixed,
        0,
    ),
    Column(
        f"over {PAPER}",
        "s",
        f"Return less that of {PAPER}, the published controller, on the same draws.",
        lambda s: s.over_paper,
        0,
    ),
    Column(
        "over best rule",
        "s",
        "Return less that of the best rule on the same draws: of the other rule-based controllers, the one with the highest "
        "mean return.",
        lambda s: s.over_best_rule,
        0,
    ),
    Column(
        f"beats {PAPER}",
        "%",
        f"Probability of improvement: share of draws on which the return is above that of {PAPER}, equal ones counted half; "
        "mean over training seeds.",
        lambda s: s.improves_on_paper,
        1,
        100,
    ),
)

WORKSHOP = (
    Column(
        "productivity",
        "cm3/min",
        "Metal removed over all time: machine time, edge changes and the downtime of breakages. An edge that the time limit "
        "leaves unfinished is charged its used share of a change.",
        lambda s: s.productivity,
        1,
    ),
    Column(
        "cost",
        "min/dm3",
        "All that time, and the price of the edges used up, in minutes of machine time, over metal removed.",
        lambda s: s.cost,
        2,
    ),
    Column(
        "over a limit", "%", "Share of cutting time above the limit of force or of power.", lambda s: s.overload_share, 2, 100
    ),
    Column(
        "severely over",
        "%",
        "Share of cutting time above a limit by more than the tolerance.",
        lambda s: s.severe_share,
        2,
        100,
    ),
    Column(
        "severely over, at most",
        "%",
        "Upper 95 % confidence limit of that share (one-sided). Within the allowance, the policy is admissible.",
        lambda s: s.severe_limit,
        2,
        100,
    ),
    Column(
        "excess",
        "%",
        "Relative excess over the limits, force and power added, averaged over cutting time.",
        lambda s: s.excess,
        3,
        100,
    ),
    Column(
        "broken edges",
        "per 100",
        "Edges broken, per hundred used up; one that the time limit leaves unfinished counts as its used share.",
        lambda s: s.broken_share,
        1,
        100,
    ),
    Column("used life", "%", "Used share of the edge's life when the episode ends, on average.", lambda s: s.used_life, 1, 100),
)
