"""The controller core: readings of a machine in, commands out.

``Controller`` knows no machine. An adapter (``linuxcnc.py``, ``opcua.py``) gives it ``Readings``
once per control interval and carries out its ``Commands``. The simulation's own functions compute
the observation, so a policy sees what it was trained on. ``shield.py`` guards the policy.
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

# A reading that does not change while the tool cuts is stuck after this time [s], and not before
# this number of control intervals.
STUCK_TIME = 0.5
STUCK_INTERVALS = 5.0
# Delay from readings until LinuxCNC follows [s], if the scenario gives none: measured in the demo.
COMMAND_DELAY = 0.006
# Readings that only some scenarios need.
FURTHER = ("spindle_heat", "roughness_reference", "removed_wear")


@dataclass(frozen=True)
class Readings:
    """Readings of a machine at the end of a control interval.

    NaN: the machine has no such sensor, or the sensor is lost.
    """

    spindle_speed: float  # [rev/min]
    feed_velocity: float  # [mm/min]
    # Whether the program moves at feed: no rapid, no pause, no feed hold, no emergency stop.
    in_feed: bool
    cutting: bool  # whether the tool is in metal
    engaged_time: float  # time in metal since the last readings [s]
    power: float = math.nan  # [kW]
    thrust_force: float = math.nan  # [N]
    servo_current: float = math.nan  # [A]
    # Tool position along the bar, below 0 before it [mm]. NaN: the shield integrates the feed.
    position: float = math.nan
    new_edge: bool = False  # whether the edge has been changed since the last readings
    spindle_heat: float = math.nan  # [-]
    roughness_reference: float = math.nan  # [um]
    # Measured flank wear of the edge that was taken out last, 0 before the first change [mm].
    removed_wear: float = math.nan


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


def feed_hold(status: Status, reason: str) -> Commands:
    """Return the commands that stop the feed."""
    return Commands(adaptive_feed=0.0, spindle_override=1.0, status=status, reason=reason)


class Controller:
    """A policy behind a shield for one machine.

    The scenario that the policy was trained on must be calibrated to this machine.

    Attributes:
        safe_feed: share of the highest feed that is safe [-]; an adapter falls back to it without
            the controller.
        observation: the last observation, float32 of shape (1, entries).
    """

    def __init__(
        self, scenario: Scenario, make_policy: PolicyFactory, settings: Settings = DEFAULT_SETTINGS
    ) -> None:
        self._scenario = scenario.nominal()
        self._highest_feed = highest_feed(scenario)
        self.safe_feed = safe_feed(scenario, settings)
        self._shield = Shield(make_policy(1), self._scenario, 1, settings)
        self._states, self._parameters, self._scratches = block_records(self._scenario)
        self.observation = np.zeros((1, len(layout(scenario))), np.float32)
        self._repeats = 0  # control intervals in a row in which a load did not change
        self._loads_before = (math.nan, math.nan)
        self.start()

    def start(self) -> None:
        """Start with a fresh edge: after a takeover, or for a new job."""
        control = self._scenario.control
        self._set(
            commanded_cutting_speed=control.initial_cutting_speed,
            commanded_feed=control.initial_feed,
            log_nominal_depth=math.log(self._scenario.workpiece.depth_of_cut),
            cutting_time=0.0,
            nominal_used_life=0.0,
        )
        self._shield.reset(np.ones(1, np.bool_))

    def lacks(self, readings: Readings) -> list[str]:
        """Return the readings that the policy's observation needs and the machine does not give."""
        observed = layout(self._scenario)
        needed = ["power", force_reading(self._scenario)]
        for name in FURTHER:
            if name in observed:
                needed.append(name)
        return [name for name in needed if math.isnan(getattr(readings, name))]

    def observe(self, readings: Readings) -> NDArray[np.float32]:
        """Return the observation of readings, shape (1, entries).

        Call it once per control interval, because it counts the edge's time.
        """
        machine = self._scenario.machine
        diameter = self._scenario.workpiece.diameter
        if readings.new_edge:
            self._set(cutting_time=0.0, nominal_used_life=0.0)
        speed = readings.spindle_speed * np.pi * diameter / 1000.0
        feed = readings.feed_velocity / max(readings.spindle_speed, 1e-9)
        self._set(
            # A standstill has no logarithm.
            cutting_speed=max(speed, 1e-3 * machine.cutting_speed_min),
            feed=max(feed, 1e-3 * machine.feed_min),
            cutting=int(readings.cutting),
            measured_power=readings.power,
            measured_thrust_force=readings.thrust_force,
            measured_servo_current=readings.servo_current,
            spindle_heat=readings.spindle_heat,
            roughness_reference=readings.roughness_reference,
            removed_wear=readings.removed_wear,
        )
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
        commands = self._commands(readings, self.observe(readings))
        LOG.debug(
            "%s: %s: feed %.4f, %s",
            commands.status.name,
            commands.reason,
            commands.adaptive_feed,
            readings,
        )
        return commands

    def _commands(self, readings: Readings, observation: NDArray[np.float32]) -> Commands:
        if self._shield.takeover[0]:
            return feed_hold(Status.OPERATOR, "takeover")
        lowest_speed = self._scenario.machine.cutting_speed_min
        lowest_turns = lowest_speed * 1000.0 / np.pi / self._scenario.workpiece.diameter
        if readings.spindle_speed < 0.01 * lowest_turns:
            status = Status.OPERATOR if readings.in_feed else Status.IDLE
            return feed_hold(status, "spindle stopped")
        if not readings.in_feed:
            return self._present_commands(Status.IDLE, "no feed motion")
        fault = self._fault(readings)
        if fault:
            LOG.warning("%s: the safe feed holds", fault)
            self._set(commanded_feed=self.safe_feed * self._highest_feed)
            return Commands(self.safe_feed, 1.0, status=Status.SAFE, reason=fault)
        return self._ask_policy(readings, observation)

    def _ask_policy(self, readings: Readings, observation: NDArray[np.float32]) -> Commands:
        """Return the commands of the policy behind the shield."""
        self._shield.place = None
        if not math.isnan(readings.position):
            self._shield.place = np.array([readings.position])
        speed, feed = commanded(
            self._shield.act(observation),
            self._states["commanded_cutting_speed"][0, :1],
            feed=self._states["commanded_feed"][0, :1],
            scenario=self._scenario,
        )
        self._set(commanded_cutting_speed=speed[0], commanded_feed=feed[0])

        reason = self._shield.reasons[0]
        if self._shield.takeover[0]:
            return feed_hold(Status.OPERATOR, reason)
        if reason in REFUSALS:
            return self._present_commands(Status.SAFE, reason)
        if reason == "passed":
            return self._present_commands(Status.POLICY, reason)
        return self._present_commands(Status.SHIELD, reason)

    def _present_commands(self, status: Status, reason: str) -> Commands:
        """Return the commanded speed and feed as commands to the machine."""
        feed = float(self._states["commanded_feed"][0, 0])
        speed = float(self._states["commanded_cutting_speed"][0, 0])
        return Commands(
            adaptive_feed=min(feed / self._highest_feed, 1.0),
            spindle_override=speed / self._scenario.control.initial_cutting_speed,
            status=status,
            reason=reason,
        )

    def _fault(self, readings: Readings) -> str:
        """Return the fault of the sensors, or an empty text.

        Call it once per control interval, because it counts unchanged readings.
        """
        missing = self.lacks(readings)
        if missing:
            first = missing[0]
            return f"no {first}"
        # Noise changes every reading of a sensor that works.
        power = readings.power
        force = getattr(readings, force_reading(self._scenario))
        power_before, force_before = self._loads_before
        is_same = power == power_before or force == force_before
        self._loads_before = (power, force)
        if readings.cutting and is_same:
            self._repeats += 1
        else:
            self._repeats = 0
        # At long intervals, a short time holds too few readings to tell chance from a fault.
        max_repeats = max(STUCK_TIME / self._scenario.control.interval, STUCK_INTERVALS)
        if self._repeats >= max_repeats:
            return "sensor stuck"
        return ""

    def _set(self, **values: float) -> None:
        """Set quantities of the only environment's state."""
        for name, value in values.items():
            self._states[name][0, 0] = value


def highest_feed(scenario: Scenario) -> float:
    """Return the highest feed that actions command [mm/rev], which the part program holds."""
    control = scenario.control
    if control.action == "override":
        return min(control.override_max * control.initial_feed, scenario.machine.feed_max)
    return scenario.machine.feed_max


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
    delayed = machine.model_copy(update={"command_delay": delay})
    return scenario.model_copy(update={"machine": delayed})


@compiled_entry
def observe_readings(states, parameters, scratches, minutes, observations):  # type: ignore[no-untyped-def]
    """Write the observation of the state's readings after ``minutes`` in metal."""
    state = states[0]
    p = parameters[0]
    scratch = scratches[0]
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
