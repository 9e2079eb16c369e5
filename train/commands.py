"""From what an agent wants to the action that gets there, and to what is then commanded, differentiably.

An agent wants a place -1..1 in the range of every quantity that it sets, as ``turning_env/observation.py`` scales them: cutting
speed and feed on a logarithmic scale, an override from 0 to its most. How far it gets in one interval is the control's business.
"""

import math

import torch

from turning_env import Scenario
from turning_env.physics.quantities import OBS

Tensor = torch.Tensor

ACTUAL = slice(OBS.cutting_speed, OBS.feed + 1)
COMMANDED = slice(OBS.commanded_cutting_speed, OBS.commanded_feed + 1)
"""Places of cutting speed and feed in an observation."""


class Commands(torch.nn.Module):
    """Actions and commands of a scenario whose action sets the feed, with or without the cutting speed, by the interval.

    Raises:
        ValueError: actions of the scenario set whole parts, or set points that are not on a logarithmic scale.
    """

    ACTIONS = ("incremental", "override")

    low: Tensor
    span: Tensor
    step: Tensor

    def __init__(self, scenario: Scenario) -> None:
        super().__init__()
        control, machine = scenario.control, scenario.machine
        if control.action not in self.ACTIONS:
            raise ValueError(f"control.action is {control.action!r}, but must be {' or '.join(self.ACTIONS)}")
        lows = [math.log(machine.cutting_speed_min), math.log(machine.feed_min)]
        highs = [math.log(machine.cutting_speed_max), math.log(machine.feed_max)]
        self.override = control.action == "override"
        self.changes_edges = control.edge_changes == "commanded"
        self.most_feed = control.override_max * control.initial_feed
        self.least_feed = machine.feed_min
        self.log_programmed_speed = math.log(control.initial_cutting_speed)
        self.wants = 1 if self.override else 2
        """Quantities that are set."""
        self.register_buffer("low", torch.tensor(lows))
        self.register_buffer("span", torch.tensor(highs) - torch.tensor(lows))
        self.register_buffer("step", torch.tensor([control.cutting_speed_step, control.feed_step]))

    def action(self, wanted: Tensor, observation: Tensor) -> Tensor:
        """Action, shape (..., actions), for what is wanted, shape (..., wants), and whether to change the edge behind it."""
        if self.override:
            action = wanted[..., :1]
        else:
            # Places are near one another and of order one: of logarithms the difference would be less exact.
            action = ((wanted[..., :2] - observation[..., COMMANDED]) * (0.5 * self.span / self.step)).clamp(-1.0, 1.0)
        return torch.cat([action, wanted[..., -1:].clamp(-1.0, 1.0)], dim=-1) if self.changes_edges else action

    def commanded(self, wanted: Tensor, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Logarithms of the commanded cutting speed [m/min] and feed [mm/rev], each of shape (...).

        What is out of reach in one interval has the gradient that it would have within: it is still what is wanted.
        """
        if self.override:
            feed = torch.log((0.5 * (wanted[..., 0] + 1.0) * self.most_feed).clamp(min=self.least_feed))
            return torch.full_like(feed, self.log_programmed_speed), feed
        target = self._logarithm(wanted[..., :2])
        now = self._logarithm(observation[..., COMMANDED])
        reached = torch.maximum(torch.minimum(target, now + self.step), now - self.step)
        reached = target + (reached - target).detach()
        return reached[..., 0], reached[..., 1]

    def actual(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Actual cutting speed [m/min] and feed [mm/rev], each of shape (...)."""
        return self._speed_and_feed(observation[..., ACTUAL])

    def in_force(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Commanded cutting speed [m/min] and feed [mm/rev] of the last interval, each of shape (...)."""
        return self._speed_and_feed(observation[..., COMMANDED])

    def _speed_and_feed(self, places: Tensor) -> tuple[Tensor, Tensor]:
        values = torch.exp(self._logarithm(places))
        return values[..., 0], values[..., 1]

    def _logarithm(self, place: Tensor) -> Tensor:
        return self.low + 0.5 * (place + 1.0) * self.span
