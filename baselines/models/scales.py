"""Ratios of measured force and power to a model's."""

import numpy as np
from numpy.typing import NDArray

MIN_SCALE = 0.1
"""Lower bound of a scale [-]: no lathe cuts with a tenth of the nominal force."""


class Scales:
    """Smoothed ratios of measured to predicted force and power.

    Args:
        num_envs: number of environments.
        smoothing: weight of the newest ratio [-].
    """

    def __init__(self, num_envs: int, smoothing: float) -> None:
        self._smoothing = smoothing
        self._force, self._power = np.ones(num_envs), np.ones(num_envs)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Return to the model's force and power."""
        self._force[mask] = 1.0
        self._power[mask] = 1.0

    def follow(
        self, mask: NDArray[np.bool_], force_ratio: NDArray[np.float64], power_ratio: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Move the scales of the masked environments towards new ratios; return all scales of force and power [-]."""
        gain = np.where(mask, self._smoothing, 0.0)
        self._force += gain * (force_ratio - self._force)
        self._power += gain * (power_ratio - self._power)
        return np.maximum(self._force, MIN_SCALE), np.maximum(self._power, MIN_SCALE)
