"""The grid search of Alaskari and Oraby (2018), as published and on models rescaled online.

Each step tries all pairs of a grid of cutting speeds and feeds on the nominal models of wear, thrust force and power. It commands
the pair with the highest removal rate among those that keep force, power and wear within their limits at the end of the step. The
paper's grid has 16 speeds times 109 feeds: 1744 pairs. Its simulation ends at the first step without a feasible pair. Here, the
search goes on. Once the nominal edge is worn out, wear is no constraint. If no pair keeps force and power within their limits, it
commands the pair with the least force.

It needs of the nominal model: the laws of wear, force and power, base speed and idle torque.
"""

from typing import Any

import numpy as np

from baselines.models.process import Scales
from baselines.rule import Array, Mask, Range, Rule
from turning_env import Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.numerics.functions import real_power
from turning_env.physics.machinability import force_and_power, log_wear_coefficient
from turning_env.physics.records import parameter_records
from turning_env.physics.spindle import capacity, idle_power
from turning_env.physics.wear import advance_used_life, log_wear
from turning_env.scoring.policy import Actions, Observations, Policy

CUTTING_SPEED_STEP = 10.0  # the paper's grid [m/min]
FEED_STEP = 0.005  # likewise [mm/rev]


def grid(scenario: Scenario) -> list[Array]:
    """Return the grid's cutting speeds [m/min] and feeds [mm/rev] within the machine's ranges, ascending."""
    speeds = scenario.machine.cutting_speed_min, scenario.cutting_speed_max, CUTTING_SPEED_STEP
    feeds = scenario.machine.feed_min, scenario.machine.feed_max, FEED_STEP
    return [
        low + step * np.arange(int((high - low) / step + 1e-9) + 1.0)
        for low, high, step in (speeds, feeds)
    ]


@compiled
def predict(parameters, speed, feed, used_life, start, end):
    """Return the nominal (used life [-], thrust force [N], power [kW]) after cutting from ``start`` to ``end`` [min]."""
    log_speed, log_feed, log_depth = np.log(speed), np.log(feed), parameters.log_depth_of_cut[0]
    log_coefficient = log_wear_coefficient(parameters, 0, log_speed, log_feed, log_depth, 0.0)
    used_life = advance_used_life(parameters, 0, used_life, log_coefficient, start, end)
    force, power = force_and_power(
        parameters, 0, log_speed, log_feed, log_depth, log_wear(parameters, 0, used_life), 0.0
    )
    return used_life, force, power + idle_power(parameters, 0, speed)


@compiled
def highest_feed(
    parameters, speed, feeds, used_life, start, end, force_limit, power_limit, used_life_limit
):
    """Return the index of the highest feasible feed at a speed, or -1, by bisection: force, power and wear grow with feed."""
    power_limit *= capacity(parameters, 0, speed)
    feasible, infeasible = -1, len(feeds)
    while infeasible - feasible > 1:
        index = (feasible + infeasible) // 2
        life, force, power = predict(parameters, speed, feeds[index], used_life, start, end)
        if force <= force_limit and power <= power_limit and life <= used_life_limit:
            feasible = index
        else:
            infeasible = index
    return feasible


@compiled
def best_pair(
    parameters, speeds, feeds, used_life, start, end, force_limit, power_limit, used_life_limit
):
    """Return the indices (speed, feed) of the feasible pair with the highest removal rate and lowest speed; (-1, -1) if none."""
    best_speed, best_feed, best_rate = -1, -1, 0.0
    for index in range(len(speeds)):
        feed = highest_feed(
            parameters,
            speeds[index],
            feeds,
            used_life,
            start,
            end,
            force_limit,
            power_limit,
            used_life_limit,
        )
        if feed >= 0 and speeds[index] * feeds[feed] > best_rate:
            best_speed, best_feed, best_rate = index, feed, speeds[index] * feeds[feed]
    return best_speed, best_feed


@compiled_entry
def search(parameters, speeds, feeds, used_lives, times, interval, limits, chosen):
    """Fill ``chosen``, shape (num_envs, 2), with speeds [m/min] and feeds [mm/rev]; ``limits``: of force [N] and power [kW]."""
    p = parameters[0]
    for i in range(len(used_lives)):
        start, end, force_limit, power_limit = (
            times[i],
            times[i] + interval,
            limits[0, i],
            limits[1, i],
        )
        speed, feed = best_pair(
            p, speeds, feeds, used_lives[i], start, end, force_limit, power_limit, 1.0
        )
        if speed < 0:
            speed, feed = best_pair(
                p, speeds, feeds, used_lives[i], start, end, force_limit, power_limit, np.inf
            )
        if speed < 0:
            speed, feed = len(speeds) - 1, 0
        chosen[i, 0], chosen[i, 1] = speeds[speed], feeds[feed]


class GridSearch(Policy):
    """The grid search on nominal models, with nominal depth and hardness; without its last arguments the paper's controller.

    ``margin``: factor on the limits of force and power [-]; ``smoothing``: weight of the newest ratio of measured to predicted in
    their scales [-]. No response may fall with feed, because of the bisection.
    """

    def __init__(
        self, scenario: Scenario, num_envs: int, margin: float = 1.0, smoothing: float = 0.0
    ) -> None:
        self._scenario, self._scales = scenario, Scales(num_envs, smoothing)
        self._parameters: Any = parameter_records(scenario)
        self._speeds, self._feeds = grid(scenario)
        self._limits = margin * np.array([[scenario.limits.thrust_force], [scenario.limits.power]])

    def reset(self, mask: Mask) -> None:
        self._scales.reset(mask)

    def act(self, observations: Observations) -> Actions:
        scenario, reading = self._scenario, read(observations, self._scenario)
        measured = reading.cutting & (reading.power_ratio > 0)
        limits = self._limits / self._scales.follow(
            measured, reading.force_ratio, reading.power_ratio
        )
        used_life = real_power(
            reading.nominal_wear / scenario.tool.wear_criterion, 1.0 / scenario.material.wear.time
        )
        times, chosen = (
            (reading.cutting_time, scenario.control.interval / 60.0),
            np.empty((len(observations), 2)),
        )
        search(self._parameters, self._speeds, self._feeds, used_life, *times, limits, chosen)
        return towards(reading, scenario, chosen[:, 0], chosen[:, 1])


def _plays(scenario: Scenario) -> bool:
    return sets_speed_and_feed(scenario) and all(law.feed >= 0 for _, law in scenario.material)


RULES = {
    "grid_search": Rule(
        "the grid search of Alaskari and Oraby (2018) on nominal models", GridSearch, _plays, {}
    ),
    "rescaled_grid_search": Rule(
        "this project's own rescaling of the grid search: models scaled by measured force and power, with a margin, both tuned",
        GridSearch,
        _plays,
        {"margin": Range(0.80, 1.05), "smoothing": Range(0.05, 1.0)},
        worth_tuning=True,
    ),
}
