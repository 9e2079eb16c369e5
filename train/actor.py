"""Actors, the form in which trained agents play: PyTorch modules with a memory."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from turning_env.policy import Actions, Observations


class Actor(torch.nn.Module):
    """A module that returns an agent's most likely action.

    It includes scaling, memory and clipping. ``forward(observation, memory)`` takes float32 tensors
    of shape (num_envs, entries) and (num_envs, memory_size). It returns the action in -1..1 of
    shape (num_envs, actions) and the memory for the next call. The memory is 0 before an episode's
    first observation.
    """

    memory_size: int = 0
    """Size of the memory; 0: the action is a function of the present observation."""

    def forward(
        self, observation: torch.Tensor, memory: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the action and the next memory."""
        raise NotImplementedError


class Feedforward(Actor):
    """An agent without memory: layers with outputs clipped to -1..1."""

    def __init__(self, *layers: torch.nn.Module) -> None:
        super().__init__()
        self.layers = torch.nn.Sequential(*layers)

    def forward(
        self, observation: torch.Tensor, memory: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        return self.layers(observation).clamp(-1.0, 1.0), memory


class ActorPolicy:
    """The policy of an actor, for ``num_envs`` environments."""

    def __init__(self, actor: Actor, num_envs: int) -> None:
        self._actor = actor
        self._memory = torch.zeros(num_envs, actor.memory_size)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of the environments in the mask, shape (num_envs,)."""
        self._memory[torch.from_numpy(mask)] = 0.0

    def act(self, observations: Observations) -> Actions:
        """Return actions, shape (num_envs, actions), for observations, shape (num_envs, entries).

        Both are float32.
        """
        with torch.no_grad():
            action, self._memory = self._actor(torch.from_numpy(observations), self._memory)
        actions: NDArray[Any] = action.numpy()
        return actions
