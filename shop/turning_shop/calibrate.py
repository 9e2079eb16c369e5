"""Calibrate a material: fit its laws to measured cuts, report the uncertainty, and write a scenario with them.

The command is ``python -m turning_env calibrate``; docs/your_own_machine.md is the tutorial.
"""

import difflib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
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
    Fit,
    complete_rows,
    fit,
    fresh_rows,
    rows_correlate,
    tells_no_edges,
)
from turning_shop.form import misfit
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

from turning_env.files import replace_file
from turning_env.scenario import Scenario, presets
from turning_env.scenario.scenario import name_of_file
from turning_env.scenario.sections import Material

VAGUE = 1.0
"""Half-width of the interval of the wear law's exponent of speed above which that of catalogues is taken if it lies within."""
WIDE = 0.5  # half-width of an exponent's interval above which a warning calls the exponent hardly known [-]


class Implausible(WorkshopError):
    """Implausible measurements or laws; the message names the rows and the likely cause."""

    def __init__(self, problems: Sequence[str]):
        super().__init__("; ".join(problems))
        self.problems = tuple(problems)


@dataclass(frozen=True)
class Calibration:
    """A material with laws fitted to measurements."""

    fits: dict[str, Fit]  # by predicted response
    kept: dict[str, str]  # laws kept from the base, with the reason
    material: Material  # the fitted and the kept laws
    problems: tuple[str, ...]  # implausible values, if the calibration was forced
    warnings: tuple[str, ...]  # for the use of the laws
    readings: tuple[str, ...]  # how each column of the sheet was read

    @property
    def wear_factor_spread(self) -> float | None:
        """Log standard deviation of wear from edge to edge [-]; None if it is unknown or outside the scenario's range."""
        edges = self.fits["wear"].edges if "wear" in self.fits else None
        return round(edges.spread, 4) if edges and edges.spread <= 1.0 else None


def calibrate(measurements: Measurements, base: Scenario, force: bool = False) -> Calibration:
    """Fit every law that has rows; take the other laws, and exponents that cannot be estimated, from the base.

    Raises:
        Implausible: A row, or a fitted law, cannot be true, and ``force`` is not set.
        WorkshopError: No law has rows, one has too few, or the fitted laws are out of range.
    """
    measurements, copied = without_copies(measurements)
    notes = list(_notes_on_rows(measurements, copied))
    problems = [*row_problems(measurements), *_contradictions(measurements)]
    fits: dict[str, Fit] = {}
    kept: dict[str, str] = {}
    for response in FACTORS:
        if complete_rows(response, measurements).any():
            try:
                fits[response], misfits = _fit_where_it_holds(response, measurements, base)
                notes += misfits
            except WorkshopError as error:
                if problems and not force:  # the likely reason
                    raise Implausible(problems) from error
                if len(copied):
                    raise WorkshopError(f"{error}; {notes[0]}") from error
                raise
        else:
            kept[response] = _why_kept(response, measurements)
    if not fits:
        raise WorkshopError(
            "no law can be fitted: " + "; ".join(f"{name}: {why}" for name, why in kept.items())
        )
    robust = {response: robust_fit(fitted) for response, fitted in fits.items()}
    problems += outliers(fits, robust)
    if not problems or force:  # wrong rows make laws wrong, too
        problems += law_problems(fits, base.tool.wear_criterion)
    if problems and not force:
        raise Implausible(problems)
    laws = {response: fitted.law.model_dump() for response, fitted in fits.items()}
    try:
        material = Material.model_validate(base.material.model_dump() | laws)
    except ValidationError as error:
        detail = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise WorkshopError(f"the fitted laws are no material: {detail}") from error
    warnings = (*notes, *unusual_edges(fits, robust), *_warnings(fits, measurements, base))
    return Calibration(fits, kept, material, tuple(problems), warnings, measurements.readings)


def _notes_on_rows(measurements: Measurements, copied: NDArray[np.int64]) -> Iterator[str]:
    """Yield warnings on rows that count as others or tell nothing."""
    if len(copied):
        rows = f"{len(copied)} row{'s repeat others' if len(copied) > 1 else ' repeats another'}"
        yield f"{rows} to within {100 * ROUNDING:g} %, in {name_lines(copied)}: copies count as one reading"
    wear, time = measurements.columns.get("wear"), measurements.columns.get("time")
    if wear is not None and time is not None and (unread := (wear == 0.0) & (time > 0.0)).any():
        lines = name_lines(measurements.lines[unread])
        yield f"wear: 0 after some cutting time, in {lines}: too little to read, so not used for the law of wear"


def _contradictions(measurements: Measurements) -> Iterator[str]:
    """Yield a problem on rows whose edge is worn before it has cut."""
    wear, time = measurements.columns.get("wear"), measurements.columns.get("time")
    if wear is not None and time is not None and (early := (wear > 0.0) & (time == 0.0)).any():
        lines = name_lines(measurements.lines[early])
        yield f"wear is above 0 at a cutting time of 0, in {lines}: give the wear since the edge was fresh, or leave time empty"


def _why_kept(response: str, measurements: Measurements) -> str:
    """Return why a law has no rows."""
    needed = [name for name in (response, *FACTORS[response]) if name != "hardness"]
    if absent := [name for name in needed if name not in measurements.columns]:
        return f"there is no column {', '.join(absent)}"
    if response == "wear" and (measurements.columns["wear"] == 0.0).any():
        return "all rows are of fresh edges, wear 0"
    return f"no row has all of {', '.join(needed)}"


def _fit_where_it_holds(
    response: str, measurements: Measurements, base: Scenario
) -> tuple[Fit, list[str]]:
    """Return a law fitted to the rows for which its form holds, and a warning if those are not all."""
    fitted = _fit(response, measurements, base)
    wrong = misfit(fitted)
    if wrong is None:
        return fitted, []
    used = measurements.columns[response].copy()
    used[np.isin(measurements.lines, fitted.lines[wrong.beyond])] = np.nan
    column = COLUMNS[wrong.factor]
    line = f"c (1 + {wrong.slope:.3g} {wrong.factor})"
    reason = (
        f"{response}: the law's form, c {wrong.factor}^x, does not fit near {wrong.factor} 0; "
        f"{line} fits all rows with a scatter of {100 * wrong.scatter:.2g} %"
    )
    try:
        refitted = _fit(
            response, replace(measurements, columns=measurements.columns | {response: used}), base
        )
    except WorkshopError as error:
        above = f"too few rows are left above {wrong.holds_from:.3g} {column.unit}, where it fits"
        raise WorkshopError(f"{reason}; {above}: {error}") from error
    return refitted, [
        f"{reason}. It was fitted to {wrong.factor} from {wrong.holds_from:.3g} {column.unit} up, and holds only there: "
        f"rows below were left out, in {name_lines(fitted.lines[wrong.beyond])}"
    ]


def _fit(response: str, measurements: Measurements, base: Scenario) -> Fit:
    """Fit a law, with Taylor's n of catalogues if the sheet cannot tell it and the base has the paper's."""
    edge_spread = base.tool.wear_factor_spread if response == "wear" else 0.0
    fitted = fit(response, measurements, getattr(base.material, response), edge_spread=edge_spread)
    if response == "wear" and is_papers(base.material.wear):
        return _with_taylor(fitted, measurements, base)
    return fitted


def _with_taylor(fitted: Fit, measurements: Measurements, base: Scenario) -> Fit:
    """Return a law of wear whose exponent of speed or time, if the sheet cannot tell it, agrees with Taylor's n of catalogues."""
    assumed, speed, wanted = (
        dict(fitted.assumed),
        fitted.estimates.get("cutting_speed"),
        fitted.law.time / TAYLOR,
    )
    if speed and speed.high - speed.low > 2.0 * VAGUE and speed.low < wanted < speed.high:
        assumed["cutting_speed"] = (
            f"the sheet tells only that it is {speed.low:.2g} to {speed.high:.2g}"
        )
    if "cutting_speed" in assumed:
        known = {"cutting_speed": wanted}
    elif "time" in assumed and fitted.law.cutting_speed > 0:
        known = {"time": fitted.law.cutting_speed * TAYLOR}
    else:
        return fitted
    reasons = {name: f"{assumed[name]}; {CATALOGUE}" for name in known}
    law = base.material.wear.model_copy(update=known)
    return fit("wear", measurements, law, reasons, edge_spread=base.tool.wear_factor_spread)


def _warnings(fits: dict[str, Fit], measurements: Measurements, base: Scenario) -> Iterator[str]:
    for name in measurements.ignored:
        likely = difflib.get_close_matches(name.lower(), COLUMNS, n=1, cutoff=0.75)
        yield f"column {name!r} is not understood and was ignored" + "".join(
            f"; is it {column}?" for column in likely
        )
    counted = [
        complete_rows(response, measurements) | fresh_rows(response, measurements)
        for response in FACTORS
    ]
    if {"wear", "time"} <= measurements.columns.keys():
        counted.append(
            (measurements.columns["wear"] == 0.0) & (measurements.columns["time"] == 0.0)
        )
    unused = ~np.logical_or.reduce(counted)
    if unused.any():
        yield f"{unused.sum()} rows have too many empty cells for any law, the first in line {measurements.lines[unused][0]}"
    nominal = int(np.isnan(measurements.columns.get("hardness", np.ones(1))).sum())
    if nominal:
        yield f"hardness is empty in {nominal} rows, where it was taken as nominal, 1"
    for response, fitted in fits.items():
        if fitted.fresh.any() and fitted.fresh.all():
            yield f"{response}: all rows are of fresh edges: loads of worn edges are higher, so limits may not hold with them"
        if fitted.edges is None and measurements.edges is not None:
            yield f"{response}: too few edges or readings to tell how edges differ: rows were taken as independent"
        if (
            response == "wear"
            and fitted.edges is None
            and tells_no_edges(measurements, fitted.factors)
        ):
            spread = base.tool.wear_factor_spread
            assumed = f"{100 * spread:g} % is assumed, tool.wear_factor_spread"
            yield f"wear: too few edges or settings to tell how edges differ: {assumed}"
        if fitted.edges is None and rows_correlate(fitted):
            yield (
                f"{response}: rows at the same settings deviate together, so intervals are too narrow: "
                "name edges in a column 'edge'; otherwise no power law fits"
            )
        for name in fitted.exponents:
            found = fitted.estimates[name]
            if found.high - found.low > 2.0 * WIDE:
                known = f"{found.value:.3g} +- {0.5 * (found.high - found.low):.2g}"
                yield f"{response}: the exponent of {name} is hardly known, {known}: vary it more, or read more edges"


def summary(calibration: Calibration) -> Iterator[str]:
    """Yield all results as lines of text."""
    yield f"columns: {', '.join(calibration.readings)}"
    for response, fitted in calibration.fits.items():
        yield f"{response}: {fitted.quality}"
        if fitted.edges:
            yield f"  {fitted.edges.count} edges, which differ by {100 * fitted.edges.spread:.2g} % (one standard deviation)"
        for name, estimate in fitted.estimates.items():
            yield f"  {name:<14}{estimate.value:>12.6g}   {estimate.low:.6g} to {estimate.high:.6g}"
        for name, why in fitted.assumed.items():
            yield f"  {name:<14}{getattr(fitted.law, name):>12.6g}   assumed: {why}"
        if fitted.fresh.any():
            yield f"  {_on_fresh_edges(fitted)}"
    for response, why in calibration.kept.items():
        yield f"{response}: as in the base, {why}"


def _on_fresh_edges(fitted: Fit) -> str:
    """Return what rows with a wear of 0 tell, for people; of a power also kc1.1 and mc (Kienzle)."""
    level, mean = 1.0, 1.0
    text = "all rows are of fresh edges: the law does not depend on wear"
    if not fitted.fresh.all():
        worn = fitted.factors["wear"][~fitted.fresh]
        level, mean = fitted.fresh_level, float(np.exp(np.log(worn).mean()))
        text = (
            f"{fitted.fresh.sum()} rows of fresh edges, {level:.3g} times the law at {mean:.3g} mm, tell the exponents of "
            f"speed, feed and depth; the law holds from {worn.min():.3g} mm of wear"
        )
    if fitted.response == "power":
        speed = float(np.exp(np.log(fitted.factors["cutting_speed"]).mean()))
        power = level * float(fitted.law(speed, 1.0, 1.0, wear=mean))
        text += f"; kc1.1 {60e3 * power / speed:.4g} N/mm2, mc {1.0 - fitted.law.feed:.2f} at {speed:.3g} m/min"
    return text


def write_scenario(calibration: Calibration, base: str, source: str, out: Path) -> Scenario:
    """Write and return a scenario with the fitted laws on a base.

    A limit of force or power that no file states is off if its law was not measured. The base is a preset or a file. The name of
    ``out`` without its suffix is the scenario's name; ``source`` names the sheet.

    Raises:
        WorkshopError: The fitted laws do not suit the base, or the base is no other TOML file.
        OSError: The file cannot be written.
    """
    path = None if base in presets() else Path(base)
    if path and (path.suffix != ".toml" or path.resolve() == out.resolve()):
        raise WorkshopError(
            f"--base is {base}, but must be a preset or a file that ends in .toml, and not --out"
        )
    own = stated_by(path)[0].get("limits", {}) if path else {}
    off = {
        name: none
        for name, none in NO_LIMIT.items()
        if name in calibration.kept and name not in own
    }
    spread = calibration.wear_factor_spread
    tables = {"limits": off, "tool": {} if spread is None else {"wear_factor_spread": spread}}
    values = Scenario.load(base).model_dump() | {
        "name": name_of_file(out),
        "material": calibration.material.model_dump(),
    }
    try:
        scenario = Scenario.model_validate(
            values | {name: values[name] | table for name, table in tables.items()}
        )
    except ValidationError as error:
        detail = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise WorkshopError(f"{out}: {detail}") from error
    stated: dict[str, Any] = {"base": os.path.relpath(path, out.parent) if path else base}
    stated |= {name: table for name, table in tables.items() if table}
    before = read_evidence(Scenario.load(base))
    kept = {name: law for name, law in before.laws.items() if name not in calibration.fits}
    lasting = [
        warning for warning in calibration.warnings if not warning.startswith("column ")
    ]  # of laws, not of the sheet
    evidence = Evidence(
        source=source,
        warnings=tuple(
            dict.fromkeys((*calibration.problems, *lasting, *(before.warnings if kept else ())))
        ),
        laws=kept | {name: evidence_of(fitted) for name, fitted in calibration.fits.items()},
    )
    text = "\n".join(_toml_lines(calibration, stated, evidence, source))
    replace_file(out, lambda partial: partial.write_text(text, "utf-8"))
    return scenario


def _toml_lines(
    calibration: Calibration, stated: dict[str, Any], evidence: Evidence, source: str
) -> Iterator[str]:
    yield f"# Fitted by `python -m turning_env calibrate` to {source!a}; each fitted number is followed by its 95 % interval."
    for response, why in calibration.kept.items():
        yield f"# The law of {response} is the base's: {why}."
    for name in stated.get("limits", {}):
        yield f"# limits.{name} is off, as its law was not measured and no file states it."
    if calibration.wear_factor_spread is not None:
        yield "# tool.wear_factor_spread is the deviation of edges from the law of wear."
    yield ""
    yield tomli_w.dumps(stated)
    for response, fitted in calibration.fits.items():
        yield f"[material.{response}]"
        yield f"# {fitted.quality}."
        for name, value in fitted.law.model_dump().items():
            comment = ""
            if name in fitted.estimates:
                comment = (
                    f" # {fitted.estimates[name].low:.6g} to {fitted.estimates[name].high:.6g}"
                )
            elif name in fitted.assumed:
                comment = f" # assumed: {fitted.assumed[name]}"
            yield f"{name} = {value!r}{comment}"
        yield ""
    yield "# What is known of the fitted laws, for intervals of predictions. It changes nothing in the environment."
    yield tomli_w.dumps({"calibration": evidence.model_dump(mode="json")})
