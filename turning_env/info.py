"""The environments' ``info``: a plain dict of the quantities of ``quantities.INFO``."""

from collections.abc import Callable, Iterable
from typing import Any

from turning_env.physics.quantities import INFO, REPORT

Info = dict[str, Any]

INFO_KEYS = tuple(quantity.name for quantity in INFO)


def _compose_info_of() -> Callable[[Iterable[Any]], Info]:
    """Return ``info_of``, made of source text that names every key.

    It replaces the values of a copy in one assignment:

        info = empty.copy()
        info["cutting_speed"], ..., broken, finished, _, _, _ = values
        info["broken"] = broken != 0.0
        ...

    This takes half the time of a loop or of ``dict(zip(...))``, and a step of the single
    environment takes not much longer than its info.
    """
    flags = []
    targets = []
    for quantity in INFO:
        if quantity.unit == "bool":
            flags.append(quantity.name)
            targets.append(quantity.name)
        else:
            targets.append(f"info[{quantity.name!r}]")
    # The outcome, which follows in a report, is no part of info.
    targets += ["_"] * (len(REPORT) - len(INFO))
    lines = [
        "def info_of(values):",
        "    info = empty.copy()",
        f"    {', '.join(targets)} = values",
    ]
    for name in flags:
        lines.append(f"    info[{name!r}] = {name} != 0.0")
    lines.append("    return info")
    namespace: dict[str, Any] = {"empty": dict.fromkeys(INFO_KEYS)}
    exec("\n".join(lines), namespace)
    function: Callable[[Iterable[Any]], Info] = namespace["info_of"]
    return function


info_of = _compose_info_of()
"""Return the info of a report's values in the order of ``quantities.REPORT``; flags become bool.

The values are numbers of one environment, or arrays of many.
"""
