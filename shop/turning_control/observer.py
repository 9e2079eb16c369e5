"""The shield's load observer: estimates of a bar and an edge beyond the nominal model, and the feeds that the limits allow.

It is an extended Kalman filter (assumption: the nominal exponents hold). Power P and force F follow depth, hardness and edge:

    log P = log P_0(vc, f, ap, VB) + c_P log(1 + d / ap) + h_P (b + m) + (w_P / w_F) s
    log F = log F_0(vc, f, ap, VB) + c_F log(1 + d / ap) + h_F (b + m) + s

P_0 and F_0 are nominal, at the depth ap of the drawing. The exponents are c of depth, h of hardness and w of wear; d is the
excess of depth [mm]. The logarithms are b of the bar's hardness, m of all bars' hardness, and s of the edge's force over
nominal. The scenario's spreads and correlation lengths are the prior, and set how fast d and b change along the bar.
Pairs of loads or feeds have power first and force second, along the first axis.
"""

import math

import numpy as np
from numpy.typing import NDArray

from turning_env.observation import Reading
from turning_env.physics.spindle import capacity_at, idle_power_at
from turning_env.scenario import Scenario

MARGIN = 2.6  # margin of expected loads to the tolerance above their limits [standard deviations]
ENTRY_MARGIN = 1.6  # likewise at the start of a bar, whose hardness and depth are unknown
FIRST_MARGIN = 3.2  # likewise after a bar's first readings, whose errors the filter understates
FIRST_READINGS = 3  # number of readings in a bar after which its margin is ``MARGIN``
MODEL_NOISE = 0.005  # standard deviation of readings that the sensors' noise does not explain [-]
MODEL_SPREAD = 0.05  # standard deviation of the nominal model's errors in hardness and in force [-]
EDGE_DRIFT = 0.001  # drift of force over nominal as the edge wears [1/sqrt(mm)]
SPEED_CHANGE = 0.3  # largest change of the asked speed, natural logarithm [-]
SETTLED = 0.02  # time before a deeper section at which the feed must fit it [s]
LAG_ERROR = 0.2  # standard deviation of a correction for a sensor's lag, over that correction [-]
ENTRY_LEAD = (
    3  # steps beyond those of the change itself in which a speed must fit the next section [-]
)
ENTRY_SPEEDS = 25  # number of speeds that are tried for an entry
CERTAIN = (
    2.5  # margin above its noise at which a reading alone proves an overload [standard deviations]
)
LOWEST_GAP = 0.05  # gap over the lowest feed from which a falling feed counts as that feed [-]
NEAR_END = 0.9  # share of a bar's length behind which the next bar may begin [-]
MIN_WEAR = 0.05  # nominal wear over the criterion below which predictions hold it constant [-]

EXCESS, SLOPE, BAR, EDGE, ALL_BARS = range(
    5
)  # the filter's states: d [mm], its slope along the bar [-], b, s and m
OF_A_BAR = slice(EXCESS, EDGE)

Values = NDArray[np.float64]


class Observer:
    """An extended Kalman filter of the nominal model's errors in each environment; ``known`` tells which bars are measured."""

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        self._scenario = scenario
        work, sensors, machine = scenario.workpiece, scenario.sensors, scenario.machine
        power, force = scenario.material.power, scenario.material.thrust_force
        edge = (power.wear / force.wear if force.wear else 0.0), 1.0
        self._exponents = np.array(
            [
                (law.depth_of_cut, law.hardness, w)
                for law, w in zip((power, force), edge, strict=True)
            ]
        )
        self._noise = np.hypot((sensors.power_noise, sensors.force_noise), MODEL_NOISE)
        self._chip_lag, self._time_constants = (
            machine.chip_lag,
            (sensors.power_time_constant, sensors.force_time_constant),
        )
        slope = 0.5 * np.pi * work.depth_along_spread / work.depth_correlation_length
        harder = 0.5 * np.pi * work.hardness_along_spread / work.hardness_correlation_length
        self._slope_length = 0.5 * work.depth_correlation_length
        self._hardness_drift = harder**2 * work.hardness_correlation_length  # [1/mm]
        depth = work.depth_bar_spread**2 + work.depth_along_spread**2
        hardness = work.hardness_bar_spread**2 + work.hardness_along_spread**2
        sharpness = (force.wear * scenario.tool.wear_factor_spread) ** 2 + MODEL_SPREAD**2
        self._prior = np.diag([depth, slope**2, hardness, sharpness, MODEL_SPREAD**2])
        profile = np.array(work.depth_profile or (work.depth_of_cut,))
        lengths = work.section_lengths or (work.bar_length / len(profile),) * len(profile)
        self._profile = np.maximum(profile, 0.01 * profile.max())
        self._starts = np.cumsum([0.0, *lengths])[:-1]
        self._acts = (
            scenario.control.interval + machine.command_delay
        )  # [s] until the end of the next command's step
        self._mean, self._covariance = np.zeros((num_envs, 5)), np.zeros((num_envs, 5, 5))
        self._place, self._cutting_time = np.zeros((2, num_envs))
        self._forming, self._lagging = np.zeros(
            (2, 2, num_envs)
        )  # nominal loads behind the chip's lag, and the sensors'
        self._in_metal, self.known = np.zeros((2, num_envs), np.bool_)
        self._readings = np.zeros(num_envs, np.int64)  # in this bar
        self._speed_before, self._feed_before = np.zeros((2, num_envs))  # at the last readings

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._forget(self._mean, self._covariance, mask, slice(None))
        self._place[mask] = self._cutting_time[mask] = self._forming[:, mask] = self._lagging[
            :, mask
        ] = 0.0
        self._in_metal[mask] = self.known[mask] = False
        self._readings[mask] = 0

    def _forget(
        self, mean: Values, covariance: Values, mask: NDArray[np.bool_], states: slice
    ) -> None:
        """Set states back to their prior, independent of the others."""
        mean[mask, states] = covariance[mask, states, :] = covariance[mask, :, states] = 0.0
        covariance[mask, states, states] = self._prior[states, states]

    def follow(self, reading: Reading, place: Values | None) -> None:
        """Take the readings at the end of a step into the estimates.

        ``place`` is the tool position along the bar [mm], below 0 before it; None: integrated over the time in metal.
        """
        scenario, interval = self._scenario, self._scenario.control.interval
        fresh = reading.cutting_time < self._cutting_time - 1e-5
        self._forget(self._mean, self._covariance, fresh, slice(EDGE, EDGE + 1))
        engaged = np.clip(
            60.0 * (reading.cutting_time - np.where(fresh, 0.0, self._cutting_time)), 0.0, interval
        )
        self._cutting_time = reading.cutting_time
        self._velocity = self._feed_velocity(reading.cutting_speed, reading.feed)
        moved = self._mean_velocity(reading) * engaged
        self._speed_before, self._feed_before = reading.cutting_speed, reading.feed
        self._feed = reading.feed
        passed_gap = self._passed_gap(reading, place, moved, engaged)
        entering = ~reading.cutting | ~self._in_metal | passed_gap
        self._forget(self._mean, self._covariance, entering, OF_A_BAR)
        self.known &= ~entering
        self._readings[entering] = 0
        time_in_metal = np.where(self._in_metal & ~passed_gap, interval, engaged)
        place = self._moved_to(reading, moved, passed_gap) if place is None else place
        self._place = np.where(
            reading.cutting, np.maximum(place, 0.0), place
        )  # a wrong zero must not free the feed
        self._in_metal = reading.cutting
        self._wear = np.maximum(reading.nominal_wear, MIN_WEAR * scenario.tool.wear_criterion)
        self._mean, self._covariance = self._predicted(moved)
        depth = self._profile[np.maximum(self._section(), 0)]
        nominal = nominal_loads(scenario, reading.cutting_speed, reading.feed, depth, self._wear)
        cut_power = reading.power - idle_power_at(scenario, reading.cutting_speed)
        measured = np.maximum([cut_power, reading.thrust_force], 0.01 * nominal)
        moves = (
            reading.feed > 0.5 * scenario.machine.feed_min
        )  # the models do not hold at a standstill
        remains = (
            np.exp(-moved / reading.feed / self._chip_lag) if self._chip_lag > 0.0 else 0.0
        )  # moved / feed: turns
        self._forming = np.where(
            reading.cutting, nominal - remains * (nominal - self._forming), 0.0
        )
        for k, tau in enumerate(self._time_constants):
            share = -np.expm1(-time_in_metal / tau) if tau > 0.0 else 1.0
            self._lagging[k] += (self._forming[k] - self._lagging[k]) * share
            readable = (
                reading.cutting & (engaged > 0.0) & moves & (self._lagging[k] > 0.3 * nominal[k])
            )
            lag = np.log(np.maximum(self._lagging[k], 1e-9) / nominal[k])
            noise = self._noise[k] * (
                np.maximum(reading.power / measured[0], 1.0) if k == 0 else 1.0
            )
            if k == 0:
                self.known |= readable
                self._readings += readable
            self._correct(
                k,
                np.log(measured[k] / nominal[k]) - lag,
                noise**2 + (LAG_ERROR * lag) ** 2,
                depth,
                readable,
            )

    def _feed_velocity(self, cutting_speed: Values, feed: Values) -> Values:
        """Return the feed velocity [mm/s] at a cutting speed [m/min] and a feed [mm/rev]."""
        turns = cutting_speed * 1000.0 / (np.pi * self._scenario.workpiece.diameter)  # [1/min]
        return turns * feed / 60.0

    def _mean_velocity(self, reading: Reading) -> Values:
        """Return the mean feed velocity [mm/s] since the readings before, as both drives follow with a first-order lag."""
        machine, interval = self._scenario.machine, self._scenario.control.interval
        speed = mean_of_lag(
            self._speed_before, reading.cutting_speed, machine.spindle_time_constant, interval
        )
        feed = mean_of_lag(self._feed_before, reading.feed, machine.feed_time_constant, interval)
        return self._feed_velocity(speed, feed)

    def _passed_gap(
        self, reading: Reading, place: Values | None, moved: Values, engaged: Values
    ) -> NDArray[np.bool_]:
        """Return whether the tool has passed into another bar between two readings in metal.

        The gap between two bars may be so short that no reading falls into it. Then the time in metal falls short of the
        interval by the time that the gap takes.
        """
        work = self._scenario.workpiece
        stays_in_metal = reading.cutting & self._in_metal
        if place is not None:
            return stays_in_metal & (place < self._place - 0.5 * work.bar_length)
        missing = self._scenario.control.interval - engaged
        near_end = self._place + moved > NEAR_END * work.bar_length
        return stays_in_metal & near_end & (missing > 0.5 * work.approach / self._velocity)

    def _moved_to(self, reading: Reading, moved: Values, passed_gap: NDArray[np.bool_]) -> Values:
        """Return the tool position along the bar [mm] from the distances that it has moved in metal [mm]."""
        place = np.where(self._in_metal, self._place, 0.0) + moved
        place = np.where(passed_gap, place - self._scenario.workpiece.bar_length, place)
        return np.where(reading.cutting, place, -1e-9)

    def _section(self) -> NDArray[np.intp]:
        """Return the index of the drawing's section in which the tool is; -1: before the bar."""
        return np.searchsorted(self._starts, self._place, side="right") - 1

    def _predicted(self, moved: Values) -> tuple[Values, Values]:
        """Return mean and covariance after a distance [mm] in metal."""
        keep = np.exp(-moved / self._slope_length)
        step = np.tile(np.eye(5), (len(moved), 1, 1))
        step[:, EXCESS, SLOPE], step[:, SLOPE, SLOPE] = self._slope_length * (1.0 - keep), keep
        covariance = step @ self._covariance @ step.transpose(0, 2, 1)
        new = self._prior[SLOPE, SLOPE] * (1.0 - keep**2)
        covariance[:, EXCESS, EXCESS] += new * moved**2 / 3.0
        covariance[:, EXCESS, SLOPE] += new * moved / 2.0
        covariance[:, SLOPE, EXCESS] += new * moved / 2.0
        covariance[:, SLOPE, SLOPE] += new
        covariance[:, BAR, BAR] += self._hardness_drift * moved
        covariance[:, EDGE, EDGE] += EDGE_DRIFT**2 * moved
        return np.einsum("nij,nj->ni", step, self._mean), covariance

    def _response(self, k: int, mean: Values, depth: Values) -> tuple[Values, Values]:
        """Return the logarithm of a load over nominal at a nominal depth [mm], and its gradient."""
        by_depth, by_hardness, by_edge = self._exponents[k]
        actual = np.maximum(depth + mean[:, EXCESS], 0.2 * depth)
        gradient = np.tile([0.0, 0.0, by_hardness, by_edge, by_hardness], (len(depth), 1))
        value = (
            by_depth * np.log(actual / depth)
            + by_hardness * (mean[:, BAR] + mean[:, ALL_BARS])
            + by_edge * mean[:, EDGE]
        )
        gradient[:, EXCESS] = by_depth / actual
        return value, gradient

    def _correct(
        self, k: int, measured: Values, variance: Values, depth: Values, readable: NDArray[np.bool_]
    ) -> None:
        expected, gradient = self._response(k, self._mean, depth)
        shared = np.einsum("nij,nj->ni", self._covariance, gradient)
        total = np.einsum("ni,ni->n", shared, gradient) + variance
        gain = np.where(readable[:, None], shared / total[:, None], 0.0)
        self._mean = self._mean + gain * (measured - expected)[:, None]
        self._covariance = self._covariance - gain[:, :, None] * shared[:, None, :]

    def expect(self, target: float, asked_speed: Values, asked_feed: Values) -> None:
        """Set the loads over nominal that commands must bear, in this section of the bar and in the next one or the next bar.

        They are those expected over ``target``, or a margin above the expected ones over the tolerated, whichever is more. The
        uncertainty grows with the distance that the tool moves until the next command holds: at its present velocity, or at that
        of the asked speed [m/min] and feed [mm/rev] as far as loads allow it, if that is higher.
        """
        self._expect_at(self._velocity, target)
        allowed = np.minimum(self.feeds(asked_speed).min(axis=0), asked_feed)
        self._expect_at(
            np.maximum(self._velocity, self._feed_velocity(asked_speed, allowed)), target
        )

    def _expect_at(self, velocity: Values, target: float) -> None:
        """Set the loads over nominal that commands must bear if the tool moves at a velocity [mm/s]."""
        scenario, work, machine = self._scenario, self._scenario.workpiece, self._scenario.machine
        section = self._section()
        self._in_air, new_bar = section < 0, section == len(self._starts) - 1
        following = np.where(new_bar, 0, section + 1)
        self._depths = self._profile[section], self._profile[following]
        here = self._predicted(velocity * (self._acts + machine.feed_time_constant))
        there = here[0].copy(), here[1].copy()
        self._forget(*there, new_bar, OF_A_BAR)
        margin = np.where(self._readings < FIRST_READINGS, FIRST_MARGIN, MARGIN)
        loads = np.empty((2, 2, len(section)))
        for j, ((mean, covariance), unknown) in enumerate(
            ((here, ~self.known), (there, new_bar | ~self.known))
        ):
            for k in (0, 1):
                value, gradient = self._response(k, mean, self._depths[j])
                spread = np.sqrt(np.einsum("ni,nij,nj->n", gradient, covariance, gradient))
                tolerated = value + np.where(unknown, ENTRY_MARGIN, margin) * spread
                tolerated -= np.log1p(scenario.limits.overload_tolerance)
                loads[j, k] = np.maximum(value - np.log(target), tolerated)
        self._loads = np.exp(loads)
        distance = (
            np.where(new_bar, work.bar_length + work.approach, self._starts[following])
            - self._place
        )
        self._time_left = np.maximum(distance, 0.0) / velocity  # until the next section or bar [s]
        self._last_section = new_bar & (work.bars == 1)
        left = self._time_left - self._acts - SETTLED
        fall = max(
            machine.feed_time_constant, 1e-3
        )  # time constant with which the feed falls before a deeper section [s]
        if scenario.control.action == "incremental":
            fall = max(fall, scenario.control.interval / scenario.control.feed_step)
        self._slack = np.exp(np.clip(left / fall, 0.0, 50.0))
        self._slack[self._last_section] = np.inf

    def feeds(self, speed: Values) -> Values:
        """Return the feeds [mm/rev] at which power and force reach their allowed values at a speed [m/min]."""
        law, low = self._scenario.material.wear, self._scenario.machine.feed_min
        per_minute = law(speed, self._feed, self._scenario.workpiece.depth_of_cut)
        minutes, n = self._acts / 60.0, law.time
        wear = (
            self._wear ** (1.0 / n) + per_minute ** (1.0 / n) * minutes
        ) ** n  # at the end of the next step
        if self._scenario.tool.wear_rule == "clock_time":  # as if the edge had always cut so
            wear = np.maximum(wear, per_minute * (self._cutting_time + minutes) ** n)
        here, there = (
            feeds_of(self._scenario, speed, depth, wear, loads)
            for depth, loads in zip(self._depths, self._loads, strict=True)
        )
        # The feed falls to the lowest one in time, also if that one is too high: another speed or the operator must help then.
        later = low + np.maximum(there - low, LOWEST_GAP * low) * self._slack
        return np.minimum(np.where(self._in_air, np.inf, here), later)

    def speed(self, asked: Values, feed: Values, free: bool) -> tuple[Values, NDArray[np.bool_]]:
        """Return the speed [m/min] nearest to the asked one at which the removal rate can be the asked one, or else is highest.

        ``feed`` is asked [mm/rev]; ``free``: whether the speed may be changed. Also return whether no speed near and no feed
        keep the limits.
        """
        machine = self._scenario.machine
        self._feed = np.maximum(self._feed, feed)
        changes = np.linspace(-SPEED_CHANGE, SPEED_CHANGE, 41) if free else np.zeros(1)
        changes = changes[np.argsort(np.abs(changes), kind="stable")]
        speeds = np.clip(
            asked * np.exp(changes)[:, None],
            machine.cutting_speed_min,
            self._scenario.cutting_speed_max,
        )
        feeds = self.feeds(speeds).min(axis=0)
        removal = speeds * np.where(feeds >= machine.feed_min, feeds, 1e-6 * feeds)
        enough = removal >= asked * feed
        chosen = np.where(enough.any(axis=0), enough.argmax(axis=0), removal.argmax(axis=0))
        return speeds[chosen, np.arange(len(asked))], self.known & (feeds < machine.feed_min).all(
            axis=0
        )

    def entry_speed(
        self, asked: Values, commanded: Values, free: bool
    ) -> tuple[Values, NDArray[np.bool_]]:
        """Return the speed [m/min] nearest to the asked one at which the lowest feed keeps the limits in the next section or bar.

        The asked speed stays where there is time to change it later. ``free``: whether the speed may be changed from the
        ``commanded`` one. Also return whether the tool is about to enter, and no speed will do.
        """
        scenario, machine = self._scenario, self._scenario.machine
        speed, blocked = asked.copy(), np.zeros(len(asked), np.bool_)
        speed_step = (
            scenario.control.cutting_speed_step
            if scenario.control.action == "incremental"
            else np.inf
        )
        longest = (
            np.log(scenario.cutting_speed_max / machine.cutting_speed_min) / speed_step + ENTRY_LEAD
        )
        near = (self._time_left < longest * scenario.control.interval) & ~self._last_section
        if not near.any():
            return speed, blocked

        lowest, highest = machine.cutting_speed_min, scenario.cutting_speed_max
        speeds = (
            np.geomspace(lowest, highest, ENTRY_SPEEDS)[:, None]
            if free
            else commanded[near][None, :]
        )
        depth, wear, loads = self._depths[1][near], self._wear[near], self._loads[1][:, near]
        feeds = feeds_of(scenario, speeds, depth, wear, loads[:, None, :]).min(axis=0)
        changes = np.abs(np.log(speeds / asked[near]))
        nearest = np.where(feeds >= machine.feed_min, changes, np.inf).argmin(axis=0)
        none = ~(feeds >= machine.feed_min).any(axis=0)
        fitting = np.broadcast_to(speeds, feeds.shape)[nearest, np.arange(len(nearest))]

        # The asked speed keeps the limits itself if the speeds on both sides of it on the grid do.
        fits = feeds_of(scenario, asked[near], depth, wear, loads).min(axis=0) >= machine.feed_min
        steps = np.abs(np.log(fitting / commanded[near])) / speed_step + ENTRY_LEAD
        due = self._time_left[near] < steps * scenario.control.interval
        speed[near] = np.where(due & ~fits & ~none, fitting, asked[near])
        blocked[near] = due & none & ~fits
        return speed, blocked

    def proven_feed(self, reading: Reading) -> tuple[Values, NDArray[np.bool_]]:
        """Return the feeds [mm/rev] to which readings that prove an overload by themselves limit the feed, else infinity.

        No model or estimate can make such a reading harmless. Also return whether it is the power that is over its limit.
        """
        scenario, limits = self._scenario, self._scenario.limits
        tolerated = 1.0 + limits.overload_tolerance
        idle = idle_power_at(scenario, reading.cutting_speed)
        power_limit = limits.power * capacity_at(scenario, reading.cutting_speed)
        certain_power = reading.power * math.exp(-CERTAIN * self._noise[0])
        certain_force = reading.thrust_force * math.exp(-CERTAIN * self._noise[1])
        power_share = (certain_power - idle) / np.maximum(tolerated * power_limit - idle, 1e-6)
        force_share = certain_force / (tolerated * limits.thrust_force)
        feed = np.full(len(reading.feed), np.inf)
        laws = scenario.material.power, scenario.material.thrust_force
        for share, law in zip((power_share, force_share), laws, strict=True):
            over = reading.cutting & (share > 1.0)
            exponent = law.feed if law.feed > 0.0 else np.inf
            feed = np.where(
                over,
                np.minimum(feed, reading.feed * np.maximum(share, 1.0) ** (-1.0 / exponent)),
                feed,
            )
        return feed, reading.cutting & (power_share > 1.0)


def mean_of_lag(start: Values, end: Values, time_constant: float, interval: float) -> Values:
    """Return the mean over an interval [s] of a value that follows a constant command with a first-order lag."""
    if time_constant <= 0.0:
        return end
    remains = math.exp(-interval / time_constant)
    return end + (start - end) * (time_constant / interval - remains / (1.0 - remains))


def nominal_loads(
    scenario: Scenario, speed: Values, feed: Values, depth: Values, wear: Values
) -> Values:
    """Return nominal cutting power [kW] and thrust force [N]."""
    laws = scenario.material.power, scenario.material.thrust_force
    return np.stack([law(speed, feed, depth, wear=wear) for law in laws])


def feeds_of(
    scenario: Scenario, speed: Values, depth: Values, wear: Values, loads: Values
) -> Values:
    """Return the feeds [mm/rev] at which loads, expected over nominal [-], reach their limits; infinite if feed has no effect."""
    limits, material = scenario.limits, scenario.material
    nominal = nominal_loads(scenario, speed, np.ones_like(depth), depth, wear)
    per_power, per_force = (load * each for load, each in zip(loads, nominal, strict=True))
    left = np.maximum(
        limits.power * capacity_at(scenario, speed) - idle_power_at(scenario, speed), 1e-6
    )
    shares = (
        (left / per_power, material.power.feed),
        (limits.thrust_force / per_force, material.thrust_force.feed),
    )
    return np.stack(
        [
            share ** (1.0 / feed) if feed > 0 else np.full_like(share, np.inf)
            for share, feed in shares
        ]
    )
