"""What policies do on the way to their return, in numbers: how they use up an edge, enter a bar, and keep to the limits."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from leaderboard.result import ResultError
from leaderboard.trajectories import play_trajectory
from turning_env import Scenario
from turning_env.score.policy import PolicySpec

Array = NDArray[np.float64]

FIFTHS = 5
BEFORE, AFTER = 10.0, 40.0
"""The stretch on either side of a bar's start that counts as its entry [mm]."""
_MIN_INTERVALS = 5  # with fewer on that stretch nothing is seen of the entry
_SERIES = (
    "path",  # tool position, air and metal [mm]
    "depth_of_cut",  # [mm], 0 in air
    "hardness",  # relative to nominal [-], 0 in air
    "cutting_speed",  # [m/min]
    "feed",  # [mm/rev]
    "thrust_force",  # [N]
    "power",  # [kW]
    "wear",  # [mm]
    "used_life",  # [-]
)
_SUMS = (
    "engaged_time",  # this interval [s]
    "removed",  # this interval [cm3]
    "edges_used",  # this interval [-]
    "overload_time",  # this interval [s]
    "severe_overload_time",  # this interval [s]
)


@dataclass(frozen=True)
class Course:
    """One episode: arrays of shape (intervals,), with values at each interval's end or sums over it."""

    draw: int
    scenario: Scenario
    series: dict[str, Array]

    @classmethod
    def of(cls, contestant: PolicySpec, scenario: Scenario, draw: int) -> Self:
        """Play it.

        Raises:
            ResultError: the policy's actions have the wrong shape or are not finite.
        """
        try:
            series = play_trajectory(contestant.make, scenario, draw, (*_SERIES, *_SUMS))
        except ValueError as error:
            raise ResultError(f"{contestant.label} cannot play: {error}") from error
        return cls(draw, scenario, {name: np.array(values) for name, values in series.items()})

    def __getitem__(self, name: str) -> Array:
        return self.series[name]

    @property
    def cutting(self) -> NDArray[np.bool_]:
        """Whether the tool is in metal at each interval's end; after a whole part it never is."""
        return (self["depth_of_cut"] > 0.0) & (self.scenario.control.action != "part")

    @property
    def force_share(self) -> Array:
        """Thrust force over its limit [-]."""
        return self["thrust_force"] / self.scenario.limits.thrust_force

    @property
    def power_share(self) -> Array:
        """Power over its limit [-]."""
        return self["power"] / self.scenario.limits.power

    def bar_start(self, bar: int) -> float:
        """Where on the path a bar's metal begins [mm]."""
        workpiece = self.scenario.workpiece
        return bar * (workpiece.bar_length + workpiece.approach) + workpiece.approach

    @property
    def whole_bars(self) -> int:
        """How many bars were cut from end to end."""
        workpiece = self.scenario.workpiece
        return int((self["path"][-1] + 1e-6) / (workpiece.bar_length + workpiece.approach))

    def entries(self) -> Iterator[tuple[int, Array, NDArray[np.bool_]]]:
        """The entries into all whole bars but the first, before which there is no bar to come from.

        Yields the bar, every interval's place from the bar's start [mm], and which intervals lie from ``BEFORE`` to ``AFTER``.
        None where bars are too short or intervals too long to tell.
        """
        if self.scenario.workpiece.bar_length < BEFORE + AFTER:
            return
        for bar in range(1, self.whole_bars):
            place = self["path"] - self.bar_start(bar)
            near = (place > -BEFORE) & (place < AFTER)
            if near.sum() >= _MIN_INTERVALS:
                yield bar, place, near


@dataclass(frozen=True)
class Habit:
    """One number that says what a policy does."""

    name: str
    heading: str
    unit: str
    decimals: int


HABITS = (
    Habit("minutes_per_edge", "machine time per edge", "min", 2),
    Habit("removed_per_edge", "metal per edge", "cm3", 0),
    Habit("first_cutting_speed", "mean cutting speed in the first fifth of life", "m/min", 1),
    Habit("last_cutting_speed", "mean cutting speed in the last fifth of life", "m/min", 1),
    Habit("first_feed", "mean feed in the first fifth of life", "mm/rev", 3),
    Habit("last_feed", "mean feed in the last fifth of life", "mm/rev", 3),
    Habit("overload_share", "cutting time over a limit", "%", 2),
    Habit("severe_overload_share", "cutting time over a limit by more than the tolerance", "%", 2),
    Habit("feed_before_entry", f"feed {BEFORE:g} mm before a bar's start, of its mean in the bar", "%", 1),
    Habit("feed_at_entry", "feed at a bar's start, likewise", "%", 1),
    Habit("feed_after_entry", f"feed {BEFORE:g} mm after a bar's start, likewise", "%", 1),
)


def habits(courses: Sequence[Course]) -> dict[str, float]:
    """Each of ``HABITS`` of one policy over all its episodes; NaN where there is nothing to tell."""
    total = {name: sum(float(course[name].sum()) for course in courses) for name in _SUMS}
    total["minutes"] = sum(float(course["minutes"][-1]) for course in courses)
    speeds, feeds = fifths(courses, "cutting_speed"), fifths(courses, "feed")
    before, at, after = (_entry_feed(courses, place) for place in (-BEFORE, 0.0, BEFORE))
    return {
        "minutes_per_edge": _ratio(total["minutes"], total["edges_used"]),
        "removed_per_edge": _ratio(total["removed"], total["edges_used"]),
        "first_cutting_speed": float(speeds[0]),
        "last_cutting_speed": float(speeds[-1]),
        "first_feed": float(feeds[0]),
        "last_feed": float(feeds[-1]),
        "overload_share": 100.0 * _ratio(total["overload_time"], total["engaged_time"]),
        "severe_overload_share": 100.0 * _ratio(total["severe_overload_time"], total["engaged_time"]),
        "feed_before_entry": 100.0 * before,
        "feed_at_entry": 100.0 * at,
        "feed_after_entry": 100.0 * after,
    }


def fifths(courses: Sequence[Course], name: str) -> Array:
    """Means of a series over the cutting time in each fifth of the edge's life, shape (5,); NaN where an edge got not so far."""
    cutting = [course.cutting for course in courses]
    values, weights, used = (
        np.concatenate([course[key][cut] for course, cut in zip(courses, cutting, strict=True)])
        for key in (name, "engaged_time", "used_life")
    )
    fifth = np.clip((FIFTHS * used).astype(np.int64), 0, FIFTHS - 1)
    sums, times = (np.bincount(fifth, what, FIFTHS) for what in (values * weights, weights))
    means: Array = np.divide(sums, times, out=np.full(FIFTHS, np.nan), where=times > 0.0)
    return means


def as_json(played: Mapping[str, Sequence[Course]]) -> dict[str, dict[str, float | None]]:
    """The habits of each policy as JSON can hold them: None for what cannot be told."""
    return {
        label: {name: value if math.isfinite(value) else None for name, value in habits(courses).items()}
        for label, courses in played.items()
    }


def render(played: Mapping[str, Sequence[Course]]) -> str:
    """The habits as text: a row each, a column for every policy."""
    columns = [habits(courses) for courses in played.values()]
    rows = [["", *played]]
    for habit in HABITS:
        values = [column[habit.name] for column in columns]
        texts = [f"{value:.{habit.decimals}f}" if math.isfinite(value) else "" for value in values]
        rows.append([f"{habit.heading} [{habit.unit}]", *texts])
    widths = [max(map(len, texts)) for texts in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join([row[0].ljust(widths[0]), *(text.rjust(width) for text, width in zip(row[1:], widths[1:], strict=True))])
        for row in rows
    )


def _entry_feed(courses: Sequence[Course], place: float) -> float:
    """Mean over entries of the feed at a place from the bar's start [mm], over its mean deep in the same bars [-]."""
    near, deep = 0.0, 0.0
    for course in courses:
        for _, places, _ in course.entries():
            inside = (places >= AFTER) & (places < course.scenario.workpiece.bar_length) & course.cutting
            weights = course["engaged_time"][inside]
            if weights.sum() > 0.0:
                near += float(np.interp(place, places, course["feed"]))
                deep += float(np.average(course["feed"][inside], weights=weights))
    return _ratio(near, deep)


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0.0 else math.nan
