"""Solve the regression of one law: least squares in logarithms, with an effect of edges.

``fit.py`` makes the regression of a law and reads its solution. If readings name their edges, those
of one edge share a deviation: a random effect, whose variance is estimated by the method of Swamy
and Arora (Econometrica 40, 1972). The growth with wear is the only number in which the regression
is not linear.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from turning_shop import Values

MIN_SHARE = 0.1
"""Share of a factor's variance within edges from which its exponent is estimated there [-]."""
MIN_KEPT = 1e-3
"""Lowest share of its edge's mean that a row keeps [-]; at 0, settings would all be the same."""
MIN_GROWTH, MAX_GROWTH = 1e-3, 1000.0
"""Range in which the growth of a load with the wear is searched [1/mm]; the law allows no more."""
GROWTHS = np.geomspace(MIN_GROWTH, MAX_GROWTH, 43)  # tried first, seven in a decade
MAX_ROUNDS = 10  # of growth and edge effect, each estimated with the other
GROWTH_TOLERANCE = 1e-4  # relative change of the growth at which the rounds end [-]
MIN_SCATTER = 1e-4  # lowest scatter of the rows [-]: that of rounding to four digits


@dataclass(frozen=True)
class EdgeEffect:
    """The deviation that readings of one edge share."""

    count: int  # of edges
    readings: float  # of an edge, on average: their mean number, less its variance over that mean
    spread: float  # standard deviation of the logarithm that readings of one edge share [-]
    degrees: tuple[int, ...]  # of freedom, of each fitted number, the coefficient first
    is_within: tuple[bool, ...]  # whether each is estimated within edges, rather than between them
    group: NDArray[np.int64]  # number of each row's edge, from 0, shape (rows,)
    # Share of its edge's mean to subtract from each row, which makes rows independent [-], (rows,).
    removed: Values


@dataclass(frozen=True)
class Regression:
    """A regression that is linear in its parameters, except in the growth with wear.

    target = design @ parameters + wear_exponent * log(1 + growth * wear)
    """

    target: Values  # log(response) - log(assumed part), shape (rows,)
    design: Values  # of the coefficient's logarithm and the exponents, shape (rows, exponents + 1)
    wear: Values | None  # [mm], shape (rows,); None if no growth is fitted
    wear_exponent: float
    progress: int | None  # place of the parameter of wear or time, by which an edge proceeds

    def without_wear(self, growth: float) -> Values:
        """Return the target less the term of wear with this growth [1/mm], shape (rows,)."""
        if self.wear is None:
            return self.target
        return np.asarray(self.target - self.wear_exponent * np.log1p(growth * self.wear))

    def tangent(self, growth: float) -> Values:
        """Return the design with a column for the growth, (rows, parameters)."""
        if self.wear is None:
            return self.design
        slope = self.wear_exponent * self.wear / (1.0 + growth * self.wear)
        return np.column_stack([self.design, slope])


class Solution(NamedTuple):
    """The solution of a regression; its parameters are in the order of ``Regression.tangent``."""

    parameters: Values  # shape (parameters,)
    unbounded: Values  # parameters, with the growth that least squares ask for, even below 0
    covariance: Values  # of the parameters, shape (parameters, parameters)
    degrees: tuple[int, ...]  # of freedom, of each parameter
    scatter: float  # standard deviation of a row, without that of its edge [-]
    edges: EdgeEffect | None


def solve(regression: Regression, edge: NDArray[np.int64] | None) -> Solution:
    """Solve a regression: by ordinary least squares, or with an edge effect by generalised ones."""
    growth = MIN_GROWTH
    edges = None
    for _ in range(MAX_ROUNDS):
        previous = growth
        if regression.wear is not None:
            growth = _best_growth(regression, edges)
        if edge is not None:
            target = regression.without_wear(growth)
            edges = _edge_effect(target, regression.tangent(growth)[:, 1:], edge)
        if regression.wear is None or abs(growth / previous - 1.0) < GROWTH_TOLERANCE:
            break

    target = independent(regression.without_wear(growth), edges)
    design = independent(regression.design, edges)
    tangent = independent(regression.tangent(growth), edges)
    parameters = np.linalg.pinv(design) @ target
    residual = target - design @ parameters
    inverse = np.linalg.pinv(tangent)
    unbounded = inverse @ target
    if regression.wear is not None:
        # The last parameter of the tangent is the change of the growth.
        parameters = np.append(parameters, growth)
        unbounded[-1] += growth
    degrees_of_rows = len(target) - len(parameters)
    scatter = float(np.linalg.norm(residual) / np.sqrt(degrees_of_rows))
    scatter = max(scatter, MIN_SCATTER)
    covariance = inverse @ inverse.T * scatter**2
    degrees = [degrees_of_rows] * len(parameters)
    if edges is not None:
        degrees = list(edges.degrees)
        place = regression.progress
        if place is not None and edges.is_within[place]:
            variance = _variance_of_slopes(inverse[place], residual, edges)
            if variance > covariance[place, place]:
                _widen(covariance, place, variance)
                # It is the scatter of as many slopes as there are edges.
                degrees[place] = edges.degrees[0]
    return Solution(
        parameters,
        unbounded,
        covariance=covariance,
        degrees=tuple(degrees),
        scatter=scatter,
        edges=edges,
    )


def _best_growth(regression: Regression, edges: EdgeEffect | None) -> float:
    """Return the growth with wear [1/mm] of least squares, with a known edge effect."""
    basis = np.linalg.qr(independent(regression.design, edges))[0]

    def misfits(growths: Values) -> Values:
        """Return the squared length of what the other parameters cannot explain, of growths."""
        targets = [regression.without_wear(growth) for growth in growths]
        target = independent(np.column_stack(targets), edges)
        explained = basis.T @ target
        return np.asarray((target**2).sum(axis=0) - (explained**2).sum(axis=0))

    def misfit(log_growth: float) -> float:
        growth = np.exp([log_growth])
        return float(misfits(growth)[0])

    # The misfit may have several minima: search the neighbourhood of the lowest.
    logs = np.log(GROWTHS)
    tried = misfits(GROWTHS)
    best = int(np.argmin(tried))
    below = max(best - 1, 0)
    above = min(best + 1, len(logs) - 1)
    minimum = optimize.minimize_scalar(
        misfit,
        bounds=(logs[below], logs[above]),
        method="bounded",
        options={"xatol": 0.1 * GROWTH_TOLERANCE},
    )
    log_growth = logs[best]
    if minimum.fun < tried[best]:
        log_growth = minimum.x
    # The logarithm of an end rounds.
    return float(np.clip(np.exp(log_growth), MIN_GROWTH, MAX_GROWTH))


def independent(values: Values, edges: EdgeEffect | None) -> Values:
    """Return targets or regressors whose rows are independent: less a share of the edge's mean."""
    if edges is None:
        return values
    removed = (edges.removed * _group_means(values, edges.group).T).T
    return np.asarray(values - removed)


def _variance_of_slopes(weights: Values, residual: Values, edges: EdgeEffect) -> float:
    """Return the variance of a parameter that holds however the rows of an edge correlate.

    The parameter is weights @ target, with weights of shape (rows,) (Liang and Zeger 1986).
    """
    sums = np.bincount(edges.group, weights * residual)
    return float((sums**2).sum()) * edges.count / (edges.count - 1)


def _widen(covariance: Values, place: int, variance: float) -> None:
    """Give a parameter a larger variance and the same correlations, in its place."""
    factor = np.sqrt(variance / covariance[place, place])
    covariance[place] *= factor
    covariance[:, place] *= factor


def _edge_effect(target: Values, design: Values, edge: NDArray[np.int64]) -> EdgeEffect | None:
    """Estimate the deviations of edges.

    ``target`` holds log responses (rows,), ``design`` the regressors (rows, regressors) and
    ``edge`` every row's edge. The variance components are those of Swamy and Arora (1972): the
    residual variance of the regression within edges, and that of the edges' means less its share
    of the former. Regressors that vary within edges are estimated there, the others between edges.

    Return None if there are too few edges, or too few readings of each.
    """
    group = np.unique(edge, return_inverse=True)[1]
    members = np.bincount(group)
    rows = len(group)
    edges = len(members)
    design_within = design - _group_means(design, group)
    target_within = target - _group_means(target, group)
    centred = design - design.mean(axis=0)
    total_squares = (centred**2).sum(axis=0)
    squares_within = (design_within**2).sum(axis=0)
    within = squares_within > MIN_SHARE * total_squares
    degrees_within = rows - edges - int(within.sum())
    degrees_between = edges - 1 - int((~within).sum())
    if degrees_within < 1 or degrees_between < 1:
        return None
    slopes = least_squares(design_within[:, within], target_within)
    residual = target_within - design_within[:, within] @ slopes
    variance_within = float((residual**2).sum()) / degrees_within

    # Each edge weighs as often as it was read.
    level = _group_means(target - design[:, within] @ slopes, group)
    settings = _group_means(design[:, ~within], group)
    design_between = np.column_stack([np.ones(rows), settings])
    solution = least_squares(design_between, level)
    deviation = level - design_between @ solution
    mean_square = float(deviation @ deviation) / degrees_between
    # Readings of an edge on average: the mean number, less its variance over that mean.
    readings = (rows - float(members @ members) / rows) / (edges - 1)
    variance_between = max(0.0, (mean_square - variance_within) / readings)

    # Less the share 1 - sqrt(s_w^2 / (s_w^2 + m s_b^2)) of their edge's mean, rows are independent.
    variance_of_mean = variance_within + members * variance_between
    kept_squared = np.ones(edges)
    np.divide(
        variance_within,
        variance_of_mean,
        out=kept_squared,
        where=variance_of_mean > 0,
    )
    kept = np.maximum(np.sqrt(kept_squared), MIN_KEPT)
    degrees = [degrees_between]
    for is_within in within:
        degrees.append(degrees_within if is_within else degrees_between)
    return EdgeEffect(
        count=edges,
        readings=readings,
        spread=float(np.sqrt(variance_between)),
        degrees=tuple(degrees),
        is_within=(False, *within.tolist()),
        group=group,
        removed=1.0 - kept[group],
    )


def least_squares(design: Values, target: Values) -> Values:
    """Return the parameters of least squares, of lowest norm if they are not unique."""
    return np.asarray(np.linalg.lstsq(design, target, rcond=None)[0], np.float64)


def _group_means(values: Values, group: NDArray[np.int64]) -> Values:
    """Return each row's mean over its group, for values of shape (rows,) or (rows, columns)."""
    groups = int(group.max()) + 1
    sums = np.zeros((groups, *values.shape[1:]))
    np.add.at(sums, group, values)
    members = np.bincount(group)
    means = (sums.T / members).T
    return np.asarray(means[group])
