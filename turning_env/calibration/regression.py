"""Fits one power law to measurements, by least squares in logarithms.

The logarithm of a power law is linear in the logarithms of its factors, so its exponents are slopes. A factor that never
varies, or only together with others, tells nothing of its own exponent: that is left as the base law has it, and the rest is
fitted given it. Intervals are those of ordinary least squares: rows are taken as independent, with the same relative scatter.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from turning_env.calibration.columns import COLUMNS, FACTORS, CalibrationError
from turning_env.calibration.reading import Measurements
from turning_env.calibration.student import two_sided_quantile
from turning_env.power_law import PowerLaw

Column = NDArray[np.float64]

LEAST_VARIATION = 1e-3
"""By so much [-] a factor must vary, once what other factors explain of it is taken off, for its exponent to be fitted."""


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
    fitted, assumed = _told_apart(factors, logs)
    if "hardness" not in measurements.columns:
        assumed["hardness"] = "there is no column hardness: nominal in all rows"
    _check_enough(response, count, fitted, logs)

    known = PowerLaw.model_validate(base.model_dump() | {"coefficient": 1.0} | dict.fromkeys(fitted, 0.0))
    target = np.log(measured) - np.log(_evaluated(known, factors))
    # Centred, so that the slopes do not depend on how far from 1 the factors lie.
    references = {"depth_of_cut": np.log(base.reference_depth_of_cut)}
    design = np.array([logs[name] - references.get(name, 0.0) for name in fitted]).reshape(len(fitted), count).T
    centre = design.mean(axis=0)
    orthogonal, triangular = np.linalg.qr(design - centre)
    inverse = np.linalg.inv(triangular)
    slopes = inverse @ (orthogonal.T @ (target - target.mean()))
    intercept = target.mean() - centre @ slopes

    exponents = dict(zip(fitted, slopes.tolist(), strict=True))
    law = _checked(response, base, {"coefficient": float(np.exp(intercept)), **exponents})
    predicted = _evaluated(law, factors)
    residuals = np.log(measured / predicted)
    degrees = count - 1 - len(fitted)
    scatter = float(np.sqrt(residuals @ residuals / degrees))
    covariance = inverse @ inverse.T
    reach = two_sided_quantile(confidence, degrees) * scatter
    aside = reach * np.sqrt(1.0 / count + centre @ covariance @ centre)
    estimates = {"coefficient": _interval(law.coefficient, np.exp(intercept - aside), np.exp(intercept + aside))}
    for name, slope, error in zip(fitted, slopes, reach * np.sqrt(np.diag(covariance)), strict=True):
        estimates[name] = _interval(slope, slope - error, slope + error)
    log_measured = np.log(measured)
    variation = float(((log_measured - log_measured.mean()) ** 2).sum())
    varies = np.ptp(log_measured) >= LEAST_VARIATION
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
    )


def rows_of(response: str, measurements: Measurements) -> NDArray[np.bool_]:
    """Which rows have a response and all its factors, shape (rows,); hardness may be missing."""
    present = np.ones(len(measurements.lines), bool)
    for name in (response, *FACTORS[response]):
        if name in measurements.columns:
            present &= np.isfinite(measurements.columns[name]) | (name == "hardness")
        elif name != "hardness":
            present[:] = False
    return present


def _told_apart(factors: Mapping[str, Column], logs: Mapping[str, Column]) -> tuple[list[str], dict[str, str]]:
    """Factors whose exponents the rows tell, and why they do not tell the others'.

    Of factors that vary together, the first is fitted.
    """
    kept: list[str] = []
    assumed: dict[str, str] = {}
    for name, log in logs.items():
        if _variation(log) < LEAST_VARIATION:
            values, unit = factors[name], COLUMNS[name].unit.replace("-", "")
            assumed[name] = f"{name} never varies: {values.mean():.4g} {unit}".rstrip() + f" in all {len(values)} rows"
            continue
        others = np.array([logs[other] - logs[other].mean() for other in kept]).reshape(len(kept), len(log)).T
        weights = np.linalg.lstsq(others, log - log.mean(), rcond=None)[0]
        if _variation(log - others @ weights) < LEAST_VARIATION:
            shares = np.abs(weights) * np.ptp(others, axis=0)
            together = [other for other, share in zip(kept, shares, strict=True) if share >= LEAST_VARIATION]
            assumed[name] = f"{name} varies only together with {' and '.join(together)}"
            continue
        kept.append(name)
    return kept, assumed


def _variation(log: Column) -> float:
    """Largest relative distance of a factor from its mean [-]."""
    return float(np.abs(log - log.mean()).max())


def _check_enough(response: str, count: int, fitted: list[str], logs: Mapping[str, Column]) -> None:
    if count >= len(fitted) + 2:
        return
    varying = [name for name, log in logs.items() if _variation(log) >= LEAST_VARIATION]
    numbers = f"the coefficient and {len(varying)} exponents ({', '.join(varying)})" if varying else "the coefficient"
    raise CalibrationError(
        f"{response}: {count} row{'s' * (count != 1)} with this and all its factors, but {len(varying) + 2} are needed: "
        f"for {numbers}, and one more to judge the scatter by"
    )


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
