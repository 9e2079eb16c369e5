"""Calibrate a material: fit its laws to measured cuts, report the uncertainty, write a scenario.

The command is ``python -m turning_shop calibrate``; shop/docs/your_own_machine.md is the tutorial.
``fit.py`` fits one law, and ``plausibility.py`` judges rows and laws.
"""

import difflib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray
from pydantic import ValidationError
from turning_shop import WorkshopError
from turning_shop.copies import ROUNDING, without_copies
from turning_shop.fit import (
    FACTORS,
    TYPICAL_EDGE_SPREAD,
    Fit,
    complete_rows,
    fit,
    rows_correlate,
    tells_no_edges,
    validated_law,
)
from turning_shop.form import FormChoice, choose_form, misfit
from turning_shop.headers import COLUMNS
from turning_shop.measurements import Measurements
from turning_shop.plausibility import (
    law_problems,
    name_lines,
    outliers,
    robust_fit,
    row_problems,
    unusual_edges,
)
from turning_shop.prediction import Evidence, evidence_of, read_evidence
from turning_shop.provenance import CATALOGUE, TAYLOR, is_papers, stated_by
from turning_shop.whatif import NO_LIMIT

from leaderboard.statistics import Estimate
from turning_env.files import replace_file
from turning_env.scenario import Scenario, presets
from turning_env.scenario.power_law import PowerLaw
from turning_env.scenario.scenario import name_of_file
from turning_env.scenario.sections import Material

VAGUE = 1.0
"""Half-width of the interval of the wear law's exponent of speed above which catalogues count [-].

The exponent of catalogues is then taken if it lies within the interval.
"""
WIDE = 0.5
"""Half-width of an exponent's interval above which a warning calls it hardly known [-]."""
MAX_SPREAD = 1.0  # largest log standard deviation of edges that a scenario may have [-]
MAX_IGNORED = 8  # number of ignored columns that a warning names
MIN_LIKENESS = 0.75  # of a column's name and an unknown header, from which a warning asks [-]


class ImplausibleError(WorkshopError):
    """Implausible measurements or laws; the message names the rows and the likely cause."""

    def __init__(self, problems: Sequence[str]):
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


@dataclass(frozen=True)
class Calibration:
    """A material with laws fitted to measurements."""

    fits: dict[str, Fit]  # by predicted response
    kept: dict[str, str]  # laws kept from the base, with the reason
    forms: dict[str, str]  # form of each law in the wear, and what decided, for people
    # Log standard deviation of wear from edge to edge, if it was assumed [-].
    assumed_edge_spread: float | None
    material: Material  # the fitted and the kept laws
    problems: tuple[str, ...]  # implausible values, if the calibration was forced
    warnings: tuple[str, ...]  # for the use of the laws
    readings: tuple[str, ...]  # how each column of the sheet was read

    @property
    def wear_factor_spread(self) -> float | None:
        """Log standard deviation of wear from edge to edge [-].

        None if it is unknown or outside the scenario's range.
        """
        if self.assumed_edge_spread is not None:
            return self.assumed_edge_spread
        edges = self.fits["wear"].edges if "wear" in self.fits else None
        if edges is None or edges.spread > MAX_SPREAD:
            return None
        return round(edges.spread, 4)


def calibrate(measurements: Measurements, base: Scenario, force: bool = False) -> Calibration:
    """Fit every law that has rows; take from the base what rows do not tell.

    Raises:
        ImplausibleError: A row, or a fitted law, cannot be true, and ``force`` is not set.
        WorkshopError: No law has rows, one has too few, or the fitted laws are out of range.
    """
    measurements, copied = without_copies(measurements)
    notes = list(_notes_on_rows(measurements, copied))
    problems = [*row_problems(measurements), *_contradictions(measurements)]
    fits: dict[str, Fit] = {}
    forms: dict[str, str] = {}
    kept: dict[str, str] = {}
    for response in FACTORS:
        if not complete_rows(response, measurements).any():
            kept[response] = _why_kept(response, measurements)
            continue
        try:
            choice = fitted_law(response, measurements, base)
        except WorkshopError as error:
            # Wrong rows, or copies, are the likely reason.
            if problems and not force:
                raise ImplausibleError(problems) from error
            if len(copied):
                raise WorkshopError(f"{error}; {notes[0]}") from error
            raise
        fits[response] = choice.fitted
        if choice.reason:
            forms[response] = choice.reason
    if not fits:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in kept.items())
        raise WorkshopError(f"no law can be fitted: {reasons}")

    robust = {}
    for response, fitted in fits.items():
        robust_law = robust_fit(fitted)
        wrong_form = misfit(fitted, robust_law.distance)
        if wrong_form is None:
            robust[response] = robust_law
        else:
            # Far from a law of a wrong form, rows may well be right.
            notes.append(wrong_form.describe(response))
    problems += outliers(fits, robust)
    # Wrong rows make laws wrong, too, so that only the rows are named.
    if not problems or force:
        problems += law_problems(fits, base.tool.wear_criterion)
    if problems and not force:
        raise ImplausibleError(problems)
    warnings = [*notes, *unusual_edges(fits, robust), *_warnings(fits, measurements, base)]
    return Calibration(
        fits=fits,
        kept=kept,
        forms=forms,
        assumed_edge_spread=_assumed_edge_spread(fits, measurements, base),
        material=_material(fits, base),
        problems=tuple(problems),
        warnings=tuple(warnings),
        readings=measurements.readings,
    )


def _material(fits: Mapping[str, Fit], base: Scenario) -> Material:
    """Return the base's material with the fitted laws."""
    laws = {response: fitted.law.model_dump() for response, fitted in fits.items()}
    try:
        return Material.model_validate(base.material.model_dump() | laws)
    except ValidationError as error:
        raise WorkshopError(f"the fitted laws are no material: {_fault(error)}") from error


def _fault(error: ValidationError) -> str:
    """Return the first fault of values that are not valid."""
    return error.errors()[0]["msg"].removeprefix("Value error, ")


def _notes_on_rows(measurements: Measurements, copied: NDArray[np.int64]) -> Iterator[str]:
    """Yield warnings on rows that count as others or tell nothing."""
    if len(copied):
        rows = "1 row repeats another" if len(copied) == 1 else f"{len(copied)} rows repeat others"
        agreement = f"to within {100 * ROUNDING:g} %, in {name_lines(copied)}"
        yield f"{rows} {agreement}: copies count as one reading"
    if {"wear", "time"} <= measurements.columns.keys():
        no_wear = measurements.columns["wear"] == 0.0
        unread = no_wear & (measurements.columns["time"] > 0.0)
        if unread.any():
            lines = name_lines(measurements.lines[unread])
            yield (
                f"wear: 0 after some cutting time, in {lines}: "
                "too little to read, so not used for the law of wear"
            )


def _contradictions(measurements: Measurements) -> Iterator[str]:
    """Yield a problem on rows whose edge is worn before it has cut."""
    if {"wear", "time"} <= measurements.columns.keys():
        has_not_cut = measurements.columns["time"] == 0.0
        early = has_not_cut & (measurements.columns["wear"] > 0.0)
        if early.any():
            lines = name_lines(measurements.lines[early])
            yield (
                f"wear is above 0 at a cutting time of 0, in {lines}: "
                "give the wear since the edge was fresh, or leave time empty"
            )


def _why_kept(response: str, measurements: Measurements) -> str:
    """Return why a law has no rows."""
    columns = measurements.columns
    needed = [name for name in (response, *FACTORS[response]) if name != "hardness"]
    absent = [name for name in needed if name not in columns]
    if absent:
        return f"there is no column {', '.join(absent)}"
    if response == "wear":
        fresh = columns["wear"] == 0.0
        if fresh.any():
            return "all rows are of fresh edges, wear 0"
    empty = [name for name in needed if np.isnan(columns[name]).all()]
    reason = f"no row has all of {', '.join(needed)}"
    if empty:
        reason += f"; empty in all rows: {', '.join(empty)}"
    return reason


def fitted_law(
    response: str, measurements: Measurements, base: Scenario, compares: bool = True
) -> FormChoice:
    """Return a law in the form that fits, and why; ``compares``: see ``choose_form``.

    Taylor's n is that of catalogues if the sheet cannot tell it. This replaces only the paper's n,
    which is that of presets.

    Raises:
        WorkshopError: There are too few rows, or a fitted number is out of the law's range.
    """
    edge_spread = _edge_spread(response, base)

    def fit_law(rows: Measurements, law: PowerLaw) -> Fit:
        fitted = fit(response, rows, law, edge_spread=edge_spread)
        if response == "wear" and is_papers(base.material.wear):
            return _with_taylor(fitted, rows, base)
        return fitted

    law = getattr(base.material, response)
    return choose_form(response, measurements, law, fit_law=fit_law, compares=compares)


def _edge_spread(response: str, base: Scenario) -> float:
    """Return how edges differ if a sheet does not tell it, as a log standard deviation [-].

    That of wear may be stated by the base's files.
    """
    if response == "wear" and _states_edge_spread(base):
        return base.tool.wear_factor_spread
    return TYPICAL_EDGE_SPREAD[response]


def _states_edge_spread(base: Scenario) -> bool:
    """Return whether a file of the user states how the wear of edges differs."""
    if base.file is None:
        return False
    return "wear_factor_spread" in stated_by(base.file)[0].get("tool", {})


def _assumed_edge_spread(
    fits: Mapping[str, Fit], measurements: Measurements, base: Scenario
) -> float | None:
    """Return the spread of edges in wear that was assumed, or None if it was measured or stated."""
    fitted = fits.get("wear")
    if fitted is None or fitted.edges or _states_edge_spread(base):
        return None
    if not tells_no_edges(measurements, fitted.factors):
        return None
    return TYPICAL_EDGE_SPREAD["wear"]


def _with_taylor(fitted: Fit, measurements: Measurements, base: Scenario) -> Fit:
    """Return a law of wear that has Taylor's n of catalogues if the sheet cannot tell it.

    In W = c V^a t^g, n is g / a: the exponent that the sheet does not tell follows from the other.
    """
    assumed = dict(fitted.assumed)
    catalogue_exponent = fitted.law.time / TAYLOR
    speed = fitted.estimates.get("cutting_speed")
    if speed and _is_vague(speed) and speed.low < catalogue_exponent < speed.high:
        interval = f"{speed.low:.2g} to {speed.high:.2g}"
        assumed["cutting_speed"] = f"the sheet tells only that it is {interval}"
    if "cutting_speed" in assumed:
        name = "cutting_speed"
        exponent = catalogue_exponent
    elif "time" in assumed and fitted.law.cutting_speed > 0:
        name = "time"
        exponent = fitted.law.cutting_speed * TAYLOR
    else:
        return fitted
    law = validated_law("wear", base.material.wear, {name: exponent})
    reasons = {name: f"{assumed[name]}; {CATALOGUE}"}
    return fit("wear", measurements, law, reasons, edge_spread=_edge_spread("wear", base))


def _is_vague(estimate: Estimate) -> bool:
    return estimate.high - estimate.low > 2.0 * VAGUE


def _warnings(fits: Mapping[str, Fit], measurements: Measurements, base: Scenario) -> Iterator[str]:
    """Yield warnings on columns and rows that were not used, and on fitted laws."""
    unlike = []
    for name in measurements.ignored:
        likely = difflib.get_close_matches(name.lower(), COLUMNS, n=1, cutoff=MIN_LIKENESS)
        if likely:
            yield f"column {name!r} is not understood and was ignored; is it {likely[0]}?"
        else:
            unlike.append(repr(name))
    if unlike:
        shown = ", ".join(unlike[:MAX_IGNORED])
        further = len(unlike) - MAX_IGNORED
        more = f" and {further} more" if further > 0 else ""
        columns = "column" if len(unlike) == 1 else "columns"
        verb = "is" if len(unlike) == 1 else "are"
        yield f"{columns} {shown}{more} {verb} not understood and ignored"
    unused = ~_used_rows(measurements)
    if unused.any():
        lines = measurements.lines[unused]
        count = len(lines)
        rows = "1 row has" if count == 1 else f"{count} rows have"
        yield f"{rows} too many empty cells for any law, the first in line {lines[0]}"
    if "hardness" in measurements.columns:
        is_empty = np.isnan(measurements.columns["hardness"])
        nominal = int(is_empty.sum())
        if nominal:
            yield f"hardness is empty in {nominal} rows, where it was taken as nominal, 1"
    for fitted in fits.values():
        yield from _law_warnings(fitted, measurements, base)


def _used_rows(measurements: Measurements) -> NDArray[np.bool_]:
    """Return which rows tell of a law, or are of an edge without wear at a time, shape (rows,)."""
    used = np.zeros(len(measurements.lines), np.bool_)
    for response in FACTORS:
        used |= complete_rows(response, measurements)
    if {"wear", "time"} <= measurements.columns.keys():
        no_wear = measurements.columns["wear"] == 0.0
        # Another warning names those after some time.
        used |= no_wear & np.isfinite(measurements.columns["time"])
    return used


def _law_warnings(fitted: Fit, measurements: Measurements, base: Scenario) -> Iterator[str]:
    """Yield warnings on one fitted law."""
    response = fitted.response
    if fitted.fresh.any() and fitted.fresh.all():
        yield (
            f"{response}: all rows are of fresh edges: how the load grows with wear "
            "was not measured but assumed"
        )
    if fitted.edges is None:
        if measurements.edges is not None:
            yield (
                f"{response}: too few edges or readings to tell how edges differ: "
                "rows were taken as independent"
            )
        if response == "wear" and tells_no_edges(measurements, fitted.factors):
            spread = f"{100 * _edge_spread('wear', base):g} %"
            yield (
                "wear: too few edges or settings to tell how edges differ: "
                f"{spread} is assumed, tool.wear_factor_spread"
            )
        if rows_correlate(fitted):
            yield (
                f"{response}: rows at the same settings deviate together, so intervals are too "
                "narrow: name edges in a column 'edge'; otherwise the law's form does not fit"
            )
    if response == "power":
        yield from _level_warning(fitted, base)
    for name in fitted.exponents:
        estimate = fitted.estimates[name]
        width = estimate.high - estimate.low
        if width > 2.0 * WIDE:
            known = f"{estimate.value:.3g} +- {0.5 * width:.2g}"
            yield (
                f"{response}: the exponent of {name} is hardly known, {known}: "
                "vary it more, or read more edges"
            )


def _level_warning(fitted: Fit, base: Scenario) -> Iterator[str]:
    """Yield a warning if the power lies outside the width of the base's catalogue."""
    evidence = read_evidence(base).laws.get("power")
    if evidence is None or evidence.origin != "catalogue":
        return
    nominal_law = base.material.power
    ratio = float(np.exp(np.median(np.log(fitted.measured / nominal_law(**fitted.factors)))))
    deviations = evidence.log_deviation(nominal_law, fitted.factors, of_reading=False)
    width = float(np.exp(evidence.quantile * np.median(deviations)))
    if 1.0 / width <= ratio <= width:
        return
    if ratio < 1.0:
        cause = "is cutting_speed in rev/min, or depth_of_cut taken on the diameter?"
    else:
        cause = "does it hold the idle power?"
    yield (
        f"power: {ratio:.2g} times that of the catalogue in the base, which is known to within a "
        f"factor of {width:.2g}: another material, or {cause}"
    )


def summary(calibration: Calibration) -> Iterator[str]:
    """Yield all results as lines of text."""
    yield f"columns: {', '.join(calibration.readings)}"
    for response, fitted in calibration.fits.items():
        yield f"{response}: {fitted.quality}"
        if response in calibration.forms:
            yield f"  form: {calibration.forms[response]}"
        if fitted.edges:
            percent = 100 * fitted.edges.spread
            spread = f"{percent:.2g} % (one standard deviation)"
            yield f"  {fitted.edges.count} edges, which differ by {spread}"
        for name, estimate in fitted.estimates.items():
            interval = f"{estimate.low:.6g} to {estimate.high:.6g}"
            yield f"  {name:<14}{estimate.value:>12.6g}   {interval}"
        for name, reason in fitted.assumed.items():
            value = getattr(fitted.law, name)
            yield f"  {name:<14}{value:>12.6g}   assumed: {reason}"
        if response == "power" and fitted.has_growth:
            yield f"  {_specific_force(fitted)}"
    for response, reason in calibration.kept.items():
        yield f"{response}: as in the base, {reason}"


def _specific_force(fitted: Fit) -> str:
    """Return Kienzle's kc1.1 and mc of a fresh edge by a law of power, for people.

    Fc = kc1.1 b h^(1 - mc), and P [kW] = Fc [N] V [m/min] / 60,000. At a depth and a feed of 1 mm,
    and an entering angle of 90 degrees, b and h are 1 mm, and Fc is kc1.1.
    """
    log_speeds = np.log(fitted.factors["cutting_speed"])
    speed = float(np.exp(log_speeds.mean()))
    power = float(fitted.law(speed, 1.0, 1.0, wear=0.0))
    force = 60e3 * power / speed
    specific_force = f"kc1.1 {force:.4g} N/mm2"
    exponent = f"mc {1.0 - fitted.law.feed:.2f}"
    return f"a fresh edge has {specific_force}, {exponent} at {speed:.3g} m/min"


def write_scenario(calibration: Calibration, base: str, source: str, out: Path) -> Scenario:
    """Write and return a scenario with the fitted laws on a base.

    A limit of force or power that no file states is off if its law was not measured. The base is a
    preset or a file. The name of ``out`` without its suffix is the scenario's name; ``source``
    names the sheet.

    Raises:
        WorkshopError: The fitted laws do not suit the base, or the base is no other TOML file.
        OSError: The file cannot be written.
    """
    path = None if base in presets() else Path(base)
    if path and (path.suffix != ".toml" or path.resolve() == out.resolve()):
        raise WorkshopError(
            f"--base is {base}, but must be a preset or a file that ends in .toml, and not --out"
        )
    below = Scenario.load(base)
    tables = _stated_tables(calibration, path)
    values = below.model_dump()
    values["name"] = name_of_file(out)
    values["material"] = calibration.material.model_dump()
    for name, table in tables.items():
        values[name] |= table
    try:
        scenario = Scenario.model_validate(values)
    except ValidationError as error:
        raise WorkshopError(f"{out}: {_fault(error)}") from error
    stated: dict[str, Any] = {"base": os.path.relpath(path, out.parent) if path else base}
    stated |= tables
    evidence = _evidence(calibration, read_evidence(below), source)
    text = "\n".join(_toml_lines(calibration, stated, evidence))
    replace_file(out, lambda partial: partial.write_text(text, "utf-8"))
    return scenario


def _stated_tables(calibration: Calibration, base: Path | None) -> dict[str, dict[str, float]]:
    """Return the values that the written file states beside the laws, by section."""
    limits = stated_by(base)[0].get("limits", {}) if base else {}
    off = {}
    for name, no_limit in NO_LIMIT.items():
        if name in calibration.kept and name not in limits:
            off[name] = no_limit
    tables = {}
    if off:
        tables["limits"] = off
    if calibration.wear_factor_spread is not None:
        tables["tool"] = {"wear_factor_spread": calibration.wear_factor_spread}
    return tables


def _evidence(calibration: Calibration, before: Evidence, source: str) -> Evidence:
    """Return the evidence for the fitted laws, and for those that the base had fitted before."""
    laws = {}
    for name, law in before.laws.items():
        if name not in calibration.fits:
            laws[name] = law
    warnings = list(calibration.problems)
    # Warnings on columns concern the sheet, not the laws.
    warnings += [text for text in calibration.warnings if not text.startswith("column")]
    if laws:
        warnings += before.warnings
    for name, fitted in calibration.fits.items():
        laws[name] = evidence_of(fitted)
    unique = tuple(dict.fromkeys(warnings))
    return Evidence(source=source, warnings=unique, laws=laws)


def _toml_lines(
    calibration: Calibration, stated: dict[str, Any], evidence: Evidence
) -> Iterator[str]:
    """Yield the lines of a scenario's file."""
    yield (
        f"# Fitted by `python -m turning_shop calibrate` to {evidence.source!a}; "
        "each fitted number is followed by its 95 % interval."
    )
    for response, reason in calibration.kept.items():
        yield f"# The law of {response} is the base's: {reason}."
    for name in stated.get("limits", {}):
        yield f"# limits.{name} is off, as its law was not measured and no file states it."
    if calibration.wear_factor_spread is not None:
        measured = calibration.assumed_edge_spread is None
        source = "" if measured else ", assumed: the sheet tells it not, and AIST's edges have it"
        yield f"# tool.wear_factor_spread is the deviation of edges from the law of wear{source}."
    yield ""
    yield tomli_w.dumps(stated)
    for response, fitted in calibration.fits.items():
        yield f"[material.{response}]"
        yield f"# {fitted.quality}."
        if response in calibration.forms:
            yield f"# Form: {calibration.forms[response]}."
        for name, value in fitted.law.model_dump().items():
            yield f"{name} = {value!r}{_comment(fitted, name)}"
        yield ""
    yield (
        "# What is known of the fitted laws, for intervals of predictions. "
        "It changes nothing in the environment."
    )
    yield tomli_w.dumps({"calibration": evidence.model_dump(mode="json")})


def _comment(fitted: Fit, name: str) -> str:
    """Return the comment on a number of a law: its interval, or why it is assumed."""
    if name in fitted.estimates:
        estimate = fitted.estimates[name]
        return f" # {estimate.low:.6g} to {estimate.high:.6g}"
    if name in fitted.assumed:
        return f" # assumed: {fitted.assumed[name]}"
    return ""
