"""The search finds the set point with the greatest gain within reach."""

from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from baselines.models import edge_value
from baselines.models.feed_search import (
    ENVIRONMENT,
    MOMENT,
    POINT,
    SET_POINT,
    search,
    try_set_point,
)
from baselines.models.load_filter import records
from tests.turning_env.playing import changed
from turning_env import Scenario

BASE = Scenario()
KINKED = changed(BASE, machine={"rated_power": 6.0}, spindle={"base_speed": 1500.0})
FRESH_SHARE = changed(
    BASE,
    material={
        "thrust_force": BASE.material.thrust_force.model_dump()
        | {"coefficient": 14000.0, "wear": 1.0, "wear_growth": 6.0},
    },
)
POINTS = 3
NUM_ENVS = 12


class Task(NamedTuple):
    """Arguments of ``search``."""

    parameters: Any
    moments: Any
    environments: Any
    points: Any

    def gain(self, env: int, log_speed: float, log_feed: float) -> float:
        """Return the mean gain of a set point in an environment."""
        trial = try_set_point(
            self.parameters[0],
            self.moments[0],
            self.environments[env],
            self.points[env],
            log_speed,
            log_feed,
        )
        return float(trial.gain)


def random_task(scenario: Scenario, seed: int, **of_points: float) -> Task:
    """Return the task of random states; ``of_points``: values of all points."""
    random = np.random.default_rng(seed)
    log_speed = np.log(random.uniform(120.0, 300.0, NUM_ENVS))
    log_feed = np.log(random.uniform(0.15, 0.6, NUM_ENVS))
    used_life = random.uniform(0.05, 0.9, NUM_ENVS)
    log_force = random.normal(0.0, 0.15, NUM_ENVS)
    log_power = random.normal(0.0, 0.15, NUM_ENVS)

    moments = np.empty((1, POINTS), MOMENT)
    moments["time"] = np.arange(1.0, POINTS + 1.0) / POINTS
    moments["speed_left"] = np.exp(-moments["time"] / 0.2)
    moments["feed_left"] = np.exp(-moments["time"] / 0.1)

    parameters = records([edge_value.numbers_of(scenario, severity=1.5)])
    environments = np.empty(NUM_ENVS, ENVIRONMENT)
    environments["min_log_speed"] = log_speed - 0.15
    environments["max_log_speed"] = log_speed + 0.15
    environments["min_log_feed"] = log_feed - 0.4
    environments["max_log_feed"] = log_feed + 0.4
    environments["log_speed"] = log_speed
    environments["log_feed"] = log_feed
    environments["used_life"] = used_life
    environments["breakage_price"] = 300.0
    for name in ("log_life_rate", "life_speed", "life_feed"):
        environments[name] = parameters[name]
    laws = {"force": scenario.material.thrust_force, "power": scenario.material.power}
    for name, law in laws.items():
        environments[f"{name}_speed"] = law.cutting_speed
        environments[f"{name}_feed"] = law.feed
        environments[f"{name}_wear"] = law.wear
        environments[f"{name}_growth"] = law.wear_growth * scenario.tool.wear_criterion

    points = np.empty((NUM_ENVS, POINTS), POINT)
    points["log_force"] = log_force[:, np.newaxis]
    points["log_power"] = log_power[:, np.newaxis]
    points["force_spread"] = 0.04
    points["power_spread"] = 0.03
    points["strength_spread"] = 0.15
    points["life_price"] = 1000.0
    points["metal_value"] = parameters["metal_value"]
    points["cutting"] = 1.0
    points["unmeasured"] = 0.0
    for name, value in of_points.items():
        points[name] = value
    return Task(parameters, moments, environments, points)


def best_set_points(task: Task) -> NDArray[Any]:
    """Return the set points that the search finds."""
    best = np.empty(NUM_ENVS, SET_POINT)
    search(*task, best)
    return best


@pytest.mark.parametrize("scenario", [BASE, KINKED, FRESH_SHARE], ids=["power", "base", "fresh"])
def test_the_slope_of_the_gain_leads_uphill(scenario: Scenario) -> None:
    """A small part of the step from a set point raises the gain."""
    task = random_task(scenario, seed=1)
    for i in range(NUM_ENVS):
        env = task.environments[i]
        start = (env.log_speed, env.log_feed)
        trial = try_set_point(task.parameters[0], task.moments[0], env, task.points[i], *start)
        share = 1e-4
        gain = task.gain(
            i, start[0] + share * trial.step.log_speed, start[1] + share * trial.step.log_feed
        )
        assert gain >= trial.gain


@pytest.mark.parametrize(
    ("scenario", "of_points"),
    [
        pytest.param(BASE, {}, id="metal"),
        pytest.param(KINKED, {}, id="base speed"),
        pytest.param(FRESH_SHARE, {}, id="fresh edge's share"),
        pytest.param(BASE, {"unmeasured": 1.0}, id="unmeasured bar"),
        pytest.param(BASE, {"cutting": 0.0, "log_force": 9.0}, id="air"),
    ],
)
def test_no_set_point_of_a_grid_within_reach_gains_more(
    scenario: Scenario, of_points: dict[str, float]
) -> None:
    task = random_task(scenario, seed=0, **of_points)
    best = best_set_points(task)
    for i in range(4):
        env = task.environments[i]
        assert env.min_log_speed - 1e-12 <= best[i].log_speed <= env.max_log_speed + 1e-12
        assert env.min_log_feed - 1e-12 <= best[i].log_feed <= env.max_log_feed + 1e-12
        speeds = np.linspace(env.min_log_speed, env.max_log_speed, 13)
        feeds = np.linspace(env.min_log_feed, env.max_log_feed, 13)
        gains = [task.gain(i, speed, feed) for speed, feed in product(speeds, feeds)]
        assert task.gain(i, best[i].log_speed, best[i].log_feed) >= max(gains) - 1e-4
