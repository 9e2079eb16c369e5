"""Fit one power law to measurements, by least squares in logarithms.

The laws are the extended Taylor equation of tool life, solved for the wear, and Kienzle's equation
of forces with factors for speed and wear. In the symbols of ``turning_env.scenario.power_law``:

    response = coefficient * V^a * f^b * (d / d0)^c * t^g * W^e * H^h

Its logarithm is linear in the logarithms of the factors, so exponents are slopes. If a factor never
varies, or varies only together with others, its exponent cannot be estimated. The base law's
exponent is then kept, and the others are fitted given it.

Confidence intervals assume the same relative scatter in all rows. If the file does not name edges,
rows count as independent. If it does, the rows of one edge share a deviation: a random effect,
whose variance is estimated by the method of Swamy and Arora (Econometrica 40, 1972).

``calibrate.py`` fits the laws of a material and judges them; ``prediction.py`` uses the intervals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy import stats
from turning_shop import Values, WorkshopError
from turning_shop.headers import COLUMNS
from turning_shop.measurements import Measurements

from turning_env.scenario.power_law import PowerLaw
from turning_env.scoring.statistics import Estimate

FACTORS = {
    "wear": ("cutting_speed", "feed", "depth_of_cut", "time", "hardness"),
    "thrust_force": ("cutting_speed", "feed", "depth_of_cut", "wear", "hardness"),
    "power": ("cutting_speed", "feed", "depth_of_cut", "wear", "hardness"),
}
"""Factors of each law, named as in ``turning_env.PowerLaw``.

A law is named after the column that it predicts.
"""
SETTINGS = ("cutting_speed", "feed", "depth_of_cut", "hardness")
"""Factors that are equal in all readings of one edge in one bar."""
MIN_VARIATION = 1e-3
"""Variation of a factor, unexplained by other factors, from which its exponent is fitted [-]."""
MIN_SHARE = 0.1
"""Share of a factor's variance within edges from which its exponent is estimated there [-]."""
MIN_KEPT = 1e-3
"""Lowest share of its edge's mean that a row keeps [-]; at 0, settings would all be the same."""
SIGNIFICANCE = 0.01
"""Probability of the F test below which rows at the same settings count as correlated [-]."""
LEVEL = 0.95  # confidence level of all intervals [-]
MIN_SCATTER = 1e-4  # lowest scatter of the rows [-]: that of rounding to four digits
MIN_READING_SCATTER = 0.01
"""Lowest scatter of a reading of an edge that was not measured [-] (assumption)."""
MIN_TOLD_APART = 0.05
"""Share of the difference of fresh and worn edges that settings must leave unexplained [-]."""
MIN_SETTINGS = 3
"""Number of settings below which rows without names of edges do not tell how edges differ."""
MAX_LOG = 700.0
"""Largest logarithm of an end of the coefficient's interval; it keeps the end finite."""
FRESH_ONLY = "all rows are of fresh edges: the load of a worn edge is higher, and not known"
NO_HARDNESS = "there is no column hardness: nominal in all rows"

Rows = NDArray[np.bool_]
"""Which rows of a sheet are meant, shape (rows,)."""


@dataclass(frozen=True)
class EdgeEffect:
    """The deviation that readings of one edge share."""

    count: int  # of edges
    spread: float  # standard deviation of the logarithm that readings of one edge share [-]
    degrees: tuple[int, ...]  # of freedom, of the coefficient and of each fitted exponent
    group: NDArray[np.int64]  # number of each row's edge, from 0, shape (rows,)
    # Share of its edge's mean to subtract from each row, which makes rows independent [-], (rows,).
    removed: Values


@dataclass(frozen=True)
class Fit:
    """A fitted law; arrays have the shape (rows,).

    Rows of fresh edges, whose wear is 0, have a level of their own: they tell the exponents of
    speed, feed and depth. Their wear in ``factors`` is the mean of the others. If all edges are
    fresh, the law does not depend on wear.
    """

    response: str  # predicted quantity, a key of ``FACTORS``
    law: PowerLaw
    estimates: dict[str, Estimate]  # the coefficient and the fitted exponents, named as in the law
    assumed: dict[str, str]  # factors whose exponents are the base law's, with the reason
    # Of the coefficient's logarithm and the fitted exponents, in the order of ``estimates``.
    covariance: Values
    # Standard deviation of the logarithm of one reading of an edge that was not measured [-].
    reading_scatter: float
    factors: dict[str, Values]  # in the units of ``COLUMNS``
    measured: Values  # response in its unit
    predicted: Values  # response by the law
    lines: NDArray[np.int64]  # of the file
    edges: EdgeEffect | None  # None if they are unknown
    fresh: Rows  # rows of fresh edges
    # Response of a fresh edge over that of the law at the rows' mean wear [-]; NaN if not measured.
    fresh_level: float

    @property
    def exponents(self) -> list[str]:
        """Factors whose exponents were fitted."""
        return list(self.estimates)[1:]

    @property
    def degrees(self) -> int:
        """Degrees of freedom of the residuals: number of rows - number of fitted parameters."""
        has_fresh_level = int(np.isfinite(self.fresh_level))
        return len(self.lines) - len(self.estimates) - has_fresh_level

    @property
    def log_residuals(self) -> Values:
        """Logarithms of measured over predicted responses [-], shape (rows,)."""
        return np.asarray(np.log(self.measured / self.predicted))

    @property
    def scatter(self) -> float:
        """Standard deviation of the residuals' logarithms, by the degrees of freedom [-]."""
        return float(np.linalg.norm(self.log_residuals) / np.sqrt(self.degrees))

    @property
    def r_squared(self) -> float | None:
        """Share of the variance of the response's logarithm that the law explains [-].

        None if the response never varies.
        """
        logs = np.log(self.measured)
        if np.ptp(logs) < MIN_VARIATION:
            return None
        return 1.0 - float(np.mean(self.log_residuals**2) / np.var(logs))

    @property
    def quality(self) -> str:
        """Number of rows, explained variance and scatter, for people."""
        explained = "" if self.r_squared is None else f"R2 {self.r_squared:.5f}, "
        return f"{len(self.lines)} rows, {explained}scatter {100 * self.scatter:.2g} %"


@dataclass(frozen=True)
class _Sample:
    """The rows with a response and all its factors; arrays have the shape (rows,)."""

    measured: Values
    factors: dict[str, Values]  # with a wear of fresh edges as in ``Fit``
    lines: NDArray[np.int64]
    edges: NDArray[np.int64] | None
    fresh: Rows

    @property
    def is_mixed(self) -> bool:
        """Whether both fresh and worn edges were measured."""
        return bool(self.fresh.any() and not self.fresh.all())


def fit(
    response: str,
    measurements: Measurements,
    base: PowerLaw,
    given: Mapping[str, str] = MappingProxyType({}),
    edge_spread: float = 0.0,
) -> Fit:
    """Fit the law of one response to all rows with that response and all its factors.

    Without a hardness column or value, hardness is nominal. Exponents that cannot be estimated, and
    those of ``given`` factors with the reason, are the base's. ``edge_spread`` is the log standard
    deviation of edges [-] that is assumed if the rows are of too few to tell it.

    Raises:
        WorkshopError: There are too few rows, or a fitted number is out of the law's range.
    """
    sample = _sample(response, measurements)
    fresh_only = bool(sample.fresh.any()) and not sample.is_mixed
    if fresh_only:
        base = base.model_copy(update={"wear": 0.0})
    candidates = [name for name in sample.factors if name not in given]
    fitted, assumed = _identifiable(sample.factors, candidates)
    assumed |= given
    if fresh_only:
        assumed["wear"] = FRESH_ONLY
    if "hardness" not in measurements.columns:
        assumed["hardness"] = NO_HARDNESS
    if len(sample.lines) < len(fitted) + 2 + int(sample.is_mixed):
        raise WorkshopError(f"{response}: {_too_few(sample)}")

    target, design = _regression(sample, base, fitted)
    edges = None
    if sample.edges is not None:
        edges = _edge_effect(target, design[:, 1:], sample.edges)
    solved = _least_squares(target, design, edges)

    # The level of fresh edges, the last parameter, is no part of the law.
    names = ("coefficient", *fitted)
    count = len(names)
    solution = solved.parameters[:count]
    covariance = solved.covariance[:count, :count]
    degrees = (len(target) - design.shape[1],) * count
    if edges:
        degrees = edges.degrees[:count]
    numbers = dict(zip(names, solution, strict=True))
    # A coefficient that overflows is infinite, and ``validated_law`` refuses it.
    with np.errstate(over="ignore"):
        numbers["coefficient"] = np.exp(solution[0])
    law = validated_law(response, base, numbers)
    fresh_level = np.nan
    level = np.ones(len(target))
    if sample.is_mixed:
        fresh_level = float(np.exp(solved.parameters[-1]))
        level[sample.fresh] = fresh_level

    spread = edges.spread if edges else 0.0
    if edges is None and tells_no_edges(measurements, sample.factors):
        spread = edge_spread
    return Fit(
        response=response,
        law=law,
        estimates=_estimates(law, names, solution, covariance, degrees),
        assumed=assumed,
        covariance=covariance,
        reading_scatter=max(float(np.hypot(solved.scatter, spread)), MIN_READING_SCATTER),
        factors=sample.factors,
        measured=sample.measured,
        predicted=np.asarray(law(**sample.factors)) * level,
        lines=sample.lines,
        edges=edges,
        fresh=sample.fresh,
        fresh_level=fresh_level,
    )


def _sample(response: str, measurements: Measurements) -> _Sample:
    """Return the rows to which the law of a response is fitted."""
    present = complete_rows(response, measurements)
    columns = measurements.columns
    count = int(present.sum())
    factors = {}
    for name in FACTORS[response]:
        # Only hardness may be missing: it is then nominal, 1.
        known = columns[name][present] if name in columns else np.ones(count)
        factors[name] = np.nan_to_num(known, nan=1.0)
    fresh = fresh_rows(response, measurements)[present]
    if fresh.all() and fresh.any():
        factors["wear"] = np.ones(count)
    elif fresh.any():
        mean = np.exp(np.log(factors["wear"][~fresh]).mean())
        factors["wear"] = np.where(fresh, mean, factors["wear"])
    edges = measurements.edges
    return _Sample(
        measured=columns[response][present],
        factors=factors,
        lines=measurements.lines[present],
        edges=None if edges is None else edges[present],
        fresh=fresh,
    )


def _too_few(sample: _Sample) -> str:
    """Return the message on a sample with too few rows."""
    varying = []
    for name, values in sample.factors.items():
        if _variation(np.log(values)) >= MIN_VARIATION:
            varying.append(name)
    numbers = "the coefficient"
    if varying:
        numbers += f" and {len(varying)} exponents ({', '.join(varying)})"
    if sample.is_mixed:
        numbers += " and the level of fresh edges"
    count = len(sample.lines)
    needed = len(varying) + 2 + int(sample.is_mixed)
    return (
        f"{count} row{'' if count == 1 else 's'} with this and all its factors, "
        f"but {needed} are needed: for {numbers}, and one more to estimate the scatter"
    )


def _regression(sample: _Sample, base: PowerLaw, fitted: Sequence[str]) -> tuple[Values, Values]:
    """Return the target (rows,) and the design (rows, parameters) of the regression.

    log(response) - log(assumed part) = log c + a log V + b log f + e log(d / d0) + ...

    The parameters are the coefficient's logarithm, the fitted exponents and, if both fresh and worn
    edges were measured, the logarithm of the level of fresh ones.
    """
    assumed_part = base.model_dump() | {"coefficient": 1.0} | dict.fromkeys(fitted, 0.0)
    known = PowerLaw.model_validate(assumed_part)
    target = np.log(sample.measured) - np.log(known(**sample.factors))
    columns = [np.ones(len(target))]
    for name in fitted:
        log = np.log(sample.factors[name])
        if name == "depth_of_cut":
            log = log - np.log(base.reference_depth_of_cut)
        columns.append(log)
    if sample.is_mixed:
        columns.append(sample.fresh.astype(float))
    return target, np.column_stack(columns)


def _estimates(
    law: PowerLaw,
    names: Sequence[str],
    solution: Values,
    covariance: Values,
    degrees: Sequence[int],
) -> dict[str, Estimate]:
    """Return the numbers of a fitted law with their intervals of confidence ``LEVEL``."""
    # Student's t, as the scatter is estimated from the same rows.
    quantiles = stats.t.ppf(0.5 + 0.5 * LEVEL, degrees)
    margins = np.sqrt(np.diag(covariance)) * quantiles
    low = solution - margins
    high = solution + margins
    # The first parameter is the coefficient's logarithm.
    low[0] = np.exp(max(low[0], -MAX_LOG))
    high[0] = np.exp(min(high[0], MAX_LOG))
    estimates = {}
    for index, name in enumerate(names):
        estimates[name] = Estimate(
            value=getattr(law, name),
            low=float(low[index]),
            high=float(high[index]),
        )
    return estimates


def tells_no_edges(measurements: Measurements, factors: Mapping[str, Values]) -> bool:
    """Return whether rows, of which no edge effect is known, cannot tell how edges differ.

    Either too few edges are named, or none is and the settings hardly differ.
    """
    if measurements.edges is not None:
        return True
    logs = np.log(np.stack([factors[name] for name in SETTINGS], axis=1))
    settings = np.round(logs / MIN_VARIATION)
    return len(np.unique(settings, axis=0)) < MIN_SETTINGS


def complete_rows(response: str, measurements: Measurements) -> Rows:
    """Return which rows have a response and all its factors; hardness may be missing.

    Rows of fresh edges count for force and power, unless their level cannot be told. They tell
    nothing of the law of wear.
    """
    complete = _filled_rows(response, measurements)
    if response == "wear":
        # The logarithms of wear and time are fitted.
        for name in ("wear", "time"):
            if name in measurements.columns:
                complete &= measurements.columns[name] > 0.0
        return complete
    fresh = fresh_rows(response, measurements)
    if (complete & ~fresh).any() and not _told_apart(response, measurements, complete):
        complete &= ~fresh
    return complete


def fresh_rows(response: str, measurements: Measurements) -> Rows:
    """Return which rows have a force or power of a fresh edge, whose wear is 0."""
    if response == "wear" or "wear" not in measurements.columns:
        return np.zeros(len(measurements.lines), np.bool_)
    unworn = measurements.columns["wear"] == 0.0
    return np.asarray(_filled_rows(response, measurements) & unworn)


def _filled_rows(response: str, measurements: Measurements) -> Rows:
    """Return which rows have a response and all its factors, also a wear of 0."""
    filled = np.ones(len(measurements.lines), np.bool_)
    for name in (response, *FACTORS[response]):
        if name in measurements.columns:
            filled &= np.isfinite(measurements.columns[name]) | (name == "hardness")
        elif name != "hardness":
            filled[:] = False
    return filled


def _told_apart(response: str, measurements: Measurements, rows: Rows) -> bool:
    """Return whether fresh edges were measured at settings that tell their level.

    It must not be a combination of the terms of speed, feed and depth.
    """
    fresh = fresh_rows(response, measurements)
    if not fresh.any():
        return True
    columns = [np.ones(int(rows.sum()))]
    for name in SETTINGS:
        if name in FACTORS[response] and name != "hardness":
            columns.append(np.log(measurements.columns[name][rows]))
    others = np.column_stack(columns)
    indicator = fresh[rows].astype(float)
    unexplained = indicator - others @ _slopes(others, indicator)
    return bool(np.abs(unexplained).max() > MIN_TOLD_APART)


def rows_correlate(fitted: Fit) -> bool:
    """Return whether rows at the same settings deviate from the law together more than by chance.

    Usually they are readings of one edge, and edges differ; otherwise no power law fits. An F test
    compares the variance of the residuals between settings with the variance within them.
    """
    residuals = fitted.log_residuals
    settings = np.stack([fitted.factors[name] for name in SETTINGS], axis=1)
    group = np.unique(settings, axis=0, return_inverse=True)[1]
    members = np.bincount(group)
    means = np.bincount(group, residuals) / members
    # The coefficient and the exponents of settings are decided between them, the others within.
    between = 1 + sum(name in SETTINGS for name in fitted.estimates)
    degrees_between = len(members) - between
    degrees_within = len(residuals) - len(members) - (len(fitted.estimates) - between)
    if degrees_between < 1 or degrees_within < 1:
        return False
    within = residuals - means[group]
    variance_within = float((within**2).sum()) / degrees_within
    if variance_within <= 0:
        return False
    variance_between = float(members @ means**2) / degrees_between
    ratio = variance_between / variance_within
    return bool(stats.f.sf(ratio, degrees_between, degrees_within) < SIGNIFICANCE)


def _identifiable(
    factors: Mapping[str, Values], candidates: Sequence[str]
) -> tuple[list[str], dict[str, str]]:
    """Return the factors whose exponents can be estimated, and the reasons why others cannot.

    If factors vary only together, the first is fitted.
    """
    kept: list[str] = []
    centred: list[Values] = []  # logarithms of the kept factors, less their means
    reasons: dict[str, str] = {}
    for name in candidates:
        log = np.log(factors[name])
        if _variation(log) < MIN_VARIATION:
            reasons[name] = _never_varies(name, factors[name])
            continue
        others = np.array(centred).reshape(len(kept), len(log)).T
        weights = _slopes(others, log - log.mean())
        if _variation(log - others @ weights) >= MIN_VARIATION:
            kept.append(name)
            centred.append(log - log.mean())
            continue
        shares = np.abs(weights) * np.ptp(others, axis=0)
        together = []
        for other, share in zip(kept, shares, strict=True):
            if share >= MIN_VARIATION:
                together.append(other)
        reasons[name] = f"{name} varies only together with {' and '.join(together)}"
    return kept, reasons


def _never_varies(name: str, values: Values) -> str:
    unit = COLUMNS[name].unit.replace("-", "")
    number = f"{values.mean():.4g} {unit}".rstrip()
    return f"{name} never varies: {number} in all {len(values)} rows"


def _variation(log: Values) -> float:
    """Return the largest relative distance of a factor from its mean [-]."""
    return float(np.abs(log - log.mean()).max())


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
    rows, edges = len(group), len(members)
    design_within = design - _group_means(design, group)
    target_within = target - _group_means(target, group)
    centred = design - design.mean(axis=0)
    total = (centred**2).sum(axis=0)
    within = (design_within**2).sum(axis=0) > MIN_SHARE * total
    degrees_within = rows - edges - int(within.sum())
    degrees_between = edges - 1 - int((~within).sum())
    if degrees_within < 1 or degrees_between < 1:
        return None
    slopes = _slopes(design_within[:, within], target_within)
    residual = target_within - design_within[:, within] @ slopes
    variance_within = float((residual**2).sum()) / degrees_within

    # Each edge weighs as often as it was read.
    level = _group_means(target - design[:, within] @ slopes, group)
    settings = _group_means(design[:, ~within], group)
    design_between = np.column_stack([np.ones(rows), settings])
    deviation = level - design_between @ _slopes(design_between, level)
    mean_square = float(deviation @ deviation) / degrees_between
    # Readings of an edge on average: the mean number, less its variance over that mean.
    readings = (rows - float(members @ members) / rows) / (edges - 1)
    variance_between = max(0.0, (mean_square - variance_within) / readings)

    # Less the share 1 - sqrt(s_w^2 / (s_w^2 + m s_b^2)) of their edge's mean, rows are independent.
    variance_of_mean = variance_within + members * variance_between
    kept_squared = np.divide(
        variance_within, variance_of_mean, out=np.ones(edges), where=variance_of_mean > 0
    )
    kept = np.maximum(np.sqrt(kept_squared), MIN_KEPT)
    degrees = [degrees_between]
    for is_within in within:
        degrees.append(degrees_within if is_within else degrees_between)
    return EdgeEffect(
        count=edges,
        spread=float(np.sqrt(variance_between)),
        degrees=tuple(degrees),
        group=group,
        removed=1.0 - kept[group],
    )


def _slopes(design: Values, target: Values) -> Values:
    """Return the parameters of least squares, of lowest norm if they are not unique."""
    return np.asarray(np.linalg.lstsq(design, target, rcond=None)[0], np.float64)


def _group_means(values: Values, group: NDArray[np.int64]) -> Values:
    """Return each row's mean over its group, for values of shape (rows,) or (rows, columns)."""
    sums = np.zeros((int(group.max()) + 1, *values.shape[1:]))
    np.add.at(sums, group, values)
    means = (sums.T / np.bincount(group)).T
    return np.asarray(means[group])


class _Solution(NamedTuple):
    """The solution of a regression."""

    parameters: Values  # shape (parameters,)
    covariance: Values  # of the parameters, shape (parameters, parameters)
    scatter: float  # standard deviation of a row, without that of its edge [-]


def _least_squares(target: Values, design: Values, edges: EdgeEffect | None) -> _Solution:
    """Solve a regression: by ordinary least squares, or with an edge effect by generalised ones."""
    if edges is not None:
        share = edges.removed
        target = target - share * _group_means(target, edges.group)
        design = design - share[:, np.newaxis] * _group_means(design, edges.group)
    inverse = np.linalg.pinv(design)
    parameters = inverse @ target
    degrees = len(target) - len(parameters)
    residual = target - design @ parameters
    scatter = float(np.linalg.norm(residual) / np.sqrt(degrees))
    scatter = max(scatter, MIN_SCATTER)
    covariance = inverse @ inverse.T * scatter**2
    return _Solution(parameters, covariance, scatter=scatter)


def validated_law(response: str, base: PowerLaw, numbers: dict[str, float]) -> PowerLaw:
    """Return the base law with fitted numbers; raise an error if one is out of range."""
    try:
        return PowerLaw.model_validate(base.model_dump() | numbers)
    except ValidationError as error:
        detail = error.errors()[0]
        field = detail["loc"][-1]
        number = "coefficient" if field == "coefficient" else f"exponent of {field}"
        fault = detail["msg"].removeprefix("Value error, ")
        why = "factors vary too little, rows scatter too much, or a unit is wrong"
        raise WorkshopError(f"{response}: {number}, as fitted: {fault}; {why}") from error
