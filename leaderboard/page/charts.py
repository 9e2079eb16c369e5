"""The recorded trajectories of a leaderboard as data for the page's charts."""

import math
import zlib
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baselines.comparators import comparators
from leaderboard.ranking import Leaderboard
from leaderboard.trajectories import JobLimits, Trajectory
from turning_env import Scenario
from turning_env.rendering.plot_style import policy_look

LEVELS = 4_094  # a packed value is one of 0 to LEVELS, over the series' range: finer than a screen
GAP = LEVELS + 1  # stands for a missing value: the load of a tool in air
AXES = {"minutes": "machine time [min]", "path": "path [mm]"}  # axes along which a chart is drawn
ZERO_IN_AIR = ("thrust_force", "power", "roughness")  # series without a value in air


@dataclass(frozen=True)
class Subject:
    """One panel."""

    series: str
    heading: str
    unit: str
    from_zero: bool = True  # whether its axis begins at 0
    reference: str | None = None  # the series to be followed


def subjects(scenario: Scenario) -> list[Subject]:
    """Return the panels of a scenario."""
    panels = [
        Subject("cutting_speed", "cutting speed", unit="m/min", from_zero=False),
        Subject("feed", "feed", unit="mm/rev"),
        Subject("thrust_force", "thrust force", unit="N"),
        Subject("power", "power", unit="kW"),
    ]
    if scenario.control.aim == "roughness":
        panels.append(
            Subject(
                "roughness",
                "roughness Ra",
                unit="\N{MICRO SIGN}m",
                from_zero=False,
                reference="roughness_reference",
            )
        )
    panels.append(Subject("wear", "flank wear", unit="mm"))
    return panels


class SeriesRange(NamedTuple):
    """The lowest and the highest value of a series."""

    low: float
    high: float


def chart_data(leaderboard: Leaderboard) -> dict[str, Any] | None:
    """Return all that the charts need, as JSON can hold it; None if nothing was recorded.

    Policies stand in the order of the standings, each with a trajectory, or None, for each seed.
    From ``start`` on, the packed values of a trajectory are ``kept`` of each series in ``ranges``.
    ``limits`` holds those of each seed, by series.
    """
    if leaderboard.trajectories is None:
        return None
    task = leaderboard.task
    scenario = task.scenario
    recorded = leaderboard.trajectories.episodes
    panels = subjects(scenario)
    ranges = _ranges(panels, recorded)
    recorded_seeds = {trajectory.seed for trajectory in recorded}
    seeds = [seed for seed in task.seeds if seed in recorded_seeds]
    limits = {seed: JobLimits.of(scenario) for seed in seeds}
    for trajectory in recorded:
        if trajectory.limits is not None:
            limits[trajectory.seed] = trajectory.limits
    # After a whole part the tool may be in air, but force and power are the part's.
    missing_in_air = () if scenario.control.action == "part" else ZERO_IN_AIR

    names = leaderboard.names
    policies: dict[str, dict[str, Any]] = {}
    levels: list[NDArray[np.int64]] = []
    start = 0
    for trajectory in recorded:
        label = trajectory.policy.label
        name = names[label]
        if name not in policies:
            colour, _ = policy_look(name)
            trajectories = [None] * len(seeds)
            policies[name] = {"label": label, "colour": colour, "trajectories": trajectories}
        kept = len(trajectory.series["path"])
        place = seeds.index(trajectory.seed)
        policies[name]["trajectories"][place] = {
            "steps": trajectory.steps,
            "kept": kept,
            "start": start,
        }
        levels += _levels(trajectory, ranges, missing_in_air)
        start += kept * len(ranges)

    standings = [standing.name for standing in leaderboard.standings]
    compared = comparators(scenario, on_family=task.of_family is not None)
    second = compared.published or compared.fixed
    return {
        "axes": AXES,
        "seed_name": "seed" if task.of_family is None else "job",
        "seeds": seeds,
        "limits": [limits[seed].model_dump() for seed in seeds],
        "ranges": ranges,
        "subjects": [asdict(panel) for panel in panels],
        "policies": [policies.get(name) for name in standings],
        "second": standings.index(second) if second in standings else None,
        "packed": packed(np.concatenate(levels)),
    }


def _ranges(panels: Sequence[Subject], recorded: Sequence[Trajectory]) -> dict[str, SeriesRange]:
    """Return the range of each series that the charts show, over all trajectories."""
    series = list(AXES)
    for panel in panels:
        series.append(panel.series)
        if panel.reference is not None:
            series.append(panel.reference)
    return {
        name: SeriesRange(
            low=min(min(trajectory.series[name]) for trajectory in recorded),
            high=max(max(trajectory.series[name]) for trajectory in recorded),
        )
        for name in series
    }


def _levels(
    trajectory: Trajectory, ranges: dict[str, SeriesRange], missing_in_air: Sequence[str]
) -> list[NDArray[np.int64]]:
    """Return the series of a trajectory as levels; some are missing in air."""
    in_air = np.array(trajectory.series["depth_of_cut"]) == 0.0
    levels = []
    for name, (low, high) in ranges.items():
        values = np.array(trajectory.series[name], np.float64)
        if name in missing_in_air:
            values[in_air] = math.nan
        levels.append(quantise(values, low, high))
    return levels


def quantise(values: ArrayLike, low: float, high: float) -> NDArray[np.int64]:
    """Return values between ``low`` and ``high`` as 0 to ``LEVELS``, NaN as ``GAP``."""
    width = (high - low) or 1.0
    share = (np.asarray(values, np.float64) - low) / width
    return np.where(np.isnan(share), GAP, np.rint(share * LEVELS)).astype(np.int64)


def packed(levels: NDArray[np.int64]) -> str:
    """Return the differences of neighbours as base64 of compressed bytes.

    The lower bytes of all differences come first, then the upper bytes: neighbours are alike, so
    the upper bytes are nearly all equal and compress well.
    """
    differences = np.diff(levels, prepend=0).astype("<u2")
    by_byte = differences.view(np.uint8).reshape(-1, 2).T
    return b64encode(zlib.compress(by_byte.tobytes(), 9)).decode()
