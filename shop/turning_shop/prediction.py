"""Compute intervals of predictions by fitted laws, and find predictions that extrapolate.

The evidence travels with a scenario, as table ``calibration`` of its file. It counts only for laws
that still are those fitted. ``whatif.py`` predicts the nominal values.
"""

from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field
from scipy import special
from turning_shop import Values, WorkshopError
from turning_shop.catalogue import UNMEASURED
from turning_shop.fit import FACTORS, LEVEL, SETTINGS, Fit, curve_slope, regressor
from turning_shop.headers import COLUMNS
from turning_shop.whatif import Cuts

from turning_env.scenario import Scenario
from turning_env.scenario.power_law import PowerLaw, wear_exponent

BEYOND = 0.01
"""Relative distance beyond the measured range above which a law counts as extrapolated [-]."""
LONGEST_LIFE = {"catalogue": 60.0, "measured": 480.0}
"""Longest life of an edge that laws of an origin are used for [min].

Makers state speeds for lives of 15 to 60 min (Dormer Pramet 2024, p. 76). Laws that were measured,
or are a preset's, are used for a shift (assumption).
"""
PREDICTED = ("time", "wear", "thrust_force", "power", "tool_life")
"""Fields of ``Cuts`` that have intervals."""


class LawEvidence(BaseModel, frozen=True, allow_inf_nan=False):
    """The evidence for one fitted law."""

    coefficient: float  # by which the law is recognised
    terms: tuple[str, ...]  # fitted exponents, named after their factors, and wear_growth
    # Of the coefficient's logarithm and the terms.
    covariance: tuple[tuple[float, ...], ...]
    degrees: float  # of freedom
    # Of one reading of an edge that was not measured: see ``ReadingScatter``.
    scatter: float
    curve_scatter: float = 0.0
    curve_reference: float = 1.0
    # Lowest and highest value of each factor, as measured or as the catalogue states them.
    measured: dict[str, tuple[float, float]]
    origin: Literal["measured", "catalogue"] = "measured"

    @property
    def quantile(self) -> float:
        """Half the width of an interval over the standard deviation [-]."""
        # Of Student's t.
        return float(special.stdtrit(self.degrees, 0.5 + 0.5 * LEVEL))

    def log_deviation(
        self, law: PowerLaw, factors: Mapping[str, Values], of_reading: bool = True
    ) -> Values:
        """Return the standard deviation of the logarithm of one reading at these factors [-].

        It is sqrt(x C x' + scatter^2 + (curve_scatter curve_slope)^2), with the covariance C of the
        fitted numbers and the slopes x of the response's logarithm by them. If it is not
        ``of_reading``, it is that of the law, sqrt(x C x').
        """
        regressors = [np.ones_like(factors["feed"])]
        for name in self.terms:
            regressors.append(regressor(law, name, factors))
        slopes = np.stack(np.broadcast_arrays(*regressors), axis=-1)
        covariance = np.array(self.covariance)
        variance = np.sum((slopes @ covariance) * slopes, axis=-1)
        variance = np.maximum(variance, 0.0)
        if of_reading:
            variance = variance + self.scatter**2
            if self.curve_scatter > 0.0:
                slope = curve_slope(law, factors, self.curve_reference)
                variance = variance + (self.curve_scatter * slope) ** 2
        return np.asarray(np.sqrt(variance))

    def extrapolates(self, factors: Mapping[str, Values]) -> NDArray[np.bool_]:
        """Return whether one of the factors lies outside its measured range."""
        outside = []
        for name, (low, high) in self.measured.items():
            if name in factors:
                outside.append(_beyond(factors[name], low, high))
        return np.asarray(np.logical_or.reduce(outside))


class Evidence(BaseModel, frozen=True, allow_inf_nan=False):
    """The evidence for a scenario's fitted laws, and the name of the file of measurements."""

    source: str = ""
    tool: str = ""  # insert, grade and material, where the laws are those of a catalogue
    hardness: float = 0.0  # of a bar of nominal hardness [HB]; 0 if it is not stated
    warnings: tuple[str, ...] = ()
    laws: dict[str, LawEvidence] = Field(default_factory=dict)

    @property
    def origins(self) -> str:
        """The source of its laws, for people: "measured", or "in the catalogue"."""
        origins = {law.origin for law in self.laws.values()}
        return "in the catalogue" if origins == {"catalogue"} else "measured"

    @property
    def range_name(self) -> str:
        """Adjective for the range of its laws, for people: "measured", or "catalogue's"."""
        return "measured" if self.origins == "measured" else "catalogue's"

    def known(self, name: str) -> str:
        """Return what is known of a law, for people."""
        if name not in self.laws:
            return "not measured"
        if self.laws[name].origin == "catalogue":
            return UNMEASURED
        return "measured"


def longest_life(evidence: Evidence) -> float:
    """Return the longest life of an edge that the law of wear is used for [min].

    Beyond it, wear does not limit the edge, and other causes that no law knows do.
    """
    law = evidence.laws.get("wear")
    return LONGEST_LIFE[law.origin if law else "measured"]


class MeasuredRange(NamedTuple):
    """The range of a factor in which all laws were measured."""

    factor: str
    low: float
    high: float
    unit: str  # of the factor; empty for a ratio
    text: str  # the range for people
    outside: NDArray[np.bool_]  # whether values lie outside


def outside(evidence: Evidence, values: Mapping[str, Values]) -> Iterator[MeasuredRange]:
    """Yield the measured range of each factor of the laws, and whether its values lie outside."""
    for name, column in COLUMNS.items():
        lows = []
        highs = []
        for law in evidence.laws.values():
            if name in law.measured:
                law_low, law_high = law.measured[name]
                lows.append(law_low)
                highs.append(law_high)
        if not lows:
            continue
        # The range that all laws cover.
        low = max(lows)
        high = min(highs)
        ends = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
        is_outside = _beyond(values[name], low, high)
        unit = column.unit.replace("-", "")
        text = f"{ends} {unit}".rstrip()
        yield MeasuredRange(name, low, high, unit=unit, text=text, outside=is_outside)


def _beyond(values: Values, low: float, high: float) -> NDArray[np.bool_]:
    below = values < low * (1 - BEYOND)
    above = values > high * (1 + BEYOND)
    return np.asarray(below | above)


def evidence_of(fitted: Fit) -> LawEvidence:
    """Return a fit's evidence for its law."""
    measured = {}
    for name, values in fitted.factors.items():
        measured[name] = (float(values.min()), float(values.max()))
    return LawEvidence(
        coefficient=fitted.law.coefficient,
        terms=tuple(fitted.terms),
        covariance=tuple(tuple(row) for row in fitted.covariance.tolist()),
        degrees=fitted.reading.degrees,
        scatter=fitted.reading.level,
        curve_scatter=fitted.reading.curve,
        curve_reference=fitted.reading.reference,
        measured=measured,
    )


def read_evidence(scenario: Scenario) -> Evidence:
    """Return the evidence for a scenario's laws, except those not fitted, or changed since.

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
    laws = {}
    warnings = list(evidence.warnings)
    for name, law in evidence.laws.items():
        if name in FACTORS and getattr(scenario.material, name).coefficient == law.coefficient:
            laws[name] = law
        else:
            warnings.append(
                f"{name}: the law was changed since it was fitted, so no interval is known"
            )
    return evidence.model_copy(update={"warnings": tuple(warnings), "laws": laws})


class Prediction(NamedTuple):
    """Intervals of cuts, by names of ``PREDICTED``; NaN if the law was not fitted."""

    low: dict[str, Values]
    high: dict[str, Values]
    extrapolated: NDArray[np.bool_]  # whether a fitted law is used outside the measured range


def predict(scenario: Scenario, evidence: Evidence, cuts: Cuts, of_wear: bool) -> Prediction:
    """Return intervals of one reading at an edge and bar that were not measured.

    ``of_wear`` says whether the cuts' wear is given, and exact, rather than predicted from their
    time.
    """
    material = scenario.material
    settings = {name: getattr(cuts, name) for name in SETTINGS}
    shape = cuts.wear.shape
    half_width = dict.fromkeys(PREDICTED, np.full(shape, np.nan))  # of the values' logarithms
    extrapolated = np.zeros(shape, bool)
    wear_deviation = np.zeros(shape)  # of its logarithm, if it is predicted
    if "wear" in evidence.laws:
        known = evidence.laws["wear"]
        exponent = material.wear.time
        # The logarithm of a time of 0 or infinity is not finite.
        now = settings | {"time": np.clip(cuts.time, 1e-300, 1e300)}
        at_end = settings | {"time": np.clip(cuts.tool_life, 1e-300, 1e300)}
        deviation = known.log_deviation(material.wear, now)
        # W = c t^g, so that the logarithm of the time to a wear deviates by 1 / g of that of wear.
        end_deviation = known.log_deviation(material.wear, at_end)
        half_width["tool_life"] = known.quantile * end_deviation / exponent
        # A fresh edge has cut for no time, by any law.
        has_cut = cuts.time > 0.0
        if of_wear:
            half_width["time"] = has_cut * known.quantile * deviation / exponent
        else:
            half_width["wear"] = known.quantile * deviation
            wear_deviation = deviation
        extrapolated |= has_cut & known.extrapolates(now)

    log_wear = np.log(np.maximum(cuts.wear, 1e-300))
    for name in ("thrust_force", "power"):
        if name in evidence.laws:
            known = evidence.laws[name]
            law = getattr(material, name)
            factors = settings | {"wear": cuts.wear}
            # The deviation of the wear reaches the load through the slope of their logarithms.
            through_wear = wear_exponent(law, log_wear) * wear_deviation
            deviation = np.hypot(known.log_deviation(law, factors), through_wear)
            half_width[name] = known.quantile * deviation
            extrapolated |= known.extrapolates(factors)
    low = {}
    high = {}
    with np.errstate(over="ignore"):
        for name in PREDICTED:
            value = getattr(cuts, name)
            low[name] = value * np.exp(-half_width[name])
            high[name] = value * np.exp(half_width[name])
    return Prediction(low, high, extrapolated=extrapolated)
