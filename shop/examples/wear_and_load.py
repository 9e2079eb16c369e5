"""Measure how forces grow with flank wear in two public sets of turning.

    python shop/examples/wear_and_load.py vicomtech.csv Exp2.csv

The first file is the table of segments of Vicomtech/dataset-machine-tool-wear, the second that of experiment 2 of
shay-tham/turning. The thrust force is the resultant of feed and passive force.

* Exponent e: least squares of log F = a + e log VB with one e for all edges, and an a for each edge (first set) or setting
  (second set, in which every edge has one wear). Readings between 0.05 and 0.3 mm count.
* Growth: force at 0.3 mm over that at 0.1 mm, interpolated, as the mean over edges or settings with readings at both.
* Forms: for each edge of the first set, the median relative error of F = F0 (1 + b VB) and of F = k VB^e, both fitted to its own
  readings from 0.01 mm on.
"""

import csv
import lzma
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

LOWEST_WEAR = 0.05  # [mm]
FIRST_WEAR = 0.01  # [mm]; a power law has no force at 0
HIGHEST_WEAR = 0.305  # [mm]


@dataclass(frozen=True)
class Readings:
    """Readings of one set: arrays of the same length."""

    title: str
    group: Any  # edge (first set) or setting (second set)
    wear: Any  # flank wear [mm]
    forces: dict[str, Any]  # main and thrust force [N]

    @property
    def groups(self) -> Any:
        """Return the names of all groups."""
        return np.unique(self.group)


def table(path: Path) -> dict[str, Any]:
    """Return the columns of a CSV file, perhaps compressed by xz, as arrays of strings."""
    content = path.read_bytes()
    if path.suffix == ".xz":
        content = lzma.decompress(content)
    rows = list(csv.DictReader(content.decode("utf-8-sig").splitlines()))
    columns = {}
    for name in rows[0]:
        columns[name] = np.array([row[name] for row in rows])
    return columns


def vicomtech(path: Path) -> Readings:
    """Return the readings of the first set, grouped by edge."""
    columns = table(path)
    main = columns["F_c_MEAN"].astype(float)
    feed = columns["F_f_MEAN"].astype(float)
    passive = columns["F_p_MEAN"].astype(float)
    wear = columns["Vb"].astype(float) / 1000.0
    forces = {"main": main, "thrust": np.hypot(feed, passive)}
    return Readings(title="Vicomtech", group=columns["tool"], wear=wear, forces=forces)


def h13(path: Path) -> Readings:
    """Return the readings of the second set, one for each run, grouped by setting."""
    columns = table(path)
    # Each run has several rows, one for each reading of roughness; their forces are the same.
    _, first = np.unique(columns["Run_ID"], return_index=True)
    for name in columns:
        columns[name] = columns[name][first]

    main = columns["Fx"].astype(float)
    feed = columns["Fz"].astype(float)
    passive = columns["Fy"].astype(float)
    setting = columns["ap"].astype(object) + " " + columns["vc"] + " " + columns["f"]
    wear = columns["TCond"].astype(float)
    forces = {"main": main, "thrust": np.hypot(feed, passive)}
    return Readings(title="H13", group=setting.astype(str), wear=wear, forces=forces)


def exponent(readings: Readings, force: Any) -> float:
    """Return the exponent of wear that all groups share."""
    counts = (readings.wear >= LOWEST_WEAR) & (readings.wear <= HIGHEST_WEAR)
    group = readings.group[counts]
    log_wear = np.log(readings.wear[counts])
    log_force = np.log(force[counts])
    for name in np.unique(group):
        members = group == name
        log_wear[members] -= log_wear[members].mean()
        log_force[members] -= log_force[members].mean()
    return float(log_wear @ log_force / (log_wear @ log_wear))


def growth(readings: Readings, force: Any) -> list[float]:
    """Return the growth of force from 0.1 to 0.3 mm [-] of each group with readings at both."""
    ratios = []
    for name in readings.groups:
        members = readings.group == name
        levels, level_of = np.unique(readings.wear[members], return_inverse=True)
        if levels[0] > 0.1 or levels[-1] < 0.3:
            continue
        means = np.bincount(level_of, force[members]) / np.bincount(level_of)
        at_low, at_high = np.interp([0.1, 0.3], levels, means)
        ratios.append(float(at_high / at_low))
    return ratios


def affine_law(wear: Any, force: Any) -> tuple[float, float]:
    """Return the median relative error [-] of F = F0 (1 + b VB) on one edge, and b [1/mm]."""
    slope, fresh = np.polyfit(wear, force, 1)
    fitted = fresh + slope * wear
    return float(np.median(np.abs(fitted / force - 1.0))), float(slope / fresh)


def power_law_error(wear: Any, force: Any) -> float:
    """Return the median relative error [-] of F = k VB^e on one edge."""
    power, log_scale = np.polyfit(np.log(wear), np.log(force), 1)
    fitted = np.exp(log_scale) * wear**power
    return float(np.median(np.abs(fitted / force - 1.0)))


def compare_forms(readings: Readings, name: str) -> str:
    """Return a line that compares both laws on all edges."""
    affine_errors = []
    power_errors = []
    slopes = []  # b of edges whose first reading is of nearly no wear
    for edge in readings.groups:
        members = (readings.group == edge) & (readings.wear >= FIRST_WEAR)
        wear = readings.wear[members]
        force = readings.forces[name][members]
        error, slope = affine_law(wear, force)
        affine_errors.append(error)
        power_errors.append(power_law_error(wear, force))
        if wear.min() < LOWEST_WEAR:
            slopes.append(slope)

    better = int(np.sum(np.array(affine_errors) < np.array(power_errors)))
    affine = 100.0 * np.median(affine_errors)
    power = 100.0 * np.median(power_errors)
    line = f"{readings.title}, {name} force: affine law better on {better} of {len(affine_errors)} edges"
    line += f", median error {affine:.1f} against {power:.1f} %"
    return (
        line + f", b {min(slopes):.1f} to {max(slopes):.1f} per mm on the {len(slopes)} seen fresh"
    )


def fresh_share(readings: Readings, force: Any) -> float:
    """Return the force of a fresh edge over that at 0.1 mm [-], the mean over settings."""
    ratios = []
    for setting in readings.groups:
        members = readings.group == setting
        fresh = force[members & (readings.wear == 0.0)]
        worn = force[members & (readings.wear == 0.1)]
        ratios.append(fresh.mean() / worn.mean())
    return float(np.mean(ratios))


def main(vicomtech_path: str, h13_path: str) -> None:
    """Print exponents of both sets, forms of the first and shares of a fresh edge of the second."""
    first = vicomtech(Path(vicomtech_path))
    second = h13(Path(h13_path))
    for readings in (first, second):
        print(
            f"{readings.title}: {len(readings.wear)} readings, {len(readings.groups)} edges or settings"
        )
        for name, force in readings.forces.items():
            ratios = growth(readings, force)
            line = f"  {name} force: exponent {exponent(readings, force):.2f}"
            print(f"{line}; from 0.1 to 0.3 mm x{np.mean(ratios):.2f} (mean of {len(ratios)})")
    for name in first.forces:
        print(compare_forms(first, name))
    for name, force in second.forces.items():
        share = 100.0 * fresh_share(second, force)
        print(
            f"{second.title}, {name} force: a fresh edge has {share:.0f} % of the force at 0.1 mm"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
