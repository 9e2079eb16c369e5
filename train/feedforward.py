"""An agent whose action is a function of the present observation."""

import torch

from train.actor import Actor


class Feedforward(Actor):
    """The output of layers, clipped to -1..1."""

    def __init__(self, *layers: torch.nn.Module) -> None:
        """``layers`` lead from observations to actions."""
        super().__init__()
        self.layers = torch.nn.Sequential(*layers)

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.layers(observation).clamp(-1.0, 1.0), memory
