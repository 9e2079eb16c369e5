"""The columns of a ranking: heading, unit, definition and value, for the terminal, the page and the model cards."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from leaderboard.information import GIVEN, SEEN
from leaderboard.standings import LARGEST, Standing, ranked_by
from turning_env import Scenario
from turning_env.scoring.statistics import Estimate


@dataclass(frozen=True)
class Cell:
    """A value as text."""

    text: str
    interval: str
    number: float | None  # the number to sort by; None if there is no value or it is infinite
    ends: tuple[float, float] | None = (
        None  # low and high end of the interval, in the unit of number
    )


@dataclass(frozen=True)
class Column:
    """One number of a standing."""

    heading: str
    unit: str
    definition: str
    field: str  # field of Standing
    decimals: int = 0  # lowest number of decimals; a narrow interval needs more
    factor: float = 1.0  # factor from the unit of Standing to unit
    of_play: bool = (
        False  # whether a policy without episodes, such as the clairvoyant bound, lacks the number
    )
    lower_is_better: bool = False

    def value(self, standing: Standing) -> Estimate | float | None:
        """Return the standing's value in the unit of ``Standing``, None if it has none."""
        if self.of_play and standing.minutes == 0.0:
            return None
        value: Estimate | float | None = getattr(standing, self.field)
        return value

    def cell(self, standing: Standing) -> Cell:
        """Return the standing's value in this column's unit, with its interval if it has one."""
        value = self.value(standing)
        if value is None:
            return Cell("", "", None)
        if isinstance(value, Estimate):
            decimals = max(self.decimals, value.decimals(self.factor))
            text, low, high = (
                self._text(number, decimals) for number in (value.value, value.low, value.high)
            )
            return Cell(text, f"{low} to {high}", value.value, (value.low, value.high))
        return Cell(self._text(value, self.decimals), "", value if math.isfinite(value) else None)

    def _text(self, value: float, decimals: int) -> str:
        return f"{self.factor * value:.{decimals}f}"


@dataclass(frozen=True)
class Training(Column):
    """A field of an agent's ``Information``, or whether the agent was given something in training or has it at run time."""

    def value(self, standing: Standing) -> float | None:
        """Return the number, or 1 or 0; None if the policy is no agent or its file does not state it."""
        told = standing.information
        if told is None or told.given is None or told.seen is None:
            return None
        if self.field in (*GIVEN, *SEEN):
            return float(self.field in (*told.given, *told.seen))
        count: int | None = getattr(told, self.field)
        return count

    def cell(self, standing: Standing) -> Cell:
        """Return a number with commas, or "yes" or "no"; nothing if that is unknown."""
        value = self.value(standing)
        if value is None or self.field not in (*GIVEN, *SEEN):
            return Cell("" if value is None else f"{value:,}", "", value)
        return Cell("yes" if value else "no", "", value)


@dataclass(frozen=True)
class ClassRank(Column):
    """The rank within a class, with the class."""

    def cell(self, standing: Standing) -> Cell:
        """Return the rank, and the class in place of an interval."""
        rank = standing.class_rank
        return Cell("", "", None) if rank is None else Cell(str(rank), standing.policy_class, rank)


_OVER_CAUSAL = (
    "Return less that of the causal oracle on the same seeds: the price of not knowing the state and of imperfect control; for "
    "the clairvoyant bound, the value of foresight."
)
_CLASS_RANK = "Rank among the policies of the same class, which were given alike: see the definitions of classes."
_COST_RANK = "Rank on the constraint track: feasible policies by cost, whatever their return."
_OVER_CHEAPEST = "Cost less that of the cheapest other feasible policy on the same seeds."
_REMOVAL_RATE = (
    "Metal removed over all time: machine time, edge changes and the downtime of breakages. An edge that the time limit leaves "
    "unfinished is charged its used share of a change."
)
_COST = "All that time, and the price of the edges used up, in minutes of machine time, over metal removed; overload is free."
_BEST_RULE = (
    "Return less that of the best other rule on the same seeds: of the rules that are not this policy, the one with the highest "
    "mean return, a feasible one if there is any. In the row of the best rule, this is its lead over the next rule."
)
_SEVERE_LIMIT = "Upper 95 % confidence limit (one-sided) of the time severely over. Within the allowance, the policy is feasible."
_SEVERE_LOWER_LIMIT = "Lower 95 % confidence limit (one-sided) of the time severely over. Above the allowance, it is infeasible."
_EXCESS = "Share of cutting time above a limit of force or power by more than {} %. Older results lack it."
_SCORE = "Place of the return between the best fixed parameters, 0, and the causal oracle, 100; paired by seed."
_TIME = "Mean time of an episode: machine time, edge changes, downtime of breakages."
_PART_COST = "Time per part, plus the price of the edges used up in minutes of machine time."
_DEVIATION = "Mean relative deviation of Ra from its set point; 1 in air."
_BROKEN = "Edges broken, per hundred used up; an edge that the time limit leaves unfinished counts as its used share."

_RETURN = (
    "Mean over seeds and training seeds of the sum of an episode's rewards. If an episode is one edge and its metal does not "
    "pay, the return is higher if the edge ends early: compare full costs."
)
_FULL_COST = (
    "Price of time, edges, breakage and overload in minutes of machine time, over metal removed. Metal pays for itself below "
    "1000 / reference_removal_rate of the scenario, by default 8.7."
)

RETURN = Column("return", "s", _RETURN, "mean_return")
FULL_COST = Column("full cost", "min/dm3", _FULL_COST, "full_cost", 2, 1, True, True)
RETURNS = (
    RETURN,
    FULL_COST,
    Column(
        "interquartile return",
        "s",
        "Mean of the middle half of all episodes' returns.",
        "interquartile_return",
    ),
    ClassRank("rank in class", "-", _CLASS_RANK, "class_rank", lower_is_better=True),
)
_FULL_COST_SHARE = (
    "Cost of time, edges, overload and breakage over the worth of the metal, sums of all jobs; above 100 the metal does not pay. "
    "It is not per volume, as volumes of different materials do not add up."
)
_JOB_SCORE = "Interquartile mean over jobs of the place of the return between the fixed nominal optimum, 0, and the causal oracle, 100."
_OVER_TRUTH = "Return less that of the best rule with true laws on the same jobs: what the nominal model's faults still cost."
_WITHOUT_LARGEST = (
    f"Mean lead over the best other rule without the {LARGEST} seeds on which the two differ most."
)
JOBS = (
    Column("full cost", "%", _FULL_COST_SHARE, "full_cost_share", 0, 100, lower_is_better=True),
    Column("job score", "-", _JOB_SCORE, "job_score", 0, 100),
    Column("over true laws", "s", _OVER_TRUTH, "over_truth"),
    Column("worst job", "s", "Lowest return of a job.", "worst_return"),
    Column(
        "feasible jobs",
        "% of jobs",
        "Jobs within the allowance of severe overload.",
        "feasible_jobs",
        0,
        100,
    ),
)
SCORE = (
    Column("score", "-", _SCORE, "score", 1, 100),
    Column("over causal", "s", _OVER_CAUSAL, "over_causal"),
)
COMPARISONS = (
    Column(
        "over fixed",
        "s",
        "Return less that of the task's best fixed parameters on the same seeds.",
        "over_fixed",
    ),
    Column(
        "over published",
        "s",
        "Return less that of the task's published controller on the same seeds.",
        "over_published",
    ),
    Column("over best other rule", "s", _BEST_RULE, "over_best_rule"),
    Column(
        "median lead",
        "s",
        "Median over seeds of the lead over the best other rule.",
        "median_over_best_rule",
        1,
    ),
    Column("lead without 3 largest", "s", _WITHOUT_LARGEST, "over_best_rule_without_largest", 1),
    Column(
        "beats best other rule",
        "% of seeds",
        "Seeds with a higher return than the best other rule's.",
        "beats_best_rule",
        0,
        100,
    ),
)
LIMITS = (
    Column(
        "over a limit",
        "%",
        "Share of cutting time above a limit of force or power.",
        "overload_share",
        2,
        100,
        True,
        True,
    ),
    Column("over by 2 %", "%", _EXCESS.format(2), "share_above_2_percent", 2, 100, True, True),
    Column(
        "severely over",
        "%",
        "Cutting time above a limit by more than its tolerance.",
        "severe_share",
        2,
        100,
        True,
        True,
    ),
    Column("over by 10 %", "%", _EXCESS.format(10), "share_above_10_percent", 2, 100, True, True),
    Column(
        "severely over, at least",
        "%",
        _SEVERE_LOWER_LIMIT,
        "severe_lower_limit",
        2,
        100,
        True,
        True,
    ),
    Column("severely over, at most", "%", _SEVERE_LIMIT, "severe_limit", 2, 100, True, True),
    Column(
        "excess",
        "%",
        "Mean excess over force and power limits, added, while cutting.",
        "excess",
        3,
        100,
        True,
        True,
    ),
)
CONSTRAINT = (
    Column("rank by cost", "-", _COST_RANK, "constraint_rank", lower_is_better=True),
    Column("cost", "min/dm3", _COST, "cost", 2, 1, True, True),
    Column("over least cost", "min/dm3", _OVER_CHEAPEST, "over_least_cost", 2, 1, True, True),
    Column("removal rate", "cm3/min", _REMOVAL_RATE, "removal_rate", 1, 1, True),
)
WORKSHOP = (
    Column("time", "min", _TIME, "minutes", 2, 1, True, True),
    Column("cost per part", "min", _PART_COST, "part_cost", 2, 1, True, True),
    Column("roughness deviation", "%", _DEVIATION, "roughness_deviation", 2, 100, True, True),
    Column(
        "edges", "edges", "Mean number of edges that an episode uses up.", "edges", 2, 1, True, True
    ),
    Column("broken edges", "per 100", _BROKEN, "broken_share", 1, 100, True, True),
    Column(
        "used life",
        "%",
        "Mean used share of the edge's life at the end of an episode.",
        "used_life",
        1,
        100,
        True,
    ),
)
GROUPS = {
    "Result": RETURNS,
    "Over the jobs of a family": JOBS,
    "Score": SCORE,
    "Constraint track": CONSTRAINT,
    "Limits": LIMITS,
    "Compared on the same seeds": COMPARISONS,
    "In the workshop": WORKSHOP,
    "Given in training": tuple(
        Training(name, "", f"Given in training: {what}.", name) for name, what in GIVEN.items()
    ),
    "Run time and budget": (
        *(
            Training(name, "", f"At run time the agent {what}.", name)
            for name, what in SEEN.items()
        ),
        Training("steps", "", "Environment steps of the training.", "steps"),
    ),
}


def ranking(scenario: Scenario) -> Column:
    """Return the column by which feasible policies are ranked on a scenario."""
    return {column.field: column for column in RETURNS}[ranked_by(scenario)]


_AIMS = ("part_cost", "roughness_deviation")  # of tasks that have them; of others, the return


def groups(standings: Sequence[Standing]) -> dict[str, list[Column]]:
    """Return the columns that apply to a ranking, by heading; the task's main numbers come first."""
    found = {heading: applying(group, standings) for heading, group in GROUPS.items()}
    aims = [column for column in found["In the workshop"] if column.field in _AIMS]
    found["Result"] = aims + found["Result"]
    found["In the workshop"] = [column for column in found["In the workshop"] if column not in aims]
    return {heading: group for heading, group in found.items() if group}


def applying(columns: Sequence[Column], standings: Sequence[Standing]) -> list[Column]:
    """Return the columns that have a value for at least one of the standings."""
    return [
        column
        for column in columns
        if any(column.value(standing) is not None for standing in standings)
    ]
