"""Which exponents a table of measurements can tell at all."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from turning_env.workshop.calibration.columns import COLUMNS, CalibrationError

Column = NDArray[np.float64]

MIN_VARIATION = 1e-3
"""By so much [-] a factor must vary, once what other factors explain of it is taken off, for its exponent to be fitted."""


def told_apart(factors: Mapping[str, Column], logs: Mapping[str, Column]) -> tuple[list[str], dict[str, str]]:
    """Factors whose exponents the rows tell, and why they do not tell the others'.

    Of factors that vary together, the first is fitted.
    """
    kept: list[str] = []
    assumed: dict[str, str] = {}
    for name, log in logs.items():
        if _variation(log) < MIN_VARIATION:
            values, unit = factors[name], COLUMNS[name].unit.replace("-", "")
            assumed[name] = f"{name} never varies: {values.mean():.4g} {unit}".rstrip() + f" in all {len(values)} rows"
            continue
        others = np.array([logs[other] - logs[other].mean() for other in kept]).reshape(len(kept), len(log)).T
        weights = np.linalg.lstsq(others, log - log.mean(), rcond=None)[0]
        if _variation(log - others @ weights) < MIN_VARIATION:
            shares = np.abs(weights) * np.ptp(others, axis=0)
            together = [other for other, share in zip(kept, shares, strict=True) if share >= MIN_VARIATION]
            assumed[name] = f"{name} varies only together with {' and '.join(together)}"
            continue
        kept.append(name)
    return kept, assumed


def _variation(log: Column) -> float:
    """Largest relative distance of a factor from its mean [-]."""
    return float(np.abs(log - log.mean()).max())


def check_enough(response: str, count: int, fitted: list[str], logs: Mapping[str, Column]) -> None:
    """CalibrationError if there are fewer rows than fitted numbers and one more."""
    if count >= len(fitted) + 2:
        return
    varying = [name for name, log in logs.items() if _variation(log) >= MIN_VARIATION]
    numbers = f"the coefficient and {len(varying)} exponents ({', '.join(varying)})" if varying else "the coefficient"
    raise CalibrationError(
        f"{response}: {count} row{'s' * (count != 1)} with this and all its factors, but {len(varying) + 2} are needed: "
        f"for {numbers}, and one more to judge the scatter by"
    )
