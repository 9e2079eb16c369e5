"""The environments' ``info``: a plain dict of the quantities of ``quantities.INFO``."""

from collections.abc import Iterable
from typing import Any

from turning_env.physics.quantities import INFO

Info = dict[str, Any]

INFO_KEYS = tuple(quantity.name for quantity in INFO)
INFO_UNITS = {quantity.name: quantity.unit for quantity in INFO}
_EMPTY = dict.fromkeys(INFO_KEYS)
_FLAGS = tuple(quantity.name for quantity in INFO if quantity.unit == "bool")


def info_of(values: Iterable[Any]) -> Info:
    """Return the info of a report's values, numbers or arrays in the order of ``quantities.REPORT``; flags become bool."""
    info: Info = _EMPTY.copy()  # replacing values is faster than inserting keys
    info.update(zip(INFO_KEYS, values))  # noqa: B905 - further values of the report are not part of info
    for name in _FLAGS:
        info[name] = info[name] != 0.0
    return info
