"""Where along a bar the tool is: what the observation does not tell, but follows from what it has told so far.

The tool's path is the sum over sub-steps of cutting speed times feed, and both follow their commands behind known lags. So two
observations and the drawing's geometry give the position exactly, as ``baselines/models/kalman.py`` has it too; where the control says
otherwise, whether the tool is in metal, the control is right.
"""

import math

import torch

from train.commands import Commands
from turning_env import Scenario
from turning_env.physics.quantities import OBS

Tensor = torch.Tensor

"""Place in an observation."""
MAX_TIME = 4.0
"""Time to the end of the bar [s] above which it is all the same."""


class Odometer(torch.nn.Module):
    """Keeps the position. Its state, shape (lanes, 3), is 0 before an episode's first observation.

    Columns: position from the start of the bar's approach [mm]; cutting speed [m/min] and feed [mm/rev] at the last observation.
    """

    STATES = 3
    READINGS = 2

    def __init__(self, scenario: Scenario, commands: Commands) -> None:
        super().__init__()
        control, machine, work = scenario.control, scenario.machine, scenario.workpiece
        self._commands = [commands]  # in a list, so that it is no part of this module
        self._pitch, self._approach = work.bar_length + work.approach, work.approach
        self._per_second = 1000.0 / (60.0 * math.pi * work.diameter)  # mm per s, m/min and mm/rev
        step = control.interval / control.sub_steps
        times = [step * (number + 1) for number in range(control.sub_steps)]
        speeds, feeds = (
            [math.exp(-time / lag) if lag > 0.0 else 0.0 for time in times]
            for lag in (machine.spindle_time_constant, machine.feed_time_constant)
        )
        # Sums over an interval's sub-steps of what is left of a deviation in speed, in feed, and in both [s].
        self._speed_left, self._feed_left = step * sum(speeds), step * sum(feeds)
        self._both_left = step * sum(speed * feed for speed, feed in zip(speeds, feeds, strict=True))
        self._interval = control.interval

    def forward(self, observation: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """(Readings of order one, shape (lanes, READINGS); next state).

        Readings: place between the start of the approach, -1, and the end of the bar, 1; time to that end at the present speed
        and feed, -1 at none, 1 at ``MAX_TIME`` or more.
        """
        (commands,) = self._commands
        along, last_speed, last_feed = state.unbind(dim=-1)
        speed, feed = commands.actual(observation)
        commanded_speed, commanded_feed = commands.in_force(observation)
        late, slow = last_speed - commanded_speed, last_feed - commanded_feed
        travel = self._interval * commanded_speed * commanded_feed + commanded_feed * late * self._speed_left
        travel = travel + commanded_speed * slow * self._feed_left + late * slow * self._both_left
        along = along + torch.where(last_speed > 0.0, travel * self._per_second, 0.0)
        along = torch.where(along >= self._pitch, along - self._pitch, along)
        cutting = observation[..., OBS.cutting] > 0.5
        # In metal, it is the nearer of the bar behind and the bar ahead.
        nearest = torch.where(along < 0.5 * self._approach, self._pitch * (1.0 - 1e-6), self._approach)
        along = torch.where(cutting & (along < self._approach), nearest, along)
        along = torch.where(~cutting & (along > self._approach), 0.5 * self._approach, along)
        left = (self._pitch - along) / (speed * feed * self._per_second)
        readings = torch.stack([2.0 * along / self._pitch - 1.0, 2.0 * left.clamp(max=MAX_TIME) / MAX_TIME - 1.0], dim=-1)
        return readings, torch.stack([along, speed, feed], dim=-1)
