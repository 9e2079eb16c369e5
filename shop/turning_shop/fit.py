"""Fit one power law to measurements, by least squares in logarithms.

The logarithm of a power law is linear in the logarithms of its factors, so its exponents are slopes. If a factor never varies, or
varies only together with others, its exponent cannot be estimated. The base law's exponent is then kept, and the others are
fitted given it.

Confidence intervals assume the same relative scatter in all rows. If the file does not name edges, rows count as independent.
If it does, the rows of one edge share a deviation: a random effect, whose variance is estimated by Swamy and Arora's method
(Econometrica 40, 1972).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

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
"""Factors of each law, named as in ``turning_env.PowerLaw``; a law is named after the column that it predicts."""
SETTINGS = (
    "cutting_speed",
    "feed",
    "depth_of_cut",
    "hardness",
)  # equal in all readings of one edge in one bar
MIN_VARIATION = 1e-3  # relative variation [-] of a factor, unexplained by other factors, that is needed to fit its exponent
MIN_SHARE = 0.1  # share of a factor's variance within edges that is needed to estimate its exponent from readings of one edge [-]
MIN_KEPT = 1e-3  # lowest share of its edge's mean that a row keeps [-]; at 0, settings could not be distinguished
SIGNIFICANCE = (
    0.01  # probability of the F test below which rows at the same settings count as correlated [-]
)
LEVEL = 0.95  # confidence level of all intervals [-]
MIN_SCATTER = 1e-4  # lowest scatter of the rows [-]: that of rounding to four digits
MIN_READING_SCATTER = (
    0.01  # lowest scatter of a reading of an edge that was not measured [-] (assumption)
)
MIN_TOLD_APART = (
    0.05  # share of the difference of fresh and worn edges that settings must leave unexplained [-]
)
MIN_SETTINGS = (
    3  # different settings below which rows without names of edges do not tell how edges differ
)
MAX_LOG = (
    700.0  # largest logarithm of an end of the coefficient's interval; it keeps the end finite
)


@dataclass(frozen=True)
class EdgeEffect:
    """The deviation that readings of one edge share."""

    count: int  # of edges
    spread: float  # standard deviation of the logarithm that readings of one edge share [-]
    degrees: tuple[int, ...]  # of freedom, of the coefficient and of each fitted exponent
    group: NDArray[np.int64]  # number of each row's edge, from 0, shape (rows,)
    removed: Values  # share of its edge's mean to subtract from each row, which makes all rows independent [-], shape (rows,)


@dataclass(frozen=True)
class Fit:
    """A fitted law; arrays have the shape (rows,).

    Rows of fresh edges, whose wear is 0, have a level of their own: they tell the exponents of speed, feed and depth. Their wear
    in ``factors`` is the mean of the others. If all edges are fresh, the law does not depend on wear.
    """

    response: str  # predicted quantity, a key of ``FACTORS``
    law: PowerLaw
    estimates: dict[
        str, Estimate
    ]  # the coefficient and the fitted exponents, by their names in ``PowerLaw``
    assumed: dict[str, str]  # factors whose exponents are the base law's, with the reason
    covariance: Values  # of the coefficient's logarithm and the fitted exponents, in the order of ``estimates``
    reading_scatter: float  # standard deviation of the logarithm of one reading of an edge that was not measured [-]
    factors: dict[str, Values]  # in the units of ``COLUMNS``
    measured: Values  # response in its unit
    predicted: Values  # response by the law
    lines: NDArray[np.int64]  # of the file
    edges: EdgeEffect | None  # None if they are unknown
    fresh: NDArray[np.bool_]  # rows of fresh edges
    fresh_level: float  # response of a fresh edge over that of the law at the rows' mean wear [-]; NaN if not both were measured

    @property
    def exponents(self) -> list[str]:
        """Factors whose exponents were fitted."""
        return list(self.estimates)[1:]

    @property
    def degrees(self) -> int:
        """Degrees of freedom of the residuals: number of rows - number of fitted parameters."""
        return len(self.lines) - len(self.estimates) - int(np.isfinite(self.fresh_level))

    @property
    def log_residuals(self) -> Values:
        """Logarithms of measured over predicted responses [-], shape (rows,)."""
        return np.asarray(np.log(self.measured / self.predicted))

    @property
    def scatter(self) -> float:
        """Standard deviation of the residuals' logarithms, adjusted for the degrees of freedom [-]."""
        return float(np.linalg.norm(self.log_residuals) / np.sqrt(self.degrees))

    @property
    def r_squared(self) -> float | None:
        """Share of the variance of the response's logarithm that the law explains [-]; None if the response never varies."""
        logs = np.log(self.measured)
        return (
            1.0 - float(np.mean(self.log_residuals**2) / np.var(logs))
            if np.ptp(logs) >= MIN_VARIATION
            else None
        )

    @property
    def quality(self) -> str:
        """Number of rows, explained variance and scatter, for people."""
        explained = "" if self.r_squared is None else f"R2 {self.r_squared:.5f}, "
        return f"{len(self.lines)} rows, {explained}scatter {100 * self.scatter:.2g} %"


def fit(
    response: str,
    measurements: Measurements,
    base: PowerLaw,
    given: Mapping[str, str] = MappingProxyType({}),
    edge_spread: float = 0.0,
) -> Fit:
    """Fit the law of one response to all rows with that response and all its factors.

    Without a hardness column or value, hardness is nominal. Exponents that cannot be estimated, and those of ``given`` factors
    with the reason, are the base's. ``edge_spread`` is the log standard deviation of edges [-] that is assumed if the rows are of
    too few to tell it.

    Raises:
        WorkshopError: There are too few rows, or a fitted number lies outside the range of ``PowerLaw``.
    """
    present = complete_rows(response, measurements)
    count, columns = int(present.sum()), measurements.columns
    factors = {
        name: np.nan_to_num(columns[name][present], nan=1.0) if name in columns else np.ones(count)
        for name in FACTORS[response]
    }
    fresh = fresh_rows(response, measurements)[present]
    mixed = bool(fresh.any() and not fresh.all())
    if mixed:
        worn = factors["wear"][~fresh]
        factors["wear"] = np.where(fresh, np.exp(np.log(worn).mean()), factors["wear"])
    elif fresh.any():
        factors["wear"] = np.ones(count)
        base = base.model_copy(update={"wear": 0.0})
    logs = {name: np.log(values) for name, values in factors.items()}
    fitted, assumed = _identifiable(
        factors, {name: log for name, log in logs.items() if name not in given}
    )
    assumed |= given
    if fresh.any() and not mixed:
        assumed["wear"] = (
            "all rows are of fresh edges: the load of a worn edge is higher, and not known"
        )
    if "hardness" not in columns:
        assumed["hardness"] = "there is no column hardness: nominal in all rows"
    if count < len(fitted) + 2 + int(mixed):
        varying = [name for name, log in logs.items() if _variation(log) >= MIN_VARIATION]
        numbers = "the coefficient" + (
            f" and {len(varying)} exponents ({', '.join(varying)})" if varying else ""
        )
        numbers += " and the level of fresh edges" * mixed
        raise WorkshopError(
            f"{response}: {count} row{'s' * (count != 1)} with this and all its factors, "
            f"but {len(varying) + 2 + int(mixed)} are needed: for {numbers}, and one more to estimate the scatter"
        )
    measured = columns[response][present]
    known = PowerLaw.model_validate(
        base.model_dump() | {"coefficient": 1.0} | dict.fromkeys(fitted, 0.0)
    )
    target = np.log(measured) - np.log(known(**factors))
    references = {"depth_of_cut": np.log(base.reference_depth_of_cut)}
    design = np.column_stack(
        [np.ones(count), *(logs[name] - references.get(name, 0.0) for name in fitted)]
    )
    names = ("coefficient", *fitted)
    if mixed:
        design = np.column_stack(
            [design, fresh.astype(float)]
        )  # the level of fresh edges, the last parameter
    edges = (
        None
        if measurements.edges is None
        else _edge_effect(target, design[:, 1:], measurements.edges[present])
    )
    solution, covariance, within = _least_squares(target, design, edges)
    fresh_level = float(np.exp(solution[-1])) if mixed else np.nan
    numbers_of_law = len(names)
    degrees = edges.degrees if edges else (count - design.shape[1],) * numbers_of_law
    solution, covariance = solution[:numbers_of_law], covariance[:numbers_of_law, :numbers_of_law]
    law = _validated(
        response, base, dict(zip(names, [np.exp(solution[0]), *solution[1:]], strict=True))
    )
    margins = np.sqrt(np.diag(covariance)) * stats.t.ppf(
        0.5 + 0.5 * LEVEL, degrees[:numbers_of_law]
    )
    ends = np.column_stack([solution - margins, solution + margins])
    ends[0] = np.exp(np.clip(ends[0], -MAX_LOG, MAX_LOG))
    estimates = {
        name: Estimate(getattr(law, name), *row)
        for name, row in zip(names, ends.tolist(), strict=True)
    }
    spread = edges.spread if edges else 0.0
    if edges is None and tells_no_edges(measurements, factors):
        spread = edge_spread
    return Fit(
        response=response,
        law=law,
        estimates=estimates,
        assumed=assumed,
        covariance=covariance,
        reading_scatter=max(float(np.hypot(within, spread)), MIN_READING_SCATTER),
        factors=factors,
        measured=measured,
        predicted=np.asarray(law(**factors)) * np.where(fresh & mixed, fresh_level, 1.0),
        lines=measurements.lines[present],
        edges=edges,
        fresh=fresh,
        fresh_level=fresh_level,
    )


def tells_no_edges(measurements: Measurements, factors: Mapping[str, Values]) -> bool:
    """Return whether rows cannot tell how edges differ: too few are named, or none is and the settings hardly differ."""
    settings = np.round(
        np.log(np.stack([factors[name] for name in SETTINGS], axis=1)) / MIN_VARIATION
    )
    return measurements.edges is not None or len(np.unique(settings, axis=0)) < MIN_SETTINGS


def complete_rows(response: str, measurements: Measurements) -> NDArray[np.bool_]:
    """Return which rows have a response and all its factors, shape (rows,); hardness may be missing.

    Rows of fresh edges count for force and power, unless their level cannot be told, and tell nothing of the law of wear.
    """
    complete = _filled_rows(response, measurements)
    if response == "wear":  # its logarithm, and that of the time, are fitted
        for name in ("wear", "time"):
            if name in measurements.columns:
                complete &= measurements.columns[name] > 0.0
        return complete
    fresh = fresh_rows(response, measurements)
    if (complete & ~fresh).any() and not _told_apart(response, measurements, complete, fresh):
        complete &= ~fresh
    return complete


def fresh_rows(response: str, measurements: Measurements) -> NDArray[np.bool_]:
    """Return which rows have a force or power of a fresh edge, whose wear is 0, shape (rows,)."""
    nothing = np.zeros(len(measurements.lines), np.bool_)
    if response == "wear" or "wear" not in measurements.columns:
        return nothing
    return np.asarray(_filled_rows(response, measurements) & (measurements.columns["wear"] == 0.0))


def _filled_rows(response: str, measurements: Measurements) -> NDArray[np.bool_]:
    absent = np.full(len(measurements.lines), np.nan)
    needed = [
        measurements.columns.get(name, absent)
        for name in (response, *FACTORS[response])
        if name != "hardness"
    ]
    return np.asarray(np.isfinite(needed).all(axis=0))


def _told_apart(
    response: str, measurements: Measurements, rows: NDArray[np.bool_], fresh: NDArray[np.bool_]
) -> bool:
    """Return whether fresh edges were measured at settings that tell their level from the exponents of speed, feed and depth."""
    if not fresh.any():
        return True
    logs = [
        np.log(measurements.columns[name][rows])
        for name in SETTINGS
        if name in FACTORS[response] and name != "hardness"
    ]
    others = np.column_stack([np.ones(int(rows.sum())), *logs])
    indicator = fresh[rows].astype(float)
    rest = indicator - others @ np.linalg.lstsq(others, indicator, rcond=None)[0]
    return bool(np.abs(rest).max() > MIN_TOLD_APART)


def rows_correlate(fitted: Fit) -> bool:
    """Return whether rows at the same settings deviate from the law together more than by chance.

    Usually they are readings of one edge, and edges differ; otherwise no power law fits. An F test compares the variance of the
    residuals between settings with the variance within them.
    """
    residuals = fitted.log_residuals
    settings = np.stack([fitted.factors[name] for name in SETTINGS], axis=1)
    _, group, members = np.unique(settings, axis=0, return_inverse=True, return_counts=True)
    means = np.bincount(group, residuals) / members
    of_settings = 1 + sum(
        name in SETTINGS for name in fitted.estimates
    )  # the coefficient and exponents that settings decide
    between, within = (
        len(members) - of_settings,
        len(residuals) - len(members) - (len(fitted.estimates) - of_settings),
    )
    if between < 1 or within < 1:
        return False
    rest = float(((residuals - means[group]) ** 2).sum()) / within
    return rest > 0 and bool(
        stats.f.sf(float(members @ means**2) / between / rest, between, within) < SIGNIFICANCE
    )


def _identifiable(
    factors: Mapping[str, Values], logs: Mapping[str, Values]
) -> tuple[list[str], dict[str, str]]:
    """Return the factors whose exponents can be estimated, and the reasons why the others cannot.

    If factors vary only together, the first is fitted.
    """
    kept: list[str] = []
    assumed: dict[str, str] = {}
    for name, log in logs.items():
        if _variation(log) < MIN_VARIATION:
            values, unit = factors[name], COLUMNS[name].unit.replace("-", "")
            assumed[name] = (
                f"{name} never varies: {values.mean():.4g} {unit}".rstrip()
                + f" in all {len(values)} rows"
            )
            continue
        others = (
            np.array([logs[other] - logs[other].mean() for other in kept])
            .reshape(len(kept), len(log))
            .T
        )
        weights = np.linalg.lstsq(others, log - log.mean(), rcond=None)[0]
        if _variation(log - others @ weights) < MIN_VARIATION:
            shares = np.abs(weights) * np.ptp(others, axis=0)
            together = [
                other for other, share in zip(kept, shares, strict=True) if share >= MIN_VARIATION
            ]
            assumed[name] = f"{name} varies only together with {' and '.join(together)}"
        else:
            kept.append(name)
    return kept, assumed


def _variation(log: Values) -> float:
    """Return the largest relative distance of a factor from its mean [-]."""
    return float(np.abs(log - log.mean()).max())


def _edge_effect(target: Values, design: Values, edge: NDArray[np.int64]) -> EdgeEffect | None:
    """Estimate the deviations of edges from log responses (rows,), log factors (rows, factors) and every row's edge.

    Return None if there are too few edges, or too few readings of each.
    """
    _, group, members = np.unique(edge, return_inverse=True, return_counts=True)
    rows, edges = len(group), len(members)
    own_design, own_target = (
        design - _group_means(design, group),
        target - _group_means(target, group),
    )
    total = ((design - design.mean(axis=0)) ** 2).sum(axis=0)
    within = (own_design**2).sum(axis=0) > MIN_SHARE * total
    degrees_within, degrees_between = (
        rows - edges - int(within.sum()),
        edges - 1 - int((~within).sum()),
    )
    if degrees_within < 1 or degrees_between < 1:
        return None
    slopes = np.linalg.lstsq(own_design[:, within], own_target, rcond=None)[0]
    variance_within = (
        float(((own_target - own_design[:, within] @ slopes) ** 2).sum()) / degrees_within
    )

    level = _group_means(target - design[:, within] @ slopes, group)
    settings = np.column_stack([np.ones(rows), _group_means(design[:, ~within], group)])
    deviation = (
        level - settings @ np.linalg.lstsq(settings, level, rcond=None)[0]
    )  # each edge weighs as often as it was read
    readings = (rows - float(members @ members) / rows) / (edges - 1)
    variance_between = max(
        0.0, (float(deviation @ deviation) / degrees_between - variance_within) / readings
    )
    both = variance_within + members * variance_between
    kept = np.sqrt(np.divide(variance_within, both, out=np.ones(edges), where=both > 0))
    degrees = (
        degrees_between,
        *(degrees_within if inside else degrees_between for inside in within),
    )
    return EdgeEffect(
        edges,
        float(np.sqrt(variance_between)),
        degrees,
        group,
        1.0 - np.maximum(kept, MIN_KEPT)[group],
    )


def _group_means(values: Values, group: NDArray[np.int64]) -> Values:
    """Return each row's mean over its group, for values of shape (rows,) or (rows, columns)."""
    sums = np.zeros((int(group.max()) + 1, *values.shape[1:]))
    np.add.at(sums, group, values)
    return np.asarray((sums.T / np.bincount(group)).T[group])


def _least_squares(
    target: Values, design: Values, edges: EdgeEffect | None
) -> tuple[Values, Values, float]:
    """Return the parameters, their covariance, and the standard deviation of a row's own scatter."""
    if edges is not None:
        target = target - edges.removed * _group_means(target, edges.group)
        design = design - edges.removed[:, np.newaxis] * _group_means(design, edges.group)
    inverse = np.linalg.pinv(design)
    solution = inverse @ target
    scatter = float(
        np.linalg.norm(target - design @ solution) / np.sqrt(len(target) - len(solution))
    )
    scatter = max(scatter, MIN_SCATTER)
    return solution, inverse @ inverse.T * scatter**2, scatter


def _validated(response: str, base: PowerLaw, values: dict[str, float]) -> PowerLaw:
    try:
        return PowerLaw.model_validate(base.model_dump() | values)
    except ValidationError as error:
        detail = error.errors()[0]
        number = f"exponent of {detail['loc'][-1]}".replace(
            "exponent of coefficient", "coefficient"
        )
        why = "factors vary too little, rows scatter too much, or a unit is wrong"
        raise WorkshopError(
            f"{response}: {number}, as fitted: {detail['msg'].removeprefix('Value error, ')}; {why}"
        ) from error
