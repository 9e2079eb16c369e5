"""Find rows of a sheet that repeat others to within rounding.

Copies are one reading: counted several times, they would tell a scatter that is too small.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from turning_shop import Values
from turning_shop.measurements import Measurements

ROUNDING = 2e-3
"""Relative difference up to which numbers count as equal [-].

Assumption: readings of wear and force scatter by 1 % or more.
"""
RESPONSES = ("wear", "thrust_force", "power")
"""Columns whose readings differ between edges.

If all rows of two edges agree in two of these columns, one edge is a copy of the other.
"""


def without_copies(measurements: Measurements) -> tuple[Measurements, NDArray[np.int64]]:
    """Return the measurements with the first of each group of copies, and the lines of the others.

    Rows are copies if all their numbers agree to within ``ROUNDING``, and they are of one edge or
    of edges without names. Edges of other names are copies, too, if all their rows agree.
    """
    levels = np.column_stack([_levels(values) for values in measurements.columns.values()])
    reading = np.unique(levels, axis=0, return_inverse=True)[1]
    edge = _real_edges(measurements, reading)
    identity = np.column_stack([reading, edge])
    first = np.unique(identity, axis=0, return_index=True)[1]
    kept = np.zeros(len(measurements.lines), np.bool_)
    kept[first] = True

    edges = measurements.edges
    if edges is not None:
        edges = np.unique(edges[kept], return_inverse=True)[1]
    reduced = replace(
        measurements,
        columns={name: values[kept] for name, values in measurements.columns.items()},
        lines=measurements.lines[kept],
        edges=edges,
    )
    return reduced, measurements.lines[~kept]


def _real_edges(measurements: Measurements, reading: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the edge of each row, shape (rows,).

    An edge whose readings are all those of another has the number of that one.
    """
    count = len(measurements.lines)
    edges = measurements.edges
    if edges is None:
        return np.zeros(count, np.int64)
    responses = np.zeros(count, np.int64)
    for name in RESPONSES:
        if name in measurements.columns:
            responses += np.isfinite(measurements.columns[name])

    real = edges.copy()
    originals: dict[tuple[int, ...], int] = {}  # edges by their readings
    order = np.argsort(edges, kind="stable")
    is_next_edge = np.diff(edges[order]) != 0
    starts = np.flatnonzero(is_next_edge) + 1
    for rows in np.split(order, starts):
        # One response alone may agree by chance.
        if (responses[rows] >= 2).all():
            distinct = np.unique(reading[rows])
            readings = tuple(distinct.tolist())
            first_edge = int(real[rows[0]])
            real[rows] = originals.setdefault(readings, first_edge)
    return real


def _levels(values: Values) -> NDArray[np.int64]:
    """Return the number of each value's level, shape (rows,).

    Values of a level agree with its lowest to within ``ROUNDING``.
    """
    distinct, place = np.unique(values, return_inverse=True)  # NaN counts as one value, the last
    level = np.zeros(len(distinct), np.int64)
    lowest = distinct[0]
    number = 0
    for index, value in enumerate(distinct):
        # The negation makes NaN, which compares as false, a level of its own.
        if not value <= lowest * (1.0 + ROUNDING):
            lowest = value
            number += 1
        level[index] = number
    return np.asarray(level[place])
