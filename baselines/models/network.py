"""A radial basis network, the small neural network of the controllers."""

import numpy as np
from numpy.typing import NDArray

from turning_env.numerics.functions import exp

Array = NDArray[np.float64]

DECAY = 1e-3
"""Weight decay: the fit minimises the sum of squares of the errors plus that of ``DECAY`` times each weight."""


class Network:
    """A radial basis network, w_0 + sum of w_j exp(-(distance to centre j / width)^2 / 2), with inputs scaled to 0..1.

    The centres are samples, evenly spaced in their order; the weights follow by linear least squares. So the fit has one
    solution.

    Args:
        inputs: samples, shape (samples, inputs).
        outputs: wanted outputs, shape (samples,).
        units: number of hidden units.
        width: of a unit, over the range of an input [-].
    """

    def __init__(self, inputs: Array, outputs: Array, units: int, width: float) -> None:
        self._low = inputs.min(axis=0)
        self._span = np.where(np.ptp(inputs, axis=0) > 0.0, np.ptp(inputs, axis=0), 1.0)
        self._width = width
        self._centres = self._scaled(inputs)[np.linspace(0, len(inputs) - 1, units).round().astype(np.int64)]
        hidden = self._hidden(inputs)
        products = (hidden[:, :, np.newaxis] * hidden[:, np.newaxis]).sum(axis=0) + DECAY**2 * np.eye(units + 1)
        self._weights = solved(products, (hidden * outputs[:, np.newaxis]).sum(axis=0))

    def __call__(self, inputs: Array) -> Array:
        """Return the outputs, shape (samples,), for inputs, shape (samples, inputs)."""
        return np.asarray((self._hidden(inputs) * self._weights).sum(axis=1))

    def _scaled(self, inputs: Array) -> Array:
        return np.asarray((inputs - self._low) / self._span)

    def _hidden(self, inputs: Array) -> Array:
        distance = ((self._scaled(inputs)[:, np.newaxis] - self._centres) ** 2).sum(axis=2)
        return np.column_stack([np.ones(len(inputs)), exp(-0.5 * distance / self._width**2)])


def solved(matrix: Array, right: Array) -> Array:
    """Return x of ``matrix`` x = ``right`` for a positive definite matrix, by elimination.

    NumPy's solver gives other bits on other processors.
    """
    rows = np.column_stack([matrix, right])
    for k in range(len(rows)):
        rows[k] /= rows[k, k]
        others = np.arange(len(rows)) != k
        rows[others] -= rows[others, k, np.newaxis] * rows[k]
    return rows[:, -1]
