"""Compute the numbers of the presets ``h13_romi`` and ``vicomtech``, and of the family ``shop2``.

    python -m research.studies.measured_sets h13 Exp1.csv Exp2.csv Prep.csv
    python -m research.studies.measured_sets vicomtech Dataset_Machine_tool_wear.csv

The tables are those of github.com/shay-tham/turning and
github.com/Vicomtech/dataset-machine-tool-wear, which the project does not ship. Loads follow
F = F0 (1 + b VB); the thrust force is the resultant of feed and passive force. Lengths are in mm,
forces in N, times in min.
"""

import argparse
import csv
import lzma
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from turning_env.console import UserError, described, exits

GROWTHS = np.linspace(0.0, 15.0, 301)  # values of b that are compared [1/mm]
HIGHEST_WEAR = 0.4  # of readings to which the lines of Vicomtech are fitted [mm]
LOWEST_WEAR = 0.02  # of readings to which wear over time is fitted, likewise
CRITERION = 0.3
WEARS = (0.05, 0.3)  # between which exponents of wear are fitted
WORN = 0.15  # wear that an edge reaches, so that its wear over time counts
ROWS_AT_LEAST = 20  # of an edge, likewise for exponents

Columns = dict[str, Any]
Numbers = dict[str, float]


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file, perhaps compressed by xz.

    Raises:
        UserError: there is no such file, or it has no rows.
    """
    if not path.is_file():
        raise UserError(f"there is no file {path}")
    content = path.read_bytes()
    if path.suffix == ".xz":
        content = lzma.decompress(content)
    rows = list(csv.DictReader(content.decode("utf-8-sig").splitlines()))
    if not rows:
        raise UserError(f"{path} has no rows")
    return rows


def first_of_each(rows: Sequence[dict[str, str]], *keys: str) -> list[dict[str, str]]:
    """Return the first row of each run: further ones hold its other readings of roughness."""
    runs: dict[tuple[str, ...], dict[str, str]] = {}
    for row in rows:
        runs.setdefault(tuple(row[key] for key in keys), row)
    return list(runs.values())


def column(rows: Sequence[dict[str, str]], name: str) -> Any:
    """Return a column of numbers."""
    return np.array([float(row[name]) for row in rows])


def residual_spreads(residuals: Any, edges: Any) -> tuple[float, float]:
    """Return the standard deviations of residuals within edges, and of edges."""
    names = np.unique(edges)
    means = np.array([residuals[edges == name].mean() for name in names])
    sizes = np.array([(edges == name).sum() for name in names])
    deviations = residuals - means[np.searchsorted(names, edges)]
    within = (deviations**2).sum() / (len(residuals) - len(names))
    # The mean of an edge's residuals scatters by those within it, too.
    between = max(means.var(ddof=1) - within * (1.0 / sizes).mean(), 0.0)
    return float(np.sqrt(within)), float(np.sqrt(between))


def fit_law(runs: Sequence[dict[str, str]], force: Any) -> Numbers:
    """Return the law F = c V^a f^x d^w (1 + b VB) with the least squares of log F."""
    wear = column(runs, "TCond")
    settings = np.column_stack(
        [np.ones(len(runs)), *(np.log(column(runs, name)) for name in ("vc", "f", "ap"))]
    )
    best: Any = None
    for growth in GROWTHS:
        log_force = np.log(force) - np.log1p(growth * wear)
        solution = np.linalg.lstsq(settings, log_force, rcond=None)[0]
        residuals = log_force - settings @ solution
        squares = residuals @ residuals
        if best is None or squares < best[0]:
            best = (squares, growth, solution, residuals)
    squares, growth, solution, residuals = best
    edges = np.array([row["Tool_ID"] for row in runs])
    within, between = residual_spreads(residuals, edges)
    return {
        "coefficient at 1 m/min, 1 mm/rev, 1 mm": float(np.exp(solution[0])),
        "exponent of speed": float(solution[1]),
        "exponent of feed": float(solution[2]),
        "exponent of depth": float(solution[3]),
        "b [1/mm]": float(growth),
        "residuals": float(np.sqrt(squares / (len(runs) - settings.shape[1] - 1))),
        "within edges": within,
        "between edges": between,
        "highest [N]": float(force.max()),
        "repeats": spread_of_repeats(runs, force),
    }


def spread_of_repeats(runs: Sequence[dict[str, str]], force: Any) -> float:
    """Return the log standard deviation of runs of one edge at one setting."""
    groups: dict[tuple[str, ...], list[float]] = {}
    for row, value in zip(runs, force, strict=True):
        place = tuple(row[name] for name in ("Tool_ID", "ap", "vc", "f", "TCond"))
        groups.setdefault(place, []).append(float(np.log(value)))
    variances = [np.var(values, ddof=1) for values in groups.values() if len(values) > 1]
    return float(np.sqrt(np.mean(variances))) if variances else float("nan")


def fit_wear(time: Any, wear: Any, edges: Any, weights: Any) -> tuple[float, Any]:
    """Return the exponent n and each edge's log K of W = K t^n, with one n for all edges."""
    names = np.unique(edges)
    log_time = np.log(time)
    log_wear = np.log(wear)
    mean_time = np.array([log_time[edges == name].mean() for name in names])
    mean_wear = np.array([log_wear[edges == name].mean() for name in names])
    place = np.searchsorted(names, edges)
    times = log_time - mean_time[place]
    wears = log_wear - mean_wear[place]
    exponent = (weights * times * wears).sum() / (weights * times**2).sum()
    return float(exponent), mean_wear - exponent * mean_time


def h13(exp1: Path, exp2: Path, prep: Path) -> dict[str, Numbers]:
    """Return the numbers of ``h13_romi`` by what they describe."""
    runs = first_of_each([*read_rows(exp1), *read_rows(exp2)], "Run_ID")
    main = column(runs, "Fx")
    thrust = np.hypot(column(runs, "Fy"), column(runs, "Fz"))
    readings = []
    for row in first_of_each(read_rows(prep), "Tool_ID", "CTime"):
        if row["TCond"] not in ("na", "") and float(row["TCond"]) > 0.0:
            readings.append(row)
    time = column(readings, "CTime")
    wear = column(readings, "TCond")
    depth = column(readings, "ap")
    edges = np.array([row["Tool_ID"] for row in readings])
    exponent, log_factors = fit_wear(time, wear, edges, weights=np.ones(len(time)))
    edge_depth = np.array([depth[edges == name][0] for name in np.unique(edges)])
    numbers: dict[str, Numbers] = {
        "main force": fit_law(runs, main),
        "thrust force": fit_law(runs, thrust),
        "power": {"highest [kW]": float((main * column(runs, "vc")).max() / 60000.0)},
        "wear": {"exponent of time": exponent},
    }
    squares = 0.0
    for value in np.unique(edge_depth):
        factors = log_factors[edge_depth == value]
        squares += ((factors - factors.mean()) ** 2).sum()
        factor = np.exp(factors.mean())
        numbers["wear"][f"K at {value:g} mm [mm]"] = float(factor)
        numbers["wear"][f"life at {value:g} mm [min]"] = float(
            (CRITERION / factor) ** (1.0 / exponent)
        )
    free = len(edge_depth) - len(np.unique(edge_depth))
    numbers["wear"]["log spread of edges, within depths"] = float(np.sqrt(squares / free))
    return numbers


def vicomtech(path: Path) -> dict[str, Numbers]:
    """Return the numbers of ``vicomtech`` by what they describe; lines are those of fresh edges."""
    rows = read_rows(path)
    wear = column(rows, "Vb") / 1000.0
    edges = np.array([row["tool"] for row in rows])
    main = column(rows, "F_c_MEAN")
    thrust = np.hypot(column(rows, "F_f_MEAN"), column(rows, "F_p_MEAN"))
    seen_fresh = [name for name in np.unique(edges) if wear[edges == name][0] < WEARS[0]]
    numbers = {
        "main force": lines(wear, main, edges=edges, names=seen_fresh),
        "thrust force": lines(wear, thrust, edges=edges, names=seen_fresh),
    }
    for name, force in (("main force", main), ("thrust force", thrust)):
        numbers[name]["spread of exponents of wear"] = spread_of_exponents(wear, force, edges)
        numbers[name]["highest up to 0.3 mm [N]"] = float(force[wear <= CRITERION].max())

    # Rows are consecutive seconds: see the preset. Each edge counts alike, however many it has.
    times, wears, owners, weights = [], [], [], []
    for name in np.unique(edges):
        of_edge = wear[edges == name]
        if of_edge[0] > 0.0 or of_edge.max() < WORN:
            continue
        minutes = (np.arange(len(of_edge)) + 1.0) / 60.0
        counts = (of_edge > LOWEST_WEAR) & (of_edge < HIGHEST_WEAR)
        times.append(minutes[counts])
        wears.append(of_edge[counts])
        owners.append(np.full(counts.sum(), name))
        weights.append(np.full(counts.sum(), 1.0 / counts.sum()))
    exponent, log_factors = fit_wear(
        np.concatenate(times),
        np.concatenate(wears),
        edges=np.concatenate(owners),
        weights=np.concatenate(weights),
    )
    of_one_edge = []
    for edge in zip(times, wears, owners, weights, strict=True):
        of_one_edge.append(fit_wear(*edge)[0])
    factor = float(np.exp(log_factors.mean()))
    numbers["wear"] = {
        "edges": len(times),
        "exponent of time": exponent,
        "lowest exponent of an edge": min(of_one_edge),
        "highest exponent of an edge": max(of_one_edge),
        "spread of the exponents": float(np.std(of_one_edge, ddof=1)),
        "K [mm]": factor,
        "log spread of edges": float(log_factors.std(ddof=1)),
        "life [min]": (CRITERION / factor) ** (1.0 / exponent),
    }
    return numbers


def lines(wear: Any, force: Any, edges: Any, names: Sequence[str]) -> Numbers:
    """Return medians and spreads of the lines F = F0 (1 + b VB) of some edges."""
    fresh, growth, scatter = [], [], []
    for name in names:
        counts = (edges == name) & (wear <= HIGHEST_WEAR)
        slope, intercept = np.polyfit(wear[counts], force[counts], 1)
        line = intercept + slope * wear[counts]
        fresh.append(intercept)
        growth.append(slope / intercept)
        scatter.append((force[counts] / line - 1.0).std())
    half_worn = np.array(fresh) * (1.0 + WORN * np.array(growth))
    return {
        "edges": len(names),
        "F0 [N]": float(np.median(fresh)),
        "log spread of F0": float(np.log(fresh).std(ddof=1)),
        "b [1/mm]": float(np.median(growth)),
        "lowest b [1/mm]": min(growth),
        "highest b [1/mm]": max(growth),
        "log spread of b": float(np.log(growth).std(ddof=1)),
        "log spread at 0.15 mm": float(np.log(half_worn).std(ddof=1)),
        "scatter about the line": float(np.median(scatter)),
        "lowest scatter": min(scatter),
        "highest scatter": max(scatter),
    }


def spread_of_exponents(wear: Any, force: Any, edges: Any) -> float:
    """Return the standard deviation between edges of the exponents of wear of a force."""
    exponents = []
    for name in np.unique(edges):
        counts = (edges == name) & (wear >= WEARS[0]) & (wear <= WEARS[1])
        if counts.sum() > ROWS_AT_LEAST and np.ptp(wear[counts]) > 0.08:
            exponents.append(np.polyfit(np.log(wear[counts]), np.log(force[counts]), 1)[0])
    return float(np.std(exponents, ddof=1))


SETS: dict[str, Callable[..., dict[str, Numbers]]] = {"h13": h13, "vicomtech": vicomtech}
FILES = {"h13": 3, "vicomtech": 1}


@exits(UserError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the numbers; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.measured_sets", **described(__doc__)
    )
    parser.add_argument("set", choices=SETS)
    parser.add_argument("files", nargs="+", type=Path, help="its tables, as in the example")
    options = parser.parse_args(arguments)
    needed = FILES[options.set]
    if len(options.files) != needed:
        parser.error(f"{options.set} needs {needed} files, got {len(options.files)}")
    for what, numbers in SETS[options.set](*options.files).items():
        for name, value in numbers.items():
            print(f"{what}, {name}: {value:.4g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
