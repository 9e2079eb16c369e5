"""The search finds the set point with the greatest gain within reach."""

from typing import Any

import numpy as np
import pytest

from baselines.models import feed_search
from baselines.models.edge_value import numbers
from baselines.models.feed_search import outlook, search
from baselines.models.load_filter import records
from tests.turning_env.playing import changed
from turning_env import Scenario

BASE = Scenario()
KINKED = changed(BASE, machine={"rated_power": 6.0}, spindle={"base_speed": 1500.0})
POINTS, NUM_ENVS = 3, 12


def states(scenario: Scenario, seed: int, **fixed: float) -> tuple[Any, Any, Any, Any]:
    """Arguments of ``search`` for random states; ``fixed``: numbers of all points."""
    random = np.random.default_rng(seed)
    times = np.arange(1.0, POINTS + 1.0) / POINTS
    lefts = np.stack([times, np.exp(-times / 0.2), np.exp(-times / 0.1)])[np.newaxis]
    log_speed, log_feed = (
        np.log(random.uniform(120.0, 300.0, NUM_ENVS)),
        np.log(random.uniform(0.15, 0.6, NUM_ENVS)),
    )
    rows = [log_speed - 0.15, log_speed + 0.15, log_feed - 0.4, log_feed + 0.4, log_speed, log_feed]
    exponents = [
        [law.cutting_speed, law.feed, law.wear]
        for law in (scenario.material.thrust_force, scenario.material.power)
    ]
    parameters = records([numbers(scenario, 1.5)])
    environments = np.empty((NUM_ENVS, feed_search.ENVIRONMENT))
    environments[:, :6] = np.transpose(rows)
    environments[:, 6], environments[:, 7] = random.uniform(0.05, 0.9, NUM_ENVS), 300.0
    environments[:, 8:] = [*parameters["life"][0], *np.ravel(exponents)]
    drawn = {name: random.normal(0.0, 0.15, NUM_ENVS) for name in ("log_force", "log_power")}
    drawn |= {
        "force_spread": 0.04,
        "power_spread": 0.03,
        "strength_spread": 0.15,
        "life_price": 1000.0,
    }
    drawn |= {
        "metal_value": scenario.workpiece.depth_of_cut / scenario.economics.reference_removal_rate
    }
    drawn |= {"cutting": 1.0, "unmeasured": 0.0} | fixed
    points = np.empty((NUM_ENVS, feed_search.POINT, POINTS))
    for name, value in drawn.items():
        points[:, getattr(feed_search, name.upper())] = np.reshape(value, (-1, 1))
    return parameters, lefts, environments, points


@pytest.mark.parametrize(
    ("scenario", "fixed"),
    [
        (BASE, {}),
        (KINKED, {}),
        (BASE, {"unmeasured": 1.0}),
        (BASE, {"cutting": 0.0, "log_force": 9.0}),
    ],
)
def test_no_set_point_of_a_grid_within_reach_gains_more(
    scenario: Scenario, fixed: dict[str, float]
) -> None:
    parameters, lefts, environments, points = task = states(scenario, 0, **fixed)
    found = np.empty((NUM_ENVS, 2))
    search(*task, found)
    for env, ahead, best in zip(environments[:4], points, found, strict=False):
        slowest, fastest, lowest, highest = env[:4]
        assert best == pytest.approx(
            np.clip(best, (slowest, lowest), (fastest, highest)), abs=1e-12
        )
        grid = np.stack(
            np.meshgrid(np.linspace(slowest, fastest, 13), np.linspace(lowest, highest, 13)),
            axis=-1,
        ).reshape(-1, 2)
        gains = [outlook(parameters[0], lefts[0], env, ahead, *place)[0] for place in grid]
        assert outlook(parameters[0], lefts[0], env, ahead, *best)[0] >= max(gains) - 1e-4
