"""Tiny untrained agents and their files."""

import functools
from pathlib import Path

import torch

from train.actor import Actor, Feedforward
from train.export import metadata, to_onnx
from train.run import Run
from turning_env import Scenario

SCENARIO = Scenario.model_validate({"name": "short", "control": {"time_limit": 0.2}})


class Counter(Actor):
    """An LSTM, and the number of calls since the start."""

    def __init__(self) -> None:
        super().__init__()
        self.lstm = torch.nn.LSTM(11, 3)
        self.memory_size = 7

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        hidden, cell, count = memory.unsqueeze(0).split((3, 3, 1), dim=2)
        output, (hidden, cell) = self.lstm(observation.unsqueeze(0), (hidden.contiguous(), cell.contiguous()))
        action = output.squeeze(0)[:, :2] + 0.01 * count.squeeze(0)
        return action.clamp(-1.0, 1.0), torch.cat((hidden, cell, count + 1.0), dim=2).squeeze(0)


def memoryless(seed: int = 0) -> Actor:
    """Two layers."""
    torch.manual_seed(seed)
    return Feedforward(torch.nn.Linear(11, 16), torch.nn.ReLU(), torch.nn.Linear(16, 2)).eval()


def remembering(seed: int = 0) -> Actor:
    """An agent with a memory."""
    torch.manual_seed(seed)
    return Counter().eval()


def run(folder: Path, seed: int = 0, algorithm: str = "ppo") -> Run:
    """A run that was never trained."""
    return Run(algorithm, "RoughTurning-v0", SCENARIO, seed, {"steps": 1000, "discount": 0.8}, "train it", folder)


@functools.cache
def content(memory: bool = False, seed: int = 0, algorithm: str = "ppo") -> bytes:
    """What an agent's file holds."""
    actor = remembering(seed) if memory else memoryless(seed)
    with torch.no_grad():
        return to_onnx(actor, metadata(run(Path(), seed, algorithm)))


def write(folder: Path, seed: int = 0, algorithm: str = "ppo", memory: bool = False) -> Path:
    """An agent's file in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{algorithm}-seed{seed}.onnx"
    path.write_bytes(content(memory, seed, algorithm))
    return path
