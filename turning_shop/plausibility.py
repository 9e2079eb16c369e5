"""Find what cannot be true in a sheet of cuts and in the laws fitted to it, and name the rows and the likely cause."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from turning_shop.fit import Fit, rows_correlate
from turning_shop.measurements import Measurements
from turning_shop.outliers import name_lines

Values = NDArray[np.float64]

CUTTING_ENERGY = 0.3, 12.0
"""Plausible specific cutting energy P / (V f d) [GPa]: aluminium to hardened steel and superalloys at thin chips."""
SPECIFIC_THRUST = 0.03, 20.0
"""Plausible thrust force over the chip's cross-section F / (f d) [GPa]."""
TAYLOR_EXPONENT = 0.1, 0.6
"""Plausible Taylor exponent n in V T^n = C [-]."""
TOOL_LIFE = 0.5, 600.0
"""Plausible tool life at measured settings [min]."""
POSITIVE = {
    "wear": ("cutting_speed", "feed", "depth_of_cut", "time"),
    "thrust_force": ("feed", "depth_of_cut", "wear"),
    "power": ("cutting_speed", "feed", "depth_of_cut", "wear"),
}
"""Factors with which each law must not fall."""
FEW = 0.5
"""Share of rows below which implausible ones count as typing errors, not as a wrong unit [-]."""
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


def row_problems(measurements: Measurements) -> Iterator[str]:
    """Yield what cannot be true of rows, whatever the law."""
    lines, columns = measurements.lines, measurements.columns
    yield from _outside("specific cutting energy P/(V f d)", "energy", "GPa", _energy, CUTTING_ENERGY, lines, columns)
    yield from _outside("thrust force over f d", "thrust", "GPa", _thrust, SPECIFIC_THRUST, lines, columns)


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
        what = f"tool life to {wear_criterion:g} mm at measured settings"
        columns = wear.factors | {"wear": wear.measured, "misfit": wear.predicted / wear.measured}

        def life(columns: Mapping[str, Values]) -> Values:
            """Return the tool life of each row [min]; in another unit of wear, the fitted law changes with it."""
            return tool_life(wear.law.time, wear_criterion, columns["time"], columns["wear"] * columns["misfit"])

        yield from _outside(what, "life", "min", life, TOOL_LIFE, wear.lines, columns)


def tool_life(exponent: float, wear_criterion: float, time: Values, wear: Values) -> Values:
    """Return the time to a wear criterion [mm] if ``time`` [min] leads to ``wear`` [mm], which grows with time ** exponent."""
    with np.errstate(over="ignore", under="ignore"):
        return np.asarray(time * (wear_criterion / wear) ** (1.0 / exponent))


def _energy(columns: Mapping[str, Values]) -> Values:
    """Return the specific cutting energy of each row [GPa]; kW over cm3/min is 60 GPa."""
    return 60.0 * _over(columns, "power", "cutting_speed", "feed", "depth_of_cut")


def _thrust(columns: Mapping[str, Values]) -> Values:
    """Return the thrust force over the chip's cross-section of each row [GPa]; N/mm2 is 0.001 GPa."""
    return 1e-3 * _over(columns, "thrust_force", "feed", "depth_of_cut")


def _over(columns: Mapping[str, Values], above: str, *below: str) -> Values:
    """Return one column over the product of others; nothing if one is missing."""
    if not {above, *below} <= columns.keys():
        return np.empty(0)
    return np.asarray(columns[above] / np.prod([columns[name] for name in below], axis=0))


def _outside(
    what: str,
    name: str,
    unit: str,
    of: Callable[[Mapping[str, Values]], Values],
    limits: tuple[float, float],
    lines: NDArray[np.int64],
    columns: Mapping[str, Values],
) -> Iterator[str]:
    """Yield a message if a quantity of the rows, ``of(columns)``, lies outside its range; ``name`` is in ``TYPICAL``."""
    values, (low, high) = of(columns), limits
    wrong = (values < low) | (values > high)
    if not wrong.any():
        return
    found = values[wrong]
    least, most = f"{found.min():.3g}", f"{found.max():.3g}"
    shown = least if least == most else f"{least} to {most}"
    few = name != "life" and wrong.mean() < FEW
    rows = {each: column[wrong] for each, column in columns.items()}
    cause = "typing errors?" if few else _likely_unit(rows, name, of, limits)
    yield f"{what} is {shown} {unit} in {name_lines(lines[wrong])}, where {low:g} to {high:g} is plausible: {cause}"


def _likely_unit(
    columns: Mapping[str, Values], name: str, of: Callable[[Mapping[str, Values]], Values], limits: tuple[float, float]
) -> str:
    """Return the wrong unit that explains implausible rows best."""
    best, least = "check their numbers and units", _strangeness({**columns, name: of(columns)})
    for names, factor, message in WRONG_UNITS:
        if set(names) <= columns.keys():
            changed = {**columns, **{each: factor * columns[each] for each in names}}
            values = of(changed)
            strangeness = _strangeness({**changed, name: values})
            if np.mean((values >= limits[0]) & (values <= limits[1])) >= 0.8 and strangeness < least:
                best, least = message, strangeness
    return best


def _strangeness(columns: Mapping[str, Values]) -> float:
    """Return how far rows lie from what is usual in rough turning, summed over quantities [-]."""
    values = {"energy": _energy(columns), "thrust": _thrust(columns), **columns}
    total = 0.0
    for name, (typical, decades) in TYPICAL.items():
        known = values.get(name, np.empty(0))
        known = known[np.isfinite(known) & (known > 0)]
        if known.size:
            total += float(((np.log10(known / typical) / decades) ** 2).mean())
    return total
