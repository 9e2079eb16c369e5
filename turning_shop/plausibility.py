"""Find what cannot be true in a sheet of cuts and in the laws fitted to it, and name the rows and the likely cause."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turning_shop.fit import Fit, rows_correlate
from turning_shop.measurements import Measurements

Values = NDArray[np.float64]
Columns = Mapping[str, Values]

TAYLOR_EXPONENT = 0.1, 0.6
"""Plausible Taylor exponent n in V T^n = C [-]."""
POSITIVE = {
    "wear": ("cutting_speed", "feed", "depth_of_cut", "time"),
    "thrust_force": ("feed", "depth_of_cut", "wear"),
    "power": ("cutting_speed", "feed", "depth_of_cut", "wear"),
}
"""Factors with which each law must not fall."""
FEW = 0.5
"""Share of rows below which implausible ones count as typing errors, not as a wrong unit [-]."""
MAX_NAMED = 8
"""Number of lines that a message names."""
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
"""Typical value of each quantity in rough turning and its spread in decades, to tell apart what may be in a wrong unit."""
WRONG_UNITS = (
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
"""Columns that may be in a wrong unit, their factor to the right one, and the message."""


class Derived(NamedTuple):
    """A quantity that follows from the columns of a row, and its plausible range."""

    name: str
    """A key of ``TYPICAL``."""
    meaning: str
    unit: str
    low: float
    high: float
    of: Callable[[Columns], Values]
    """Returns the quantity of each row; none if a column is missing."""

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
    *("energy", "specific cutting energy P/(V f d)", "GPa", 0.3, 12.0),  # aluminium to hardened steel and superalloys
    lambda columns: 60.0 * _over(columns, "power", "cutting_speed", "feed", "depth_of_cut"),  # kW over cm3/min is 60 GPa
)
THRUST = Derived(
    *("thrust", "thrust force over f d", "GPa", 0.03, 20.0),
    lambda columns: 1e-3 * _over(columns, "thrust_force", "feed", "depth_of_cut"),  # N/mm2 is 0.001 GPa
)


def row_problems(measurements: Measurements) -> Iterator[str]:
    """Yield what cannot be true of rows, whatever the law."""
    for quantity in (ENERGY, THRUST):
        yield from _problem(quantity, measurements.lines, measurements.columns)


def law_problems(fits: Mapping[str, Fit], wear_criterion: float) -> Iterator[str]:
    """Yield what cannot be true of the fitted laws, at a wear criterion [mm]."""
    for response, fitted in fits.items():
        known = fitted.edges is not None or not rows_correlate(fitted)  # otherwise intervals are too narrow
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
        misfit = wear.predicted / wear.measured  # in another unit of wear, the fitted law changes with it

        def life(columns: Columns) -> Values:
            with np.errstate(over="ignore", under="ignore"):
                share = wear_criterion / (columns["wear"] * columns["misfit"])
                return np.asarray(columns["time"] * share ** (1.0 / wear.law.time))

        quantity = Derived("life", f"tool life to {wear_criterion:g} mm at measured settings", "min", 0.5, 600.0, life)
        yield from _problem(quantity, wear.lines, wear.factors | {"wear": wear.measured, "misfit": misfit})


def _problem(quantity: Derived, lines: NDArray[np.int64], columns: Columns) -> Iterator[str]:
    """Yield a message if a quantity of some rows lies outside its range."""
    wrong = ~quantity.plausible(columns)
    if not wrong.any():
        return
    found = quantity.of(columns)[wrong]
    least, most = f"{found.min():.3g}", f"{found.max():.3g}"
    shown = least if least == most else f"{least} to {most}"
    few = quantity.name != "life" and wrong.mean() < FEW
    cause = "typing errors?" if few else _likely_unit(quantity, {name: column[wrong] for name, column in columns.items()})
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
    """Return how far rows lie from what is usual in rough turning, summed over quantities [-]."""
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
    return f"line{'s' * (len(numbers) > 1)} {', '.join(ranges[:MAX_NAMED])}" + (", ..." if len(ranges) > MAX_NAMED else "")
