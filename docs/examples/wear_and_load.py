"""Measure how forces grow with flank wear in two public sets of turning.

    python docs/examples/wear_and_load.py vicomtech.csv Exp2.csv

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
from pathlib import Path
from typing import Any

import numpy as np

LOWEST_WEAR = 0.05  # [mm]
FIRST_WEAR = 0.01  # [mm]; a power law has no force at 0
HIGHEST_WEAR = 0.305  # [mm]


def table(path: Path) -> dict[str, Any]:
    """Return the columns of a CSV file, perhaps compressed by xz, as arrays of strings."""
    content = path.read_bytes()
    if path.suffix == ".xz":
        content = lzma.decompress(content)
    rows = list(csv.DictReader(content.decode("utf-8-sig").splitlines()))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def vicomtech(path: Path) -> tuple[Any, Any, dict[str, Any]]:
    """Return edges, wear [mm] and forces [N] of the first set."""
    columns = table(path)
    feed_force = columns["F_f_MEAN"].astype(float)
    passive_force = columns["F_p_MEAN"].astype(float)
    forces = {"main": columns["F_c_MEAN"].astype(float), "thrust": np.hypot(feed_force, passive_force)}
    return columns["tool"], columns["Vb"].astype(float) / 1000.0, forces


def h13(path: Path) -> tuple[Any, Any, dict[str, Any]]:
    """Return settings, wear [mm] and forces [N] of the second set, one reading for each run."""
    columns = table(path)
    _, first = np.unique(columns["Run_ID"], return_index=True)
    settings = np.array([" ".join(setting) for setting in zip(columns["ap"], columns["vc"], columns["f"], strict=True)])
    feed_force = columns["Fz"].astype(float)
    passive_force = columns["Fy"].astype(float)
    forces = {"main": columns["Fx"].astype(float)[first], "thrust": np.hypot(feed_force, passive_force)[first]}
    return settings[first], columns["TCond"].astype(float)[first], forces


def exponent(groups: Any, wear: Any, force: Any) -> float:
    """Return the exponent of wear that all groups share."""
    counts = (wear >= LOWEST_WEAR) & (wear <= HIGHEST_WEAR)
    log_wear = np.log(wear[counts])
    log_force = np.log(force[counts])
    for group in np.unique(groups[counts]):
        members = groups[counts] == group
        log_wear[members] -= log_wear[members].mean()
        log_force[members] -= log_force[members].mean()
    return float(log_wear @ log_force / (log_wear @ log_wear))


def growth(groups: Any, wear: Any, force: Any) -> tuple[float, int]:
    """Return the mean growth of force from 0.1 to 0.3 mm [-], and the number of groups with readings at both."""
    ratios = []
    for group in np.unique(groups):
        members = groups == group
        if wear[members].min() <= 0.1 and wear[members].max() >= 0.3:
            levels, level_of = np.unique(wear[members], return_inverse=True)
            means = np.bincount(level_of, force[members]) / np.bincount(level_of)
            at_low, at_high = np.interp([0.1, 0.3], levels, means)
            ratios.append(at_high / at_low)
    return float(np.mean(ratios)), len(ratios)


def median_errors(wear: Any, force: Any) -> tuple[float, float, float]:
    """Return the median relative errors [-] of the affine and the power law of one edge, and b [1/mm]."""
    slope, fresh = np.polyfit(wear, force, 1)
    power, log_scale = np.polyfit(np.log(wear), np.log(force), 1)
    affine_error = np.median(np.abs((fresh + slope * wear) / force - 1.0))
    power_error = np.median(np.abs(np.exp(log_scale) * wear**power / force - 1.0))
    return float(affine_error), float(power_error), float(slope / fresh)


def main(vicomtech_path: str, h13_path: str) -> None:
    """Print exponents of both sets, forms of the first and shares of a fresh edge of the second."""
    sets = {"Vicomtech": vicomtech(Path(vicomtech_path)), "H13": h13(Path(h13_path))}
    for title, (groups, wear, forces) in sets.items():
        print(f"{title}: {len(wear)} readings, {len(np.unique(groups))} edges or settings")
        for name, force in forces.items():
            found = exponent(groups, wear, force)
            ratio, count = growth(groups, wear, force)
            print(f"  {name} force: exponent {found:.2f}; from 0.1 to 0.3 mm x{ratio:.2f} (mean of {count})")

    edges, wear, forces = sets["Vicomtech"]
    for name, force in forces.items():
        found = []
        for edge in np.unique(edges):
            members = (edges == edge) & (wear >= FIRST_WEAR)
            found.append(median_errors(wear[members], force[members]))
        affine, power, slopes = np.array(found).T
        from_fresh = np.array([wear[edges == edge].min() < LOWEST_WEAR for edge in np.unique(edges)])
        print(
            f"Vicomtech, {name} force: affine law better on {np.sum(affine < power)} of {len(affine)} edges, "
            f"median error {100 * np.median(affine):.1f} against {100 * np.median(power):.1f} %, "
            f"b {slopes[from_fresh].min():.1f} to {slopes[from_fresh].max():.1f} per mm on the {from_fresh.sum()} seen fresh"
        )

    settings, wear, forces = sets["H13"]
    for name, force in forces.items():
        ratios = []
        for setting in np.unique(settings):
            fresh = force[(settings == setting) & (wear == 0.0)]
            worn = force[(settings == setting) & (wear == 0.1)]
            ratios.append(fresh.mean() / worn.mean())
        print(f"H13, {name} force: a fresh edge has {100 * np.mean(ratios):.0f} % of the force at 0.1 mm")


if __name__ == "__main__":
    main(*sys.argv[1:])
