"""Find rows of a sheet that lie far from the law of the others, and the cell that is probably wrong."""

import itertools
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from turning_shop.fit import SETTINGS, Fit
from turning_shop.measurements import COLUMNS

Values = NDArray[np.float64]

SUSPECT = 3.5
"""Distance from the robust law, in robust standard deviations, from which a row may be an outlier [-]."""
SIGNIFICANCE = 1e-3
"""Probability that a sheet without errors has an outlier in one law [-]."""
MIN_FAR = 0.4
"""Distance of logarithms below which no row is an outlier [-]: readings of real wear scatter by 0.24, edges by 0.34."""
SPARE_ROWS = 4
"""Rows beyond the fitted numbers that are needed to tell outliers."""
SUBSETS = 500
"""Random subsets of rows from which the robust fit starts."""
MAX_NAMED = 8
"""Number of lines that a message names."""
SLIPS = (10.0, 100.0, 1000.0, 60.0, 25.4)
"""Factors by which a single cell may be wrong, or one over them."""


class RobustFit(NamedTuple):
    """A law fitted so that a few wrong rows, wherever they lie, hardly count."""

    exponents: dict[str, float]
    """By their names in ``PowerLaw``, without the coefficient."""
    distance: Values
    """Logarithm of each measured over predicted response [-], shape (rows,)."""
    scale: float
    """Robust standard deviation of ``distance`` [-]."""
    outlying: NDArray[np.bool_]
    """Which rows are outliers, shape (rows,)."""


def robust_fit(fitted: Fit) -> RobustFit:
    """Fit a law again, by least squares with Cauchy loss from the subset of rows that suits most of the others.

    The start has a high breakdown point (least quantile of squares, Rousseeuw 1984), so that a wrong speed or feed cannot draw
    the law to its row.
    """
    names = [name for name in fitted.estimates if name != "coefficient"]
    residual = np.log(fitted.measured / fitted.predicted)
    logs = np.log(np.array([fitted.factors[name] for name in names]).reshape(len(names), len(residual)).T)
    design = np.column_stack([np.ones(len(residual)), logs - logs.mean(axis=0)])
    rows, count = design.shape
    change = np.zeros(count)
    if rows >= count + SPARE_ROWS:
        rng, quantile = np.random.default_rng(0), (rows + count + 1) // 2
        picks = [rng.choice(rows, count + 1, replace=False) for _ in range(SUBSETS)]
        starts = [change, *(np.linalg.lstsq(design[pick], residual[pick], rcond=None)[0] for pick in picks)]
        medians = [np.partition(np.abs(residual - design @ start), quantile - 1)[quantile - 1] for start in starts]
        change = starts[int(np.argmin(medians))]
        scale = max(1.4826 * float(min(medians)), 1e-9)
        distance = residual - design @ change

        def loss(more: Values) -> Values:
            return np.asarray((distance - design @ more) / scale)

        change = change + optimize.least_squares(loss, np.zeros(count), loss="cauchy").x
    distance = np.asarray(residual - design @ change)
    scale = 1.4826 * float(np.median(np.abs(distance))) * (1.0 + 5.0 / max(rows - count, 1))
    outlying = _outlying(residual, design, np.abs(distance) > SUSPECT * scale) & (np.abs(distance) > MIN_FAR)
    exponents = {name: getattr(fitted.law, name) + float(slope) for name, slope in zip(names, change[1:], strict=True)}
    return RobustFit(exponents, distance, scale, np.asarray(outlying))


def _outlying(residual: Values, design: Values, suspect: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which suspects lie too far from the law of the other rows for chance, by a t test of each."""
    kept = ~suspect
    degrees = int(kept.sum()) - design.shape[1]
    if degrees < SPARE_ROWS or not suspect.any():
        return np.zeros_like(suspect)
    inverse = np.linalg.pinv(design[kept])
    distance = residual - design @ (inverse @ residual[kept])
    variance = float(distance[kept] @ distance[kept]) / degrees
    leverage = ((design @ inverse) ** 2).sum(axis=1)
    limit = stats.t.isf(0.5 * SIGNIFICANCE / len(residual), degrees) * np.sqrt(variance * (1.0 + leverage))
    return np.asarray(suspect & (np.abs(distance) > limit))


def outliers(fits: Mapping[str, Fit], robust: Mapping[str, RobustFit]) -> Iterator[str]:
    """Yield a message for each row that lies far from a law, with the cell that is probably wrong."""
    wrong = {name: robust[name].outlying & ~_of_unusual_edge(fits[name], robust[name]) for name in fits}
    lines = sorted({int(line) for name in fits for line in fits[name].lines[wrong[name]]})
    for line in lines:
        rows = {name: int(np.flatnonzero(fitted.lines == line)[0]) for name, fitted in fits.items() if line in fitted.lines}
        far = [name for name, row in rows.items() if wrong[name][row]]
        shown = " and ".join(
            f"{name} is {_times(np.exp(robust[name].distance[rows[name]]))} the law of the other rows" for name in far
        )
        yield f"line {line}: {shown}: {_slip(fits, robust, rows)}"


def _of_unusual_edge(fitted: Fit, robust: RobustFit) -> NDArray[np.bool_]:
    """Return the rows of edges of which most readings, and two or more, are outliers: such an edge is odd, but no typing error.

    Without names of edges, rows at the same settings count as readings of one.
    """
    settings = np.stack([fitted.factors[name] for name in SETTINGS], axis=1)
    group = fitted.edges.group if fitted.edges else np.unique(settings, axis=0, return_inverse=True)[1]
    found, members = np.bincount(group, robust.outlying), np.bincount(group)
    return np.asarray(((found >= 2) & (found > 0.5 * members))[group])


def unusual_edges(fits: Mapping[str, Fit], robust: Mapping[str, RobustFit]) -> Iterator[str]:
    """Yield a warning for each law from which the readings of whole edges lie far."""
    for name, fitted in fits.items():
        if (odd := robust[name].outlying & _of_unusual_edge(fitted, robust[name])).any():
            yield f"{name}: all readings of an edge lie far from the law, in {name_lines(fitted.lines[odd])}: an unusual edge?"


def _slip(fits: Mapping[str, Fit], robust: Mapping[str, RobustFit], rows: Mapping[str, int]) -> str:
    """Return which cell of a row is probably wrong, and by what factor; ``rows`` is the row's index in each law."""
    best, least = "check its numbers", np.inf
    columns = {name: (fit.measured, rows[response]) for response, fit in fits.items() if response in rows for name in (response,)}
    for response, row in rows.items():
        columns |= {name: (values, row) for name, values in fits[response].factors.items() if name not in columns}
    for (name, (values, row)), slip in itertools.product(columns.items(), (*SLIPS, *(1 / slip for slip in SLIPS))):
        others = np.delete(values, row)
        if not 0.5 * others.min() <= values[row] / slip <= 2.0 * others.max():
            continue
        distances = []
        for response, at in rows.items():
            sensitivity = 1.0 if name == response else -robust[response].exponents.get(name, 0.0)
            distances.append((robust[response].distance[at] - sensitivity * np.log(slip)) / max(robust[response].scale, 0.05))
        worst = float(np.abs(distances).max())
        if worst < min(least, SUSPECT):
            least, best = worst, f"is {name}, {values[row]:.4g} {COLUMNS[name].unit}, {_times(slip)} the true value?"
    return best


def _times(ratio: float) -> str:
    return f"{ratio:.3g} times" if ratio >= 0.01 else f"1/{1 / ratio:.3g} of"


def name_lines(lines: Iterable[int]) -> str:
    """Return lines of a file for people, as ranges: "lines 2 to 9, 12"."""
    numbers = sorted(int(line) for line in lines)
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][-1] + 1:
            ranges[-1] = [ranges[-1][0], number]
        else:
            ranges.append([number, number])
    shown = [f"{first} to {last}" if last > first else str(first) for first, last in ranges[:MAX_NAMED]]
    return f"line{'s' * (len(numbers) > 1)} {', '.join(shown)}" + (", ..." if len(ranges) > MAX_NAMED else "")
