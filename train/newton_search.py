"""Newton's method for the greatest gain of two numbers within bounds: that of ``baselines/models/feed_search.py`` for tensors.

A network computes it in every step, so the number of steps is fixed.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch

Tensor = torch.Tensor


def single(value: float) -> float:
    """Return the nearest number of single precision: the exporter rounds a network's numbers so."""
    return float(torch.tensor(value, dtype=torch.float32))


Pair = tuple[Tensor, Tensor]
"""Values of x and y, each of shape (num_envs,)."""

STEPS = 6
"""Number of steps that are tried."""
_FLAT = single(1e-6)  # curvature that is added, as a parabola without curvature has no top


class Slopes(NamedTuple):
    """A gain and its derivatives by x and y; fields have shape (num_envs,)."""

    gain: Tensor
    x: Tensor
    y: Tensor
    xx: Tensor
    xy: Tensor
    yy: Tensor


class Top(NamedTuple):
    """The place of the greatest gain; fields have shape (num_envs,)."""

    x: Tensor
    y: Tensor
    free_y: Tensor
    """The best y for that x without bounds, by the curvature there."""
    slope: Tensor
    """Change of that y with x."""


def search(gain: Callable[[Tensor, Tensor], Slopes], start: Pair, low: Pair, high: Pair) -> Top:
    """Return the place of the greatest gain, uphill from ``start``, between ``low`` and ``high``.

    A step that does not raise the gain is halved.
    """
    x, y = (torch.minimum(torch.maximum(each, least), most) for each, least, most in zip(start, low, high, strict=True))
    here = gain(x, y)
    dx, dy = _step(here, (x, y), low, high)
    for _ in range(STEPS):
        there = gain(x + dx, y + dy)
        rises = there.gain > here.gain
        x, y = torch.where(rises, x + dx, x), torch.where(rises, y + dy, y)
        here = Slopes(*(torch.where(rises, new, old) for new, old in zip(there, here, strict=True)))
        next_step = _step(here, (x, y), low, high)
        dx, dy = (torch.where(rises, new, 0.5 * old) for new, old in zip(next_step, (dx, dy), strict=True))
    _, xy, yy = _magnitudes(here)
    return Top(x, y, y + here.y / yy, -xy / yy)


def _magnitudes(here: Slopes) -> tuple[Tensor, Tensor, Tensor]:
    """Return the matrix of curvatures xx, xy, yy with its eigenvalues' magnitudes, so steps go uphill (Dauphin et al. 2014)."""
    determinant = (here.xx * here.yy - here.xy.square()).abs()
    root = torch.sqrt(here.xx.square() + 2.0 * here.xy.square() + here.yy.square() + 2.0 * determinant) + _FLAT
    xx, yy = ((each.square() + here.xy.square() + determinant) / root + _FLAT for each in (here.xx, here.yy))
    return xx, here.xy * (here.xx + here.yy) / root, yy


def _step(here: Slopes, place: Pair, low: Pair, high: Pair) -> Pair:
    """Return the step to the top, within bounds, of the parabola with these slopes and magnitudes of curvatures."""
    xx, xy, yy = _magnitudes(here)

    def within(value: Tensor, axis: int) -> Tensor:
        return torch.minimum(torch.maximum(value, low[axis] - place[axis]), high[axis] - place[axis])

    def rise(dx: Tensor, dy: Tensor) -> Tensor:
        return here.x * dx + here.y * dy - 0.5 * (xx * dx.square() + 2.0 * xy * dx * dy + yy * dy.square())

    determinant = xx * yy - xy.square()
    dx, dy = within((here.x * yy - here.y * xy) / determinant, 0), within((here.y * xx - here.x * xy) / determinant, 1)
    first, second = (dx, within((here.y - xy * dx) / yy, 1)), (within((here.x - xy * dy) / xx, 0), dy)
    better = rise(*second) > rise(*first)
    return torch.where(better, second[0], first[0]), torch.where(better, second[1], first[1])
