"""The typed records of the compiled transition, derived from the table of quantities."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from turning_env.physics import quantities
from turning_env.physics.quantities import AT_END, WIDTH, Parameter, Quantity, action_size
from turning_env.scenario import Scenario
from turning_env.scenario.section import Section

__all__ = [
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


STATE = _record_type(quantities.STATE)
WORK = _record_type((*quantities.WORK, Quantity("observation", "-", "entries", np.float64, (len(quantities.OBSERVATION), WIDTH))))
REPORT = _report_type()
PARAMETERS = _record_type(quantities.PARAMETERS)
SCRATCH = np.dtype((np.record, np.dtype([("parameters", PARAMETERS), ("work", WORK), ("report", REPORT)], align=True)))
"""Record of a thread's working memory, without the environments' states."""

FIRST_SUM = len(AT_END)
"""First row of the report's table that a step starts with 0."""


def new_records(dtype: np.dtype[Any], count: int) -> Any:
    """Return ``count`` zeroed records. Compiled calls know ``dtype`` by identity, and take equal types more slowly."""
    return np.zeros(count, dtype)


def parameter_records(scenario: Scenario) -> Any:
    """Return the scenario as the one record that the transition reads (an array of one, as Numba passes arrays faster)."""
    sections = [section for _, section in scenario if isinstance(section, Section) and section is not scenario.material]
    fields = {name: value for section in sections for name, value in section}
    records = new_records(PARAMETERS, 1)
    for parameter in quantities.PARAMETERS:
        records[parameter.name][0] = parameter.value(scenario) if parameter.value else fields[parameter.name]
    return records


def scratch_records(scenario: Scenario) -> Any:
    """Return a ``SCRATCH`` record for a scenario, as an array of one."""
    records = new_records(SCRATCH, 1)
    records["parameters"] = parameter_records(scenario)
    return records
