"""A controller in a closed loop with the plant, between which a test can spoil the readings."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from turning_control.core import Commands, Controller, Status, highest_feed, on_control
from turning_control.plant import Plant
from turning_control.readings import Readings, force_reading

from turning_env.physics.drives import lag_share
from turning_env.physics.quantities import action_size
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario import Scenario

RAPID_TIME = 0.5  # time of the return to the next bar [s]


class Always(Policy):
    """Gives one number as every entry of its actions: 1 asks for the highest speed and feed."""

    def __init__(self, scenario: Scenario, action: float) -> None:
        self._size = action_size(scenario)
        self._action = action

    def act(self, observations: Observations) -> Actions:
        return np.full((len(observations), self._size), self._action, np.float32)


Spoil = Callable[[Readings], Readings]


@dataclass
class Course:
    """What happened on the lathe in the steps of a test."""

    feeds: list[float] = field(default_factory=list)  # adaptive feeds [-]
    statuses: list[str] = field(default_factory=list)
    engaged: list[float] = field(default_factory=list)  # time in metal [s]
    severe: list[float] = field(default_factory=list)  # time more than 5 % over a limit [s]

    def severe_share(self) -> float:
        """Return the share of cutting time in severe overload [-]."""
        return sum(self.severe) / max(sum(self.engaged), 1e-9)


class ClosedLoop:
    """A lathe that turns bars: the controller, the drives, the plant and its sensors.

    Args:
        scenario: what the lathe and its policy are.
        seed: determines bars and edges.
        start: tool position along the bar at the beginning, below 0 before it [mm].
        action: every entry of the policy's actions.

    Attributes:
        obeys: whether the program lets the controller scale its feed, as ``M52 P1`` does.
            Otherwise the tool moves at the programmed feed.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int = 1,
        start: float | None = None,
        action: float = 1.0,
    ) -> None:
        self.scenario = on_control(scenario)
        self.controller = Controller(self.scenario, lambda num_envs: Always(self.scenario, action))
        self.obeys = True
        self.safe_feed = self.controller.safe_feed
        self.plant = Plant(self.scenario, seed)
        self.interval = self.scenario.control.interval
        work = self.scenario.workpiece
        self._turns = 1000.0 * self.scenario.control.initial_cutting_speed / np.pi / work.diameter
        self._start = -work.approach if start is None else start
        self.position = self._start
        self._feed = self.scenario.control.initial_feed
        self._spindle_speed = self._turns
        self._edges = 0.0
        self._rapid = 0.0  # time left of a return [s]
        self.commands = Commands(self.safe_feed, 1.0, status=Status.IDLE, reason="")
        self.course = Course()

    def step(self, spoil: Spoil = lambda readings: readings) -> Commands:
        """Move for a control interval, then let the controller decide on spoiled readings."""
        self.commands = self.controller.decide(spoil(self._move()))
        self.course.feeds.append(self.commands.adaptive_feed)
        self.course.statuses.append(self.commands.status.name)
        return self.commands

    def _move(self) -> Readings:
        """Move for a control interval; return the true readings at its end."""
        machine = self.scenario.machine
        work = self.scenario.workpiece
        wanted_feed = self.scenario.control.initial_feed
        if self.obeys:
            wanted_feed = self.commands.adaptive_feed * highest_feed(self.scenario)
        wanted_turns = self.commands.spindle_override * self._turns
        feed_share = lag_share(self.interval, machine.feed_time_constant)
        self._feed += feed_share * (wanted_feed - self._feed)
        turns_share = lag_share(self.interval, machine.spindle_time_constant)
        self._spindle_speed += turns_share * (wanted_turns - self._spindle_speed)

        if self.position >= work.bar_length:
            self.position = self._start
            self._rapid = RAPID_TIME
        in_feed = self._rapid <= 0.0
        velocity = 0.0  # [mm/s]
        if in_feed:
            velocity = self._feed * self._spindle_speed / 60.0
            self.position += velocity * self.interval
        self._rapid -= self.interval
        values = self.plant.advance(
            self.interval,
            along=work.approach + self.position,
            spindle_speed=self._spindle_speed,
            velocity=velocity,
            in_feed=in_feed,
        )
        self.course.engaged.append(values["engaged_time"])
        self.course.severe.append(values["severe_overload_time"])
        new_edge = values["edge"] != self._edges
        self._edges = values["edge"]
        force = force_reading(self.scenario)
        return Readings(
            spindle_speed=self._spindle_speed,
            feed_velocity=60.0 * velocity,
            in_feed=in_feed,
            # Whether the tool is in metal now; it may have left the bar in this interval.
            cutting=values["engaged_time"] > 0.0 and bool(values["cutting"]),
            engaged_time=values["engaged_time"],
            power=values["measured_power"],
            position=self.position,
            new_edge=new_edge,
            spindle_heat=0.1,
            roughness_reference=2.0,
            removed_wear=0.0,
            **{force: values[f"measured_{force}"]},
        )
