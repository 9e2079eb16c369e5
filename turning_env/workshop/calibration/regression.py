"""Fits one power law to measurements, by least squares in logarithms.

The logarithm of a power law is linear in the logarithms of its factors, so its exponents are slopes. A factor that never
varies, or only together with others, tells nothing of its own exponent: that is left as the base law has it, and the rest is
fitted given it. Intervals are those of least squares, with the same relative scatter of all rows: independent ones or, where the
file names edges, such as share what their edge is off by (``edges``).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from turning_env.scenario.power_law import PowerLaw
from turning_env.workshop.calibration.columns import FACTORS, CalibrationError
from turning_env.workshop.calibration.edges import EdgeSpread, edge_spread
from turning_env.workshop.calibration.identifiable import MIN_VARIATION, check_enough, told_apart
from turning_env.workshop.calibration.reading import Measurements
from turning_env.workshop.calibration.student import two_sided_quantile

Column = NDArray[np.float64]

MAX_LOG = 700.0
"""Logarithm at which an interval of a coefficient that is not known at all ends, so that its ends are numbers."""


@dataclass(frozen=True)
class Estimate:
    """A fitted number and its confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Fit:
    """One law, as fitted."""

    response: str
    """What the law predicts: a key of ``FACTORS``."""
    law: PowerLaw
    estimates: dict[str, Estimate]
    """The coefficient and the exponents that were fitted, by their names in ``PowerLaw``."""
    assumed: dict[str, str]
    """Factors whose exponents are the base law's, and why."""
    r_squared: float | None
    """Share of the variance of the response's logarithm that the law explains [-]; None if the response never varies."""
    scatter: float
    """Standard deviation of the residuals, with the degrees of freedom taken off [-]."""
    degrees: int
    """Degrees of freedom of the residuals: rows less fitted numbers."""
    factors: dict[str, Column]
    """Values of all factors, each of shape (rows,)."""
    measured: Column
    predicted: Column
    """The response, as measured and by the law, shape (rows,)."""
    lines: NDArray[np.int64]
    """Where the rows stand in the file, shape (rows,)."""
    edges: EdgeSpread | None
    """How edges differ; None if that is not known."""

    @property
    def residuals(self) -> Column:
        """Measured over predicted, less 1 [-], shape (rows,)."""
        return np.asarray(self.measured / self.predicted - 1.0)


def fit(response: str, measurements: Measurements, base: PowerLaw, confidence: float = 0.95) -> Fit | None:
    """The law of one response, from all rows that have it and its factors; None if there is no such row.

    Where the file has no hardness, or the cell is empty, hardness is nominal.

    Raises:
        CalibrationError: too few rows, or a fitted number outside the range of ``PowerLaw``.
    """
    present = rows_of(response, measurements)
    count = int(present.sum())
    if count == 0:
        return None
    factors = {
        name: np.nan_to_num(measurements.columns[name][present], nan=1.0) if name in measurements.columns else np.ones(count)
        for name in FACTORS[response]
    }
    measured = measurements.columns[response][present]
    logs = {name: np.log(values) for name, values in factors.items()}
    fitted, assumed = told_apart(factors, logs)
    if "hardness" not in measurements.columns:
        assumed["hardness"] = "there is no column hardness: nominal in all rows"
    check_enough(response, count, fitted, logs)

    known = PowerLaw.model_validate(base.model_dump() | {"coefficient": 1.0} | dict.fromkeys(fitted, 0.0))
    target = np.log(measured) - np.log(_evaluated(known, factors))
    references = {"depth_of_cut": np.log(base.reference_depth_of_cut)}
    design = np.array([logs[name] - references.get(name, 0.0) for name in fitted]).reshape(len(fitted), count).T
    edges = None if measurements.edges is None else edge_spread(target, design, measurements.edges[present])
    intercept, slopes, errors = _least_squares(target, design, edges)
    exponents = dict(zip(fitted, slopes.tolist(), strict=True))
    law = _checked(response, base, {"coefficient": float(np.exp(intercept)), **exponents})
    predicted = _evaluated(law, factors)
    residuals = np.log(measured / predicted)
    degrees = count - 1 - len(fitted)
    scatter = float(np.sqrt(residuals @ residuals / degrees))
    freedom = edges.degrees if edges else (degrees,) * (1 + len(fitted))
    aside, *reaches = (error * two_sided_quantile(confidence, each) for error, each in zip(errors, freedom, strict=True))
    ends = np.exp(np.clip((intercept - aside, intercept + aside), -MAX_LOG, MAX_LOG))
    estimates = {"coefficient": _interval(law.coefficient, *ends)}
    for name, slope, reach in zip(fitted, slopes, reaches, strict=True):
        estimates[name] = _interval(slope, slope - reach, slope + reach)
    log_measured = np.log(measured)
    variation = float(((log_measured - log_measured.mean()) ** 2).sum())
    varies = np.ptp(log_measured) >= MIN_VARIATION
    return Fit(
        response=response,
        law=law,
        estimates=estimates,
        assumed=assumed,
        r_squared=1.0 - float(residuals @ residuals) / variation if varies else None,
        scatter=scatter,
        degrees=degrees,
        factors=factors,
        measured=measured,
        predicted=predicted,
        lines=measurements.lines[present],
        edges=edges,
    )


def _least_squares(target: Column, design: Column, edges: EdgeSpread | None) -> tuple[float, Column, Column]:
    """Intercept, slopes, and the standard errors of both, shape (1 + factors,)."""
    centre = design.mean(axis=0)  # taken off, so that slopes do not depend on how far from 1 the factors lie
    columns = np.column_stack([target, np.ones(len(target)), design - centre])
    if edges is not None:
        columns = edges.independent(columns)
    target, columns = columns[:, 0], columns[:, 1:]
    orthogonal, triangular = np.linalg.qr(columns)
    inverse = np.linalg.inv(triangular)
    level, *slopes = inverse @ (orthogonal.T @ target)
    residuals = target - orthogonal @ (orthogonal.T @ target)
    covariance = inverse @ inverse.T * (residuals @ residuals) / (len(target) - columns.shape[1])
    back = np.concatenate([[1.0], -centre])
    errors = np.sqrt([back @ covariance @ back, *np.diag(covariance)[1:]])
    return float(level - centre @ slopes), np.array(slopes), errors


def rows_of(response: str, measurements: Measurements) -> NDArray[np.bool_]:
    """Which rows have a response and all its factors, shape (rows,); hardness may be missing."""
    present = np.ones(len(measurements.lines), bool)
    for name in (response, *FACTORS[response]):
        if name in measurements.columns:
            present &= np.isfinite(measurements.columns[name]) | (name == "hardness")
        elif name != "hardness":
            present[:] = False
    return present


def _evaluated(law: PowerLaw, factors: Mapping[str, Column]) -> Column:
    return np.asarray(law(**factors))


def _checked(response: str, base: PowerLaw, values: dict[str, float]) -> PowerLaw:
    try:
        return PowerLaw.model_validate(base.model_dump() | values)
    except ValidationError as error:
        detail = error.errors()[0]
        name = str(detail["loc"][-1])
        what = name if name == "coefficient" else f"exponent of {name}"
        message = detail["msg"].removeprefix("Value error, ")
        raise CalibrationError(
            f"{response}: {what}, as fitted: {message}; factors vary too little, rows scatter too much, or a unit is wrong"
        ) from error


def _interval(value: float, low: float, high: float) -> Estimate:
    return Estimate(float(value), float(low), float(high))
