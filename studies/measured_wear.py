"""Check intervals, the spread of edges and the form of the wear curve against measured wear.

    python -m studies.measured_wear aist_turning_wear.csv
    python -m studies.measured_wear aist_turning_wear.csv --json

The sheet has the columns work_material, tool_material, organization, cutting_speed_m_min, feed_mm_rev, depth_of_cut_mm, time_min
and flank_wear_mm, as made from the turning data of the KIT-AMEL/aist_machining_data repository. An edge is one pair, organization
and setting. Every fifth edge of the sheet is left out in turn; its readings are predicted by the law of its pair of materials.

The law of a pair is log W = c + a log V + n log t, with (c, a, n) normal about a common mean; edges and readings add normal
deviations. The mean is estimated by generalised least squares, the variances by maximum likelihood without the edges left out.
"""

import argparse
import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize, stats

from turning_env.console import described, exits, print_json

Values = NDArray[np.float64]

FOLDS = 5
LEVEL = 0.95
LONG = 6
"""Fewest readings of an edge whose curve is compared."""
REFERENCE_SPEED = 150.0
"""Cutting speed [m/min] at which the logarithm in the law is 0."""


class Readings(NamedTuple):
    """Readings of wear, one per row."""

    pair: NDArray[np.int64]
    edge: NDArray[np.int64]
    design: Values
    """1, log V, log t, shape (rows, 3)."""
    wear: Values
    """log W."""

    def of(self, rows: NDArray[np.bool_]) -> "Readings":
        """Return some of the rows."""
        return Readings(self.pair[rows], self.edge[rows], self.design[rows], self.wear[rows])


class Variances(NamedTuple):
    """Variances of the law."""

    law: Values
    """Covariance of c, a and n from pair to pair."""
    edge: float
    reading: float


def read(path: Path) -> Readings:
    """Return the readings of a sheet.

    Raises:
        ValueError: A column is missing or a cell is not a number above 0.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    try:
        pairs = [(row["work_material"], row["tool_material"]) for row in rows]
        settings = ("organization", "cutting_speed_m_min", "feed_mm_rev", "depth_of_cut_mm")
        edges = [(*pair, *(row[name] for name in settings)) for pair, row in zip(pairs, rows, strict=True)]
        numbers = np.array([[float(row[name]) for name in ("cutting_speed_m_min", "time_min", "flank_wear_mm")] for row in rows])
    except KeyError as error:
        raise ValueError(f"{path}: there is no column {error}") from error
    if not len(rows) or not (numbers > 0).all():
        raise ValueError(f"{path}: needs readings with speed, time and wear above 0")
    speed, time, wear = np.log(numbers.T)
    design = np.column_stack([np.ones(len(rows)), speed - np.log(REFERENCE_SPEED), time])
    pair, edge = (np.unique(np.array([str(name) for name in names]), return_inverse=True)[1] for names in (pairs, edges))
    return Readings(pair, edge, design, wear)


def covariance(first: Readings, second: Readings, variances: Variances) -> Values:
    """Return the covariance of readings of one pair of materials, without the scatter of single readings."""
    same_edge = first.edge[:, np.newaxis] == second.edge
    return np.asarray(first.design @ variances.law @ second.design.T + variances.edge * same_edge)


def pairs_of(readings: Readings) -> list[Readings]:
    """Return the readings of each pair."""
    return [readings.of(readings.pair == pair) for pair in np.unique(readings.pair)]


def unpacked(numbers: Values) -> Variances:
    """Return variances from the logarithms and entries over which the likelihood is maximised."""
    root = np.zeros((3, 3))
    root[np.tril_indices(3)] = numbers[:6]
    root[np.diag_indices(3)] = np.exp(root[np.diag_indices(3)])
    return Variances(root @ root.T, float(np.exp(2 * numbers[6])), float(np.exp(2 * numbers[7])))


def mean_law(pairs: list[Readings], variances: Variances) -> tuple[Values, Values, float]:
    """Return the mean of c, a and n, its covariance, and twice the negative log likelihood."""
    information, target, fitted, log_determinant = np.zeros((3, 3)), np.zeros(3), 0.0, 0.0
    for rows in pairs:
        root = linalg.cholesky(covariance(rows, rows, variances) + variances.reading * np.eye(len(rows.wear)), lower=True)
        whitened = linalg.solve_triangular(root, np.column_stack([rows.design, rows.wear]), lower=True)
        information += whitened[:, :3].T @ whitened[:, :3]
        target += whitened[:, :3].T @ whitened[:, 3]
        fitted += float(whitened[:, 3] @ whitened[:, 3])
        log_determinant += 2.0 * float(np.log(np.diag(root)).sum())
    mean = np.linalg.solve(information, target)
    return (
        np.asarray(mean, np.float64),
        np.asarray(np.linalg.inv(information), np.float64),
        fitted - float(target @ mean) + log_determinant,
    )


def estimate(readings: Readings) -> Variances:
    """Return the variances of greatest likelihood."""
    pairs = pairs_of(readings)
    start = np.array([-0.5, 0.0, -0.7, 0.0, 0.0, -2.0, -2.0, -2.0])
    bounds = [(-5.0, 3.0), (-3.0, 3.0), (-5.0, 3.0), (-3.0, 3.0), (-3.0, 3.0), (-5.0, 3.0), (-6.0, 1.0), (-6.0, 1.0)]

    def loss(numbers: Values) -> float:
        return mean_law(pairs, unpacked(numbers))[2]

    found = optimize.minimize(loss, start, method="L-BFGS-B", bounds=bounds)
    return unpacked(found.x)


def predict(known: Readings, left_out: Readings, variances: Variances) -> tuple[Values, Values]:
    """Return the mean and standard deviation of each reading left out, from the readings known."""
    mean, uncertainty, _ = mean_law(pairs_of(known), variances)
    centre, deviation = np.empty(len(left_out.wear)), np.empty(len(left_out.wear))
    for pair in np.unique(left_out.pair):
        rows, at = known.of(known.pair == pair), left_out.pair == pair
        wanted = left_out.of(at)
        own = covariance(rows, rows, variances) + variances.reading * np.eye(len(rows.wear))
        weights = np.linalg.solve(own, covariance(rows, wanted, variances)).T if len(rows.wear) else np.zeros((at.sum(), 0))
        centre[at] = wanted.design @ mean + weights @ (rows.wear - rows.design @ mean)
        spread = covariance(wanted, wanted, variances) - weights @ covariance(rows, wanted, variances)
        rest = wanted.design - weights @ rows.design
        deviation[at] = np.sqrt(np.diag(spread + rest @ uncertainty @ rest.T) + variances.reading)
    return centre, deviation


def coverage(readings: Readings) -> dict[str, float]:
    """Return the share of left-out edges' readings within the intervals, and how wide these are."""
    quantile, z = float(stats.norm.ppf(0.5 + 0.5 * LEVEL)), np.empty(len(readings.wear))
    alone = np.array([len(np.unique(readings.edge[readings.pair == pair])) == 1 for pair in readings.pair])
    widths = np.empty(len(z))
    # Neighbours in the order of edges belong to one pair, so each pair loses one edge of five.
    for fold in range(FOLDS):
        out = readings.edge % FOLDS == fold
        centre, deviation = predict(readings.of(~out), readings.of(out), estimate(readings.of(~out)))
        z[out], widths[out] = (readings.wear[out] - centre) / deviation, quantile * deviation
    inside = np.abs(z) <= quantile
    return {
        "readings": len(z),
        "edges": len(np.unique(readings.edge)),
        "pairs": len(np.unique(readings.pair)),
        "inside": float(inside.mean()),
        "inside_pair_known": float(inside[~alone].mean()),
        "below": float((z < -quantile).mean()),
        "above": float((z > quantile).mean()),
        "typical_factor": float(np.exp(np.median(widths))),
    }


def _line(time: Values, start: float, rate: float) -> Values:
    """Return the logarithm of a straight line over the logarithm of time."""
    return np.asarray(np.log(np.exp(start) + np.exp(rate + time)))


def _aicc(residuals: Values, parameters: int) -> float:
    count = len(residuals)
    variance = max(float(residuals @ residuals) / count, 1e-12)
    return count * float(np.log(variance)) + 2 * parameters * count / (count - parameters - 1)


def curves(readings: Readings) -> dict[str, float]:
    """Compare the power law with a straight line and with three phases on edges with many readings, by AICc."""
    better = {"line": 0, "three_phases": 0}
    bends, exponents, criteria = [], [], np.zeros(3)
    edges = [edge for edge in np.unique(readings.edge) if (readings.edge == edge).sum() >= LONG]
    for edge in edges:
        rows = readings.of(readings.edge == edge)
        time, count = rows.design[:, 2], len(rows.wear)
        found = [np.polynomial.Polynomial.fit(time, rows.wear, degree) for degree in (1, 2, 3)]
        start = (rows.wear[0], -4.0)
        line = optimize.curve_fit(_line, time, rows.wear, start, maxfev=20000)[0]
        predicted = ((found[0](time), 3), (_line(time, *line), 3), (found[2](time), 5))
        aicc = [_aicc(rows.wear - centre, parameters) for centre, parameters in predicted if count > parameters + 1]
        aicc += [np.inf] * (3 - len(aicc))
        better["line"] += aicc[1] < aicc[0] - 2
        better["three_phases"] += aicc[2] < aicc[0] - 2
        criteria += np.where(np.isfinite(aicc), aicc, aicc[0])
        exponents.append(float(found[0].convert().coef[1]))
        bends.append(float(found[1].convert().coef[2]))
    return {
        "edges": len(edges),
        "median_exponent": float(np.median(exponents)),
        "line_better": better["line"] / len(edges),
        "three_phases_better": better["three_phases"] / len(edges),
        "bending_up": float(np.mean(np.array(bends) > 0)),
        "line_less_power_law": float(criteria[1] - criteria[0]),
        "three_phases_less_power_law": float(criteria[2] - criteria[0]),
    }


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Compute and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.measured_wear", **described(__doc__))
    parser.add_argument("sheet", type=Path, help="CSV file of readings")
    parser.add_argument("--json", action="store_true", help="print all numbers as JSON")
    parsed = parser.parse_args(arguments)
    readings = read(parsed.sheet)
    variances = estimate(readings)
    mean = mean_law(pairs_of(readings), variances)[0]
    found = {
        "spread": {"edge": variances.edge**0.5, "reading": variances.reading**0.5},
        "law": {name: [float(mean[i]), float(variances.law[i, i] ** 0.5)] for i, name in ((1, "cutting_speed"), (2, "time"))},
        "coverage": coverage(readings),
        "curves": curves(readings),
    }
    if parsed.json:
        print_json(found)
        return 0
    held, curve, law, spread = found["coverage"], found["curves"], found["law"], found["spread"]
    print(f"{held['readings']} readings of {held['edges']} edges, {held['pairs']} pairs of materials")
    print(f"exponent of time {law['time'][0]:.2f}, {law['time'][1]:.2f} from pair to pair")
    print(f"exponent of cutting speed {law['cutting_speed'][0]:.2f}, {law['cutting_speed'][1]:.2f} from pair to pair")
    print(f"edges differ by {spread['edge']:.2f}, readings by {spread['reading']:.2f} (standard deviations of log wear)")
    print(f"95 % intervals hold {100 * held['inside']:.1f} % of the readings of edges left out")
    print(f"  {100 * held['below']:.1f} % are below, {100 * held['above']:.1f} % above")
    print(f"  their ends typically lie a factor of {held['typical_factor']:.2f} from the prediction")
    print(f"{curve['edges']} edges of {LONG} readings or more, against the power law by AICc less 2:")
    print(
        f"  a line is better for {100 * curve['line_better']:.0f} %, three phases for {100 * curve['three_phases_better']:.0f} %"
    )
    print(f"  {100 * curve['bending_up']:.0f} % bend upwards in logarithms")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
