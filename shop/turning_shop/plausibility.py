"""Find implausible values in a sheet of cuts and in its laws; name the rows and the likely cause.

Three checks find quantities of rows and laws outside their plausible ranges, laws that fall with a
factor with which they must rise, and rows far from the law of the others. ``measurements.py`` has
already refused single numbers outside their columns' ranges.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special
from turning_shop import Values
from turning_shop.fit import SETTINGS, Fit, rows_correlate
from turning_shop.measurements import Measurements

Columns = Mapping[str, Values]

MIN_TAYLOR, MAX_TAYLOR = 0.1, 0.6
"""Plausible range of the Taylor exponent n in V T^n = C [-]."""
RISING = {
    "wear": ("cutting_speed", "feed", "depth_of_cut", "time"),
    "thrust_force": ("feed", "depth_of_cut", "wear"),
    "power": ("cutting_speed", "feed", "depth_of_cut", "wear"),
}
"""Factors with which each law must not fall."""
FEW = 0.5
"""Share of rows below which implausible ones count as typing errors, not as a wrong unit [-]."""
MIN_EXPLAINED = 0.8
"""Share of implausible rows that a wrong unit must make plausible to be named [-]."""
MAX_NAMED = 8  # number of ranges of lines that a message names


class Typical(NamedTuple):
    """The typical value of a quantity in rough turning."""

    value: float
    decades: float  # spread


TYPICAL = {
    "cutting_speed": Typical(130.0, decades=0.3),
    "feed": Typical(0.25, decades=0.25),
    "depth_of_cut": Typical(2.0, decades=0.35),
    "time": Typical(8.0, decades=0.6),
    "wear": Typical(0.2, decades=0.3),
    "energy": Typical(2.2, decades=0.2),
    "thrust": Typical(0.9, decades=0.4),
    "life": Typical(15.0, decades=0.5),
}
"""Typical values, to find those in a wrong unit; in the units of ``COLUMNS`` and ``Derived``."""


class WrongUnit(NamedTuple):
    """Columns that may be in a wrong unit."""

    columns: tuple[str, ...]
    factor: float  # to the right unit
    message: str


WRONG_UNITS = (
    WrongUnit(("power",), 1e-3, "power looks like W: divide by 1000"),
    WrongUnit(("power",), 1e3, "power looks like MW: multiply by 1000"),
    WrongUnit(("cutting_speed",), 60.0, "cutting_speed looks like m/s: multiply by 60"),
    WrongUnit(("cutting_speed",), 0.3048, "cutting_speed looks like ft/min: multiply by 0.3048"),
    WrongUnit(("feed",), 25.4, "feed looks like inches: multiply by 25.4"),
    WrongUnit(("feed",), 1e-3, "feed looks like um: divide by 1000"),
    WrongUnit(("depth_of_cut",), 25.4, "depth_of_cut looks like inches: multiply by 25.4"),
    WrongUnit(
        ("feed", "depth_of_cut"), 25.4, "feed and depth_of_cut look like inches: multiply by 25.4"
    ),
    WrongUnit(("thrust_force",), 1e3, "thrust_force looks like kN: multiply by 1000"),
    WrongUnit(("time",), 1 / 60, "time looks like seconds: divide by 60"),
    WrongUnit(("time",), 60.0, "time looks like hours: multiply by 60"),
    WrongUnit(("wear",), 25.4, "wear looks like inches: multiply by 25.4"),
)
SUSPECT = 3.5
"""Distance from the robust law, in robust standard deviations, from which a row is suspect [-]."""
OUTLIER_SIGNIFICANCE = 1e-3
"""Probability that a sheet without errors has an outlier in one law [-]."""
MIN_FAR = 0.4
"""Distance of logarithms below which no row is an outlier [-].

Readings of real wear scatter by 0.24, edges by 0.34.
"""
SPARE_ROWS = 4  # rows beyond the fitted numbers that are needed to tell outliers
SUBSETS = 500  # random subsets of rows from which the robust fit starts
SIGMA_PER_MEDIAN = 1.4826
"""Standard deviation over the median absolute deviation, of a normal distribution [-]."""


class Derived(NamedTuple):
    """A quantity that follows from the columns of a row, and its plausible range."""

    name: str  # a key of ``TYPICAL``
    meaning: str
    unit: str
    low: float
    high: float
    of: Callable[[Columns], Values]  # returns each row's quantity; none if a column is missing

    def plausible(self, columns: Columns) -> NDArray[np.bool_]:
        """Return whether each row's quantity lies in its range or is unknown."""
        values = self.of(columns)
        return np.asarray(~((values < self.low) | (values > self.high)))


def _cutting_energy(columns: Columns) -> Values:
    """Return P / (V f d) of each row; a power of 1 kW over 1 cm3/min is 60 GPa."""
    return 60.0 * _over(columns, "power", ("cutting_speed", "feed", "depth_of_cut"))


def _thrust_per_area(columns: Columns) -> Values:
    """Return F / (f d) of each row; 1 N/mm2 is 0.001 GPa."""
    return 1e-3 * _over(columns, "thrust_force", ("feed", "depth_of_cut"))


def _over(columns: Columns, dividend: str, divisors: Sequence[str]) -> Values:
    """Return one column over the product of others; nothing if one is missing."""
    if not {dividend, *divisors} <= columns.keys():
        return np.empty(0)
    product = np.prod([columns[name] for name in divisors], axis=0)
    return np.asarray(columns[dividend] / product)


ENERGY = Derived(
    name="energy",
    meaning="specific cutting energy P/(V f d)",
    unit="GPa",
    # From aluminium to hardened steel and superalloys.
    low=0.3,
    high=12.0,
    of=_cutting_energy,
)
THRUST = Derived(
    name="thrust",
    meaning="thrust force over f d",
    unit="GPa",
    low=0.03,
    high=20.0,
    of=_thrust_per_area,
)


def row_problems(measurements: Measurements) -> Iterator[str]:
    """Yield messages on rows that are implausible under any law."""
    for quantity in (ENERGY, THRUST):
        problem = _problem(quantity, measurements.lines, measurements.columns)
        if problem:
            yield problem


def law_problems(fits: Mapping[str, Fit], wear_criterion: float) -> Iterator[str]:
    """Yield messages on implausible fitted laws, at a wear criterion [mm]."""
    for response, fitted in fits.items():
        # If rows correlate, intervals are too narrow to tell that a law falls.
        if fitted.edges is None and rows_correlate(fitted):
            continue
        for name in RISING[response]:
            is_growth = name == "wear" and fitted.has_growth
            term = "wear_growth" if is_growth else name
            estimate = fitted.estimates.get(term)
            if estimate and estimate.high < 0:
                interval = f"{estimate.low:.3g} to {estimate.high:.3g}"
                number = f"exponent {estimate.value:.3g}"
                if is_growth:
                    number = term
                yield f"{response}: falls with {name}: {number}, {interval}"
    if "wear" in fits:
        yield from _wear_law_problems(fits["wear"], wear_criterion)


def _wear_law_problems(fitted: Fit, wear_criterion: float) -> Iterator[str]:
    """Yield messages on an implausible law of wear, at a wear criterion [mm]."""
    law = fitted.law
    if {"cutting_speed", "time"} <= fitted.estimates.keys():
        # Wear c V^a t^g is constant on V t^(g / a) = constant, Taylor's equation.
        taylor = law.time / law.cutting_speed if law.cutting_speed else np.inf
        if not MIN_TAYLOR <= taylor <= MAX_TAYLOR:
            yield (
                f"wear: the Taylor exponent n in V T^n = C is {taylor:.3g}, "
                f"where {MIN_TAYLOR:g} to {MAX_TAYLOR:g} is plausible"
            )
    if law.time <= 0:
        yield f"wear: does not grow with time: exponent {law.time:.3g}"
        return

    def life(columns: Columns) -> Values:
        """Return the time at which the law reaches the criterion, through each row's own wear."""
        with np.errstate(over="ignore", under="ignore"):
            share = wear_criterion / (columns["wear"] * columns["misfit"])
            return np.asarray(columns["time"] * share ** (1.0 / law.time))

    quantity = Derived(
        name="life",
        meaning=f"tool life to {wear_criterion:g} mm at measured settings",
        unit="min",
        low=0.5,
        high=600.0,
        of=life,
    )
    # In another unit of wear, the fitted law changes with it, and this ratio does not.
    misfit = fitted.predicted / fitted.measured
    columns = fitted.factors | {"wear": fitted.measured, "misfit": misfit}
    problem = _problem(quantity, fitted.lines, columns)
    if not problem:
        return
    if "time" not in fitted.estimates:
        problem += (
            f", or the assumed exponent of time, {law.time:.3g}, is wrong: "
            "read the wear of an edge at several times"
        )
    yield problem


def _problem(quantity: Derived, lines: NDArray[np.int64], columns: Columns) -> str:
    """Return a message if a quantity of some rows lies outside its range; otherwise nothing."""
    wrong = ~quantity.plausible(columns)
    if not wrong.any():
        return ""
    values = quantity.of(columns)[wrong]
    lowest = f"{values.min():.3g}"
    highest = f"{values.max():.3g}"
    shown = lowest if lowest == highest else f"{lowest} to {highest}"
    # An implausible life is not a typing error of some rows: it follows from the law of all.
    if quantity.name != "life" and wrong.mean() < FEW:
        cause = "typing errors?"
    else:
        wrong_rows = {name: values[wrong] for name, values in columns.items()}
        cause = _likely_unit(quantity, wrong_rows)
    return (
        f"{quantity.meaning} is {shown} {quantity.unit} in {name_lines(lines[wrong])}, "
        f"where {quantity.low:g} to {quantity.high:g} is plausible: {cause}"
    )


def _likely_unit(quantity: Derived, columns: Columns) -> str:
    """Return the message on the wrong unit that explains implausible rows best."""
    message = "check their numbers and units"
    lowest = _strangeness(quantity, columns)
    for unit in WRONG_UNITS:
        if not set(unit.columns) <= columns.keys():
            continue
        changed = dict(columns)
        for name in unit.columns:
            changed[name] = unit.factor * columns[name]
        strangeness = _strangeness(quantity, changed)
        explained = quantity.plausible(changed).mean()
        if explained >= MIN_EXPLAINED and strangeness < lowest:
            message = unit.message
            lowest = strangeness
    return message


def _strangeness(quantity: Derived, columns: Columns) -> float:
    """Return the distance of rows from typical values in rough turning, summed over quantities [-].

    It is the mean square of log10(value / typical value) / decades of each quantity.
    """
    values = dict(columns)
    for derived in (ENERGY, THRUST, quantity):
        values[derived.name] = derived.of(columns)
    total = 0.0
    for name, typical in TYPICAL.items():
        known = values.get(name, np.empty(0))
        known = known[np.isfinite(known) & (known > 0)]
        if known.size:
            distance = np.log10(known / typical.value) / typical.decades
            total += float((distance**2).mean())
    return total


def name_lines(lines: Iterable[int]) -> str:
    """Return lines of a file for people, as ranges: "lines 2 to 9, 12"."""
    numbers = np.unique(np.fromiter(lines, int))
    gaps = np.flatnonzero(np.diff(numbers) > 1)
    ranges = []
    for run in np.split(numbers, gaps + 1):
        if len(run) > 1:
            ranges.append(f"{run[0]} to {run[-1]}")
        else:
            ranges.append(str(run[0]))
    named = ", ".join(ranges[:MAX_NAMED])
    if len(ranges) > MAX_NAMED:
        named += ", ..."
    word = "lines" if len(numbers) > 1 else "line"
    return f"{word} {named}"


class RobustFit(NamedTuple):
    """A law fitted so that a few wrong rows, wherever they lie, hardly count."""

    distance: Values  # logarithm of each measured over predicted response [-], shape (rows,)
    outlying: NDArray[np.bool_]  # which rows are outliers, shape (rows,)


def robust_fit(fitted: Fit) -> RobustFit:
    """Fit a law again, by least squares with Cauchy loss.

    The start is the subset of rows whose law suits most of the others. It has a high breakdown
    point (least quantile of squares, Rousseeuw 1984), so that a wrong speed or feed cannot draw the
    law to its row.
    """
    residual = fitted.log_residuals
    design = fitted.regressors()
    design[:, 1:] -= design[:, 1:].mean(axis=0)
    rows, count = design.shape
    change = np.zeros(count)  # of the law's parameters
    if rows >= count + SPARE_ROWS:
        change = _robust_change(residual, design)
    distance = np.asarray(residual - design @ change)
    size = np.abs(distance)
    # The median is small in small samples; 1 + 5 / (n - p) corrects it (Rousseeuw and Leroy 1987).
    median = float(np.median(size))
    correction = 1.0 + 5.0 / max(rows - count, 1)
    scale = SIGMA_PER_MEDIAN * median * correction
    suspect = size > SUSPECT * scale
    outlying = _outlying(residual, design, suspect) & (size > MIN_FAR)
    return RobustFit(distance, np.asarray(outlying))


def _robust_change(residual: Values, design: Values) -> Values:
    """Return the robust regression of residuals (rows,) on a design (rows, parameters)."""
    rows, count = design.shape
    rng = np.random.default_rng(0)
    # The quantile of least squares with the highest breakdown point.
    quantile = (rows + count + 1) // 2
    starts = [np.zeros(count)]
    for _ in range(SUBSETS):
        pick = rng.choice(rows, count + 1, replace=False)
        solution, *_ = np.linalg.lstsq(design[pick], residual[pick], rcond=None)
        starts.append(solution)
    medians = []
    for start in starts:
        distance = np.abs(residual - design @ start)
        ordered = np.partition(distance, quantile - 1)
        medians.append(ordered[quantile - 1])
    start = starts[int(np.argmin(medians))]
    # A scale of 0, if rows fit exactly, has no loss.
    scale = max(SIGMA_PER_MEDIAN * float(min(medians)), 1e-9)

    def misfit(change: Values) -> Values:
        return np.asarray(residual - design @ change)

    return optimize.least_squares(misfit, start, loss="cauchy", f_scale=scale).x


def _outlying(residual: Values, design: Values, suspect: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which suspects lie too far from the law of the other rows for chance.

    Each is tested against Student's t with the variance of a new row, s^2 (1 + x (X'X)^-1 x'). The
    level is shared by all rows (Bonferroni).
    """
    kept = ~suspect
    degrees = int(kept.sum()) - design.shape[1]
    if degrees < SPARE_ROWS or not suspect.any():
        return np.zeros_like(suspect)
    inverse = np.linalg.pinv(design[kept])
    change = inverse @ residual[kept]
    distance = residual - design @ change
    kept_distance = distance[kept]
    variance = float(kept_distance @ kept_distance) / degrees
    leverage = ((design @ inverse) ** 2).sum(axis=1)
    new_row_variance = variance * (1.0 + leverage)
    # Of Student's t.
    level = 0.5 * OUTLIER_SIGNIFICANCE / len(residual)
    quantile = -special.stdtrit(degrees, level)
    limit = quantile * np.sqrt(new_row_variance)
    is_far = np.abs(distance) > limit
    return np.asarray(suspect & is_far)


def outliers(fits: Mapping[str, Fit], robust: Mapping[str, RobustFit]) -> Iterator[str]:
    """Yield a message for each row that lies far from a law, which is probably wrong.

    ``robust`` holds the laws whose form fits.
    """
    faults_by_line: dict[int, list[str]] = {}
    for name, law in robust.items():
        fitted = fits[name]
        usual_edge = ~_of_unusual_edge(fitted, law)
        wrong = law.outlying & usual_edge & _far_from_edge(fitted, law)
        for row in np.flatnonzero(wrong):
            ratio = _times(np.exp(law.distance[row]))
            line = int(fitted.lines[row])
            faults = faults_by_line.setdefault(line, [])
            faults.append(f"{name} is {ratio} the law of the other rows")
    for line in sorted(faults_by_line):
        listed = " and ".join(faults_by_line[line])
        yield f"line {line}: {listed}: check its numbers"


def _of_unusual_edge(fitted: Fit, robust: RobustFit) -> NDArray[np.bool_]:
    """Return the rows of edges of which most readings, and two or more, are outliers.

    Such an edge is odd, but no typing error.
    """
    group = _edge_of_rows(fitted)
    outlying = np.bincount(group, robust.outlying)
    members = np.bincount(group)
    unusual = (outlying >= 2) & (outlying > 0.5 * members)
    return np.asarray(unusual[group])


def _far_from_edge(fitted: Fit, robust: RobustFit) -> NDArray[np.bool_]:
    """Return which rows lie far from the other readings of their edge, where it has two or more.

    If a whole edge lies off the law, its form in speed, feed or depth may be wrong, or the edge
    odd; a typing error is in one row.
    """
    group = _edge_of_rows(fitted)
    distance = robust.distance
    far = np.ones(len(group), np.bool_)
    for row in np.flatnonzero(robust.outlying):
        of_edge = distance[group == group[row]]
        if len(of_edge) > 2:
            from_edge = abs(distance[row] - np.median(of_edge))
            far[row] = from_edge > MIN_FAR
    return far


def _edge_of_rows(fitted: Fit) -> NDArray[np.int64]:
    """Return the number of each row's edge; without names, rows at the same settings have one."""
    if fitted.edges:
        return fitted.edges.group
    settings = np.stack([fitted.factors[name] for name in SETTINGS], axis=1)
    return np.asarray(np.unique(settings, axis=0, return_inverse=True)[1])


def unusual_edges(fits: Mapping[str, Fit], robust: Mapping[str, RobustFit]) -> Iterator[str]:
    """Yield a warning for each law from which the readings of whole edges lie far."""
    for name, law in robust.items():
        fitted = fits[name]
        odd = law.outlying & _of_unusual_edge(fitted, law)
        if odd.any():
            lines = name_lines(fitted.lines[odd])
            fault = f"all readings of an edge lie far from the law, in {lines}"
            yield f"{name}: {fault}: an unusual edge?"


def _times(ratio: float) -> str:
    return f"{ratio:.3g} times" if ratio >= 0.01 else f"1/{1 / ratio:.3g} of"
