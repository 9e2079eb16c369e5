"""The network of the analytic-gradient agent: a GRU between two layers.

The network outputs a target for every quantity that it sets: a position -1..1 in its range. Cutting
speed and feed have a logarithmic scale, as in ``turning_env/observation.py``; an override goes from
0 to its maximum. ``TargetCommands`` converts targets to actions, and to the resulting commands,
differentiably. What the network learns from is left to ``analytic_gradient.py``.
"""

import math
from typing import NamedTuple

import torch

from train.actor import Actor
from turning_env import Scenario
from turning_env.physics.quantities import OBS

Tensor = torch.Tensor

ACTUAL = slice(OBS.cutting_speed, OBS.feed + 1)
COMMANDED = slice(OBS.commanded_cutting_speed, OBS.commanded_feed + 1)
"""Entries of an observation: actual and commanded cutting speed and feed."""


class SpeedAndFeed(NamedTuple):
    """Cutting speed [m/min] and feed [mm/rev], or their logarithms, each of shape (...)."""

    speed: Tensor
    feed: Tensor


class TargetCommands(torch.nn.Module):
    """A module that converts targets to actions and commands.

    The scenario's actions must set the feed (``ACTIONS``); they may also set the speed.

    Raises:
        ValueError: the scenario has other actions.
    """

    ACTIONS = ("incremental", "override")

    low: Tensor
    span: Tensor
    step: Tensor

    def __init__(self, scenario: Scenario) -> None:
        super().__init__()
        control = scenario.control
        machine = scenario.machine
        if control.action not in self.ACTIONS:
            raise ValueError(
                f"control.action is {control.action!r}, but must be {' or '.join(self.ACTIONS)}"
            )
        self.override = control.action == "override"
        self.changes_edges = control.edge_changes == "commanded"
        self.max_feed = control.override_max * control.initial_feed
        self.min_feed = machine.feed_min
        self.log_programmed_speed = math.log(control.initial_cutting_speed)
        self.targets = 1 if self.override else 2
        """Number of quantities that are set."""

        # Logarithmic scales of speed and feed: smallest value, range, and largest change in a step.
        log_min = torch.tensor([math.log(machine.cutting_speed_min), math.log(machine.feed_min)])
        log_max = torch.tensor([math.log(machine.cutting_speed_max), math.log(machine.feed_max)])
        self.register_buffer("low", log_min)
        self.register_buffer("span", log_max - log_min)
        self.register_buffer("step", torch.tensor([control.cutting_speed_step, control.feed_step]))

    def action(self, target: Tensor, observation: Tensor) -> Tensor:
        """Return actions, shape (..., actions).

        Targets have the shape (..., targets), and an edge-change score follows them if there is
        one.
        """
        if self.override:
            action = target[..., :1]
        else:
            # Positions are close to one another and of order one, so their difference is more exact
            # than that of logarithms.
            distance = target[..., :2] - observation[..., COMMANDED]
            steps = distance * (0.5 * self.span / self.step)
            action = steps.clamp(-1.0, 1.0)
        if not self.changes_edges:
            return action
        change_score = target[..., -1:].clamp(-1.0, 1.0)
        return torch.cat([action, change_score], dim=-1)

    def commanded(self, target: Tensor, observation: Tensor) -> SpeedAndFeed:
        """Return the logarithms of the commanded cutting speed and feed.

        A target out of reach in one step gets the gradient of a target within reach
        (straight-through estimator).
        """
        if self.override:
            feed = (0.5 * (target[..., 0] + 1.0) * self.max_feed).clamp(min=self.min_feed)
            log_feed = torch.log(feed)
            log_speed = torch.full_like(log_feed, self.log_programmed_speed)
            return SpeedAndFeed(log_speed, log_feed)
        wanted = self._logarithm(target[..., :2])
        present = self._logarithm(observation[..., COMMANDED])
        reached = torch.minimum(wanted, present + self.step)
        reached = torch.maximum(reached, present - self.step)
        reached = wanted + (reached - wanted).detach()
        return SpeedAndFeed(reached[..., 0], reached[..., 1])

    def speed_and_feed(self, observation: Tensor, entries: slice) -> SpeedAndFeed:
        """Return cutting speed and feed of the entries ``ACTUAL`` or ``COMMANDED``."""
        values = torch.exp(self._logarithm(observation[..., entries]))
        return SpeedAndFeed(values[..., 0], values[..., 1])

    def _logarithm(self, position: Tensor) -> Tensor:
        return self.low + 0.5 * (position + 1.0) * self.span


class GruActor(Actor):
    """A GRU of ``cells`` between layers of that size.

    Its memory holds the cells. Without ``memory``, they are cleared before every observation.
    """

    def __init__(self, scenario: Scenario, entries: int, cells: int, memory: bool = True) -> None:
        super().__init__()
        self.commands = TargetCommands(scenario)
        self.remembers = memory
        self.memory_size = cells
        self.encoder = torch.nn.Linear(entries, cells)
        self.memory_cell = torch.nn.GRUCell(cells, cells)
        self.hidden: torch.nn.Module = torch.nn.Linear(cells + entries, cells)
        outputs = self.commands.targets + self.commands.changes_edges
        self.head = torch.nn.Linear(cells, outputs)
        # The first targets are near the middles of the ranges, and edges are not changed: both
        # leave room for gradients.
        with torch.no_grad():
            self.head.weight.mul_(0.1)
            self.head.bias.zero_()
            if self.commands.changes_edges:
                self.head.bias[-1] = -1.0

    def forward(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        cells = memory if self.remembers else torch.zeros_like(memory)
        cells = self.memory_cell(torch.relu(self.encoder(observation)), cells)
        target = self.bounded(self._unbounded(cells, observation))
        return self.commands.action(target, observation), cells

    def unroll(self, observations: Tensor, cells: Tensor, begins: Tensor) -> Tensor:
        """Return unbounded targets for a sequence of observations.

        Args:
            observations: shape (steps, num_envs, entries).
            cells: memory before the first step, shape (num_envs, cells).
            begins: 1 where an episode begins, which clears the memory first, else 0; shape (steps,
                num_envs, 1).
        """
        encoded = torch.relu(self.encoder(observations))
        cells_of_steps = []
        for step, begin in zip(encoded, begins, strict=True):
            cells = self.memory_cell(step, cells * (1.0 - begin) * self.remembers)
            cells_of_steps.append(cells)
        return self._unbounded(torch.stack(cells_of_steps), observations)

    def bounded(self, target: Tensor) -> Tensor:
        """Return targets with speed and feed squashed to -1..1.

        The edge-change score needs no bounds.
        """
        targets = self.commands.targets
        squashed = target[..., :targets].tanh()
        return torch.cat([squashed, target[..., targets:]], dim=-1)

    def _unbounded(self, cells: Tensor, observation: Tensor) -> Tensor:
        hidden = torch.relu(self.hidden(torch.cat([cells, observation], dim=-1)))
        target: Tensor = self.head(hidden)
        return target
