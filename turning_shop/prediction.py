"""How well fitted laws are known: intervals of predictions, and where a prediction extrapolates.

The evidence travels with a scenario, as table ``calibration`` of its file. It counts only for laws that still are those fitted.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field
from scipy import stats

from turning_env.scenario import Scenario
from turning_env.scenario.power_law import PowerLaw
from turning_shop import WorkshopError
from turning_shop.fit import Fit
from turning_shop.whatif import Cuts

Values = NDArray[np.float64]

LEVEL = 0.95
"""Confidence level of all intervals of predictions [-]."""
BEYOND = 0.01
"""Relative distance beyond the measured range above which a law counts as extrapolated [-]."""
PREDICTED = ("time", "wear", "thrust_force", "power", "tool_life")
"""Fields of ``Cuts`` that have intervals."""


class LawEvidence(BaseModel, frozen=True, allow_inf_nan=False):
    """What is known of one fitted law."""

    coefficient: float
    """The law's coefficient, by which the law is recognised."""
    terms: tuple[str, ...]
    """Fitted exponents; the covariance's first row and column is the coefficient's logarithm."""
    covariance: tuple[tuple[float, ...], ...]
    degrees: int
    scatter: float
    """Standard deviation of the logarithm of one reading, of an edge that was not measured [-]."""
    measured: dict[str, tuple[float, float]]
    """Lowest and highest measured value of each factor."""

    def log_deviation(self, law: PowerLaw, factors: Mapping[str, Values]) -> Values:
        """Return the standard error of the law's logarithm at values of its factors [-]."""
        columns = [np.ones(np.broadcast_shapes(*(np.shape(values) for values in factors.values())))]
        for name in self.terms:
            reference = law.reference_depth_of_cut if name == "depth_of_cut" else 1.0
            columns.append(np.log(factors[name] / reference) + 0.0 * columns[0])
        at = np.stack(columns, axis=-1)
        return np.asarray(np.sqrt(np.maximum(np.einsum("...i,ij,...j", at, np.array(self.covariance), at), 0.0)))

    def extrapolates(self, factors: Mapping[str, Values]) -> NDArray[np.bool_]:
        """Return where a factor lies outside its measured range."""
        outside = np.zeros(np.broadcast_shapes(*(np.shape(values) for values in factors.values())), bool)
        for name, (low, high) in self.measured.items():
            outside = outside | (factors[name] < low * (1 - BEYOND)) | (factors[name] > high * (1 + BEYOND))
        return np.asarray(outside)


class Evidence(BaseModel, frozen=True, allow_inf_nan=False):
    """What is known of a scenario's fitted laws."""

    source: str = ""
    """Name of the file of measurements."""
    warnings: tuple[str, ...] = ()
    laws: dict[str, LawEvidence] = Field(default_factory=dict)


class Prediction(NamedTuple):
    """Intervals of cuts."""

    low: dict[str, Values]
    """Lower ends, by names of ``PREDICTED``; NaN if the law was not fitted."""
    high: dict[str, Values]
    extrapolated: NDArray[np.bool_]
    """Where a fitted law is used beyond what was measured."""


def evidence_of(fitted: Fit) -> LawEvidence:
    """Return what a fit leaves known of its law."""
    return LawEvidence(
        coefficient=fitted.law.coefficient,
        terms=tuple(name for name in fitted.estimates if name != "coefficient"),
        covariance=tuple(tuple(row) for row in fitted.covariance.tolist()),
        degrees=min(fitted.edges.degrees) if fitted.edges else fitted.degrees,
        scatter=fitted.reading_scatter,
        measured={name: (float(values.min()), float(values.max())) for name, values in fitted.factors.items()},
    )


def read_evidence(scenario: Scenario) -> Evidence:
    """Return what is known of a scenario's laws; nothing if they were not fitted, or were changed since.

    Raises:
        WorkshopError: The table ``calibration`` of the scenario's file is damaged.
    """
    if scenario.calibration is None:
        return Evidence()
    try:
        evidence = Evidence.model_validate(scenario.calibration)
    except ValueError as error:
        raise WorkshopError(f"{scenario.file}: the table calibration is damaged: calibrate again, or delete it") from error
    same = {
        name: law
        for name, law in evidence.laws.items()
        if name in ("wear", "thrust_force", "power") and getattr(scenario.material, name).coefficient == law.coefficient
    }
    changed = [
        f"{name}: the law was changed since it was fitted, so no interval is known" for name in evidence.laws if name not in same
    ]
    return Evidence(source=evidence.source, warnings=(*evidence.warnings, *changed), laws=same)


def predict(scenario: Scenario, evidence: Evidence, cuts: Cuts, of_wear: bool) -> Prediction:
    """Return intervals of one reading at an edge and bar that were not measured.

    Args:
        scenario: Source of the laws and of the wear criterion.
        evidence: Returned by ``read_evidence``.
        cuts: Returned by ``what_if``.
        of_wear: Whether the cuts' wear is given, and exact, rather than predicted from their time.
    """
    material = scenario.material
    factors = {
        "cutting_speed": cuts.cutting_speed,
        "feed": cuts.feed,
        "depth_of_cut": cuts.depth_of_cut,
        "hardness": cuts.hardness,
    }
    half = {name: np.full(cuts.wear.shape, np.nan) for name in PREDICTED}
    extrapolated = np.zeros(cuts.wear.shape, bool)
    of_reading = np.zeros(cuts.wear.shape)
    if wear := evidence.laws.get("wear"):
        quantile = stats.t.ppf(0.5 + 0.5 * LEVEL, wear.degrees)
        for name, time in (("time" if of_wear else "wear", cuts.time), ("tool_life", cuts.tool_life)):
            at = factors | {"time": np.clip(time, 1e-300, 1e300)}
            deviation = np.hypot(wear.log_deviation(material.wear, at), wear.scatter)
            half[name] = deviation * quantile / (1.0 if name == "wear" else material.wear.time)
            if name != "tool_life":
                of_reading = deviation
                extrapolated |= wear.extrapolates(at)
    for name in ("thrust_force", "power"):
        if law := evidence.laws.get(name):
            at = factors | {"wear": cuts.wear}
            through_wear = 0.0 if of_wear else getattr(material, name).wear * of_reading
            deviation = np.sqrt(law.log_deviation(getattr(material, name), at) ** 2 + law.scatter**2 + through_wear**2)
            half[name] = deviation * stats.t.ppf(0.5 + 0.5 * LEVEL, law.degrees)
            extrapolated |= law.extrapolates(at)
    with np.errstate(over="ignore"):
        low = {name: getattr(cuts, name) * np.exp(-half[name]) for name in PREDICTED}
        high = {name: getattr(cuts, name) * np.exp(half[name]) for name in PREDICTED}
    return Prediction(low, high, extrapolated)
