"""Find settings of a measured set in which the slower of two edges wears more.

    python -m research.studies.slower_wear aist_turning_wear.csv

The file has the columns of the AIST readings of wear (repository KIT-AMEL/aist_machining_data). A
setting is a pair of work and tool material at one feed, depth and nose radius. It counts if the
slower edge has worn more at each of ``MIN_TIMES`` or more common cutting times. Built-up edges wear
so, and laws with one exponent of speed cannot. The size b of ``edge_failure.built_up_edge`` that
would explain a reversal, with a Taylor exponent of ``TAYLOR``, is

    1 + b = (V_fast / V_slow)^(1 / TAYLOR) * (W_slow / W_fast)^(1 / n)
"""

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from research.studies.measured_sets import read_rows
from turning_env.console import described, exits

MIN_TIMES = 3
TAYLOR = 0.3  # middle of the family shop's (assumption)
TIME_EXPONENT = 0.5  # n, middle of AIST's 0.39 to 0.73
SETTING = ("organization", "work_material", "tool_material", "nose_radius_mm", "feed_mm_rev")
DEPTH = "depth_of_cut_mm"

Wear = Mapping[float, float]
"""Flank wear [mm] by cutting time [min]."""


class Reversal(NamedTuple):
    """A pair of speeds of which the slower edge wears more."""

    speed_ratio: float  # of the faster to the slower [-]
    wear_ratio: float  # of the slower to the faster [-], median over common times

    @property
    def size(self) -> float:
        """Size b of a built-up edge that would explain it [-]."""
        by_speed = self.speed_ratio ** (1.0 / TAYLOR)
        by_wear = self.wear_ratio ** (1.0 / TIME_EXPONENT)
        return float(by_speed * by_wear - 1.0)


def settings_of(rows: Iterable[Mapping[str, str]]) -> list[dict[float, dict[float, float]]]:
    """Return the wear of each setting with several speeds, by speed [m/min]."""
    settings: dict[tuple[str, ...], dict[float, dict[float, float]]] = {}
    for row in rows:
        setting = tuple(row[name] for name in (*SETTING, DEPTH))
        speed = float(row["cutting_speed_m_min"])
        time = float(row["time_min"])
        by_speed = settings.setdefault(setting, {})
        wear = by_speed.setdefault(speed, {})
        wear[time] = float(row["flank_wear_mm"])
    return [dict(by_speed) for by_speed in settings.values() if len(by_speed) > 1]


def reversal_of(slow: Wear, fast: Wear, speed_ratio: float) -> Reversal | None:
    """Return the reversal of two edges, or None if the slower one does not always wear more."""
    times = sorted(slow.keys() & fast.keys())
    if len(times) < MIN_TIMES:
        return None
    ratios = [slow[time] / fast[time] for time in times]
    if min(ratios) <= 1.0:
        return None
    return Reversal(speed_ratio, float(np.median(ratios)))


def largest_reversal(speeds: Mapping[float, Wear]) -> Reversal | None:
    """Return the reversal of a setting with the largest ratio of wear, or None."""
    reversals = []
    for slow, fast in combinations(sorted(speeds), 2):
        reversal = reversal_of(speeds[slow], speeds[fast], fast / slow)
        if reversal is not None:
            reversals.append(reversal)
    return max(reversals, key=lambda reversal: reversal.wear_ratio, default=None)


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print what the file holds; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.slower_wear", **described(__doc__)
    )
    parser.add_argument("file", type=Path, help="CSV file of readings")
    options = parser.parse_args(arguments)
    settings = settings_of(read_rows(options.file))
    reversals = []
    for speeds in settings:
        reversal = largest_reversal(speeds)
        if reversal is not None:
            reversals.append(reversal)
    print(f"settings with several speeds: {len(settings)}")
    print(f"of these, the slower edge wears more in: {len(reversals)}")
    for name in ("speed_ratio", "wear_ratio", "size"):
        values = [getattr(reversal, name) for reversal in reversals]
        low, first, middle, third, high = np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0])
        middle_half = f"{first:.2f} to {third:.2f}"
        print(f"{name}: {low:.2f} to {high:.2f}, median {middle:.2f} ({middle_half})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
