"""Cutting force from the current of the feed's motor (servo current paper).

The current is filtered by a Butterworth low-pass of 10th order, against ripple and noise; its root mean square over some samples
is taken, and the force at which that current is steady is the estimate. The feed velocity, which shifts the no-load current, goes
through the same filter, so that both are of the same moment; and so does the feed, for a controller that asks at which feed the
force was what it is estimated to be (filtering them is an assumption; the rest is the paper's).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

from turning_env import Reading, Scenario
from turning_env.physics.drives import force_from_current
from turning_env.physics.records import parameter_records

ORDER = 10
"""Of the low-pass filter (servo current paper)."""


class Butterworth:
    """A low-pass filter of signals in lanes, one sample at a time.

    A lane's first sample after ``reset`` is taken to have lasted for ever.

    Args:
        lanes: how many lanes.
        signals: how many signals in each.
        cutoff: half-power frequency over the Nyquist frequency, half the sampling's [-]; above 0 and below 1.
    """

    def __init__(self, num_envs: int, signals: int, cutoff: float) -> None:
        self._sections: NDArray[np.float64] = butter(ORDER, cutoff, output="sos")
        self._steady = sosfilt_zi(self._sections)[:, np.newaxis, np.newaxis, :]  # per unit of a signal that does not change
        self._state = np.zeros((len(self._sections), num_envs, signals, 2))
        self._fresh = np.ones(num_envs, np.bool_)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the samples of these lanes."""
        self._fresh |= mask

    def update(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """The next samples, filtered; both of shape (lanes, signals)."""
        if self._fresh.any():
            self._state[:, self._fresh] = self._steady * samples[self._fresh][..., np.newaxis]
            self._fresh[:] = False
        filtered, self._state = sosfilt(self._sections, samples[..., np.newaxis], axis=-1, zi=self._state)
        return np.asarray(filtered[..., 0], np.float64)


def delay(cutoff: float) -> float:
    """By how many samples the filter delays what changes slowly [-].

    The analogue Butterworth filter of order n delays it by 1 / sin(pi / 2n) over its cut-off frequency in rad/s; the bilinear
    transform puts that at 2 tan(pi cutoff / 2) per sample.
    """
    return 1.0 / (math.sin(math.pi / (2.0 * ORDER)) * 2.0 * math.tan(0.5 * math.pi * cutoff))


class MovingWindow:
    """The last samples of every lane, of which there may be fewer after ``reset``.

    Args:
        lanes: how many lanes.
        signals: how many signals in each.
        length: samples in a full window, 1 or more.
    """

    def __init__(self, num_envs: int, signals: int, length: int) -> None:
        self._samples = np.zeros((length, num_envs, signals))
        self._count = np.zeros(num_envs, np.int64)
        self._next = 0

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the samples of these lanes."""
        self._samples[:, mask] = 0.0
        self._count[mask] = 0

    def update(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """Root mean square of each signal over the window with these samples in it; both of shape (lanes, signals)."""
        self._samples[self._next] = samples
        self._next = (self._next + 1) % len(self._samples)
        self._count = np.minimum(self._count + 1, len(self._samples))
        return np.asarray(np.sqrt((self._samples**2).sum(axis=0) / self._count[:, np.newaxis]), np.float64)


@dataclass(frozen=True)
class Estimate:
    """Of one moment, some samples ago; every field has shape (lanes,)."""

    thrust_force: NDArray[np.float64]
    """[N]"""
    feed: NDArray[np.float64]
    """[mm/rev]"""


class ForceEstimator:
    """Thrust force from what is sensed: the servo current, or the force itself where there is a dynamometer.

    Args:
        scenario: what is sensed, and the motor and screw that turn force into current.
        lanes: how many lanes.
        cutoff: of the filter, over the Nyquist frequency [-]; above 0 and below 1.
        window: samples over which the root mean square is taken, 1 or more.
    """

    def __init__(self, scenario: Scenario, num_envs: int, cutoff: float, window: int) -> None:
        self._parameters = parameter_records(scenario)[0]
        self._machine = scenario.machine
        self._senses_current = scenario.sensors.force == "servo_current"
        self._filter = Butterworth(num_envs, 3, cutoff)
        self._window = MovingWindow(num_envs, 3, window)
        self.delay = delay(cutoff) + 0.5 * (window - 1)
        """By how many samples an estimate lags behind [-]."""

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the samples of these lanes."""
        self._filter.reset(mask)
        self._window.reset(mask)

    def update(self, reading: Reading) -> Estimate:
        """Take one reading of all lanes into account."""
        sensed = reading.servo_current if self._senses_current else reading.thrust_force
        feed_velocity = reading.cutting_speed * self._parameters.revolutions_per_metre * reading.feed
        samples = np.stack([sensed, feed_velocity, reading.feed], axis=1)
        sensed, feed_velocity, feed = self._window.update(self._filter.update(samples)).T
        force = sensed
        if self._senses_current:
            force = force_from_current(self._parameters, sensed, feed_velocity)  # type: ignore[no-untyped-call]
        # The filter overshoots what jumps.
        return Estimate(np.maximum(force, 0.0), np.clip(feed, self._machine.feed_min, self._machine.feed_max))
