"""Choose the form in which a load depends on flank wear, and find forms that do not fit.

A force or power is proportional to a power of the wear VB, VB^e, or has a fresh edge's share,
1 + b VB. Both forms are fitted to part of the edges and predict the others. ``fit.py`` fits one
law; ``plausibility.py`` looks for typing errors, in the form that was chosen.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special
from turning_shop import Values, WorkshopError
from turning_shop.fit import (
    FACTORS,
    TYPICAL_GROWTH,
    Fit,
    complete_rows,
    fresh_rows,
    with_growth,
    without_growth,
    worn_rows,
)
from turning_shop.headers import COLUMNS
from turning_shop.measurements import Measurements
from turning_shop.regression import independent

from turning_env.scenario.power_law import PowerLaw

FitLaw = Callable[[Measurements, PowerLaw], Fit]
"""Fits a law of the form of a base law to measurements."""

MAX_FOLDS = 10  # parts of the rows that are left out in turn
MIN_FOLDS = 3  # that tell which form predicts better
MIN_CERTAINTY = 2.0
"""Mean gain of the other form over its standard error, from which the base's form is left [-]."""
BINS = 6  # ranges of wear or time in which residuals are compared
MIN_UNITS = 4  # edges, or rows without names of edges, that tell of a range
MIN_MISFIT = 0.15
"""Mean logarithm of measured over predicted response in a range from which a form is wrong [-]."""
SIGNIFICANCE = 1e-3  # probability that a law of the right form has such a range [-]


class FormChoice(NamedTuple):
    """A law in the form that predicts better, and what decided, for people."""

    fitted: Fit
    reason: str  # empty if there was nothing to decide


def choose_form(
    response: str,
    measurements: Measurements,
    base: PowerLaw,
    fit_law: FitLaw,
    compares: bool = True,
) -> FormChoice:
    """Fit a law in the form that predicts left-out edges better, or rows if edges have no names.

    The base's form is kept unless the other is better by more than two standard errors of the
    difference. A power of the wear cannot predict fresh edges, so that rows of them decide for
    1 + b VB. The forms are then compared for the reason alone, if ``compares``.

    Raises:
        WorkshopError: There are too few rows, or a fitted number is out of the law's range.
    """
    if response == "wear":
        return FormChoice(fit_law(measurements, base), "")
    growing = base if base.wear_growth > 0.0 else with_growth(base, TYPICAL_GROWTH[response])
    if fresh_rows(response, measurements).any():
        fitted = fit_law(measurements, growing)
        count = int(fitted.fresh.sum())
        reason = f"1 + b VB, as {count} rows are of fresh edges"
        errors = None
        if compares:
            errors = _errors_of_forms(response, measurements, growing, fit_law)
        if errors is not None:
            reason += f"; {errors.compared(measurements)}"
        return FormChoice(fitted, reason)

    fitted = fit_law(measurements, base)
    if not {"wear", "wear_growth"} & set(fitted.terms):
        return FormChoice(fitted, "")
    errors = _errors_of_forms(response, measurements, growing, fit_law)
    if errors is None:
        return FormChoice(fitted, "")
    has_growth = base.wear_growth > 0.0
    gain = errors.gain_of_growth if not has_growth else -errors.gain_of_growth
    if gain.mean() > MIN_CERTAINTY * gain.std(ddof=1) / np.sqrt(len(gain)):
        other = without_growth(base) if has_growth else growing
        fitted = fit_law(measurements, other)
    chosen = "1 + b VB" if fitted.has_growth else "a power of VB"
    reason = f"{chosen}, as {errors.compared(measurements)}"
    if fitted.has_growth == has_growth and gain.mean() > 0.0:
        reason = f"{chosen}, as in the base: {errors.compared(measurements)}, too close to tell"
    return FormChoice(fitted, reason)


class _Errors(NamedTuple):
    """Errors of both forms at worn edges that were left out."""

    with_growth: list[Values]  # absolute logarithms of measured over predicted, by fold
    as_power: list[Values]

    @property
    def gain_of_growth(self) -> Values:
        """Mean error of a power less that of 1 + b VB, of each fold."""
        pairs = zip(self.as_power, self.with_growth, strict=True)
        return np.array([power.mean() - growth.mean() for power, growth in pairs])

    def compared(self, measurements: Measurements) -> str:
        """Return the median errors of both forms for people."""
        left_out = "rows" if measurements.edges is None else "edges"
        with_growth = np.median(np.concatenate(self.with_growth))
        as_power = np.median(np.concatenate(self.as_power))
        growth_percent = 100.0 * np.expm1(with_growth)
        power_percent = 100.0 * np.expm1(as_power)
        return (
            f"the median error at worn {left_out} left out is {growth_percent:.2g} % by 1 + b VB "
            f"and {power_percent:.2g} % by a power of VB"
        )


def _errors_of_forms(
    response: str, measurements: Measurements, growing: PowerLaw, fit_law: FitLaw
) -> _Errors | None:
    """Return the errors of both forms by cross-validation; None if too few edges tell."""
    rows = complete_rows(response, measurements)
    worn = worn_rows(response, measurements)
    with_share: list[Values] = []
    as_power: list[Values] = []
    for left_out in folds(measurements, rows):
        # A power of the wear has no error at a fresh edge that could be compared.
        tested = left_out & worn
        if not tested.any():
            continue
        rest = without_rows(measurements, left_out)
        try:
            growth_fit = fit_law(rest, growing)
            power_fit = fit_law(rest, without_growth(growing))
        except WorkshopError:
            continue
        if "wear_growth" not in growth_fit.terms or "wear" not in power_fit.terms:
            continue
        with_share.append(np.abs(log_errors(growth_fit, measurements, tested)))
        as_power.append(np.abs(log_errors(power_fit, measurements, tested)))
    if len(with_share) < MIN_FOLDS:
        return None
    return _Errors(with_share, as_power)


def folds(
    measurements: Measurements, rows: NDArray[np.bool_], count: int = MAX_FOLDS
) -> Iterator[NDArray[np.bool_]]:
    """Yield at most ``count`` parts of rows, each of whole edges if edges have names."""
    groups = measurements.lines if measurements.edges is None else measurements.edges
    place = np.unique(groups[rows], return_inverse=True)[1]
    num_groups = int(place.max(initial=-1)) + 1
    fold = np.full(len(rows), -1)
    # Edges that follow one another often have like settings: they go to different parts.
    fold[rows] = place % count
    for number in range(min(count, num_groups)):
        yield fold == number


def without_rows(measurements: Measurements, left_out: NDArray[np.bool_]) -> Measurements:
    """Return measurements without some rows."""
    edges = measurements.edges
    return replace(
        measurements,
        columns={name: values[~left_out] for name, values in measurements.columns.items()},
        lines=measurements.lines[~left_out],
        edges=None if edges is None else edges[~left_out],
    )


def factors_of(
    response: str, measurements: Measurements, rows: NDArray[np.bool_]
) -> dict[str, Values]:
    """Return the factors of a law in some rows; a hardness that is not known is nominal."""
    factors = {}
    for name in FACTORS[response]:
        if name in measurements.columns:
            factors[name] = np.nan_to_num(measurements.columns[name][rows], nan=1.0)
        else:
            factors[name] = np.ones(int(rows.sum()))
    return factors


def log_errors(fitted: Fit, measurements: Measurements, rows: NDArray[np.bool_]) -> Values:
    """Return the logarithms of measured over predicted responses in some rows [-]."""
    factors = factors_of(fitted.response, measurements, rows)
    measured = measurements.columns[fitted.response][rows]
    return np.asarray(np.log(measured / fitted.law(**factors)))


class Misfit(NamedTuple):
    """A range of wear or time in which readings lie on one side of a law."""

    factor: str
    low: float  # ends of the range, in the factor's unit
    high: float
    ratio: float  # measured over predicted response in this range [-]

    def describe(self, response: str) -> str:
        """Return the misfit for people."""
        unit = COLUMNS[self.factor].unit
        percent = 100.0 * abs(self.ratio - 1.0)
        side = "above" if self.ratio > 1.0 else "below"
        return (
            f"{response}: the law's form does not fit: at a {self.factor} of {self.low:.3g} to "
            f"{self.high:.3g} {unit}, readings are {percent:.0f} % {side} it"
        )


def misfit(fitted: Fit, distance: Values) -> Misfit | None:
    """Return the range of wear or time in which a law's form is wrong by most; None if it fits.

    ``distance`` holds the rows' residuals from the law, fitted so that wrong rows hardly count. The
    means of edges must agree on the side, so that a typing error is no misfit.
    """
    factor = "time" if fitted.response == "wear" else "wear"
    values = fitted.factors[factor]
    residual = independent(distance, fitted.edges)
    # Rows of one edge deviate together, so that edges are the sample.
    unit = np.arange(len(values))
    if fitted.edges is not None:
        unit = fitted.edges.group

    quantiles = np.linspace(0.0, 1.0, BINS + 1)
    ends = np.unique(np.quantile(values, quantiles))
    last_bin = max(len(ends) - 2, 0)
    bins = np.searchsorted(ends, values, side="right") - 1
    bins = np.clip(bins, 0, last_bin)
    worst = None
    for number in np.unique(bins):
        inside = bins == number
        sums = np.bincount(unit[inside], residual[inside])
        members = np.bincount(unit[inside])
        has_rows = members > 0
        means = sums[has_rows] / members[has_rows]
        count = len(means)
        if count < MIN_UNITS:
            continue
        mean = means.mean()
        error = means.std(ddof=1) / np.sqrt(count)
        # Of Student's t; scipy.stats, which has a name for it, takes long to import.
        quantile = -special.stdtrit(count - 1, 0.5 * SIGNIFICANCE / BINS)
        if abs(mean) < max(MIN_MISFIT, quantile * error):
            continue
        ratio = float(np.exp(mean))
        if worst is None or abs(np.log(ratio)) > abs(np.log(worst.ratio)):
            low = float(values[inside].min())
            high = float(values[inside].max())
            worst = Misfit(factor, low=low, high=high, ratio=ratio)
    return worst
