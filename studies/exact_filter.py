"""A planner with the exact filter of the bars: how far a policy can go that sees observations only.

The filter of ``predictive`` models depth and hardness along a bar as a process with a slope. The simulator blends independent
normal nodes, one correlation length apart. Given the tool's position, the fields are linear in the nodes, so a Kalman filter of
the nodes is exact but for the logarithm of depth. The planner is ``predictive`` on these beliefs, and can be told hidden states.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.models.kalman_steps import MAX_SPREAD, MIN_DEPTH, MIN_READING
from baselines.models.load_filter import READING_DOUBT, Array, Outlook, decay, feed_velocity
from baselines.oracles.perfect_state import DOUBT, true_states
from baselines.predictive import Predictive
from turning_env import Reading, Scenario

DEPTH, DEPTH_NODE, HARDNESS, HARDNESS_NODE, WEAR = range(5)
"""States [-]: relative deviation of depth, its node behind, log hardness, its node behind, log wear factor."""
HIDDEN = {"depth": DEPTH, "hardness": HARDNESS, "wear": WEAR}
"""States that can be told, by name, in the order of ``true_states``."""
_STATES = 9
_FIELDS = ((DEPTH, DEPTH_NODE, 5, 6), (HARDNESS, HARDNESS_NODE, 7, 8))
"""States of depth and of hardness: the value here, the node behind, the bar's offset and the node ahead."""


class NodeFilter:
    """A load filter of the nodes on either side of the tool and of each bar's offsets, all standard normal.

    Its interface is that of ``baselines.models.load_filter.LoadFilter``.
    """

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        self._scenario = scenario
        control, machine, sensors, work = scenario.control, scenario.machine, scenario.sensors, scenario.workpiece
        wear, force, power = scenario.material.wear, scenario.material.thrust_force, scenario.material.power
        self._exponents = np.array([[law.depth_of_cut, law.hardness, law.wear] for law in (force, power)])
        along = np.array([work.depth_along_spread / work.depth_of_cut, work.hardness_along_spread])
        bar = np.array([work.depth_bar_spread / work.depth_of_cut, work.hardness_bar_spread])
        spread = np.hypot(along, bar)
        # An edge's wear also deviates from nominal because of the depth and hardness of the bars that it has cut.
        self._history = (wear.depth_of_cut * spread[0]) ** 2 + (wear.hardness * spread[1]) ** 2
        insert = scenario.tool.wear_factor_spread**2
        self._spreads = tuple(zip(bar, along, strict=True))
        self._lengths = work.depth_correlation_length, work.hardness_correlation_length
        self._prior = np.ones(_STATES)
        self._prior[[DEPTH, HARDNESS]] = spread**2
        self._prior[WEAR] = insert + self._history
        self._lags = np.array([sensors.force_time_constant, sensors.power_time_constant])
        self._noise = np.array([sensors.force_noise, sensors.power_noise]) ** 2 + READING_DOUBT**2
        self._sub_step = control.interval / control.sub_steps
        times = self._sub_step * np.arange(1.0, control.sub_steps + 1.0)
        self._spindle_left = decay(times, machine.spindle_time_constant)
        self._feed_left = decay(times, machine.feed_time_constant)
        self._pitch = work.bar_length + work.approach
        self._mean = np.zeros((num_envs, _STATES))
        self._covariance = np.zeros((num_envs, _STATES, _STATES))
        self._expected = np.zeros((num_envs, 2))  # nominal force [N] and power [kW] behind the sensors' lags
        self._path = np.zeros(num_envs)  # travelled distance in air and metal [mm]
        self._speed = np.zeros(num_envs)  # at the last reading [m/min]; 0 before the first
        self._feed = np.zeros(num_envs)  # likewise [mm/rev]
        self._cutting_time = np.zeros(num_envs)  # likewise [min]
        self.measured = np.zeros(num_envs, np.bool_)
        """Whether the present bar has been measured."""

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Reset to the start of the first bar and to the prior."""
        self._mean[mask] = 0.0
        self._covariance[mask] = np.diag(self._prior)
        self._path[mask] = 0.0
        self._speed[mask] = 0.0
        self._cutting_time[mask] = 0.0
        self._expected[mask] = 0.0
        self.measured[mask] = False

    @property
    def along(self) -> Array:
        """Position from the start of the present bar's approach [mm], shape (num_envs,)."""
        return self._path - self._pitch * np.floor(self._path / self._pitch)

    @property
    def log_wear_factor(self) -> Array:
        """Expected log ratio of wear to the nominal model [-], shape (num_envs,)."""
        return self._mean[:, WEAR]

    @property
    def log_lot_factor(self) -> Array:
        """Expected part of it that all edges of the job share: none."""
        return np.zeros(len(self._mean))

    @property
    def wear_doubt(self) -> Array:
        """Standard deviation of the log wear factor [-], shape (num_envs,)."""
        return np.sqrt(np.maximum(self._covariance[:, WEAR, WEAR], 0.0))

    def observe(self, reading: Reading) -> None:
        """Predict up to a reading and correct the estimate by it."""
        first = self._speed == 0.0
        fresh_edge = reading.cutting_time < self._cutting_time
        self._change_edges(fresh_edge)
        moved = np.where(first, 0.0, self._moved(reading))
        # An edge that is found worn or broken ends the step early, somewhere.
        moved *= np.where(fresh_edge & (reading.cutting_time == 0.0), 0.5, 1.0)
        bar = np.floor(self._path / self._pitch)
        self._path = self._on_track(self._path + moved, reading.cutting)
        self._enter_bars(np.floor(self._path / self._pitch) > bar)
        metal = np.maximum(self.along - self._scenario.workpiece.approach, 0.0)  # of this bar, behind the tool [mm]
        cut = np.clip(moved, 0.0, metal)
        transition, growth = self._transition(cut)
        growth[:, WEAR, WEAR] = self._history * cut / self._scenario.workpiece.bar_length
        self._mean = np.einsum("nij,nj->ni", transition, self._mean)
        self._covariance = transition @ self._covariance @ transition.swapaxes(1, 2) + growth
        velocity = feed_velocity(self._scenario, reading.cutting_speed, reading.feed)
        self._learn(reading, np.where(first, 0.0, np.minimum(metal / velocity, self._scenario.control.interval)))
        self._speed, self._feed, self._cutting_time = reading.cutting_speed, reading.feed, reading.cutting_time

    def ahead(self, distance: Array) -> Outlook:
        """Return the outlook on the present bar at distances ahead [mm], shape (num_envs, points)."""
        transition, growth = self._transition(distance)
        mean = np.einsum("nkij,nj->nki", transition, self._mean)
        covariance = transition @ self._covariance[:, np.newaxis] @ transition.swapaxes(-1, -2) + growth
        return self._outlook(mean, covariance)

    def next_bar(self) -> Outlook:
        """Return the outlook on an unmeasured bar, at one point."""
        mean = np.zeros_like(self._mean)
        mean[:, WEAR] = self._mean[:, WEAR]
        covariance = np.zeros_like(self._covariance) + np.diag(self._prior)
        covariance[:, WEAR, WEAR] = self._covariance[:, WEAR, WEAR]
        return self._outlook(mean[:, np.newaxis], covariance[:, np.newaxis])

    @property
    def exponents(self) -> Array:
        """Exponents of speed, feed and wear of force and power [-], shape (1, 2, 3)."""
        laws = self._scenario.material.thrust_force, self._scenario.material.power
        return np.array([[(law.cutting_speed, law.feed, law.wear) for law in laws]])

    def outlook(self, distance: Array, entering: NDArray[np.bool_]) -> Outlook:
        """Return the outlook at distances ahead [mm], or where ``entering`` on an unmeasured bar, shape (num_envs, points)."""
        return Outlook(*(np.where(entering, b, a) for a, b in zip(self.ahead(distance), self.next_bar(), strict=True)))

    def _moved(self, reading: Reading) -> Array:
        """Return the distance since the last reading [mm], from the drives' response to their commands."""
        speed = reading.commanded_cutting_speed[:, np.newaxis]
        feed = reading.commanded_feed[:, np.newaxis]
        speed = speed + (self._speed[:, np.newaxis] - speed) * self._spindle_left
        feed = feed + (self._feed[:, np.newaxis] - feed) * self._feed_left
        return np.asarray(self._sub_step * feed_velocity(self._scenario, speed, feed).sum(axis=1))

    def _on_track(self, path: Array, cutting: NDArray[np.bool_]) -> Array:
        """Return the distance [mm], corrected if it contradicts the reading on whether the tool cuts."""
        approach = self._scenario.workpiece.approach
        start = self._pitch * np.floor(path / self._pitch)
        along = path - start
        in_air = along < approach
        behind = np.where(in_air, along > 0.5 * approach, along > 0.5 * self._pitch)
        leaves = np.where(behind, start + approach, np.maximum(start - 1e-6, 0.0))
        enters = np.where(behind, start + self._pitch + 1e-6, start)
        return np.where(cutting & in_air, leaves, np.where(~cutting & ~in_air, enters, path))

    def _enter_bars(self, mask: NDArray[np.bool_]) -> None:
        """Reset depth and hardness to the prior; keep the wear factor."""
        doubt, factor = self._covariance[mask, WEAR, WEAR], self._mean[mask, WEAR]
        self._covariance[mask] = np.diag(self._prior)
        self._covariance[mask, WEAR, WEAR] = doubt
        self._mean[mask] = 0.0
        self._mean[mask, WEAR] = factor
        self.measured[mask] = False

    def _change_edges(self, mask: NDArray[np.bool_]) -> None:
        """Reset the wear factor to the prior; keep depth and hardness."""
        self._mean[mask, WEAR] = 0.0
        self._covariance[mask, WEAR, :] = 0.0
        self._covariance[mask, :, WEAR] = 0.0
        self._covariance[mask, WEAR, WEAR] = self._prior[WEAR]
        self._expected[mask] = 0.0

    def _transition(self, distance: Array) -> tuple[Array, Array]:
        """Return transition matrices and added covariances over distances [mm], shape (*distance.shape, states, states)."""
        metal = np.maximum(self.along - self._scenario.workpiece.approach, 0.0)
        # One distance leads to the tool's place, several lead on from there.
        start = metal - distance if distance.ndim == 1 else metal[:, np.newaxis] + np.zeros_like(distance)
        transition = np.zeros((*distance.shape, _STATES, _STATES))
        growth = np.zeros_like(transition)
        transition[..., WEAR, WEAR] = 1.0
        for (here, behind, offset, ahead), (bar, along), length in zip(_FIELDS, self._spreads, self._lengths, strict=True):
            place = (start + distance) / length + 1e-12
            passed = np.floor(place) > np.floor(start / length + 1e-12)
            share = place - np.floor(place)
            weights = along * (1.0 - share**2) / (1.0 + share**2), along * 2.0 * share / (1.0 + share**2)
            transition[..., offset, offset] = 1.0
            transition[..., behind, behind] = transition[..., ahead, ahead] = ~passed
            transition[..., behind, ahead] = passed
            transition[..., here, offset] = bar
            transition[..., here, behind] = np.where(passed, 0.0, weights[0])
            transition[..., here, ahead] = np.where(passed, *weights)
            growth[..., ahead, ahead] = passed
            growth[..., here, here] = np.where(passed, weights[1] ** 2, 0.0)
            growth[..., here, ahead] = growth[..., ahead, here] = np.where(passed, weights[1], 0.0)
        return transition, growth

    def _loads(self, mean: Array) -> tuple[Array, Array]:
        """Return the log ratios of force and power to the nominal model, (..., 2), and their derivatives, (..., 2, states)."""
        depth = np.maximum(1.0 + mean[..., DEPTH], MIN_DEPTH)
        factors = np.stack([np.log(depth), mean[..., HARDNESS], mean[..., WEAR]], axis=-1)
        derivatives = np.zeros((*depth.shape, 2, _STATES))
        derivatives[..., DEPTH] = self._exponents[:, 0] / depth[..., np.newaxis]
        derivatives[..., [HARDNESS, WEAR]] = self._exponents[:, 1:]
        return factors @ self._exponents.T, derivatives

    def _outlook(self, mean: Array, covariance: Array) -> Outlook:
        loads, derivatives = self._loads(mean)
        variances = np.einsum("...ai,...ij,...aj->...a", derivatives, covariance, derivatives)
        spreads = np.sqrt(np.clip(variances, 0.0, MAX_SPREAD**2))
        depth = self._scenario.workpiece.depth_of_cut * np.maximum(1.0 + mean[..., DEPTH], MIN_DEPTH)
        return Outlook(depth, mean[..., HARDNESS], loads[..., 0], loads[..., 1], spreads[..., 0], spreads[..., 1])

    def _learn(self, reading: Reading, time_in_metal: Array) -> None:
        """Correct the estimate by measured force and power."""
        material, depth = self._scenario.material, self._scenario.workpiece.depth_of_cut
        cutting = reading.cutting & (reading.nominal_wear > 0.0)
        wear = np.where(cutting, reading.nominal_wear, self._scenario.tool.wear_criterion)
        laws = (material.thrust_force, material.power)
        nominal = np.stack([law(reading.cutting_speed, reading.feed, depth, wear=wear) for law in laws], axis=1)
        nominal *= cutting[:, np.newaxis]
        interval = np.full((len(wear), 1), self._scenario.control.interval)
        reached = 1.0 - decay(time_in_metal[:, np.newaxis], self._lags)
        self._expected = self._expected * decay(interval, self._lags) + nominal * reached
        measured = np.stack([reading.thrust_force, reading.power], axis=1)
        good = (self._expected > 0.5 * nominal) & (measured > MIN_READING * nominal) & cutting[:, np.newaxis]
        # Behind its lag a reading depends on when the tool entered, which is known to a sub-step.
        expected = np.where(good, self._expected, 1.0)
        drift = np.where(good, nominal / expected - 1.0, 0.0)
        timing = np.divide(0.5 * self._sub_step * drift, self._lags, out=np.zeros_like(drift), where=self._lags > 0)
        loads, derivatives = self._loads(self._mean)
        surprise = np.where(good, np.log(np.where(good, measured, 1.0) / expected) - loads, 0.0)
        self._correct(derivatives * good[..., np.newaxis], surprise, self._noise + timing**2)
        self.measured |= good.any(axis=1)

    def _correct(self, derivatives: Array, surprise: Array, variance: Array) -> None:
        """Correct the estimate by k measurements.

        Args:
            derivatives: of the measurements by the states, shape (num_envs, k, states).
            surprise: measured less expected, shape (num_envs, k).
            variance: of the measurements' noise, likewise.
        """
        spread = derivatives @ self._covariance @ derivatives.swapaxes(1, 2)
        measurements = np.arange(surprise.shape[1])
        spread[:, measurements, measurements] += variance
        gain = np.linalg.solve(spread, derivatives @ self._covariance).swapaxes(1, 2)
        self._mean += np.einsum("nij,nj->ni", gain, surprise)
        covariance = self._covariance - gain @ derivatives @ self._covariance
        self._covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))


class ToldFilter(NodeFilter):
    """A filter of nodes that is told some of the hidden states at the tool after every step."""

    truth: Mapping[str, Any]
    """``info`` of the vector environment that came with the next observations."""

    def __init__(self, scenario: Scenario, num_envs: int, told: Sequence[str]) -> None:
        """``told``: names in ``HIDDEN``."""
        super().__init__(scenario, num_envs)
        self._told = [name for name in HIDDEN if name in told]

    def observe(self, reading: Reading) -> None:
        """Predict up to a reading, and correct the estimate by it and by what is told."""
        super().observe(reading)
        if not self._told:
            return
        known, states = true_states(self.truth, reading, self._scenario.workpiece.depth_of_cut)
        rows = np.eye(_STATES)[[HIDDEN[name] for name in self._told]]
        surprise = states[:, [list(HIDDEN).index(name) for name in self._told]] - self._mean @ rows.T
        surprise = np.where(known[:, np.newaxis], surprise, 0.0)
        self._correct(rows * known[:, np.newaxis, np.newaxis], surprise, np.full(surprise.shape, DOUBT**2))
        self.measured |= known


class Planner(Predictive):
    """``Predictive`` on the exact filter; an oracle if it is told anything."""

    _filter: Any

    def __init__(self, scenario: Scenario, num_envs: int, told: Sequence[str] = ()) -> None:
        self._told = told
        super().__init__(scenario, num_envs, severity=1.0, caution=1.0)

    def _new_filter(self, num_envs: int) -> Any:
        return ToldFilter(self._scenarios[0], num_envs, self._told)

    def tell(self, infos: Mapping[str, Any]) -> None:
        """Take the ``infos`` that came with the next observations."""
        self._filter.truth = infos
