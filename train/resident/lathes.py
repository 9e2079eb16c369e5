"""Lathes that take and give tensors of their own device: the processor's or the accelerator's, with the same numbers."""

from typing import Any, Protocol

import torch

from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.records import action_size

Tensor = torch.Tensor
Answer = tuple[Tensor, Tensor, Tensor, Tensor]
"""Observations, float32 of shape (lanes, entries), and rewards [s], terminated and truncated, of shape (lanes,)."""


class TensorLathes(Protocol):
    """What learns from lathes needs of them. After an episode's end, the next step ignores its action and starts the next one."""

    device: torch.device
    lanes: int
    actions: int
    """Numbers of an action."""

    def reset(self, seed: int) -> Tensor:
        """Start episode 0 of ``seed + i`` in every lane i; return its observations."""

    def step(self, actions: Tensor) -> Answer:
        """Run one interval; what is returned may be the same memory every time, so copy what is to be kept."""

    def wait(self) -> None:
        """Return when all that has been asked for is done."""


class ProcessorLathes:
    """``RoughTurningVectorEnv``, whose arrays the tensors share."""

    device = torch.device("cpu")

    def __init__(self, scenario: Scenario, lanes: int) -> None:
        self.lanes, self.actions = lanes, action_size(scenario)
        self._env = RoughTurningVectorEnv(lanes, scenario)

    def reset(self, seed: int) -> Tensor:
        """See ``TensorLathes``."""
        return torch.from_numpy(self._env.reset(seed=seed)[0])

    def step(self, actions: Tensor) -> Answer:
        """See ``TensorLathes``."""
        observations, rewards, terminated, truncated, _ = self._env.step(actions.numpy())
        return tuple(map(torch.from_numpy, (observations, rewards, terminated, truncated)))  # type: ignore[return-value]

    def wait(self) -> None:
        """See ``TensorLathes``."""


class AcceleratorLathes:
    """``AcceleratedLathes``, whose memory the tensors share.

    Raises:
        NoAcceleratorError: there is no GPU, or what drives it is missing.
    """

    def __init__(self, scenario: Scenario, lanes: int) -> None:
        from turning_env.accelerator import AcceleratedLathes, NoAcceleratorError

        self._lathes = AcceleratedLathes(lanes, scenario)
        if not torch.cuda.is_available():
            raise NoAcceleratorError("torch finds no GPU: torch with CUDA is needed beside numba-cuda")
        self.device = torch.device("cuda")
        self.lanes, self.actions = lanes, self._lathes.action_size
        shared: Any = (self._lathes.observations, self._lathes.rewards, self._lathes.ends)
        self._observations, self._rewards, self._ends = (torch.as_tensor(array, device=self.device) for array in shared)

    def reset(self, seed: int) -> Tensor:
        """See ``TensorLathes``."""
        self._lathes.reset(seed)
        return self._observations

    def step(self, actions: Tensor) -> Answer:
        """See ``TensorLathes``."""
        self._lathes.step(actions.detach())
        return self._observations, self._rewards, self._ends[0], self._ends[1]

    def wait(self) -> None:
        """See ``TensorLathes``."""
        torch.cuda.synchronize()
        self._lathes.check()


def lathes_on(device: str, scenario: Scenario, lanes: int) -> TensorLathes:
    """Lathes on the device ``cpu`` or ``cuda``.

    Raises:
        NoAcceleratorError: ``cuda``, but there is no GPU, or what drives it is missing.
    """
    return AcceleratorLathes(scenario, lanes) if device == "cuda" else ProcessorLathes(scenario, lanes)
