"""Compute intervals of predictions by fitted laws, and find predictions that extrapolate.

The evidence travels with a scenario, as table ``calibration`` of its file. It counts only for laws that still are those fitted.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field
from scipy import stats
from turning_shop import Values, WorkshopError
from turning_shop.fit import FACTORS, LEVEL, SETTINGS, Fit
from turning_shop.headers import COLUMNS
from turning_shop.whatif import Cuts

from turning_env.scenario import Scenario
from turning_env.scenario.power_law import PowerLaw

BEYOND = (
    0.01  # relative distance beyond the measured range above which a law counts as extrapolated [-]
)
PREDICTED = ("time", "wear", "thrust_force", "power", "tool_life")
"""Fields of ``Cuts`` that have intervals."""


class LawEvidence(BaseModel, frozen=True, allow_inf_nan=False):
    """The evidence for one fitted law."""

    coefficient: float  # by which the law is recognised
    terms: tuple[str, ...]  # fitted exponents
    covariance: tuple[
        tuple[float, ...], ...
    ]  # of the coefficient's logarithm and the fitted exponents
    degrees: int  # of freedom
    scatter: float  # standard deviation of the logarithm of one reading, of an edge that was not measured [-]
    measured: dict[str, tuple[float, float]]  # lowest and highest value of each factor

    @property
    def quantile(self) -> float:
        """Half the width of an interval over the standard deviation [-]."""
        return float(stats.t.ppf(0.5 + 0.5 * LEVEL, self.degrees))

    def log_deviation(
        self, law: PowerLaw, factors: Mapping[str, Values], scatter: float | None = None
    ) -> Values:
        """Return the standard deviation of the logarithm of one reading at values of the law's factors [-]; 0: of the law."""
        references = {"depth_of_cut": law.reference_depth_of_cut}
        logs = [np.log(factors[name] / references.get(name, 1.0)) for name in self.terms]
        at = np.stack(np.broadcast_arrays(np.ones_like(factors["feed"]), *logs), axis=-1)
        variance = np.einsum("...i,ij,...j", at, np.array(self.covariance), at)
        return np.asarray(
            np.sqrt(np.maximum(variance, 0.0) + (self.scatter if scatter is None else scatter) ** 2)
        )

    def extrapolates(self, factors: Mapping[str, Values]) -> NDArray[np.bool_]:
        """Return whether one of the factors lies outside its measured range."""
        ranges = {name: ends for name, ends in self.measured.items() if name in factors}
        return np.asarray(
            np.logical_or.reduce([_beyond(factors[name], *ends) for name, ends in ranges.items()])
        )


class Evidence(BaseModel, frozen=True, allow_inf_nan=False):
    """The evidence for a scenario's fitted laws, and the name of the file of measurements."""

    source: str = ""
    warnings: tuple[str, ...] = ()
    laws: dict[str, LawEvidence] = Field(default_factory=dict)


def outside(
    evidence: Evidence, values: Mapping[str, Values]
) -> Iterator[tuple[str, str, NDArray[np.bool_]]]:
    """Yield each factor of the laws, the range in which all of them were measured, and whether its values lie outside."""
    for name in COLUMNS:
        if ranges := [law.measured[name] for law in evidence.laws.values() if name in law.measured]:
            low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
            measured = f"{low:.3g}{f' to {high:.3g}' * (low != high)} {COLUMNS[name].unit}"
            yield name, measured, _beyond(values[name], low, high)


def _beyond(values: Values, low: float, high: float) -> NDArray[np.bool_]:
    return np.asarray((values < low * (1 - BEYOND)) | (values > high * (1 + BEYOND)))


class Prediction(NamedTuple):
    """Intervals of cuts, by names of ``PREDICTED``; NaN if the law was not fitted."""

    low: dict[str, Values]
    high: dict[str, Values]
    extrapolated: NDArray[np.bool_]  # whether a fitted law is used outside the measured range


def evidence_of(fitted: Fit) -> LawEvidence:
    """Return a fit's evidence for its law."""
    measured = {
        name: (float(values.min()), float(values.max())) for name, values in fitted.factors.items()
    }
    if fitted.fresh.all():
        measured["wear"] = (0.0, 0.0)
    return LawEvidence(
        coefficient=fitted.law.coefficient,
        terms=tuple(fitted.exponents),
        covariance=tuple(tuple(row) for row in fitted.covariance.tolist()),
        degrees=min(fitted.edges.degrees) if fitted.edges else fitted.degrees,
        scatter=fitted.reading_scatter,
        measured=measured,
    )


def read_evidence(scenario: Scenario) -> Evidence:
    """Return the evidence for a scenario's laws; none if they were not fitted, or were changed since.

    Raises:
        WorkshopError: The table ``calibration`` of the scenario's file is damaged.
    """
    if scenario.calibration is None:
        return Evidence()
    try:
        evidence = Evidence.model_validate(scenario.calibration)
    except ValueError as error:
        raise WorkshopError(
            f"{scenario.file}: the table calibration is damaged: calibrate again, or delete it"
        ) from error
    laws, warnings = {}, list(evidence.warnings)
    for name, law in evidence.laws.items():
        if name in FACTORS and getattr(scenario.material, name).coefficient == law.coefficient:
            laws[name] = law
        else:
            warnings.append(
                f"{name}: the law was changed since it was fitted, so no interval is known"
            )
    return Evidence(source=evidence.source, warnings=tuple(warnings), laws=laws)


def predict(scenario: Scenario, evidence: Evidence, cuts: Cuts, of_wear: bool) -> Prediction:
    """Return intervals of one reading at an edge and bar that were not measured.

    ``of_wear`` says whether the cuts' wear is given, and exact, rather than predicted from their time.
    """
    material, settings = scenario.material, {name: getattr(cuts, name) for name in SETTINGS}
    half = dict.fromkeys(PREDICTED, np.full(cuts.wear.shape, np.nan))
    extrapolated, through_wear = np.zeros(cuts.wear.shape, bool), np.zeros(cuts.wear.shape)
    if wear := evidence.laws.get("wear"):
        now, at_the_end = (
            settings | {"time": np.clip(time, 1e-300, 1e300)}
            for time in (cuts.time, cuts.tool_life)
        )
        deviation = wear.log_deviation(material.wear, now)
        half["tool_life"] = (
            wear.quantile * wear.log_deviation(material.wear, at_the_end) / material.wear.time
        )
        if of_wear:
            half["time"] = wear.quantile * deviation / material.wear.time
        else:
            half["wear"], through_wear = wear.quantile * deviation, deviation
        extrapolated |= wear.extrapolates(now)
    for name in ("thrust_force", "power"):
        if known := evidence.laws.get(name):
            law, at = getattr(material, name), settings | {"wear": cuts.wear}
            half[name] = known.quantile * np.hypot(
                known.log_deviation(law, at), law.wear * through_wear
            )
            extrapolated |= known.extrapolates(at)
    with np.errstate(over="ignore"):
        low, high = (
            {name: getattr(cuts, name) * np.exp(sign * half[name]) for name in PREDICTED}
            for sign in (-1.0, 1.0)
        )
    return Prediction(low, high, extrapolated)
