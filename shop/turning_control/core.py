"""The controller core: readings of a machine in, commands out, through the observation on which policies are trained.

``Controller`` knows no machine. An adapter (``linuxcnc.py``) gives it ``Readings`` once per control interval and carries out its
``Commands``. The simulation's own functions compute the observation.
"""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from turning_control.shield import DEFAULT_SETTINGS, LOG, REFUSALS, Settings, Shield

from turning_env.action import commanded
from turning_env.numerics.compilation import compiled_entry
from turning_env.numerics.functions import log
from turning_env.observation import observe
from turning_env.physics.lathe import charge_time_and_life
from turning_env.physics.quantities import layout
from turning_env.physics.records import block_records
from turning_env.physics.wear import EQUIVALENT_TIME
from turning_env.scenario import Scenario
from turning_env.scoring.policy import PolicyFactory

STUCK = 0.5  # time in metal without any change of a reading after which a sensor is stuck [s]; 5 control intervals at least
COMMAND_DELAY = 0.006  # time from readings until LinuxCNC follows [s], if the scenario gives none: measured in the demo
FURTHER = (
    "spindle_heat",
    "roughness_reference",
    "removed_wear",
)  # readings that only some scenarios need


@dataclass(frozen=True)
class Readings:
    """Readings of a machine at the end of a control interval. NaN: it has no such sensor, or the sensor is lost."""

    spindle_speed: float  # [rev/min]
    feed_velocity: float  # [mm/min]
    in_feed: bool  # whether the program moves at feed: no rapid, no pause, no feed hold, no emergency stop
    cutting: bool  # whether the tool is in metal
    engaged_time: float  # time in metal since the readings before [s]
    power: float = math.nan  # [kW]
    thrust_force: float = math.nan  # [N]
    servo_current: float = math.nan  # [A]
    position: float = math.nan  # tool position along the bar, below 0 before it [mm]; without it, the shield integrates the feed
    new_edge: bool = False  # whether the edge has been changed since the readings before
    spindle_heat: float = math.nan  # [-]
    roughness_reference: float = math.nan  # [um]
    removed_wear: float = (
        math.nan
    )  # measured flank wear of the edge that was taken out last, 0 before the first change [mm]


class Status(IntEnum):
    """State of the controller."""

    IDLE = 0  # no feed motion: the policy is not asked
    POLICY = 1  # the policy's command holds
    SHIELD = 2  # the shield has changed the policy's command
    SAFE = 3  # the safe feed holds: no valid answer, or a sensor is lost or stuck
    OPERATOR = 4  # feed hold: the operator must decide


@dataclass(frozen=True)
class Commands:
    """Commands to a machine, which hold until the next."""

    adaptive_feed: float  # share of the highest feed, which the program holds, 0 to 1 [-]
    spindle_override: float  # cutting speed over the programmed one [-]
    status: Status
    reason: str  # one word or a few for the operator's display and the log


class Controller:
    """A policy behind a shield for one machine, for which the scenario of its training is calibrated.

    Attributes:
        safe_feed: share of the highest feed that is safe [-]; an adapter falls back to it without the controller.
        observation: the last observation, float32 of shape (1, entries).
    """

    def __init__(
        self, scenario: Scenario, make_policy: PolicyFactory, settings: Settings = DEFAULT_SETTINGS
    ) -> None:
        self._scenario, self._highest = scenario.nominal(), highest_feed(scenario)
        self.safe_feed = safe_feed(scenario, settings)
        self._shield = Shield(make_policy(1), self._scenario, 1, settings)
        self._states, self._parameters, self._scratches = block_records(self._scenario)
        self.observation = np.zeros((1, len(layout(scenario))), np.float32)
        self._repeats, self._loads_before = 0, (math.nan, math.nan)
        self.start()

    def start(self) -> None:
        """Start anew with a fresh edge: after the operator has released the shield, or for a new job."""
        control = self._scenario.control
        self._set(
            commanded_cutting_speed=control.initial_cutting_speed,
            commanded_feed=control.initial_feed,
        )
        depth = math.log(self._scenario.workpiece.depth_of_cut)
        self._set(log_nominal_depth=depth, cutting_time=0.0, nominal_used_life=0.0)
        self._shield.reset(np.ones(1, np.bool_))

    def lacks(self, readings: Readings) -> list[str]:
        """Return the readings that the policy's observation needs and the machine does not give."""
        further = (name for name in FURTHER if name in layout(self._scenario))
        return [
            name
            for name in ("power", force_reading(self._scenario), *further)
            if math.isnan(getattr(readings, name))
        ]

    def observe(self, readings: Readings) -> NDArray[np.float32]:
        """Return the observation of readings, shape (1, entries); call it once per control interval."""
        machine, diameter = self._scenario.machine, self._scenario.workpiece.diameter
        if readings.new_edge:
            self._set(cutting_time=0.0, nominal_used_life=0.0)
        speed = max(
            readings.spindle_speed * np.pi * diameter / 1000.0, 1e-3 * machine.cutting_speed_min
        )
        feed = max(
            readings.feed_velocity / max(readings.spindle_speed, 1e-9), 1e-3 * machine.feed_min
        )
        self._set(cutting_speed=speed, feed=feed, cutting=int(readings.cutting))
        self._set(
            **{
                f"measured_{name}": getattr(readings, name)
                for name in ("power", "thrust_force", "servo_current")
            }
        )
        self._set(**{name: getattr(readings, name) for name in FURTHER})
        observe_readings(
            self._states,
            self._parameters,
            self._scratches,
            readings.engaged_time / 60.0,
            self.observation,
        )
        return self.observation

    def decide(self, readings: Readings) -> Commands:
        """Return the commands for the next control interval, and log them."""
        commands = self._decided(readings, self.observe(readings))
        LOG.debug(
            "%s: %s: feed %.4f, %s",
            commands.status.name,
            commands.reason,
            commands.adaptive_feed,
            readings,
        )
        return commands

    def _decided(self, readings: Readings, observation: NDArray[np.float32]) -> Commands:
        if self._shield.takeover[0]:
            return Commands(0.0, 1.0, Status.OPERATOR, "takeover")
        turns = (
            self._scenario.machine.cutting_speed_min
            * 1000.0
            / np.pi
            / self._scenario.workpiece.diameter
        )
        if readings.spindle_speed < 0.01 * turns:
            return Commands(
                0.0, 1.0, Status.OPERATOR if readings.in_feed else Status.IDLE, "spindle stopped"
            )
        if not readings.in_feed:
            return self._commands(Status.IDLE, "no feed motion")
        if fault := self._fault(readings):
            LOG.warning("%s: the safe feed holds", fault)
            self._set(commanded_feed=self.safe_feed * self._highest)
            return Commands(self.safe_feed, 1.0, Status.SAFE, fault)
        self._shield.place = (
            None if math.isnan(readings.position) else np.array([readings.position])
        )
        action, state = self._shield.act(observation), self._states
        before = state["commanded_cutting_speed"][0, :1], state["commanded_feed"][0, :1]
        speed, feed = commanded(action, *before, self._scenario)
        self._set(commanded_cutting_speed=speed[0], commanded_feed=feed[0])
        reason = self._shield.reasons[0]
        if self._shield.takeover[0]:
            return Commands(0.0, 1.0, Status.OPERATOR, reason)
        status = (
            Status.SAFE
            if reason in REFUSALS
            else Status.POLICY
            if reason == "passed"
            else Status.SHIELD
        )
        return self._commands(status, reason)

    def _commands(self, status: Status, reason: str) -> Commands:
        feed, speed = (
            float(self._states[name][0, 0])
            for name in ("commanded_feed", "commanded_cutting_speed")
        )
        return Commands(
            min(feed / self._highest, 1.0),
            speed / self._scenario.control.initial_cutting_speed,
            status,
            reason,
        )

    def _fault(self, readings: Readings) -> str:
        """Return the fault of the sensors, or an empty text."""
        if lost := self.lacks(readings):
            return f"no {lost[0]}"
        loads = readings.power, getattr(readings, force_reading(self._scenario))
        repeated = readings.cutting and any(
            now == before for now, before in zip(loads, self._loads_before, strict=True)
        )
        self._repeats, self._loads_before = self._repeats + 1 if repeated else 0, loads
        return (
            "sensor stuck"
            if self._repeats >= max(STUCK / self._scenario.control.interval, 5.0)
            else ""
        )

    def _set(self, **values: float) -> None:
        for name, value in values.items():
            self._states[name][0, 0] = value


def highest_feed(scenario: Scenario) -> float:
    """Return the highest feed that actions command [mm/rev], which the part program holds."""
    control, machine = scenario.control, scenario.machine
    return min(
        control.override_max * control.initial_feed if control.action == "override" else math.inf,
        machine.feed_max,
    )


def safe_feed(scenario: Scenario, settings: Settings = DEFAULT_SETTINGS) -> float:
    """Return the safe feed over the highest [-]."""
    return min(settings.safe_share * scenario.control.initial_feed / highest_feed(scenario), 1.0)


def force_reading(scenario: Scenario) -> str:
    """Return the name of the reading from which the force is known."""
    return "servo_current" if scenario.sensors.force == "servo_current" else "thrust_force"


def on_control(scenario: Scenario) -> Scenario:
    """Return a scenario with the delay of a control, ``COMMAND_DELAY``, if it has none."""
    machine = scenario.machine
    delay = machine.command_delay or min(COMMAND_DELAY, scenario.control.interval)
    return scenario.model_copy(
        update={"machine": machine.model_copy(update={"command_delay": delay})}
    )


@compiled_entry
def observe_readings(states, parameters, scratches, minutes, observations):  # type: ignore[no-untyped-def]
    """Write the observation of the state's readings after ``minutes`` in metal."""
    state, p, scratch = states[0], parameters[0], scratches[0]
    work = scratch.work
    work.log_cutting_speed[0] = log(state.cutting_speed[0])
    work.log_feed[0] = log(state.feed[0])
    work.time[0] = 0.0
    work.cutting_time_before[0] = state.cutting_time[0]
    state.cutting_time[0] += minutes
    charge_time_and_life(state, work, scratch.report, 0, p, p.wear_rule == EQUIVALENT_TIME)
    observe(state, work, 0, 1, p)
    for k in range(observations.shape[1]):
        observations[0, k] = work.observation[p.observation_layout[k], 0]
