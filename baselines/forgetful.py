"""A policy without memory between edges, which shows what its memory is worth."""

import numpy as np
from numpy.typing import NDArray

from turning_env.physics.quantities import OBS
from turning_env.policy import Actions, Observations, Policy


class Forgetful(Policy):
    """A policy that forgets everything at each change of the edge: lathe, material and position."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._wear: Observations = np.zeros(0, np.float32)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of the environments in the mask, shape (num_envs,)."""
        self._policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        """Return the policy's actions, shape (num_envs, 3)."""
        wear = observations[:, OBS.nominal_wear]
        # Nominal wear falls only when the edge is changed.
        if self._wear.size:
            self._policy.reset(wear < self._wear)
        self._wear = wear.copy()
        return self._policy.act(observations)
