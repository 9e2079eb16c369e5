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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.models.edge_value import USED_LIVES, worth
from baselines.models.feed_search import POINT, search
from baselines.models.load_filter import Array, LoadFilter, Outlook, decay, feed_velocity, records
from baselines.rule import Range, Rule
from turning_env import PowerLaw, Reading, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.numerics.functions import exp, hypotenuse, log, real_power
from turning_env.physics.spindle import idle_power_at
from turning_env.scenario.plan import columns_of
from turning_env.scoring.policy import Actions, Observations

POINTS = 3
"""Points of a step at which loads are predicted."""
LEAD = 2.0
"""Steps before its end at which an edge is changed, as it may wear faster than expected [-]."""
MIN_SPREAD = 1e-3
"""Least standard deviation of log force and log power [-]; it keeps expectations smooth if nothing varies."""
MIN_USED_LIFE = 1e-9
"""Used share of life of an edge that has not cut [-]: the laws are undefined without wear."""


class Prospect(NamedTuple):
    """The terms of the gain. A field has shape (num_envs,), from ``log_force`` on (num_envs, points ahead of the tool)."""

    log_speed: Array
    """Actual cutting speed [log m/min]."""
    log_feed: Array
    """Actual feed [log mm/rev]."""
    used_life: Array
    """Used share of the edge's life by the nominal model [-]."""
    breakage_price: Array
    """Cost of breaking the edge [s]."""
    log_force: Array
    """Log ratio of thrust force to the nominal model at nominal wear [-]."""
    log_power: Array
    """Log ratio of power to the nominal model at nominal wear [-]."""
    force_spread: Array
    """Standard deviation of log force in the price of overload [-]."""
    power_spread: Array
    """Standard deviation of log power in the price of overload [-]."""
    strength_spread: Array
    """Standard deviation of log(force / strength of the edge) [-]."""
    metal_value: Array
    """Value of metal over cutting speed and feed [per m/min and mm/rev]."""
    life_price: Array
    """Price of a life [s] that is used at the rate of nominal depth and hardness."""
    cutting: Array
    """1 in metal, 0 in air."""
    unmeasured: Array
    """1 in metal of a bar that has not been measured, else 0."""


class Optimiser:
    """A policy that maximises the expected gain of each step alone.

    Args:
        scenario: task, or one for each environment, which all have the same actions and sensors.
        num_envs: number of environments.
        severity: factor on the price of overload [-].
        caution: factor on the standard deviations of force and power [-].
    """

    wear_caution = 1.0
    """Factor on the standard deviation of the wear at which an edge may soon be worn out [-]."""

    def __init__(self, scenario: Scenario | Sequence[Scenario], num_envs: int, severity: float, caution: float) -> None:
        scenarios = [scenario] if isinstance(scenario, Scenario) else list(scenario)
        self._scenario: Any = scenarios[0] if len(scenarios) == 1 else columns_of(scenarios)
        self._scenarios, self._severity, self._caution = scenarios, severity, caution
        self._parameters = np.concatenate([parameter_record(each, severity) for each in scenarios])
        self._filter = self._new_filter(num_envs)
        self._look_at(self._scenario.control.interval * (np.arange(POINTS) + 0.5) / POINTS)

    def _new_filter(self, num_envs: int) -> LoadFilter:
        return LoadFilter(self._scenarios, num_envs)

    @cached_property
    def _prices(self) -> Array:
        """Price of a whole life [s], shape (scenarios, used lives)."""
        return np.array([worth(each, self._severity * each.economics.overload_price).life for each in self._scenarios])

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the estimates."""
        self._filter.reset(mask)

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, action size), for observations, shape (num_envs, entries)."""
        reading = read(observations, self._scenario)
        self._filter.observe(reading)
        nominal, expected = self._used_lives(reading)
        price = self._price(expected)
        best = self._best(reading, self._prospect(reading, nominal, price, *self._ahead(reading)))
        return towards(reading, self._scenario, *best, self._spent(reading, expected, price))

    def _used_lives(self, reading: Reading) -> tuple[Array, Array]:
        """Return the used share of the edge's life [-] by the nominal model and by the filter."""
        exponent = self._scenario.material.wear.time
        nominal = real_power(reading.nominal_wear / self._scenario.tool.wear_criterion, 1.0 / exponent)
        nominal = np.maximum(nominal, MIN_USED_LIFE)
        return nominal, nominal * exp(self._filter.log_wear_factor / exponent)

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
        over = soon * exp(self.wear_caution * self._filter.wear_deviation / exponent) >= 1.0
        spent: NDArray[np.bool_] = (reading.nominal_wear > 0.0) & (over | (price <= 0.0))
        return spent

    def _look_at(self, times: Array) -> None:
        """Predict at these times after a step's start [s], shape (points,), or (num_envs, points) if they differ."""
        machine, self._times = self._scenario.machine, np.atleast_2d(times)
        lags = column(machine.spindle_time_constant), column(machine.feed_time_constant)
        deviations = np.broadcast_arrays(self._times, *(decay(self._times, lag) for lag in lags))
        self._left = np.stack(deviations, axis=1)

    def _ahead(self, reading: Reading) -> tuple[Outlook, Array, Array]:
        """Return the outlook, and 1 in metal and 1 in an unmeasured bar, else 0, each of shape (num_envs, points)."""
        velocity = feed_velocity(self._scenario, reading.commanded_cutting_speed, reading.commanded_feed)
        distance = velocity[:, np.newaxis] * self._times
        outlook = self._filter.outlook(distance, distance < 0.0)
        cutting = np.ones(outlook.log_force.shape)
        return outlook, cutting, cutting - self._filter.memory["measured"][:, np.newaxis]

    def _prospect(
        self, reading: Reading, used_life: Array, price: Array, outlook: Outlook, cutting: Array, unmeasured: Array
    ) -> Prospect:
        """Return the prospect at a nominal used life [-] and a price of life [s], shape (num_envs,)."""
        economics, tool, law = self._scenario.economics, self._scenario.tool, self._scenario.material.wear
        nominal_depth = column(self._scenario.workpiece.depth_of_cut)
        deeper, harder = log(outlook.depth_of_cut / nominal_depth), outlook.log_hardness
        wear = column(law.depth_of_cut) * deeper + column(law.hardness) * harder
        left = np.maximum(1.0 - used_life, 0.0)
        # Air costs only time: crossing it is worth the metal that could be cut instead.
        depth = np.where(cutting > 0, outlook.depth_of_cut, nominal_depth)
        return Prospect(
            log_speed=log(reading.cutting_speed),
            log_feed=log(reading.feed),
            used_life=used_life,
            breakage_price=60.0 * (left * (economics.edge_cost + economics.edge_change_time) + economics.breakage_downtime),
            log_force=outlook.log_force,
            log_power=outlook.log_power,
            force_spread=np.maximum(self._caution * outlook.force_spread, MIN_SPREAD),
            power_spread=np.maximum(self._caution * outlook.power_spread, MIN_SPREAD),
            strength_spread=np.maximum(hypotenuse(outlook.force_spread, column(tool.edge_strength_spread)), MIN_SPREAD),
            metal_value=depth / column(economics.reference_removal_rate),
            life_price=price[:, np.newaxis] * exp(wear / column(law.time)),
            cutting=cutting,
            unmeasured=unmeasured,
        )

    def _best(self, reading: Reading, prospect: Prospect) -> tuple[Array, Array]:
        """Return the cutting speed [m/min] and feed [mm/rev] within reach with the greatest gain."""
        exponents = np.broadcast_to(self._filter.exponents.reshape(-1, 6), (len(reading.feed), 6))
        speeds = self._scenario.machine.cutting_speed_min, self._scenario.cutting_speed_max
        slowest, fastest = self._reach(reading.commanded_cutting_speed, speeds, "cutting_speed")
        lowest, highest = self._reach(reading.commanded_feed, self._scenario.feed_range, "feed")
        known = prospect[: -len(POINT)]
        life = (np.broadcast_to(each, len(reading.feed)) for each in self._life_rate())
        environments = np.stack([slowest, fastest, lowest, highest, *known, *life, *exponents.T], axis=1)
        points = np.stack(prospect[-len(POINT) :], axis=1)
        found = np.empty((len(points), 2))
        search(self._parameters, self._left, environments, points, found)
        return exp(found[:, 0]), exp(found[:, 1])

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


def parameter_record(scenario: Scenario, severity: float) -> Any:
    """Return the parameters of ``search`` for a scenario, an array of one record."""
    material, limits, tool = scenario.material, scenario.limits, scenario.tool
    wear, wear_speed, wear_feed = log_law(material.wear, scenario, tool.wear_criterion)
    time = material.wear.time
    parameters: dict[str, Any] = {
        "life": (wear / time - log(60.0), wear_speed / time, wear_feed / time),  # of the log used life [1/s]
        "force": log_law(material.thrust_force, scenario, limits.thrust_force)[0],
        "power": log_law(material.power, scenario, limits.power)[0],
        "wear_time": time,
        "log_base_speed": log(scenario.base_cutting_speed or 1e-9),
        "log_strength": float(log(tool.edge_strength / limits.thrust_force)),
        "overload_price": severity * scenario.economics.overload_price,
        "interval": scenario.control.interval,
        "slowest": log(scenario.machine.cutting_speed_min),
        "fastest": log(scenario.cutting_speed_max),
        "lowest": log(scenario.feed_range[0]),
        "highest": log(scenario.feed_range[1]),
        "metal": scenario.workpiece.depth_of_cut / scenario.economics.reference_removal_rate,
        "idle": idle_power_at(scenario, 1.0) / scenario.limits.power,
        "edge_cost": 60.0 * scenario.economics.edge_cost,
        "edge_change_time": 60.0 * scenario.economics.edge_change_time,
    }
    return records([parameters])


def log_law(law: PowerLaw, scenario: Scenario, limit: float) -> tuple[float, float, float]:
    """Return log(response / limit) at 1 m/min, 1 mm/rev, nominal depth and the wear criterion, and exponents of the first two."""
    at_one = law(1.0, 1.0, scenario.workpiece.depth_of_cut, wear=scenario.tool.wear_criterion)
    return float(log(at_one / limit)), law.cutting_speed, law.feed


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
        together=True,
        tuned_on="rough_turning",
    )


DESCRIPTION = "the best expected net gain of each step, on a Kalman filter's estimates and a price of life by dynamic programming"
RULES = {"optimiser": optimising(DESCRIPTION, Optimiser, version=4)}
