"""An extended Kalman filter of depth of cut, hardness and the wear factor of the insert.

Measured thrust force and power are power laws of all three, so their log ratios to the nominal model are nearly linear:

    log ratio = c log(depth / nominal) + h log(hardness) + e log(wear factor) + noise

The three have different weights in force and power. Depth and hardness vary along the bar and from bar to bar; the wear factor
belongs to the insert. Depth and hardness are modelled as stationary processes with a slope (Matern 3/2: correlation
(1 + a) exp(-a), a = rate * distance). The variance is the sum of the scenario's variances; the rate follows from the mean square
slope along a bar.

Observations do not contain the position, so the filter integrates the travelled distance to know when the next bar begins.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turning_env import Reading, Scenario
from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.numerics.functions import exp, log

Array = NDArray[np.float64]

DEPTH, DEPTH_SLOPE, HARDNESS, HARDNESS_SLOPE, WEAR = range(5)
"""States: relative deviation of depth [-], its slope [1/mm], log hardness [-], its slope [1/mm], log wear factor [-]."""
SLOPE = 1.603
"""Root mean square slope of noise along a bar, times correlation length over spread: sqrt(pi/2 + 1) for the fields' nodes."""
MIN_DEPTH = 0.05
"""Least expected depth over the nominal depth [-]: the logarithm has no linear approximation near 0."""
MAX_SPREAD = 1.0
"""Upper bound of the log standard deviation of a load [-]: the linear approximation fails beyond it."""
MIN_READING = 0.01
"""Share of the expected reading below which a reading is ignored [-]: the tool does not cut."""
READING_DOUBT = 1e-3
"""Log standard deviation of a reading beside its noise [-] (assumption): the filter does not resolve a step exactly."""

READ = (
    "thrust_force",
    "power",
    "cutting_speed",
    "feed",
    "commanded_cutting_speed",
    "commanded_feed",
    "cutting_time",
    "nominal_wear",
    "cutting",
)
"""Fields of a reading that the filter needs, in the units of ``Reading``; force and power come first."""
SPEED, FEED, COMMANDED_SPEED, COMMANDED_FEED, CUTTING_TIME, NOMINAL_WEAR, CUTTING = range(2, len(READ))
STATE = np.dtype(
    (
        np.record,
        [
            ("estimate", np.float64, 5),
            ("covariance", np.float64, (5, 5)),
            ("expected", np.float64, 2),  # nominal force [N] and power [kW] behind the sensors' lags
            ("path", np.float64),  # travelled distance in air and metal [mm]
            ("cutting_speed", np.float64),  # at the last reading [m/min]; 0 before the first
            ("feed", np.float64),  # likewise [mm/rev]
            ("cutting_time", np.float64),  # likewise [min]
            ("measured", np.bool_),  # whether the present bar has been measured
        ],
    )
)
"""The filter's state of an environment."""


class Outlook(NamedTuple):
    """Expected loads at points ahead of the tool; every field has shape (num_envs, points)."""

    depth_of_cut: Array
    """[mm]"""
    log_hardness: Array
    """[-]"""
    log_force: Array
    """Log ratio of thrust force to the nominal model at nominal wear [-]."""
    log_power: Array
    """Log ratio of power to the nominal model at nominal wear [-]."""
    force_spread: Array
    """Standard deviation of ``log_force`` [-]."""
    power_spread: Array
    """Standard deviation of ``log_power`` [-]."""


class LoadFilter:
    """A filter that estimates depth, hardness and wear factor of many environments from their readings.

    Args:
        scenario: task, with its nominal models, spreads, lags and geometry.
        num_envs: number of environments.
    """

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        control, machine, sensors, work = scenario.control, scenario.machine, scenario.sensors, scenario.workpiece
        wear, laws = scenario.material.wear, (scenario.material.thrust_force, scenario.material.power)
        along = np.array([work.depth_along_spread / work.depth_of_cut, work.hardness_along_spread])
        bar = np.array([work.depth_bar_spread / work.depth_of_cut, work.hardness_bar_spread])
        spread = np.hypot(along, bar)
        slope = SLOPE * along / np.array([work.depth_correlation_length, work.hardness_correlation_length])
        # An edge's wear also deviates from nominal because of the depth and hardness of the bars that it has cut.
        history = (wear.depth_of_cut * spread[0]) ** 2 + (wear.hardness * spread[1]) ** 2
        sub_step = control.interval / control.sub_steps
        times = sub_step * np.arange(1.0, control.sub_steps + 1.0)
        spindle_left, feed_left = decay(times, machine.spindle_time_constant), decay(times, machine.feed_time_constant)
        self._parameters = record(
            {
                "laws": [[np.log(law(1.0, 1.0, work.depth_of_cut)), law.cutting_speed, law.feed, law.wear] for law in laws],
                "exponents": [[law.depth_of_cut, law.hardness, law.wear] for law in laws],
                "rates": np.divide(slope, spread, out=np.zeros(2), where=spread > 0),
                "prior": [*np.stack([spread, slope], axis=1).ravel() ** 2, scenario.tool.wear_factor_spread**2 + history],
                "history": history,
                "lags": [sensors.force_time_constant, sensors.power_time_constant],
                "noise": np.array([sensors.force_noise, sensors.power_noise]) ** 2 + READING_DOUBT**2,
                "sub_step": sub_step,
                "interval": control.interval,
                # Mean remaining deviations of speed, of feed and of both in a step.
                "left": [spindle_left.mean(), feed_left.mean(), (spindle_left * feed_left).mean()],
                "approach": work.approach,
                "bar_length": work.bar_length,
                "depth_of_cut": work.depth_of_cut,
                "velocity": feed_velocity(scenario, 1.0, 1.0),
            }
        )
        self._fresh = np.zeros(1, STATE)[0]
        self._fresh["covariance"] = np.diag(self._parameters["prior"][0])
        self._pitch = work.bar_length + work.approach
        self._states = np.zeros(num_envs, STATE)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Reset to the start of the first bar and to the prior."""
        self._states[mask] = self._fresh

    @property
    def along(self) -> Array:
        """Position from the start of the present bar's approach [mm], shape (num_envs,)."""
        path: Array = self._states["path"]
        return np.asarray(path - self._pitch * np.floor(path / self._pitch))

    @property
    def measured(self) -> NDArray[np.bool_]:
        """Whether the present bar has been measured, shape (num_envs,)."""
        return np.asarray(self._states["measured"])

    @property
    def log_wear_factor(self) -> Array:
        """Expected log ratio of wear to the nominal model [-], shape (num_envs,)."""
        return np.asarray(self._states["estimate"][:, WEAR])

    @property
    def wear_doubt(self) -> Array:
        """Standard deviation of the log wear factor [-], shape (num_envs,)."""
        return np.sqrt(np.maximum(self._states["covariance"][:, WEAR, WEAR], 0.0))

    def observe(self, reading: Reading) -> None:
        """Predict up to a reading and correct the estimate by it."""
        observe(self._states, self._parameters, np.stack([getattr(reading, name) for name in READ], axis=1, dtype=np.float64))

    def ahead(self, distance: Array) -> Outlook:
        """Return the outlook on the present bar at distances ahead [mm], shape (num_envs, points)."""
        found = np.empty((len(Outlook._fields), *distance.shape))
        look_ahead(self._states, self._parameters, np.ascontiguousarray(distance), found)
        return Outlook(*found)

    def next_bar(self) -> Outlook:
        """Return the outlook on an unmeasured bar, at one point."""
        return self.ahead(np.full((len(self._states), 1), np.inf))


@compiled_entry
def observe(states, parameters, readings):
    """Predict the states up to readings, shape (num_envs, len(READ)), and correct them."""
    p = parameters[0]
    for i in range(len(states)):
        state, reading = states[i], readings[i]
        first = state.cutting_speed == 0.0
        fresh_edge = reading[CUTTING_TIME] < state.cutting_time
        if fresh_edge:
            forget_edge(state, p)
        moved = 0.0 if first else travelled(state, reading, p)
        if fresh_edge and reading[CUTTING_TIME] == 0.0:
            moved *= 0.5  # an edge that is found worn or broken ends the step early, somewhere
        pitch = p.bar_length + p.approach
        bar = np.floor(state.path / pitch)
        state.path = on_track(state.path + moved, reading[CUTTING] > 0.0, p)
        if np.floor(state.path / pitch) > bar:
            forget_bar(state, p)
        metal = max(state.path - pitch * np.floor(state.path / pitch) - p.approach, 0.0)  # of this bar, behind the tool [mm]
        predict(state, min(max(moved, 0.0), metal), p)
        time_in_metal = 0.0 if first else min(metal / (p.velocity * reading[SPEED] * reading[FEED]), p.interval)
        learn(state, reading, time_in_metal, p)
        state.cutting_speed, state.feed, state.cutting_time = reading[SPEED], reading[FEED], reading[CUTTING_TIME]


@compiled_entry
def look_ahead(states, parameters, distances, outlook):
    """Fill an outlook, shape (fields, num_envs, points), at distances ahead on the present bar [mm]; infinite: any other bar."""
    p = parameters[0]
    for i in range(len(states)):
        for k in range(distances.shape[1]):
            predict_loads(states[i], distances[i, k], p, outlook[:, i, k])


@compiled_entry
def correct_by_truth(states, told, truth, variance):
    """Correct depth, hardness and wear factor by true values, shape (num_envs, 3), where they are told."""
    for i in range(len(states)):
        if told[i]:
            for k in range(3):
                row = np.zeros(5)
                row[2 * k] = 1.0
                correct(states[i], row, truth[i, k] - states[i].estimate[2 * k], variance)
            states[i].measured = True


@compiled
def travelled(state, reading, p):
    """Return the distance since the last reading [mm], from the drives' response to their commands."""
    speed, feed = reading[COMMANDED_SPEED], reading[COMMANDED_FEED]
    speed_off, feed_off = state.cutting_speed - speed, state.feed - feed
    mean = speed * feed + p.left[0] * speed_off * feed + p.left[1] * speed * feed_off + p.left[2] * speed_off * feed_off
    return p.interval * p.velocity * mean


@compiled
def on_track(path, cutting, p):
    """Return the distance [mm], corrected if it contradicts the reading on whether the tool cuts."""
    pitch = p.bar_length + p.approach
    start = pitch * np.floor(path / pitch)
    along = path - start
    in_air = along < p.approach
    if cutting and in_air:
        return start + p.approach if along > 0.5 * p.approach else max(start - 1e-6, 0.0)
    if not cutting and not in_air:
        return start + pitch + 1e-6 if along > 0.5 * pitch else start
    return path


@compiled
def forget_bar(state, p):
    """Reset depth and hardness to the prior; keep the wear factor."""
    for j in range(WEAR):
        state.estimate[j] = 0.0
        for k in range(5):
            state.covariance[j, k] = state.covariance[k, j] = 0.0
        state.covariance[j, j] = p.prior[j]
    state.measured = False


@compiled
def forget_edge(state, p):
    """Reset the wear factor to the prior; keep depth and hardness."""
    state.estimate[WEAR] = 0.0
    for k in range(5):
        state.covariance[WEAR, k] = state.covariance[k, WEAR] = 0.0
    state.covariance[WEAR, WEAR] = p.prior[WEAR]
    state.expected[:] = 0.0


@compiled
def transition(rate, distance):
    """Return the transition matrix (a, b; c, d) of a deviation and its slope over a distance [mm]."""
    if distance == np.inf:
        return 0.0, 0.0, 0.0, 0.0
    step = rate * distance
    stay = exp(-step)
    return (1.0 + step) * stay, distance * stay, -rate * step * stay, (1.0 - step) * stay


@compiled
def predict(state, cut, p):
    """Predict the state after a distance in metal [mm]."""
    mean, covariance = state.estimate, state.covariance
    for first in (DEPTH, HARDNESS):
        second = first + 1
        a, b, c, d = transition(p.rates[first // 2], cut)
        mean[first], mean[second] = a * mean[first] + b * mean[second], c * mean[first] + d * mean[second]
        for j in range(5):
            x, y = covariance[first, j], covariance[second, j]
            covariance[first, j], covariance[second, j] = a * x + b * y, c * x + d * y
        for j in range(5):
            x, y = covariance[j, first], covariance[j, second]
            covariance[j, first], covariance[j, second] = a * x + b * y, c * x + d * y
        x, y = p.prior[first], p.prior[second]
        covariance[first, first] += x - (a * a * x + b * b * y)
        covariance[first, second] -= a * c * x + b * d * y
        covariance[second, first] -= a * c * x + b * d * y
        covariance[second, second] += y - (c * c * x + d * d * y)
    covariance[WEAR, WEAR] += p.history * cut / p.bar_length


@compiled
def load(exponents, depth, log_hardness, log_wear_factor):
    """Return the log ratio of a load to the nominal model at a depth over the nominal depth."""
    return exponents[0] * log(depth) + exponents[1] * log_hardness + exponents[2] * log_wear_factor


@compiled
def predict_loads(state, distance, p, outlook):
    """Fill an outlook at a distance ahead [mm]."""
    mean, covariance = state.estimate, state.covariance
    a, b, _, _ = transition(p.rates[0], distance)
    c, d, _, _ = transition(p.rates[1], distance)
    depth = max(1.0 + a * mean[DEPTH] + b * mean[DEPTH_SLOPE], MIN_DEPTH)
    log_hardness = c * mean[HARDNESS] + d * mean[HARDNESS_SLOPE]
    outlook[0], outlook[1] = p.depth_of_cut * depth, log_hardness
    for k in range(2):
        exponents = p.exponents[k]
        by_depth, by_hardness = exponents[0] / depth, exponents[1]
        row = (a * by_depth, b * by_depth, c * by_hardness, d * by_hardness, exponents[2])
        variance = by_depth**2 * (p.prior[DEPTH] - a * a * p.prior[DEPTH] - b * b * p.prior[DEPTH_SLOPE])
        variance += by_hardness**2 * (p.prior[HARDNESS] - c * c * p.prior[HARDNESS] - d * d * p.prior[HARDNESS_SLOPE])
        for i in range(5):
            for j in range(5):
                variance += row[i] * covariance[i, j] * row[j]
        outlook[2 + k] = load(exponents, depth, log_hardness, mean[WEAR])
        outlook[4 + k] = np.sqrt(min(max(variance, 0.0), MAX_SPREAD**2))


@compiled
def learn(state, reading, time_in_metal, p):
    """Correct the state by measured force and power."""
    cutting = reading[CUTTING] > 0.0 and reading[NOMINAL_WEAR] > 0.0
    mean = state.estimate
    depth, log_hardness, log_wear_factor = max(1.0 + mean[DEPTH], MIN_DEPTH), mean[HARDNESS], mean[WEAR]
    before = mean.copy()
    row = np.zeros(5)
    for k in range(2):
        law, exponents, lag = p.laws[k], p.exponents[k], p.lags[k]
        nominal = 0.0
        if cutting:
            nominal = exp(
                law[0] + law[1] * log(reading[SPEED]) + law[2] * log(reading[FEED]) + law[3] * log(reading[NOMINAL_WEAR])
            )
        state.expected[k] = state.expected[k] * remaining(p.interval, lag) + nominal * (1.0 - remaining(time_in_metal, lag))
        expected = state.expected[k]
        if not cutting or expected <= 0.5 * nominal or reading[k] <= MIN_READING * nominal:
            continue
        # Behind its lag a reading depends on when the tool entered, which is known to a sub-step.
        timing = 0.5 * p.sub_step * (nominal / expected - 1.0) / lag if lag > 0.0 else 0.0
        row[DEPTH], row[HARDNESS], row[WEAR] = exponents[0] / depth, exponents[1], exponents[2]
        surprise = log(reading[k] / expected) - load(exponents, depth, log_hardness, log_wear_factor)
        for j in range(5):
            surprise -= row[j] * (mean[j] - before[j])
        correct(state, row, surprise, p.noise[k] + timing**2)
        state.measured = True


@compiled
def correct(state, row, surprise, variance):
    """Correct the state by a measurement: its derivatives by the states, measured less expected, variance of its noise."""
    covariance, shared, spread = state.covariance, np.zeros(5), variance
    for i in range(5):
        for j in range(5):
            shared[i] += covariance[i, j] * row[j]
        spread += row[i] * shared[i]
    for i in range(5):
        gain = shared[i] / spread
        state.estimate[i] += gain * surprise
        for j in range(5):
            covariance[i, j] -= gain * shared[j]


@compiled
def remaining(time, time_constant):
    """Return ``decay`` of a time constant [s] from 0."""
    if time_constant > 0.0:
        return exp(-time / time_constant)
    return 0.0 if time > 0.0 else 1.0


def record(values: dict[str, Any]) -> Any:
    """Return numbers, and arrays of them, as an array of one record."""
    fields: Any = [(name, np.float64, np.shape(value)) for name, value in values.items()]
    found = np.zeros(1, np.dtype((np.record, fields)))
    for name, value in values.items():
        found[name] = value
    return found


def feed_velocity(scenario: Scenario, cutting_speed: Array | float, feed: Array | float) -> Any:
    """Return the feed velocity [mm/s] at a cutting speed [m/min] and a feed [mm/rev]."""
    return cutting_speed * feed * (1000.0 / (60.0 * np.pi * scenario.workpiece.diameter))


def decay(time: Array, time_constant: float | Array) -> Array:
    """Return the share of a deviation that remains after a time [s]: exp(-time / time_constant), 0 for a time constant of 0."""
    lag = np.asarray(time_constant, np.float64)
    return np.where(lag > 0, np.exp(-time / np.where(lag > 0, lag, 1.0)), np.where(time > 0, 0.0, 1.0))
