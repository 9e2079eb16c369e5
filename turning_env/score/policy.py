"""What a policy is, for rules and agents alike."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Observations = NDArray[np.float32]
Actions = NDArray[np.float32]


class Policy(Protocol):
    """Controls a fixed number of lanes. It sees their observations and nothing else."""

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget these lanes (bool, shape (lanes,)): their next observation is an episode's first."""

    def act(self, observations: Observations) -> Actions:
        """Actions of shape (lanes, 2) in -1..1 for observations of shape (lanes, 11), both float32."""


PolicyFactory = Callable[[int], Policy]
"""Makes a policy for a number of lanes."""
