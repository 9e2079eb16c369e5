import numpy as np
import pytest

from turning_env import RoughTurningVectorEnv, Scenario, read
from turning_env.action import towards


@pytest.mark.parametrize("preset", ["rough_turning", "paper"])
def test_a_set_point_is_reached_and_held(preset: str) -> None:
    scenario = Scenario.load(preset)
    env = RoughTurningVectorEnv(2, scenario)
    observations, _ = env.reset(seed=0)
    speeds, feeds = np.array([70.0, 190.0]), np.array([0.5, 0.1])
    for _ in range(8):
        observations, _, _, _, infos = env.step(towards(read(observations, scenario), scenario, speeds, feeds))
    np.testing.assert_allclose(infos["commanded_cutting_speed"], speeds, rtol=1e-6)
    np.testing.assert_allclose(infos["commanded_feed"], feeds, rtol=1e-6)


def test_one_interval_moves_no_further_than_a_step() -> None:
    scenario = Scenario.load("rough_turning")
    env = RoughTurningVectorEnv(1, scenario)
    observations, before = env.reset(seed=0)
    action = towards(read(observations, scenario), scenario, np.array([200.0]), np.array([0.06]))
    np.testing.assert_array_equal(action, [[1.0, -1.0]])
    _, _, _, _, after = env.step(action)
    ratio = after["commanded_cutting_speed"] / before["commanded_cutting_speed"]
    np.testing.assert_allclose(np.log(ratio), scenario.control.cutting_speed_step)
