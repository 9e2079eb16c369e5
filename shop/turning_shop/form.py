"""Find a factor in which a law's form, a power, does not fit the rows, although a straight line does.

Forces are not 0 at a fresh edge, and wear is not 0 after the first seconds: measured over flank wear VB, a force often follows
F0 (1 + b VB), which no power of VB fits near 0. Rows near 0 then lie far from the law. They are no typing errors: the law holds
only above a value of the factor, from which it agrees with the straight line.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from turning_shop import Values
from turning_shop.fit import Fit

MIN_MISFIT = 0.15
"""Logarithm of the straight line over the law, at some row, from which the law's form counts as wrong [-]."""
MAX_MISFIT = 0.05  # likewise, up to which the law holds [-]
MIN_GAIN = 0.6  # scatter about the straight line over that about the law, below which the line fits better [-]
SPARE_ROWS = 4  # rows beyond the fitted numbers that are needed to tell the form
SLOPES = np.geomspace(
    0.03, 3000.0, 60
)  # slopes times the largest value of the factor that are tried first [-]
CANDIDATES = 200  # largest number of values of the factor that are tried as the lowest at which the law holds


class Misfit(NamedTuple):
    """A factor in which the response follows c (1 + slope * factor) rather than a power."""

    factor: str
    slope: float  # in the inverse of the factor's unit
    scatter: float  # standard deviation of the rows from the straight line, of each edge's if edges are named [-]
    holds_from: float  # lowest value of the factor at which a power agrees with the line
    beyond: NDArray[np.bool_]  # rows below this value, shape (rows,)


def misfit(fitted: Fit) -> Misfit | None:
    """Return the factor of a law in which a straight line fits far better than a power; None if there is none."""
    if int((~fitted.fresh).sum()) < len(fitted.estimates) + SPARE_ROWS:
        return None
    found = None
    for factor in fitted.exponents:
        one = _misfit_in(fitted, factor)
        if one and (found is None or one.scatter < found.scatter):
            found = one
    return found


def _misfit_in(fitted: Fit, factor: str) -> Misfit | None:
    rows = ~fitted.fresh
    values, residual = fitted.factors[factor][rows], fitted.log_residuals[rows]
    others = [np.log(fitted.factors[name][rows]) for name in fitted.exponents if name != factor]
    design = np.column_stack([np.ones(len(values)), *others])
    by_law = getattr(fitted.law, factor) * np.log(values)

    def about_line(scaled_slope: float) -> Values:
        """Return the residuals about c (1 + slope * factor), with the other exponents fitted to it."""
        target = residual + by_law - np.log1p(scaled_slope * values / values.max())
        return np.asarray(target - design @ np.linalg.lstsq(design, target, rcond=None)[0])

    def scale(log_slope: float) -> float:
        return float(np.abs(about_line(float(np.exp(log_slope)))).mean())

    best = int(np.argmin([scale(float(np.log(slope))) for slope in SLOPES]))
    low, high = (
        float(np.log(SLOPES[index])) for index in (max(best - 1, 0), min(best + 1, len(SLOPES) - 1))
    )
    scaled = float(np.exp(optimize.minimize_scalar(scale, bounds=(low, high), method="bounded").x))
    remaining = about_line(scaled)
    apart = residual - remaining  # logarithm of the line over the law
    if (
        np.abs(apart).max() < MIN_MISFIT
        or np.abs(remaining).mean() > MIN_GAIN * np.abs(residual).mean()
    ):
        return None
    slope = scaled / float(values.max())
    holds_from = _holds_from(values, slope)
    beyond = rows & (fitted.factors[factor] < holds_from)
    if not beyond.any():
        return None
    return Misfit(
        factor=factor,
        slope=slope,
        scatter=_scatter(remaining, fitted.edges.group[rows] if fitted.edges else None),
        holds_from=holds_from,
        beyond=beyond,
    )


def _scatter(residual: Values, edge: NDArray[np.int64] | None) -> float:
    """Return the standard deviation of residuals, about the mean of each edge if edges are named [-]."""
    if edge is None:
        return float(residual.std())
    means = np.bincount(edge, residual) / np.maximum(np.bincount(edge), 1)
    return float((residual - means[edge]).std())


def _holds_from(values: Values, slope: float) -> float:
    """Return the lowest value from which a power of the values agrees with 1 + slope * value to within ``MAX_MISFIT``."""
    distinct = np.unique(values)
    candidates = distinct[np.unique(np.linspace(0, len(distinct) - 1, CANDIDATES).astype(int))]
    for lowest in candidates:
        above = distinct[distinct >= lowest]
        log, line = np.log(above), np.log1p(slope * above)
        design = np.column_stack([np.ones(len(above)), log])
        apart = line - design @ np.linalg.lstsq(design, line, rcond=None)[0]
        if np.abs(apart).max() <= MAX_MISFIT:
            return float(lowest)
    return float(distinct[-1])
