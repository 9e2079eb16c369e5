"""An extended Kalman filter of bar, edge and laws from measured thrust force and power.

Each environment has a nominal model. Force and power are power laws, so their log ratios to the
nominal model are nearly linear in the states:

    log ratio = c log(depth / nominal) + h log(hardness) + e log(U(W) / U(nominal wear))
              + b + v log(V / V0) + s log(f / f0) + g log(U(W) / U(W0)) + noise
    w = insert + history + lot,   W = nominal wear * exp(w)

Depth and hardness vary along the bar and from bar to bar, as stationary processes with a slope
(Matern 3/2: correlation (1 + a) exp(-a), a = rate * distance). Their variance is the sum of the
scenario's variances; the rate follows from the mean square slope along a bar. ``insert`` is the log
wear factor of the edge, ``history`` that of the bars that it has cut, ``lot`` that of all edges of
the job. Each law has a bias b and errors v, s and g of its exponents of speed, feed and wear,
constant for a job (dual estimation). They count from the initial speed V0 and feed f0, and from
half the wear criterion, W0. U is the laws' wear term, W or 1 + wear_growth W. Without
``LawErrors``, laws and lot are known.

If edges are inspected, the wear of a removed edge measures its log wear factor. Observations do not
contain the position, so the filter integrates the travelled distance to know when the next bar
begins.

The equations are in ``kalman_steps.py``. This file is their interface: the numbers of a nominal
model, and the estimates in the units that controllers use.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from baselines.models import kalman_steps
from baselines.models.kalman_steps import (
    BIAS,
    ERRORS,
    FEED_ERROR,
    HISTORY,
    INSERT,
    LAWS,
    LOT,
    MEMORY,
    READING,
    SPEED_ERROR,
    STATES,
    WEAR_ERROR,
    WEAR_FEED,
    WEAR_SPEED,
    TrueStates,
    decay,
)
from baselines.rule import Array, Mask
from turning_env import Reading, Scenario
from turning_env.numerics.functions import hypotenuse, log
from turning_env.numerics.wear_term import log_wear_term
from turning_env.scenario.laws import hardness_spread, idle_power_at

SLOPE = 1.603
"""Root mean square slope along a bar, times correlation length over spread: sqrt(pi/2 + 1) for
nodes of fields."""
READING_DEVIATION = 1e-3
"""Log standard deviation of readings beside noise [-] (assumption): steps are not resolved
exactly."""
MISFIT = 0.02
"""Log standard deviation of loads about the corrected laws [-] (found on training jobs)."""


class LawErrors(NamedTuple):
    """Mean and covariance of the errors of a nominal model's laws, true less nominal.

    See ``baselines/law_errors.py``.

    They are those of wear (logarithm of the rate at which life is used, its exponent of speed over
    the nominal one, less 1, and its exponent of feed), of force and of power (logarithm, exponents
    of speed, feed and wear).
    """

    mean: Array  # shape (errors,)
    covariance: Array  # shape (errors, errors)


class Outlook(NamedTuple):
    """Expected loads at points ahead of the tool; every field has shape (num_envs, points)."""

    depth_of_cut: Array  # [mm]
    log_hardness: Array  # [-]
    # Log ratios to the nominal laws with ``LoadFilter.exponents`` [-], at nominal wear. Power
    # contains that of the idling spindle.
    log_force: Array
    log_power: Array
    # Standard deviations of log force and log power [-].
    force_spread: Array
    power_spread: Array


class WearErrors(NamedTuple):
    """Expected errors of the law of wear; every field has shape (num_envs,)."""

    log_wear: Array  # at 1 m/min and 1 mm/rev [-]
    speed_exponent: Array  # [-]
    feed_exponent: Array  # [-]


class LoadExponents(NamedTuple):
    """Exponents in the laws of force and power [-]; every field has shape (2, num_envs).

    ``kalman_steps.FORCE`` and ``POWER`` are the places of the laws.
    """

    speed: Array
    feed: Array
    wear: Array


class Prior(NamedTuple):
    """The knowledge of a filter before its first reading, for some nominal models."""

    parameters: Any  # records of ``filter_numbers_of``, shape (models,)
    mean: Array  # expected states, shape (models, STATES)
    covariance: Array  # shape (models, STATES, STATES)


def records(rows: Sequence[dict[str, Any]]) -> Any:
    """Return one record for each row of numbers and arrays, for compiled loops."""
    fields: Any = []
    for name, value in rows[0].items():
        fields.append((name, np.float64, np.shape(value)))
    filled = np.empty(len(rows), np.dtype((np.record, fields)))
    for i, row in enumerate(rows):
        for name, value in row.items():
            filled[name][i] = value
    return filled


def model_of(scenarios: Sequence[Scenario], errors: LawErrors | None = None) -> Prior:
    """Return the filter's knowledge of nominal models, whose laws have ``errors`` or are right."""
    learns_laws = errors is not None
    rows = [filter_numbers_of(scenario, learns_laws) for scenario in scenarios]
    parameters = records(rows)
    mean = np.zeros((len(rows), STATES))
    covariance = parameters["prior"][:, :, np.newaxis] * np.eye(STATES)
    if errors is not None:
        # The states from ``LOT`` on are the errors, in the same order. Errors of wear are given as
        # those of the used life, which is wear to the power 1 / time exponent.
        wear_laws = [scenario.material.wear for scenario in scenarios]
        scales = np.ones((len(rows), STATES))
        scales[:, LOT] = [law.time for law in wear_laws]
        scales[:, WEAR_SPEED] = [law.cutting_speed for law in wear_laws]
        scales[:, WEAR_FEED] = scales[:, LOT]
        error_scales = scales[:, LOT:]
        rows_scaled = error_scales[:, :, np.newaxis] * errors.covariance
        mean[:, LOT:] = error_scales * errors.mean
        covariance[:, LOT:, LOT:] = rows_scaled * error_scales[:, np.newaxis, :]
    return Prior(parameters, mean, covariance)


class LoadFilter:
    """A filter that estimates the states of many environments from readings.

    Args:
        scenarios: one nominal model, or one for each environment.
        num_envs: number of environments.
        errors: expected errors of the laws; None: the laws are right.

    Attributes:
        parameters: records of the nominal models, see ``filter_numbers_of``.
        mean: expected states, shape (num_envs, STATES).
        covariance: their covariance, shape (num_envs, STATES, STATES).
        memory: records of ``kalman_steps.MEMORY``, shape (num_envs,).
    """

    def __init__(
        self, scenarios: Sequence[Scenario], num_envs: int, errors: LawErrors | None = None
    ) -> None:
        self._prior = model_of(scenarios, errors)
        self.parameters = self._prior.parameters
        self.mean = np.zeros((num_envs, STATES))
        self.covariance = np.zeros((num_envs, STATES, STATES))
        self.memory = np.zeros(num_envs, MEMORY)

    def assign(self, env_index: int, model: Prior) -> None:
        """Give an environment another nominal model, and reset it."""
        prior = self._prior
        prior.parameters[env_index] = model.parameters[0]
        prior.mean[env_index] = model.mean[0]
        prior.covariance[env_index] = model.covariance[0]
        environments = np.arange(len(prior.mean))
        self.reset(environments == env_index)

    def reset(self, mask: Mask) -> None:
        """Reset to the start of the first bar and to the prior."""
        prior = self._prior
        environments = np.flatnonzero(mask)
        models = environments % len(prior.mean)
        self.mean[mask] = prior.mean[models]
        self.covariance[mask] = prior.covariance[models]
        self.memory[mask] = np.zeros((), MEMORY)

    @property
    def prior_deviations(self) -> Array:
        """Standard deviations of the states before an edge's first cut, shape (models, STATES)."""
        deviations = np.sqrt(np.diagonal(self._prior.covariance, axis1=1, axis2=2))
        # The history of a fresh edge is known: it is 0. The insert's deviation gives it a scale.
        deviations[:, HISTORY] = deviations[:, INSERT]
        return deviations

    @property
    def along(self) -> Array:
        """Position from the start of the present bar's approach [mm], shape (num_envs,)."""
        path = self.memory["path"]
        pitch = self.parameters["pitch"]
        return np.asarray(path - pitch * np.floor(path / pitch))

    @property
    def log_wear_factor(self) -> Array:
        """Expected log ratio of wear to the nominal model [-], shape (num_envs,)."""
        return np.asarray(
            sum(weight * self.mean[:, state] for state, weight in self._wear_weights.items())
        )

    @property
    def wear_deviation(self) -> Array:
        """Standard deviation of the log wear factor [-], shape (num_envs,)."""
        weights = self._wear_weights
        variance: Any = 0.0
        for row, row_weight in weights.items():
            for column, column_weight in weights.items():
                variance = variance + row_weight * column_weight * self.covariance[:, row, column]
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    @property
    def _wear_weights(self) -> dict[int, Any]:
        """Weights of the states in the log wear factor, as in ``kalman_steps.log_wear_factor``."""
        return {
            INSERT: 1.0,
            HISTORY: 1.0,
            LOT: 1.0,
            WEAR_SPEED: self.memory["mean_log_speed"],
            WEAR_FEED: self.memory["mean_log_feed"],
        }

    @property
    def wear_errors(self) -> WearErrors:
        """Expected errors of the law of wear.

        With the errors v and s of the exponents, which count from the speed V0 and the feed f0:

            log wear / nominal wear = lot + v log(V / V0) + s log(f / f0)

        The record holds its value at V = f = 1.
        """
        lot = self.mean[:, LOT]  # log wear factor of all edges of the job
        speed_error = self.mean[:, WEAR_SPEED]
        feed_error = self.mean[:, WEAR_FEED]
        log_speed = self.parameters["reference_log_speed"]
        log_feed = self.parameters["reference_log_feed"]
        return WearErrors(
            log_wear=lot - speed_error * log_speed - feed_error * log_feed,
            speed_exponent=speed_error,
            feed_exponent=feed_error,
        )

    @property
    def load_errors(self) -> Array:
        """Expected log errors of force and power at 1 m/min, 1 mm/rev and the wear criterion.

        Shape (2, num_envs).
        """
        errors = self._law_errors
        log_speed = self.parameters["reference_log_speed"]
        log_feed = self.parameters["reference_log_feed"]
        growth = self.parameters["wear_growths"].T
        worn_out = log_wear_term(growth, log(self.parameters["wear_criterion"]))
        wear_deviation = worn_out - log_wear_term(growth, self.parameters["reference_log_wear"])
        by_exponents = (
            errors[SPEED_ERROR] * -log_speed
            + errors[FEED_ERROR] * -log_feed
            + errors[WEAR_ERROR] * wear_deviation
        )
        return np.asarray(errors[BIAS] + by_exponents)

    @property
    def exponents(self) -> LoadExponents:
        """Expected exponents in the laws of force and power."""
        errors = self._law_errors
        return LoadExponents(
            speed=self.parameters["speed_exponents"].T + errors[SPEED_ERROR],
            feed=self.parameters["feed_exponents"].T + errors[FEED_ERROR],
            wear=self.parameters["wear_exponents"].T + errors[WEAR_ERROR],
        )

    @property
    def worn_out_growths(self) -> Array:
        """Growth of the wear terms of force and power at the wear criterion: shape (2, num_envs).

        It is 0 for a power law (``numerics/wear_term.py``).
        """
        growths = self.parameters["wear_growths"] * self.parameters["wear_criterion"][:, np.newaxis]
        return np.broadcast_to(growths.T, (2, len(self.mean)))

    @property
    def _law_errors(self) -> Array:
        """Expected errors of the laws of force and power, shape (ERRORS, 2, num_envs)."""
        return self.mean[:, LAWS:].reshape(-1, 2, ERRORS).T

    def observe(self, reading: Reading, mask: Mask | None = None) -> None:
        """Predict up to a reading and correct the estimate by it, in a mask or everywhere."""
        readings = np.zeros(len(self.mean), READING)
        for name in READING.names or ():
            readings[name] = getattr(reading, name)
        chosen = np.arange(len(readings)) if mask is None else np.flatnonzero(mask)
        kalman_steps.follow(
            self.parameters, self.memory, self.mean, self.covariance, readings, chosen
        )

    def tell(self, mask: Mask, true_states: TrueStates, deviation: float) -> None:
        """Correct the estimates of a mask by true states with a standard deviation [-]."""
        kalman_steps.learn_states(
            self.memory,
            self.mean,
            self.covariance,
            np.flatnonzero(mask),
            true_states,
            deviation * deviation,
        )

    def outlook(self, distance: Array, entering: Mask) -> Outlook:
        """Return the outlook at distances ahead [mm], shape (num_envs, points).

        If ``entering``, on an unmeasured bar.
        """
        outlook = Outlook(*np.empty((len(Outlook._fields), *distance.shape)))
        kalman_steps.look_ahead(
            self.parameters,
            self.memory,
            self.mean,
            self.covariance,
            distance,
            # A copy, because Numba compiles once more for a mask that is read-only or broadcast.
            np.array(entering, order="C"),
            outlook,
        )
        return outlook


def travel_numbers_of(scenario: Scenario) -> dict[str, float]:
    """Return the numbers of a nominal model by which ``distance_moved`` follows the tool."""
    control = scenario.control
    machine = scenario.machine
    work = scenario.workpiece
    # Shares of a deviation of the drives that remain in the sub-steps of a step.
    sub_step = control.interval / control.sub_steps
    times = sub_step * np.arange(1.0, control.sub_steps + 1.0)
    spindle_left = np.vectorize(decay)(times, machine.spindle_time_constant)
    feed_left = np.vectorize(decay)(times, machine.feed_time_constant)
    return {
        "approach": work.approach,  # [mm]
        "bar_length": work.bar_length,  # [mm]
        "pitch": work.bar_length + work.approach,  # [mm]
        # Feed velocity [mm/s] per cutting speed [m/min] and feed [mm/rev]: ``feed_velocity_at`` in
        # another order, whose last bits recorded actions have.
        "velocity": 1000.0 / (60.0 * math.pi * work.diameter),
        "sub_step": sub_step,  # [s]
        # Sums over the sub-steps of a step.
        "spindle_left": float(spindle_left.sum()),
        "feed_left": float(feed_left.sum()),
        "both_left": float((spindle_left * feed_left).sum()),
        "sub_steps": control.sub_steps,
    }


def filter_numbers_of(scenario: Scenario, errors: bool) -> dict[str, Any]:
    """Return the numbers of a nominal model, which may have ``errors``, for ``kalman_steps.py``."""
    control = scenario.control
    tool = scenario.tool
    sensors = scenario.sensors
    work = scenario.workpiece
    wear = scenario.material.wear
    laws = (scenario.material.thrust_force, scenario.material.power)

    # ``laws.depth_spread`` over the depth, but divided first: recorded actions have its last bits.
    depth_along = work.depth_along_spread / work.depth_of_cut
    depth_spread = hypotenuse(depth_along, work.depth_bar_spread / work.depth_of_cut)
    depth_slope = SLOPE * depth_along / work.depth_correlation_length
    hardness_along = work.hardness_along_spread
    log_hardness_spread = hardness_spread(work)
    hardness_slope = SLOPE * hardness_along / work.hardness_correlation_length

    # The depth and hardness of the bars that an edge has cut move its wear, too. If the laws are
    # right, the loads show little of it, and it counts with the insert. Otherwise the state
    # ``HISTORY`` follows it.
    history = 0.0
    if not errors:
        history = np.square(wear.depth_of_cut * depth_spread) + np.square(
            wear.hardness * log_hardness_spread
        )
    insert = np.sqrt(np.square(tool.wear_factor_spread) + history)
    prior = np.zeros(STATES)
    prior[:HISTORY] = [depth_spread, depth_slope, log_hardness_spread, hardness_slope, insert]
    noise = np.square([sensors.force_noise, sensors.power_noise]) + np.square(READING_DEVIATION)

    return travel_numbers_of(scenario) | {
        "depth_of_cut": work.depth_of_cut,  # [mm]
        # Rates of the correlations of depth and hardness [1/mm].
        "depth_rate": depth_slope / depth_spread if depth_spread > 0.0 else 0.0,
        "hardness_rate": hardness_slope / log_hardness_spread if log_hardness_spread > 0.0 else 0.0,
        "prior": np.square(prior),  # variances of the states
        # Variance of an edge's log wear from the bars that it has cut, if they are not followed.
        "history": history,
        # Exponents of depth and hardness in the law of wear, if the bars are followed.
        "wear_by_depth": wear.depth_of_cut if errors else 0.0,
        "wear_by_hardness": wear.hardness if errors else 0.0,
        "wear_time": wear.time,  # exponent of time in the law of wear
        # 1 if the idling spindle's power is told from that of the cut, else 0.
        "separates_idle": float(errors),
        # Laws of force [N] and power [kW]: logarithm at 1 m/min, 1 mm/rev and a wear term of 1;
        # exponents. The wear term is 1 at 1 mm or, with a growth, for a fresh edge.
        "log_coefficients": [
            log(law(1.0, 1.0, work.depth_of_cut, wear=float(law.wear_growth == 0.0)))
            for law in laws
        ],
        "speed_exponents": [law.cutting_speed for law in laws],
        "feed_exponents": [law.feed for law in laws],
        "wear_exponents": [law.wear for law in laws],
        "wear_growths": [law.wear_growth for law in laws],  # [1/mm]
        "depth_exponents": [law.depth_of_cut for law in laws],
        "hardness_exponents": [law.hardness for law in laws],
        # Speed, feed and wear from which the errors of exponents count.
        "reference_log_speed": log(control.initial_cutting_speed),
        "reference_log_feed": log(control.initial_feed),
        "reference_log_wear": log(0.5 * tool.wear_criterion),
        # Sensors of force and power: time constants [s] and variances of the log readings.
        "lags": [sensors.force_time_constant, sensors.power_time_constant],
        "noise": noise + np.square(MISFIT) if errors else noise,
        "interval": control.interval,  # [s]
        "wear_criterion": tool.wear_criterion,  # [mm]
        "idle_power": idle_power_at(scenario, 1.0),  # [kW] per cutting speed
    }
