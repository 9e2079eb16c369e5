"""Find rows of a sheet that lie far from the law of the others, and the cell that is probably wrong."""

import itertools
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from turning_shop.fit import SETTINGS, Fit
from turning_shop.measurements import COLUMNS
from turning_shop.plausibility import name_lines

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
SLIPS = (10.0, 100.0, 1000.0, 60.0, 25.4, 1 / 10.0, 1 / 100.0, 1 / 1000.0, 1 / 60.0, 1 / 25.4)
"""Factors by which a single cell may be wrong."""


class RobustFit(NamedTuple):
    """A law fitted so that a few wrong rows, wherever they lie, hardly count.

    Attributes:
        exponents: By their names in ``PowerLaw``, without the coefficient.
        distance: Logarithm of each measured over predicted response [-], shape (rows,).
        scale: Robust standard deviation of ``distance`` [-].
        outlying: Which rows are outliers, shape (rows,).
    """

    exponents: dict[str, float]
    distance: Values
    scale: float
    outlying: NDArray[np.bool_]


def robust_fit(fitted: Fit) -> RobustFit:
    """Fit a law again, by least squares with Cauchy loss from the subset of rows that suits most of the others.

    The start has a high breakdown point (least quantile of squares, Rousseeuw 1984), so that a wrong speed or feed cannot draw
    the law to its row.
    """
    residual = fitted.log_residuals
    logs = [np.log(fitted.factors[name]) for name in fitted.exponents]
    design = np.column_stack([np.ones(len(residual)), *(log - log.mean() for log in logs)])
    rows, count = design.shape
    change = np.zeros(count)
    if rows >= count + SPARE_ROWS:
        rng, quantile = np.random.default_rng(0), (rows + count + 1) // 2
        picks = [rng.choice(rows, count + 1, replace=False) for _ in range(SUBSETS)]
        starts = [change, *(np.linalg.lstsq(design[pick], residual[pick], rcond=None)[0] for pick in picks)]
        medians = [np.partition(np.abs(residual - design @ start), quantile - 1)[quantile - 1] for start in starts]
        start, scale = starts[int(np.argmin(medians))], max(1.4826 * float(min(medians)), 1e-9)

        def misfit(change: Values) -> Values:
            return np.asarray(residual - design @ change)

        change = optimize.least_squares(misfit, start, loss="cauchy", f_scale=scale).x
    distance = np.asarray(residual - design @ change)
    scale = 1.4826 * float(np.median(np.abs(distance))) * (1.0 + 5.0 / max(rows - count, 1))
    outlying = _outlying(residual, design, np.abs(distance) > SUSPECT * scale) & (np.abs(distance) > MIN_FAR)
    exponents = {name: getattr(fitted.law, name) + float(slope) for name, slope in zip(fitted.exponents, change[1:], strict=True)}
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
    for line in sorted({int(line) for name in fits for line in fits[name].lines[wrong[name]]}):
        rows = {name: int(np.flatnonzero(fitted.lines == line)[0]) for name, fitted in fits.items() if line in fitted.lines}
        shown = " and ".join(
            f"{name} is {_times(np.exp(robust[name].distance[row]))} the law of the other rows"
            for name, row in rows.items()
            if wrong[name][row]
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
    columns: dict[str, tuple[Values, int]] = {}
    for response, row in rows.items():
        for name, values in {response: fits[response].measured, **fits[response].factors}.items():
            columns.setdefault(name, (values, row))
    for (name, (values, row)), slip in itertools.product(columns.items(), SLIPS):
        others = np.delete(values, row)
        if not 0.5 * others.min() <= values[row] / slip <= 2.0 * others.max():
            continue
        worst = 0.0
        for response, at in rows.items():
            sensitivity = 1.0 if name == response else -robust[response].exponents.get(name, 0.0)
            distance = robust[response].distance[at] - sensitivity * np.log(slip)
            worst = max(worst, abs(distance) / max(robust[response].scale, 0.05))
        if worst < min(least, SUSPECT):
            least, best = worst, f"is {name}, {values[row]:.4g} {COLUMNS[name].unit}, {_times(slip)} the true value?"
    return best


def _times(ratio: float) -> str:
    return f"{ratio:.3g} times" if ratio >= 0.01 else f"1/{1 / ratio:.3g} of"
