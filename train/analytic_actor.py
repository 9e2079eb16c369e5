"""The network of the analytic-gradient agent: a GRU between two layers.

The network outputs a target for every quantity that it sets: a position -1..1 in its range. Cutting speed and feed have a
logarithmic scale, as in ``turning_env/observation.py``; an override goes from 0 to its maximum. ``TargetCommands`` converts
targets to actions, and to the resulting commands, differentiably.
"""

import math

import torch

from train.actor import Actor
from turning_env import Scenario
from turning_env.physics.quantities import OBS

Tensor = torch.Tensor

ACTUAL = slice(OBS.cutting_speed, OBS.feed + 1)
COMMANDED = slice(OBS.commanded_cutting_speed, OBS.commanded_feed + 1)
"""Entries of an observation: actual and commanded cutting speed and feed."""


class TargetCommands(torch.nn.Module):
    """A module that converts targets to actions and commands, if actions set the feed (``ACTIONS``), perhaps also the speed."""

    ACTIONS = ("incremental", "override")

    low: Tensor
    span: Tensor
    step: Tensor

    def __init__(self, scenario: Scenario) -> None:
        super().__init__()
        control, machine = scenario.control, scenario.machine
        if control.action not in self.ACTIONS:
            raise ValueError(
                f"control.action is {control.action!r}, but must be {' or '.join(self.ACTIONS)}"
            )
        lows = [math.log(machine.cutting_speed_min), math.log(machine.feed_min)]
        highs = [math.log(machine.cutting_speed_max), math.log(machine.feed_max)]
        self.override = control.action == "override"
        self.changes_edges = control.edge_changes == "commanded"
        self.max_feed = control.override_max * control.initial_feed
        self.min_feed = machine.feed_min
        self.log_programmed_speed = math.log(control.initial_cutting_speed)
        self.targets = 1 if self.override else 2
        """Number of quantities that are set."""
        self.register_buffer("low", torch.tensor(lows))
        self.register_buffer("span", torch.tensor(highs) - torch.tensor(lows))
        self.register_buffer("step", torch.tensor([control.cutting_speed_step, control.feed_step]))

    def action(self, target: Tensor, observation: Tensor) -> Tensor:
        """Return actions, shape (..., actions), for targets, shape (..., targets), followed by the edge-change score if any."""
        if self.override:
            action = target[..., :1]
        else:
            # Positions are close to one another and of order one, so their difference is more exact than that of logarithms.
            action = (
                (target[..., :2] - observation[..., COMMANDED]) * (0.5 * self.span / self.step)
            ).clamp(-1.0, 1.0)
        return (
            torch.cat([action, target[..., -1:].clamp(-1.0, 1.0)], dim=-1)
            if self.changes_edges
            else action
        )

    def commanded(self, target: Tensor, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Return the logarithms of the commanded cutting speed [m/min] and feed [mm/rev], each of shape (...).

        A target out of reach in one step gets the gradient of a target within reach (straight-through estimator).
        """
        if self.override:
            feed = torch.log(
                (0.5 * (target[..., 0] + 1.0) * self.max_feed).clamp(min=self.min_feed)
            )
            return torch.full_like(feed, self.log_programmed_speed), feed
        wanted = self._logarithm(target[..., :2])
        now = self._logarithm(observation[..., COMMANDED])
        reached = torch.maximum(torch.minimum(wanted, now + self.step), now - self.step)
        reached = wanted + (reached - wanted).detach()
        return reached[..., 0], reached[..., 1]

    def speed_and_feed(self, observation: Tensor, entries: slice) -> tuple[Tensor, Tensor]:
        """Return cutting speed [m/min] and feed [mm/rev], each of shape (...), of the entries ``ACTUAL`` or ``COMMANDED``."""
        values = torch.exp(self._logarithm(observation[..., entries]))
        return values[..., 0], values[..., 1]

    def _logarithm(self, position: Tensor) -> Tensor:
        return self.low + 0.5 * (position + 1.0) * self.span


class GruActor(Actor):
    """A GRU of ``cells`` between layers of that size. Its memory holds them; without ``memory`` it begins anew every time."""

    def __init__(self, scenario: Scenario, entries: int, cells: int, memory: bool = True) -> None:
        super().__init__()
        self.commands = TargetCommands(scenario)
        self.remembers = memory
        self.memory_size = cells
        self.encoder = torch.nn.Linear(entries, cells)
        self.memory_cell = torch.nn.GRUCell(cells, cells)
        self.hidden = torch.nn.Linear(cells + entries, cells)
        self.head = torch.nn.Linear(cells, self.commands.targets + self.commands.changes_edges)
        with torch.no_grad():
            self.head.weight.mul_(0.1)
            self.head.bias.zero_()
            if self.commands.changes_edges:
                self.head.bias[-1] = -1.0

    def forward(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        cells = memory if self.remembers else torch.zeros_like(memory)
        cells = self.memory_cell(torch.relu(self.encoder(observation)), cells)
        return self.commands.action(
            self.bounded(self._unbounded(cells, observation)), observation
        ), cells

    def unroll(self, observations: Tensor, cells: Tensor, begins: Tensor) -> Tensor:
        """Return unbounded targets for a sequence of observations, shape (steps, num_envs, entries).

        If an episode begins (``begins`` is 1, shape (steps, num_envs, 1)), the memory is cleared first.
        """
        all_cells = []
        for step, begin in zip(torch.relu(self.encoder(observations)), begins, strict=True):
            cells = self.memory_cell(step, cells * (1.0 - begin) * self.remembers)
            all_cells.append(cells)
        return self._unbounded(torch.stack(all_cells), observations)

    def bounded(self, target: Tensor) -> Tensor:
        """Return targets with speed and feed squashed to -1..1; the edge-change score needs no bounds."""
        free = self.commands.targets
        return torch.cat([target[..., :free].tanh(), target[..., free:]], dim=-1)

    def _unbounded(self, cells: Tensor, observation: Tensor) -> Tensor:
        target: Tensor = self.head(torch.relu(self.hidden(torch.cat([cells, observation], dim=-1))))
        return target
