"""Find what cannot be true in a sheet of cuts and in the laws fitted to it, and name the rows and the likely cause."""

import itertools
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from turning_env.workshop.fit import SETTINGS, Fit, rows_correlate
from turning_env.workshop.measurements import COLUMNS, Measurements

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
SUSPECT = 3.5
"""Distance from the robust law, in robust standard deviations, from which a row may be an outlier [-]."""
SIGNIFICANCE = 1e-3
"""Probability that a sheet without errors has an outlier in one law [-]."""
MIN_FAR = 0.4
"""Distance of logarithms below which no row is an outlier [-]: readings of real wear scatter by 0.24, edges by 0.34."""
SPARE_ROWS = 4
"""Rows beyond the fitted numbers that are needed to tell outliers."""
FEW = 0.5
"""Share of rows below which implausible ones count as typing errors, not as a wrong unit [-]."""
SUBSETS = 500
"""Random subsets of rows from which the robust fit starts."""
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
SLIPS = (10.0, 100.0, 1000.0, 60.0, 25.4)
"""Factors by which a single cell may be wrong, or one over them."""


class RobustFit(NamedTuple):
    """A law fitted so that a few wrong rows, wherever they lie, hardly count."""

    exponents: dict[str, float]
    """By their names in ``PowerLaw``, without the coefficient."""
    distance: Values
    """Logarithm of each measured over predicted response [-], shape (rows,)."""
    scale: float
    """Robust standard deviation of ``distance`` [-]."""
    outlying: NDArray[np.bool_]
    """Which rows are outliers, shape (rows,)."""


def robust_fit(fitted: Fit) -> RobustFit:
    """Fit a law again, by least squares with Cauchy loss from the subset of rows that suits most of the others.

    The start has a high breakdown point (least quantile of squares, Rousseeuw 1984), so that a wrong speed or feed cannot draw
    the law to its row.
    """
    names = [name for name in fitted.estimates if name != "coefficient"]
    residual = np.log(fitted.measured / fitted.predicted)
    logs = np.log(np.array([fitted.factors[name] for name in names]).reshape(len(names), len(residual)).T)
    design = np.column_stack([np.ones(len(residual)), logs - logs.mean(axis=0)])
    rows, count = design.shape
    change = np.zeros(count)
    if rows >= count + SPARE_ROWS:
        rng, quantile = np.random.default_rng(0), (rows + count + 1) // 2
        picks = [rng.choice(rows, count + 1, replace=False) for _ in range(SUBSETS)]
        starts = [change, *(np.linalg.lstsq(design[pick], residual[pick], rcond=None)[0] for pick in picks)]
        medians = [np.partition(np.abs(residual - design @ start), quantile - 1)[quantile - 1] for start in starts]
        change = starts[int(np.argmin(medians))]
        scale = max(1.4826 * float(min(medians)), 1e-9)
        distance = residual - design @ change

        def loss(more: Values) -> Values:
            return np.asarray((distance - design @ more) / scale)

        change = change + optimize.least_squares(loss, np.zeros(count), loss="cauchy").x
    distance = np.asarray(residual - design @ change)
    scale = 1.4826 * float(np.median(np.abs(distance))) * (1.0 + 5.0 / max(rows - count, 1))
    outlying = _outlying(residual, design, np.abs(distance) > SUSPECT * scale) & (np.abs(distance) > MIN_FAR)
    exponents = {name: getattr(fitted.law, name) + float(slope) for name, slope in zip(names, change[1:], strict=True)}
    return RobustFit(exponents, distance, scale, np.asarray(outlying))


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
    limit = stats.t.isf(0.5 * SIGNIFICANCE / len(residual), degrees) * np.sqrt(variance * (1.0 + leverage))
    return np.asarray(suspect & (np.abs(distance) > limit))


def row_problems(measurements: Measurements) -> Iterator[str]:
    """Yield what cannot be true of rows, whatever the law."""
    for what, unit, values, (low, high) in (
        ("specific cutting energy P/(V f d)", "GPa", _energy(measurements.columns), CUTTING_ENERGY),
        ("thrust force over f d", "GPa", _thrust(measurements.columns), SPECIFIC_THRUST),
    ):
        yield from _outside(what, unit, values, low, high, measurements.lines, measurements.columns)


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
        life = tool_life(wear, wear_criterion)
        what = f"tool life to {wear_criterion:g} mm at measured settings"
        yield from _outside(
            what,
            "min",
            life,
            *TOOL_LIFE,
            wear.lines,
            wear.factors
            | {"wear": wear.measured, "life": life, "wear_power": np.full(len(life), min(1.0 / wear.law.time, 100.0))},
        )


def tool_life(wear: Fit, wear_criterion: float) -> Values:
    """Return the fitted tool life [min] at the settings of each row, to a wear criterion [mm]."""
    with np.errstate(over="ignore", under="ignore"):
        return np.asarray(wear.factors["time"] * (wear_criterion / wear.predicted) ** (1.0 / wear.law.time))


def outliers(fits: Mapping[str, Fit], robust: Mapping[str, RobustFit]) -> Iterator[str]:
    """Yield a message for each row that lies far from a law, with the cell that is probably wrong."""
    wrong = {name: robust[name].outlying & ~_of_unusual_edge(fits[name], robust[name]) for name in fits}
    lines = sorted({int(line) for name in fits for line in fits[name].lines[wrong[name]]})
    for line in lines:
        rows = {name: int(np.flatnonzero(fitted.lines == line)[0]) for name, fitted in fits.items() if line in fitted.lines}
        far = [name for name, row in rows.items() if wrong[name][row]]
        shown = " and ".join(
            f"{name} is {_times(np.exp(robust[name].distance[rows[name]]))} the law of the other rows" for name in far
        )
        yield f"line {line}: {shown}: {_slip(fits, robust, rows)}"


def _of_unusual_edge(fitted: Fit, robust: RobustFit) -> NDArray[np.bool_]:
    """Return the rows of edges of which most readings, and two or more, are outliers: such an edge is odd, but no typing error.

    Without names of edges, rows at the same settings count as readings of one.
    """
    settings = np.stack([fitted.factors[name] for name in SETTINGS], axis=1)
    group = fitted.edges.group if fitted.edges else np.unique(settings, axis=0, return_inverse=True)[1]
    found, members = np.bincount(group, robust.outlying), np.bincount(group)
    return np.asarray(((found >= 2) & (found > 0.5 * members))[group])


def unusual_edges(fits: Mapping[str, Fit], robust: Mapping[str, RobustFit]) -> Iterator[str]:
    """Yield a warning for each law from which the readings of whole edges lie far."""
    for name, fitted in fits.items():
        if (odd := robust[name].outlying & _of_unusual_edge(fitted, robust[name])).any():
            yield f"{name}: all readings of an edge lie far from the law, in {name_lines(fitted.lines[odd])}: an unusual edge?"


def _slip(fits: Mapping[str, Fit], robust: Mapping[str, RobustFit], rows: Mapping[str, int]) -> str:
    """Return which cell of a row is probably wrong, and by what factor; ``rows`` is the row's index in each law."""
    best, least = "check its numbers", np.inf
    columns = {name: (fit.measured, rows[response]) for response, fit in fits.items() if response in rows for name in (response,)}
    for response, row in rows.items():
        columns |= {name: (values, row) for name, values in fits[response].factors.items() if name not in columns}
    for (name, (values, row)), slip in itertools.product(columns.items(), (*SLIPS, *(1 / slip for slip in SLIPS))):
        others = np.delete(values, row)
        if not 0.5 * others.min() <= values[row] / slip <= 2.0 * others.max():
            continue
        distances = []
        for response, at in rows.items():
            sensitivity = 1.0 if name == response else -robust[response].exponents.get(name, 0.0)
            distances.append((robust[response].distance[at] - sensitivity * np.log(slip)) / max(robust[response].scale, 0.05))
        worst = float(np.abs(distances).max())
        if worst < min(least, SUSPECT):
            least, best = worst, f"is {name}, {values[row]:.4g} {COLUMNS[name].unit}, {_times(slip)} the true value?"
    return best


def _times(ratio: float) -> str:
    return f"{ratio:.3g} times" if ratio >= 0.01 else f"1/{1 / ratio:.3g} of"


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
    what: str, unit: str, values: Values, low: float, high: float, lines: NDArray[np.int64], columns: Mapping[str, Values]
) -> Iterator[str]:
    """Yield a message if values lie outside their plausible range."""
    wrong = (values < low) | (values > high)
    if not wrong.any():
        return
    found = values[wrong]
    least, most = f"{found.min():.3g}", f"{found.max():.3g}"
    shown = least if least == most else f"{least} to {most}"
    few = "life" not in columns and wrong.mean() < FEW
    cause = "typing errors?" if few else _likely_unit({name: column[wrong] for name, column in columns.items()}, low, high, what)
    yield f"{what} is {shown} {unit} in {name_lines(lines[wrong])}, where {low:g} to {high:g} is plausible: {cause}"


def _likely_unit(columns: dict[str, Values], low: float, high: float, what: str) -> str:
    """Return the wrong unit that explains implausible rows best."""
    best, least = "check their numbers and units", _strangeness(columns)
    for names, factor, message in WRONG_UNITS:
        if not set(names) <= columns.keys():
            continue
        changed = columns | {name: factor * columns[name] for name in names}
        if "life" in columns:
            # Life grows with the time of the readings and falls with a power of their wear.
            changed["life"] = columns["life"] * (
                factor if names == ("time",) else factor ** -float(columns["wear_power"][0]) if names == ("wear",) else 1.0
            )
            checked = changed["life"]
        else:
            checked = _energy(changed) if "energy" in what else _thrust(changed)
        plausible = float(np.mean((checked >= low) & (checked <= high)))
        if plausible >= 0.8 and (strangeness := _strangeness(changed)) < least:
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


def name_lines(lines: Iterable[int]) -> str:
    """Return lines of a file for people, as ranges: "lines 2 to 9, 12"."""
    numbers = sorted(int(line) for line in lines)
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][-1] + 1:
            ranges[-1] = [ranges[-1][0], number]
        else:
            ranges.append([number, number])
    shown = [f"{first} to {last}" if last > first else str(first) for first, last in ranges[:MAX_NAMED]]
    return f"line{'s' * (len(numbers) > 1)} {', '.join(shown)}" + (", ..." if len(ranges) > MAX_NAMED else "")
