"""The recorded trajectories of a leaderboard as data for the page's charts."""

import math
import zlib
from base64 import b64encode
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leaderboard.ranking import Leaderboard
from leaderboard.standings import comparators
from turning_env import Scenario
from turning_env.rendering.plot_style import policy_look

LEVELS = 4_094  # a packed value is one of 0 to LEVELS, over the series' range: finer than a screen
GAP = LEVELS + 1  # stands for a missing value: the load of a tool in air
AXES = {"minutes": "machine time [min]", "path": "path [mm]"}  # axes along which a chart is drawn


class Subject(NamedTuple):
    """One panel."""

    series: str
    heading: str
    unit: str
    limit: float | None = None
    from_zero: bool = True  # whether its axis begins at 0
    reference: str | None = None  # the series to be followed


def subjects(scenario: Scenario) -> list[Subject]:
    """Return the panels of a scenario."""
    found = [
        Subject("cutting_speed", "cutting speed", "m/min", from_zero=False),
        Subject("feed", "feed", "mm/rev"),
        Subject("thrust_force", "thrust force", "N", scenario.limits.thrust_force),
        Subject("power", "power", "kW", scenario.limits.power),
    ]
    if scenario.control.aim == "roughness":
        found.append(
            Subject(
                "roughness", "roughness Ra", "\N{MICRO SIGN}m", None, False, "roughness_reference"
            )
        )
    return [*found, Subject("wear", "flank wear", "mm", scenario.tool.wear_criterion)]


def chart_data(leaderboard: Leaderboard) -> dict[str, Any] | None:
    """Return all that the charts need, as JSON can hold it; None if nothing was recorded.

    Policies stand in the order of the standings, each with a trajectory, or None, for each seed. From ``start`` on, the packed
    values of a trajectory are ``kept`` of each series in ``ranges``.
    """
    if leaderboard.trajectories is None:
        return None
    scenario, recorded, standing_of = (
        leaderboard.task.scenario,
        leaderboard.trajectories.episodes,
        leaderboard.names,
    )
    panels = subjects(scenario)
    names = [
        *AXES,
        *(name for panel in panels for name in (panel.series, panel.reference) if name is not None),
    ]
    ends = {
        name: [
            value for each in recorded for value in (min(each.series[name]), max(each.series[name]))
        ]
        for name in names
    }
    ranges = {name: (min(values), max(values)) for name, values in ends.items()}
    # The tool's load and surface are nothing in air. After a whole part it may be in air, but force and power are the part's.
    gaps = () if scenario.control.action == "part" else ("thrust_force", "power", "roughness")
    seeds = [seed for seed in leaderboard.task.seeds if any(each.seed == seed for each in recorded)]
    by_policy: dict[str, dict[str, Any]] = {}
    levels: list[NDArray[np.int64]] = []
    for each in recorded:
        name, label = standing_of[each.policy.label], each.policy.label
        new = {"label": label, "colour": policy_look(name)[0], "trajectories": [None] * len(seeds)}
        policy = by_policy.setdefault(name, new)
        kept = len(each.series["path"])
        policy["trajectories"][seeds.index(each.seed)] = {
            "steps": each.steps,
            "kept": kept,
            "start": sum(map(len, levels)),
        }
        air = np.array(each.series["depth_of_cut"]) == 0.0
        for series, (low, high) in ranges.items():
            levels.append(
                quantise(np.where(air & (series in gaps), math.nan, each.series[series]), low, high)
            )
    standings = [standing.name for standing in leaderboard.standings]
    published = comparators(scenario).published
    return {
        "axes": AXES,
        "seeds": seeds,
        "ranges": ranges,
        "subjects": [panel._asdict() for panel in panels],
        "policies": [by_policy.get(name) for name in standings],
        "second": standings.index(published) if published in standings else None,
        "packed": pack(np.concatenate(levels)),
    }


def quantise(values: ArrayLike, low: float, high: float) -> NDArray[np.int64]:
    """Return values between ``low`` and ``high`` as 0 to ``LEVELS``, NaN as ``GAP``."""
    share = (np.asarray(values, np.float64) - low) / ((high - low) or 1.0)
    return np.where(np.isnan(share), GAP, np.rint(share * LEVELS)).astype(np.int64)


def pack(levels: NDArray[np.int64]) -> str:
    """Return the differences of neighbours as base64 of compressed bytes: first the lower byte of each, then the upper."""
    differences = np.diff(levels, prepend=0).astype("<u2")
    return b64encode(
        zlib.compress(differences.view(np.uint8).reshape(-1, 2).T.tobytes(), 9)
    ).decode()
