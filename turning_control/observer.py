"""The shield's load observer: what the nominal model does not know of a bar and an edge, and the feeds that it leaves.

The observer (assumption: the nominal exponents hold) is an extended Kalman filter. Power P and force F follow depth, hardness and
edge:

    log P = log P_0(vc, f, ap, VB) + c_P log(1 + d / ap) + h_P (b + m) + (w_P / w_F) s
    log F = log F_0(vc, f, ap, VB) + c_F log(1 + d / ap) + h_F (b + m) + s

with the nominal P_0 and F_0 at the depth ap of the drawing, the exponents c of depth, h of hardness and w of wear, the excess d
of depth [mm], and the logarithms b of the bar's hardness, m of all bars' hardness, and s of the edge's force over nominal. The
scenario's spreads and correlation lengths are the prior, and say how fast d and b change along the bar. So the filter knows how
sure it is: it knows little of a new bar, and much of the next section of the same bar.
"""

import numpy as np
from numpy.typing import NDArray

from turning_env.observation import Reading
from turning_env.physics.spindle import capacity_at, idle_power_at
from turning_env.scenario import Scenario

MARGIN = 2.2
"""Margin of expected loads to the tolerance above their limits [standard deviations]."""
ENTRY = 1.6
"""Likewise where a bar begins, whose hardness and depth are unknown; this lasts a second or two [standard deviations]."""
MODEL_NOISE = 0.005
"""Standard deviation of readings that the sensors' noise does not explain [-]."""
MODEL_SPREAD = 0.05
"""Standard deviation of what the nominal model may be wrong by, in hardness and in force [-]."""
EDGE_DRIFT = 0.001
"""Drift of force over nominal as the edge wears [1/sqrt(mm)]."""
SPEED_CHANGE = 0.3
"""Largest change of the asked speed, natural logarithm [-]."""
SETTLED = 0.02
"""Time before a deeper section at which the feed must fit it [s]."""
BRAKING = 1.0
"""Time constant with which the feed falls before a deeper section, over that of the drive [-]."""
LAG_ERROR = 0.2
"""Standard deviation of a correction for a sensor's lag, over that correction [-]."""
MIN_WEAR = 0.05
"""Nominal wear over the criterion below which predictions hold it constant [-]."""

Values = NDArray[np.float64]


class Observer:
    """An extended Kalman filter of what the nominal model does not know, in each environment.

    The state's rows are d [mm], its slope along the bar [-], b, s and m.
    """

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        self._scenario = scenario
        material, work, sensors, tool = scenario.material, scenario.workpiece, scenario.sensors, scenario.tool
        power, force = material.power, material.thrust_force
        self._laws = [  # exponents of depth, hardness and edge; noise; time constant
            (power.depth_of_cut, power.hardness, power.wear / max(force.wear, 1e-9) if force.wear else 0.0,
             np.hypot(sensors.power_noise, MODEL_NOISE), sensors.power_time_constant),
            (force.depth_of_cut, force.hardness, 1.0,
             np.hypot(sensors.force_noise, MODEL_NOISE), sensors.force_time_constant),
        ]  # fmt: skip
        slope = 0.5 * np.pi * work.depth_along_spread / work.depth_correlation_length
        harder = 0.5 * np.pi * work.hardness_along_spread / work.hardness_correlation_length
        self._slope_length = 0.5 * work.depth_correlation_length
        self._slope_variance = slope**2
        self._hardness_drift = harder**2 * work.hardness_correlation_length  # [1/mm]
        self._bar = np.diag([
            work.depth_bar_spread**2 + work.depth_along_spread**2,
            slope**2,
            work.hardness_bar_spread**2 + work.hardness_along_spread**2,
        ])  # fmt: skip
        self._edge_variance = (force.wear * tool.wear_factor_spread) ** 2 + MODEL_SPREAD**2
        self._profile = np.array(work.depth_profile or (work.depth_of_cut,))
        lengths = work.section_lengths or (work.bar_length / len(self._profile),) * len(self._profile)
        self._starts = np.cumsum([0.0, *lengths])[:-1]
        settling = scenario.machine.feed_time_constant
        self._acts = scenario.control.interval + scenario.machine.command_delay  # [s] until the end of the next command's step
        self._horizon = self._acts + settling  # [s]
        self._mean, self._covariance = np.zeros((num_envs, 5)), np.zeros((num_envs, 5, 5))
        self._place, self._cutting_time = np.zeros((2, num_envs))
        self._lags = np.zeros((2, num_envs))  # nominal power and force behind the sensors' lag
        self._in_metal, self.known = np.zeros((2, num_envs), np.bool_)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._mean[mask], self._covariance[mask] = 0.0, 0.0
        self._covariance[mask, 3, 3], self._covariance[mask, 4, 4] = self._edge_variance, MODEL_SPREAD**2
        self._place[mask] = self._cutting_time[mask] = self._lags[:, mask] = 0.0
        self._in_metal[mask] = self.known[mask] = False
        self._mean, self._covariance = self._of_a_new_bar(mask, self._mean, self._covariance)

    def _of_a_new_bar(self, mask: NDArray[np.bool_], mean: Values, covariance: Values) -> tuple[Values, Values]:
        """Return mean and covariance that know nothing of the bar."""
        mean, covariance = mean.copy(), covariance.copy()
        mean[mask, :3] = covariance[mask, :3, :] = covariance[mask, :, :3] = 0.0
        covariance[mask, :3, :3] = self._bar
        return mean, covariance

    def follow(self, reading: Reading, place: Values | None) -> None:
        """Take the readings at the end of a step into the estimates.

        Args:
            reading: the readings.
            place: tool position along the bar [mm], below 0 before it; None: unknown, so integrated over the time in metal.
        """
        scenario, interval = self._scenario, self._scenario.control.interval
        fresh = reading.cutting_time < self._cutting_time - 1e-5
        self._mean[fresh, 3] = self._covariance[fresh, 3, :] = self._covariance[fresh, :, 3] = 0.0
        self._covariance[fresh, 3, 3] = self._edge_variance
        engaged = np.clip(60.0 * (reading.cutting_time - np.where(fresh, 0.0, self._cutting_time)), 0.0, interval)
        self._cutting_time = reading.cutting_time
        self._velocity = reading.cutting_speed * 1000.0 / (np.pi * scenario.workpiece.diameter) * reading.feed / 60.0  # [mm/s]
        entering = ~reading.cutting | ~self._in_metal
        self._mean, self._covariance = self._of_a_new_bar(entering, self._mean, self._covariance)
        self.known &= ~entering
        moved = self._velocity * engaged
        if place is None:
            place = np.where(reading.cutting, np.where(self._in_metal, self._place, 0.0) + moved, -1e-9)
        place = np.where(reading.cutting, np.maximum(place, 0.0), place)  # a wrong zero must not free the feed
        time_in_metal = np.where(self._in_metal, interval, engaged)
        self._place, self._in_metal = place, reading.cutting
        self._feed = reading.feed
        self._wear = np.maximum(reading.nominal_wear, MIN_WEAR * scenario.tool.wear_criterion)
        here = self._profile[np.clip(np.searchsorted(self._starts, place, side="right") - 1, 0, None)]
        here = np.maximum(here, 0.01 * self._profile.max())
        self._mean, self._covariance = self._predicted(moved)
        force, power = nominal_loads(scenario, reading.cutting_speed, reading.feed, here, self._wear)
        cut_power = np.maximum(reading.power - idle_power_at(scenario, reading.cutting_speed), 0.01 * power)
        for k, (nominal, measured) in enumerate(((power, cut_power), (force, np.maximum(reading.thrust_force, 0.01 * force)))):
            *_, noise, tau = self._laws[k]
            share = -np.expm1(-time_in_metal / tau) if tau > 0.0 else 1.0
            self._lags[k] += (np.where(reading.cutting, nominal, 0.0) - self._lags[k]) * share
            moves = reading.feed > 0.5 * scenario.machine.feed_min  # the models do not hold at a standstill
            readable = reading.cutting & (engaged > 0.0) & moves & (self._lags[k] > 0.3 * nominal)
            lag = np.log(np.maximum(self._lags[k], 1e-9) / nominal)
            if k == 0:
                noise = noise * np.maximum(reading.power / cut_power, 1.0)
                self.known |= readable
            self._correct(k, np.log(measured / nominal) - lag, noise**2 + (LAG_ERROR * lag) ** 2, here, readable)

    def _predicted(self, moved: Values) -> tuple[Values, Values]:
        """Return mean and covariance after a way [mm] in metal."""
        mean, keep = self._mean.copy(), np.exp(-moved / self._slope_length)
        integrated = self._slope_length * (1.0 - keep)
        step = np.tile(np.eye(5), (len(moved), 1, 1))
        step[:, 0, 1], step[:, 1, 1] = integrated, keep
        mean[:, 0] += integrated * mean[:, 1]
        mean[:, 1] *= keep
        covariance = step @ self._covariance @ step.transpose(0, 2, 1)
        new = self._slope_variance * (1.0 - keep**2)
        covariance[:, 0, 0] += new * moved**2 / 3.0
        covariance[:, 0, 1] += new * moved / 2.0
        covariance[:, 1, 0] += new * moved / 2.0
        covariance[:, 1, 1] += new
        covariance[:, 2, 2] += self._hardness_drift * moved
        covariance[:, 3, 3] += EDGE_DRIFT**2 * moved
        return mean, covariance

    def _response(self, k: int, mean: Values, depth: Values) -> tuple[Values, Values]:
        """Return the logarithm of power (k = 0) or force (1) over nominal at a nominal depth [mm], and its gradient."""
        by_depth, by_hardness, by_edge, *_ = self._laws[k]
        actual = np.maximum(depth + mean[:, 0], 0.2 * depth)
        zero, one = np.zeros_like(depth), np.ones_like(depth)
        gradient = np.stack([by_depth / actual, zero, by_hardness * one, by_edge * one, by_hardness * one], axis=1)
        value = by_depth * np.log(actual / depth) + by_hardness * (mean[:, 2] + mean[:, 4]) + by_edge * mean[:, 3]
        return value, gradient

    def _correct(self, k: int, measured: Values, variance: Values, depth: Values, readable: NDArray[np.bool_]) -> None:
        expected, gradient = self._response(k, self._mean, depth)
        shared = np.einsum("nij,nj->ni", self._covariance, gradient)
        total = np.einsum("ni,ni->n", shared, gradient) + variance
        gain = np.where(readable[:, None], shared / total[:, None], 0.0)
        self._mean = self._mean + gain * (measured - expected)[:, None]
        self._covariance = self._covariance - gain[:, :, None] * shared[:, None, :]

    def expect(self, target: float) -> None:
        """Set the loads over nominal that commands must bear, in this section of the bar and in the next one or the next bar.

        They are those expected over ``target``, or a margin above the expected ones over the tolerated, whichever is more.
        """
        scenario, work, control = self._scenario, self._scenario.workpiece, self._scenario.control
        mean, covariance = self._predicted(self._velocity * self._horizon)
        section = np.searchsorted(self._starts, self._place, side="right") - 1  # -1: before the bar
        new_bar = section == len(self._starts) - 1
        following = np.where(new_bar, 0, section + 1)
        profile = np.maximum(self._profile, 0.01 * self._profile.max())
        self._depths = np.stack([profile[section], profile[following]])
        bar_mean, bar_covariance = self._of_a_new_bar(new_bar, mean, covariance)
        loads = np.empty((2, 2, len(section)))
        for j, (m, c, unknown) in enumerate(((mean, covariance, ~self.known), (bar_mean, bar_covariance, new_bar | ~self.known))):
            margin = np.where(unknown, ENTRY, MARGIN)
            for k in (0, 1):
                value, gradient = self._response(k, m, self._depths[j])
                spread = np.sqrt(np.einsum("ni,nij,nj->n", gradient, c, gradient))
                tolerated = value + margin * spread - np.log1p(scenario.limits.overload_tolerance)
                loads[k, j] = np.maximum(value - np.log(target), tolerated)
        self._loads = np.exp(loads)
        way = np.where(new_bar, work.bar_length + work.approach, self._starts[following]) - self._place
        left = np.maximum(way, 0.0) / self._velocity - self._acts - SETTLED
        fall = max(BRAKING * scenario.machine.feed_time_constant, 1e-3)
        if control.action == "incremental":
            fall = max(fall, control.interval / control.feed_step)
        self._slack = np.exp(np.clip(left / fall, 0.0, 50.0))
        self._slack[new_bar & (work.bars == 1)] = np.inf
        self._in_air = section < 0

    def feeds(self, speed: Values) -> tuple[Values, Values]:
        """Return the feeds [mm/rev] at which power and force reach what they may at a speed [m/min]."""
        law = self._scenario.material.wear
        per_minute = law(speed, self._feed, self._scenario.workpiece.depth_of_cut)
        minutes, n = self._acts / 60.0, law.time
        wear = (self._wear ** (1.0 / n) + per_minute ** (1.0 / n) * minutes) ** n  # at the end of the next step
        if self._scenario.tool.wear_rule == "clock_time":  # as if the edge had always cut so
            wear = np.maximum(wear, per_minute * (self._cutting_time + minutes) ** n)
        here, there = (
            feeds_of(self._scenario, speed, self._depths[j], wear, self._loads[1, j], self._loads[0, j]) for j in (0, 1)
        )
        low = self._scenario.machine.feed_min
        power, force = (
            np.minimum(np.where(self._in_air, np.inf, now), low + np.maximum(then - low, 0.0) * self._slack)
            for now, then in zip(here, there, strict=True)
        )
        return power, force

    def speed(self, asked: Values, feed: Values, free: bool) -> tuple[Values, NDArray[np.bool_]]:
        """Return the speed [m/min] nearest to the asked one at which the removal rate can be the asked one, or else is highest.

        Args:
            asked: asked speed [m/min].
            feed: asked feed [mm/rev].
            free: whether the speed may be changed.

        Returns:
            The speed; and whether no speed near and no feed keep the limits.
        """
        scenario = self._scenario
        self._feed = np.maximum(self._feed, feed)
        ways = np.linspace(-SPEED_CHANGE, SPEED_CHANGE, 41) if free else np.zeros(1)
        ways = ways[np.argsort(np.abs(ways), kind="stable")]
        speeds = np.clip(asked * np.exp(ways)[:, None], scenario.machine.cutting_speed_min, scenario.cutting_speed_max)
        feeds = np.minimum(*self.feeds(speeds))
        removal = speeds * np.where(feeds >= scenario.machine.feed_min, feeds, 1e-6 * feeds)
        enough = removal >= asked * feed
        chosen = np.where(enough.any(axis=0), enough.argmax(axis=0), removal.argmax(axis=0))
        return speeds[chosen, np.arange(len(asked))], self.known & (feeds < scenario.machine.feed_min).all(axis=0)


def nominal_loads(scenario: Scenario, speed: Values, feed: Values, depth: Values, wear: Values) -> tuple[Values, Values]:
    """Return the nominal thrust force [N] and cutting power [kW]."""
    material = scenario.material
    return (material.thrust_force(speed, feed, depth, wear=wear), material.power(speed, feed, depth, wear=wear))


def feeds_of(
    scenario: Scenario, speed: Values, depth: Values, wear: Values, force: Values, power: Values, target: float = 1.0
) -> tuple[Values, Values]:
    """Return the feeds [mm/rev] at which power and force reach ``target`` times their limits; unlimited if feed has no effect.

    Args:
        scenario: nominal model.
        speed: cutting speed [m/min].
        depth: depth of cut [mm].
        wear: flank wear [mm].
        force: expected over nominal thrust force [-].
        power: expected over nominal cutting power [-].
        target: load over limit [-].
    """
    limits, material = scenario.limits, scenario.material
    per_force, per_power = nominal_loads(scenario, speed, np.ones_like(depth), depth, wear)
    left = np.maximum(target * limits.power * capacity_at(scenario, speed) - idle_power_at(scenario, speed), 1e-6)
    shares = (
        (left / (power * per_power), material.power.feed),
        (target * limits.thrust_force / (force * per_force), material.thrust_force.feed),
    )
    by_power, by_force = (
        share ** (1.0 / exponent) if exponent > 0 else np.full_like(share, np.inf) for share, exponent in shares
    )
    return by_power, by_force
