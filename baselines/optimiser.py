"""An optimiser of one step, on a Kalman filter's estimates of the hidden state.

In every step it chooses the cutting speed and feed within reach with the greatest expected gain (``models/feed_search.py``):

    value of metal - price of the life used - price of overload - price of breakage

Force and power are log-normal with the filter's means and variances. So the expected excess over a limit has a closed form (the
price of an option, Black and Scholes 1973). So does the risk that an unmeasured bar breaks the edge. The price of the edge's
life comes from dynamic programming (``models/edge_value.py``).

It needs of the nominal model: the laws of wear, force and power, prices, the spreads of depth, hardness, wear factor and
strength, and the lags and noise of drives and sensors.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from baselines.models import feed_search
from baselines.models.edge_value import PRICED_SPREAD, numbers, price_life
from baselines.models.kalman_steps import decay
from baselines.models.load_filter import LoadFilter, Outlook, records
from baselines.rule import Array, Mask, Range, Rule, Scenarios
from turning_env import Reading, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.numerics.functions import exp, hypotenuse, log, real_power
from turning_env.scenario.scenario_batch import ScenarioBatch
from turning_env.scoring.policy import Actions, Observations, Policy

USED_LIVES = np.linspace(0.0, 1.0, 41)[
    1:
]  # shares of the life [-] at which ``worth`` tabulates its price
POINTS = 3  # points of a step at which loads are predicted
LEAD = (
    2.0  # steps before its end at which an edge is changed, as it may wear faster than expected [-]
)
MIN_SPREAD = 1e-3  # least standard deviation of log force and log power [-]; it keeps expectations smooth if nothing varies
MIN_USED_LIFE = (
    1e-9  # used share of life of an edge that has not cut [-]: the laws are undefined without wear
)


class Optimiser(Policy):
    """A policy that maximises the expected gain of each step alone. All scenarios have the same actions and sensors.

    ``severity``: factor on the price of overload [-]; ``caution``: on the standard deviations of force and power;
    ``wear_caution``: on that of the wear at which an edge may soon be worn out; ``errors``: ``LawErrors`` to expect, or None.
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
        self._scenario: Any = scenarios[0] if len(scenarios) == 1 else ScenarioBatch.of(scenarios)
        self._scenarios, self._severity, self._caution, self._wear_caution = (
            scenarios,
            severity,
            caution,
            wear_caution,
        )
        self._parameters = records([numbers(each, severity) for each in scenarios])
        self._filter = LoadFilter(scenarios, num_envs, errors)
        self._times, machine = self._look_at(), self._scenario.machine
        lags = column(machine.spindle_time_constant), column(machine.feed_time_constant)
        self._left = np.stack(
            np.broadcast_arrays(
                self._times, *(np.vectorize(decay)(self._times, lag) for lag in lags)
            ),
            axis=1,
        )

    def reset(self, mask: Mask) -> None:
        self._filter.reset(mask)

    def act(self, observations: Observations) -> Actions:
        reading, scenario = read(observations, self._scenario), self._scenario
        self._observe(reading)
        exponent = scenario.material.wear.time
        nominal = np.maximum(
            real_power(reading.nominal_wear / scenario.tool.wear_criterion, 1.0 / exponent),
            MIN_USED_LIFE,
        )
        expected = nominal * exp(self._filter.log_wear_factor / exponent)
        price = self.prices(expected)[:, 1]
        return towards(
            reading,
            scenario,
            *self._best(reading, nominal, price),
            self._spent(reading, expected, price),
        )

    def _observe(self, reading: Reading) -> None:
        self._filter.observe(reading)

    def prices(self, used_life: Array) -> Array:
        """Return the prices of time and life [s] at used shares, shape (num_envs, 2), by the laws as the filter knows them."""
        laws, exponents, errors = (
            self._life_rate(),
            self._filter.exponents.T,
            self._filter.load_errors,
        )
        spreads = self._priced_spread * self._parameters["spreads"].T
        for law, name in enumerate(("force", "power")):
            speed, feed, wear = exponents[:, law]
            laws += [
                self._parameters[name] + spreads[law] + errors[law],
                speed,
                feed,
                self._parameters["wear_time"] * wear,
            ]
        found = np.empty((len(used_life), 2))
        price_life(self._parameters, np.stack(np.broadcast_arrays(*laws), axis=1), used_life, found)
        return found

    def _spent(self, reading: Reading, used_life: Array, price: Array) -> Mask:
        """Return whether to change the edge: its life has no price left, or may soon be over."""
        exponent, (log_rate, speed, feed) = (
            self._scenario.material.wear.time,
            self._parameters["life"].T,
        )
        log_rate = log_rate + speed * log(reading.cutting_speed) + feed * log(reading.feed)
        rate = exp(log_rate + self._filter.log_wear_factor / exponent)  # [1/s]
        soon = used_life + rate * LEAD * self._scenario.control.interval
        over = soon * exp(self._wear_caution * self._filter.wear_deviation / exponent) >= 1.0
        return np.asarray((reading.nominal_wear > 0.0) & (over | (price <= 0.0)))

    def _look_at(self) -> Array:
        """Return the times after a step's start at which loads are predicted [s], shape (1 or num_envs, points)."""
        return np.asarray(
            column(self._scenario.control.interval) * (np.arange(POINTS) + 0.5) / POINTS
        )

    def _ahead(self, reading: Reading) -> tuple[Outlook, Array, Array]:
        """Return the outlook, and 1 in metal and 1 in an unmeasured bar, else 0, each of shape (num_envs, points)."""
        velocity = (
            reading.commanded_cutting_speed
            * reading.commanded_feed
            * self._filter.parameters["velocity"]
        )
        distance = velocity[:, np.newaxis] * self._times
        cutting, enters = (
            np.ones(distance.shape),
            np.zeros(distance.shape, np.bool_),
        )  # as if the tool stayed in this bar
        return (
            self._filter.outlook(distance, enters),
            cutting,
            cutting - column(self._filter.memory["measured"]),
        )

    def _best(self, reading: Reading, used_life: Array, price: Array) -> tuple[Array, Array]:
        """Return the best speed [m/min] and feed [mm/rev] within reach, for nominal used lives and prices of life [s]."""
        scenario, economics, law = (
            self._scenario,
            self._scenario.economics,
            self._scenario.material.wear,
        )
        outlook, cutting, unmeasured = self._ahead(reading)
        nominal_depth, left = (
            column(scenario.workpiece.depth_of_cut),
            np.maximum(1.0 - used_life, 0.0),
        )
        wear = (
            column(law.depth_of_cut) * log(outlook.depth_of_cut / nominal_depth)
            + column(law.hardness) * outlook.log_hardness
        )
        # Air costs only time: crossing it is worth the metal that could be cut instead.
        depth = np.where(cutting > 0, outlook.depth_of_cut, nominal_depth)
        strength_spread = hypotenuse(
            outlook.force_spread, column(scenario.tool.edge_strength_spread)
        )
        points = (  # in the order of their names in feed_search
            *(outlook.log_force, outlook.log_power),
            *(
                np.maximum(self._caution * spread, MIN_SPREAD)
                for spread in (outlook.force_spread, outlook.power_spread)
            ),
            *(
                np.maximum(strength_spread, MIN_SPREAD),
                depth / column(economics.reference_removal_rate),
            ),
            *(column(price) * exp(wear / column(law.time)), cutting, unmeasured),
        )
        speeds = scenario.machine.cutting_speed_min, self._fastest(used_life)
        breakage = 60.0 * (
            left * (economics.edge_cost + economics.edge_change_time) + economics.breakage_downtime
        )
        environments = (  # likewise
            *self._reach(reading.commanded_cutting_speed, speeds, "cutting_speed"),
            *self._reach(reading.commanded_feed, scenario.feed_range, "feed"),
            *(log(reading.cutting_speed), log(reading.feed), used_life, breakage),
            *(*self._life_rate(), *self._filter.exponents.reshape(-1, 6).T),
        )
        columns = (np.stack(np.broadcast_arrays(*rows), axis=1) for rows in (environments, points))
        found = np.empty((len(price), 2))
        feed_search.search(self._parameters, self._left, *columns, found)
        return exp(found[:, 0]), exp(found[:, 1])

    def _fastest(self, used_life: Array) -> Any:
        """Return the highest cutting speed to command [m/min] at used lives by the nominal model [-]."""
        return self._scenario.cutting_speed_max

    def _life_rate(self) -> list[Array]:
        """Return the log rate at which a usual edge's life is used at 1 m/min and 1 mm/rev [1/s], and its exponents of both."""
        return list(self._parameters["life"].T)

    def _reach(self, commanded: Array, ends: tuple[Any, Any], name: str) -> tuple[Array, Array]:
        """Return the logarithms of the lowest and the highest value, between two ends, that the next action can command."""
        least, most = (log(end) for end in ends)
        if self._scenario.control.action == "set_point":
            return least, most
        step = getattr(self._scenario.control, f"{name}_step")
        return np.clip(log(commanded) - step, least, most), np.clip(
            log(commanded) + step, least, most
        )


class Worth(NamedTuple):
    """Prices of time and life."""

    time: float  # of a second [s]: 1, or what a second can earn if time is limited
    life: Array  # p(D), of a whole life [s], at each of ``USED_LIVES``


@lru_cache(maxsize=1024)
def worth(scenario: Scenario) -> Worth:
    """Return the prices of time and life by the scenario's own laws; the array is cached."""
    times, lives = (
        Optimiser(scenario, len(USED_LIVES), severity=1.0, caution=1.0).prices(USED_LIVES).T
    )
    return Worth(float(times[0]), lives)


def column(value: Any) -> Any:
    """Return a number, or one for each environment, as a column beside points, shape (1 or num_envs, 1)."""
    return np.reshape(value, (-1, 1))


def plays(scenario: Scenario) -> bool:
    """Return whether an action sets speed and feed, and force and power are measured."""
    return sets_speed_and_feed(scenario) and scenario.sensors.force == "dynamometer"


def optimising(description: str, optimiser: Callable[..., Optimiser], version: int) -> Rule:
    """Return the rule of an optimiser, a function of scenario, number of environments, severity and caution."""
    return Rule(
        description,
        optimiser,
        plays,
        {
            "severity": Range(0.5, 4.0, logarithmic=True),
            "caution": Range(0.5, 2.0, logarithmic=True),
        },
        version=version,
        changes_edges=True,
        together=True,
        tuned_on="rough_turning",
    )


DESCRIPTION = "the best expected net gain of each step, on a Kalman filter's estimates and a price of life by dynamic programming"
RULES = {"optimiser": optimising(DESCRIPTION, Optimiser, version=6)}
