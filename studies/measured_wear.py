"""Check intervals, the spread of edges and the form of the wear curve against measured wear.

    python -m studies.measured_wear aist_turning_wear.csv

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

from turning_env.console import described, exits

Values = NDArray[np.float64]

FOLDS = 5
LEVEL = 0.95
LONG = 6
"""Fewest readings of an edge whose curve is compared."""
REFERENCE_SPEED = 150.0
"""Cutting speed [m/min] at which the logarithm in the law is 0."""
SETTING = ("work_material", "tool_material", "organization", "cutting_speed_m_min", "feed_mm_rev", "depth_of_cut_mm")
"""Columns that tell edges apart; the first two are the pair of materials."""
NUMBERS = ("cutting_speed_m_min", "time_min", "flank_wear_mm")
_BOUNDS = [(-5.0, 3.0), (-3.0, 3.0), (-5.0, 3.0), (-3.0, 3.0), (-3.0, 3.0), (-5.0, 3.0), (-6.0, 1.0), (-6.0, 1.0)]


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

    def pairs(self) -> list["Readings"]:
        """Return the readings of each pair of materials."""
        return [self.of(self.pair == pair) for pair in np.unique(self.pair)]


class Variances(NamedTuple):
    """Variances of the law."""

    law: Values
    """Covariance of c, a and n from pair to pair."""
    edge: float
    reading: float

    def between(self, first: Readings, second: Readings) -> Values:
        """Return the covariance of readings of one pair of materials, without the scatter of single readings."""
        same_edge = first.edge[:, np.newaxis] == second.edge
        return np.asarray(first.design @ self.law @ second.design.T + self.edge * same_edge)

    def of(self, rows: Readings) -> Values:
        """Return the covariance of readings of one pair of materials."""
        return self.between(rows, rows) + self.reading * np.eye(len(rows.wear))


def read(path: Path) -> Readings:
    """Return the readings of a sheet.

    Raises:
        ValueError: A column is missing or a cell is not a number above 0.
    """
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    try:
        edges = [tuple(row[name] for name in SETTING) for row in rows]
        numbers = np.array([[float(row[name]) for name in NUMBERS] for row in rows])
    except KeyError as error:
        raise ValueError(f"{path}: there is no column {error}") from error
    if not len(rows) or not (numbers > 0).all():
        raise ValueError(f"{path}: needs readings with speed, time and wear above 0")
    speed, time, wear = np.log(numbers.T)
    design = np.column_stack([np.ones(len(rows)), speed - np.log(REFERENCE_SPEED), time])
    pair, edge = (np.unique([str(each[:n]) for each in edges], return_inverse=True)[1] for n in (2, len(SETTING)))
    return Readings(pair, edge, design, wear)


def mean_law(readings: Readings, variances: Variances) -> tuple[Values, Values, float]:
    """Return the mean of c, a and n, its covariance, and twice the negative log likelihood."""
    information, target, deviance = np.zeros((3, 3)), np.zeros(3), 0.0
    for rows in readings.pairs():
        root = linalg.cholesky(variances.of(rows), lower=True)
        whitened = linalg.solve_triangular(root, np.column_stack([rows.design, rows.wear]), lower=True)
        information += whitened[:, :3].T @ whitened[:, :3]
        target += whitened[:, :3].T @ whitened[:, 3]
        deviance += float(whitened[:, 3] @ whitened[:, 3]) + 2.0 * float(np.log(np.diag(root)).sum())
    mean = np.asarray(np.linalg.solve(information, target), np.float64)
    return mean, np.asarray(np.linalg.inv(information), np.float64), deviance - float(target @ mean)


def estimate(readings: Readings) -> Variances:
    """Return the variances of greatest likelihood."""

    def variances(numbers: Values) -> Variances:
        root = np.zeros((3, 3))
        root[np.tril_indices(3)] = numbers[:6]
        root[np.diag_indices(3)] = np.exp(root[np.diag_indices(3)])
        return Variances(root @ root.T, float(np.exp(2 * numbers[6])), float(np.exp(2 * numbers[7])))

    def loss(numbers: Values) -> float:
        return mean_law(readings, variances(numbers))[2]

    start = np.array([-0.5, 0.0, -0.7, 0.0, 0.0, -2.0, -2.0, -2.0])
    return variances(optimize.minimize(loss, start, method="L-BFGS-B", bounds=_BOUNDS).x)


def predict(known: Readings, left_out: Readings, variances: Variances) -> tuple[Values, Values]:
    """Return the mean and standard deviation of each reading left out, from the readings known."""
    mean, uncertainty, _ = mean_law(known, variances)
    centre, deviation = np.empty((2, len(left_out.wear)))
    for pair in np.unique(left_out.pair):
        rows, at = known.of(known.pair == pair), left_out.pair == pair
        wanted = left_out.of(at)
        weights = np.linalg.solve(variances.of(rows), variances.between(rows, wanted)).T
        centre[at] = wanted.design @ mean + weights @ (rows.wear - rows.design @ mean)
        spread = variances.between(wanted, wanted) - weights @ variances.between(rows, wanted)
        rest = wanted.design - weights @ rows.design
        deviation[at] = np.sqrt(np.diag(spread + rest @ uncertainty @ rest.T) + variances.reading)
    return centre, deviation


def coverage(readings: Readings) -> tuple[float, float, float, float]:
    """Predict edges left out; return the shares of readings within, below and above the intervals, and their typical factor."""
    quantile = float(stats.norm.ppf(0.5 + 0.5 * LEVEL))
    z, widths = np.empty((2, len(readings.wear)))
    # Neighbours in the order of edges belong to one pair, so each pair loses one edge of five.
    for fold in range(FOLDS):
        out = readings.edge % FOLDS == fold
        centre, deviation = predict(readings.of(~out), readings.of(out), estimate(readings.of(~out)))
        z[out], widths[out] = (readings.wear[out] - centre) / deviation, quantile * deviation
    below, above = float((z < -quantile).mean()), float((z > quantile).mean())
    return 1.0 - below - above, below, above, float(np.exp(np.median(widths)))


def curves(readings: Readings) -> dict[str, float]:
    """Compare the power law with a straight line and with three phases on edges with many readings, by AICc less 2."""

    def line(time: Values, start: float, rate: float) -> Values:
        return np.asarray(np.log(np.exp(start) + np.exp(rate + time)))

    def aicc(residuals: Values, parameters: int) -> float:
        count = len(residuals)
        if count <= parameters + 1:
            return np.inf
        variance = max(float(residuals @ residuals) / count, 1e-12)
        return count * float(np.log(variance)) + 2 * parameters * count / (count - parameters - 1)

    found = []
    for edge in np.unique(readings.edge):
        rows = readings.of(readings.edge == edge)
        time, wear = rows.design[:, 2], rows.wear
        if len(wear) < LONG:
            continue
        power, bent, phases = (np.polynomial.Polynomial.fit(time, wear, degree) for degree in (1, 2, 3))
        straight = optimize.curve_fit(line, time, wear, (wear[0], -4.0), maxfev=20000)[0]
        least = aicc(wear - power(time), 3) - 2.0
        better = aicc(wear - line(time, *straight), 3) < least, aicc(wear - phases(time), 5) < least
        found.append((power.convert().coef[1], *better, bent.convert().coef[2] > 0.0))
    exponents, lines, three, bending = np.array(found, np.float64).T
    return {
        "edges": len(found),
        "median_exponent": float(np.median(exponents)),
        "line_better": float(lines.mean()),
        "three_phases_better": float(three.mean()),
        "bending_up": float(bending.mean()),
    }


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Compute and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.measured_wear", **described(__doc__))
    parser.add_argument("sheet", type=Path, help="CSV file of readings")
    readings = read(parser.parse_args(arguments).sheet)
    variances = estimate(readings)
    mean, spread = mean_law(readings, variances)[0], np.sqrt(np.diag(variances.law))
    inside, below, above, factor = coverage(readings)
    curve = curves(readings)
    counts = len(readings.wear), len(np.unique(readings.edge)), len(np.unique(readings.pair))
    print("{} readings of {} edges, {} pairs of materials".format(*counts))
    print(f"exponent of time {mean[2]:.2f}, {spread[2]:.2f} from pair to pair")
    print(f"exponent of cutting speed {mean[1]:.2f}, {spread[1]:.2f} from pair to pair")
    print(
        f"edges differ by {variances.edge**0.5:.2f}, readings by {variances.reading**0.5:.2f} (standard deviations of log wear)"
    )
    print(f"95 % intervals hold {100 * inside:.1f} % of the readings of edges left out")
    print(f"  {100 * below:.1f} % are below, {100 * above:.1f} % above")
    print(f"  their ends typically lie a factor of {factor:.2f} from the prediction")
    print(f"{curve['edges']} edges of {LONG} readings or more, against the power law by AICc less 2:")
    shares = (f"{100 * curve[name]:.0f} %" for name in ("line_better", "three_phases_better", "bending_up"))
    print("  a line is better for {}, three phases for {}\n  {} bend upwards in logarithms".format(*shares))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
