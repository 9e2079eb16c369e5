"""The typed records of the compiled transition, derived from the table of quantities."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from turning_env.numerics.per_env import ROWS
from turning_env.physics import quantities
from turning_env.physics.quantities import AT_END, WIDTH, Parameter, Quantity, action_size
from turning_env.scenario import Scenario

__all__ = [
    "BLOCK_PARAMETERS",
    "OWN_NUMBERS",
    "PARAMETERS",
    "REPORT",
    "SCRATCH",
    "STATE",
    "WORK",
    "action_size",
    "new_records",
    "parameter_records",
    "scratch_records",
]


def _record_type(fields: Iterable[Quantity | Parameter]) -> np.dtype[Any]:
    """Return a record type; interpreted, its records give fields as attributes."""
    plain = np.dtype([(field.name, field.dtype, field.shape) for field in fields], align=True)
    return np.dtype((np.record, plain))


def _report_type() -> np.dtype[Any]:
    """Return the report's type: a field for every quantity, and ``table``, shape (len(REPORT), WIDTH), for all of them."""
    names = [quantity.name for quantity in quantities.REPORT]
    row, size = np.dtype((np.float64, (WIDTH,))), 8 * WIDTH
    whole = np.dtype((np.float64, (len(names), WIDTH)))
    plain = np.dtype(
        {
            "names": [*names, "table"],
            "formats": [row] * len(names) + [whole],
            "offsets": [*(size * k for k in range(len(names))), 0],
        },
        align=True,
    )
    return np.dtype((np.record, plain))


_DTYPES = {each.name: np.dtype((each.dtype, each.shape)) for each in quantities.PARAMETERS}
_DTYPES["nominal"] = np.dtype([(name, _DTYPES[name]) for name in quantities.NOMINAL])
_OWN = [name for name, dtype in _DTYPES.items() if dtype == np.float64 or dtype.names]
_SHARED = [(name, dtype) for name, dtype in _DTYPES.items() if name not in _OWN]
OWN_NUMBERS = sum(_DTYPES[name].itemsize for name in _OWN) // 8
"""Numbers in which the environments of a block can differ. They come first in ``PARAMETERS``; what follows, they share."""


def _for_each(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return a type with ``WIDTH`` numbers in place of each."""
    if dtype.names:
        return np.dtype([(name, _for_each(dtype[name])) for name in dtype.names])
    return np.dtype((np.float64, (WIDTH,)))


def _block_parameters_type() -> np.dtype[Any]:
    """Return the type of the parameters of a block whose environments differ (``numerics.per_env``)."""
    plain = np.dtype([*((name, _for_each(_DTYPES[name])) for name in _OWN), *_SHARED], align=True)
    names = plain.names or ()
    layout = {
        "names": [*names, ROWS],
        "formats": [*(plain[name] for name in names), (np.float64, (OWN_NUMBERS, WIDTH))],
        "offsets": [*(plain.fields[name][1] for name in names), 0],  # type: ignore[index]
        "itemsize": plain.itemsize,
    }
    return np.dtype((np.record, np.dtype(layout, align=True)))  # type: ignore[call-overload]


STATE = _record_type(quantities.STATE)
WORK = _record_type((*quantities.WORK, Quantity("observation", "-", "entries", np.float64, (len(quantities.OBSERVATION), WIDTH))))
REPORT = _report_type()
PARAMETERS = np.dtype((np.record, np.dtype([*((name, _DTYPES[name]) for name in _OWN), *_SHARED], align=True)))
BLOCK_PARAMETERS = _block_parameters_type()
SCRATCH = np.dtype((np.record, np.dtype([("parameters", PARAMETERS), ("work", WORK), ("report", REPORT)], align=True)))
"""Record of a thread's working memory, without the environments' states."""

FIRST_SUM = len(AT_END)
"""First row of the report's table that a step starts with 0."""


def new_records(dtype: np.dtype[Any], count: int) -> Any:
    """Return ``count`` zeroed records. Compiled calls know ``dtype`` by identity, and take equal types more slowly."""
    return np.zeros(count, dtype)


def parameter_records(scenario: Any, count: int = 1) -> Any:
    """Return the parameters of a scenario as an array of one record, as Numba passes arrays faster than records.

    The scenario's numbers can also be arrays of ``count`` numbers: then return the records of as many scenarios.
    """
    records = new_records(PARAMETERS, count)
    for parameter, value in _values(scenario):
        _fill(records[parameter.name], value)
    for parameter, value in _values(scenario.nominal()):
        if parameter.name in quantities.NOMINAL:
            _fill(records["nominal"][parameter.name], value)
    return records


def _values(scenario: Any) -> Iterator[tuple[Parameter, Any]]:
    sections = (section for name, section in scenario if name not in ("name", "material", "nominal_model"))
    fields = {name: value for section in sections for name, value in section}
    for parameter in quantities.PARAMETERS:
        yield parameter, parameter.value(scenario) if parameter.value else fields[parameter.name]


def _fill(column: Any, value: Any) -> None:
    """Write a value, or a law with the names of its numbers, into a column of records."""
    if column.dtype.names:
        for name in column.dtype.names:
            column[name] = getattr(value, name)
    else:
        column[...] = value


def scratch_records(scenario: Scenario) -> Any:
    """Return a ``SCRATCH`` record for a scenario, as an array of one."""
    records = new_records(SCRATCH, 1)
    records["parameters"] = parameter_records(scenario)
    return records
