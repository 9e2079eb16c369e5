"""Whole parts: what is planned is what is turned, and a path made for the measured size is."""

import numpy as np
import pytest

from baselines.part_planning import RuledParts, pass_depths, plan
from tests.turning_env.playing import changed, infos
from turning_env import RoughTurningEnv, Scenario

BATCH = Scenario.load("batch_casting")
SPREADS = {
    f"{field}_{kind}_spread": 0.0 for field in ("hardness", "depth") for kind in ("bar", "along")
}


def test_a_plan_is_turned_as_it_says():
    scenario = changed(BATCH, workpiece=SPREADS | {"depth_of_cut": 6.0})
    actions = plan(
        scenario, np.array([3.0]), np.array([6.0]), np.full((1, 4), 150.0), np.full((1, 4), 0.3)
    )
    (info,) = infos(scenario, actions)
    assert info["passes"] == 3
    assert (info["cutting_speed"], info["feed"]) == (
        pytest.approx(150.0, rel=1e-5),
        pytest.approx(0.3, rel=1e-5),
    )
    assert info["mean_thrust_force"] == pytest.approx(
        BATCH.material.thrust_force(150.0, 0.3, 2.0), rel=1e-4
    )
    assert actions.shape == (1, 10)
    assert (np.abs(actions) <= 1).all()


def test_depths_of_passes():
    allowance, path, passes = np.array(
        [[5.0, 5, 2], [6, 5, 2], [2, 5, 2], [5, 0, 3], [0, 5, 1], [4, 4, 4]]
    ).T
    expected = [
        [2.5, 2.5, 0, 0],
        [3.5, 2.5, 0, 0],
        [0, 2, 0, 0],
        [5, 0, 0, 0],
        [0, 0, 0, 0],
        [1, 1, 1, 1],
    ]
    np.testing.assert_allclose(pass_depths(allowance, path, passes, 4), expected)


def test_no_pass_is_planned_too_deep_for_a_further_limit():
    scenario = changed("batch_p20", workpiece=SPREADS | {"depth_of_cut": 4.0})
    for margin in (1.0, 0.6):  # 400 N allow 4 mm at the lowest feed, 240 N do not
        seen, policy = (
            RoughTurningEnv(scenario).reset(seed=0)[0],
            RuledParts(scenario, "PV", True, margin, margin),
        )
        policy.reset(np.ones(1, np.bool_))
        (found,) = infos(scenario, policy.act(seen[np.newaxis]))
        assert (found["passes"] > 1) == (margin < 1.0)
        assert found["cost_force"] < 1e-6
