"""All laws of a material from one table of measurements, and how far they can be trusted on a machine."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from pydantic import ValidationError

from turning_env.scenario import Scenario
from turning_env.scenario.sections import Material
from turning_env.workshop.calibration.alike import misses_together
from turning_env.workshop.calibration.columns import COLUMNS, FACTORS, CalibrationError
from turning_env.workshop.calibration.reading import Measurements, meant
from turning_env.workshop.calibration.regression import Fit, fit, rows_of

BEYOND = 0.01
"""Relative distance beyond the measured range from which a law counts as extrapolated [-]."""
WIDE = 0.5
"""Half-width of an exponent's interval above which it counts as hardly known [-]."""


@dataclass(frozen=True)
class Calibration:
    """What a table of measurements gives."""

    fits: dict[str, Fit]
    """Fitted laws, by what they predict."""
    kept: dict[str, str]
    """Laws that stay as the base has them, and why."""
    material: Material
    warnings: tuple[str, ...]
    confidence: float
    """Of all intervals [-]."""

    @property
    def wear_factor_spread(self) -> float | None:
        """How edges differ in wear, as log standard deviation [-]; None if that is not known, or beyond the scenario's range."""
        edges = self.fits["wear"].edges if "wear" in self.fits else None
        return round(edges.spread, 4) if edges and edges.spread <= 1.0 else None


def calibrate(measurements: Measurements, base: Scenario, confidence: float = 0.95, strict: bool = False) -> Calibration:
    """Fit every law that the measurements have rows for; the others, and what rows cannot tell, are the base's.

    Args:
        measurements: From ``read_measurements``.
        base: Gives the exponents that cannot be fitted, and the ranges in which the laws will be used.
        confidence: Of the intervals, above 0 and below 1.
        strict: Whether a column from which nothing can be learnt is an error.

    Raises:
        CalibrationError: no law has rows, one has too few, or what was fitted is no material.
    """
    fits: dict[str, Fit] = {}
    kept: dict[str, str] = {}
    for response in FACTORS:
        fitted = fit(response, measurements, getattr(base.material, response), confidence)
        if fitted is None:
            kept[response] = _why_no_rows(response, measurements)
        else:
            fits[response] = fitted
    if not fits:
        raise CalibrationError("no law can be fitted: " + "; ".join(f"{name}: {why}" for name, why in kept.items()))
    if strict:
        _check_all_of_use(fits, kept, measurements)
    laws = {name: fitted.law.model_dump() for name, fitted in fits.items()}
    try:
        material = Material.model_validate(base.material.model_dump() | laws)
    except ValidationError as error:
        message = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise CalibrationError(f"the fitted laws are no material: {message}") from error
    return Calibration(fits, kept, material, tuple(_warnings(fits, measurements, base)), confidence)


def _why_no_rows(response: str, measurements: Measurements) -> str:
    absent = _absent(response, measurements)
    needed = [name for name in (response, *FACTORS[response]) if name != "hardness"]
    return f"there is no column {', '.join(absent)}" if absent else f"no row has all of {', '.join(needed)}"


def _absent(response: str, measurements: Measurements) -> list[str]:
    """Columns that a law needs and the file does not have."""
    needed = (response, *FACTORS[response])
    return [name for name in needed if name not in measurements.columns and name != "hardness"]


def _check_all_of_use(fits: dict[str, Fit], kept: dict[str, str], measurements: Measurements) -> None:
    wrong = [f"{name}: {why}" for name, why in kept.items() if not _absent(name, measurements)]
    for name, fitted in fits.items():
        wrong += [f"{name}: {why}" for factor, why in fitted.assumed.items() if factor in measurements.columns]
    if wrong:
        raise CalibrationError("not all can be fitted, as --strict demands: " + "; ".join(wrong))


def _warnings(fits: dict[str, Fit], measurements: Measurements, base: Scenario) -> Iterator[str]:
    for name in measurements.ignored:
        likely = meant(name)
        yield f"column {name!r} is not understood and was ignored" + (f"; is it {likely}?" if likely else "")
    unused = ~np.logical_or.reduce([rows_of(response, measurements) for response in FACTORS])
    if unused.any():
        yield f"{unused.sum()} rows have too many empty cells for any law, the first in line {measurements.lines[unused][0]}"
    nominal = int(np.isnan(measurements.columns.get("hardness", np.ones(1))).sum())
    if nominal:
        yield f"hardness is empty in {nominal} rows, where it was taken as nominal, 1"
    for response, fitted in fits.items():
        if fitted.edges is None and measurements.edges is not None:
            yield f"{response}: too few edges or readings to tell how edges differ: rows were taken as independent"
        if fitted.edges is None and misses_together(fitted):
            yield (
                f"{response}: rows of the same settings lie off together, so intervals are too narrow: "
                "name edges in a column 'edge'; or no power law fits"
            )
        for name, estimate in fitted.estimates.items():
            half = 0.5 * (estimate.high - estimate.low)
            if name != "coefficient" and half > WIDE:
                known = f"{estimate.value:.3g} +- {half:.2g}"
                yield f"{response}: the exponent of {name} is hardly known, {known}: vary it more, or read more edges"
    yield from _extrapolated(fits, base)


def _extrapolated(fits: dict[str, Fit], base: Scenario) -> Iterator[str]:
    """Where the base scenario will use laws outside of what they were fitted to."""
    machine, depths = base.machine, base.workpiece.depth_profile or (base.workpiece.depth_of_cut,)
    used = {
        "cutting_speed": (machine.cutting_speed_min, machine.cutting_speed_max),
        "feed": (machine.feed_min, machine.feed_max),
        "depth_of_cut": (min(depths), max(depths)),
        "wear": (None, base.tool.wear_criterion),
    }
    laws: dict[str, list[str]] = {}
    for response, fitted in fits.items():
        for name, values in (fitted.factors | {response: fitted.measured}).items():
            low, high = used.get(name, (None, 0.0))
            least, most = values.min(), values.max()
            if (low is not None and low < least * (1 - BEYOND)) or high > most * (1 + BEYOND):
                asked = f"up to {high:g}" if low is None else f"{high:g}" if low == high else f"{low:g} to {high:g}"
                measured = f"{least:.4g}" if least == most else f"{least:.4g} to {most:.4g}"
                laws.setdefault(f"{name} of {asked} {COLUMNS[name].unit}, but measured at {measured}", []).append(response)
    for what, responses in laws.items():
        yield f"{', '.join(responses)}: extrapolated, used at a {what}"
