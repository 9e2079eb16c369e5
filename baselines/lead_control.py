"""Feed override that leads the lags of feed servo and chip, and estimates the load per feed.

A command passes three lags of first order before its effect is measured:

    commanded feed -> (servo) -> actual feed f -> k f^m -> (chip) -> load -> (sensor) -> reading

The published law of constant force (``constant_force``) scales the feed by the ratio of reference
and measured load. It does not account for these lags, so it is slow, or swings. This controller
knows their time constants and the exponent m of feed:

1. It sends f^m through the lags of chip and sensor, as the load goes. The measured load divided by
   the result is k, which changes only with depth, hardness and wear. k is smoothed over
   ``estimate_time``.
2. The reference divided by k is the wanted value of f^m behind the chip.
3. It commands the feed at which each lag covers, within one step, the distance that a lag with
   ``response_time`` would. The commanded feed therefore overshoots, and the load does not.

In air it commands the override ``approach``. The lead and the estimate are this project's; both are
textbook control.

Uses from the nominal model: the exponent of feed in the law of the load, the law's value before the
first reading, the lags of servo, chip and sensor, and for roughness the force of a roughness.
"""

import numpy as np

from baselines.constant_force import force_of_roughness, holds_roughness_by_feed
from baselines.models.part_program import PartProgram, on_override, on_program
from baselines.rule import Array, Mask, Rule, TuningRange
from turning_env import Reading, read
from turning_env.numerics.conversions import spindle_speed_at
from turning_env.numerics.functions import exp, log, real_power
from turning_env.physics.drives import lag_share
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.power_law import PowerLaw

MIN_CHIP = 0.1
"""Lower bound of f^m behind the lags over the programmed feed's at which readings are used [-].

Below it, the tool has just entered.
"""


class LeadControl(Policy):
    """Hold a load at its reference; subclasses say which load.

    Args:
        program: the part program, whose feed is overridden.
        num_envs: number of environments.
        law: the nominal law of the load.
        sensor_time: time constant of the load's sensor [s].
        estimate_time: time constant of the smoothing of k [s].
        response_time: time constant with which servo and chip seem to follow [s].
        approach: override in air [-].
    """

    def __init__(
        self,
        program: PartProgram,
        num_envs: int,
        law: PowerLaw,
        sensor_time: float,
        estimate_time: float,
        response_time: float,
        approach: float,
    ) -> None:
        scenario = program.scenario
        self._program = program
        self._approach = approach
        self._exponent = law.feed
        self._feed_max = min(program.override_max * program.feed, scenario.machine.feed_max)
        self._interval = scenario.control.interval
        self._sensor_share = lag_share(self._interval, sensor_time)
        self._estimate_share = lag_share(self._interval, estimate_time)
        self._response_share = lag_share(self._interval, response_time)
        self._servo_share = lag_share(self._interval, scenario.machine.feed_time_constant)

        nominal = law(
            program.cutting_speed,
            1.0,
            scenario.workpiece.depth_of_cut,
            wear=scenario.tool.wear_criterion,
        )
        self._log_nominal = float(log(nominal))
        self._min_chip = MIN_CHIP * float(real_power(program.feed, law.feed))

        self._feed_before = np.full(num_envs, program.feed)  # actual feed at the last step [mm/rev]
        self._chip = np.zeros(num_envs)  # f^m behind the chip
        self._sensed = np.zeros(num_envs)  # f^m behind chip and sensor
        self._log_k = np.full(num_envs, self._log_nominal)

    def reset(self, mask: Mask) -> None:
        self._feed_before[mask] = self._program.feed
        self._chip[mask] = 0.0
        self._sensed[mask] = 0.0
        self._log_k[mask] = self._log_nominal

    def act(self, observations: Observations) -> Actions:
        reading = read(observations, self._program.scenario)
        chip_share = self._chip_share(reading)
        self._follow(reading, chip_share)
        self._estimate(reading)

        # Chip and load mean f^m, the feed to the law's exponent, behind and before the chip's lag.
        # A lag with the share s covers s (wanted - actual) in a step. To cover r (wanted - actual),
        # with r the share of ``response_time``, it is sent actual + r / s (wanted - actual).
        wanted_chip = self._reference(reading) / exp(self._log_k)
        chip_lead = self._response_share / chip_share
        wanted_load = np.maximum(self._chip + chip_lead * (wanted_chip - self._chip), 0.0)
        wanted_feed = real_power(wanted_load, 1.0 / self._exponent)
        wanted_feed = np.minimum(wanted_feed, self._feed_max)

        servo_lead = self._response_share / self._servo_share
        feed = reading.feed + servo_lead * (wanted_feed - reading.feed)
        override = np.where(reading.cutting, feed / self._program.feed, self._approach)
        return self._program.act(reading, override)

    def _chip_share(self, reading: Reading) -> Array:
        """Return the share of the way to a new load that the chip's lag covers in one step [-]."""
        scenario = self._program.scenario
        turns_per_minute = spindle_speed_at(reading.cutting_speed, scenario.workpiece.diameter)
        turns = turns_per_minute * self._interval / 60.0
        return np.asarray(lag_share(turns, scenario.machine.chip_lag))

    def _follow(self, reading: Reading, chip_share: Array) -> None:
        """Send the actual feed of the last step through the lags of chip and sensor."""
        mean_feed = 0.5 * (self._feed_before + reading.feed)
        self._feed_before = reading.feed
        settled = real_power(mean_feed, self._exponent)
        load = np.where(reading.cutting, settled, 0.0)
        self._chip += chip_share * (load - self._chip)
        self._sensed += self._sensor_share * (self._chip - self._sensed)

    def _estimate(self, reading: Reading) -> None:
        """Move log k towards the latest reading's."""
        measured = self._measured(reading)
        has_chip = self._sensed > self._min_chip
        usable = reading.cutting & has_chip & (measured > 0.0)
        # Where no reading is usable, k stays.
        ratio = exp(self._log_k)
        np.divide(measured, self._sensed, out=ratio, where=usable)
        self._log_k += self._estimate_share * (log(ratio) - self._log_k)

    def _measured(self, reading: Reading) -> Array:
        """Return the measured load."""
        raise NotImplementedError

    def _reference(self, reading: Reading) -> Array | float:
        """Return the load to hold, in the unit of ``_measured``."""
        raise NotImplementedError


class ForceLead(LeadControl):
    """Hold the thrust force at which the nominal model has the reference of roughness."""

    def __init__(
        self,
        program: PartProgram,
        num_envs: int,
        estimate_time: float,
        response_time: float,
        approach: float,
    ) -> None:
        scenario = program.scenario
        super().__init__(
            program,
            num_envs,
            law=scenario.material.thrust_force,
            sensor_time=scenario.sensors.force_time_constant,
            estimate_time=estimate_time,
            response_time=response_time,
            approach=approach,
        )

    def _measured(self, reading: Reading) -> Array:
        return reading.thrust_force

    def _reference(self, reading: Reading) -> Array:
        return force_of_roughness(self._program.scenario.surface, reading.roughness_reference)


class PowerLead(LeadControl):
    """Hold the spindle power at ``target`` [-], a share of the power limit."""

    def __init__(
        self,
        program: PartProgram,
        num_envs: int,
        target: float,
        estimate_time: float,
        response_time: float,
        approach: float,
    ) -> None:
        scenario = program.scenario
        super().__init__(
            program,
            num_envs,
            law=scenario.material.power,
            sensor_time=scenario.sensors.power_time_constant,
            estimate_time=estimate_time,
            response_time=response_time,
            approach=approach,
        )
        self._target = target * scenario.limits.power

    def _measured(self, reading: Reading) -> Array:
        return reading.power

    def _reference(self, reading: Reading) -> Array | float:
        return self._target


TIME = TuningRange(0.005, 0.5, logarithmic=True)
"""Time constants [s]: half an interval of these tasks to several times their longest lag."""
APPROACH = TuningRange(0.5, 2.0)

RULES = {
    "constant_force_lead": Rule(
        "constant_force with an estimate of force per feed and a lead for the lags of servo and "
        "chip (this project)",
        on_program(ForceLead),
        plays=holds_roughness_by_feed,
        parameters={"estimate_time": TIME, "response_time": TIME, "approach": APPROACH},
        worth_tuning=True,
    ),
    "constant_power_lead": Rule(
        "constant spindle power with an estimate of power per feed and a lead for the lags of "
        "servo and chip (this project)",
        on_program(PowerLead),
        plays=lambda scenario: on_override(scenario) and scenario.material.power.feed > 0.0,
        parameters={
            "target": TuningRange(0.7, 1.0),
            "estimate_time": TIME,
            "response_time": TIME,
            "approach": APPROACH,
        },
        worth_tuning=True,
    ),
}
