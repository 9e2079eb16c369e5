"""Metrics of behaviour beside the return: use of edges, entries into bars, and overload."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from leaderboard.result import ResultError
from leaderboard.table import aligned
from leaderboard.trajectories import play_trajectory
from turning_env import Scenario
from turning_env.scoring.policy import PolicySpec

Array = NDArray[np.float64]

LIFE_STAGES = 5
"""Equal parts into which an edge's life is divided."""
BEFORE, AFTER = 10.0, 40.0
"""Stretch on either side of a bar's start that counts as its entry [mm]."""
_MIN_STEPS = 5  # with fewer on that stretch nothing is seen of the entry
_STATES = ("path", "depth_of_cut", "hardness", "cutting_speed", "feed", "thrust_force", "power", "wear", "used_life")
_SUMS = ("engaged_time", "removed", "edges_used", "overload_time", "severe_overload_time")
"""Fields of ``info`` at a step's end, and sums over a step: for units see ``RoughTurningEnv``."""


@dataclass(frozen=True)
class Episode:
    """One episode: ``minutes``, the machine time elapsed, and fields of ``info``, arrays of shape (steps,)."""

    seed: int
    scenario: Scenario
    series: dict[str, Array]

    @classmethod
    def of(cls, spec: PolicySpec, scenario: Scenario, seed: int) -> Self:
        """Play it.

        Raises:
            ResultError: the policy's actions have the wrong shape or are not finite.
        """
        try:
            series = play_trajectory(spec.make, scenario, seed, (*_STATES, *_SUMS))
        except ValueError as error:
            raise ResultError(f"{spec.label} cannot play: {error}") from error
        return cls(seed, scenario, {name: np.array(values) for name, values in series.items()})

    def __getitem__(self, name: str) -> Array:
        return self.series[name]

    @property
    def cutting(self) -> NDArray[np.bool_]:
        """Whether the tool is in metal at each step's end; after a whole part it never is."""
        return (self["depth_of_cut"] > 0.0) & (self.scenario.control.action != "part")

    @property
    def force_load(self) -> Array:
        """Thrust force over its limit [-]."""
        return self["thrust_force"] / self.scenario.limits.thrust_force

    @property
    def power_load(self) -> Array:
        """Power over its limit [-]."""
        return self["power"] / self.scenario.limits.power

    def bar_start(self, bar: int) -> float:
        """Return where on the path a bar's metal begins [mm]."""
        workpiece = self.scenario.workpiece
        return bar * (workpiece.bar_length + workpiece.approach) + workpiece.approach

    @property
    def whole_bars(self) -> int:
        """Number of bars that were cut from end to end."""
        workpiece = self.scenario.workpiece
        return int((self["path"][-1] + 1e-6) / (workpiece.bar_length + workpiece.approach))

    def entries(self) -> Iterator[tuple[Array, NDArray[np.bool_]]]:
        """Yield the entries into all whole bars but the first, which no other bar precedes.

        An entry is every step's place from the bar's start [mm], and which steps lie from ``BEFORE`` to ``AFTER``. There are
        none where bars are too short or steps too long to tell.
        """
        if self.scenario.workpiece.bar_length < BEFORE + AFTER:
            return
        for bar in range(1, self.whole_bars):
            place = self["path"] - self.bar_start(bar)
            near = (place > -BEFORE) & (place < AFTER)
            if near.sum() >= _MIN_STEPS:
                yield place, near


class Metric(NamedTuple):
    """Heading, unit and format of a metric of behaviour."""

    heading: str
    unit: str
    decimals: int


METRICS = {
    "minutes_per_edge": Metric("machine time per edge", "min", 2),
    "removed_per_edge": Metric("metal per edge", "cm3", 0),
    "first_cutting_speed": Metric("mean cutting speed in the first fifth of life", "m/min", 1),
    "last_cutting_speed": Metric("mean cutting speed in the last fifth of life", "m/min", 1),
    "first_feed": Metric("mean feed in the first fifth of life", "mm/rev", 3),
    "last_feed": Metric("mean feed in the last fifth of life", "mm/rev", 3),
    "overload_share": Metric("cutting time over a limit", "%", 2),
    "severe_overload_share": Metric("cutting time over a limit by more than the tolerance", "%", 2),
    "feed_before_entry": Metric(f"feed {BEFORE:g} mm before a bar's start, over its mean in the bar", "%", 1),
    "feed_at_entry": Metric("feed at a bar's start, likewise", "%", 1),
    "feed_after_entry": Metric(f"feed {BEFORE:g} mm after a bar's start, likewise", "%", 1),
}


def measure(episodes: Sequence[Episode]) -> dict[str, float]:
    """Return each of ``METRICS`` over all episodes of one policy; NaN where there is nothing to tell."""
    edges, removed, engaged, overload, severe = (
        sum(float(episode[name].sum()) for episode in episodes)
        for name in ("edges_used", "removed", "engaged_time", "overload_time", "severe_overload_time")
    )
    speeds, feeds = by_life_stage(episodes, "cutting_speed"), by_life_stage(episodes, "feed")
    values = (
        _ratio(sum(float(episode["minutes"][-1]) for episode in episodes), edges),
        _ratio(removed, edges),
        *(float(each) for each in (speeds[0], speeds[-1], feeds[0], feeds[-1])),
        100.0 * _ratio(overload, engaged),
        100.0 * _ratio(severe, engaged),
        *(100.0 * _entry_feed(episodes, place) for place in (-BEFORE, 0.0, BEFORE)),
    )
    return dict(zip(METRICS, values, strict=True))


def by_life_stage(episodes: Sequence[Episode], name: str) -> Array:
    """Return means of a series over the cutting time in each stage of life, shape (LIFE_STAGES,); NaN for stages not reached."""
    values, weights, used = (
        np.concatenate([episode[key][episode.cutting] for episode in episodes]) for key in (name, "engaged_time", "used_life")
    )
    stage = np.clip((LIFE_STAGES * used).astype(np.int64), 0, LIFE_STAGES - 1)
    sums, times = (np.bincount(stage, what, LIFE_STAGES) for what in (values * weights, weights))
    means: Array = np.divide(sums, times, out=np.full(LIFE_STAGES, np.nan), where=times > 0.0)
    return means


def render(played: Mapping[str, Sequence[Episode]]) -> str:
    """Return the metrics as text: a line each, a column for every policy."""
    columns = [measure(episodes) for episodes in played.values()]
    rows = [["", *played]]
    for name, metric in METRICS.items():
        values = [f"{column[name]:.{metric.decimals}f}" if math.isfinite(column[name]) else "" for column in columns]
        rows.append([f"{metric.heading} [{metric.unit}]", *values])
    return aligned(rows)


def _entry_feed(episodes: Sequence[Episode], place: float) -> float:
    """Return the mean feed at a place from bars' starts [mm], over its mean deep in the same bars [-]."""
    near, deep = 0.0, 0.0
    for episode in episodes:
        for places, _ in episode.entries():
            inside = (places >= AFTER) & (places < episode.scenario.workpiece.bar_length) & episode.cutting
            weights = episode["engaged_time"][inside]
            if weights.sum() > 0.0:
                near += float(np.interp(place, places, episode["feed"]))
                deep += float(np.average(episode["feed"][inside], weights=weights))
    return _ratio(near, deep)


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0.0 else math.nan
