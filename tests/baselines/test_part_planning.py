"""Whole parts: what is planned is what is turned, and a path made for the measured size is."""

import numpy as np
import pytest

from baselines.part_planning import RuledParts, pass_depths, plan
from tests.turning_env.playing import NO_SPREAD, changed, infos
from turning_env import RoughTurningEnv, Scenario

BATCH = Scenario.load("batch_casting")


def test_a_plan_is_turned_as_it_says():
    scenario = changed(BATCH, workpiece=NO_SPREAD | {"depth_of_cut": 6.0})
    actions = plan(
        scenario,
        passes=np.array([3.0]),
        allowance=np.array([6.0]),
        cutting_speed=np.full((1, 4), 150.0),
        feed=np.full((1, 4), 0.3),
    )
    (info,) = infos(scenario, actions)
    assert info["passes"] == 3
    assert info["cutting_speed"] == pytest.approx(150.0, rel=1e-5)
    assert info["feed"] == pytest.approx(0.3, rel=1e-5)
    expected_force = BATCH.material.thrust_force(150.0, 0.3, 2.0)
    assert info["mean_thrust_force"] == pytest.approx(expected_force, rel=1e-4)
    assert actions.shape == (1, 10)
    assert np.abs(actions).max() <= 1


@pytest.mark.parametrize(
    ("allowance", "path", "passes", "expected"),
    [
        pytest.param(5.0, 5.0, 2.0, [2.5, 2.5, 0.0, 0.0], id="as planned"),
        pytest.param(6.0, 5.0, 2.0, [3.5, 2.5, 0.0, 0.0], id="larger blank"),
        pytest.param(2.0, 5.0, 2.0, [0.0, 2.0, 0.0, 0.0], id="smaller blank"),
        pytest.param(5.0, 0.0, 3.0, [5.0, 0.0, 0.0, 0.0], id="path without allowance"),
        pytest.param(0.0, 5.0, 1.0, [0.0, 0.0, 0.0, 0.0], id="no metal"),
        pytest.param(4.0, 4.0, 4.0, [1.0, 1.0, 1.0, 1.0], id="most passes"),
    ],
)
def test_depths_of_passes(allowance, path, passes, expected):
    depths = pass_depths(
        np.array([allowance]),
        np.array([path]),
        np.array([passes]),
        passes_max=4,
    )
    np.testing.assert_allclose(depths, [expected])


@pytest.mark.parametrize(
    ("margin", "in_one_pass"),
    [
        pytest.param(1.0, True, id="400 N allow 4 mm at the lowest feed"),
        pytest.param(0.6, False, id="240 N do not"),
    ],
)
def test_no_pass_is_planned_too_deep_for_a_further_limit(margin, in_one_pass):
    scenario = changed("batch_p20", workpiece=NO_SPREAD | {"depth_of_cut": 4.0})
    observation, _ = RoughTurningEnv(scenario).reset(seed=0)
    policy = RuledParts(
        scenario,
        "PV",
        corrected=True,
        margin=margin,
        first_margin=margin,
    )
    policy.reset(np.ones(1, np.bool_))
    (info,) = infos(scenario, policy.act(observation[np.newaxis]))
    assert (info["passes"] == 1) == in_one_pass
    assert info["excess_force"] < 1e-6
