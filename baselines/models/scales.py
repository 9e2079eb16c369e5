"""By how much measured force and power differ from a model's, lane by lane."""

import numpy as np
from numpy.typing import NDArray

MIN_SCALE = 0.1
"""Least measured over predicted force and power that is believed [-]: no lathe cuts with a tenth of the nominal force."""


class Scales:
    """Smoothed ratios of measured over predicted force and power.

    Args:
        lanes: how many lanes are followed.
        smoothing: share of the distance to the newest ratio by which a scale moves [-].
    """

    def __init__(self, num_envs: int, smoothing: float) -> None:
        self._smoothing = smoothing
        self._force, self._power = np.ones(num_envs), np.ones(num_envs)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Back to the model."""
        self._force[mask] = 1.0
        self._power[mask] = 1.0

    def follow(
        self, mask: NDArray[np.bool_], force_ratio: NDArray[np.float64], power_ratio: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Move the scales of some lanes towards new ratios; return those of force and power that are believed [-], of all."""
        gain = np.where(mask, self._smoothing, 0.0)
        self._force += gain * (force_ratio - self._force)
        self._power += gain * (power_ratio - self._power)
        return np.maximum(self._force, MIN_SCALE), np.maximum(self._power, MIN_SCALE)
