"""The columns of the ranking: heading, unit, definition and value, for the terminal and the page alike."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from leaderboard.standings import OVERRIDE, PARTS, ROUGHNESS, SPEED_AND_FEED, Standing
from turning_env.score.statistics import Estimate

Value = Estimate | float | None


@dataclass(frozen=True)
class Cell:
    """A value as text; ``number`` is what to sort by, None for no number or an infinite one."""

    text: str
    interval: str
    number: float | None
    ends: tuple[float, float] | None = None
    """Of the interval, in the unit of ``number``."""


@dataclass(frozen=True)
class Column:
    """One number of a standing."""

    heading: str
    unit: str
    definition: str
    value: Callable[[Standing], Value]
    decimals: int
    """At least; a value with an interval is shown with as many as the interval's width asks for."""
    factor: float = 1.0

    def cell(self, standing: Standing) -> Cell:
        """The standing's value in this column's unit, with its interval if it has one."""
        value = self.value(standing)
        if value is None:
            return Cell("", "", None)
        if isinstance(value, Estimate):
            decimals = max(self.decimals, _decimals(self.factor * (value.high - value.low)))
            text, low, high = (self._text(number, decimals) for number in (value.value, value.low, value.high))
            return Cell(text, f"{low} to {high}", value.value, (value.low, value.high))
        return Cell(self._text(value, self.decimals), "", value if math.isfinite(value) else None)

    def _text(self, value: float, decimals: int) -> str:
        return f"{self.factor * value:.{decimals}f}"


def _decimals(width: float) -> int:
    """Decimals, at most two, that show an interval of this width in two digits; none where it is but rounding."""
    return min(max(1 - math.floor(math.log10(width)), 0), 2) if width > 1e-6 else 0


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

SCORE = (
    Column(
        "score",
        "-",
        "Where the return lies between fixed parameters, 0, and the clairvoyant bound, 100; paired by draw.",
        lambda s: s.score,
        1,
        100,
    ),
    Column(
        "of the way",
        "%",
        "Share of the way from the rescaled grid search to the causal reference, which knows the present state perfectly but not "
        "what is to come.",
        lambda s: s.gap_closed,
        0,
        100,
    ),
    Column(
        "over causal",
        "s",
        "Return less that of the causal reference on the same draws: what is lost by not knowing and by not controlling as well. "
        "The clairvoyant bound's is what not foreseeing costs.",
        lambda s: s.over_causal,
        0,
    ),
)

_TASKS = (
    ("where speed and feed are set", SPEED_AND_FEED),
    ("where only the feed is set", OVERRIDE),
    ("where a roughness is held", ROUGHNESS),
    ("where parts are turned", PARTS),
)
_FIXED = "; ".join(f"{where}, {refer.fixed}" for where, refer in _TASKS)
_PUBLISHED = "; ".join(f"{where}, {refer.published}" for where, refer in _TASKS)

COMPARISONS = (
    Column(
        "over fixed",
        "s",
        f"Return less that of fixed parameters on the same draws, which are the zero of the score: {_FIXED}.",
        lambda s: s.over_fixed,
        0,
    ),
    Column(
        "over published",
        "s",
        f"Return less that of a published controller on the same draws: {_PUBLISHED}.",
        lambda s: s.over_published,
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
        "beats published",
        "%",
        "Probability of improvement: share of draws on which the return is above that of the published controller, equal ones "
        "counted half; mean over training seeds.",
        lambda s: s.improves_on_published,
        1,
        100,
    ),
)


def _of_play(columns: Sequence[Column]) -> tuple[Column, ...]:
    """The columns with nothing to say of what has not been played: a bound."""

    def played(value: Callable[[Standing], Value]) -> Callable[[Standing], Value]:
        return lambda standing: value(standing) if standing.minutes > 0.0 else None

    return tuple(replace(column, value=played(column.value)) for column in columns)


LIMITS = _of_play(
    (
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
            "Upper 95 % confidence limit of that share (one-sided). Within the allowance, the policy is feasible.",
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
    )
)

WORKSHOP = _of_play(
    (
        Column(
            "time",
            "min",
            "Mean time of an episode: machine time, edge changes and the downtime of breakages.",
            lambda s: s.minutes,
            2,
        ),
        Column(
            "cost per part",
            "min",
            "That time and the price of edges, per part turned, in machine time.",
            lambda s: s.part_cost,
            2,
        ),
        Column(
            "roughness deviation",
            "%",
            "Relative deviation of Ra from its reference, averaged over cutting time.",
            lambda s: s.roughness_deviation,
            2,
            100,
        ),
        Column(
            "removal_rate",
            "cm3/min",
            "Metal removed over all time: machine time, edge changes and the downtime of breakages. An edge that the time limit "
            "leaves unfinished is charged its used share of a change.",
            lambda s: s.removal_rate,
            1,
        ),
        Column(
            "cost",
            "min/dm3",
            "All that time, and the price of the edges used up, in minutes of machine time, over metal removed.",
            lambda s: s.cost,
            2,
        ),
        Column("edges", "edges", "Mean number of edges that an episode uses up.", lambda s: s.edges, 2),
        Column(
            "broken edges",
            "per 100",
            "Edges broken, per hundred used up; one that the time limit leaves unfinished counts as its used share.",
            lambda s: s.broken_share,
            1,
            100,
        ),
        Column(
            "used life", "%", "Used share of the edge's life when the episode ends, on average.", lambda s: s.used_life, 1, 100
        ),
    )
)


def applying(columns: Sequence[Column], standings: Sequence[Standing]) -> list[Column]:
    """The columns that have something to say of some of the standings."""
    return [column for column in columns if any(column.value(standing) is not None for standing in standings)]
