"""The records of one environment, with values set by hand, for tests of single equations.

Called from Python, the equations run as they are written, with or without Numba.
"""

from typing import Any, NamedTuple

import numpy as np

from turning_env import Scenario
from turning_env.physics.records import block_records

ENV = 3
"""Number of the environment: not the first, so that a wrong number shows."""
AFTER = ENV + 1


class Records(NamedTuple):
    """The records of a block."""

    state: Any
    work: Any
    report: Any
    p: Any


def records_of(scenario: Scenario | None = None, **parameters: Any) -> Records:
    """Return new records of a scenario, with some parameters replaced."""
    block = block_records(scenario or Scenario())
    records = Records(
        state=block.states[0],
        work=block.scratches[0].work,
        report=block.scratches[0].report,
        p=block.parameters[0],
    )
    put(records.p, **parameters)
    return records


def put(record: Any, **values: Any) -> None:
    """Set values of the environment in a record; values of all environments are set whole."""
    for name, value in values.items():
        if np.ndim(record[name]) > 0 and np.ndim(value) == 0:
            record[name][ENV] = value
        else:
            record[name] = value


def put_law(law: Any, coefficient: float, **exponents: float) -> None:
    """Set a law of the environment: its coefficient and exponents, others are 0."""
    for name in law.dtype.names:
        law[name][ENV] = exponents.get(name, 0.0)
    law.log_coefficient[ENV] = np.log(coefficient)


def values_of(record: Any, *names: str) -> list[float]:
    """Return values of the environment in a record."""
    return [float(record[name][ENV]) for name in names]


def fill(record: Any, **values: Any) -> None:
    """Set values of all environments of the block, for equations that loop over them."""
    for name, value in values.items():
        record[name][...] = value
