"""The output block: its tool life, cost and resultant force agree with what the environment does."""

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.scoring.output_block import output_block


def test_at_constant_conditions_the_tool_life_is_that_of_the_edge_and_the_cost_its_price() -> None:
    scenario = changed(UNDISTURBED, tool={"wear_factor_spread": 0.3}, mismatch={"hardness_factor": 1.2})
    env = RoughTurningVectorEnv(3, scenario)
    env.reset(seed=1)
    cost = np.zeros(3)
    for _ in range(2):
        *_, infos = env.step(np.zeros(env.action_space.shape, np.float32))
        outputs = output_block(infos, scenario)
        cost += outputs.operation_cost
    assert outputs.tool_life == pytest.approx(infos["cutting_time"] / infos["used_life"], rel=1e-9)
    assert len(np.unique(outputs.tool_life)) == 3
    economics, share = scenario.economics, infos["used_life"]
    edge = 60.0 * (economics.edge_cost + economics.edge_change_time)
    assert cost == pytest.approx(2.0 * scenario.control.interval + edge * share, rel=1e-9)
    main = 60.0 * infos["power"] * 1000.0 / infos["cutting_speed"]
    np.testing.assert_allclose(outputs.resultant_force**2, main**2 + infos["thrust_force"] ** 2)
    np.testing.assert_array_equal(outputs.wear, infos["wear"])


def test_a_tool_in_air_lasts_forever_and_the_surface_tasks_force_is_the_resultant() -> None:
    scenario = Scenario.load("surface")
    env = RoughTurningVectorEnv(2, scenario)
    env.reset(seed=1)
    *_, infos = env.step(np.zeros(env.action_space.shape, np.float32))
    outputs = output_block(infos, scenario)
    assert np.isinf(outputs.tool_life).all()
    np.testing.assert_array_equal(outputs.resultant_force, infos["thrust_force"])
