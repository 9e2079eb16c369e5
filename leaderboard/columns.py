"""The columns of a ranking, for the terminal, the page and the model cards.

A column has a heading, a unit and a definition, and reads its value from a ``Standing``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter

from leaderboard.inputs import RUN_TIME_INPUTS, TRAINING_INPUTS
from leaderboard.standings import LARGEST, Standing, ranked_by
from leaderboard.statistics import Estimate, Mean
from turning_env import Scenario


@dataclass(frozen=True)
class Cell:
    """A value as text."""

    text: str
    interval: str = ""
    number: float | None = None  # to sort by; None if there is no value or it is infinite
    # Low and high end of the interval, in the unit of number.
    ends: tuple[float, float] | None = None


EMPTY = Cell("")


@dataclass(frozen=True)
class Column:
    """One number of a standing."""

    heading: str
    unit: str
    definition: str
    path: str  # of the number in Standing, such as "overload.severe_share"
    decimals: int = 0  # lowest number of decimals; a narrow interval needs more
    factor: float = 1.0  # factor from the unit of Standing to unit
    # Whether a policy without episodes, such as the clairvoyant bound, lacks the number.
    of_play: bool = False
    lower_is_better: bool = False

    @property
    def key(self) -> str:
        """The name of the number in the output of ``--json``."""
        return self.path.rpartition(".")[2]

    def value(self, standing: Standing) -> Estimate | float | None:
        """Return the standing's value in the unit of ``Standing``, None if it has none."""
        if self.of_play and standing.operation.minutes == 0.0:
            return None
        value: Mean | Estimate | float | None = attrgetter(self.path)(standing)
        return value.estimate if isinstance(value, Mean) else value

    def cell(self, standing: Standing) -> Cell:
        """Return the standing's value in this column's unit, with its interval if it has one."""
        value = self.value(standing)
        if value is None:
            return EMPTY
        if not isinstance(value, Estimate):
            number = value if math.isfinite(value) else None
            return Cell(self._text(value, self.decimals), number=number)
        decimals = max(self.decimals, value.decimals(self.factor))
        low = self._text(value.low, decimals)
        high = self._text(value.high, decimals)
        return Cell(
            self._text(value.value, decimals),
            interval=f"{low} to {high}",
            number=value.value,
            ends=(value.low, value.high),
        )

    def _text(self, value: float, decimals: int) -> str:
        return f"{self.factor * value:.{decimals}f}"


@dataclass(frozen=True)
class TrainingInput(Column):
    """Whether an agent is given an input in training or at run time: ``key`` is its name."""

    def value(self, standing: Standing) -> float | None:
        """Return 1 or 0; None if the policy is no agent or its file does not state it."""
        inputs = standing.about.inputs
        if inputs is None or inputs.training is None:
            return None
        return float(self.key in inputs.training or self.key in inputs.run_time)

    def cell(self, standing: Standing) -> Cell:
        """Return "yes" or "no"; nothing if that is unknown."""
        value = self.value(standing)
        if value is None:
            return EMPTY
        return Cell("yes" if value else "no", number=value)


@dataclass(frozen=True)
class TrainingSteps(Column):
    """The environment steps of an agent's training."""

    def value(self, standing: Standing) -> float | None:
        """Return the number; None if the policy is no agent or its file does not state it."""
        inputs = standing.about.inputs
        return None if inputs is None else inputs.steps

    def cell(self, standing: Standing) -> Cell:
        """Return the number with commas; nothing if it is unknown."""
        value = self.value(standing)
        return EMPTY if value is None else Cell(f"{value:,}", number=value)


@dataclass(frozen=True)
class ClassRank(Column):
    """The rank within a class, with the class."""

    def cell(self, standing: Standing) -> Cell:
        """Return the rank, and the class in place of an interval."""
        rank = standing.class_rank
        if rank is None:
            return EMPTY
        return Cell(str(rank), interval=standing.about.policy_class, number=rank)


_EXCESS = (
    "Share of cutting time above a limit of force or power by more than {} %. Older results lack "
    "it."
)

RETURN = Column(
    "return",
    "s",
    definition="Mean over seeds and training seeds of the sum of an episode's rewards. If an "
    "episode is one edge and its metal does not pay, the return is higher if the edge ends early: "
    "compare full costs.",
    path="mean_return",
)
FULL_COST = Column(
    "full cost",
    "min/dm3",
    definition="Price of time, edges, breakage and overload in minutes of machine time, over metal "
    "removed. Metal pays for itself below 1000 / reference_removal_rate of the scenario, by "
    "default 8.7.",
    path="costs.full_cost",
    decimals=2,
    of_play=True,
    lower_is_better=True,
)
RETURNS = (
    RETURN,
    FULL_COST,
    Column(
        "interquartile return",
        "s",
        definition="Mean of the middle half of all episodes' returns.",
        path="interquartile_return",
    ),
    ClassRank(
        "rank in class",
        "-",
        definition="Rank among the policies of the same class, which were given alike: see the "
        "definitions of classes.",
        path="class_rank",
        lower_is_better=True,
    ),
)
JOBS = (
    Column(
        "full cost",
        "%",
        definition="Cost of time, edges, overload and breakage over the worth of the metal, sums "
        "of all jobs; above 100 the metal does not pay. It is not per volume, as volumes of "
        "different materials do not add up.",
        path="costs.full_cost_share",
        factor=100,
        lower_is_better=True,
    ),
    Column(
        "over true laws",
        "s",
        definition="Return less that of the best rule with true laws on the same jobs: what the "
        "nominal model's faults still cost.",
        path="leads.over_truth",
    ),
    Column("worst job", "s", definition="Lowest return of a job.", path="operation.worst_return"),
    Column(
        "feasible jobs",
        "% of jobs",
        definition="Jobs within the allowance of severe overload.",
        path="operation.feasible_jobs",
        factor=100,
    ),
)
SCORE = (
    Column(
        "score",
        "-",
        definition="Place of the mean return between that of the best fixed speed and feed, 0, and "
        "that of the causal oracle, 100, on the same seeds. Fixed parameters are tuned on tuning "
        "seeds, or on a family the best of each job's nominal model.",
        path="score",
        decimals=1,
    ),
    Column(
        "over causal",
        "s",
        definition="Return less that of the causal oracle on the same seeds: the price of not "
        "knowing the state and of imperfect control; for the clairvoyant bound, the value of "
        "foresight.",
        path="leads.over_causal",
    ),
)
COMPARISONS = (
    Column(
        "over fixed",
        "s",
        definition="Return less that of the task's best fixed parameters on the same seeds.",
        path="leads.over_fixed",
    ),
    Column(
        "over published",
        "s",
        definition="Return less that of the task's published controller on the same seeds.",
        path="leads.over_published",
    ),
    Column(
        "over best other rule",
        "s",
        definition="Return less that of the best other rule on the same seeds: of the rules that "
        "are not this policy, the one with the highest mean return, a feasible one if there is "
        "any. In the row of the best rule, this is its lead over the next rule.",
        path="leads.over_best_rule",
    ),
    Column(
        "median lead",
        "s",
        definition="Median over seeds of the lead over the best other rule.",
        path="leads.median_over_best_rule",
        decimals=1,
    ),
    Column(
        f"lead without {LARGEST} largest",
        "s",
        definition=f"Mean lead over the best other rule without the {LARGEST} seeds on which the "
        "two differ most.",
        path="leads.over_best_rule_without_largest",
        decimals=1,
    ),
    Column(
        "beats best other rule",
        "% of seeds",
        definition="Seeds with a higher return than the best other rule's.",
        path="leads.beats_best_rule",
        factor=100,
    ),
)
LIMITS = (
    Column(
        "over a limit",
        "%",
        definition="Share of cutting time above a limit of force or power.",
        path="overload.overload_share",
        decimals=2,
        factor=100,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "over by 2 %",
        "%",
        definition=_EXCESS.format(2),
        path="overload.share_above_2_percent",
        decimals=2,
        factor=100,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "severe overload",
        "%",
        definition="Cutting time above a limit by more than its tolerance.",
        path="overload.severe_share",
        decimals=2,
        factor=100,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "over by 10 %",
        "%",
        definition=_EXCESS.format(10),
        path="overload.share_above_10_percent",
        decimals=2,
        factor=100,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "severe overload, at least",
        "%",
        definition="Lower 95 % confidence limit (one-sided) of the time in severe overload. Above "
        "the allowance, it is infeasible.",
        path="overload.severe_lower_limit",
        decimals=2,
        factor=100,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "severe overload, at most",
        "%",
        definition="Upper 95 % confidence limit (one-sided) of the time in severe overload. Within "
        "the allowance, the policy is feasible.",
        path="overload.severe_limit",
        decimals=2,
        factor=100,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "excess",
        "%",
        definition="Mean excess over force and power limits, added, while cutting.",
        path="overload.excess",
        decimals=3,
        factor=100,
        of_play=True,
        lower_is_better=True,
    ),
)
CONSTRAINT = (
    Column(
        "rank by cost",
        "-",
        definition="Rank on the constraint track: feasible policies by cost, whatever their "
        "return.",
        path="constraint_rank",
        lower_is_better=True,
    ),
    Column(
        "cost",
        "min/dm3",
        definition="All that time, and the price of the edges used up, in minutes of machine time, "
        "over metal removed; overload is free.",
        path="costs.cost",
        decimals=2,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "over least cost",
        "min/dm3",
        definition="Cost less that of the cheapest other feasible policy on the same seeds.",
        path="costs.over_least_cost",
        decimals=2,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "removal rate",
        "cm3/min",
        definition="Metal removed over all time: machine time, edge changes and the downtime of "
        "breakages. An edge that the time limit leaves unfinished is charged its used share of a "
        "change.",
        path="operation.removal_rate",
        decimals=1,
        of_play=True,
    ),
)
WORKSHOP = (
    Column(
        "time",
        "min",
        definition="Mean time of an episode: machine time, edge changes, downtime of breakages.",
        path="operation.minutes",
        decimals=2,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "cost per part",
        "min",
        definition="Time per part, plus the price of the edges used up in minutes of machine time.",
        path="costs.part_cost",
        decimals=2,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "roughness deviation",
        "%",
        definition="Mean relative deviation of Ra from its set point; 1 in air.",
        path="operation.roughness_deviation",
        decimals=2,
        factor=100,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "edges",
        "edges",
        definition="Mean number of edges that an episode uses up.",
        path="operation.edges",
        decimals=2,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "broken edges",
        "per 100",
        definition="Edges broken, per hundred used up; an edge that the time limit leaves "
        "unfinished counts as its used share.",
        path="operation.broken_share",
        decimals=1,
        factor=100,
        of_play=True,
        lower_is_better=True,
    ),
    Column(
        "used life",
        "%",
        definition="Mean used share of the edge's life at the end of an episode.",
        path="operation.used_life",
        decimals=1,
        factor=100,
        of_play=True,
    ),
)
GIVEN_IN_TRAINING = tuple(
    TrainingInput(name, "", definition=f"Given in training: {meaning}.", path=name)
    for name, meaning in TRAINING_INPUTS.items()
)
SEEN_AT_RUN_TIME = tuple(
    TrainingInput(name, "", definition=f"At run time the agent {meaning}.", path=name)
    for name, meaning in RUN_TIME_INPUTS.items()
)
STEPS = TrainingSteps("steps", "", definition="Environment steps of the training.", path="steps")
GROUPS: dict[str, tuple[Column, ...]] = {
    "Result": RETURNS,
    "Over the jobs of a family": JOBS,
    "Score": SCORE,
    "Constraint track": CONSTRAINT,
    "Limits": LIMITS,
    "Compared on the same seeds": COMPARISONS,
    "In the workshop": WORKSHOP,
    "Given in training": GIVEN_IN_TRAINING,
    "Run time and budget": (*SEEN_AT_RUN_TIME, STEPS),
}
"""All columns by the heading of their group."""
TRAINING_GROUPS = ("Given in training", "Run time and budget")
"""Groups whose columns describe an agent's training in place of a number of its standing."""


def ranking(scenario: Scenario) -> Column:
    """Return the column by which feasible policies are ranked on a scenario."""
    return RETURN if ranked_by(scenario) == RETURN.key else FULL_COST


_AIMS = ("part_cost", "roughness_deviation")
"""Numbers that a task has if they are its aim; the aim of other tasks is the return."""


def groups(standings: Sequence[Standing]) -> dict[str, list[Column]]:
    """Return the columns that apply to a ranking, by heading; the task's aim comes first."""
    columns = {heading: applying(group, standings) for heading, group in GROUPS.items()}
    workshop = columns["In the workshop"]
    aims = [column for column in workshop if column.key in _AIMS]
    columns["Result"] = aims + columns["Result"]
    columns["In the workshop"] = [column for column in workshop if column not in aims]
    return {heading: group for heading, group in columns.items() if group}


def applying(columns: Sequence[Column], standings: Sequence[Standing]) -> list[Column]:
    """Return the columns that have a value for at least one of the standings."""
    return [
        column
        for column in columns
        if any(column.value(standing) is not None for standing in standings)
    ]
