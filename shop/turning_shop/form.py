"""Find a factor in which a straight line fits the rows, but a power, the laws' form, does not.

Forces are not 0 at a fresh edge, and wear is not 0 after the first seconds. Measured over flank
wear VB, a force often follows F0 (1 + b VB), which no power of VB fits near 0. Rows near 0 then lie
far from the law, but are no typing errors: the law holds only above a value of the factor, from
which it agrees with the straight line. ``plausibility.py`` looks for typing errors.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from turning_shop import Values
from turning_shop.fit import Fit

MIN_MISFIT = 0.15
"""Logarithm of the straight line over the law, at some row, from which the form is wrong [-]."""
MAX_MISFIT = 0.05
"""Logarithm of the straight line over the law, at all rows, up to which the law holds [-]."""
MIN_GAIN = 0.6
"""Scatter about the straight line over that about the law, below which the line fits better [-]."""
SPARE_ROWS = 4  # rows beyond the fitted numbers that are needed to tell the form
SLOPES = np.geomspace(0.03, 3000.0, 60)
"""Slopes times the largest value of the factor that are tried first [-]."""
CANDIDATES = 200
"""Largest number of values of the factor that are tried as the lowest at which the law holds."""


class Misfit(NamedTuple):
    """A factor in which the response follows c (1 + slope * factor) rather than a power."""

    factor: str
    slope: float  # in the inverse of the factor's unit
    # Standard deviation of the rows from the straight line, of each edge's if edges are named [-].
    scatter: float
    holds_from: float  # lowest value of the factor at which a power agrees with the line
    beyond: NDArray[np.bool_]  # rows below this value, shape (rows,)


def misfit(fitted: Fit) -> Misfit | None:
    """Return the factor of a law in which a straight line fits far better than a power.

    None if there is none, or too few rows tell.
    """
    worn_rows = int((~fitted.fresh).sum())
    if worn_rows < len(fitted.estimates) + SPARE_ROWS:
        return None
    worst = None
    for factor in fitted.exponents:
        candidate = _misfit_in(fitted, factor)
        if candidate and (worst is None or candidate.scatter < worst.scatter):
            worst = candidate
    return worst


def _misfit_in(fitted: Fit, factor: str) -> Misfit | None:
    """Return the misfit of a law in one factor; None if a power fits well enough."""
    rows = ~fitted.fresh
    values = fitted.factors[factor][rows]
    residual = fitted.log_residuals[rows]
    by_law = getattr(fitted.law, factor) * np.log(values)
    columns = [np.ones(len(values))]
    for name in fitted.exponents:
        if name != factor:
            columns.append(np.log(fitted.factors[name][rows]))
    design = np.column_stack(columns)

    def about_line(scaled_slope: float) -> Values:
        """Return the residuals about c (1 + slope * factor), with the other exponents refitted."""
        target = residual + by_law - np.log1p(scaled_slope * values / values.max())
        return np.asarray(target - design @ np.linalg.lstsq(design, target, rcond=None)[0])

    def mean_deviation(log_slope: float) -> float:
        slope = float(np.exp(log_slope))
        return float(np.abs(about_line(slope)).mean())

    # The deviation may have several minima over the slope: search the neighbourhood of the lowest.
    deviations = [mean_deviation(float(np.log(slope))) for slope in SLOPES]
    best = int(np.argmin(deviations))
    low = float(np.log(SLOPES[max(best - 1, 0)]))
    high = float(np.log(SLOPES[min(best + 1, len(SLOPES) - 1)]))
    minimum = optimize.minimize_scalar(mean_deviation, bounds=(low, high), method="bounded")
    scaled_slope = float(np.exp(minimum.x))

    remaining = about_line(scaled_slope)
    line_over_law = residual - remaining  # logarithm
    if np.abs(line_over_law).max() < MIN_MISFIT:
        return None
    if np.abs(remaining).mean() > MIN_GAIN * np.abs(residual).mean():
        return None
    slope = scaled_slope / float(values.max())
    holds_from = _holds_from(values, slope)
    beyond = rows & (fitted.factors[factor] < holds_from)
    if not beyond.any():
        return None
    edge = fitted.edges.group[rows] if fitted.edges else None
    return Misfit(
        factor=factor,
        slope=slope,
        scatter=_scatter(remaining, edge),
        holds_from=holds_from,
        beyond=beyond,
    )


def _scatter(residual: Values, edge: NDArray[np.int64] | None) -> float:
    """Return the standard deviation of residuals, about each edge's mean if edges are named."""
    if edge is None:
        return float(residual.std())
    members = np.maximum(np.bincount(edge), 1)
    means = np.bincount(edge, residual) / members
    return float((residual - means[edge]).std())


def _holds_from(values: Values, slope: float) -> float:
    """Return the lowest value from which a power agrees with 1 + slope * value.

    The logarithms of both agree to within ``MAX_MISFIT``.
    """
    distinct = np.unique(values)
    places = np.linspace(0, len(distinct) - 1, CANDIDATES).astype(int)
    for lowest in distinct[np.unique(places)]:
        above = distinct[distinct >= lowest]
        line = np.log1p(slope * above)
        design = np.column_stack([np.ones(len(above)), np.log(above)])
        power = design @ np.linalg.lstsq(design, line, rcond=None)[0]
        if np.abs(line - power).max() <= MAX_MISFIT:
            return float(lowest)
    return float(distinct[-1])
