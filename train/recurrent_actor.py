"""The network of the agent that is taught in hindsight: a memory of what was seen, and an odometer."""

import torch

from train.actor import Actor
from train.commands import Commands
from train.odometer import Odometer
from turning_env import Scenario

Tensor = torch.Tensor


class RecurrentActor(Actor):
    """A GRU between two layers, beside an odometer, which wants a cutting speed and a feed.

    See ``train/commands.py`` for how it gets there. Its memory: the odometer's state, then the GRU's cells.
    """

    def __init__(self, scenario: Scenario, entries: int, cells: int) -> None:
        super().__init__()
        self.commands = Commands(scenario)
        self.odometer = Odometer(scenario, self.commands)
        self.memory_size = Odometer.STATES + cells
        entries += Odometer.READINGS
        self.encoder = torch.nn.Linear(entries, cells)
        self.memory_cell = torch.nn.GRUCell(cells, cells)
        self.hidden = torch.nn.Linear(cells + entries, cells)
        self.head = torch.nn.Linear(cells, self.commands.wants + self.commands.changes_edges)
        with torch.no_grad():
            self.head.weight.mul_(0.1)
            self.head.bias.zero_()
            if self.commands.changes_edges:
                self.head.bias[-1] = -1.0

    def forward(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        place, cells = memory[:, : Odometer.STATES], memory[:, Odometer.STATES :]
        readings, place = self.odometer(observation, place)
        seen = torch.cat([observation, readings], dim=-1)
        cells = self.memory_cell(torch.relu(self.encoder(seen)), cells)
        wanted = self.bounded(self._unbounded(cells, seen))
        return self.commands.action(wanted, observation), torch.cat([place, cells], dim=-1)

    def unroll(self, observations: Tensor, memory: Tensor, begins: Tensor) -> Tensor:
        """What is wanted in a sequence, before it is bounded, from observations of shape (intervals, lanes, entries).

        Where an episode ``begins``, 1 in shape (intervals, lanes, 1), all before it is forgotten.
        """
        place, cells = memory[:, : Odometer.STATES], memory[:, Odometer.STATES :]
        keeps = 1.0 - begins
        all_readings, all_cells = [], []
        for observation, keep in zip(observations, keeps, strict=True):
            readings, place = self.odometer(observation, place * keep)
            all_readings.append(readings)
        seen = torch.cat([observations, torch.stack(all_readings)], dim=-1)
        for step, keep in zip(torch.relu(self.encoder(seen)), keeps, strict=True):
            cells = self.memory_cell(step, cells * keep)
            all_cells.append(cells)
        return self._unbounded(torch.stack(all_cells), seen)

    def bounded(self, wanted: Tensor) -> Tensor:
        """What is wanted of speed and feed within -1..1; whether to change the edge needs no bounds."""
        return torch.cat([wanted[..., : self.commands.wants].tanh(), wanted[..., self.commands.wants :]], dim=-1)

    def _unbounded(self, cells: Tensor, seen: Tensor) -> Tensor:
        wanted: Tensor = self.head(torch.relu(self.hidden(torch.cat([cells, seen], dim=-1))))
        return wanted
