"""Writes a scenario file that holds the fitted laws, and says in its comments how well each number is known."""

import os
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from turning_env.scenario import Scenario, presets
from turning_env.workshop.calibration.columns import CalibrationError
from turning_env.workshop.calibration.material import Calibration
from turning_env.workshop.calibration.regression import Fit
from turning_env.workshop.inquiry.output import write


def write_scenario(calibration: Calibration, base: str, source: str, out: Path) -> Scenario:
    """Write ``out``, whole or not at all: what the base states, with the fitted laws in place of its own; returns the scenario.

    Args:
        calibration: The fitted laws.
        base: A preset, or a scenario file, whose statements are taken over (but for its name and comments).
        source: Where the measurements come from, for the comment.
        out: The file; the scenario is called as it is.

    Raises:
        CalibrationError: the file's name is no scenario's.
        OutputError: the file cannot be written.
    """
    values = Scenario.load(base).model_dump() | {"name": out.stem, "material": calibration.material.model_dump()}
    tool = {} if calibration.wear_factor_spread is None else {"wear_factor_spread": calibration.wear_factor_spread}
    values["tool"] |= tool
    try:
        scenario = Scenario.model_validate(values)
    except ValidationError as error:
        raise CalibrationError(f"{out}: {error.errors()[0]['msg'].removeprefix('Value error, ')}") from error
    stated = _stated(base, set(calibration.fits))
    if tool:
        stated["tool"] = stated.get("tool", {}) | tool
    text = "\n".join(_lines(calibration, stated, source))
    write(out, lambda partial: partial.write_text(text, "utf-8"))
    return scenario


def _stated(base: str | os.PathLike[str], fitted: set[str]) -> dict[str, Any]:
    """What a scenario file on this base states beside its name and the fitted laws."""
    if base in presets():
        return {"base": base}
    stated = tomllib.loads(Path(base).read_text("utf-8"))
    stated.pop("name", None)
    material = {name: law for name, law in stated.pop("material", {}).items() if name not in fitted}
    return stated | ({"material": material} if material else {})


def _lines(calibration: Calibration, stated: dict[str, Any], source: str) -> Iterator[str]:
    interval = f"{100 * calibration.confidence:g} % interval"
    yield f"# Fitted by `python -m turning_env calibrate` to {source!a}; after each fitted number, its {interval}."
    for response, why in calibration.kept.items():
        yield f"# The law of {response} is the base's: {why}."
    if calibration.wear_factor_spread is not None:
        yield "# tool.wear_factor_spread is how the edges differ from the law of wear."
    yield ""
    yield tomli_w.dumps(stated)
    for response, fit in calibration.fits.items():
        yield from _law(response, fit)


def _law(response: str, fit: Fit) -> Iterator[str]:
    yield f"[material.{response}]"
    explained = "" if fit.r_squared is None else f"R2 {fit.r_squared:.5f}, "
    yield f"# {len(fit.lines)} rows, {explained}scatter {100 * fit.scatter:.2g} %."
    for name, value in fit.law.model_dump().items():
        comment = ""
        if name in fit.estimates:
            comment = f" # {fit.estimates[name].low:.6g} to {fit.estimates[name].high:.6g}"
        elif name in fit.assumed:
            comment = f" # assumed: {fit.assumed[name]}"
        yield f"{name} = {value!r}{comment}"
    yield ""
