"""Write a scenario file with fitted laws: what the base states, the laws with their intervals, and what is known of them."""

import json
import os
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from turning_env.files import replace_file
from turning_env.scenario import Scenario, presets
from turning_env.scenario.scenario import name_of_file
from turning_shop import WorkshopError
from turning_shop.calibrate import Calibration
from turning_shop.prediction import Evidence, evidence_of, read_evidence


def write_scenario(calibration: Calibration, base: str, source: str, out: Path) -> Scenario:
    """Write and return a scenario with the values that the base states, but the fitted laws.

    Args:
        calibration: The fitted laws.
        base: A preset, or a scenario file whose values are copied, without name and comments.
        source: Name of the measurements' file, for the comment.
        out: File to write, whole or not at all; its name without the suffix becomes the scenario's name.

    Raises:
        WorkshopError: The fitted laws do not suit the base.
        OSError: The file cannot be written.
    """
    spread = calibration.wear_factor_spread
    tool = {} if spread is None else {"wear_factor_spread": spread}
    values = Scenario.load(base).model_dump() | {"name": name_of_file(out), "material": calibration.material.model_dump()}
    values["tool"] |= tool
    try:
        scenario = Scenario.model_validate(values)
    except ValidationError as error:
        detail = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise WorkshopError(f"{out}: {detail}") from error
    stated: dict[str, Any] = {"base": base}
    if base not in presets():
        stated = tomllib.loads(Path(base).read_text("utf-8-sig"))
        stated.pop("name", None)
        if (above := stated.get("base")) and above not in presets():  # a file, named from the folder of the one that states it
            stated["base"] = os.path.relpath(Path(base).parent / above, out.parent)
        material = {name: law for name, law in stated.pop("material", {}).items() if name not in calibration.fits}
        stated |= {"material": material} if material else {}
    if tool:
        stated["tool"] = stated.get("tool", {}) | tool
    stated.pop("calibration", None)
    before = read_evidence(Scenario.load(base))
    kept = {name: law for name, law in before.laws.items() if name not in calibration.fits}
    evidence = Evidence(
        source=source,
        warnings=tuple(dict.fromkeys((*calibration.problems, *calibration.warnings, *(before.warnings if kept else ())))),
        laws=kept | {name: evidence_of(fitted) for name, fitted in calibration.fits.items()},
    )
    text = "\n".join(_toml_lines(calibration, stated, evidence, source))
    replace_file(out, lambda partial: partial.write_text(text, "utf-8"))
    return scenario


def _toml_lines(calibration: Calibration, stated: dict[str, Any], evidence: Evidence, source: str) -> Iterator[str]:
    interval = f"{100 * calibration.confidence:g} % interval"
    yield f"# Fitted by `python -m turning_env calibrate` to {source!a}; each fitted number is followed by its {interval}."
    for response, why in calibration.kept.items():
        yield f"# The law of {response} is the base's: {why}."
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
                comment = f" # {fitted.estimates[name].low:.6g} to {fitted.estimates[name].high:.6g}"
            elif name in fitted.assumed:
                comment = f" # assumed: {fitted.assumed[name]}"
            yield f"{name} = {value!r}{comment}"
        yield ""
    yield "# What is known of the fitted laws, for intervals of predictions. It changes nothing in the environment."
    yield "[calibration]"
    yield from _keys({"source": evidence.source, "warnings": evidence.warnings})
    for name, law in evidence.laws.items():
        values = law.model_dump()
        values |= {f"measured.{factor}": ends for factor, ends in values.pop("measured").items()}
        yield from ("", f"[calibration.laws.{name}]", *_keys(values))
    yield ""


def _keys(values: dict[str, Any]) -> Iterator[str]:
    """Yield keys and values in a line each; JSON's lists, texts and numbers are TOML's too."""
    for key, value in values.items():
        yield f"{key} = {json.dumps(value, ensure_ascii=False, allow_nan=False)}"
