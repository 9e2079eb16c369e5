"""Adapt the feed to a limit on the cutting force, estimated from the feed motor's current.

The method is that of the servo current paper. A Butterworth low-pass of 10th order removes ripple
and noise from the current. The estimate is the force whose steady current is the root mean square
of the last filtered samples. The feed velocity shifts the no-load current, and the feed belongs to
the estimated force, so both pass the same filter, the feed after the lag of the chip (assumption;
the rest is the paper's).

The nominal exponent of feed scales the force to every grade of the feed switch. If the force is
above the upper limit, a share of the force limit, the controller takes the highest grade within
that limit; if it is below the lower limit, the lowest grade above that one. The distance between
the limits prevents chatter of the switch. (The paper adapts the feed to the calculated force and
the limit, but states no law: assumption.) In air, and in metal until the estimate has settled, the
feed is the programmed one.

Uses from the nominal model: the law of thrust force's exponent of feed, the lag of the chip, and
the motor's current per force.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.constant_force import FORCE_SHARE
from baselines.models.part_program import PROGRAM, PartProgram, override_rules
from baselines.rule import Array, Mask, published
from turning_env import Reading, Scenario, read
from turning_env.numerics.functions import real_power, sine_and_cosine
from turning_env.physics.drives import force_from_current, lag_share
from turning_env.physics.records import parameter_records
from turning_env.policy import Actions, Observations, Policy

FEED_GRADES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.5, 1.5)
"""Feed override at each position of a panel's switch [-].

The positions have a four-bit code (servo current paper, section 5.2).
"""
PROGRAMMED = FEED_GRADES.index(1.0)  # position of the programmed feed
ORDER = 10  # order of the low-pass filter (servo current paper)
HYSTERESIS = 0.05  # distance between the limits over the upper one [-] (assumption)
# Arguments of ``Smoother`` (assumption): the loop is stable with this filter's lag.
CUTOFF = 0.8
WINDOW = 3
# Signals of ``ForceEstimator`` that pass the filter.
SENSED = 0  # servo current [A], or thrust force [N] if it is measured
FEED_VELOCITY = 1  # [mm/min]
CHIP_FEED = 2  # feed that the force follows [mm/rev]
SIGNALS = 3


def low_pass(cutoff: float) -> Array:
    """Return the Butterworth low-pass of a cut-off over the Nyquist frequency.

    It is the bilinear transform of the analogue filter. SciPy's own design gives other bits on
    other processors.

    Returns:
        Second-order sections as in SciPy, shape (sections, 6).
    """
    # With W = tan(pi cutoff / 2) and d_k = 2 sin(pi (k + 1/2) / ORDER / 2), section k is
    #     W^2 (1 + z^-1)^2 / ((1 + d W + W^2) + 2 (W^2 - 1) z^-1 + (1 - d W + W^2) z^-2)
    sine, cosine = sine_and_cosine(0.25 * cutoff)
    warped = sine / cosine
    squared = warped * warped
    turns = (np.arange(ORDER // 2) + 0.5) / (2.0 * ORDER)
    damping_sine, _ = sine_and_cosine(turns)
    damping = 2.0 * damping_sine
    damped = damping * warped
    scale = 1.0 / (1.0 + damped + squared)
    gain = squared * scale
    sections = np.empty((len(gain), 6))
    sections[:, 0] = gain
    sections[:, 1] = 2.0 * gain
    sections[:, 2] = gain
    sections[:, 3] = 1.0
    sections[:, 4] = 2.0 * (squared - 1.0) * scale
    sections[:, 5] = (1.0 - damped + squared) * scale
    return sections


def delay(cutoff: float) -> float:
    """Return the filter's delay of slow changes [samples]."""
    # The analogue Butterworth filter of order n has the delay 1 / (w sin(pi / 2n)), with w the
    # cut-off frequency in rad/s. The bilinear transform gives w = 2 tan(pi cutoff / 2) per sample.
    sine, cosine = sine_and_cosine(0.25 * cutoff)
    pole_sine, _ = sine_and_cosine(0.25 / ORDER)
    return float(cosine / (pole_sine * 2.0 * sine))


class Smoother:
    """A Butterworth low-pass and the root mean square of its last outputs, for several signals.

    The first sample after ``reset`` counts as steady before; the root mean square then covers the
    samples since.

    Args:
        num_envs: number of environments.
        signals: number of signals of each environment.
        cutoff: half-power frequency over the Nyquist frequency [-], between 0 and 1.
        window: samples of the root mean square, 1 or more.

    Attributes:
        count: samples that each environment's root mean square covers, shape (num_envs, 1).
    """

    def __init__(self, num_envs: int, signals: int, cutoff: float, window: int) -> None:
        # This import takes as long as all others of the catalogue.
        from scipy.signal import sosfilt

        self._filter = sosfilt
        self._sections = low_pass(cutoff)
        count = len(self._sections)
        numerator = self._sections[:, :3]
        denominator = self._sections[:, 3:]
        # State of each section per unit of a constant signal, which it passes unchanged. SciPy's
        # sections (transposed direct form II) output y = b_0 x + z_0, where z_0 follows from z_1,
        # and z_1 = b_2 x - a_2 y. With x = y = 1, z_0 = 1 - b_0 and z_1 = b_2 - a_2.
        steady = np.empty((count, 2))
        steady[:, 0] = 1.0 - numerator[:, 0]
        steady[:, 1] = numerator[:, 2] - denominator[:, 2]
        self._steady = steady[:, np.newaxis, np.newaxis, :]
        self._state = np.zeros((count, num_envs, signals, 2))
        self._window = np.zeros((window, num_envs, signals))
        self.count = np.zeros((num_envs, 1), np.int64)
        self._next = 0  # place in the window of the next output

    def reset(self, mask: Mask) -> None:
        self._window[:, mask] = 0.0
        self.count[mask] = 0

    def update(self, samples: Array) -> Array:
        """Return the smoothed signals after the next samples, both of shape (num_envs, signals)."""
        fresh = self.count[:, 0] == 0
        fresh_samples = samples[fresh][..., np.newaxis]
        self._state[:, fresh] = self._steady * fresh_samples
        filtered, self._state = self._filter(
            self._sections,
            samples[..., np.newaxis],
            axis=-1,
            zi=self._state,
        )

        window = len(self._window)
        self._window[self._next] = filtered[..., 0]
        self._next = (self._next + 1) % window
        self.count = np.minimum(self.count + 1, window)
        sum_of_squares = (self._window**2).sum(axis=0)
        return np.asarray(np.sqrt(sum_of_squares / self.count))


class ForceAndFeed(NamedTuple):
    """Force and feed of one moment; arrays of shape (num_envs,)."""

    force: Array  # thrust force [N]
    feed: Array  # feed that belongs to it [mm/rev]


class ForceEstimator:
    """An estimator of thrust force from the servo current or, if measured, the force.

    Args:
        scenario: nominal model.
        num_envs: number of environments.
        cutoff: half-power frequency over the Nyquist frequency [-], of the low-pass filter.
        window: samples of the root mean square after it.

    Attributes:
        delay: delay of an estimate [samples].
    """

    def __init__(self, scenario: Scenario, num_envs: int, cutoff: float, window: int) -> None:
        self._parameters = parameter_records(scenario)[0]
        self._machine = scenario.machine
        self._senses_current = scenario.sensors.force == "servo_current"
        self._smoother = Smoother(num_envs, SIGNALS, cutoff=cutoff, window=window)
        turns_per_minute = (
            self._parameters.revolutions_per_metre[0] * scenario.control.initial_cutting_speed
        )
        turn = 60.0 / turns_per_minute  # [s]
        chip_time = turn * self._machine.chip_lag
        self._remains = 1.0 - lag_share(scenario.control.interval, chip_time)
        self._chip_feed = np.zeros(num_envs)
        self.delay = delay(cutoff) + 0.5 * (window - 1)

    def reset(self, mask: Mask) -> None:
        self._smoother.reset(mask)

    def update(self, reading: Reading) -> ForceAndFeed:
        """Return the estimate after the next reading, of ``delay`` samples ago."""
        turns_per_minute = reading.cutting_speed * self._parameters.revolutions_per_metre[0]
        # The chip forms with a lag behind the feed; the first sample of a cut has none.
        has_begun = self._smoother.count[:, 0] > 0
        remains = self._remains * has_begun
        self._chip_feed = reading.feed - remains * (reading.feed - self._chip_feed)

        samples = np.empty((len(reading.feed), SIGNALS))
        samples[:, SENSED] = reading.thrust_force
        if self._senses_current:
            samples[:, SENSED] = reading.servo_current
        samples[:, FEED_VELOCITY] = turns_per_minute * reading.feed
        samples[:, CHIP_FEED] = self._chip_feed
        smooth = self._smoother.update(samples).T

        force = smooth[SENSED]
        if self._senses_current:
            force = force_from_current(  # type: ignore[no-untyped-call]
                self._parameters, 0, force, smooth[FEED_VELOCITY]
            )
        feed = smooth[CHIP_FEED]
        # The filter overshoots.
        return ForceAndFeed(
            force=np.maximum(force, 0.0),
            feed=np.clip(feed, self._machine.feed_min, self._machine.feed_max),
        )


class CurrentLimit(Policy):
    """Control that keeps the estimated force below a limit with the 16 grades of the feed switch.

    Args:
        program: the part program, whose feed is overridden.
        num_envs: number of environments.
        force_share: upper limit over the scenario's force limit [-].

    Attributes:
        settling_steps: steps in metal during which the estimate is ignored.
    """

    def __init__(self, program: PartProgram, num_envs: int, force_share: float) -> None:
        scenario = program.scenario
        machine = scenario.machine
        self._program = program
        self._overrides = np.minimum(FEED_GRADES, program.override_max)
        self._feeds = np.clip(self._overrides * program.feed, machine.feed_min, machine.feed_max)
        # Limits of the estimated force [N]: the grade falls above the upper one, rises below the
        # lower one, and stays in between.
        self._upper = force_share * scenario.limits.thrust_force
        self._lower = self._upper * (1.0 - HYSTERESIS)
        self._estimator = ForceEstimator(scenario, num_envs, cutoff=CUTOFF, window=WINDOW)
        # A step input has passed the filter after about twice its delay.
        self.settling_steps = math.ceil(2.0 * self._estimator.delay)
        self._steps_in_metal = np.zeros(num_envs, np.int64)
        self._grade = np.full(num_envs, PROGRAMMED)  # position of the feed switch

    def reset(self, mask: Mask) -> None:
        self._estimator.reset(mask)
        self._steps_in_metal[mask] = 0
        self._grade[mask] = PROGRAMMED

    def act(self, observations: Observations) -> Actions:
        scenario = self._program.scenario
        reading = read(observations, scenario)
        self.reset(~reading.cutting)
        self._steps_in_metal += reading.cutting
        estimate = self._estimator.update(reading)

        # Estimated force at every grade, shape (num_envs, grades).
        feed_ratio = self._feeds / estimate.feed[:, np.newaxis]
        force_ratio = real_power(feed_ratio, scenario.material.thrust_force.feed)
        force_at_grade = estimate.force[:, np.newaxis] * force_ratio
        lowest = _highest_grade_within(force_at_grade, self._lower)
        highest = _highest_grade_within(force_at_grade, self._upper)

        settled = self._steps_in_metal > self.settling_steps
        wanted = np.clip(self._grade, lowest, highest)
        self._grade = np.where(settled, wanted, self._grade)
        return self._program.act(reading, self._overrides[self._grade])


def _highest_grade_within(force_at_grade: Array, limit: float) -> NDArray[np.int64]:
    """Return the highest grade whose force is within a limit, or the lowest one; forces ascend."""
    return np.asarray(np.maximum((force_at_grade <= limit).sum(axis=1) - 1, 0))


RULES = published(
    override_rules(
        "current_limit",
        "feed by a 16-grade switch within a limit of the force, as filtered servo current tells it "
        "(servo current paper)",
        controller=CurrentLimit,
        parameters={"force_share": FORCE_SHARE},
        with_speed={"force_share": FORCE_SHARE, **PROGRAM},
        plays=lambda scenario: scenario.material.thrust_force.feed > 0.0,
    )
)
