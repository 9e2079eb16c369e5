"""Recorded trajectories: what a few policies do, interval by interval, on one and the same draw."""

import math
from collections.abc import Sequence
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from baselines.policy import PolicyFactory
from leaderboard.results import Part, PolicyRecord
from turning_env import RoughTurningEnv, Scenario

SCHEMA: Literal["rough-turning/trajectories/2"] = "rough-turning/trajectories/2"
SERIES = (
    "path",  # tool position, air and metal [mm]
    "depth_of_cut",  # [mm], 0 in air
    "hardness",  # relative to nominal [-], 0 in air
    "commanded_cutting_speed",  # [m/min]
    "cutting_speed",  # [m/min]
    "commanded_feed",  # [mm/rev]
    "feed",  # [mm/rev]
    "thrust_force",  # [N]
    "power",  # [kW]
    "wear",  # [mm]
    "roughness",  # [um], 0 where none is held
    "roughness_reference",  # [um], likewise
)
"""Recorded from ``info`` at the end of every interval, beside ``minutes``, the machine time elapsed."""
_DIGITS = 6  # enough to draw
MOST_INTERVALS = 2000
"""Of longer episodes the start is kept."""


class Trajectory(Part):
    """One episode of one policy."""

    policy: PolicyRecord
    series: dict[str, list[float]]
    """``minutes`` and each of ``SERIES``, one value per interval."""

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if set(self.series) != {"minutes", *SERIES}:
            raise ValueError(f"series holds {', '.join(self.series)}, but must hold {', '.join(('minutes', *SERIES))}")
        if len({len(values) for values in self.series.values()}) != 1 or not self.series["minutes"]:
            raise ValueError("the series must be of one length, of at least one interval")
        return self


class Trajectories(Part):
    """Episodes of several policies on one draw."""

    schema_: Literal["rough-turning/trajectories/2"] = Field(alias="schema", default=SCHEMA)
    task: str
    """The task's digest."""
    draw: int
    episodes: list[Trajectory]

    def of_policies(self, task: str, policies: Sequence[PolicyRecord]) -> "Trajectories | None":
        """Those of this task and these very policies, or None if there are none."""
        episodes = [episode for episode in self.episodes if task == self.task and episode.policy in policies]
        return self.model_copy(update={"episodes": episodes}) if episodes else None


def record(policy: PolicyRecord, make: PolicyFactory, scenario: Scenario, draw: int) -> Trajectory:
    """Play one episode and keep its course, up to ``MOST_INTERVALS``."""
    course = play_course(make, scenario, draw, SERIES, MOST_INTERVALS)
    return Trajectory(policy=policy, series={name: [_rounded(value) for value in values] for name, values in course.items()})


def play_course(
    make: PolicyFactory, scenario: Scenario, draw: int, names: Sequence[str], most: float = math.inf
) -> dict[str, list[float]]:
    """Play one episode, or its first ``most`` intervals.

    Returns:
        ``minutes``, the machine time elapsed, and each of ``names`` in ``info``, at the end of every interval.

    Raises:
        ValueError: an action has the wrong shape or is not finite.
    """
    env = RoughTurningEnv(scenario)
    controller = make(1)
    observation, _ = env.reset(seed=draw)
    controller.reset(np.ones(1, np.bool_))
    series: dict[str, list[float]] = {name: [] for name in ("minutes", *names)}
    elapsed, ended = 0.0, False
    while not ended and len(series["minutes"]) < most:
        observation, _, terminated, truncated, info = env.step(controller.act(observation[None])[0])
        elapsed += info["time"] / 60.0
        series["minutes"].append(elapsed)
        for name in names:
            series[name].append(info[name])
        ended = terminated or truncated
    return series


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
