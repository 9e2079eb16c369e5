"""Fit one power law to measurements, by least squares in logarithms.

The laws are the extended Taylor equation of tool life, solved for the wear, and Kienzle's equation
of forces with factors for speed and wear. In the symbols of ``turning_env.scenario.power_law``:

    response = coefficient * V^a * f^b * (d / d0)^c * t^g * U^e * H^h

Its logarithm is linear in the logarithms of the factors, so exponents are slopes. If a factor never
varies, or varies only together with others, its exponent cannot be estimated. The base law's
exponent is then kept, and the others are fitted given it.

U is the flank wear W, or 1 + B W in a law of force or power with a fresh edge's share. ``fit``
keeps the base's form, and ``form.py`` chooses it. B enters the logarithm as log(1 + B W), the only
term that is not linear in the number that is fitted. So B is searched, with the others by least
squares at each trial value. Intervals follow from the slope W / (1 + B W), as in a Gauss-Newton
step.

Confidence intervals assume the same relative scatter in all rows. If the file does not name edges,
rows count as independent. If it does, the rows of one edge share a deviation: a random effect,
whose variance is estimated by the method of Swamy and Arora (Econometrica 40, 1972). Edges also
differ in how fast they wear and how fast their load grows with wear. So the interval of the growth,
or of the exponent of wear or time, allows for any correlation of an edge's rows, however many they
are (Liang and Zeger, Biometrika 73, 1986). Readings of other edges scatter more along the curve.

``calibrate.py`` fits the laws of a material and judges them; ``prediction.py`` uses the intervals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy import optimize, special
from turning_shop import Values, WorkshopError
from turning_shop.headers import COLUMNS
from turning_shop.measurements import Measurements
from turning_shop.regression import EdgeEffect, Regression, Solution, least_squares, solve

from leaderboard.statistics import Estimate
from turning_env.scenario.power_law import PowerLaw

FACTORS = {
    "wear": ("cutting_speed", "feed", "depth_of_cut", "time", "hardness"),
    "thrust_force": ("cutting_speed", "feed", "depth_of_cut", "wear", "hardness"),
    "power": ("cutting_speed", "feed", "depth_of_cut", "wear", "hardness"),
}
"""Factors of each law, named as in ``turning_env.PowerLaw``.

A law is named after the column that it predicts.
"""
PROGRESS = ("time", "wear", "wear_growth")
"""Numbers of a law by which the response of an edge grows."""
SETTINGS = ("cutting_speed", "feed", "depth_of_cut", "hardness")
"""Factors that are equal in all readings of one edge in one bar."""
MIN_VARIATION = 1e-3
"""Variation of a factor, unexplained by other factors, from which its exponent is fitted [-]."""
TYPICAL_EDGE_SPREAD = {"wear": 0.34, "thrust_force": 0.12, "power": 0.03}
"""Log standard deviation of edges that is assumed if a sheet does not tell it [-].

Source: wear of 72 pairs of work and tool material (AIST), loads of 13 tools (Vicomtech); see
shop/docs/measured_data.md.
"""
EDGE_SPREAD_DEGREES = 5
"""Degrees of freedom of a spread of edges that is assumed, because it differs between materials.

With 5, intervals of 95 % hold 93.9 % of the readings of AIST, with a normal distribution 91.8 %
(shop/docs/measured_data.md).
"""
TYPICAL_CURVE_SPREAD = {"wear": 0.0, "thrust_force": 0.2, "power": 0.2}
"""Spread of the curves of edges that is assumed if a sheet does not tell it [-].

Source: loads of Vicomtech. That of wear is part of ``TYPICAL_EDGE_SPREAD``.
"""
TYPICAL_GROWTH = {"thrust_force": 4.0, "power": 0.8}
"""Growth that is assumed if all edges are fresh [1/mm].

Source: the 13 tools of Vicomtech (shop/docs/measured_data.md), which differ by a factor of 2.
"""
SIGNIFICANCE = 0.01
"""Probability of the F test below which rows at the same settings count as correlated [-]."""
LEVEL = 0.95  # confidence level of all intervals [-]
MIN_READING_SCATTER = 0.01
"""Lowest scatter of a reading of an edge that was not measured [-] (assumption)."""
MIN_SETTINGS = 3
"""Number of settings below which rows without names of edges do not tell how edges differ."""
MAX_LOG = 700.0
"""Largest logarithm of an end of the coefficient's interval; it keeps the end finite."""
FRESH_ONLY = "all rows are of fresh edges; the growth is that of 13 tools of Vicomtech"
NO_HARDNESS = "there is no column hardness: nominal in all rows"

Rows = NDArray[np.bool_]
"""Which rows of a sheet are meant, shape (rows,)."""


class ReadingScatter(NamedTuple):
    """The scatter of one reading of an edge that was not measured, about the law.

    The variance of its logarithm is level^2 + (curve * curve_slope)^2: see ``curve_slope``.
    """

    level: float  # standard deviation at the reference [-]
    curve: float  # standard deviation of the slopes of edges [-]
    reference: float  # wear [mm] or time [min] at which the slopes of edges have no effect
    degrees: float  # of freedom


@dataclass(frozen=True)
class Fit:
    """A fitted law; arrays have the shape (rows,)."""

    response: str  # predicted quantity, a key of ``FACTORS``
    law: PowerLaw
    estimates: dict[str, Estimate]  # the coefficient and the other fitted numbers, as in the law
    assumed: dict[str, str]  # other numbers, which are the base law's, with the reason
    # Of the coefficient's logarithm and the other fitted numbers, in the order of ``estimates``.
    covariance: Values
    reading: ReadingScatter
    factors: dict[str, Values]  # in the units of ``COLUMNS``
    measured: Values  # response in its unit
    predicted: Values  # response by the law
    lines: NDArray[np.int64]  # of the file
    edges: EdgeEffect | None  # None if they are unknown

    @property
    def terms(self) -> list[str]:
        """Fitted numbers but the coefficient: factors whose exponents they are, and wear_growth."""
        return list(self.estimates)[1:]

    @property
    def exponents(self) -> list[str]:
        """Factors whose exponents were fitted."""
        return [name for name in self.terms if name in FACTORS[self.response]]

    @property
    def has_growth(self) -> bool:
        """Whether the law has a fresh edge's share, 1 + wear_growth * wear."""
        return self.law.wear_growth > 0.0

    @property
    def fresh(self) -> Rows:
        """Rows of fresh edges, whose wear is 0."""
        if self.response == "wear":
            return np.zeros(len(self.lines), np.bool_)
        return np.asarray(self.factors["wear"] == 0.0)

    @property
    def degrees(self) -> int:
        """Degrees of freedom of the residuals: number of rows - number of fitted parameters."""
        return len(self.lines) - len(self.estimates)

    def regressors(self) -> Values:
        """Return the derivatives of log response by its fitted numbers, (rows, terms + 1)."""
        columns = [np.ones(len(self.lines))]
        columns += [regressor(self.law, name, self.factors) for name in self.terms]
        return np.column_stack(columns)

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


def regressor(law: PowerLaw, term: str, factors: Mapping[str, Values]) -> Values:
    """Return the derivative of the logarithm of a law's response by one of its numbers.

    ``term`` is a factor, for its exponent, or "wear_growth".
    """
    if term == "wear_growth":
        wear = factors["wear"]
        slope = law.wear * wear / (1.0 + law.wear_growth * wear)
        return np.asarray(slope)
    factor = factors[term]
    if term == "depth_of_cut":
        factor = factor / law.reference_depth_of_cut
    elif term == "wear":
        factor = law.wear_term(factor)
    return np.asarray(np.log(factor))


def curve_slope(law: PowerLaw, factors: Mapping[str, Values], reference: float) -> Values:
    """Return the derivative of a law's log response by what differs between the curves of edges.

    It is the logarithm of the growth with wear, or else the exponent of wear or time, whose effect
    is none at a ``reference`` wear or time.
    """
    if law.wear_growth > 0.0:
        growth = law.wear_growth * factors["wear"]
        return np.asarray(law.wear * growth / (1.0 + growth))
    name = "time" if law.time else "wear"
    return np.asarray(np.log(factors[name] / reference))


@dataclass(frozen=True)
class _Sample:
    """The rows with a response and all its factors; arrays have the shape (rows,)."""

    measured: Values
    factors: dict[str, Values]
    lines: NDArray[np.int64]
    edges: NDArray[np.int64] | None


def fit(
    response: str,
    measurements: Measurements,
    base: PowerLaw,
    given: Mapping[str, str] = MappingProxyType({}),
    edge_spread: float = 0.0,
) -> Fit:
    """Fit the law of one response to all rows with that response and all its factors.

    The law has the base's form: with a ``wear_growth``, that number is fitted in place of the
    exponent of wear. A power of the wear is fitted to the rows of worn edges. If all edges are
    fresh, the law has a typical growth.

    Without a hardness column or value, hardness is nominal. Numbers that cannot be estimated, and
    those ``given`` with the reason, are the base's. ``edge_spread`` is the log standard deviation
    of edges [-] that is assumed if the rows are of too few to tell it.

    Raises:
        WorkshopError: There are too few rows, or a fitted number is out of the law's range.
    """
    given = dict(given)
    fresh = fresh_rows(response, measurements)
    if fresh.any() and base.wear_growth == 0.0 and not worn_rows(response, measurements).any():
        base = with_growth(base, TYPICAL_GROWTH[response])
        given["wear_growth"] = FRESH_ONLY
    rows = complete_rows(response, measurements)
    if base.wear_growth == 0.0:
        rows &= ~fresh
    sample = _sample(response, measurements, rows)

    candidates = _candidates(response, base)
    if not rows.any():
        raise WorkshopError(f"{response}: {_too_few(sample, base, candidates)}")
    fitted, assumed = _identifiable(sample.factors, base, candidates=candidates, given=given)
    if "hardness" not in measurements.columns:
        assumed["hardness"] = NO_HARDNESS
    if len(sample.lines) < len(fitted) + 2:
        raise WorkshopError(f"{response}: {_too_few(sample, base, candidates)}")

    regression = _regression(sample, base, fitted)
    solved = solve(regression, sample.edges)
    names = ("coefficient", *fitted)
    numbers = dict(zip(names, solved.parameters, strict=True))
    # A coefficient that overflows is infinite, and ``validated_law`` refuses it.
    with np.errstate(over="ignore"):
        numbers["coefficient"] = np.exp(solved.parameters[0])
    law = validated_law(response, base, numbers)

    if solved.edges:
        reading = _reading_of_other_edge(law, sample, solved=solved, edges=solved.edges)
    else:
        is_assumed = tells_no_edges(measurements, sample.factors)
        if is_assumed and edge_spread > 0.0:
            solved = _of_few_edges(solved, sample, edge_spread)
        reading = _reading_if_edges_are_unknown(
            law,
            sample,
            solved=solved,
            edge_spread=edge_spread if is_assumed else 0.0,
            curve_spread=TYPICAL_CURVE_SPREAD[response] if is_assumed else 0.0,
        )
    return Fit(
        response=response,
        law=law,
        estimates=_estimates(law, names, solved),
        assumed=assumed,
        covariance=solved.covariance,
        reading=reading,
        factors=sample.factors,
        measured=sample.measured,
        predicted=np.asarray(law(**sample.factors)),
        lines=sample.lines,
        edges=solved.edges,
    )


def with_growth(law: PowerLaw, growth: float) -> PowerLaw:
    """Return a law with a fresh edge's share, which is proportional to 1 + growth * wear."""
    return law.model_copy(update={"wear": 1.0, "wear_growth": growth})


def without_growth(law: PowerLaw) -> PowerLaw:
    """Return a law that is proportional to a power of the wear, of the same exponent."""
    return law.model_copy(update={"wear_growth": 0.0})


def _sample(response: str, measurements: Measurements, rows: Rows) -> _Sample:
    """Return the rows to which the law of a response is fitted."""
    columns = measurements.columns
    factors = {}
    for name in FACTORS[response]:
        # Only hardness may be missing: it is then nominal, 1.
        known = columns[name][rows] if name in columns else np.ones(int(rows.sum()))
        factors[name] = np.nan_to_num(known, nan=1.0)
    edges = measurements.edges
    return _Sample(
        measured=columns[response][rows],
        factors=factors,
        lines=measurements.lines[rows],
        edges=None if edges is None else edges[rows],
    )


def _candidates(response: str, base: PowerLaw) -> list[str]:
    """Return the numbers of a law that may be fitted, but the coefficient; the growth is last."""
    candidates = list(FACTORS[response])
    if response != "wear" and base.wear_growth > 0.0:
        candidates.remove("wear")
        candidates.append("wear_growth")
    return candidates


def _too_few(sample: _Sample, base: PowerLaw, candidates: Sequence[str]) -> str:
    """Return the message on a sample with too few rows."""
    varying = []
    for name in candidates:
        if _variation(_log_factor(name, sample.factors, base)) >= MIN_VARIATION:
            varying.append(name)
    numbers = "the coefficient"
    if varying:
        numbers += f" and {len(varying)} exponents ({', '.join(varying)})"
    count = len(sample.lines)
    return (
        f"{count} row{'' if count == 1 else 's'} with this and all its factors, "
        f"but {len(varying) + 2} are needed: for {numbers}, and one more to estimate the scatter"
    )


def _regression(sample: _Sample, base: PowerLaw, fitted: Sequence[str]) -> Regression:
    """Return the regression of a law on the numbers that are fitted."""
    has_growth = "wear_growth" in fitted
    exponents = [name for name in fitted if name != "wear_growth"]
    # The law with the numbers that are not fitted alone.
    assumed_part = base.model_dump() | {"coefficient": 1.0} | dict.fromkeys(exponents, 0.0)
    if has_growth:
        assumed_part |= {"wear": 0.0, "wear_growth": 0.0}
    known = PowerLaw.model_validate(assumed_part)

    columns = [np.ones(len(sample.measured))]
    for name in exponents:
        columns.append(regressor(base, name, sample.factors))
    # The place of the number by which an edge's response grows, behind the coefficient.
    progress = None
    for name in PROGRESS:
        if name in fitted:
            progress = 1 + fitted.index(name)
            break
    return Regression(
        target=np.log(sample.measured) - np.log(known(**sample.factors)),
        design=np.column_stack(columns),
        wear=sample.factors["wear"] if has_growth else None,
        wear_exponent=base.wear,
        progress=progress,
    )


def _reading_of_other_edge(
    law: PowerLaw, sample: _Sample, solved: Solution, edges: EdgeEffect
) -> ReadingScatter:
    """Return the scatter of a reading of an edge that was not measured.

    Squared residuals are regressed on the squared slope of the curve, by non-negative least
    squares. Each edge counts as one, however often it was read.
    """
    reference = _curve_reference(law, sample)
    slope = curve_slope(law, sample.factors, reference)
    residual = np.log(sample.measured / law(**sample.factors))
    members = np.bincount(edges.group)
    root_weight = 1.0 / np.sqrt(members[edges.group])
    regressors = np.column_stack([np.ones(len(slope)), slope**2])
    design = regressors * root_weight[:, np.newaxis]
    target = residual**2 * root_weight
    variances = optimize.nnls(design, target)[0]
    # Each number that is estimated between edges takes one of them away.
    variances *= edges.count / edges.degrees[0]
    level, curve = np.sqrt(variances)
    return ReadingScatter(
        level=max(float(level), MIN_READING_SCATTER),
        curve=float(curve),
        reference=reference,
        degrees=_degrees_of_reading(solved.scatter**2, edges),
    )


def _of_few_edges(solved: Solution, sample: _Sample, edge_spread: float) -> Solution:
    """Return a solution whose coefficient allows for the deviation of the few edges it is from.

    Rows of one edge tell that edge's level, however many they are: the mean of n edges differs
    from the usual level by edge_spread / sqrt(n). The deviations that rows tell are scaled to the
    degrees of freedom of the assumed spread, so that both add up.
    """
    edges = 1 if sample.edges is None else len(np.unique(sample.edges))
    by_rows = special.stdtrit(solved.degrees[0], 0.5 + 0.5 * LEVEL)
    by_spread = special.stdtrit(EDGE_SPREAD_DEGREES, 0.5 + 0.5 * LEVEL)
    scale = float(by_rows / by_spread)
    covariance = solved.covariance * scale**2
    covariance[0, 0] += edge_spread**2 / edges
    return solved._replace(
        covariance=covariance,
        scatter=solved.scatter * scale,
        degrees=(EDGE_SPREAD_DEGREES,) * len(solved.degrees),
    )


def _reading_if_edges_are_unknown(
    law: PowerLaw, sample: _Sample, solved: Solution, edge_spread: float, curve_spread: float
) -> ReadingScatter:
    """Return the scatter of a reading if edges are assumed to differ as stated."""
    level = float(np.hypot(solved.scatter, edge_spread))
    return ReadingScatter(
        level=max(level, MIN_READING_SCATTER),
        curve=curve_spread,
        reference=_curve_reference(law, sample),
        degrees=float(solved.degrees[0]),
    )


def _curve_reference(law: PowerLaw, sample: _Sample) -> float:
    """Return the mean wear [mm] or time [min] of the rows, where curves of edges are compared."""
    if law.wear_growth > 0.0:
        return 1.0  # the curves of edges are compared at a wear of 0
    progress = sample.factors["time" if law.time else "wear"]
    return float(np.exp(np.log(progress).mean()))


def _degrees_of_reading(variance_within: float, edges: EdgeEffect) -> float:
    """Return the degrees of freedom of the variance of a reading of another edge.

    By Satterthwaite (Biometrics Bulletin 2, 1946), for the sum of the variances within edges and
    between them. The latter is (mean square of edges - variance within) / readings of an edge.
    """
    rows = len(edges.group)
    numbers_within = sum(edges.is_within)
    degrees_between = edges.degrees[0]
    degrees_within = max(rows - edges.count - numbers_within, 1)
    variance_between = edges.spread**2
    of_edges = variance_within / edges.readings + variance_between
    of_rows = variance_within * (1.0 - 1.0 / edges.readings)
    total = variance_within + variance_between
    between = of_edges**2 / degrees_between
    within = of_rows**2 / degrees_within
    return total**2 / (between + within)


def _estimates(law: PowerLaw, names: Sequence[str], solved: Solution) -> dict[str, Estimate]:
    """Return the numbers of a fitted law with their intervals of confidence ``LEVEL``."""
    # Student's t, as the scatter is estimated from the same rows; scipy.stats, which has a name for
    # it, takes long to import.
    quantiles = special.stdtrit(solved.degrees, 0.5 + 0.5 * LEVEL)
    deviations = np.sqrt(np.diag(solved.covariance))
    margins = deviations * quantiles
    low = solved.unbounded - margins
    high = solved.unbounded + margins
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

    Rows of fresh edges, whose wear is 0, count for force and power, and tell nothing of the law of
    wear.
    """
    complete = np.ones(len(measurements.lines), np.bool_)
    for name in (response, *FACTORS[response]):
        if name in measurements.columns:
            complete &= np.isfinite(measurements.columns[name]) | (name == "hardness")
        elif name != "hardness":
            complete[:] = False
    if response == "wear":
        # The logarithms of wear and time are fitted.
        for name in ("wear", "time"):
            if name in measurements.columns:
                complete &= measurements.columns[name] > 0.0
    return complete


def fresh_rows(response: str, measurements: Measurements) -> Rows:
    """Return which rows have a force or power of a fresh edge, whose wear is 0."""
    if response == "wear" or "wear" not in measurements.columns:
        return np.zeros(len(measurements.lines), np.bool_)
    unworn = measurements.columns["wear"] == 0.0
    return np.asarray(complete_rows(response, measurements) & unworn)


def worn_rows(response: str, measurements: Measurements) -> Rows:
    """Return which rows of ``complete_rows`` are not of fresh edges."""
    complete = complete_rows(response, measurements)
    return np.asarray(complete & ~fresh_rows(response, measurements))


def rows_correlate(fitted: Fit) -> bool:
    """Return whether rows at the same settings deviate from the law together more than by chance.

    Usually they are readings of one edge, and edges differ; otherwise no power law fits. An F test
    compares the variance of the residuals between settings with the variance within them.
    """
    residuals = fitted.log_residuals
    columns = [fitted.factors[name] for name in SETTINGS]
    settings = np.stack(columns, axis=1)
    group = np.unique(settings, axis=0, return_inverse=True)[1]
    members = np.bincount(group)
    means = np.bincount(group, residuals) / members

    # The coefficient and the exponents of settings are decided between them, the others within.
    numbers_between = 1 + sum(name in SETTINGS for name in fitted.estimates)
    numbers_within = len(fitted.estimates) - numbers_between
    degrees_between = len(members) - numbers_between
    degrees_within = len(residuals) - len(members) - numbers_within
    if degrees_between < 1 or degrees_within < 1:
        return False
    within = residuals - means[group]
    variance_within = float((within**2).sum()) / degrees_within
    if variance_within <= 0:
        return False
    variance_between = float(members @ means**2) / degrees_between
    ratio = variance_between / variance_within
    # By the F distribution.
    probability_of_larger = special.fdtrc(degrees_between, degrees_within, ratio)
    return bool(probability_of_larger < SIGNIFICANCE)


def _log_factor(term: str, factors: Mapping[str, Values], base: PowerLaw) -> Values:
    """Return the logarithm of the factor that a number of a law weighs, shape (rows,)."""
    if term == "wear_growth":
        return np.asarray(np.log1p(base.wear_growth * factors["wear"]))
    return np.asarray(np.log(factors[term]))


def _identifiable(
    factors: Mapping[str, Values],
    base: PowerLaw,
    candidates: Sequence[str],
    given: Mapping[str, str],
) -> tuple[list[str], dict[str, str]]:
    """Return the numbers of a law that can be estimated, and the reasons why others cannot.

    If factors vary only together, the first is fitted.
    """
    kept: list[str] = []
    centred: list[Values] = []  # logarithms of the kept factors, less their means
    reasons = dict(given)
    for term in candidates:
        if term in given:
            continue
        factor = "wear" if term == "wear_growth" else term
        log = _log_factor(term, factors, base)
        if _variation(log) < MIN_VARIATION:
            reasons[term] = _never_varies(factor, factors[factor])
            continue
        others = np.array(centred).reshape(len(kept), len(log)).T
        weights = least_squares(others, log - log.mean())
        if _variation(log - others @ weights) >= MIN_VARIATION:
            kept.append(term)
            centred.append(log - log.mean())
            continue
        shares = np.abs(weights) * np.ptp(others, axis=0)
        together = []
        for other, share in zip(kept, shares, strict=True):
            if share >= MIN_VARIATION:
                together.append(other)
        reasons[term] = f"{factor} varies only together with {' and '.join(together)}"
    return kept, reasons


def _never_varies(name: str, values: Values) -> str:
    unit = COLUMNS[name].unit.replace("-", "")
    number = f"{values.mean():.4g} {unit}".rstrip()
    return f"{name} never varies: {number} in all {len(values)} rows"


def _variation(log: Values) -> float:
    """Return the largest relative distance of a factor from its mean [-]; 0 without rows."""
    if not log.size:
        return 0.0
    return float(np.abs(log - log.mean()).max())


def validated_law(response: str, base: PowerLaw, numbers: dict[str, float]) -> PowerLaw:
    """Return the base law with fitted numbers; raise an error if one is out of range."""
    try:
        return PowerLaw.model_validate(base.model_dump() | numbers)
    except ValidationError as error:
        detail = error.errors()[0]
        field = detail["loc"][-1]
        number = f"exponent of {field}" if field in FACTORS[response] else str(field)
        fault = detail["msg"].removeprefix("Value error, ")
        why = "factors vary too little, rows scatter too much, or a unit is wrong"
        raise WorkshopError(f"{response}: {number}, as fitted: {fault}; {why}") from error
