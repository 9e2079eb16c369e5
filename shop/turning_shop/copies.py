"""Find rows of a sheet that repeat others to within rounding: copies are one reading, and tell nothing of the scatter."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from turning_shop import Values
from turning_shop.measurements import Measurements

ROUNDING = 2e-3
"""Relative difference up to which numbers count as equal [-] (assumption: readings of wear and force scatter by 1 % or more)."""
RESPONSES = ("wear", "thrust_force", "power")
"""Columns whose readings differ between edges: if all rows of two edges agree in two of them, one edge is a copy."""


def without_copies(measurements: Measurements) -> tuple[Measurements, NDArray[np.int64]]:
    """Return the measurements with the first of each group of copies, and the lines of the others.

    Rows are copies if all their numbers agree to within ``ROUNDING`` and they are of one edge, or of edges that are not named.
    Edges of other names are copies, too, if all their rows agree.
    """
    names = list(measurements.columns)
    _, reading = np.unique(
        np.column_stack([_levels(measurements.columns[name]) for name in names]),
        axis=0,
        return_inverse=True,
    )
    edge = _real_edges(measurements, reading)
    _, first = np.unique(np.column_stack([reading, edge]), axis=0, return_index=True)
    kept = np.zeros(len(measurements.lines), np.bool_)
    kept[first] = True
    edges = measurements.edges
    reduced = replace(
        measurements,
        columns={name: measurements.columns[name][kept] for name in names},
        lines=measurements.lines[kept],
        edges=None if edges is None else np.unique(edges[kept], return_inverse=True)[1],
    )
    return reduced, measurements.lines[~kept]


def _real_edges(measurements: Measurements, reading: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the edge of each row, where an edge whose readings are all those of another has the number of that one."""
    count = len(measurements.lines)
    if measurements.edges is None:
        return np.zeros(count, np.int64)
    measured = np.zeros(count, np.int64)
    for name in RESPONSES:
        measured += np.isfinite(measurements.columns.get(name, np.full(count, np.nan)))
    originals: dict[tuple[int, ...], int] = {}
    real = measurements.edges.copy()
    order = np.argsort(measurements.edges, kind="stable")
    starts = np.flatnonzero(np.diff(measurements.edges[order])) + 1
    for rows in np.split(order, starts):
        if (measured[rows] >= 2).all():
            real[rows] = originals.setdefault(
                tuple(np.unique(reading[rows]).tolist()), int(real[rows[0]])
            )
    return real


def _levels(values: Values) -> NDArray[np.int64]:
    """Return the number of each value's level; values of a level agree with its lowest to within ``ROUNDING``."""
    distinct, place = np.unique(values, return_inverse=True)  # NaN counts as one value, the last
    level = np.zeros(len(distinct), np.int64)
    lowest, number = distinct[0], 0
    for index, value in enumerate(distinct):
        if not value <= lowest * (1.0 + ROUNDING):
            lowest, number = value, number + 1
        level[index] = number
    return np.asarray(level[place])
