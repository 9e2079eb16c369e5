"""The shield's load observer: what it knows of a bar and an edge beyond the nominal model.

It is an extended Kalman filter (assumption: the nominal exponents hold). Power P and force F follow
depth, hardness and edge:

    log P = log P_0(vc, f, ap, VB) + c_P log(1 + d / ap) + h_P (b + m) + (w_P / w_F) s
    log F = log F_0(vc, f, ap, VB) + c_F log(1 + d / ap) + h_F (b + m) + s

P_0 and F_0 are nominal, at the depth ap of the drawing. The exponents are c of depth, h of hardness
and w of wear; d is the excess of depth [mm]. The logarithms are b of the bar's hardness, m of all
bars' hardness, and s of the edge's force over nominal. The scenario's spreads and correlation
lengths are the prior, and set how fast d and b change along the bar.

From the estimates follow the feeds and speeds that the limits allow. ``shield.py`` decides on them.

The filter is independent of that of the policies (``baselines/models/load_filter.py``) on purpose:
an error there, or a policy that exploits one, must not blind the guard as well. Both share the laws
of the scenario's material, the spindle's capacity and idle power, and the scenario's spreads and
noise, so both are wrong where these are.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turning_env.numerics.conversions import feed_velocity_at
from turning_env.numerics.functions import log
from turning_env.observation import Reading
from turning_env.scenario import Scenario
from turning_env.scenario.laws import (
    cutting_power_limit,
    feed_at_limit,
    idle_power_at,
    life_rate,
    used_life_at,
    wear_at,
)
from turning_env.scenario.power_law import PowerLaw, wear_exponent

# Margins of expected loads to the tolerance above their limits [standard deviations].
MARGIN = 2.6
ENTRY_MARGIN = 1.6  # at the start of a bar, whose hardness and depth are unknown
FIRST_MARGIN = 3.2  # after a bar's first readings, whose errors the filter understates
FIRST_READINGS = 3  # number of readings in a bar after which its margin is ``MARGIN``
# Margin above its noise at which a reading alone proves an overload [standard deviations].
CERTAIN = 2.5

MODEL_NOISE = 0.005  # standard deviation of readings that the sensors' noise does not explain [-]
MODEL_SPREAD = 0.05  # standard deviation of the nominal model's errors in hardness and in force [-]
EDGE_DRIFT = 0.001  # drift of force over nominal as the edge wears [1/sqrt(mm)]
LAG_ERROR = 0.2  # standard deviation of a correction for a sensor's lag, over that correction [-]
MIN_DEPTH = 0.2  # estimated depth of cut over nominal below which it is taken as this (assumption)
MIN_WEAR = 0.05  # nominal wear over the criterion below which predictions hold it constant [-]
# Nominal load behind all lags over the nominal load, above which a reading is used [-].
MIN_BUILT_UP = 0.3
# Distance below the expected load from which a reading is not one of the cut [standard deviations].
NO_CUT = 5.0

SPEED_CHANGE = 0.3  # largest change of the asked speed, natural logarithm [-]
NUM_CHANGES = 41  # number of changes of the asked speed that are tried
ENTRY_SPEEDS = 25  # number of speeds that are tried for an entry
# Steps beyond those of the change itself in which a speed must fit the next section [-].
ENTRY_LEAD = 3
SETTLED = 0.02  # time before a deeper section at which the feed must fit it [s]
LOWEST_GAP = 0.05  # gap over the lowest feed from which a falling feed counts as that feed [-]
NEAR_END = 0.9  # share of a bar's length behind which the next bar may begin [-]

# The filter's states.
EXCESS = 0  # d [mm]
SLOPE = 1  # slope of d along the bar [-]
BAR = 2  # b
EDGE = 3  # s
ALL_BARS = 4  # m
NUM_STATES = 5
OF_A_BAR = slice(EXCESS, EDGE)
OF_AN_EDGE = slice(EDGE, ALL_BARS)

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]


class ByLoad(NamedTuple):
    """A quantity that each of the two loads has, such as the feed at its limit."""

    power: Values
    force: Values

    def lower(self) -> Values:
        """Return the lower value of both."""
        return np.minimum(self.power, self.force)


@dataclass(frozen=True)
class StateEstimate:
    """Mean and covariance of the filter's states in each environment."""

    mean: Values  # (num_envs, NUM_STATES)
    covariance: Values  # (num_envs, NUM_STATES, NUM_STATES)

    def copy(self) -> "StateEstimate":
        """Return an estimate with arrays of its own."""
        return StateEstimate(self.mean.copy(), self.covariance.copy())


@dataclass(frozen=True)
class SectionOutlook:
    """Depth and expected loads in a section of the drawing."""

    depth: Values  # nominal [mm]
    loads: ByLoad  # over nominal [-]


@dataclass(frozen=True)
class SectionsAhead:
    """Sections and times that the next commands must suit."""

    present: SectionOutlook
    following: SectionOutlook  # the next section of the bar, or the first one of the next bar
    in_air: Mask  # before the bar
    is_last: Mask  # nothing follows
    time_left: Values  # until the following section [s]
    slack: Values  # gap to the lowest feed now over that in the following section [-]


class LoadModel:
    """A load: its nominal law, its sensor, and the nominal load behind the lags of chip and sensor.

    Args:
        law: nominal law.
        edge_exponent: exponent of the edge's force over nominal in this load [-].
        sensor_noise: standard deviation of the sensor's readings [-].
        time_constant: of the sensor [s].
        num_envs: number of environments.
    """

    def __init__(
        self,
        law: PowerLaw,
        edge_exponent: float,
        sensor_noise: float,
        time_constant: float,
        num_envs: int,
    ) -> None:
        self.law = law
        self.noise = np.hypot(sensor_noise, MODEL_NOISE)
        self._edge_exponent = edge_exponent
        self._time_constant = time_constant
        self._forming = np.zeros(num_envs)  # nominal load behind the chip's lag
        self._lagging = np.zeros(num_envs)  # likewise behind the sensor's lag, too

    def reset(self, mask: Mask) -> None:
        """Remove the load of environments."""
        self._forming[mask] = 0.0
        self._lagging[mask] = 0.0

    def follow(
        self, nominal: Values, chip_remains: Values | float, cutting: Mask, time_in_metal: Values
    ) -> Values:
        """Move the lags on by a step; return the nominal load that the sensor shows.

        Args:
            nominal: nominal load at the end of the step.
            chip_remains: share of a change that the chip's lag has still to complete [-].
            cutting: whether the tool is in metal.
            time_in_metal: in this step [s].
        """
        formed = nominal - chip_remains * (nominal - self._forming)
        self._forming = np.where(cutting, formed, 0.0)
        share: Values | float = 1.0
        if self._time_constant > 0.0:
            share = -np.expm1(-time_in_metal / self._time_constant)
        self._lagging += (self._forming - self._lagging) * share
        return self._lagging

    def response(self, mean: Values, depth: Values) -> tuple[Values, Values]:
        """Return the logarithm of the load over nominal at a nominal depth [mm], and its gradient.

        The gradient has shape (num_envs, NUM_STATES).
        """
        law = self.law
        # Far from any reading the estimated depth may fall below 0, where the logarithm ends.
        actual_depth = np.maximum(depth + mean[:, EXCESS], MIN_DEPTH * depth)
        log_hardness = mean[:, BAR] + mean[:, ALL_BARS]
        value = (
            law.depth_of_cut * np.log(actual_depth / depth)
            + law.hardness * log_hardness
            + self._edge_exponent * mean[:, EDGE]
        )
        gradient = np.zeros((len(depth), NUM_STATES))
        gradient[:, EXCESS] = law.depth_of_cut / actual_depth
        gradient[:, BAR] = law.hardness
        gradient[:, EDGE] = self._edge_exponent
        gradient[:, ALL_BARS] = law.hardness
        return value, gradient


class Observer:
    """An extended Kalman filter of the nominal model's errors in each environment.

    Call ``follow`` at every step, then ``expect``; the other methods use what these two set.
    """

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        self._scenario = scenario
        self._set_models(num_envs)
        self._set_prior()
        self._set_drawing()
        # Time until the end of the step in which the next command holds [s].
        self._horizon = scenario.control.interval + scenario.machine.command_delay

        self._estimate = StateEstimate(
            mean=np.zeros((num_envs, NUM_STATES)),
            covariance=np.zeros((num_envs, NUM_STATES, NUM_STATES)),
        )
        self._outlook: SectionsAhead
        self._known = np.zeros(num_envs, np.bool_)  # whether the bar has been measured
        self._readings = np.zeros(num_envs, np.int64)  # in this bar
        self._in_metal = np.zeros(num_envs, np.bool_)
        self._missed = False  # whether there were steps without readings before this one
        self._place = np.zeros(num_envs)  # tool position along the bar [mm]
        self._cutting_time = np.zeros(num_envs)  # of the edge [min]
        self._wear = np.zeros(num_envs)  # nominal [mm]
        # At the last readings.
        self._velocity = np.zeros(num_envs)  # of the feed [mm/s]
        self._speed_before = np.zeros(num_envs)  # cutting speed [m/min]
        self._feed_before = np.zeros(num_envs)  # [mm/rev]
        # Feed at which the edge will wear until the next command [mm/rev].
        self._wearing_feed = np.zeros(num_envs)

    def _set_models(self, num_envs: int) -> None:
        """Set the models of power and thrust force.

        The filter's state of the edge is the log of its force over the nominal one. Wear raises the
        log of power in proportion, by the ratio of both exponents of wear.
        """
        material = self._scenario.material
        sensors = self._scenario.sensors
        wear_exponent_ratio = 0.0
        if material.thrust_force.wear:
            wear_exponent_ratio = self._wear_exponent(material.power) / self._wear_exponent(
                material.thrust_force
            )
        self._power = LoadModel(
            material.power,
            edge_exponent=wear_exponent_ratio,
            sensor_noise=sensors.power_noise,
            time_constant=sensors.power_time_constant,
            num_envs=num_envs,
        )
        self._force = LoadModel(
            material.thrust_force,
            edge_exponent=1.0,
            sensor_noise=sensors.force_noise,
            time_constant=sensors.force_time_constant,
            num_envs=num_envs,
        )

    def _wear_exponent(self, law: PowerLaw) -> float:
        """Return the slope of a log load over the log wear of a worn-out edge [-]."""
        log_criterion = log(self._scenario.tool.wear_criterion)
        return float(wear_exponent(law, log_criterion))

    def _set_prior(self) -> None:
        """Set the variances of the states before any reading, and how they change along a bar."""
        work = self._scenario.workpiece
        depth_length = work.depth_correlation_length
        hardness_length = work.hardness_correlation_length
        # Noise along a bar blends two normal nodes, one correlation length L apart, with the cosine
        # and sine of (pi / 2) (x / L) (physics/workpiece.py). So its slope has the standard
        # deviation (pi / 2) (spread / L).
        depth_slope = 0.5 * np.pi * work.depth_along_spread / depth_length
        hardness_slope = 0.5 * np.pi * work.hardness_along_spread / hardness_length
        # Length over which the slope of depth is forgotten [mm].
        self._slope_length = 0.5 * depth_length
        # Variance that the logarithm of hardness gains along the bar [1/mm].
        self._hardness_drift = hardness_slope**2 * hardness_length

        wear_exponent = self._wear_exponent(self._scenario.material.thrust_force)
        sharpness_spread = wear_exponent * self._scenario.tool.wear_factor_spread
        variances = np.zeros(NUM_STATES)
        variances[EXCESS] = work.depth_bar_spread**2 + work.depth_along_spread**2
        variances[SLOPE] = depth_slope**2
        variances[BAR] = work.hardness_bar_spread**2 + work.hardness_along_spread**2
        variances[EDGE] = sharpness_spread**2 + MODEL_SPREAD**2
        variances[ALL_BARS] = MODEL_SPREAD**2
        self._prior = np.diag(variances)

    def _set_drawing(self) -> None:
        drawn = self._scenario.workpiece.drawn_sections()
        self._starts = drawn.starts
        # A section without any depth has no logarithm.
        lowest = 0.01 * drawn.depths.max()
        self._profile = np.maximum(drawn.depths, lowest)

    def reset(self, mask: Mask) -> None:
        """Forget everything about the environments in a mask."""
        self._forget(self._estimate, mask, slice(None))
        self._power.reset(mask)
        self._force.reset(mask)
        self._known[mask] = False
        self._readings[mask] = 0
        self._in_metal[mask] = False
        self._place[mask] = 0.0
        self._cutting_time[mask] = 0.0

    def miss(self) -> None:
        """Forget the bars at the next readings: steps without readings lie between."""
        self._missed = True

    def _forget(self, estimate: StateEstimate, mask: Mask, states: slice) -> None:
        """Set states back to their prior, independent of the others."""
        estimate.mean[mask, states] = 0.0
        estimate.covariance[mask, states, :] = 0.0
        estimate.covariance[mask, :, states] = 0.0
        estimate.covariance[mask, states, states] = self._prior[states, states]

    def follow(self, reading: Reading, place: Values | None) -> None:
        """Take the readings at the end of a step into the estimates.

        ``place`` is the tool position along the bar [mm], below 0 before it. None: the feed is
        integrated over the time in metal.
        """
        interval = self._scenario.control.interval

        # The edge's time in metal falls only if the edge is changed.
        fresh_edge = reading.cutting_time < self._cutting_time - 1e-5
        self._forget(self._estimate, fresh_edge, OF_AN_EDGE)
        time_before = np.where(fresh_edge, 0.0, self._cutting_time)
        seconds = 60.0 * (reading.cutting_time - time_before)
        engaged = np.clip(seconds, 0.0, np.inf if self._missed else interval)
        self._cutting_time = reading.cutting_time

        self._velocity = self._feed_velocity(reading.cutting_speed, reading.feed)
        moved = self._mean_velocity(reading) * engaged
        self._speed_before = reading.cutting_speed
        self._feed_before = reading.feed
        self._wearing_feed = reading.feed

        passed_gap = self._passed_gap(reading, place, moved, engaged=engaged)
        new_bar = ~reading.cutting | ~self._in_metal | passed_gap | self._missed
        self._missed = False
        self._forget(self._estimate, new_bar, OF_A_BAR)
        self._known &= ~new_bar
        self._readings[new_bar] = 0

        stayed_in_metal = self._in_metal & ~passed_gap
        time_in_metal = np.where(stayed_in_metal, interval, engaged)
        if place is None:
            place = self._moved_to(reading, moved, passed_gap)
        # In metal, the tool cannot be before the bar: a wrong zero must not free the feed.
        self._place = np.where(reading.cutting, np.maximum(place, 0.0), place)
        self._in_metal = reading.cutting
        min_wear = MIN_WEAR * self._scenario.tool.wear_criterion
        self._wear = np.maximum(reading.nominal_wear, min_wear)
        self._estimate = self._predicted(moved)
        self._read_loads(reading, engaged, moved, time_in_metal=time_in_metal)

    def _read_loads(
        self, reading: Reading, engaged: Values, moved: Values, time_in_metal: Values
    ) -> None:
        """Correct the estimate by the readings of power and force.

        Args:
            reading: readings at the end of the step.
            engaged: time in metal by the edge's own clock [s].
            moved: distance in metal [mm].
            time_in_metal: time in which the sensors followed the load [s].
        """
        section = np.maximum(self._section(), 0)
        depth = self._profile[section]
        speed = reading.cutting_speed
        power = self._power.law(speed, reading.feed, depth, wear=self._wear)
        force = self._force.law(speed, reading.feed, depth, wear=self._wear)
        cut_power = reading.power - idle_power_at(self._scenario, speed)
        measured_power = np.maximum(cut_power, 0.01 * power)
        measured_force = np.maximum(reading.thrust_force, 0.01 * force)

        # The chip's lag counts revolutions, moved / feed.
        chip_lag = self._scenario.machine.chip_lag
        remains: Values | float = 0.0
        if chip_lag > 0.0:
            remains = np.exp(-moved / reading.feed / chip_lag)
        shown_power = self._power.follow(power, remains, reading.cutting, time_in_metal)
        shown_force = self._force.follow(force, remains, reading.cutting, time_in_metal)

        # The models do not hold at a standstill.
        moves = reading.feed > 0.5 * self._scenario.machine.feed_min
        cuts = reading.cutting & (engaged > 0.0) & moves
        power_readable = cuts & (shown_power > MIN_BUILT_UP * power)
        force_readable = cuts & (shown_force > MIN_BUILT_UP * force)
        self._known |= power_readable
        self._readings += power_readable

        # The power sensor's noise is a share of the whole power, of which idling is a part.
        whole_over_cut = np.maximum(reading.power / measured_power, 1.0)
        power_lag = np.log(np.maximum(shown_power, 1e-9) / power)
        force_lag = np.log(np.maximum(shown_force, 1e-9) / force)
        power_noise = self._power.noise * whole_over_cut
        force_noise = self._force.noise
        log_power = np.log(measured_power / power)
        log_force = np.log(measured_force / force)
        self._correct(
            self._power,
            log_power - power_lag,
            variance=power_noise**2 + (LAG_ERROR * power_lag) ** 2,
            depth=depth,
            readable=power_readable,
        )
        self._correct(
            self._force,
            log_force - force_lag,
            variance=force_noise**2 + (LAG_ERROR * force_lag) ** 2,
            depth=depth,
            readable=force_readable,
        )

    def _feed_velocity(self, cutting_speed: Values, feed: Values) -> Values:
        """Return the feed velocity [mm/s] at a cutting speed [m/min] and a feed [mm/rev]."""
        velocity: Values = feed_velocity_at(cutting_speed, feed, self._scenario.workpiece.diameter)
        return velocity

    def _mean_velocity(self, reading: Reading) -> Values:
        """Return the mean feed velocity [mm/s] since the last readings.

        Both drives follow with a first-order lag.
        """
        machine = self._scenario.machine
        interval = self._scenario.control.interval
        speed = mean_of_lag(
            self._speed_before,
            reading.cutting_speed,
            time_constant=machine.spindle_time_constant,
            interval=interval,
        )
        feed = mean_of_lag(
            self._feed_before,
            reading.feed,
            time_constant=machine.feed_time_constant,
            interval=interval,
        )
        return self._feed_velocity(speed, feed)

    def _passed_gap(
        self, reading: Reading, place: Values | None, moved: Values, engaged: Values
    ) -> Mask:
        """Return whether the tool has passed into another bar between two readings in metal.

        The gap between two bars may be so short that no reading falls into it. Then the time in
        metal falls short of the interval by the time that the gap takes.
        """
        work = self._scenario.workpiece
        stays_in_metal = reading.cutting & self._in_metal
        if place is not None:
            is_far_back = place < self._place - 0.5 * work.bar_length
            return stays_in_metal & is_far_back
        near_end = self._place + moved > NEAR_END * work.bar_length
        missing = self._scenario.control.interval - engaged
        half_gap = 0.5 * work.approach / self._velocity  # [s]
        return stays_in_metal & near_end & (missing > half_gap)

    def _moved_to(self, reading: Reading, moved: Values, passed_gap: Mask) -> Values:
        """Return the tool position along the bar [mm] after a distance in metal [mm]."""
        start = np.where(self._in_metal, self._place, 0.0)
        place = start + moved
        in_next_bar = place - self._scenario.workpiece.bar_length
        place = np.where(passed_gap, in_next_bar, place)
        return np.where(reading.cutting, place, -1e-9)

    def _section(self) -> NDArray[np.intp]:
        """Return the index of the drawing's section in which the tool is; -1: before the bar."""
        return np.searchsorted(self._starts, self._place, side="right") - 1

    def _predicted(self, moved: Values) -> StateEstimate:
        """Return the estimate after a distance [mm] in metal.

        The slope of depth is a process that forgets over ``_slope_length``; the excess integrates
        it. The logarithms of hardness and of the edge's force drift at random.
        """
        estimate = self._estimate
        keep = np.exp(-moved / self._slope_length)
        step = np.tile(np.eye(NUM_STATES), (len(moved), 1, 1))
        step[:, EXCESS, SLOPE] = self._slope_length * (1.0 - keep)
        step[:, SLOPE, SLOPE] = keep
        mean = np.einsum("nij,nj->ni", step, estimate.mean)
        covariance = step @ estimate.covariance @ step.transpose(0, 2, 1)

        # The slope's new part grows along the way, and the excess integrates it.
        slope_variance = self._prior[SLOPE, SLOPE] * (1.0 - keep**2)
        both = slope_variance * moved / 2.0
        covariance[:, EXCESS, EXCESS] += slope_variance * moved**2 / 3.0
        covariance[:, EXCESS, SLOPE] += both
        covariance[:, SLOPE, EXCESS] += both
        covariance[:, SLOPE, SLOPE] += slope_variance
        covariance[:, BAR, BAR] += self._hardness_drift * moved
        covariance[:, EDGE, EDGE] += EDGE_DRIFT**2 * moved
        return StateEstimate(mean, covariance)

    def _correct(
        self, load: LoadModel, measured: Values, variance: Values, depth: Values, readable: Mask
    ) -> None:
        """Correct the estimate by the logarithm of a measured load over nominal, where readable.

        A load far below the expected one is that of a tool that has left the metal before the
        signal ``cutting`` says so. It would spoil what is known of the edge and of all bars.
        """
        mean = self._estimate.mean
        covariance = self._estimate.covariance
        expected, gradient = load.response(mean, depth)
        surprise = measured - expected
        shared = np.einsum("nij,nj->ni", covariance, gradient)
        total = np.einsum("ni,ni->n", shared, gradient) + variance
        believed = readable & (surprise > -NO_CUT * np.sqrt(total))
        gain = np.where(believed[:, None], shared / total[:, None], 0.0)
        self._estimate = StateEstimate(
            mean=mean + gain * surprise[:, None],
            covariance=covariance - gain[:, :, None] * shared[:, None, :],
        )

    def expect(self, target: float, asked_speed: Values, asked_feed: Values) -> None:
        """Set the loads over nominal that commands must bear, here and in the following section.

        A load must bear the larger of two: the expected load over ``target``, and the expected load
        plus a margin over the tolerated one. The uncertainty grows with the distance that the tool
        moves until the next command holds. It moves at its present velocity, or at that of the
        asked speed [m/min] and feed [mm/rev], as far as loads allow it, if that is higher.
        """
        self._outlook = self._outlook_at(self._velocity, target)
        allowed_feed = np.minimum(self.feeds(asked_speed).lower(), asked_feed)
        asked_velocity = self._feed_velocity(asked_speed, allowed_feed)
        self._outlook = self._outlook_at(np.maximum(self._velocity, asked_velocity), target)

    def _outlook_at(self, velocity: Values, target: float) -> SectionsAhead:
        """Return what commands must bear if the tool moves at a velocity [mm/s]."""
        work = self._scenario.workpiece
        machine = self._scenario.machine
        section = self._section()
        new_bar = section == len(self._starts) - 1  # a new bar follows this section
        following = np.where(new_bar, 0, section + 1)

        estimate = self._predicted(velocity * (self._horizon + machine.feed_time_constant))
        present = self._section_outlook(
            estimate, self._profile[section], unknown=~self._known, target=target
        )
        estimate_there = estimate.copy()
        self._forget(estimate_there, new_bar, OF_A_BAR)
        there = self._section_outlook(
            estimate_there,
            self._profile[following],
            unknown=new_bar | ~self._known,
            target=target,
        )

        next_start = np.where(new_bar, work.bar_length + work.approach, self._starts[following])
        time_left = np.maximum(next_start - self._place, 0.0) / velocity
        is_last = new_bar & (work.bars == 1)
        return SectionsAhead(
            present=present,
            following=there,
            in_air=section < 0,
            is_last=is_last,
            time_left=time_left,
            slack=self._slack(time_left, is_last),
        )

    def _slack(self, time_left: Values, is_last: Mask) -> Values:
        """Return the gap to the lowest feed now over that in the following section [-].

        From this gap the feed falls in time, exponentially as the drive does.
        """
        control = self._scenario.control
        fall_time = max(self._scenario.machine.feed_time_constant, 1e-3)
        if control.action == "incremental":
            # Each step changes the logarithm of feed by ``feed_step`` at most.
            fall_time = max(fall_time, control.interval / control.feed_step)
        left = time_left - self._horizon - SETTLED
        slack = np.exp(np.clip(left / fall_time, 0.0, 50.0))
        slack[is_last] = np.inf
        return slack

    def _section_outlook(
        self, estimate: StateEstimate, depth: Values, unknown: Mask, target: float
    ) -> SectionOutlook:
        """Return what commands must bear in a section of a nominal depth [mm]."""
        return SectionOutlook(
            depth=depth,
            loads=ByLoad(
                power=self._load_to_bear(self._power, estimate, depth, unknown, target),
                force=self._load_to_bear(self._force, estimate, depth, unknown, target),
            ),
        )

    def _load_to_bear(
        self, load: LoadModel, estimate: StateEstimate, depth: Values, unknown: Mask, target: float
    ) -> Values:
        """Return a load over nominal that commands must bear at a nominal depth [mm]."""
        expected, gradient = load.response(estimate.mean, depth)
        variance = np.einsum("ni,nij,nj->n", gradient, estimate.covariance, gradient)
        has_few_readings = self._readings < FIRST_READINGS
        margin = np.where(has_few_readings, FIRST_MARGIN, MARGIN)
        margin = np.where(unknown, ENTRY_MARGIN, margin)
        with_margin = expected + margin * np.sqrt(variance)
        with_margin -= np.log1p(self._scenario.limits.overload_tolerance)
        at_target = expected - np.log(target)
        load_to_bear: Values = np.exp(np.maximum(at_target, with_margin))
        return load_to_bear

    def feeds(self, speed: Values) -> ByLoad:
        """Return the feeds [mm/rev] at which power and force reach their allowed values.

        ``speed`` is the cutting speed [m/min], with one column per environment.
        """
        outlook = self._outlook
        wear = self._wear_ahead(speed)
        here = feeds_at_limits(self._scenario, speed, outlook.present, wear)
        there = feeds_at_limits(self._scenario, speed, outlook.following, wear)
        return ByLoad(
            power=self._feed_in_time(here.power, there.power),
            force=self._feed_in_time(here.force, there.force),
        )

    def _feed_in_time(self, here: Values, there: Values) -> Values:
        """Return the feed from which it can fall in time to that of the following section."""
        outlook = self._outlook
        lowest = self._scenario.machine.feed_min
        # It falls to the lowest feed also if that one is too high there: another speed or the
        # operator must help then.
        gap = np.maximum(there - lowest, LOWEST_GAP * lowest)
        later = lowest + gap * outlook.slack
        now = np.where(outlook.in_air, np.inf, here)
        return np.minimum(now, later)

    def _wear_ahead(self, speed: Values) -> Values:
        """Return the nominal flank wear [mm] at the end of the next command's step.

        The edge uses its life at the rate of the commanded cut, by equivalent time.
        """
        scenario = self._scenario
        law = scenario.material.wear
        depth = scenario.workpiece.depth_of_cut
        minutes = self._horizon / 60.0
        rate = life_rate(
            law,
            scenario.tool.wear_criterion,
            cutting_speed=speed,
            feed=self._wearing_feed,
            depth_of_cut=depth,
        )
        used_life = used_life_at(scenario, self._wear) + minutes * rate
        wear: Values = wear_at(scenario, used_life)
        if scenario.tool.wear_rule == "clock_time":
            # Under this rule, the edge wears as if it had always cut like this.
            cutting_time = self._cutting_time + minutes
            as_always = law(speed, self._wearing_feed, depth, time=cutting_time)
            wear = np.maximum(wear, as_always)
        return wear

    def speed(self, asked: Values, feed: Values, free: bool) -> tuple[Values, Mask]:
        """Return the cutting speed [m/min] to command, and where nothing keeps the limits.

        It is the speed nearest to the asked one at which the removal rate can be the asked one, or
        else is highest. Nothing keeps the limits if the lowest feed exceeds them at all speeds near
        the asked one.

        Args:
            asked: asked speed [m/min].
            feed: asked feed [mm/rev].
            free: whether the speed may be changed.
        """
        machine = self._scenario.machine
        self._wearing_feed = np.maximum(self._wearing_feed, feed)
        changes = np.zeros(1)
        if free:
            changes = np.linspace(-SPEED_CHANGE, SPEED_CHANGE, NUM_CHANGES)
        # The first of equal speeds is chosen, so the smallest change comes first.
        order = np.argsort(np.abs(changes), kind="stable")
        factors = np.exp(changes[order])
        speeds = np.clip(
            asked * factors[:, None],
            machine.cutting_speed_min,
            self._scenario.cutting_speed_max,
        )
        feeds = self.feeds(speeds).lower()

        # Speeds at which the lowest feed is too high are chosen last.
        fits = feeds >= machine.feed_min
        removal = speeds * np.where(fits, feeds, 1e-6 * feeds)
        enough = removal >= asked * feed
        chosen = np.where(
            enough.any(axis=0),
            enough.argmax(axis=0),
            removal.argmax(axis=0),
        )
        none_fits = (feeds < machine.feed_min).all(axis=0)
        hopeless = self._known & none_fits
        return speeds[chosen, np.arange(len(asked))], hopeless

    def entry_speed(self, asked: Values, commanded: Values, free: bool) -> tuple[Values, Mask]:
        """Return the cutting speed [m/min] to command for the following section or bar.

        It is the speed nearest to the asked one at which the lowest feed keeps the limits there.
        The asked speed stays where there is time to change it later. Also return where the tool is
        about to enter, and no speed will do.

        Args:
            asked: asked speed [m/min].
            commanded: present command [m/min], from which the speed changes.
            free: whether the speed may be changed.
        """
        scenario = self._scenario
        outlook = self._outlook
        interval = scenario.control.interval
        lowest = scenario.machine.cutting_speed_min
        highest = scenario.cutting_speed_max
        min_feed = scenario.machine.feed_min
        speed = asked.copy()
        blocked = np.zeros(len(asked), np.bool_)

        # Largest change of the speed's logarithm in a step.
        speed_step = np.inf
        if scenario.control.action == "incremental":
            speed_step = scenario.control.cutting_speed_step
        max_steps = np.log(highest / lowest) / speed_step + ENTRY_LEAD
        is_soon = outlook.time_left < max_steps * interval
        near = is_soon & ~outlook.is_last
        if not near.any():
            return speed, blocked

        asked_near = asked[near]
        commanded_near = commanded[near]
        speeds = commanded_near[None, :]
        if free:
            speeds = np.geomspace(lowest, highest, ENTRY_SPEEDS)[:, None]
        following = SectionOutlook(
            depth=outlook.following.depth[near],
            loads=ByLoad(
                power=outlook.following.loads.power[near],
                force=outlook.following.loads.force[near],
            ),
        )
        wear = self._wear[near]
        feeds = feeds_at_limits(scenario, speeds, following, wear).lower()
        fits = feeds >= min_feed
        none_fits = ~fits.any(axis=0)
        changes = np.abs(np.log(speeds / asked_near))
        nearest = np.where(fits, changes, np.inf).argmin(axis=0)
        all_speeds = np.broadcast_to(speeds, feeds.shape)
        fitting = all_speeds[nearest, np.arange(len(nearest))]

        # The asked speed may keep the limits itself, although it is not among the tried ones.
        asked_feeds = feeds_at_limits(scenario, asked_near, following, wear).lower()
        asked_fits = asked_feeds >= min_feed
        change = np.abs(np.log(fitting / commanded_near))
        steps = change / speed_step + ENTRY_LEAD
        due = outlook.time_left[near] < steps * interval
        must_change = due & ~asked_fits & ~none_fits
        speed[near] = np.where(must_change, fitting, asked_near)
        blocked[near] = due & none_fits & ~asked_fits
        return speed, blocked

    def proven_feed(self, reading: Reading) -> tuple[Values, Mask]:
        """Return the feeds [mm/rev] that readings allow which prove an overload by themselves.

        Without such a reading, the feed is infinite. No model or estimate can make one harmless.
        Also return whether it is the power that is over its limit.
        """
        scenario = self._scenario
        limits = scenario.limits
        tolerated = 1.0 + limits.overload_tolerance
        idle = idle_power_at(scenario, reading.cutting_speed)
        # The loads without the noise that may have raised the readings.
        certain_power = reading.power * math.exp(-CERTAIN * self._power.noise)
        certain_force = reading.thrust_force * math.exp(-CERTAIN * self._force.noise)

        max_cut_power = cutting_power_limit(scenario, reading.cutting_speed, tolerated=tolerated)
        max_force = tolerated * limits.thrust_force
        power_share = (certain_power - idle) / max_cut_power
        force_share = certain_force / max_force
        by_power = proven_bound(reading, power_share, self._power.law)
        by_force = proven_bound(reading, force_share, self._force.law)
        power_is_over = reading.cutting & (power_share > 1.0)
        return np.minimum(by_power, by_force), power_is_over


def proven_bound(reading: Reading, share: Values, law: PowerLaw) -> Values:
    """Return the feed [mm/rev] at which a load falls to its limit; infinite if it is below.

    ``share`` is the load over its limit [-]. A load that the feed does not change allows the
    present feed.
    """
    exponent = law.feed if law.feed > 0.0 else np.inf
    factor = np.maximum(share, 1.0) ** (-1.0 / exponent)
    bound = reading.feed * factor
    is_over = reading.cutting & (share > 1.0)
    return np.where(is_over, bound, np.inf)


def mean_of_lag(start: Values, end: Values, time_constant: float, interval: float) -> Values:
    """Return the mean over an interval [s] of a value that follows with a first-order lag.

    The command is constant, and the value moves from ``start`` to ``end``.
    """
    if time_constant <= 0.0:
        return end
    remains = math.exp(-interval / time_constant)
    mean_share = time_constant / interval - remains / (1.0 - remains)
    return end + (start - end) * mean_share


def feeds_at_limits(
    scenario: Scenario, speed: Values, section: SectionOutlook, wear: Values
) -> ByLoad:
    """Return the feeds [mm/rev] at which the loads in a section reach their limits.

    They are infinite if feed has no effect.

    Args:
        scenario: has the laws and the limits.
        speed: cutting speed [m/min].
        section: nominal depth, and loads over nominal.
        wear: nominal flank wear [mm].
    """
    limits = scenario.limits
    material = scenario.material
    # Nominal loads at a feed of 1 mm/rev.
    unit_feed = np.ones_like(section.depth)
    unit_power = material.power(speed, unit_feed, section.depth, wear=wear)
    unit_force = material.thrust_force(speed, unit_feed, section.depth, wear=wear)
    power = section.loads.power * unit_power
    force = section.loads.force * unit_force
    max_power = cutting_power_limit(scenario, speed)
    return ByLoad(
        power=feed_at_limit(material.power, max_power, at_unit_feed=power),
        force=feed_at_limit(material.thrust_force, limits.thrust_force, at_unit_feed=force),
    )
