"""What was found, for people and for machines."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from turning_env.workshop.calibration.material import Calibration
from turning_env.workshop.calibration.regression import Fit


def as_data(calibration: Calibration, source: str, base: str) -> dict[str, Any]:
    """Everything that was found, as JSON takes it."""
    return {
        "measurements": source,
        "base": base,
        "confidence": calibration.confidence,
        "laws": {response: _law_data(fit) for response, fit in calibration.fits.items()},
        "kept_from_base": calibration.kept,
        "warnings": list(calibration.warnings),
    }


def _law_data(fit: Fit) -> dict[str, Any]:
    line, residual = worst(fit)
    return {
        "rows": len(fit.lines),
        "degrees_of_freedom": fit.degrees,
        "r_squared": fit.r_squared,
        "scatter": fit.scatter,
        "edges": fit.edges and {"count": fit.edges.edges, "spread": fit.edges.spread},
        "largest_residual": {"line": line, "relative": residual},
        "fitted": {name: vars(estimate) for name, estimate in fit.estimates.items()},
        "assumed": {name: {"value": getattr(fit.law, name), "reason": why} for name, why in fit.assumed.items()},
        "law": fit.law.model_dump(),
    }


def worst(fit: Fit) -> tuple[int, float]:
    """Line in the file of the row that lies farthest from the law, and by how much [-]."""
    index = int(np.abs(np.log(fit.measured / fit.predicted)).argmax())
    return int(fit.lines[index]), float(fit.residuals[index])


def as_text(calibration: Calibration) -> Iterator[str]:
    """Everything that was found, as lines."""
    for response, fit in calibration.fits.items():
        line, residual = worst(fit)
        explained = "" if fit.r_squared is None else f"R2 {fit.r_squared:.5f}, "
        yield f"{response}: {len(fit.lines)} rows, {explained}scatter {_percent(fit.scatter)}"
        yield f"  farthest off: line {line}, {_percent(residual, '+')}"
        if fit.edges:
            yield f"  {fit.edges.edges} edges, which differ by {_percent(fit.edges.spread)} (one standard deviation)"
        for name, estimate in fit.estimates.items():
            yield f"  {name:<14}{estimate.value:>12.6g}   {estimate.low:.6g} to {estimate.high:.6g}"
        for name, why in fit.assumed.items():
            yield f"  {name:<14}{getattr(fit.law, name):>12.6g}   assumed: {why}"
    for response, why in calibration.kept.items():
        yield f"{response}: as in the base, {why}"


def _percent(share: float, sign: str = "") -> str:
    return f"{100 * share:{sign}.2g} %"
