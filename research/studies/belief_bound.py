"""A belief-state bound: the greatest return of an edge if a bar is known only by its readings.

It is an information relaxation with penalties (Brown, Smith and Sun 2010, doi
10.1287/opre.1090.0796). The clairvoyant bound knows the loads of every step and sets the feed right
at the limit. Here, every action is scored by its expected gain given the readings so far: the
penalty removes the surprise of the actual loads. Only the future motion of beliefs, and so the
coming bars, are still known in advance.

The lathe is idealised, as for the clairvoyant bound. Nothing lags, no force breaks the edge, any
speed and feed may follow any other, and wear is known. Settings are chosen once per stretch of
metal of a fixed length, at whose start force and power are read; a longer stretch means fewer
readings and older ones. Then the beliefs do not depend on the actions, and dynamic programming over
the used share D of the edge's life gives the bound of a seed.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.models.kalman_steps import MAX_SPREAD, MIN_DEPTH
from baselines.models.load_filter import READING_DEVIATION
from baselines.models.normal import excess
from baselines.oracles.cells import between, start_episode_of, survey
from turning_env import Scenario
from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.numerics.wear_term import log_wear_term
from turning_env.physics.records import block_records

Array = NDArray[np.float64]

# Length of the row for a nominal insert, which lasts for half of it: the row's end hardly matters.
BARS = 24
LIVES = 100  # steps of the used share of life
_POINTS = np.array([0.25, 0.75])  # of a stretch, at which loads are expected
# Candidates of speed: log steps from the speed at which force and power meet their limits ...
_SPEEDS = np.array([-0.1, -0.05, 0.0, 0.05, 0.1])
_LADDER = 4  # ... and a coarse ladder over the machine's range.
_FEEDS = np.arange(-0.16, 0.09, 0.02)  # log steps from the feed at the limit

# Entries of the state of ``NodeFilter``, which has four for each field.
DEPTH_AT_TOOL = 0
HARDNESS_AT_TOOL = 4

# Rows of a belief (see ``NodeFilter.belief``).
DEPTH = 0
HARDNESS = 1
FORCE = 2
POWER = 3
FORCE_SPREAD = 4
POWER_SPREAD = 5
WEAR_RATE = HARDNESS  # the compiled programme needs the hardness for the wear only


class Field(NamedTuple):
    """How depth (relative deviation) or log hardness varies."""

    bar_spread: float  # standard deviation of a bar's offset [-]
    along_spread: float  # standard deviation along a bar [-]
    correlation_length: float  # [mm]


class NodeFilter:
    """An extended Kalman filter of depth and hardness in many bars, read at the same places.

    The simulator blends independent normal nodes, one correlation length apart. So each field is
    linear in four states: the value at the tool, the node behind it, the bar's offset and the node
    ahead. The last three are in units of their spreads. The filter keeps them for depth (relative
    deviation) and for log hardness. Given the position, only the logarithm of depth is not linear.
    """

    def __init__(self, scenario: Scenario, bars: int) -> None:
        workpiece = scenario.workpiece
        sensors = scenario.sensors
        material = scenario.material
        self._depth = workpiece.depth_of_cut
        depth = Field(
            bar_spread=workpiece.depth_bar_spread / workpiece.depth_of_cut,
            along_spread=workpiece.depth_along_spread / workpiece.depth_of_cut,
            correlation_length=workpiece.depth_correlation_length,
        )
        hardness = Field(
            bar_spread=workpiece.hardness_bar_spread,
            along_spread=workpiece.hardness_along_spread,
            correlation_length=workpiece.hardness_correlation_length,
        )
        self._fields = (depth, hardness)
        force, power = material.thrust_force, material.power
        self._exponents = np.array(
            [[force.depth_of_cut, force.hardness], [power.depth_of_cut, power.hardness]]
        )
        noise = np.array([sensors.force_noise, sensors.power_noise])
        self._variance = noise**2 + READING_DEVIATION**2
        self.mean = np.zeros((bars, 8))
        variances = []
        for field in self._fields:
            # At a bar's start the value is the offset plus the first node; all states are
            # independent.
            variances += [field.along_spread**2 + field.bar_spread**2, 1.0, 1.0, 1.0]
        self.covariance = np.zeros((bars, 8, 8)) + np.diag(variances)

    def move(self, place: float, distance: float) -> tuple[Array, Array]:
        """Return mean and covariance at a distance from a place [mm]."""
        transition = np.zeros((8, 8))
        growth = np.zeros((8, 8))
        for number, field in enumerate(self._fields):
            here = 4 * number
            behind = here + 1
            offset = here + 2
            ahead = here + 3
            length = field.correlation_length
            start_node = np.floor(place / length + 1e-12)
            end = (place + distance) / length + 1e-12
            end_node = np.floor(end)
            share = end - end_node
            # The blend of two nodes that keeps the variance (turning_env/physics/workpiece.py).
            norm = 1.0 + share**2
            weight_behind = field.along_spread * (1.0 - share**2) / norm
            weight_ahead = field.along_spread * 2.0 * share / norm
            transition[offset, offset] = 1.0
            transition[here, offset] = field.bar_spread
            if end_node > start_node:
                # The node ahead is behind now, and the next one is unknown.
                transition[behind, ahead] = 1.0
                transition[here, ahead] = weight_behind
                growth[ahead, ahead] = 1.0
                growth[here, here] = weight_ahead**2
                growth[here, ahead] = weight_ahead
                growth[ahead, here] = weight_ahead
            else:
                transition[behind, behind] = 1.0
                transition[ahead, ahead] = 1.0
                transition[here, behind] = weight_behind
                transition[here, ahead] = weight_ahead
        mean = self.mean @ transition.T
        covariance = transition @ self.covariance @ transition.T + growth
        return mean, covariance

    def _loads(self, mean: Array) -> tuple[Array, Array]:
        """Return the log ratios of force and power to nominal, and their derivatives.

        Shapes: (bars, 2) and (bars, 2, 8).
        """
        depth = np.maximum(1.0 + mean[:, DEPTH_AT_TOOL], MIN_DEPTH)
        log_hardness = mean[:, HARDNESS_AT_TOOL]
        factors = np.stack([np.log(depth), log_hardness], axis=1)
        loads = factors @ self._exponents.T

        depth_exponents = self._exponents[:, 0]
        hardness_exponents = self._exponents[:, 1]
        derivatives = np.zeros((len(mean), 2, 8))
        derivatives[:, :, DEPTH_AT_TOOL] = depth_exponents / depth[:, np.newaxis]
        derivatives[:, :, HARDNESS_AT_TOOL] = hardness_exponents
        return loads, derivatives

    def read(self, log_depth: Array, log_hardness: Array, noise: Array) -> None:
        """Correct the estimate by readings of force and power.

        Args:
            log_depth: true log ratio of the depth of cut to nominal, shape (bars,).
            log_hardness: true log ratio of the hardness to nominal, shape (bars,).
            noise: standard normal, shape (bars, 2).
        """
        expected_loads, derivatives = self._loads(self.mean)
        factors = np.stack([log_depth, log_hardness], axis=1)
        true_loads = factors @ self._exponents.T
        readings = true_loads + np.sqrt(self._variance) * noise
        surprise = readings - expected_loads

        projected = derivatives @ self.covariance @ derivatives.swapaxes(1, 2)
        spread = projected + np.diag(self._variance)
        transposed_gain = np.linalg.solve(spread, derivatives @ self.covariance)
        gain = transposed_gain.swapaxes(1, 2)
        self.mean += np.einsum("nij,nj->ni", gain, surprise)
        covariance = self.covariance - gain @ derivatives @ self.covariance
        # Rounding must not make it asymmetric.
        self.covariance = 0.5 * (covariance + covariance.swapaxes(1, 2))

    def belief(self, place: float, distance: float) -> Array:
        """Return the belief at a distance from a place [mm], shape (6, bars).

        Rows: depth of cut [mm], log hardness, log ratios of force and power to nominal, and the
        standard deviations of these two ratios.
        """
        mean, covariance = self.move(place, distance)
        loads, derivatives = self._loads(mean)
        variances = np.einsum("nai,nij,naj->na", derivatives, covariance, derivatives)
        spreads = np.sqrt(np.clip(variances, 0.0, MAX_SPREAD**2))
        relative_depth = np.maximum(1.0 + mean[:, DEPTH_AT_TOOL], MIN_DEPTH)

        belief = np.empty((6, len(mean)))
        belief[DEPTH] = self._depth * relative_depth
        belief[HARDNESS] = mean[:, HARDNESS_AT_TOOL]
        belief[FORCE] = loads[:, 0]
        belief[POWER] = loads[:, 1]
        belief[FORCE_SPREAD] = spreads[:, 0]
        belief[POWER_SPREAD] = spreads[:, 1]
        return belief


def bound(scenario: Scenario, seed: int, stretch: float = 3.2, lives: int = LIVES) -> float:
    """Return the bound on the return [s] of a seed's first episode.

    Args:
        scenario: task, which the clairvoyant bound must cover, without depth profile, skin or base
            speed.
        seed: seed of the episode.
        stretch: length of metal [mm] cut with one setting; 3.2 mm are a second of the best
            policies.
        lives: steps of the root of the used share of life.
    """
    states, parameters, scratch = block_records(scenario)
    states["seed"][0, 0] = seed
    start_episode_of(states, parameters, scratch)
    cells = round(scenario.workpiece.bar_length / stretch)
    wear = scenario.material.wear

    # A first survey of one bar gives the edge's factor on wear, and so the number of bars.
    fields = np.empty((3, cells))
    survey(states, parameters, scratch, fields, cells)
    log_wear_factor = fields[2, 0]
    bars = math.ceil(BARS * math.exp(-log_wear_factor / wear.time))

    fields = np.empty((3, bars * cells))
    survey(states, parameters, scratch, fields, cells)
    truth = fields[:2].reshape(2, bars, cells)
    generator = np.random.default_rng(seed)
    lengths, believed = beliefs(scenario, truth, generator)

    # The compiled programme takes the factor on the rate of wear in place of the log hardness.
    log_depth_ratio = np.log(believed[DEPTH] / scenario.workpiece.depth_of_cut)
    log_hardness = believed[HARDNESS]
    log_wear_ratio = wear.depth_of_cut * log_depth_ratio + wear.hardness * log_hardness
    believed[WEAR_RATE] = np.exp((log_wear_ratio + log_wear_factor) / wear.time)
    best = _best_return(
        states, parameters, scratch, lengths, believed, _SPEEDS, _LADDER, _FEEDS, lives
    )
    return float(best)


def beliefs(
    scenario: Scenario, truth: Array, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Return the stretches' lengths [mm] and the belief on their metal before they are cut.

    Args:
        scenario: task.
        truth: logarithms of depth of cut [mm] and of hardness in the middle of cells, where loads
            are read; shape (2, bars, cells).
        generator: draws the readings' noise.

    Returns:
        Lengths, shape (bars, stretches), and beliefs as ``NodeFilter.belief`` returns them, shape
        (6, bars, stretches, points).
    """
    true_depth, true_hardness = truth
    bars, cells = true_depth.shape
    nominal_depth = np.log(scenario.workpiece.depth_of_cut)
    # A stretch ends in the middle of a cell, so the first and the last one are half as long.
    stretches = cells + 1
    lengths = np.full(stretches, scenario.workpiece.bar_length / cells)
    lengths[[0, -1]] *= 0.5
    believed = np.empty((6, bars, stretches, len(_POINTS)))
    node_filter = NodeFilter(scenario, bars)
    place = 0.0
    for i, length in enumerate(lengths):
        if i > 0:
            cell = i - 1
            last_length = lengths[cell]
            mean, covariance = node_filter.move(place, last_length)
            node_filter.mean = mean
            node_filter.covariance = covariance
            place += last_length
            node_filter.read(
                log_depth=true_depth[:, cell] - nominal_depth,
                log_hardness=true_hardness[:, cell],
                noise=generator.normal(size=(bars, 2)),
            )
        for k, point in enumerate(_POINTS):
            believed[:, :, i, k] = node_filter.belief(place, length * point)
    lengths_of_bars = np.broadcast_to(lengths, (bars, stretches)).copy()
    return lengths_of_bars, believed


@compiled
def expected_excess(log_mean, spread):
    """Return the expectation of max(X - 1, 0), where log X is normal with this mean and spread."""
    spread = max(spread, 1e-3)
    if log_mean < -6.0 * spread:
        return 0.0
    return excess(log_mean, spread)[0]


@compiled
def _log_load(law, log_depth, log_wear, log_limit):
    """Return the part of the log ratio of a load to its limit that speed and feed do not change."""
    wear_term = log_wear_term(law.wear_growth[0], log_wear)
    load = law.log_coefficient[0] + law.depth_of_cut[0] * log_depth + law.wear[0] * wear_term
    return load - log_limit


@compiled
def _at_setting(log_load, law, speed, feed):
    """Return the log ratio of a load to its limit at a log speed and feed."""
    return log_load + law.cutting_speed[0] * speed + law.feed[0] * feed


@compiled
def _feed_at_limit(log_load, law, speed):
    """Return the log feed at which a load meets its limit at a log speed."""
    return -(log_load + law.cutting_speed[0] * speed) / law.feed[0]


@compiled
def _feed_at_limits(force, power, p, speed):
    """Return the log feed at which a load first meets its limit, or the nearest one in range."""
    at_force = _feed_at_limit(force, p.force_law, speed)
    at_power = _feed_at_limit(power, p.power_law, speed)
    feed = min(at_force, at_power)
    return min(max(feed, np.log(p.feed_min[0])), np.log(p.feed_max[0]))


@compiled
def _expected_overload(force, power, belief):
    """Return the summed expected excess over both limits at log ratios of nominal loads to them.

    ``belief``: shape (6, points), as of ``NodeFilter.belief``.
    """
    points = belief.shape[1]
    overload = 0.0
    for q in range(points):
        force_mean = force + belief[FORCE, q]
        power_mean = power + belief[POWER, q]
        overload += expected_excess(force_mean, belief[FORCE_SPREAD, q]) / points
        overload += expected_excess(power_mean, belief[POWER_SPREAD, q]) / points
    return overload


@compiled
def _mean_of_points(row):
    """Return the mean of a row of a belief, shape (points,)."""
    points = row.shape[0]
    mean = 0.0
    for q in range(points):
        mean += row[q] / points
    return mean


@compiled
def _log_rate_of_life(p):
    """Return the log of the rate at which life is used at 1 m/min and 1 mm/rev [1/s].

    It is that of the nominal wear law.
    """
    law = p.wear_law
    log_depth = np.log(p.depth_of_cut[0])
    log_wear = law.log_coefficient[0] + law.depth_of_cut[0] * log_depth
    over_criterion = log_wear - p.log_wear_criterion[0]
    return over_criterion * p.life_exponent[0] - np.log(60.0)


@compiled
def _rate_of_life(p, nominal, speed, feed):
    """Return the rate at which life is used at a log speed and feed [1/s], by Taylor's law.

    ``nominal``: log rate of ``_log_rate_of_life``.
    """
    law = p.wear_law
    by_setting = law.cutting_speed[0] * speed + law.feed[0] * feed
    return np.exp(nominal + by_setting * p.life_exponent[0])


@compiled
def _set_speeds(speeds, force, power, p, speed_steps):
    """Set the candidates of log cutting speed for log ratios of expected loads to their limits."""
    force_by_speed = p.force_law.cutting_speed[0]
    force_by_feed = p.force_law.feed[0]
    power_by_speed = p.power_law.cutting_speed[0]
    power_by_feed = p.power_law.feed[0]
    low = np.log(p.cutting_speed_min[0])
    high = np.log(p.cutting_speed_max[0])
    high_feed = np.log(p.feed_max[0])
    steps = speed_steps.shape[0]
    ladder = speeds.shape[0] - steps - 2
    # The speed at which both limits allow the same feed solves two linear equations in logarithms.
    determinant = force_by_speed * power_by_feed - force_by_feed * power_by_speed
    for k in range(speeds.shape[0]):
        if k < steps:
            both = (power * force_by_feed - force * power_by_feed) / determinant
            speed = both + speed_steps[k]
        elif k == steps:
            # The speed at which force, and then power, allows the highest feed.
            speed = -(force + force_by_feed * high_feed) / force_by_speed
        elif k == steps + 1:
            speed = -(power + power_by_feed * high_feed) / power_by_speed
        else:
            rung = k - steps - 2
            share = rung / max(ladder - 1, 1)
            speed = low + (high - low) * (0.4 + 0.6 * share)
        speeds[k] = min(max(speed, low), high)


# Compiled entries take arrays one by one.
@compiled_entry
def _best_return(  # noqa: PLR0913
    states, parameters, scratches, lengths, beliefs, speed_steps, ladder, feed_steps, lives
):
    """Return the bound on the return [s].

    ``beliefs``: as from the function ``beliefs``, with the factor on the rate of wear in row 1.
    """
    p = parameters[0]
    force_law = p.force_law
    power_law = p.power_law
    low_feed = np.log(p.feed_min[0])
    high_feed = np.log(p.feed_max[0])
    log_force_limit = np.log(p.thrust_force_limit[0])
    log_power_limit = np.log(p.power_limit[0])
    crossing = 60.0 / p.revolutions_per_metre[0]  # time [s] of 1 mm at 1 m/min and 1 mm/rev
    air = p.approach[0] * crossing * np.exp(-np.log(p.cutting_speed_max[0]) - high_feed)
    log_depth = np.log(p.depth_of_cut[0])
    nominal_life = _log_rate_of_life(p)
    speeds = np.empty(speed_steps.shape[0] + 2 + ladder)
    values = np.zeros(lives + 1)
    next_values = np.zeros(lives + 1)
    # Backwards over the bars and their stretches; values[j] belongs to the used life (j / lives)^2,
    # whose steps are short where an edge is fresh and wears fast. A worn-out edge earns nothing.
    for bar in range(lengths.shape[0] - 1, -1, -1):
        for i in range(lengths.shape[1] - 1, -1, -1):
            length = lengths[bar, i]
            belief = beliefs[:, bar, i]
            rate = _mean_of_points(belief[WEAR_RATE])
            force_mean = _mean_of_points(belief[FORCE])
            power_mean = _mean_of_points(belief[POWER])
            worth = (
                length
                * 60.0
                / p.revolutions_per_metre[0]
                / p.reference_removal_rate[0]
                * _mean_of_points(belief[DEPTH])
            )
            for j in range(lives):
                used = (j / lives) ** 2
                log_wear = p.log_wear_criterion[0] + p.wear_law.time[0] * np.log(max(used, 1e-9))
                force = _log_load(force_law, log_depth, log_wear, log_force_limit)
                power = _log_load(power_law, log_depth, log_wear, log_power_limit)
                expected_force = force + force_mean
                expected_power = power + power_mean
                _set_speeds(speeds, expected_force, expected_power, p, speed_steps)
                best = -np.inf
                for speed in speeds:
                    kink = _feed_at_limits(expected_force, expected_power, p, speed)
                    for step in feed_steps:
                        feed = min(max(kink + step, low_feed), high_feed)
                        time = length * crossing * np.exp(-speed - feed)
                        overload = _expected_overload(
                            _at_setting(force, force_law, speed, feed),
                            _at_setting(power, power_law, speed, feed),
                            belief,
                        )
                        using = rate * _rate_of_life(p, nominal_life, speed, feed) * time
                        gain = (
                            worth
                            - time * (1.0 + p.overload_price[0] * overload)
                            - p.edge_price[0] * using
                        )
                        if used + using >= 1.0:
                            # The edge ends within the stretch: only this share of it counts.
                            gain *= (1.0 - used) / using
                        else:
                            gain += between(next_values, np.sqrt(used + using) * lives)
                        best = max(best, gain)
                values[j] = best
            if i == 0:
                values[:lives] -= air
            values, next_values = next_values, values
    used_life = min(states[0].used_life[0], 1.0)
    return between(next_values, np.sqrt(used_life) * lives)
