"""The best use of an edge by forms that are known."""

import numpy as np

from baselines.models.schedule import LIVES, has_forms, schedule
from tests.turning_env.playing import changed
from turning_env import Scenario

SHIFT = Scenario.load("shift")
HOT = changed(SHIFT, edge_failure={"collapse_temperature": 900.0})


def test_edges_are_kept_from_collapse() -> None:
    assert has_forms(HOT) > has_forms(SHIFT)
    plan, law = schedule(HOT), HOT.edge_failure.temperature
    used = (np.arange(LIVES) + 1.0) / LIVES
    wear = HOT.tool.wear_criterion * used**HOT.material.wear.time
    hot = law(plan.cutting_speed, plan.feed, HOT.workpiece.depth_of_cut, wear=wear) / 900.0
    assert hot[used <= plan.change_at].max() < 1.0
    last = int(LIVES * plan.change_at) - 1
    assert plan.cutting_speed[last] < schedule(SHIFT).cutting_speed[last]
    assert plan.time < schedule(SHIFT).time


def test_edges_that_notch_are_changed_before_they_break() -> None:
    notched = changed(SHIFT, edge_failure={"notch_growth": 2.0})
    assert 0.2 < schedule(notched).change_at < 0.5 < schedule(SHIFT).change_at
