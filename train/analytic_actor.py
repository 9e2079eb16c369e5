"""The network of the analytic-gradient agent: a GRU beside an exact tracker of the tool's position along the bar.

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
"""Entries of an observation: actual and commanded cutting speed and feed, and whether the tool is in metal."""
MAX_TIME = 4.0
"""Time to the end of the bar [s] beyond which the reading is constant."""


class TargetCommands(torch.nn.Module):
    """A module that converts targets to actions and commands, if actions set the feed, with or without the cutting speed.

    Raises:
        ValueError: the scenario's action is not one of ``ACTIONS``.
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
            action = ((target[..., :2] - observation[..., COMMANDED]) * (0.5 * self.span / self.step)).clamp(-1.0, 1.0)
        return torch.cat([action, target[..., -1:].clamp(-1.0, 1.0)], dim=-1) if self.changes_edges else action

    def commanded(self, target: Tensor, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Return the logarithms of the commanded cutting speed [m/min] and feed [mm/rev], each of shape (...).

        A target out of reach in one step gets the gradient of a target within reach (straight-through estimator).
        """
        if self.override:
            feed = torch.log((0.5 * (target[..., 0] + 1.0) * self.max_feed).clamp(min=self.min_feed))
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


class DistanceTracker:
    """A tracker of the tool's position along the bar, which observations determine but do not contain.

    The travelled distance is a sum of cutting speed times feed over sub-steps, and both follow their commands with known lags.
    So two observations and the drawing's geometry give the position exactly, as in ``baselines/models/kalman_steps.py``. If the
    position contradicts the entry ``cutting``, it is corrected.

    The state, shape (num_envs, 3), is 0 before an episode's first observation. Its columns are the position from the start of
    the approach [mm], and cutting speed [m/min] and feed [mm/rev] at the last observation.
    """

    STATES = 3
    READINGS = 2

    def __init__(self, scenario: Scenario, commands: TargetCommands) -> None:
        control, machine, work = scenario.control, scenario.machine, scenario.workpiece
        self._commands = commands
        self._pitch, self._approach = work.bar_length + work.approach, work.approach
        self._per_second = 1000.0 / (60.0 * math.pi * work.diameter)  # mm per s, m/min and mm/rev
        step = control.interval / control.sub_steps
        times = [step * (number + 1) for number in range(control.sub_steps)]
        speeds, feeds = (
            [math.exp(-time / lag) if lag > 0.0 else 0.0 for time in times]
            for lag in (machine.spindle_time_constant, machine.feed_time_constant)
        )
        # Sums over a control interval's sub-steps of the remaining deviation in speed, in feed, and in both [s].
        self._speed_left, self._feed_left = step * sum(speeds), step * sum(feeds)
        self._both_left = step * sum(speed * feed for speed, feed in zip(speeds, feeds, strict=True))
        self._interval = control.interval

    def __call__(self, observation: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Return readings of order one, shape (num_envs, READINGS), and the next state.

        The first is the position, from -1 at the start of the approach to 1 at the end of the bar. The second is the time to that
        end at the present speed and feed, from -1 for 0 to 1 for ``MAX_TIME`` or more.
        """
        along, last_speed, last_feed = state.unbind(dim=-1)
        speed, feed = self._commands.speed_and_feed(observation, ACTUAL)
        commanded_speed, commanded_feed = self._commands.speed_and_feed(observation, COMMANDED)
        late, slow = last_speed - commanded_speed, last_feed - commanded_feed
        travel = self._interval * commanded_speed * commanded_feed + commanded_feed * late * self._speed_left
        travel = travel + commanded_speed * slow * self._feed_left + late * slow * self._both_left
        along = along + torch.where(last_speed > 0.0, travel * self._per_second, 0.0)
        along = torch.where(along >= self._pitch, along - self._pitch, along)
        cutting = observation[..., OBS.cutting] > 0.5
        # In metal, take the nearer of the bars behind and ahead.
        nearest = torch.where(along < 0.5 * self._approach, self._pitch * (1.0 - 1e-6), self._approach)
        along = torch.where(cutting & (along < self._approach), nearest, along)
        along = torch.where(~cutting & (along > self._approach), 0.5 * self._approach, along)
        left = (self._pitch - along) / (speed * feed * self._per_second)
        readings = torch.stack([2.0 * along / self._pitch - 1.0, 2.0 * left.clamp(max=MAX_TIME) / MAX_TIME - 1.0], dim=-1)
        return readings, torch.stack([along, speed, feed], dim=-1)


class NoTracker:
    """A tracker without state and readings, for an agent that does not observe its position."""

    STATES = READINGS = 0

    def __call__(self, observation: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Return no readings and no state, each of shape (num_envs, 0)."""
        return observation[..., :0], state


class GruActor(Actor):
    """A GRU between two layers, beside a distance tracker. Its memory holds the tracker's state, then the GRU's cells.

    Args:
        scenario: scenario of the training.
        entries: number of entries of an observation.
        cells: size of the GRU and of the layers around it.
        position: whether there is a tracker.
        memory: whether the GRU remembers; otherwise it begins anew with every observation.
    """

    def __init__(self, scenario: Scenario, entries: int, cells: int, position: bool = True, memory: bool = True) -> None:
        super().__init__()
        self.commands = TargetCommands(scenario)
        self.tracker = DistanceTracker(scenario, self.commands) if position else NoTracker()
        self.remembers = memory
        self.memory_size = self.tracker.STATES + cells
        entries += self.tracker.READINGS
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
        states = self.tracker.STATES
        readings, state = self.tracker(observation, memory[:, :states])
        seen, cells = torch.cat([observation, readings], dim=-1), memory[:, states:]
        if not self.remembers:
            cells = torch.zeros_like(cells)
        cells = self.memory_cell(torch.relu(self.encoder(seen)), cells)
        target = self.bounded(self._unbounded(cells, seen))
        return self.commands.action(target, seen), torch.cat([state, cells], dim=-1)

    def unroll(self, observations: Tensor, memory: Tensor, begins: Tensor) -> Tensor:
        """Return unbounded targets for a sequence of observations, shape (steps, num_envs, entries).

        If an episode begins (``begins`` is 1, shape (steps, num_envs, 1)), the memory is cleared first.
        """
        states, all_seen, all_cells = self.tracker.STATES, [], []
        state, cells = memory[:, :states], memory[:, states:]
        for observation, begin in zip(observations, begins, strict=True):
            readings, state = self.tracker(observation, state * (1.0 - begin))
            all_seen.append(torch.cat([observation, readings], dim=-1))
        seen = torch.stack(all_seen)
        for step, begin in zip(torch.relu(self.encoder(seen)), begins, strict=True):
            cells = self.memory_cell(step, cells * (1.0 - begin) * self.remembers)
            all_cells.append(cells)
        return self._unbounded(torch.stack(all_cells), seen)

    def bounded(self, target: Tensor) -> Tensor:
        """Return targets with speed and feed squashed to -1..1; the edge-change score needs no bounds."""
        free = self.commands.targets
        return torch.cat([target[..., :free].tanh(), target[..., free:]], dim=-1)

    def _unbounded(self, cells: Tensor, seen: Tensor) -> Tensor:
        target: Tensor = self.head(torch.relu(self.hidden(torch.cat([cells, seen], dim=-1))))
        return target
