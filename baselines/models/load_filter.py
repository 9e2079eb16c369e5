"""An extended Kalman filter of bar, edge and laws from measured thrust force and power, with a nominal model per environment.

Force and power are power laws, so their log ratios to the nominal model are nearly linear in the states:

    log ratio = c log(depth / nominal) + h log(hardness) + e w + b + v log(V / V0) + s log(f / f0) + g log(W / W0) + noise
    w = insert + lot,   W = nominal wear * exp(w)

Depth and hardness vary along the bar and from bar to bar, as stationary processes with a slope (Matern 3/2: correlation
(1 + a) exp(-a), a = rate * distance). Their variance is the sum of the scenario's variances; the rate follows from the mean
square slope along a bar. ``insert`` and ``lot`` are log wear factors of the edge and of all edges of the job.

Each law has a bias b and errors v, s and g of its exponents of speed, feed and wear, constant for a job (dual estimation). They
count from the initial speed V0 and feed f0, and from half the wear criterion, W0. Without ``Uncertainty`` laws and lot are known.

If edges are inspected, the wear of a removed edge measures insert + lot. Observations do not contain the position, so the filter
integrates the travelled distance to know when the next bar begins.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.models.kalman_steps import (
    ERRORS,
    INSERT,
    LAWS,
    LOT,
    MEMORY,
    PARAMETERS,
    STATES,
    follow,
    learn_states,
    look_ahead,
)
from turning_env import Reading, Scenario
from turning_env.numerics.functions import exp, hypotenuse, log
from turning_env.physics.spindle import idle_power_at

Array = NDArray[np.float64]

SLOPE = 1.603
"""Root mean square slope of noise along a bar, times correlation length over spread: sqrt(pi/2 + 1) for the fields' nodes."""
READING_DEVIATION = 1e-3
"""Log standard deviation of a reading beside its noise [-] (assumption): the filter does not resolve a step exactly."""


class Uncertainty(NamedTuple):
    """Assumed error of the nominal model: prior standard deviations, and the expected log life."""

    laws: float = 0.0
    """Scale of ``LAW_ERRORS`` [-]."""
    lot: float = 0.0
    """Log standard deviation of the life of the lot's edges over the nominal life [-]."""
    lot_life: float = 1.0
    """Expected life of the lot's edges over the nominal life [-]."""


LAW_ERRORS = ((0.25, 0.1, 0.08, 0.15), (0.2, 0.05, 0.05, 0.06))
"""Standard deviations of the log bias and of the exponents of speed, feed and wear, of force and power (assumption)."""


class Outlook(NamedTuple):
    """Expected loads at points ahead of the tool; every field has shape (num_envs, points)."""

    depth_of_cut: Array
    """[mm]"""
    log_hardness: Array
    """[-]"""
    log_force: Array
    """Log ratio of thrust force to the nominal law with ``LoadFilter.exponents``, at nominal wear [-]."""
    log_power: Array
    """Likewise of power, with the idling spindle's."""
    force_spread: Array
    """Standard deviation of log force [-]."""
    power_spread: Array
    """Standard deviation of log power [-]."""


class LoadFilter:
    """A filter that estimates the states of many environments from their readings.

    Args:
        scenarios: nominal models, one for all environments or one for each.
        num_envs: number of environments.
        uncertainty: how far they may be wrong.
    """

    def __init__(self, scenarios: Sequence[Scenario], num_envs: int, uncertainty: Uncertainty = Uncertainty()) -> None:  # noqa: B008
        self._parameters = np.zeros(len(scenarios), PARAMETERS)
        for i, scenario in enumerate(scenarios):
            for name, value in _numbers(scenario, uncertainty).items():
                self._parameters[i][name] = value
        lot = np.array([-scenario.material.wear.time * log(uncertainty.lot_life) for scenario in scenarios])
        self._start = np.zeros((len(scenarios), STATES))
        self._start[:, LOT] = lot
        self.mean = np.zeros((num_envs, STATES))
        """Expected states."""
        self.covariance = np.zeros((num_envs, STATES, STATES))
        """Their covariance."""
        self._memory = np.zeros(num_envs, MEMORY)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Reset to the start of the first bar and to the prior."""
        count = len(mask)
        self.mean[mask] = np.broadcast_to(self._start, (count, STATES))[mask]
        prior = np.broadcast_to(self._parameters["prior"], (count, STATES))[mask]
        self.covariance[mask] = prior[:, :, np.newaxis] * np.eye(STATES)
        self._memory[mask] = np.zeros((), MEMORY)

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Whether the present bar has been measured, shape (num_envs,)."""
        return self._memory["measured"] > 0

    @property
    def depth_of_cut(self) -> Array:
        """Nominal depth of cut [mm], shape (scenarios,)."""
        depth: Array = self._parameters["depth_of_cut"]
        return depth

    @property
    def along(self) -> Array:
        """Position from the start of the present bar's approach [mm], shape (num_envs,)."""
        path, pitch = self._memory["path"], self._parameters["pitch"]
        along: Array = path - pitch * np.floor(path / pitch)
        return along

    @property
    def log_wear_factor(self) -> Array:
        """Expected log ratio of wear to the nominal model [-], shape (num_envs,)."""
        factor: Array = self.mean[:, INSERT] + self.mean[:, LOT]
        return factor

    @property
    def log_lot_factor(self) -> Array:
        """Expected part of it that all edges of the job share [-], shape (num_envs,)."""
        return self.mean[:, LOT]

    @property
    def wear_deviation(self) -> Array:
        """Standard deviation of the log wear factor [-], shape (num_envs,)."""
        own, lot, both = (self.covariance[:, i, k] for i, k in ((INSERT, INSERT), (LOT, LOT), (INSERT, LOT)))
        return np.sqrt(np.maximum(own + lot + 2.0 * both, 0.0))

    @property
    def exponents(self) -> Array:
        """Expected exponents of speed, feed and wear of force and power [-], shape (num_envs, 2, 3)."""
        errors = self.mean[:, LAWS:].reshape(-1, 2, ERRORS)[:, :, 1:]
        expected: Array = self._parameters["log_laws"][:, :, 1:] + errors
        return expected

    def observe(self, reading: Reading) -> None:
        """Predict up to a reading and correct the estimate by it."""
        columns = (
            *(reading.commanded_cutting_speed, reading.commanded_feed, reading.cutting_speed, reading.feed),
            *(reading.cutting_time, reading.nominal_wear, reading.removed_wear, reading.thrust_force, reading.power),
            reading.cutting,
        )
        seen = np.stack(columns, axis=1).astype(np.float64)
        follow(self._parameters, self._memory, self.mean, self.covariance, seen)

    def tell(self, chosen: NDArray[np.bool_], states: Array, deviation: float) -> None:
        """Correct the ``chosen`` estimates by true deviation of depth, log hardness and log wear factor, shape (num_envs, 3)."""
        learn_states(self._memory, self.mean, self.covariance, chosen, states, deviation * deviation)

    def outlook(self, distance: Array, entering: NDArray[np.bool_]) -> Outlook:
        """Return the outlook on the present bar at distances ahead [mm], or where ``entering`` on an unmeasured bar.

        Both have shape (num_envs, points).
        """
        found = np.empty((len(Outlook._fields), *distance.shape))
        look_ahead(self._parameters, self._memory, self.mean, self.covariance, distance, entering, found)
        return Outlook(*found)


def _numbers(scenario: Scenario, uncertainty: Uncertainty) -> dict[str, Any]:
    """Return the ``PARAMETERS`` of a nominal model."""
    control, machine, sensors, work = scenario.control, scenario.machine, scenario.sensors, scenario.workpiece
    wear, laws = scenario.material.wear, (scenario.material.thrust_force, scenario.material.power)
    along = np.array([work.depth_along_spread / work.depth_of_cut, work.hardness_along_spread])
    bar = np.array([work.depth_bar_spread / work.depth_of_cut, work.hardness_bar_spread])
    spread = hypotenuse(along, bar)
    slope = SLOPE * along / np.array([work.depth_correlation_length, work.hardness_correlation_length])
    # An edge's wear also deviates from nominal because of the depth and hardness of the bars that it has cut.
    history = np.square(wear.depth_of_cut * spread[0]) + np.square(wear.hardness * spread[1])
    insert = np.sqrt(np.square(scenario.tool.wear_factor_spread) + history)
    errors = (uncertainty.laws * each for law in LAW_ERRORS for each in law)
    prior = spread[0], slope[0], spread[1], slope[1], insert, wear.time * uncertainty.lot, *errors
    sub_step = control.interval / control.sub_steps
    times = sub_step * np.arange(1.0, control.sub_steps + 1.0)
    spindle, feed = decay(times, machine.spindle_time_constant), decay(times, machine.feed_time_constant)
    return {
        "depth_of_cut": work.depth_of_cut,
        "approach": work.approach,
        "bar_length": work.bar_length,
        "pitch": work.bar_length + work.approach,
        "velocity": 1000.0 / (60.0 * math.pi * work.diameter),
        "rates": np.divide(slope, spread, out=np.zeros(2), where=spread > 0),
        "prior": np.square(prior),
        "history": history,
        "log_laws": [(log(law(1.0, 1.0, work.depth_of_cut)), law.cutting_speed, law.feed, law.wear) for law in laws],
        "bar_exponents": [(law.depth_of_cut, law.hardness) for law in laws],
        "references": log([control.initial_cutting_speed, control.initial_feed, 0.5 * scenario.tool.wear_criterion]),
        "lags": [sensors.force_time_constant, sensors.power_time_constant],
        "noise": [np.square(noise) + np.square(READING_DEVIATION) for noise in (sensors.force_noise, sensors.power_noise)],
        "interval": control.interval,
        "sub_step": sub_step,
        "spindle_left": spindle.sum(),
        "feed_left": feed.sum(),
        "both_left": (spindle * feed).sum(),
        "sub_steps": control.sub_steps,
        "wear_criterion": scenario.tool.wear_criterion,
        "idle_power": idle_power_at(scenario, 1.0),
    }


def feed_velocity(scenario: Scenario, cutting_speed: Array, feed: Array) -> Array:
    """Return the feed velocity [mm/s] at a cutting speed [m/min] and a feed [mm/rev]."""
    return cutting_speed * feed * (1000.0 / (60.0 * np.pi * scenario.workpiece.diameter))


def decay(time: Array, time_constant: float | Array) -> Array:
    """Return the share of a deviation that remains after a time [s]: exp(-time / time_constant), 0 for a time constant of 0."""
    lag = np.asarray(time_constant, np.float64)
    return np.where(lag > 0, exp(-time / np.where(lag > 0, lag, 1.0)), np.where(time > 0, 0.0, 1.0))
