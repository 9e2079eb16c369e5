"""An optimiser of one step, on a Kalman filter's estimates of the hidden state.

In every step it chooses the cutting speed and feed within reach with the greatest expected gain
(``models/feed_search.py``):

    value of metal - price of the life used - price of overload - price of breakage

Force and power are log-normal with the filter's means and variances. So the expected excess over a
limit has a closed form (the price of an option, Black and Scholes 1973). So does the risk that an
unmeasured bar breaks the edge. The price of the edge's life comes from dynamic programming
(``models/edge_value.py``).

Uses from the nominal model: the laws of wear, force and power, prices, the spreads of depth,
hardness, wear factor and strength, and the lags and noise of drives and sensors.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from baselines.models import edge_value, feed_search
from baselines.models.edge_value import EXPECTED_LAWS, PRICED_SPREAD, PRICES, price_life
from baselines.models.feed_search import ENVIRONMENT, MOMENT, POINT, SET_POINT
from baselines.models.kalman_steps import FORCE, POWER, decay
from baselines.models.load_filter import LoadFilter, Outlook, records
from baselines.rule import Array, Mask, Rule, Scenarios, TuningRange
from turning_env import Reading, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.numerics.functions import exp, hypotenuse, log
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.laws import edge_price, used_life_at
from turning_env.scenario.scenario_batch import ScenarioBatch

USED_LIVES = np.linspace(0.0, 1.0, 41)[1:]
"""Shares of the life [-] at which ``worth`` tabulates its price."""
POINTS = 3  # points of a step at which loads are predicted
LEAD = 2.0
"""Steps before its end at which an edge is changed [-], because it may wear faster than
expected."""
MIN_SPREAD = 1e-3
"""Lower bound of the standard deviations [-]: without a spread, expectations have corners."""
MIN_USED_LIFE = 1e-9
"""Used life of an edge that has not cut [-]: the laws are undefined without wear."""


class LifeLaw(NamedTuple):
    """The rate at which a usual edge's life is used, as a power law.

    Numbers or arrays of shape (num_envs,).
    """

    log_rate: Array  # at 1 m/min and 1 mm/rev [log 1/s]
    speed: Array  # exponent of cutting speed [-]
    feed: Array  # exponent of feed [-]


class Ahead(NamedTuple):
    """Expectations of the policy ahead of the tool; arrays of shape (num_envs, points)."""

    outlook: Outlook
    cutting: Array  # 1 in metal, else 0
    unmeasured: Array  # 1 in metal of a bar that has not been measured, else 0


class Optimiser(Policy):
    """A policy that maximises the expected gain of each step alone.

    Args:
        scenario: nominal model, or one for each environment, all with the same actions and sensors.
        num_envs: number of environments.
        severity: factor on the price of overload [-].
        caution: factor on the standard deviations of force and power [-].
        wear_caution: factor on the standard deviation of the wear at which an edge may soon be worn
            out [-].
        errors: ``LawErrors`` that the filter expects; None: the nominal laws are right.
    """

    _priced_spread = PRICED_SPREAD

    def __init__(
        self,
        scenario: Scenarios,
        num_envs: int,
        severity: float,
        caution: float,
        wear_caution: float = 1.0,
        errors: Any = None,
    ) -> None:
        scenarios = [scenario] if isinstance(scenario, Scenario) else list(scenario)
        self._scenarios = scenarios
        self._scenario: Any = scenarios[0] if len(scenarios) == 1 else ScenarioBatch.of(scenarios)
        self._caution = caution
        self._wear_caution = wear_caution
        self._parameters = records(
            [edge_value.life_numbers(model, severity) for model in scenarios]
        )
        self._filter = LoadFilter(scenarios, num_envs, errors)
        self._times = self._times_ahead()
        self._moments = self._drive_moments()

    def reset(self, mask: Mask) -> None:
        self._filter.reset(mask)

    def act(self, observations: Observations) -> Actions:
        scenario = self._scenario
        reading = read(observations, scenario)
        self._observe(reading)
        exponent = scenario.material.wear.time
        nominal_life = np.maximum(used_life_at(scenario, reading.nominal_wear), MIN_USED_LIFE)
        expected_life = nominal_life * exp(self._filter.log_wear_factor / exponent)
        price = self.prices(expected_life)["life"]
        speed, feed = self._best_set_point(reading, nominal_life, price)
        change_edge = self._edge_is_spent(reading, expected_life, price)
        return towards(reading, scenario, speed, feed, change_edge)

    def _observe(self, reading: Reading) -> None:
        self._filter.observe(reading)

    def prices(self, used_life: Array) -> Any:
        """Return the prices of time and life at used lives, by the laws as the filter knows them.

        They are records of ``edge_value.PRICES``, shape (num_envs,).
        """
        parameters = self._parameters
        life = self._life_law()
        errors = self._filter.load_errors
        exponents = self._filter.exponents
        # Loads so many standard deviations above the expected stand for all bars of an edge.
        force_spread = self._priced_spread * parameters["force_spread"]
        power_spread = self._priced_spread * parameters["power_spread"]
        laws = np.empty(len(used_life), EXPECTED_LAWS)
        laws["log_life_rate"] = life.log_rate
        laws["life_speed"] = life.speed
        laws["life_feed"] = life.feed
        laws["log_force"] = parameters["log_force_coefficient"] + force_spread + errors[FORCE]
        laws["force_speed"] = exponents.speed[FORCE]
        laws["force_feed"] = exponents.feed[FORCE]
        laws["force_life"] = parameters["wear_time"] * exponents.wear[FORCE]
        laws["log_power"] = parameters["log_power_coefficient"] + power_spread + errors[POWER]
        laws["power_speed"] = exponents.speed[POWER]
        laws["power_feed"] = exponents.feed[POWER]
        laws["power_life"] = parameters["wear_time"] * exponents.wear[POWER]
        growth = self._filter.worn_out_growths
        laws["force_growth"] = growth[FORCE]
        laws["power_growth"] = growth[POWER]
        prices = np.empty(len(used_life), PRICES)
        price_life(parameters, laws, used_life, prices)
        return prices

    def _edge_is_spent(self, reading: Reading, used_life: Array, price: Array) -> Mask:
        """Return whether to change the edge: its life has no price left, or may soon be over."""
        # The wear factor contains the errors of the law of wear for this edge, so the law here is
        # the nominal one. Wear grows as W_max D^n: a factor on wear is its n-th root on life D.
        exponent = self._scenario.material.wear.time
        life = self._nominal_life_law()
        log_rate = life.log_rate + life.speed * log(reading.cutting_speed)
        log_rate = log_rate + life.feed * log(reading.feed)
        log_factor = self._filter.log_wear_factor / exponent
        rate = exp(log_rate + log_factor)  # [1/s]
        soon = used_life + rate * LEAD * self._scenario.control.interval
        doubt = exp(self._wear_caution * self._filter.wear_deviation / exponent)

        is_used = reading.nominal_wear > 0.0
        may_be_over = soon * doubt >= 1.0
        has_no_price = price <= 0.0
        return np.asarray(is_used & (may_be_over | has_no_price))

    def _times_ahead(self) -> Array:
        """Return the times after a step's start at which loads are predicted [s].

        Their shape is (1 or num_envs, points).
        """
        middles = np.arange(POINTS) + 0.5
        return np.asarray(column(self._scenario.control.interval) * middles / POINTS)

    def _drive_moments(self) -> Any:
        """Return records of ``feed_search.MOMENT``, shape (1 or num_envs, points).

        A drive approaches a new command exponentially. A record holds the share of a change that
        the drives have not yet made at one of the ``_times_ahead``.
        """
        machine = self._scenario.machine
        share_left = np.vectorize(decay)
        speed_left = share_left(self._times, column(machine.spindle_time_constant))
        feed_left = share_left(self._times, column(machine.feed_time_constant))
        moments = np.empty(np.broadcast_shapes(speed_left.shape, feed_left.shape), MOMENT)
        moments["time"] = self._times
        moments["speed_left"] = speed_left
        moments["feed_left"] = feed_left
        return moments

    def _velocity(self, reading: Reading) -> Array:
        """Return the commanded feed velocity [mm/s], shape (num_envs,)."""
        commanded = reading.commanded_cutting_speed * reading.commanded_feed
        return np.asarray(commanded * self._filter.parameters["velocity"])

    def _ahead(self, reading: Reading) -> Ahead:
        """Return the outlook, as if the tool stayed in this bar."""
        distance = self._velocity(reading)[:, np.newaxis] * self._times
        cutting = np.ones(distance.shape)
        return Ahead(
            outlook=self._filter.outlook(distance, np.zeros(distance.shape, np.bool_)),
            cutting=cutting,
            unmeasured=cutting - column(self._filter.memory["measured"]),
        )

    def _best_set_point(
        self, reading: Reading, used_life: Array, price: Array
    ) -> tuple[Array, Array]:
        """Return the best speed [m/min] and feed [mm/rev] within reach.

        ``used_life``: by the nominal model [-]; ``price``: of life [s].
        """
        points = self._points(self._ahead(reading), price)
        environments = self._environments(reading, used_life)
        best = np.empty(len(price), SET_POINT)
        feed_search.search(self._parameters, self._moments, environments, points, best)
        return exp(best["log_speed"]), exp(best["log_feed"])

    def _points(self, ahead: Ahead, price: Array) -> Any:
        """Return records of ``feed_search.POINT``, shape (num_envs, points), at prices of life."""
        scenario = self._scenario
        outlook = ahead.outlook
        wear_law = scenario.material.wear
        nominal_depth = column(scenario.workpiece.depth_of_cut)
        log_depth = log(outlook.depth_of_cut / nominal_depth)
        wear_by_depth = column(wear_law.depth_of_cut) * log_depth
        wear_by_hardness = column(wear_law.hardness) * outlook.log_hardness
        log_wear = wear_by_depth + wear_by_hardness
        # Air costs only time: crossing it is worth the metal that could be cut instead.
        depth = np.where(ahead.cutting > 0, outlook.depth_of_cut, nominal_depth)
        strength_spread = hypotenuse(
            outlook.force_spread, column(scenario.tool.edge_strength_spread)
        )
        points = np.empty(depth.shape, POINT)
        points["log_force"] = outlook.log_force
        points["log_power"] = outlook.log_power
        points["force_spread"] = np.maximum(self._caution * outlook.force_spread, MIN_SPREAD)
        points["power_spread"] = np.maximum(self._caution * outlook.power_spread, MIN_SPREAD)
        points["strength_spread"] = np.maximum(strength_spread, MIN_SPREAD)
        points["metal_value"] = depth / column(scenario.economics.reference_removal_rate)
        # Wear by a factor uses life by the factor to the power 1 / n, with n the exponent of time.
        points["life_price"] = column(price) * exp(log_wear / column(wear_law.time))
        points["cutting"] = ahead.cutting
        points["unmeasured"] = ahead.unmeasured
        return points

    def _environments(self, reading: Reading, used_life: Array) -> Any:
        """Return records of ``feed_search.ENVIRONMENT``, shape (num_envs,)."""
        scenario = self._scenario
        economics = scenario.economics
        life = self._life_law()
        exponents = self._filter.exponents
        min_log_speed, max_log_speed = self._reach(
            reading.commanded_cutting_speed,
            (self._min_speed(used_life), self._max_speed(used_life)),
            step=scenario.control.cutting_speed_step,
        )
        min_log_feed, max_log_feed = self._reach(
            reading.commanded_feed, self._feed_range(), step=scenario.control.feed_step
        )
        # A broken edge loses its unused life.
        unused = np.maximum(1.0 - used_life, 0.0)
        environments = np.empty(len(used_life), ENVIRONMENT)
        environments["min_log_speed"] = min_log_speed
        environments["max_log_speed"] = max_log_speed
        environments["min_log_feed"] = min_log_feed
        environments["max_log_feed"] = max_log_feed
        environments["log_speed"] = log(reading.cutting_speed)
        environments["log_feed"] = log(reading.feed)
        environments["used_life"] = used_life
        environments["breakage_price"] = 60.0 * (
            unused * edge_price(scenario) + economics.breakage_downtime
        )
        environments["log_life_rate"] = life.log_rate
        environments["life_speed"] = life.speed
        environments["life_feed"] = life.feed
        environments["force_speed"] = exponents.speed[FORCE]
        environments["force_feed"] = exponents.feed[FORCE]
        environments["force_wear"] = exponents.wear[FORCE]
        environments["power_speed"] = exponents.speed[POWER]
        environments["power_feed"] = exponents.feed[POWER]
        environments["power_wear"] = exponents.wear[POWER]
        # The wear of this edge is that of the nominal model times its wear factor.
        growth = self._filter.worn_out_growths * exp(self._filter.log_wear_factor)
        environments["force_growth"] = growth[FORCE]
        environments["power_growth"] = growth[POWER]
        return environments

    def _min_speed(self, used_life: Array) -> Any:
        """Return the lowest cutting speed to command [m/min] at nominal used lives [-]."""
        return self._scenario.machine.cutting_speed_min

    def _max_speed(self, used_life: Array) -> Any:
        """Return the highest cutting speed to command [m/min] at nominal used lives [-]."""
        return self._scenario.cutting_speed_max

    def _feed_range(self) -> tuple[Any, Any]:
        """Return the lowest and the highest feed to command [mm/rev]."""
        lowest, highest = self._scenario.feed_range
        return lowest, highest

    def _life_law(self) -> LifeLaw:
        """Return the law of the used life as the policy knows it."""
        return self._nominal_life_law()

    def _nominal_life_law(self) -> LifeLaw:
        """Return the law of the used life by the nominal model."""
        return LifeLaw(
            log_rate=self._parameters["log_life_rate"],
            speed=self._parameters["life_speed"],
            feed=self._parameters["life_feed"],
        )

    def _reach(self, commanded: Array, ends: tuple[Any, Any], step: float) -> tuple[Array, Array]:
        """Return the logs of the lowest and the highest value that the next action can command.

        ``commanded``: present value; ``ends``: of its range; ``step``: largest change of its log.
        """
        lowest_value, highest_value = ends
        low = log(lowest_value)
        high = log(highest_value)
        if self._scenario.control.action == "set_point":
            return low, high
        present = log(commanded)
        lowest = np.clip(present - step, low, high)
        highest = np.clip(present + step, low, high)
        return lowest, highest


class Worth(NamedTuple):
    """Prices of time and life."""

    time: float  # of a second [s]: 1, or what a second can earn if time is limited
    life: Array  # p(D), of a whole life [s], at each of ``USED_LIVES``


@lru_cache(maxsize=1024)
def worth(scenario: Scenario) -> Worth:
    """Return the prices of time and life by the scenario's own laws.

    The array is cached, do not write to it.
    """
    optimiser = Optimiser(scenario, len(USED_LIVES), severity=1.0, caution=1.0)
    prices = optimiser.prices(USED_LIVES)
    return Worth(time=float(prices["time"][0]), life=prices["life"].copy())


def column(value: Any) -> Any:
    """Return a number, or one for each environment, as a column, shape (1 or num_envs, 1)."""
    return np.reshape(value, (-1, 1))


def plays(scenario: Scenario) -> bool:
    """Return whether an action sets speed and feed, and force and power are measured."""
    return sets_speed_and_feed(scenario) and scenario.sensors.force == "dynamometer"


def optimising(description: str, optimiser: Callable[..., Optimiser], version: int) -> Rule:
    """Return the rule of an optimiser, whose arguments are those of ``Optimiser``."""
    return Rule(
        description,
        optimiser,
        plays=plays,
        parameters={
            "severity": TuningRange(0.5, 4.0, logarithmic=True),
            "caution": TuningRange(0.5, 2.0, logarithmic=True),
        },
        version=version,
        changes_edges=True,
        together=True,
        tuned_on="rough_turning",
    )


DESCRIPTION = (
    "the best expected net gain of each step, on a Kalman filter's estimates "
    "and a price of life by dynamic programming"
)
RULES = {"optimiser": optimising(DESCRIPTION, Optimiser, version=6)}
