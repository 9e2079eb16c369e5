"""Estimate the cutting force from the current of the feed motor (servo current paper).

A Butterworth low-pass of 10th order removes ripple and noise from the current. The estimate is the force whose steady current
is the root mean square of the last filtered samples. The feed velocity shifts the no-load current; it passes the same filter, so
both belong to the same moment. The feed also passes it, for controllers that need the feed at the estimated force (assumption;
the rest is the paper's).
"""

import numpy as np
from numpy.typing import NDArray

from turning_env import Reading, Scenario
from turning_env.numerics.functions import sine_and_cosine
from turning_env.physics.drives import force_from_current
from turning_env.physics.records import parameter_records

Array = NDArray[np.float64]

ORDER = 10
"""Order of the low-pass filter (servo current paper)."""


class Smoother:
    """A Butterworth low-pass and the root mean square of its last outputs, for several signals of each environment.

    The first sample after ``reset`` counts as steady before; the root mean square then covers the samples since.

    Args:
        num_envs: number of environments.
        signals: number of signals per environment.
        cutoff: half-power frequency over the Nyquist frequency [-], between 0 and 1.
        window: samples of the root mean square, 1 or more.
    """

    def __init__(self, num_envs: int, signals: int, cutoff: float, window: int) -> None:
        from scipy.signal import sosfilt  # takes as long as all other imports of the catalogue

        self._filter = sosfilt
        self._sections = low_pass(cutoff)
        b, a = self._sections[:, :3], self._sections[:, 3:]
        steady = np.stack([1.0 - b[:, 0], b[:, 2] - a[:, 2]], axis=1)  # state per unit of a constant signal
        self._steady = steady[:, np.newaxis, np.newaxis, :]
        self._state = np.zeros((len(self._sections), num_envs, signals, 2))
        self._fresh = np.ones(num_envs, np.bool_)
        self._window = np.zeros((window, num_envs, signals))
        self._count = np.zeros(num_envs, np.int64)
        self._next = 0

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the samples."""
        self._fresh |= mask
        self._window[:, mask] = 0.0
        self._count[mask] = 0

    def update(self, samples: Array) -> Array:
        """Return the smoothed signals after the next samples, both of shape (num_envs, signals)."""
        if self._fresh.any():
            self._state[:, self._fresh] = self._steady * samples[self._fresh][..., np.newaxis]
            self._fresh[:] = False
        filtered, self._state = self._filter(self._sections, samples[..., np.newaxis], axis=-1, zi=self._state)
        self._window[self._next] = filtered[..., 0]
        self._next = (self._next + 1) % len(self._window)
        self._count = np.minimum(self._count + 1, len(self._window))
        return np.asarray(np.sqrt((self._window**2).sum(axis=0) / self._count[:, np.newaxis]), np.float64)


def low_pass(cutoff: float) -> Array:
    """Return the Butterworth low-pass of a cut-off over the Nyquist frequency as second-order sections, shape (sections, 6).

    It is the bilinear transform of the analogue filter. SciPy's own design gives other bits on other processors.
    """
    sine, cosine = sine_and_cosine(0.25 * cutoff)
    warped = sine / cosine  # tan(pi cutoff / 2)
    damping = 2.0 * sine_and_cosine((np.arange(ORDER // 2) + 0.5) / (2.0 * ORDER))[0]
    scale = 1.0 / (1.0 + damping * warped + warped * warped)
    gain = warped * warped * scale
    sections = gain, 2.0 * gain, gain, np.ones(len(gain)), 2.0 * (warped * warped - 1.0) * scale
    return np.stack([*sections, (1.0 - damping * warped + warped * warped) * scale], axis=1)


def delay(cutoff: float) -> float:
    """Return the filter's delay of slow changes [samples].

    The analogue Butterworth filter of order n has the delay 1 / (w sin(pi / 2n)), with w the cut-off frequency in rad/s. The
    bilinear transform gives w = 2 tan(pi cutoff / 2) per sample.
    """
    sine, cosine = sine_and_cosine(0.25 * cutoff)
    return float(cosine / (sine_and_cosine(0.25 / ORDER)[0] * 2.0 * sine))


class ForceEstimator:
    """An estimator of the thrust force from the servo current or, if the scenario measures it, from the force.

    Args:
        scenario: task.
        num_envs: number of environments.
        cutoff: cut-off frequency of the filter over the Nyquist frequency [-], between 0 and 1.
        window: number of samples of the root mean square, 1 or more.
    """

    def __init__(self, scenario: Scenario, num_envs: int, cutoff: float, window: int) -> None:
        self._parameters = parameter_records(scenario)[0]
        self._machine = scenario.machine
        self._senses_current = scenario.sensors.force == "servo_current"
        self._smoother = Smoother(num_envs, 3, cutoff, window)
        self.delay = delay(cutoff) + 0.5 * (window - 1)
        """Delay of an estimate [samples]."""

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the samples."""
        self._smoother.reset(mask)

    def update(self, reading: Reading) -> tuple[Array, Array]:
        """Return thrust force [N] and feed [mm/rev] of one moment, ``delay`` samples ago, after the next reading."""
        sensed = reading.servo_current if self._senses_current else reading.thrust_force
        feed_velocity = reading.cutting_speed * self._parameters.revolutions_per_metre[0] * reading.feed
        samples = np.stack([sensed, feed_velocity, reading.feed], axis=1)
        sensed, feed_velocity, feed = self._smoother.update(samples).T
        force = sensed
        if self._senses_current:
            force = force_from_current(self._parameters, 0, sensed, feed_velocity)  # type: ignore[no-untyped-call]
        # After a jump the filter overshoots.
        return np.maximum(force, 0.0), np.clip(feed, self._machine.feed_min, self._machine.feed_max)
