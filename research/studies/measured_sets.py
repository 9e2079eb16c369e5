"""Compute the numbers of the presets ``h13_romi`` and ``vicomtech``, and of the family ``shop``.

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
from typing import Any, NamedTuple

import numpy as np

from turning_env.console import UserError, described, exits

GROWTHS = np.linspace(0.0, 15.0, 301)
"""Values of b that are compared [1/mm]."""
SETTING = ("Tool_ID", "ap", "vc", "f", "TCond")
"""Columns that repeats have in common."""
CRITERION = 0.3  # tool-life criterion [mm]
HALF_WORN = 0.15  # likewise; edges that wore less do not count for wear over time
HIGHEST_WEAR = 0.4  # of readings that count; later ones belong to edges that are worn out
LOWEST_WEAR = 0.02  # of readings of wear over time that count
FRESH_WEAR = 0.05  # an edge whose first reading is below was seen fresh
MIN_READINGS = 20  # of an edge, for an exponent of wear
MIN_RANGE = 0.08  # of its wear, likewise [mm]

Numbers = dict[str, Any]
"""Numbers by what they are."""


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
        run = tuple(row[key] for key in keys)
        runs.setdefault(run, row)
    return list(runs.values())


def column(rows: Sequence[dict[str, str]], name: str) -> Any:
    """Return a column of numbers."""
    return np.array([float(row[name]) for row in rows])


class Spreads(NamedTuple):
    """Standard deviations of residuals."""

    within: float  # within edges
    between: float  # between edges


class ForceLaw(NamedTuple):
    """The law of a force, F = c V^a f^x d^w (1 + b VB), and its residuals."""

    squares: float  # sum of squared residuals of log F
    growth: float  # b [1/mm]
    solution: Any  # log c and the exponents of speed, feed and depth
    residuals: Any  # of log F, one a run


class WearOverTime(NamedTuple):
    """Readings of wear over cutting time, W = K t^n. Arrays have the same length."""

    time: Any  # [min]
    wear: Any  # [mm]
    edges: Any  # name of each reading's edge


class WearLaw(NamedTuple):
    """The exponent n of all edges, and the logarithm of each edge's factor K."""

    exponent: float
    log_factors: Any


class Line(NamedTuple):
    """The line F = F0 (1 + b VB) of one edge."""

    fresh: float  # F0 [N]
    growth: float  # b [1/mm]
    scatter: float  # standard deviation of the force over the line, less 1


def residual_spreads(residuals: Any, edges: Any) -> Spreads:
    """Return the spreads of residuals within edges and between them."""
    names = np.unique(edges)
    means = []
    sizes = []
    squares = 0.0
    for name in names:
        of_edge = residuals[edges == name]
        mean = of_edge.mean()
        deviations = of_edge - mean
        means.append(mean)
        sizes.append(len(of_edge))
        squares += (deviations**2).sum()
    freedom = len(residuals) - len(names)
    within = squares / freedom
    # The mean of an edge's residuals scatters by those within it, too.
    by_chance = within * np.mean(1.0 / np.array(sizes))
    between = max(np.var(means, ddof=1) - by_chance, 0.0)
    return Spreads(
        within=float(np.sqrt(within)),
        between=float(np.sqrt(between)),
    )


def fit_law(runs: Sequence[dict[str, str]], force: Any) -> ForceLaw:
    """Return the law of a force with the least squares of log F."""
    wear = column(runs, "TCond")
    settings = np.ones((len(runs), 4))
    for i, name in enumerate(("vc", "f", "ap"), start=1):
        settings[:, i] = np.log(column(runs, name))
    # Given b, log F is linear in the other numbers.
    best = ForceLaw(
        squares=np.inf,
        growth=0.0,
        solution=None,
        residuals=None,
    )
    for growth in GROWTHS:
        by_wear = np.log1p(growth * wear)
        log_force = np.log(force) - by_wear
        solution, *_ = np.linalg.lstsq(settings, log_force, rcond=None)
        residuals = log_force - settings @ solution
        squares = float(residuals @ residuals)
        if squares < best.squares:
            best = ForceLaw(
                squares=squares,
                growth=growth,
                solution=solution,
                residuals=residuals,
            )
    return best


def describe_law(runs: Sequence[dict[str, str]], force: Any) -> Numbers:
    """Return the numbers of the law of a force, and the spreads of its residuals."""
    law = fit_law(runs, force)
    edges = np.array([row["Tool_ID"] for row in runs])
    spreads = residual_spreads(law.residuals, edges)
    num_fitted = len(law.solution) + 1  # b, too
    return {
        "coefficient at 1 m/min, 1 mm/rev, 1 mm": np.exp(law.solution[0]),
        "exponent of speed": law.solution[1],
        "exponent of feed": law.solution[2],
        "exponent of depth": law.solution[3],
        "b [1/mm]": law.growth,
        "residuals": np.sqrt(law.squares / (len(runs) - num_fitted)),
        "within edges": spreads.within,
        "between edges": spreads.between,
        "highest [N]": force.max(),
        "repeats": spread_of_repeats(runs, force),
    }


def spread_of_repeats(runs: Sequence[dict[str, str]], force: Any) -> float:
    """Return the log standard deviation of runs of one edge at one setting."""
    groups: dict[tuple[str, ...], list[float]] = {}
    for row, log_force in zip(runs, np.log(force), strict=True):
        setting = tuple(row[name] for name in SETTING)
        repeats = groups.setdefault(setting, [])
        repeats.append(log_force)

    variances = []
    for repeats in groups.values():
        if len(repeats) > 1:
            variance = np.var(repeats, ddof=1)
            variances.append(variance)
    if not variances:
        return float("nan")
    return float(np.sqrt(np.mean(variances)))


def fit_wear(readings: WearOverTime, by_edge: bool = False) -> WearLaw:
    """Return the wear law with the least squares of log W, with one exponent for all edges.

    Args:
        readings: the readings.
        by_edge: whether each edge counts alike, however many readings it has.
    """
    log_times = []
    log_wears = []
    product = 0.0
    square = 0.0
    for name in np.unique(readings.edges):
        of_edge = readings.edges == name
        log_time = np.log(readings.time[of_edge])
        log_wear = np.log(readings.wear[of_edge])
        mean_time = log_time.mean()
        mean_wear = log_wear.mean()
        weight = 1.0
        if by_edge:
            weight = 1.0 / len(log_time)
        # Each edge has a factor of its own, so only deviations from its means count.
        deviation = log_time - mean_time
        wear_deviation = log_wear - mean_wear
        product += weight * (deviation * wear_deviation).sum()
        square += weight * (deviation**2).sum()
        log_times.append(mean_time)
        log_wears.append(mean_wear)
    exponent = product / square
    log_factors = np.array(log_wears) - exponent * np.array(log_times)
    return WearLaw(exponent, log_factors)


def life(factor: float, exponent: float) -> float:
    """Return the cutting time until W = K t^n reaches the criterion [min]."""
    return float((CRITERION / factor) ** (1.0 / exponent))


def h13(exp1: Path, exp2: Path, prep: Path) -> dict[str, Numbers]:
    """Return the numbers of ``h13_romi`` by what they describe."""
    runs = first_of_each([*read_rows(exp1), *read_rows(exp2)], "Run_ID")
    main = column(runs, "Fx")
    thrust = np.hypot(column(runs, "Fy"), column(runs, "Fz"))
    power = main * column(runs, "vc") / 60000.0
    return {
        "main force": describe_law(runs, main),
        "thrust force": describe_law(runs, thrust),
        "power": {"highest [kW]": power.max()},
        "wear": h13_wear(prep),
    }


def h13_wear(prep: Path) -> Numbers:
    """Return the numbers of wear over time, at each depth.

    Columns: Tool_ID names the edge, CTime is its cutting time [min], TCond its flank wear [mm], and
    ap the depth of cut [mm].
    """
    rows = []
    for row in first_of_each(read_rows(prep), "Tool_ID", "CTime"):
        wear = row["TCond"]
        if wear not in ("na", "") and float(wear) > 0.0:
            rows.append(row)
    edges = np.array([row["Tool_ID"] for row in rows])
    readings = WearOverTime(
        column(rows, "CTime"),
        column(rows, "TCond"),
        edges=edges,
    )
    law = fit_wear(readings)

    depth = column(rows, "ap")
    first_depths = [depth[edges == name][0] for name in np.unique(edges)]
    depth_of_edge = np.array(first_depths)
    depths = np.unique(depth_of_edge)
    numbers = {"exponent of time": law.exponent}
    squares = 0.0
    for value in depths:
        log_factors = law.log_factors[depth_of_edge == value]
        mean = log_factors.mean()
        factor = np.exp(mean)
        numbers[f"K at {value:g} mm [mm]"] = factor
        numbers[f"life at {value:g} mm [min]"] = life(factor, law.exponent)
        squares += ((log_factors - mean) ** 2).sum()
    # The mean of each depth takes one degree of freedom.
    degrees_of_freedom = len(depth_of_edge) - len(depths)
    numbers["log spread of edges, within depths"] = np.sqrt(squares / degrees_of_freedom)
    return numbers


def vicomtech(path: Path) -> dict[str, Numbers]:
    """Return the numbers of ``vicomtech`` by what they describe; lines are those of fresh edges."""
    rows = read_rows(path)
    wear = column(rows, "Vb") / 1000.0
    edges = np.array([row["tool"] for row in rows])
    main = column(rows, "F_c_MEAN")
    thrust = np.hypot(column(rows, "F_f_MEAN"), column(rows, "F_p_MEAN"))
    return {
        "main force": describe_lines(wear, main, edges=edges),
        "thrust force": describe_lines(wear, thrust, edges=edges),
        "wear": vicomtech_wear(wear, edges),
    }


def line_of(wear: Any, force: Any) -> Line:
    """Return the line of an edge by its readings."""
    slope, intercept = np.polyfit(wear, force, 1)
    expected_force = intercept + slope * wear
    scatter = (force / expected_force - 1.0).std()
    return Line(fresh=intercept, growth=slope / intercept, scatter=scatter)


def describe_lines(wear: Any, force: Any, edges: Any) -> Numbers:
    """Return medians and spreads of the lines of all edges that were seen fresh."""
    lines = []
    for name in np.unique(edges):
        of_edge = edges == name
        counts = of_edge & (wear <= HIGHEST_WEAR)
        if wear[of_edge][0] < FRESH_WEAR:
            lines.append(line_of(wear[counts], force[counts]))
    fresh = np.array([line.fresh for line in lines])
    growth = np.array([line.growth for line in lines])
    scatter = np.array([line.scatter for line in lines])
    half_worn = fresh * (1.0 + HALF_WORN * growth)
    return {
        "edges": len(lines),
        "F0 [N]": np.median(fresh),
        "log spread of F0": np.log(fresh).std(ddof=1),
        "b [1/mm]": np.median(growth),
        "lowest b [1/mm]": growth.min(),
        "highest b [1/mm]": growth.max(),
        "log spread of b": np.log(growth).std(ddof=1),
        "log spread at 0.15 mm": np.log(half_worn).std(ddof=1),
        "scatter about the line": np.median(scatter),
        "lowest scatter": scatter.min(),
        "highest scatter": scatter.max(),
        "spread of exponents of wear": spread_of_exponents(wear, force, edges),
        "highest up to 0.3 mm [N]": force[wear <= CRITERION].max(),
    }


def spread_of_exponents(wear: Any, force: Any, edges: Any) -> float:
    """Return the standard deviation between edges of the exponents of wear of a force."""
    within_life = (wear >= FRESH_WEAR) & (wear <= CRITERION)
    exponents = []
    for name in np.unique(edges):
        chosen = (edges == name) & within_life
        edge_wear = wear[chosen]
        edge_force = force[chosen]
        # A short range of wear determines no exponent.
        if len(edge_wear) > MIN_READINGS and np.ptp(edge_wear) > MIN_RANGE:
            slope, _ = np.polyfit(np.log(edge_wear), np.log(edge_force), 1)
            exponents.append(slope)
    return float(np.std(exponents, ddof=1))


def vicomtech_wear(wear: Any, edges: Any) -> Numbers:
    """Return the numbers of wear over time of the edges that were seen fresh and wore far enough.

    Rows are consecutive seconds of cutting, as the preset says.
    """
    exponents = []
    times = []
    wears = []
    owners = []
    for name in np.unique(edges):
        of_edge = wear[edges == name]
        if of_edge[0] > 0.0 or of_edge.max() < HALF_WORN:
            continue
        minutes = (np.arange(len(of_edge)) + 1.0) / 60.0
        counts = (of_edge > LOWEST_WEAR) & (of_edge < HIGHEST_WEAR)
        readings = WearOverTime(
            time=minutes[counts], wear=of_edge[counts], edges=np.full(counts.sum(), name)
        )
        exponents.append(fit_wear(readings).exponent)
        times.append(readings.time)
        wears.append(readings.wear)
        owners.append(readings.edges)
    all_readings = WearOverTime(
        time=np.concatenate(times), wear=np.concatenate(wears), edges=np.concatenate(owners)
    )
    law = fit_wear(all_readings, by_edge=True)
    factor = np.exp(law.log_factors.mean())
    return {
        "edges": len(exponents),
        "exponent of time": law.exponent,
        "lowest exponent of an edge": min(exponents),
        "highest exponent of an edge": max(exponents),
        "spread of the exponents": np.std(exponents, ddof=1),
        "K [mm]": factor,
        "log spread of edges": law.log_factors.std(ddof=1),
        "life [min]": life(factor, law.exponent),
    }


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
    for subject, numbers in SETS[options.set](*options.files).items():
        for name, value in numbers.items():
            print(f"{subject}, {name}: {value:.4g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
