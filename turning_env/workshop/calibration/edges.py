"""How much edges differ, so that readings of one edge are not taken for as many independent ones.

The logarithm of a response is the law's, plus a part that all readings of one edge share, plus a part of its own. The variances
of both are estimated as by Swamy and Arora (Econometrica 40, 1972): the second within edges, the first from what edges' means lie
off by.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MIN_SHARE = 0.1
"""Share of a factor's variance that must lie within edges for its exponent to be judged there [-]."""
MIN_KEPT = 1e-3
"""Share of its edge's mean that a row keeps at least, else nothing would be left to tell one setting from another [-]."""

Values = NDArray[np.float64]


@dataclass(frozen=True)
class EdgeSpread:
    """What is found of the edges of one law's rows."""

    edges: int
    spread: float
    """Standard deviation of the logarithm that readings of one edge share [-]."""
    degrees: tuple[int, ...]
    """Degrees of freedom of the coefficient and of each exponent."""
    group: NDArray[np.int64]
    """Number of each row's edge, from 0, shape (rows,)."""
    taken_off: Values
    """Share of its edge's mean that is taken off each row so that all rows become independent [-], shape (rows,)."""

    def independent(self, values: Values) -> Values:
        """What is left of values of shape (rows, columns) for least squares, in which rows are independent."""
        return np.asarray(values - self.taken_off[:, np.newaxis] * edge_means(values, self.group))


def edge_spread(target: Values, design: Values, edge: NDArray[np.int64]) -> EdgeSpread | None:
    """How edges differ, from log responses of shape (rows,), log factors of shape (rows, factors) and every row's edge.

    None if there are too few edges, or too few readings of each, to tell.
    """
    _, group, members = np.unique(edge, return_inverse=True, return_counts=True)
    rows, edges = len(group), len(members)
    own_design, own_target = design - edge_means(design, group), target - edge_means(target, group)
    total = ((design - design.mean(axis=0)) ** 2).sum(axis=0)
    within = (own_design**2).sum(axis=0) > MIN_SHARE * total
    degrees_within, degrees_between = rows - edges - int(within.sum()), edges - 1 - int((~within).sum())
    if degrees_within < 1 or degrees_between < 1:
        return None
    slopes = np.linalg.lstsq(own_design[:, within], own_target, rcond=None)[0]
    variance_within = float(((own_target - own_design[:, within] @ slopes) ** 2).sum()) / degrees_within

    level = edge_means(target - design[:, within] @ slopes, group)
    settings = np.column_stack([np.ones(rows), edge_means(design[:, ~within], group)])
    off = level - settings @ np.linalg.lstsq(settings, level, rcond=None)[0]  # each edge counts as often as it was read
    readings = (rows - float(members @ members) / rows) / (edges - 1)
    variance_between = max(0.0, (float(off @ off) / degrees_between - variance_within) / readings)
    together = variance_within + members * variance_between
    kept = np.sqrt(np.divide(variance_within, together, out=np.ones(edges), where=together > 0))
    kept = np.maximum(kept, MIN_KEPT)
    degrees = (degrees_between, *(degrees_within if inside else degrees_between for inside in within))
    return EdgeSpread(edges, float(np.sqrt(variance_between)), degrees, group, 1.0 - kept[group])


def edge_means(values: Values, group: NDArray[np.int64]) -> Values:
    """Each row's mean over its group, for values of shape (rows,) or (rows, columns)."""
    sums = np.zeros((int(group.max()) + 1, *values.shape[1:]))
    np.add.at(sums, group, values)
    members = np.bincount(group)
    return np.asarray((sums.T / members).T[group])
