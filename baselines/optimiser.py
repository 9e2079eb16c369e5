"""An optimiser of one step, on a Kalman filter's estimates of the hidden state.

In every step it chooses the cutting speed and feed within reach with the greatest expected gain:

    value of metal - price of the life used - price of overload - price of breakage

Force and power are log-normal with the filter's means and variances. So the expected excess over a limit has a closed form (the
price of an option, Black and Scholes 1973). So does the risk that an unmeasured bar breaks the edge. The price of the edge's
life comes from dynamic programming (``models/edge_value.py``).

The search tries a grid of feeds for each of several cutting speeds and refines it around the best feed. A parabola through the
best speed and its neighbours gives the speed between them. Gains enter the tried values only through comparisons. So the last
bits of exponentials, which differ between processors, hardly ever change an action.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from baselines.models.edge_value import USED_LIVES, expected_excess, worth
from baselines.models.kalman import Array, LoadFilter, Outlook, decay, feed_velocity
from baselines.rule import Range, Rule
from turning_env import PowerLaw, Reading, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.scoring.policy import Actions, Observations

POINTS = 3
"""Points of a step at which loads are predicted."""
SPEEDS = 7
"""Number of cutting speeds to try, from the lowest to the highest within reach."""
FEEDS, REFINEMENTS = 9, 3
"""Number of feeds to try for each cutting speed, and of grids; each grid refines the last around its best feed."""
MIN_SPREAD = 1e-3
"""Least standard deviation of log force and log power [-]; it keeps expectations smooth if nothing varies."""
MIN_USED_LIFE = 1e-9
"""Used share of life of an edge that has not cut [-]: the laws are undefined without wear."""


class Prospect(NamedTuple):
    """The terms of the gain. A field has shape (num_envs,), or (num_envs, points) for points ahead of the tool."""

    outlook: Outlook
    """On the bar, at points."""
    log_speed: Array
    """Actual cutting speed [log m/min]."""
    log_feed: Array
    """Actual feed [log mm/rev]."""
    used_life: Array
    """Used share of the edge's life by the nominal model [-]."""
    breakage_price: Array
    """Cost of breaking the edge [s]."""
    metal_value: Array
    """Value of metal over cutting speed and feed [per m/min and mm/rev], at points."""
    life_price: Array
    """Price of a life [s] that is used at the rate of nominal depth and hardness, at points."""
    cutting: Array
    """1 in metal, 0 in air, at points."""
    unmeasured: Array
    """1 in metal of a bar that has not been measured, else 0, at points."""

    def of(self, env_indices: NDArray[np.intp]) -> "Prospect":
        """Return the prospect of some environments, in any order and any number of times."""
        outlook, *fields = self
        return Prospect(Outlook(*(field[env_indices] for field in outlook)), *(field[env_indices] for field in fields))


class LogLaw:
    """A law for log(response / limit) at nominal depth and hardness."""

    def __init__(self, law: PowerLaw, scenario: Scenario, limit: float) -> None:
        self._law = law
        at_one = law(1.0, 1.0, scenario.workpiece.depth_of_cut, wear=scenario.tool.wear_criterion)
        self._constant = float(np.log(at_one / limit))

    def __call__(self, log_speed: Array, log_feed: Array, log_wear: Array | float = 0.0) -> Array:
        """Return log(response / limit) for log cutting speed [m/min], log feed [mm/rev] and log(wear / criterion); broadcasts."""
        law = self._law
        return self._constant + law.cutting_speed * log_speed + law.feed * log_feed + law.wear * log_wear


class Optimiser:
    """A policy that maximises the expected gain of each step alone.

    Args:
        scenario: task.
        num_envs: number of environments.
        severity: factor on the price of overload [-].
        caution: factor on the standard deviations of force and power [-].
    """

    def __init__(self, scenario: Scenario, num_envs: int, severity: float, caution: float) -> None:
        self._scenario, self._caution = scenario, caution
        self._overload_price = severity * scenario.economics.overload_price
        material, limits, tool = scenario.material, scenario.limits, scenario.tool
        self._wear = LogLaw(material.wear, scenario, tool.wear_criterion)
        self._force = LogLaw(material.thrust_force, scenario, limits.thrust_force)
        self._power = LogLaw(material.power, scenario, limits.power)
        base_speed = scenario.base_cutting_speed
        self._log_base_speed = math.log(base_speed) if base_speed else -math.inf
        self._log_strength = float(np.log(tool.edge_strength / limits.thrust_force))
        self._prices = worth(scenario, self._overload_price).life
        self._filter = LoadFilter(scenario, num_envs)
        self._look_at(scenario.control.interval * (np.arange(POINTS) + 0.5) / POINTS)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the estimates."""
        self._filter.reset(mask)

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, action size), for observations, shape (num_envs, entries)."""
        reading = read(observations, self._scenario)
        self._filter.observe(reading)
        return towards(reading, self._scenario, *self._set_point(reading), self._spent(reading))

    def _used_life(self, reading: Reading) -> tuple[Array, Array]:
        """Return the used share of the edge's life [-] by the nominal model and by the filter."""
        exponent = self._scenario.material.wear.time
        nominal = (reading.nominal_wear / self._scenario.tool.wear_criterion) ** (1.0 / exponent)
        nominal = np.maximum(nominal, MIN_USED_LIFE)
        return nominal, nominal * np.exp(self._filter.log_wear_factor / exponent)

    def _spent(self, reading: Reading) -> NDArray[np.bool_]:
        """Return whether to change the edge: its life has no price left, or may be over (at one standard deviation)."""
        _, used_life = self._used_life(reading)
        over = used_life * np.exp(self._filter.wear_doubt / self._scenario.material.wear.time) >= 1.0
        worthless = np.interp(used_life, USED_LIVES, self._prices) <= 0.0
        return (reading.nominal_wear > 0.0) & (over | worthless)

    def _look_at(self, times: Array) -> None:
        """Predict at these times after a step's start [s]."""
        self._times = times
        self._spindle_left = decay(times, self._scenario.machine.spindle_time_constant)
        self._feed_left = decay(times, self._scenario.machine.feed_time_constant)

    def _set_point(self, reading: Reading) -> tuple[Array, Array]:
        """Return cutting speed [m/min] and feed [mm/rev] to command, each of shape (num_envs,)."""
        velocity = feed_velocity(self._scenario, reading.commanded_cutting_speed, reading.commanded_feed)
        outlook = self._filter.ahead(velocity[:, np.newaxis] * self._times)
        cutting = np.ones(outlook.log_force.shape)
        unmeasured = cutting - self._filter.measured[:, np.newaxis]
        return self._best(reading, self._prospect(reading, outlook, cutting, unmeasured))

    def _prospect(self, reading: Reading, outlook: Outlook, cutting: Array, unmeasured: Array) -> Prospect:
        """Return the prospect for an outlook; ``cutting`` and ``unmeasured`` are 1 in metal and in an unmeasured bar, else 0."""
        economics, law = self._scenario.economics, self._scenario.material.wear
        nominal_depth = self._scenario.workpiece.depth_of_cut
        used_life, estimated = self._used_life(reading)
        price = np.interp(estimated, USED_LIVES, self._prices)
        wear = law.depth_of_cut * np.log(outlook.depth_of_cut / nominal_depth) + law.hardness * outlook.log_hardness
        left = np.maximum(1.0 - used_life, 0.0)
        # Air costs only time: crossing it is worth the metal that could be cut instead.
        depth = np.where(cutting > 0, outlook.depth_of_cut, nominal_depth)
        return Prospect(
            outlook=outlook,
            log_speed=np.log(reading.cutting_speed),
            log_feed=np.log(reading.feed),
            used_life=used_life,
            breakage_price=60.0 * (left * (economics.edge_cost + economics.edge_change_time) + economics.breakage_downtime),
            metal_value=depth / economics.reference_removal_rate,
            life_price=price[:, np.newaxis] * np.exp(wear / law.time),
            cutting=cutting,
            unmeasured=unmeasured,
        )

    def _gain(self, log_speed: Array, log_feed: Array, prospect: Prospect) -> Array:
        """Return the expected mean gain [s of machine time per s] of commands, one per environment of the prospect."""
        tool, exponent, outlook = self._scenario.tool, self._scenario.material.wear.time, prospect.outlook
        speed, feed = log_speed[:, np.newaxis], log_feed[:, np.newaxis]
        speed = speed + (prospect.log_speed[:, np.newaxis] - speed) * self._spindle_left
        feed = feed + (prospect.log_feed[:, np.newaxis] - feed) * self._feed_left
        life_rate = np.exp(self._wear(speed, feed) / exponent) / 60.0  # [1/s]
        wear = exponent * np.log(prospect.used_life[:, np.newaxis] + life_rate * self._times)
        force = self._force(speed, feed, wear) + outlook.log_force
        power = self._power(speed, feed, wear) + outlook.log_power - np.minimum(speed - self._log_base_speed, 0.0)
        excess = self._excess(force, outlook.force_spread) + self._excess(power, outlook.power_spread)
        cost = prospect.life_price * life_rate + self._overload_price * excess
        gain = prospect.metal_value * np.exp(speed + feed) - prospect.cutting * cost
        doubt = np.maximum(np.hypot(outlook.force_spread, tool.edge_strength_spread), MIN_SPREAD)
        risk = np.max(prospect.unmeasured * ndtr((force - self._log_strength) / doubt), axis=1)
        return np.asarray(gain.mean(axis=1) - prospect.breakage_price * risk / self._scenario.control.interval)

    def _excess(self, log_load: Array, spread: Array) -> Array:
        return expected_excess(log_load, np.maximum(self._caution * spread, MIN_SPREAD))

    def _best(self, reading: Reading, prospect: Prospect) -> tuple[Array, Array]:
        """Return the cutting speed [m/min] and feed [mm/rev] within reach with the greatest gain."""
        slowest, fastest = self._reach(reading.commanded_cutting_speed, "cutting_speed")
        low, high = (np.repeat(end, SPEEDS) for end in self._reach(reading.commanded_feed, "feed"))
        speeds = np.linspace(slowest, fastest, SPEEDS, axis=1)
        rungs = np.arange(speeds.size)
        tried = np.repeat(speeds.ravel(), FEEDS)
        prospects = prospect.of(np.repeat(rungs // SPEEDS, FEEDS))
        for _ in range(REFINEMENTS):
            feeds = np.linspace(low, high, FEEDS, axis=1)
            gains = self._gain(tried, feeds.ravel(), prospects).reshape(feeds.shape)
            top = np.argmax(gains, axis=1)
            low, high = feeds[rungs, np.maximum(top - 1, 0)], feeds[rungs, np.minimum(top + 1, FEEDS - 1)]
        best_feeds, best_gains = (found[rungs, top].reshape(speeds.shape) for found in (feeds, gains))
        speed, feed = self._between(speeds, best_feeds, best_gains, prospect)
        return np.exp(speed), np.exp(feed)

    def _between(self, speeds: Array, feeds: Array, gains: Array, prospect: Prospect) -> tuple[Array, Array]:
        """Return the best log speed and log feed, or those of a parabola through the best and its neighbours, if better."""
        envs = np.arange(len(gains))
        top = np.argmax(gains, axis=1)
        middle = np.clip(top, 1, SPEEDS - 2)
        around = envs[:, np.newaxis], middle[:, np.newaxis] + np.array([-1, 0, 1])
        below, at, above = gains[around].T
        curvature = 2.0 * at - below - above
        share = np.divide(0.5 * (above - below), curvature, out=np.zeros_like(at), where=curvature > 0)
        share = np.clip(share, -1.0, 1.0)
        weights = np.stack([0.5 * share * (share - 1.0), 1.0 - share**2, 0.5 * share * (share + 1.0)], axis=1)
        speed = np.sum(weights * speeds[around], axis=1)
        feed = np.clip(np.sum(weights * feeds[around], axis=1), feeds[around].min(axis=1), feeds[around].max(axis=1))
        better = self._gain(speed, feed, prospect) > gains[envs, top]
        return np.where(better, speed, speeds[envs, top]), np.where(better, feed, feeds[envs, top])

    def _reach(self, commanded: Array, name: str) -> tuple[Array, Array]:
        """Return the logarithms of the lowest and the highest value that the next action can command."""
        control, machine = self._scenario.control, self._scenario.machine
        least, most = (float(np.log(getattr(machine, f"{name}_{end}"))) for end in ("min", "max"))
        if control.action == "set_point":
            return np.full(len(commanded), least), np.full(len(commanded), most)
        step = getattr(control, f"{name}_step")
        return np.clip(np.log(commanded) - step, least, most), np.clip(np.log(commanded) + step, least, most)


def plays(scenario: Scenario) -> bool:
    """Return whether an action sets speed and feed, and force and power are measured."""
    return sets_speed_and_feed(scenario) and scenario.sensors.force == "dynamometer"


PARAMETERS = {"severity": Range(0.5, 4.0, logarithmic=True), "caution": Range(0.5, 2.0, logarithmic=True)}


def optimising(description: str, optimiser: Callable[..., Optimiser], version: int) -> Rule:
    """Return the rule of an optimiser: ``optimiser(scenario, num_envs, severity, caution)``."""
    return Rule(
        description,
        lambda scenario, num_envs, parameters: optimiser(scenario, num_envs, **parameters),
        plays,
        PARAMETERS,
        version=version,
        changes_edges=True,
        tuned_on="rough_turning",
    )


DESCRIPTION = "the best expected net gain of each step, on a Kalman filter's estimates and a price of life by dynamic programming"
RULES = {"optimiser": optimising(DESCRIPTION, Optimiser, version=2)}
