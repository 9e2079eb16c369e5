"""The environments' ``info``: a plain dict of the quantities of ``quantities.INFO``."""

from collections.abc import Callable, Iterable
from typing import Any

from turning_env.physics.quantities import INFO, REPORT

Info = dict[str, Any]

INFO_KEYS = tuple(quantity.name for quantity in INFO)


def _written() -> Callable[[Iterable[Any]], Info]:
    """Return ``info_of``. Its code names every key: replacing the values of a copy so takes half the time of a loop."""
    flags = [each.name for each in INFO if each.unit == "bool"]
    places = [each.name if each.name in flags else f"info[{each.name!r}]" for each in INFO]
    lines = [
        "def info_of(values):",
        "info = empty.copy()",
        ", ".join(places + ["_"] * (len(REPORT) - len(INFO))) + " = values",
    ]
    lines += [*(f"info[{name!r}] = {name} != 0.0" for name in flags), "return info"]
    names: dict[str, Any] = {"empty": dict.fromkeys(INFO_KEYS)}
    exec("\n    ".join(lines), names)
    function: Callable[[Iterable[Any]], Info] = names["info_of"]
    return function


info_of = _written()
"""Return the info of a report's values, numbers or arrays in the order of ``quantities.REPORT``; flags become bool."""
