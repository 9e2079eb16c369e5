"""What a policy is: it chooses the actions of a batch of environments by their observations."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Observations = NDArray[np.float32]
Actions = NDArray[np.float32]


class Policy(Protocol):
    """Chooses the actions of a fixed number of environments by their observations alone."""

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of the environments in the mask, shape (num_envs,).

        Their next observation begins an episode. A policy without memory need not define this.
        """
        return

    def act(self, observations: Observations) -> Actions:
        """Return actions in -1..1, shape (num_envs, actions).

        Observations have the shape (num_envs, entries). Both are float32.
        """


PolicyFactory = Callable[[int], Policy]
"""Makes a policy for a number of environments."""
