"""An extended Kalman filter of bar, edge and laws from measured thrust force and power, with a nominal model per environment.

Force and power are power laws, so their log ratios to the nominal model are nearly linear in the states:

    log ratio = c log(depth / nominal) + h log(hardness) + e w + b + v log(V / V0) + s log(f / f0) + g log(W / W0) + noise
    w = insert + lot,   W = nominal wear * exp(w)

Depth and hardness vary along the bar and from bar to bar, as stationary processes with a slope (Matern 3/2: correlation
(1 + a) exp(-a), a = rate * distance). Their variance is the sum of the scenario's variances; the rate follows from the mean
square slope along a bar. ``insert`` and ``lot`` are log wear factors of the edge and of all edges of the job. Each law has a bias
b and errors v, s and g of its exponents of speed, feed and wear, constant for a job (dual estimation). They count from the
initial speed V0 and feed f0, and from half the wear criterion, W0. Without ``LawErrors`` laws and lot are known.

If edges are inspected, the wear of a removed edge measures insert + lot. Observations do not contain the position, so the filter
integrates the travelled distance to know when the next bar begins.
"""

import math
from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from baselines.models import kalman_steps
from baselines.models.kalman_steps import ERRORS, HISTORY, INSERT, LAWS, LOT, MEMORY, STATES, decay
from baselines.rule import Array, Mask
from turning_env import Reading, Scenario
from turning_env.numerics.functions import hypotenuse, log
from turning_env.physics.spindle import idle_power_at

SLOPE = 1.603  # root mean square slope along a bar, times correlation length over spread: sqrt(pi/2 + 1) for nodes of fields
READING_DEVIATION = 1e-3  # log standard deviation of readings beside noise [-] (assumption): steps are not resolved exactly
MISFIT = (
    0.02  # log standard deviation of loads about the corrected laws [-] (found on training jobs)
)


class LawErrors(NamedTuple):
    """Mean and covariance of the errors of a nominal model's laws, true less nominal; see ``baselines/law_errors.py``.

    They are those of wear (logarithm of the rate at which life is used, its exponent of speed over the nominal one, less 1, and
    its exponent of feed), of force and of power (logarithm, exponents of speed, feed and wear).
    """

    mean: Array  # shape (errors,)
    covariance: Array  # shape (errors, errors)


class Outlook(NamedTuple):
    """Expected loads at points ahead of the tool; every field has shape (num_envs, points)."""

    depth_of_cut: Array  # [mm]
    log_hardness: Array  # [-]
    log_force: Array  # log ratio of thrust force to the nominal law with ``LoadFilter.exponents``, at nominal wear [-]
    log_power: Array  # likewise of power, with the idling spindle's
    force_spread: Array  # standard deviation of log force [-]
    power_spread: Array  # standard deviation of log power [-]


def records(rows: Sequence[dict[str, Any]]) -> Any:
    """Return one record for each row of numbers and arrays, for compiled loops."""
    fields: Any = [(name, np.float64, np.shape(value)) for name, value in rows[0].items()]
    return np.array([tuple(row.values()) for row in rows], np.dtype((np.record, fields)))


def model_of(
    scenarios: Sequence[Scenario], errors: LawErrors | None = None
) -> tuple[Any, Array, Array]:
    """Return what a filter knows of nominal models, with ``errors`` or right: records, expected states and their covariance."""
    parameters = records([_numbers(scenario, errors is not None) for scenario in scenarios])
    mean, covariance = (
        np.zeros((len(scenarios), STATES)),
        parameters["prior"][:, :, np.newaxis] * np.eye(STATES),
    )
    if errors is not None:
        wear = (scenario.material.wear for scenario in scenarios)
        scales = np.array(
            [[law.time, law.cutting_speed, law.time] + [1.0] * (STATES - LAWS) for law in wear]
        )
        mean[:, LOT:] = scales * errors.mean
        covariance[:, LOT:, LOT:] = (
            scales[:, :, np.newaxis] * errors.covariance * scales[:, np.newaxis, :]
        )
    return parameters, mean, covariance


class LoadFilter:
    """A filter that estimates the states of many environments from readings, with one nominal model or one for each."""

    def __init__(
        self, scenarios: Sequence[Scenario], num_envs: int, errors: LawErrors | None = None
    ) -> None:
        self.parameters, self._mean, self._covariance = model_of(scenarios, errors)
        self.mean = np.zeros((num_envs, STATES))  # expected states
        self.covariance = np.zeros((num_envs, STATES, STATES))  # their covariance
        self.memory = np.zeros(
            num_envs, MEMORY
        )  # records of what the filter keeps beside the states

    def assign(self, env_index: int, model: tuple[Any, Array, Array]) -> None:
        """Give an environment, of as many as there are models, another nominal model, and reset it."""
        for known, other in zip(
            (self.parameters, self._mean, self._covariance), model, strict=True
        ):
            known[env_index] = other[0]
        self.reset(np.arange(len(self._mean)) == env_index)

    def reset(self, mask: Mask) -> None:
        """Reset to the start of the first bar and to the prior."""
        scenarios = np.flatnonzero(mask) % len(self._mean)
        self.mean[mask], self.covariance[mask] = self._mean[scenarios], self._covariance[scenarios]
        self.memory[mask] = np.zeros((), MEMORY)

    @property
    def prior_deviations(self) -> Array:
        """Standard deviations of the states before an edge's first cut, shape (models, STATES)."""
        deviations = np.sqrt(np.diagonal(self._covariance, axis1=1, axis2=2))
        deviations[:, HISTORY] = deviations[:, INSERT]
        return deviations

    @property
    def along(self) -> Array:
        """Position from the start of the present bar's approach [mm], shape (num_envs,)."""
        path, pitch = self.memory["path"], self.parameters["pitch"]
        return np.asarray(path - pitch * np.floor(path / pitch))

    @property
    def log_wear_factor(self) -> Array:
        """Expected log ratio of wear to the nominal model [-], shape (num_envs,)."""
        return np.asarray(sum(weight * self.mean[:, state] for state, weight in self._wear_states))

    @property
    def wear_deviation(self) -> Array:
        """Standard deviation of the log wear factor [-], shape (num_envs,)."""
        pairs = product(self._wear_states, repeat=2)
        variance = sum(one * other * self.covariance[:, i, k] for (i, one), (k, other) in pairs)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    @property
    def _wear_states(self) -> list[tuple[int, Any]]:
        """Return the states that the log wear factor contains, and their weights."""
        return list(enumerate((1.0, 1.0, 1.0, *self.memory["pace"].T), INSERT))

    @property
    def wear_errors(self) -> Array:
        """Expected errors of the law of wear: logarithm at 1 m/min and 1 mm/rev, exponents of both; shape (3, num_envs)."""
        lot, speed, feed = self.mean[:, LOT:LAWS].T
        log_speed, log_feed, _ = self.parameters["references"].T
        return np.stack([lot - speed * log_speed - feed * log_feed, speed, feed])

    @property
    def load_errors(self) -> Array:
        """Expected log errors of force and power at 1 m/min, 1 mm/rev and the wear criterion; shape (2, num_envs)."""
        bias, *exponents = self.mean[:, LAWS:].reshape(-1, 2, ERRORS).T
        log_speed, log_feed, log_wear = self.parameters["references"].T
        deviations = -log_speed, -log_feed, log(self.parameters["wear_criterion"]) - log_wear
        return np.asarray(
            bias
            + sum(error * deviation for error, deviation in zip(exponents, deviations, strict=True))
        )

    @property
    def exponents(self) -> Array:
        """Expected exponents of speed, feed and wear of force and power [-], shape (num_envs, 2, 3)."""
        errors = self.mean[:, LAWS:].reshape(-1, 2, ERRORS)[:, :, 1:]
        return np.asarray(self.parameters["log_laws"][:, :, 1:] + errors)

    def observe(self, reading: Reading, mask: Mask | None = None) -> None:
        """Predict up to a reading and correct the estimate by it, in the environments of a mask or in all."""
        columns = (
            *(
                reading.commanded_cutting_speed,
                reading.commanded_feed,
                reading.cutting_speed,
                reading.feed,
            ),
            *(
                reading.cutting_time,
                reading.nominal_wear,
                reading.removed_wear,
                reading.thrust_force,
                reading.power,
            ),
            reading.cutting,
        )
        readings = np.stack(columns, axis=1).astype(np.float64)
        chosen = np.arange(len(readings)) if mask is None else np.flatnonzero(mask)
        kalman_steps.follow(
            self.parameters, self.memory, self.mean, self.covariance, readings, chosen
        )

    def tell(self, mask: Mask, states: Array, deviation: float) -> None:
        """Correct the estimates of a mask by true deviation of depth, log hardness and log wear factor, shape (num_envs, 3)."""
        kalman_steps.learn_states(
            self.memory,
            self.mean,
            self.covariance,
            np.flatnonzero(mask),
            states,
            deviation * deviation,
        )

    def outlook(self, distance: Array, entering: Mask) -> Outlook:
        """Return the outlook at distances ahead [mm], shape (num_envs, points); if ``entering``, on an unmeasured bar."""
        found = np.empty((len(Outlook._fields), *distance.shape))
        kalman_steps.look_ahead(
            self.parameters, self.memory, self.mean, self.covariance, distance, entering, found
        )
        return Outlook(*found)


def _numbers(scenario: Scenario, errors: bool) -> dict[str, Any]:
    """Return the numbers of a nominal model, which may have ``errors``, for ``kalman_steps.py``."""
    control, machine, sensors, work = (
        scenario.control,
        scenario.machine,
        scenario.sensors,
        scenario.workpiece,
    )
    wear, laws = scenario.material.wear, (scenario.material.thrust_force, scenario.material.power)
    along = np.array([work.depth_along_spread / work.depth_of_cut, work.hardness_along_spread])
    bar = np.array([work.depth_bar_spread / work.depth_of_cut, work.hardness_bar_spread])
    spread = hypotenuse(along, bar)
    slope = (
        SLOPE * along / np.array([work.depth_correlation_length, work.hardness_correlation_length])
    )
    # An edge's wear also deviates from nominal because of the depth and hardness of the bars that it has cut.
    by_bars = wear.depth_of_cut, wear.hardness
    history = (
        0.0 if errors else np.square(by_bars[0] * spread[0]) + np.square(by_bars[1] * spread[1])
    )
    insert = np.sqrt(np.square(scenario.tool.wear_factor_spread) + history)
    prior = np.square(
        [spread[0], slope[0], spread[1], slope[1], insert] + [0.0] * (STATES - HISTORY)
    )
    noise = np.square([sensors.force_noise, sensors.power_noise]) + np.square(READING_DEVIATION)
    sub_step = control.interval / control.sub_steps
    times = sub_step * np.arange(1.0, control.sub_steps + 1.0)
    spindle, feed = (
        np.vectorize(decay)(times, lag)
        for lag in (machine.spindle_time_constant, machine.feed_time_constant)
    )
    return {
        "depth_of_cut": work.depth_of_cut,
        "approach": work.approach,
        "bar_length": work.bar_length,
        "pitch": work.bar_length + work.approach,
        "velocity": 1000.0
        / (60.0 * math.pi * work.diameter),  # feed velocity [mm/s] per cutting speed and feed
        "rates": np.divide(
            slope, spread, out=np.zeros(2), where=spread > 0
        ),  # of depth and hardness [1/mm]
        "prior": prior,  # variances
        "history": history,  # variance of an edge's log wear from the bars that it has cut, if they are not followed
        "history_exponents": by_bars if errors else (0.0, 0.0),  # of depth and hardness in wear
        "wear_time": wear.time,
        "separates_idle": float(
            errors
        ),  # whether the idling spindle's power is told from that of the cut
        # Log force [N] and power [kW] at 1 m/min, 1 mm/rev and 1 mm of wear; exponents.
        "log_laws": [
            (log(law(1.0, 1.0, work.depth_of_cut)), law.cutting_speed, law.feed, law.wear)
            for law in laws
        ],
        "bar_exponents": [(law.depth_of_cut, law.hardness) for law in laws],
        "references": log(
            [
                control.initial_cutting_speed,
                control.initial_feed,
                0.5 * scenario.tool.wear_criterion,
            ]
        ),
        "lags": [sensors.force_time_constant, sensors.power_time_constant],
        "noise": noise + np.square(MISFIT) if errors else noise,  # variances
        "interval": control.interval,
        "sub_step": sub_step,
        "spindle_left": spindle.sum(),  # sums over a step's sub-steps of deviations that remain
        "feed_left": feed.sum(),
        "both_left": (spindle * feed).sum(),
        "sub_steps": control.sub_steps,
        "wear_criterion": scenario.tool.wear_criterion,
        "idle_power": idle_power_at(scenario, 1.0),  # [kW] per cutting speed
    }
