"""The typed records of the compiled transition, derived from the tables of quantities and parameters.

A block is ``WIDTH`` environments. Its records hold an array over these environments for each quantity.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.physics import parameters, quantities
from turning_env.physics.quantities import WIDTH
from turning_env.scenario import Scenario, ScenarioBatch


def _record_type(fields: Iterable[Any]) -> np.dtype[Any]:
    """Return a record type; interpreted, its records give fields as attributes."""
    return np.dtype((np.record, np.dtype(list(fields), align=True)))


def _table_type(names: list[str]) -> np.dtype[Any]:
    """Return a type with a field for every name, and ``table``, shape (names, WIDTH), for all of them."""
    formats = [*[(np.float64, (WIDTH,))] * len(names), (np.float64, (len(names), WIDTH))]
    offsets = [*range(0, 8 * WIDTH * len(names), 8 * WIDTH), 0]
    return np.dtype(
        (
            np.record,
            np.dtype(
                {"names": [*names, "table"], "formats": formats, "offsets": offsets}, align=True
            ),
        )
    )


def _for_each(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return a type with ``WIDTH`` numbers in place of each number."""
    if dtype.names:
        return np.dtype([(name, _for_each(dtype[name])) for name in dtype.names])
    return np.dtype((np.float64, (WIDTH,)))


_PARAMETERS = {each.name: np.dtype((each.dtype, each.shape)) for each in parameters.PARAMETERS}
_PARAMETERS["nominal"] = np.dtype([(name, _PARAMETERS[name]) for name in parameters.NOMINAL])
_OWN = [
    (name, _for_each(dtype))
    for name, dtype in _PARAMETERS.items()
    if dtype == np.float64 or dtype.names
]
_NUMBERS = sum(dtype.itemsize for _, dtype in _OWN) // (8 * WIDTH)
CHOICES = [name for name in _PARAMETERS if name not in dict(_OWN)]
"""Parameters that the environments of a batch share. In the others, which come first, each environment can differ."""

STATE = _record_type((each.name, each.dtype, each.shape) for each in quantities.STATE)
_OBSERVATION = ("observation", np.float64, (len(quantities.OBSERVATION), WIDTH))
WORK = _record_type(
    [*((each.name, each.dtype, each.shape) for each in quantities.WORK), _OBSERVATION]
)
REPORT = _table_type([quantity.name for quantity in quantities.REPORT])
PARAMETERS = _record_type([*_OWN, *((name, _PARAMETERS[name]) for name in CHOICES)])
SCRATCH = _record_type(
    [("work", WORK), ("report", REPORT)]
)  # a thread's working memory, without the environments' states


def new_records(dtype: np.dtype[Any], count: int) -> Any:
    """Return ``count`` zeroed records. Compiled calls know ``dtype`` by identity, and take equal types more slowly."""
    return np.zeros(count, dtype)


def parameter_records(
    scenario: Scenario | ScenarioBatch,
    count: int = WIDTH,
    nominal: Scenario | ScenarioBatch | None = None,
) -> Any:
    """Return the parameters of blocks with ``count`` environments, a multiple of ``WIDTH``: shape (blocks,).

    All environments have the same scenario, or one each of a batch of ``count``, which needs a batch of ``nominal`` models.
    """
    if nominal is None:
        assert isinstance(scenario, Scenario)
        nominal = scenario.nominal()
    records = new_records(PARAMETERS, count // WIDTH)
    for columns, source in ((records, scenario), (records["nominal"], nominal)):
        fields = {
            key: value
            for name, each in source
            if name not in ("name", "material", "nominal_model")
            for key, value in each
        }
        for each in parameters.PARAMETERS:
            if each.name in columns.dtype.names:
                _fill(columns[each.name], each.value(source) if each.value else fields[each.name])
    return records


def numbers_of(records: Any) -> NDArray[np.float64]:
    """Return a view of the numbers in which environments can differ: shape (blocks, numbers, WIDTH)."""
    numbers: NDArray[np.float64] = (
        records.view(np.uint8).reshape(len(records), -1)[:, : 8 * _NUMBERS * WIDTH].view(np.float64)
    )
    return numbers.reshape(len(records), _NUMBERS, WIDTH)


def block_records(scenario: Scenario) -> tuple[Any, Any, Any]:
    """Return states, parameters and scratch of one block of environments of a scenario, each an array of one record."""
    return new_records(STATE, 1), parameter_records(scenario), new_records(SCRATCH, 1)


def _fill(column: Any, value: Any) -> None:
    """Write a value, or a law with the names of its numbers, into a column of records; what it has no value for stays 0."""
    if column.dtype.names:
        for name in column.dtype.names:
            _fill(column[name], getattr(value, name))
    elif column.shape[1:] == (WIDTH,):
        column[...] = np.reshape(value, column.shape) if np.ndim(value) else value
    elif np.ndim(value):
        column[:, : len(value)] = value
    else:
        column[...] = value
