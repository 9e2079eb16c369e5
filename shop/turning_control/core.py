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
from turning_control.readings import Readings, bar_spindle_speed
from turning_control.shield import DEFAULT_SETTINGS, LOG, REFUSALS, Shield, ShieldSettings
from turning_control.watch import Watch

from turning_env.action import commanded
from turning_env.numerics.compilation import compiled_entry
from turning_env.numerics.conversions import cutting_speed_at
from turning_env.numerics.functions import log
from turning_env.observation import observe, read
from turning_env.physics.lathe import charge_time_and_life
from turning_env.physics.quantities import layout
from turning_env.physics.records import block_records
from turning_env.physics.wear import EQUIVALENT_TIME
from turning_env.policy import PolicyFactory
from turning_env.scenario import Scenario

# Delay from readings until LinuxCNC follows [s], if the scenario gives none: measured on the
# simulated lathe.
COMMAND_DELAY = 0.006
STANDSTILL = 0.01  # spindle speed over the lowest one below which the spindle stands [-]


class Status(IntEnum):
    """State of the controller."""

    IDLE = 0  # no feed motion: the policy is not asked
    POLICY = 1  # the policy's command holds
    SHIELD = 2  # the shield has changed the policy's command
    SAFE = 3  # at most the safe feed: no valid answer, or readings do not bound the load
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
        self,
        scenario: Scenario,
        make_policy: PolicyFactory,
        settings: ShieldSettings = DEFAULT_SETTINGS,
    ) -> None:
        self._scenario = scenario.nominal()
        self._highest_feed = highest_feed(scenario)
        self.safe_feed = safe_feed(scenario, settings)
        self._shield = Shield(make_policy(1), self._scenario, 1, settings)
        self._states, self._parameters, self._scratches = block_records(self._scenario)
        self.observation = np.zeros((1, len(layout(scenario))), np.float32)
        self._watch = Watch(self._scenario)
        self._fault = ""
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
        self._watch.reset()

    def lacks(self, readings: Readings) -> list[str]:
        """Return the readings that a decision needs and the machine does not give."""
        return self._watch.lost(readings)

    def observe(self, readings: Readings) -> NDArray[np.float32]:
        """Return the observation of readings, shape (1, entries).

        Call it once per control interval, because it counts the edge's time.
        """
        machine = self._scenario.machine
        diameter = self._scenario.workpiece.diameter
        if readings.new_edge:
            self._set(cutting_time=0.0, nominal_used_life=0.0)
        speed = cutting_speed_at(readings.spindle_speed, diameter)
        feed = readings.feed_velocity / max(readings.spindle_speed, 1e-9)
        self._set(
            # A standstill has no logarithm.
            cutting_speed=max(speed, 1e-3 * machine.cutting_speed_min),
            feed=max(feed, 1e-3 * machine.feed_min),
            cutting=int(bool(readings.cutting)),
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
        observation = self.observe(self._watch.bounded(readings))
        fault = self._watch.fault(readings, read(observation, self._scenario))
        commands = self._commands(readings, observation, fault)
        # While the feed is held or the tool is in rapid motion, a fault holds no safe feed.
        self._report(fault if commands.reason == fault else "")
        LOG.debug(
            "%s: %s: feed %.4f, %s",
            commands.status.name,
            commands.reason,
            commands.adaptive_feed,
            readings,
        )
        return commands

    def _commands(
        self, readings: Readings, observation: NDArray[np.float32], fault: str
    ) -> Commands:
        """Return the commands after readings that have a fault, or none if the text is empty."""
        if self._shield.takeover[0]:
            return feed_hold(Status.OPERATOR, "takeover")
        lowest_turns = bar_spindle_speed(self._scenario, self._scenario.machine.cutting_speed_min)
        if abs(readings.spindle_speed) < STANDSTILL * lowest_turns:
            self._shield.miss()
            status = Status.IDLE if readings.in_feed is False else Status.OPERATOR
            return feed_hold(status, "spindle stopped")
        if readings.in_feed is False:
            # The tool may still move: what says that it does not is a reading, too.
            return self._safe_commands(Status.IDLE, "no feed motion")
        if fault:
            return self._safe_commands(Status.SAFE, fault)
        return self._ask_policy(readings, observation)

    def _report(self, fault: str) -> None:
        """Log a fault when it begins."""
        if fault and fault != self._fault:
            LOG.warning("%s: the safe feed holds", fault)
        self._fault = fault

    def _safe_commands(self, status: Status, reason: str) -> Commands:
        """Return the programmed speed and at most the safe feed: nothing bounds the load.

        A lower feed stays, because the shield has had a reason for it.
        """
        present = float(self._states["commanded_feed"][0, 0])
        self._set(
            commanded_cutting_speed=self._scenario.control.initial_cutting_speed,
            commanded_feed=min(present, self.safe_feed * self._highest_feed),
        )
        self._shield.miss()
        return self._present_commands(status, reason)

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


def safe_feed(scenario: Scenario, settings: ShieldSettings = DEFAULT_SETTINGS) -> float:
    """Return the safe feed over the highest [-]."""
    return min(settings.safe_share * scenario.control.initial_feed / highest_feed(scenario), 1.0)


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
