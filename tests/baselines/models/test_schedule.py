"""The best use of an edge by forms that are known."""

import numpy as np

from baselines.models.schedule import LIVES, has_forms, schedule
from tests.turning_env.playing import changed
from turning_env import Scenario

SHIFT = Scenario.load("shift")
COLLAPSE_TEMPERATURE = 900.0
HOT = changed(SHIFT, edge_failure={"collapse_temperature": COLLAPSE_TEMPERATURE})


def test_scenarios_with_edge_failure_have_forms() -> None:
    assert has_forms(HOT)
    assert not has_forms(SHIFT)


def test_edges_are_kept_from_collapse() -> None:
    plan = schedule(HOT)
    depth = HOT.workpiece.depth_of_cut
    used_life = (np.arange(LIVES) + 1.0) / LIVES
    wear = HOT.tool.wear_criterion * used_life**HOT.material.wear.time
    law = HOT.edge_failure.temperature
    temperature = law(plan.cutting_speed, plan.feed, depth, wear=wear)
    assert temperature[used_life <= plan.change_at].max() < COLLAPSE_TEMPERATURE


def test_where_edges_collapse_they_cut_more_slowly_and_time_is_worth_less() -> None:
    plan = schedule(HOT)
    without = schedule(SHIFT)
    last = int(LIVES * plan.change_at) - 1
    assert plan.cutting_speed[last] < without.cutting_speed[last]
    assert plan.time < without.time


def test_edges_that_notch_are_changed_before_they_break() -> None:
    notched = changed(SHIFT, edge_failure={"notch_growth": 2.0})
    assert 0.2 < schedule(notched).change_at < 0.5
    assert schedule(SHIFT).change_at > 0.5
