"""The grid search of Alaskari and Oraby (2018), as published and on models rescaled online.

Each step tries all pairs of a grid of cutting speeds and feeds on the nominal models of wear,
thrust force and power. It commands the pair with the highest removal rate among those that keep
force, power and wear within their limits at the end of the step. The paper's grid has 16 speeds
times 109 feeds: 1744 pairs. Its simulation ends at the first step without a feasible pair. Here,
the search goes on. Once the nominal edge is worn out, wear is no constraint. If no pair keeps force
and power within their limits, it commands the pair with the least force.

Uses from the nominal model: the laws of wear, force and power, base speed and idle torque.
"""

from typing import Any, NamedTuple

import numpy as np

from baselines.models.process import Scales
from baselines.rule import Array, Mask, Rule, TuningRange
from turning_env import Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.numerics.functions import log
from turning_env.physics.machinability import loads_with_fresh_share, log_wear_coefficient
from turning_env.physics.records import parameter_records
from turning_env.physics.spindle import capacity, idle_power
from turning_env.physics.wear import advance_used_life, log_wear
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.laws import used_life_at

CUTTING_SPEED_STEP = 10.0  # the paper's grid [m/min]
FEED_STEP = 0.005  # the paper's grid [mm/rev]

STATE = np.dtype(
    (
        np.record,
        [
            ("used_life", np.float64),  # of the edge [-]
            ("start", np.float64),  # cutting time of the edge at the start of the step [min]
            ("force_limit", np.float64),  # [N]
            ("power_limit", np.float64),  # [kW]
        ],
    )
)
"""The state of an environment in which the search begins."""

PAIR = np.dtype((np.record, [("cutting_speed", np.float64), ("feed", np.float64)]))
"""A pair of the grid [m/min], [mm/rev]."""


class Grid(NamedTuple):
    """The values that are combined, in ascending order."""

    speeds: Array  # [m/min]
    feeds: Array  # [mm/rev]


class StepLimits(NamedTuple):
    """Limits at the end of a step."""

    force: float  # [N]
    power: float  # from the base speed on [kW]
    used_life: float  # [-]


class Pair(NamedTuple):
    """Places of a cutting speed and a feed in the grid; both are -1 if no pair is feasible."""

    speed: int
    feed: int


def grid(scenario: Scenario) -> Grid:
    """Return the paper's grid within the machine's ranges."""
    machine = scenario.machine
    return Grid(
        speeds=_steps(machine.cutting_speed_min, scenario.cutting_speed_max, CUTTING_SPEED_STEP),
        feeds=_steps(machine.feed_min, machine.feed_max, FEED_STEP),
    )


def _steps(low: float, high: float, step: float) -> Array:
    """Return values from ``low`` up to ``high``, which is one of them if it is a whole step."""
    # Rounding must not make a whole number of steps a smaller one.
    return low + step * np.arange(int((high - low) / step + 1e-9) + 1.0)


@compiled
def predict(parameters, speed, feed, used_life, start, end):
    """Return the nominal response to cutting from ``start`` to ``end`` [min].

    It is a tuple of used life [-], thrust force [N] and power [kW] at the end.
    """
    log_speed = log(speed)
    log_feed = log(feed)
    log_depth = parameters.log_depth_of_cut[0]
    log_coefficient = log_wear_coefficient(parameters, 0, log_speed, log_feed, log_depth, 0.0)
    used_life = advance_used_life(parameters, 0, used_life, log_coefficient, start, end)
    wear = log_wear(parameters, 0, used_life)
    force, power = loads_with_fresh_share(parameters, 0, log_speed, log_feed, log_depth, wear, 0.0)
    return used_life, force, power + idle_power(parameters, 0, speed)


@compiled
def highest_feed(parameters, speed, feeds, used_life, start, end, limits):
    """Return the index of the highest feasible feed at a ``speed`` [m/min], or -1 if none is.

    ``feeds`` [mm/rev] are ascending. Other arguments are those of ``best_pair``. Bisection finds
    the feed, because force, power and wear grow with it.
    """
    power_limit = limits.power * capacity(parameters, 0, speed)
    feasible = -1
    infeasible = len(feeds)
    while infeasible - feasible > 1:
        index = (feasible + infeasible) // 2
        life, force, power = predict(parameters, speed, feeds[index], used_life, start, end)
        if force <= limits.force and power <= power_limit and life <= limits.used_life:
            feasible = index
        else:
            infeasible = index
    return feasible


@compiled
def best_pair(parameters, speeds, feeds, used_life, start, end, limits):
    """Return the feasible ``Pair`` with the highest removal rate; of equals, the slowest.

    The grid has ``speeds`` [m/min] and ``feeds`` [mm/rev], both ascending. ``used_life`` [-] is
    that at the cutting time ``start`` [min]; the ``limits`` hold at ``end`` [min].
    """
    best = Pair(-1, -1)
    best_rate = 0.0
    for index in range(len(speeds)):
        speed = speeds[index]
        feed = highest_feed(parameters, speed, feeds, used_life, start, end, limits)
        if feed >= 0 and speed * feeds[feed] > best_rate:
            best = Pair(index, feed)
            best_rate = speed * feeds[feed]
    return best


@compiled_entry
def search(parameters, speeds, feeds, interval, states, chosen):
    """Fill in the best pairs.

    Args:
        parameters: records of the environment's parameters.
        speeds: cutting speeds of the grid [m/min].
        feeds: feeds of the grid [mm/rev].
        interval: control interval [min].
        states: records of ``STATE``, shape (num_envs,).
        chosen: records of ``PAIR``, shape (num_envs,), which are overwritten.
    """
    p = parameters[0]
    for i in range(len(states)):
        state = states[i]
        start = state.start
        end = state.start + interval
        limits = StepLimits(state.force_limit, state.power_limit, used_life=1.0)
        best = best_pair(p, speeds, feeds, state.used_life, start, end, limits)
        if best.speed < 0:  # the nominal edge is worn out
            limits = StepLimits(state.force_limit, state.power_limit, used_life=np.inf)
            best = best_pair(p, speeds, feeds, state.used_life, start, end, limits)
        if best.speed < 0:
            best = Pair(len(speeds) - 1, 0)
        chosen[i].cutting_speed = speeds[best.speed]
        chosen[i].feed = feeds[best.feed]


class GridSearch(Policy):
    """The grid search on nominal models, with nominal depth and hardness.

    Without its last arguments, it is the paper's controller. No response may fall with feed,
    because of the bisection.

    Args:
        scenario: nominal model.
        num_envs: number of environments.
        margin: factor on the limits of force and power [-].
        smoothing: weight of the newest ratio of measured to predicted values in their scales [-].
    """

    def __init__(
        self, scenario: Scenario, num_envs: int, margin: float = 1.0, smoothing: float = 0.0
    ) -> None:
        self._scenario = scenario
        self._scales = Scales(num_envs, smoothing)
        self._parameters: Any = parameter_records(scenario)
        self._grid = grid(scenario)
        self._force_limit = margin * scenario.limits.thrust_force
        self._power_limit = margin * scenario.limits.power

    def reset(self, mask: Mask) -> None:
        self._scales.reset(mask)

    def act(self, observations: Observations) -> Actions:
        num_envs = len(observations)
        scenario = self._scenario
        reading = read(observations, scenario)
        measured = reading.cutting & (reading.power_ratio > 0)
        force_scale, power_scale = self._scales.follow(
            measured, force_ratio=reading.force_ratio, power_ratio=reading.power_ratio
        )
        states = np.empty(num_envs, STATE)
        states["used_life"] = used_life_at(scenario, reading.nominal_wear)
        states["start"] = reading.cutting_time
        states["force_limit"] = self._force_limit / force_scale
        states["power_limit"] = self._power_limit / power_scale
        chosen = np.empty(num_envs, PAIR)
        interval = scenario.control.interval / 60.0
        search(self._parameters, *self._grid, interval, states, chosen)
        return towards(reading, scenario, chosen["cutting_speed"], chosen["feed"])


def _plays(scenario: Scenario) -> bool:
    return sets_speed_and_feed(scenario) and all(law.feed >= 0 for _, law in scenario.material)


RULES = {
    "grid_search": Rule(
        "the grid search of Alaskari and Oraby (2018) on nominal models",
        GridSearch,
        plays=_plays,
        parameters={},
        published=True,
    ),
    "rescaled_grid_search": Rule(
        "this project's own rescaling of the grid search: models scaled by measured force and "
        "power, with a margin, both tuned",
        GridSearch,
        plays=_plays,
        parameters={"margin": TuningRange(0.80, 1.05), "smoothing": TuningRange(0.05, 1.0)},
        worth_tuning=True,
    ),
}
