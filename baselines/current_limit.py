"""Adapt the feed to a limit on the cutting force, estimated from the feed motor's current (servo current paper).

A Butterworth low-pass of 10th order removes ripple and noise from the current. The estimate is the force whose steady current
is the root mean square of the last filtered samples. The feed velocity shifts the no-load current, and the feed belongs to the
estimated force, so both pass the same filter, the feed after the lag of the chip (assumption; the rest is the paper's).

The nominal exponent of feed scales the force to every grade of the feed switch. If the force is above the upper limit, a share of
the force limit, the controller takes the highest grade within that limit; if it is below the lower limit, the lowest grade above
that one. The distance between the limits prevents chatter of the switch. (The paper adapts the feed to the calculated force and
the limit, but states no law: assumption.) In air, and in metal until the estimate has settled, the feed is the programmed one.

It needs of the nominal model: the law of thrust force's exponent of feed, the lag of the chip, and the motor's current per force.
"""

import math

import numpy as np

from baselines.constant_force import FORCE_SHARE
from baselines.models.part_program import PROGRAM, PartProgram, override_rules
from baselines.rule import Array, Mask
from turning_env import Reading, Scenario, read
from turning_env.numerics.functions import real_power, sine_and_cosine
from turning_env.physics.drives import force_from_current, lag_share
from turning_env.physics.records import parameter_records
from turning_env.scoring.policy import Actions, Observations, Policy

FEED_GRADES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.5, 1.5)
"""Feed override at each position of a panel's switch, a four-bit code (servo current paper, section 5.2) [-]."""
ORDER = 10  # order of the low-pass filter (servo current paper)
HYSTERESIS = 0.05  # distance between the limits over the upper one [-] (assumption)
CUTOFF, WINDOW = (
    0.8,
    3,
)  # arguments of Smoother [-], [samples]: the loop is stable with this filter's lag (assumption)
_PROGRAMMED = FEED_GRADES.index(1.0)


def low_pass(cutoff: float) -> Array:
    """Return the Butterworth low-pass of a cut-off over the Nyquist frequency as second-order sections, shape (sections, 6).

    It is the bilinear transform of the analogue filter. SciPy's own design gives other bits on other processors.
    """
    sine, cosine = sine_and_cosine(0.25 * cutoff)
    warped = sine / cosine  # tan(pi cutoff / 2)
    damping = 2.0 * sine_and_cosine((np.arange(ORDER // 2) + 0.5) / (2.0 * ORDER))[0]
    scale = 1.0 / (1.0 + damping * warped + warped * warped)
    gain, last = warped * warped * scale, (1.0 - damping * warped + warped * warped) * scale
    return np.stack(
        [gain, 2.0 * gain, gain, np.ones(len(gain)), 2.0 * (warped * warped - 1.0) * scale, last],
        axis=1,
    )


def delay(cutoff: float) -> float:
    """Return the filter's delay of slow changes [samples].

    The analogue Butterworth filter of order n has the delay 1 / (w sin(pi / 2n)), with w the cut-off frequency in rad/s. The
    bilinear transform gives w = 2 tan(pi cutoff / 2) per sample.
    """
    sine, cosine = sine_and_cosine(0.25 * cutoff)
    return float(cosine / (sine_and_cosine(0.25 / ORDER)[0] * 2.0 * sine))


class Smoother:
    """A Butterworth low-pass and the root mean square of its last outputs, for several signals of each environment.

    The first sample after ``reset`` counts as steady before; the root mean square then covers the samples since. ``cutoff``:
    half-power frequency over the Nyquist frequency [-], between 0 and 1; ``window``: samples of the root mean square, from 1.
    """

    def __init__(self, num_envs: int, signals: int, cutoff: float, window: int) -> None:
        from scipy.signal import sosfilt  # takes as long as all other imports of the catalogue

        self._filter, self._sections = sosfilt, low_pass(cutoff)
        b, a = self._sections[:, :3], self._sections[:, 3:]
        steady = np.stack(
            [1.0 - b[:, 0], b[:, 2] - a[:, 2]], axis=1
        )  # state per unit of a constant signal
        self._steady = steady[:, np.newaxis, np.newaxis, :]
        self._state = np.zeros((len(self._sections), num_envs, signals, 2))
        self._window = np.zeros((window, num_envs, signals))
        self.count = np.zeros((num_envs, 1), np.int64)  # of each environment's samples
        self._next = 0

    def reset(self, mask: Mask) -> None:
        self._window[:, mask] = 0.0
        self.count[mask] = 0

    def update(self, samples: Array) -> Array:
        """Return the smoothed signals after the next samples, both of shape (num_envs, signals)."""
        fresh = self.count[:, 0] == 0
        self._state[:, fresh] = self._steady * samples[fresh][..., np.newaxis]
        filtered, self._state = self._filter(
            self._sections, samples[..., np.newaxis], axis=-1, zi=self._state
        )
        self._window[self._next] = filtered[..., 0]
        self._next = (self._next + 1) % len(self._window)
        self.count = np.minimum(self.count + 1, len(self._window))
        return np.asarray(np.sqrt((self._window**2).sum(axis=0) / self.count))


class ForceEstimator:
    """An estimator of thrust force from the servo current or, if measured, the force; for the arguments see ``Smoother``."""

    def __init__(self, scenario: Scenario, num_envs: int, cutoff: float, window: int) -> None:
        self._parameters, self._machine = parameter_records(scenario)[0], scenario.machine
        self._senses_current = scenario.sensors.force == "servo_current"
        self._smoother = Smoother(num_envs, 3, cutoff, window)
        turn = 60.0 / (
            self._parameters.revolutions_per_metre[0] * scenario.control.initial_cutting_speed
        )  # [s]
        self._remains = 1.0 - lag_share(scenario.control.interval, turn * self._machine.chip_lag)
        self._chip_feed = np.zeros(num_envs)  # feed that the force follows [mm/rev]
        self.reset = self._smoother.reset
        self.delay = delay(cutoff) + 0.5 * (window - 1)  # delay of an estimate [samples]

    def update(self, reading: Reading) -> tuple[Array, Array]:
        """Return thrust force [N] and feed [mm/rev] of one moment, ``delay`` samples ago, after the next reading."""
        sensed = reading.servo_current if self._senses_current else reading.thrust_force
        feed_velocity = (
            reading.cutting_speed * self._parameters.revolutions_per_metre[0] * reading.feed
        )
        remains = self._remains * (self._smoother.count[:, 0] > 0)
        self._chip_feed = reading.feed - remains * (reading.feed - self._chip_feed)
        force, feed_velocity, feed = self._smoother.update(
            np.stack([sensed, feed_velocity, self._chip_feed], axis=1)
        ).T
        if self._senses_current:
            force = force_from_current(self._parameters, 0, force, feed_velocity)  # type: ignore[no-untyped-call]
        return np.maximum(force, 0.0), np.clip(
            feed, self._machine.feed_min, self._machine.feed_max
        )  # the filter overshoots


class CurrentLimit(Policy):
    """Control that keeps the estimated force below ``force_share`` [-] of its limit with the 16 grades of the feed switch."""

    def __init__(self, program: PartProgram, num_envs: int, force_share: float) -> None:
        self._program, scenario = program, program.scenario
        self._overrides = np.minimum(FEED_GRADES, program.override_max)
        self._feeds = np.clip(
            self._overrides * program.feed, scenario.machine.feed_min, scenario.machine.feed_max
        )
        self._upper = force_share * scenario.limits.thrust_force
        self._lower = self._upper * (1.0 - HYSTERESIS)
        self._estimator = ForceEstimator(scenario, num_envs, CUTOFF, WINDOW)
        self.settling_steps = math.ceil(
            2.0 * self._estimator.delay
        )  # steps in metal during which the estimate is ignored
        self._steps_in_metal = np.zeros(num_envs, np.int64)
        self._grade = np.full(num_envs, _PROGRAMMED)

    def reset(self, mask: Mask) -> None:
        self._estimator.reset(mask)
        self._steps_in_metal[mask] = 0
        self._grade[mask] = _PROGRAMMED

    def act(self, observations: Observations) -> Actions:
        scenario = self._program.scenario
        reading = read(observations, scenario)
        self.reset(~reading.cutting)
        self._steps_in_metal += reading.cutting
        force, feed = (estimate[:, np.newaxis] for estimate in self._estimator.update(reading))
        force = force * real_power(
            self._feeds / feed, scenario.material.thrust_force.feed
        )  # (num_envs, grades)
        lowest, highest = (
            np.maximum((force <= limit).sum(axis=1) - 1, 0) for limit in (self._lower, self._upper)
        )
        settled = self._steps_in_metal > self.settling_steps
        self._grade = np.where(settled, np.clip(self._grade, lowest, highest), self._grade)
        return self._program.act(reading, self._overrides[self._grade])


RULES = override_rules(
    "current_limit",
    "feed by a 16-grade switch within a limit of the force, as filtered servo current tells it (servo current paper)",
    CurrentLimit,
    {"force_share": FORCE_SHARE},
    {"force_share": FORCE_SHARE, **PROGRAM},
    lambda scenario: scenario.material.thrust_force.feed > 0.0,
)
