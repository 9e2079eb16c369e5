"""The greatest return of an edge for policies that know a bar only by its readings: a belief-state bound.

It is an information relaxation with penalties (Brown, Smith and Sun 2010, doi 10.1287/opre.1090.0796). The clairvoyant bound
knows the loads of every step and sets the feed right at the limit. Here, every action is scored by its expected gain given the
readings so far: the penalty removes the surprise of the actual loads. Only the future motion of beliefs, and so the coming
bars, are still known in advance.

The lathe is idealised, as for the clairvoyant bound. Nothing lags, no force breaks the edge, any speed and feed may follow any
other, and wear is known. Settings are chosen once per stretch of metal of a fixed length, at whose start force and power are
read; a longer stretch means fewer readings and older ones. Then the beliefs do not depend on the actions, and dynamic
programming over the used share D of the edge's life gives the bound of a seed.
"""

import math

import numpy as np
from numpy.typing import NDArray

from baselines.models.kalman_steps import MAX_SPREAD, MIN_DEPTH
from baselines.models.load_filter import READING_DEVIATION
from baselines.models.normal import excess
from baselines.oracles.cells import between, start_episode_of, survey
from turning_env import Scenario
from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.physics.records import block_records

Array = NDArray[np.float64]

BARS = 24  # length of the row for a nominal insert, which lasts for half of it; the row's end hardly matters then
LIVES = 100  # steps of the used share of life
_POINTS = np.array([0.25, 0.75])  # of a stretch, at which loads are expected
_SPEEDS = np.array(
    [-0.1, -0.05, 0.0, 0.05, 0.1]
)  # log steps from the speed at which force and power meet their limits
_LADDER = 4  # speeds beside them
_FEEDS = np.arange(-0.16, 0.09, 0.02)  # log steps from the feed at the limit


class NodeFilter:
    """An extended Kalman filter of depth and hardness in many bars with readings at the same places.

    The simulator blends independent normal nodes, one correlation length apart. So each field is linear in four states: the
    value at the tool, the node behind it, the bar's offset and the node ahead. The last three are in units of their spreads.
    The filter keeps them for depth (relative deviation) and for log hardness. Given the position, only the logarithm of depth
    is not linear.
    """

    def __init__(self, scenario: Scenario, bars: int) -> None:
        work, sensors, material = scenario.workpiece, scenario.sensors, scenario.material
        self._depth = work.depth_of_cut
        along = work.depth_along_spread / work.depth_of_cut, work.hardness_along_spread
        bar = work.depth_bar_spread / work.depth_of_cut, work.hardness_bar_spread
        self._fields = tuple(
            zip(
                bar,
                along,
                (work.depth_correlation_length, work.hardness_correlation_length),
                strict=True,
            )
        )
        self._exponents = np.array(
            [[law.depth_of_cut, law.hardness] for law in (material.thrust_force, material.power)]
        )
        self._variance = (
            np.array([sensors.force_noise, sensors.power_noise]) ** 2 + READING_DEVIATION**2
        )
        self.mean = np.zeros((bars, 8))
        self.covariance = np.zeros((bars, 8, 8)) + np.diag(
            [each for b, a, _ in self._fields for each in (a * a + b * b, 1, 1, 1)]
        )

    def move(self, place: float, distance: float) -> tuple[Array, Array]:
        """Return mean and covariance at a distance from a place [mm]."""
        transition, growth = np.zeros((2, 8, 8))
        for first, (bar, along, length) in zip((0, 4), self._fields, strict=True):
            here, behind, offset, ahead = range(first, first + 4)
            end = (place + distance) / length + 1e-12
            share = end - np.floor(end)
            weights = (
                along * (1.0 - share**2) / (1.0 + share**2),
                along * 2.0 * share / (1.0 + share**2),
            )
            transition[offset, offset], transition[here, offset] = 1.0, bar
            if np.floor(end) > np.floor(
                place / length + 1e-12
            ):  # the node ahead is behind, and the next one is unknown
                transition[behind, ahead], transition[here, ahead] = 1.0, weights[0]
                growth[ahead, ahead], growth[here, here] = 1.0, weights[1] ** 2
                growth[here, ahead] = growth[ahead, here] = weights[1]
            else:
                transition[behind, behind] = transition[ahead, ahead] = 1.0
                transition[here, behind], transition[here, ahead] = weights
        return self.mean @ transition.T, transition @ self.covariance @ transition.T + growth

    def _loads(self, mean: Array) -> tuple[Array, Array]:
        """Return the log ratios of force and power to nominal, shape (bars, 2), and their derivatives, shape (bars, 2, 8)."""
        depth = np.maximum(1.0 + mean[:, 0], MIN_DEPTH)
        derivatives = np.zeros((len(mean), 2, 8))
        derivatives[:, :, 0], derivatives[:, :, 4] = (
            self._exponents[:, 0] / depth[:, np.newaxis],
            self._exponents[:, 1],
        )
        return np.stack([np.log(depth), mean[:, 4]], axis=1) @ self._exponents.T, derivatives

    def read(self, log_depth: Array, log_hardness: Array, noise: Array) -> None:
        """Correct the estimate by readings of force and power at true log ratios of depth and hardness to nominal.

        ``noise`` is standard normal, shape (bars, 2).
        """
        loads, derivatives = self._loads(self.mean)
        surprise = (
            np.stack([log_depth, log_hardness], axis=1) @ self._exponents.T
            + np.sqrt(self._variance) * noise
            - loads
        )
        spread = derivatives @ self.covariance @ derivatives.swapaxes(1, 2) + np.diag(
            self._variance
        )
        gain = np.linalg.solve(spread, derivatives @ self.covariance).swapaxes(1, 2)
        self.mean += np.einsum("nij,nj->ni", gain, surprise)
        covariance = self.covariance - gain @ derivatives @ self.covariance
        self.covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))

    def belief(self, place: float, distance: float) -> Array:
        """Return the belief at a distance from a place [mm], shape (6, bars).

        Depth of cut [mm], log hardness, log ratios of force and power to nominal, and the standard deviations of these ratios.
        """
        mean, covariance = self.move(place, distance)
        loads, derivatives = self._loads(mean)
        variances = np.einsum("nai,nij,naj->na", derivatives, covariance, derivatives)
        depth = self._depth * np.maximum(1.0 + mean[:, 0], MIN_DEPTH)
        return np.stack(
            [depth, mean[:, 4], *loads.T, *np.sqrt(np.clip(variances, 0.0, MAX_SPREAD**2)).T]
        )


def bound(scenario: Scenario, seed: int, stretch: float = 3.2, lives: int = LIVES) -> float:
    """Return the bound on the return [s] of a seed's first episode.

    Args:
        scenario: task, which the clairvoyant bound must cover, without depth profile, skin or base speed.
        seed: seed of the episode.
        stretch: length of metal [mm] cut with one setting; 3.2 mm are a second of the best policies.
        lives: steps of the root of the used share of life.
    """
    states, parameters, scratch = block_records(scenario)
    states["seed"][0, 0] = seed
    start_episode_of(states, parameters, scratch)
    cells = round(scenario.workpiece.bar_length / stretch)
    wear = scenario.material.wear
    fields = np.empty((3, cells))
    survey(states, parameters, scratch, fields, cells)
    log_wear_factor = fields[2, 0]
    bars = math.ceil(BARS * math.exp(-log_wear_factor / wear.time))
    fields = np.empty((3, bars * cells))
    survey(states, parameters, scratch, fields, cells)
    lengths, believed = beliefs(
        scenario, fields[:2].reshape(2, bars, cells), np.random.default_rng(seed)
    )
    life = (
        wear.depth_of_cut * np.log(believed[0] / scenario.workpiece.depth_of_cut)
        + wear.hardness * believed[1]
    )
    believed[1] = np.exp((life + log_wear_factor) / wear.time)
    return float(
        _best_return(
            states, parameters, scratch, lengths, believed, _SPEEDS, _LADDER, _FEEDS, lives
        )
    )


def beliefs(
    scenario: Scenario, truth: Array, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Return the stretches' lengths [mm] and the belief on their metal before they are cut.

    Args:
        scenario: task.
        truth: logarithms of depth of cut [mm] and of hardness in the middle of cells, where loads are read;
            shape (2, bars, cells).
        generator: draws the readings' noise.

    Returns:
        Lengths, shape (bars, stretches), and beliefs as ``NodeFilter.belief`` returns them, shape (6, bars, stretches, points).
    """
    _, bars, cells = truth.shape
    lengths = np.full(cells + 1, scenario.workpiece.bar_length / cells)
    lengths[[0, -1]] *= 0.5
    believed = np.empty((6, bars, cells + 1, len(_POINTS)))
    known, place = NodeFilter(scenario, bars), 0.0
    for i, length in enumerate(lengths):
        if i:
            known.mean, known.covariance = known.move(place, lengths[i - 1])
            place += lengths[i - 1]
            log_depth = truth[0, :, i - 1] - np.log(scenario.workpiece.depth_of_cut)
            known.read(log_depth, truth[1, :, i - 1], generator.normal(size=(bars, 2)))
        believed[:, :, i] = np.stack(
            [known.belief(place, length * point) for point in _POINTS], axis=-1
        )
    return np.broadcast_to(lengths, (bars, cells + 1)).copy(), believed


@compiled
def expected_excess(log_mean, spread):
    """Return the expectation of max(X - 1, 0), where log X is normal with this mean and standard deviation."""
    spread = max(spread, 1e-3)
    return 0.0 if log_mean < -6.0 * spread else excess(log_mean, spread)[0]


@compiled_entry
def _best_return(
    states, parameters, scratches, lengths, beliefs, speed_steps, ladder, feed_steps, lives
):
    """Return the bound on the return [s]; ``beliefs`` as from ``beliefs``, with the factor on the rate of wear in place 1."""
    state, p = states[0], parameters[0]
    wear_law, force_law, power_law = p.wear_law, p.force_law, p.power_law
    low_speed, high_speed = np.log(p.cutting_speed_min[0]), np.log(p.cutting_speed_max[0])
    low_feed, high_feed = np.log(p.feed_min[0]), np.log(p.feed_max[0])
    crossing = 60.0 / p.revolutions_per_metre[0]  # time [s] of 1 mm at 1 m/min and 1 mm/rev
    air = p.approach[0] * crossing * np.exp(-high_speed - high_feed)
    log_depth = np.log(p.depth_of_cut[0])
    at_nominal = (
        wear_law.log_coefficient[0] + wear_law.depth_of_cut[0] * log_depth - p.log_wear_criterion[0]
    )
    nominal_life = at_nominal * p.life_exponent[0] - np.log(60.0)
    speeds = np.empty(speed_steps.shape[0] + 2 + ladder)
    values, next_values = np.zeros(lives + 1), np.zeros(lives + 1)
    points = beliefs.shape[3]
    meet = (
        force_law.cutting_speed[0] * power_law.feed[0]
        - force_law.feed[0] * power_law.cutting_speed[0]
    )
    for bar in range(lengths.shape[0] - 1, -1, -1):
        for i in range(lengths.shape[1] - 1, -1, -1):
            length = lengths[bar, i]
            depth, rate, force_mean, power_mean = 0.0, 0.0, 0.0, 0.0
            for q in range(points):
                depth += beliefs[0, bar, i, q] / points
                rate += beliefs[1, bar, i, q] / points
                force_mean += beliefs[2, bar, i, q] / points
                power_mean += beliefs[3, bar, i, q] / points
            worth = length * 60.0 / p.revolutions_per_metre[0] / p.reference_removal_rate[0] * depth
            for j in range(lives):
                used = (j / lives) ** 2
                log_wear = p.log_wear_criterion[0] + wear_law.time[0] * np.log(max(used, 1e-9))
                force = (
                    force_law.log_coefficient[0]
                    + force_law.depth_of_cut[0] * log_depth
                    + force_law.wear[0] * log_wear
                )
                force -= np.log(p.thrust_force_limit[0])
                power = (
                    power_law.log_coefficient[0]
                    + power_law.depth_of_cut[0] * log_depth
                    + power_law.wear[0] * log_wear
                )
                power -= np.log(p.power_limit[0])
                f, w = force + force_mean, power + power_mean
                for k in range(speeds.shape[0]):
                    if k < speed_steps.shape[0]:
                        speed = (
                            w * force_law.feed[0] - f * power_law.feed[0]
                        ) / meet + speed_steps[k]
                    elif k == speed_steps.shape[0]:
                        speed = -(f + force_law.feed[0] * high_feed) / force_law.cutting_speed[0]
                    elif k == speed_steps.shape[0] + 1:
                        speed = -(w + power_law.feed[0] * high_feed) / power_law.cutting_speed[0]
                    else:
                        share = (k - speed_steps.shape[0] - 2) / max(ladder - 1, 1)
                        speed = low_speed + (high_speed - low_speed) * (0.4 + 0.6 * share)
                    speeds[k] = min(max(speed, low_speed), high_speed)
                best = -np.inf
                for speed in speeds:
                    kink = min(
                        -(f + force_law.cutting_speed[0] * speed) / force_law.feed[0],
                        -(w + power_law.cutting_speed[0] * speed) / power_law.feed[0],
                    )
                    kink = min(max(kink, low_feed), high_feed)
                    for step in feed_steps:
                        feed = min(max(kink + step, low_feed), high_feed)
                        time = length * crossing * np.exp(-speed - feed)
                        f_here = (
                            force + force_law.cutting_speed[0] * speed + force_law.feed[0] * feed
                        )
                        w_here = (
                            power + power_law.cutting_speed[0] * speed + power_law.feed[0] * feed
                        )
                        over = 0.0
                        for q in range(points):
                            over += (
                                expected_excess(
                                    f_here + beliefs[2, bar, i, q], beliefs[4, bar, i, q]
                                )
                                / points
                            )
                            over += (
                                expected_excess(
                                    w_here + beliefs[3, bar, i, q], beliefs[5, bar, i, q]
                                )
                                / points
                            )
                        taylor = (
                            nominal_life
                            + (wear_law.cutting_speed[0] * speed + wear_law.feed[0] * feed)
                            * p.life_exponent[0]
                        )
                        using = rate * np.exp(taylor) * time
                        gain = (
                            worth
                            - time * (1.0 + p.overload_price[0] * over)
                            - p.edge_price[0] * using
                        )
                        after = used + using
                        if after >= 1.0:
                            gain *= (1.0 - used) / using
                        else:
                            gain += between(next_values, np.sqrt(after) * lives)
                        best = max(best, gain)
                values[j] = best
            values[lives] = 0.0
            if i == 0:
                values[:lives] -= air
            values, next_values = next_values, values
    return between(next_values, np.sqrt(min(state.used_life[0], 1.0)) * lives)
