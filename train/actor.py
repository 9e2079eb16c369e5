"""What every trained agent is when it plays: a module from observation and memory to action and memory."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from turning_env.score.policy import Actions, Observations


class Actor(torch.nn.Module):
    """An agent's most likely action, with everything that belongs to it inside: scaling, memory, clipping.

    ``forward(observation, memory)`` takes float32 tensors of shape (lanes, entries) and (lanes, memory_size), and gives the
    action in -1..1 of shape (lanes, actions) and the memory for the next call. Before an episode's first observation the memory
    is 0.
    """

    memory_size: int = 0
    """0: the action is a function of the present observation."""

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Action and next memory."""
        raise NotImplementedError


class ActorPolicy:
    """An actor that controls ``lanes`` lanes."""

    def __init__(self, actor: Actor, num_envs: int) -> None:
        self._actor = actor
        self._memory = torch.zeros(num_envs, actor.memory_size)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget these lanes."""
        self._memory[torch.from_numpy(mask)] = 0.0

    def act(self, observations: Observations) -> Actions:
        """Actions for observations, both float32 and of one row per lane."""
        with torch.no_grad():
            action, self._memory = self._actor(torch.from_numpy(observations), self._memory)
        result: NDArray[Any] = action.numpy()
        return result
