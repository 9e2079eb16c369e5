"""The plain grids with which searches are compared have the same laws and the same objective."""

import numpy as np
import pytest

from baselines.models.process import Process
from baselines.two_limits import ECONOMIC_OPTIMUM, set_point
from research.studies.searches import cheapest_of_grid, cost_at, excess_at_every_point
from turning_env import Scenario
from turning_env.scenario.plan import SetPointGrid
from turning_env.scenario.scenario_batch import ScenarioBatch


def test_factors_of_a_grid_are_the_laws_at_every_point() -> None:
    jobs = ScenarioBatch.of([Scenario.load("rough_turning"), Scenario.load("h13_romi")])
    grid = SetPointGrid(jobs)
    expected = excess_at_every_point(jobs, grid, used_life=0.5)
    np.testing.assert_allclose(grid.excess(0.5), expected, rtol=1e-10, atol=1e-12)


def test_no_point_of_a_grid_is_cheaper_than_the_economic_optimum() -> None:
    scenario = Scenario.load("rough_turning")
    process = Process.of(scenario)
    depth = scenario.workpiece.depth_of_cut
    optimum = cost_at(process, *set_point(ECONOMIC_OPTIMUM, process, depth), depth)
    cheapest = cost_at(process, *cheapest_of_grid(scenario, process), depth)
    assert float(optimum) < float(cheapest)
    assert float(cheapest) == pytest.approx(float(optimum), rel=0.1)
