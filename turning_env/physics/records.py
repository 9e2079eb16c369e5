"""The typed records of the compiled transition; tables of quantities and parameters define them.

A block is ``WIDTH`` environments. Its records hold, for each quantity, an array over these
environments.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turning_env.physics import parameters, quantities
from turning_env.physics.quantities import WIDTH
from turning_env.scenario import Scenario, ScenarioBatch

_BYTES = 8  # of a number


def _record_type(fields: Iterable[Any]) -> np.dtype[Any]:
    """Return a record type; interpreted, its records give fields as attributes."""
    return np.dtype((np.record, np.dtype(list(fields), align=True)))


def _quantity_fields(table: Iterable[quantities.Quantity]) -> list[Any]:
    """Return the fields of a record of quantities."""
    return [(quantity.name, quantity.dtype, quantity.shape) for quantity in table]


def _table_type(fields: list[Any]) -> np.dtype[Any]:
    """Return a type with the fields, each of one or more rows, and ``table`` for all of them.

    ``table`` has shape (rows, WIDTH). It overlaps the fields: loops over many quantities use it,
    and read those of whole numbers as the floats with the same bits.
    """
    starts = []
    end = 0
    for _, dtype, shape in fields:
        starts.append(end)
        end += np.dtype((dtype, shape)).itemsize
    rows = end // (WIDTH * _BYTES)
    layout: Any = {
        "names": [*[name for name, _, _ in fields], "table"],
        "formats": [*[(dtype, shape) for _, dtype, shape in fields], (np.float64, (rows, WIDTH))],
        "offsets": [*starts, 0],
    }
    return np.dtype((np.record, np.dtype(layout, align=True)))


def _per_env(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Return a type with ``WIDTH`` numbers in place of each number."""
    if dtype.names:
        return np.dtype([(name, _per_env(dtype[name])) for name in dtype.names])
    return np.dtype((np.float64, (WIDTH,)))


_BY_NAME = parameters.by_name(parameters.PARAMETERS)


def _parameter_fields() -> tuple[list[Any], list[Any]]:
    """Return the fields in which environments can differ, and those that they share."""
    differing, shared = [], []
    for name, parameter in _BY_NAME.items():
        dtype = np.dtype((parameter.dtype, parameter.shape))
        if parameter.per_env:
            differing.append((name, _per_env(dtype)))
        else:
            shared.append((name, dtype))
    nominal = np.dtype([(name, _BY_NAME[name].dtype) for name in parameters.NOMINAL])
    differing.append(("nominal", _per_env(nominal)))
    return differing, shared


_DIFFERING, _SHARED = _parameter_fields()
_NUMBERS = sum(dtype.itemsize for _, dtype in _DIFFERING) // (_BYTES * WIDTH)
SHARED_PARAMETERS = [name for name, _ in _SHARED]
"""Parameters that the environments of a batch share.

In the others, which come first in a record, each environment can differ.
"""

STATE = _table_type(_quantity_fields(quantities.STATE))
_OBSERVATION = ("observation", np.float64, (len(quantities.OBSERVATION), WIDTH))
WORK = _record_type([*_quantity_fields(quantities.WORK), _OBSERVATION])
# A report shows all of its quantities as numbers.
REPORT = _table_type([(quantity.name, np.float64, (WIDTH,)) for quantity in quantities.REPORT])
PARAMETERS = _record_type([*_DIFFERING, *_SHARED])
SCRATCH = _record_type([("work", WORK), ("report", REPORT)])
"""A thread's working memory, without the environments' states."""


def row_of(dtype: np.dtype[Any], name: str) -> int:
    """Return the first row of a quantity in the ``table`` of a ``STATE`` or a ``REPORT``."""
    assert dtype.fields is not None
    offset = dtype.fields[name][1]
    return offset // (WIDTH * _BYTES)


def new_records(dtype: np.dtype[Any], count: int) -> Any:
    """Return ``count`` zeroed records.

    Compiled calls know ``dtype`` by identity, and take equal types more slowly.
    """
    return np.zeros(count, dtype)


def parameter_records(
    scenario: Scenario | ScenarioBatch,
    count: int = WIDTH,
    nominal: Scenario | ScenarioBatch | None = None,
) -> Any:
    """Return the parameters of blocks with ``count`` environments: shape (blocks,).

    ``count`` is a multiple of ``WIDTH``. All environments have the same scenario, or one each of a
    batch of ``count``, which needs a batch of ``nominal`` models.
    """
    if nominal is None:
        assert isinstance(scenario, Scenario)
        nominal = scenario.nominal()
    records = new_records(PARAMETERS, count // WIDTH)
    for name, parameter in _BY_NAME.items():
        _fill(records[name], parameter, parameter.value(scenario))
    for name in parameters.NOMINAL:
        parameter = _BY_NAME[name]
        _fill(records["nominal"][name], parameter, parameter.value(nominal))
    # One flag serves both models.
    records["fresh_edges_load"] |= _BY_NAME["fresh_edges_load"].value(nominal)
    return records


def _fill(column: Any, parameter: parameters.Parameter, value: Any) -> None:
    """Write a parameter's value into its column of records; what it has no value for stays 0."""
    if not parameter.per_env:
        if parameter.shape:
            column[:, : len(value)] = value
        else:
            column[...] = value
    elif column.dtype.names:
        # A law, which has its numbers as attributes.
        for name in column.dtype.names:
            _fill_numbers(column[name], getattr(value, name))
    else:
        _fill_numbers(column, value)


def _fill_numbers(column: Any, value: Any) -> None:
    """Write one number for all environments, or one for each, into a column of a parameter."""
    column[...] = np.reshape(value, column.shape) if np.ndim(value) else value


def numbers_of(records: Any) -> NDArray[np.float64]:
    """Return a view of the numbers in which environments can differ.

    Its shape is (blocks, numbers, WIDTH). These numbers come first in a record.
    """
    record_bytes = records.view(np.uint8).reshape(len(records), -1)
    numbers: NDArray[np.float64] = record_bytes[:, : _BYTES * _NUMBERS * WIDTH].view(np.float64)
    return numbers.reshape(len(records), _NUMBERS, WIDTH)


class BlockRecords(NamedTuple):
    """The records of one block of environments; each is an array of one record."""

    states: Any
    parameters: Any
    scratches: Any


def block_records(scenario: Scenario) -> BlockRecords:
    """Return new records of one block of environments of a scenario."""
    return BlockRecords(
        states=new_records(STATE, 1),
        parameters=parameter_records(scenario),
        scratches=new_records(SCRATCH, 1),
    )
