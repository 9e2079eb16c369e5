"""An optimiser of one step, on a Kalman filter's estimates of the hidden state.

In every step it chooses the cutting speed and feed within reach with the greatest expected gain:

    value of metal - price of the life used - price of overload - price of breakage

Force and power are log-normal with the filter's means and variances. So the expected excess over a limit has a closed form (the
price of an option, Black and Scholes 1973). So does the risk that an unmeasured bar breaks the edge. The price of the edge's
life comes from dynamic programming (``models/edge_value.py``).

``models/feed_search.py`` finds the best speed and feed.

It needs of the nominal model: the laws of wear, force and power, prices, the spreads of depth, hardness, wear
factor and strength, and the lags and noise of drives and sensors.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.models import feed_search
from baselines.models.edge_value import USED_LIVES, worth
from baselines.models.load_filter import Array, LawErrors, LoadFilter, Outlook, decay, feed_velocity, records
from baselines.rule import Range, Rule
from turning_env import PowerLaw, Reading, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.numerics.functions import exp, hypotenuse, log, real_power
from turning_env.physics.spindle import idle_power_at
from turning_env.scenario.plan import columns_of
from turning_env.scoring.policy import Actions, Observations, Policy

POINTS = 3
"""Points of a step at which loads are predicted."""
LEAD = 2.0
"""Steps before its end at which an edge is changed, as it may wear faster than expected [-]."""
MIN_SPREAD = 1e-3
"""Least standard deviation of log force and log power [-]; it keeps expectations smooth if nothing varies."""
MIN_USED_LIFE = 1e-9
"""Used share of life of an edge that has not cut [-]: the laws are undefined without wear."""


class Optimiser(Policy):
    """A policy that maximises the expected gain of each step alone.

    Args:
        scenario: task, or one for each environment, which all have the same actions and sensors.
        severity: factor on the price of overload [-].
        caution: factor on the standard deviations of force and power [-].
        wear_caution: factor on the standard deviation of the wear at which an edge may soon be worn out [-].
        errors: the errors that the nominal model is expected to have; None: it is right.
    """

    def __init__(
        self,
        scenario: Scenario | Sequence[Scenario],
        num_envs: int,
        severity: float,
        caution: float,
        wear_caution: float = 1.0,
        errors: LawErrors | None = None,
    ) -> None:
        scenarios = [scenario] if isinstance(scenario, Scenario) else list(scenario)
        self._scenario: Any = scenarios[0] if len(scenarios) == 1 else columns_of(scenarios)
        self._scenarios, self._severity, self._caution, self._wear_caution = scenarios, severity, caution, wear_caution
        self._parameters = records([numbers(each, severity) for each in scenarios])
        self._filter = LoadFilter(scenarios, num_envs, errors)
        self._times, machine = self._look_at(), self._scenario.machine
        lags = column(machine.spindle_time_constant), column(machine.feed_time_constant)
        self._left = np.stack(np.broadcast_arrays(self._times, *(decay(self._times, lag) for lag in lags)), axis=1)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._filter.reset(mask)

    def act(self, observations: Observations) -> Actions:
        reading, scenario = read(observations, self._scenario), self._scenario
        self._observe(reading)
        exponent = scenario.material.wear.time
        nominal = np.maximum(real_power(reading.nominal_wear / scenario.tool.wear_criterion, 1.0 / exponent), MIN_USED_LIFE)
        expected = nominal * exp(self._filter.log_wear_factor / exponent)
        price = self._price(expected)
        return towards(reading, scenario, *self._best(reading, nominal, price), self._spent(reading, expected, price))

    def _observe(self, reading: Reading) -> None:
        self._filter.observe(reading)

    @cached_property
    def _prices(self) -> Array:
        """Price of a whole life [s], shape (scenarios, used lives)."""
        return np.array([worth(each, self._severity * each.economics.overload_price).life for each in self._scenarios])

    def _price(self, used_life: Array) -> Array:
        """Return the price of a life [s] at used shares, shape (num_envs,)."""
        table = np.arange(len(used_life)) % len(self._prices)
        position = np.clip(used_life * len(USED_LIVES) - 1.0, 0.0, len(USED_LIVES) - 1.0)
        place = np.minimum(position.astype(np.int64), len(USED_LIVES) - 2)
        low, high = (self._prices[table, place + step] for step in (0, 1))
        return np.asarray(low + (position - place) * (high - low))

    def _spent(self, reading: Reading, used_life: Array, price: Array) -> NDArray[np.bool_]:
        """Return whether to change the edge: its life has no price left, or may soon be over."""
        exponent, (log_rate, speed, feed) = self._scenario.material.wear.time, self._parameters["life"].T
        log_rate = log_rate + speed * log(reading.cutting_speed) + feed * log(reading.feed)
        rate = exp(log_rate + self._filter.log_wear_factor / exponent)  # [1/s]
        soon = used_life + rate * LEAD * self._scenario.control.interval
        over = soon * exp(self._wear_caution * self._filter.wear_deviation / exponent) >= 1.0
        spent: NDArray[np.bool_] = (reading.nominal_wear > 0.0) & (over | (price <= 0.0))
        return spent

    def _look_at(self) -> Array:
        """Return the times after a step's start at which loads are predicted [s], shape (1 or num_envs, points)."""
        return np.asarray(column(self._scenario.control.interval) * (np.arange(POINTS) + 0.5) / POINTS)

    def _ahead(self, reading: Reading) -> tuple[Outlook, Array, Array]:
        """Return the outlook, and 1 in metal and 1 in an unmeasured bar, else 0, each of shape (num_envs, points)."""
        velocity = feed_velocity(self._scenario, reading.commanded_cutting_speed, reading.commanded_feed)
        distance = velocity[:, np.newaxis] * self._times
        cutting = np.ones(distance.shape)
        return self._filter.outlook(distance, distance < 0.0), cutting, cutting - column(self._filter.memory["measured"])

    def _best(self, reading: Reading, used_life: Array, price: Array) -> tuple[Array, Array]:
        """Return the cutting speed [m/min] and feed [mm/rev] within reach with the greatest gain.

        ``used_life``: by the nominal model [-]; ``price``: of a life [s]; shape (num_envs,).
        """
        scenario, economics, law = self._scenario, self._scenario.economics, self._scenario.material.wear
        outlook, cutting, unmeasured = self._ahead(reading)
        nominal_depth, left = column(scenario.workpiece.depth_of_cut), np.maximum(1.0 - used_life, 0.0)
        wear = column(law.depth_of_cut) * log(outlook.depth_of_cut / nominal_depth) + column(law.hardness) * outlook.log_hardness
        # Air costs only time: crossing it is worth the metal that could be cut instead.
        depth = np.where(cutting > 0, outlook.depth_of_cut, nominal_depth)
        strength_spread = hypotenuse(outlook.force_spread, column(scenario.tool.edge_strength_spread))
        points = np.empty((len(price), feed_search.POINT, cutting.shape[1]))
        points[:, feed_search.LOG_FORCE] = outlook.log_force
        points[:, feed_search.LOG_POWER] = outlook.log_power
        points[:, feed_search.FORCE_SPREAD] = np.maximum(self._caution * outlook.force_spread, MIN_SPREAD)
        points[:, feed_search.POWER_SPREAD] = np.maximum(self._caution * outlook.power_spread, MIN_SPREAD)
        points[:, feed_search.STRENGTH_SPREAD] = np.maximum(strength_spread, MIN_SPREAD)
        points[:, feed_search.METAL_VALUE] = depth / column(economics.reference_removal_rate)
        points[:, feed_search.LIFE_PRICE] = column(price) * exp(wear / column(law.time))
        points[:, feed_search.CUTTING] = cutting
        points[:, feed_search.UNMEASURED] = unmeasured
        speeds = scenario.machine.cutting_speed_min, self._fastest(used_life)
        environments = np.empty((len(price), feed_search.ENVIRONMENT))
        environments[:, : feed_search.LIFE_RATE] = np.stack(
            [
                *self._reach(reading.commanded_cutting_speed, speeds, "cutting_speed"),
                *self._reach(reading.commanded_feed, scenario.feed_range, "feed"),
                log(reading.cutting_speed),
                log(reading.feed),
                used_life,
                60.0 * (left * (economics.edge_cost + economics.edge_change_time) + economics.breakage_downtime),
            ],
            axis=1,
        )
        environments[:, feed_search.LIFE_RATE : feed_search.FORCE_SPEED] = np.transpose(self._life_rate())
        environments[:, feed_search.FORCE_SPEED :] = self._filter.exponents.reshape(-1, 6)
        found = np.empty((len(points), 2))
        feed_search.search(self._parameters, self._left, environments, points, found)
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
            return np.broadcast_to(least, commanded.shape), np.broadcast_to(most, commanded.shape)
        step = getattr(self._scenario.control, f"{name}_step")
        return np.clip(log(commanded) - step, least, most), np.clip(log(commanded) + step, least, most)


def column(value: Any) -> Any:
    """Return a number, or one for each environment, as a column beside points, shape (1 or num_envs, 1)."""
    return np.reshape(value, (-1, 1))


def numbers(scenario: Scenario, severity: float) -> dict[str, Any]:
    """Return what ``feed_search.py`` and ``edge_value.py`` must know of a scenario."""
    material, limits, tool, economics = scenario.material, scenario.limits, scenario.tool, scenario.economics

    def at_one(law: PowerLaw, limit: float) -> float:
        """Return log(response / limit) at 1 m/min, 1 mm/rev, nominal depth and the wear criterion."""
        return float(log(law(1.0, 1.0, scenario.workpiece.depth_of_cut, wear=tool.wear_criterion) / limit))

    wear = material.wear
    life = at_one(wear, tool.wear_criterion) / wear.time - log(60.0)
    return {
        "life": (life, wear.cutting_speed / wear.time, wear.feed / wear.time),  # of the log used life [1/s]
        "force": at_one(material.thrust_force, limits.thrust_force),
        "power": at_one(material.power, limits.power),
        "wear_time": wear.time,
        "log_base_speed": log(scenario.base_cutting_speed or 1e-9),
        "log_strength": float(log(tool.edge_strength / limits.thrust_force)),
        "overload_price": severity * economics.overload_price,
        "interval": scenario.control.interval,
        "slowest": log(scenario.machine.cutting_speed_min),
        "fastest": log(scenario.cutting_speed_max),
        "lowest": log(scenario.feed_range[0]),
        "highest": log(scenario.feed_range[1]),
        "metal": scenario.workpiece.depth_of_cut / economics.reference_removal_rate,
        "idle": idle_power_at(scenario, 1.0) / limits.power,
        "edge_cost": 60.0 * economics.edge_cost,
        "edge_change_time": 60.0 * economics.edge_change_time,
    }


def plays(scenario: Scenario) -> bool:
    """Return whether an action sets speed and feed, and force and power are measured."""
    return sets_speed_and_feed(scenario) and scenario.sensors.force == "dynamometer"


def optimising(description: str, optimiser: Callable[..., Optimiser], version: int) -> Rule:
    """Return the rule of an optimiser, a function of scenario, number of environments, severity and caution."""
    return Rule(
        description,
        optimiser,
        plays,
        {"severity": Range(0.5, 4.0, logarithmic=True), "caution": Range(0.5, 2.0, logarithmic=True)},
        version=version,
        changes_edges=True,
        together=True,
        tuned_on="rough_turning",
    )


DESCRIPTION = "the best expected net gain of each step, on a Kalman filter's estimates and a price of life by dynamic programming"
RULES = {"optimiser": optimising(DESCRIPTION, Optimiser, version=5)}
