"""Find implausible values in a sheet of cuts and in the laws fitted to it, and name the rows and the likely cause.

Three checks find quantities of rows and laws outside their plausible ranges; laws that fall with a factor with which they must
rise; and rows far from the law of the others.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats
from turning_shop import Values
from turning_shop.fit import SETTINGS, Fit, rows_correlate
from turning_shop.measurements import Measurements

Columns = Mapping[str, Values]

TAYLOR_EXPONENT = 0.1, 0.6  # plausible Taylor exponent n in V T^n = C [-]
POSITIVE = {  # factors with which each law must not fall
    "wear": ("cutting_speed", "feed", "depth_of_cut", "time"),
    "thrust_force": ("feed", "depth_of_cut", "wear"),
    "power": ("cutting_speed", "feed", "depth_of_cut", "wear"),
}
FEW = 0.5  # share of rows below which implausible ones count as typing errors, not as a wrong unit [-]
MAX_NAMED = 8  # number of lines that a message names
TYPICAL = {
    "cutting_speed": (130.0, 0.3),
    "feed": (0.25, 0.25),
    "depth_of_cut": (2.0, 0.35),
    "time": (8.0, 0.6),
    "wear": (0.2, 0.3),
    "energy": (2.2, 0.2),
    "thrust": (0.9, 0.4),
    "life": (15.0, 0.5),
}
"""Typical value of each quantity in rough turning and its spread in decades, to find values in a wrong unit."""
WRONG_UNITS = (  # columns that may be in a wrong unit, their factor to the right one, and the message
    (("power",), 1e-3, "power looks like W: divide by 1000"),
    (("power",), 1e3, "power looks like MW: multiply by 1000"),
    (("cutting_speed",), 60.0, "cutting_speed looks like m/s: multiply by 60"),
    (("cutting_speed",), 0.3048, "cutting_speed looks like ft/min: multiply by 0.3048"),
    (("feed",), 25.4, "feed looks like inches: multiply by 25.4"),
    (("feed",), 1e-3, "feed looks like um: divide by 1000"),
    (("depth_of_cut",), 25.4, "depth_of_cut looks like inches: multiply by 25.4"),
    (("feed", "depth_of_cut"), 25.4, "feed and depth_of_cut look like inches: multiply by 25.4"),
    (("thrust_force",), 1e3, "thrust_force looks like kN: multiply by 1000"),
    (("time",), 1 / 60, "time looks like seconds: divide by 60"),
    (("time",), 60.0, "time looks like hours: multiply by 60"),
    (("wear",), 25.4, "wear looks like inches: multiply by 25.4"),
)
SUSPECT = 3.5  # distance from the robust law, in robust standard deviations, from which a row may be an outlier [-]
OUTLIER_SIGNIFICANCE = 1e-3  # probability that a sheet without errors has an outlier in one law [-]
MIN_FAR = 0.4  # distance of logarithms below which no row is an outlier [-]: readings of real wear scatter by 0.24, edges by 0.34
SPARE_ROWS = 4  # rows beyond the fitted numbers that are needed to tell outliers
SUBSETS = 500  # random subsets of rows from which the robust fit starts


class Derived(NamedTuple):
    """A quantity that follows from the columns of a row, and its plausible range."""

    name: str  # a key of ``TYPICAL``
    meaning: str
    unit: str
    low: float
    high: float
    of: Callable[[Columns], Values]  # returns the quantity of each row; none if a column is missing

    def plausible(self, columns: Columns) -> NDArray[np.bool_]:
        """Return whether each row's quantity lies in its range or is unknown."""
        values = self.of(columns)
        return np.asarray(~((values < self.low) | (values > self.high)))


def _over(columns: Columns, above: str, *below: str) -> Values:
    """Return one column over the product of others; nothing if one is missing."""
    if not {above, *below} <= columns.keys():
        return np.empty(0)
    return np.asarray(columns[above] / np.prod([columns[name] for name in below], axis=0))


ENERGY = Derived(
    *(
        "energy",
        "specific cutting energy P/(V f d)",
        "GPa",
        0.3,
        12.0,
    ),  # aluminium to hardened steel and superalloys
    lambda columns: (
        60.0 * _over(columns, "power", "cutting_speed", "feed", "depth_of_cut")
    ),  # kW over cm3/min is 60 GPa
)
THRUST = Derived(
    *("thrust", "thrust force over f d", "GPa", 0.03, 20.0),
    lambda columns: (
        1e-3 * _over(columns, "thrust_force", "feed", "depth_of_cut")
    ),  # N/mm2 is 0.001 GPa
)


def row_problems(measurements: Measurements) -> Iterator[str]:
    """Yield messages on rows that are implausible under any law."""
    for quantity in (ENERGY, THRUST):
        yield from _problem(quantity, measurements.lines, measurements.columns)


def law_problems(fits: Mapping[str, Fit], wear_criterion: float) -> Iterator[str]:
    """Yield messages on implausible fitted laws, at a wear criterion [mm]."""
    for response, fitted in fits.items():
        known = fitted.edges is not None or not rows_correlate(
            fitted
        )  # otherwise intervals are too narrow
        for name in POSITIVE[response] if known else ():
            if (estimate := fitted.estimates.get(name)) and estimate.high < 0:
                yield f"{response}: falls with {name}: exponent {estimate.value:.3g}, {estimate.low:.3g} to {estimate.high:.3g}"
    if wear := fits.get("wear"):
        low, high = TAYLOR_EXPONENT
        if {"cutting_speed", "time"} <= wear.estimates.keys():
            taylor = wear.law.time / wear.law.cutting_speed if wear.law.cutting_speed else np.inf
            if not low <= taylor <= high:
                yield f"wear: the Taylor exponent n in V T^n = C is {taylor:.3g}, where {low:g} to {high:g} is plausible"
        if wear.law.time <= 0:
            yield f"wear: does not grow with time: exponent {wear.law.time:.3g}"
            return
        misfit = (
            wear.predicted / wear.measured
        )  # in another unit of wear, the fitted law changes with it

        def life(columns: Columns) -> Values:
            with np.errstate(over="ignore", under="ignore"):
                share = wear_criterion / (columns["wear"] * columns["misfit"])
                return np.asarray(columns["time"] * share ** (1.0 / wear.law.time))

        quantity = Derived(
            "life",
            f"tool life to {wear_criterion:g} mm at measured settings",
            "min",
            0.5,
            600.0,
            life,
        )
        doubt = f", or the assumed exponent of time, {wear.law.time:.3g}, is wrong: read the wear of an edge at several times"
        for problem in _problem(
            quantity, wear.lines, wear.factors | {"wear": wear.measured, "misfit": misfit}
        ):
            yield problem + doubt * ("time" not in wear.estimates)


def _problem(quantity: Derived, lines: NDArray[np.int64], columns: Columns) -> Iterator[str]:
    """Yield a message if a quantity of some rows lies outside its range."""
    wrong = ~quantity.plausible(columns)
    if not wrong.any():
        return
    found = quantity.of(columns)[wrong]
    least, most = f"{found.min():.3g}", f"{found.max():.3g}"
    shown = least if least == most else f"{least} to {most}"
    few = quantity.name != "life" and wrong.mean() < FEW
    cause = (
        "typing errors?"
        if few
        else _likely_unit(quantity, {name: column[wrong] for name, column in columns.items()})
    )
    yield (
        f"{quantity.meaning} is {shown} {quantity.unit} in {name_lines(lines[wrong])}, "
        f"where {quantity.low:g} to {quantity.high:g} is plausible: {cause}"
    )


def _likely_unit(quantity: Derived, columns: Columns) -> str:
    """Return the wrong unit that explains implausible rows best."""
    best, least = "check their numbers and units", _strangeness(quantity, columns)
    for names, factor, message in WRONG_UNITS:
        if set(names) <= columns.keys():
            changed = {**columns, **{name: factor * columns[name] for name in names}}
            strangeness = _strangeness(quantity, changed)
            if quantity.plausible(changed).mean() >= 0.8 and strangeness < least:
                best, least = message, strangeness
    return best


def _strangeness(quantity: Derived, columns: Columns) -> float:
    """Return the distance of rows from typical values in rough turning, summed over quantities [-]."""
    values = {**columns, **{each.name: each.of(columns) for each in (ENERGY, THRUST, quantity)}}
    total = 0.0
    for name, (typical, decades) in TYPICAL.items():
        known = values.get(name, np.empty(0))
        known = known[np.isfinite(known) & (known > 0)]
        if known.size:
            total += float(((np.log10(known / typical) / decades) ** 2).mean())
    return total


def name_lines(lines: Iterable[int]) -> str:
    """Return lines of a file for people, as ranges: "lines 2 to 9, 12"."""
    numbers = np.unique(np.fromiter(lines, int))
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    ranges = [f"{run[0]} to {run[-1]}" if len(run) > 1 else str(run[0]) for run in runs]
    return f"line{'s' * (len(numbers) > 1)} {', '.join(ranges[:MAX_NAMED])}" + (
        ", ..." if len(ranges) > MAX_NAMED else ""
    )


class RobustFit(NamedTuple):
    """A law fitted so that a few wrong rows, wherever they lie, hardly count."""

    distance: Values  # logarithm of each measured over predicted response [-], shape (rows,)
    outlying: NDArray[np.bool_]  # which rows are outliers, shape (rows,)


def robust_fit(fitted: Fit) -> RobustFit:
    """Fit a law again, by least squares with Cauchy loss from the subset of rows that suits most of the others.

    The start has a high breakdown point (least quantile of squares, Rousseeuw 1984), so that a wrong speed or feed cannot draw
    the law to its row.
    """
    residual = fitted.log_residuals
    logs = [np.log(fitted.factors[name]) for name in fitted.exponents]
    design = np.column_stack([np.ones(len(residual)), *(log - log.mean() for log in logs)])
    rows, count = design.shape
    change = np.zeros(count)
    if rows >= count + SPARE_ROWS:
        rng, quantile = np.random.default_rng(0), (rows + count + 1) // 2
        picks = [rng.choice(rows, count + 1, replace=False) for _ in range(SUBSETS)]
        starts = [
            change,
            *(np.linalg.lstsq(design[pick], residual[pick], rcond=None)[0] for pick in picks),
        ]
        medians = [
            np.partition(np.abs(residual - design @ start), quantile - 1)[quantile - 1]
            for start in starts
        ]
        start, scale = starts[int(np.argmin(medians))], max(1.4826 * float(min(medians)), 1e-9)

        def misfit(change: Values) -> Values:
            return np.asarray(residual - design @ change)

        change = optimize.least_squares(misfit, start, loss="cauchy", f_scale=scale).x
    distance = np.asarray(residual - design @ change)
    scale = 1.4826 * float(np.median(np.abs(distance))) * (1.0 + 5.0 / max(rows - count, 1))
    outlying = _outlying(residual, design, np.abs(distance) > SUSPECT * scale) & (
        np.abs(distance) > MIN_FAR
    )
    return RobustFit(distance, np.asarray(outlying))


def _outlying(residual: Values, design: Values, suspect: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which suspects lie too far from the law of the other rows for chance, by a t test of each."""
    kept = ~suspect
    degrees = int(kept.sum()) - design.shape[1]
    if degrees < SPARE_ROWS or not suspect.any():
        return np.zeros_like(suspect)
    inverse = np.linalg.pinv(design[kept])
    distance = residual - design @ (inverse @ residual[kept])
    variance = float(distance[kept] @ distance[kept]) / degrees
    leverage = ((design @ inverse) ** 2).sum(axis=1)
    limit = stats.t.isf(0.5 * OUTLIER_SIGNIFICANCE / len(residual), degrees) * np.sqrt(
        variance * (1.0 + leverage)
    )
    return np.asarray(suspect & (np.abs(distance) > limit))


def outliers(fits: Mapping[str, Fit], robust: Mapping[str, RobustFit]) -> Iterator[str]:
    """Yield a message for each row that lies far from a law, which is probably wrong."""
    wrong = {
        name: robust[name].outlying & ~_of_unusual_edge(fits[name], robust[name]) for name in fits
    }
    for line in sorted({int(line) for name in fits for line in fits[name].lines[wrong[name]]}):
        rows = {
            name: int(np.flatnonzero(fitted.lines == line)[0])
            for name, fitted in fits.items()
            if line in fitted.lines
        }
        shown = " and ".join(
            f"{name} is {_times(np.exp(robust[name].distance[row]))} the law of the other rows"
            for name, row in rows.items()
            if wrong[name][row]
        )
        yield f"line {line}: {shown}: check its numbers"


def _of_unusual_edge(fitted: Fit, robust: RobustFit) -> NDArray[np.bool_]:
    """Return the rows of edges of which most readings, and two or more, are outliers: such an edge is odd, but no typing error.

    Without names of edges, rows at the same settings count as readings of one.
    """
    settings = np.stack([fitted.factors[name] for name in SETTINGS], axis=1)
    group = (
        fitted.edges.group if fitted.edges else np.unique(settings, axis=0, return_inverse=True)[1]
    )
    found, members = np.bincount(group, robust.outlying), np.bincount(group)
    return np.asarray(((found >= 2) & (found > 0.5 * members))[group])


def unusual_edges(fits: Mapping[str, Fit], robust: Mapping[str, RobustFit]) -> Iterator[str]:
    """Yield a warning for each law from which the readings of whole edges lie far."""
    for name, fitted in fits.items():
        if (odd := robust[name].outlying & _of_unusual_edge(fitted, robust[name])).any():
            yield f"{name}: all readings of an edge lie far from the law, in {name_lines(fitted.lines[odd])}: an unusual edge?"


def _times(ratio: float) -> str:
    return f"{ratio:.3g} times" if ratio >= 0.01 else f"1/{1 / ratio:.3g} of"
