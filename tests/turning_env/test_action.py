"""Actions and what they command."""

import numpy as np
import pytest

from turning_env import RoughTurningVectorEnv, Scenario, read
from turning_env.action import commanded, towards


@pytest.mark.parametrize("preset", ["rough_turning", "override", "shift", "paper"])
def test_actions_command_what_the_environment_reports(preset: str) -> None:
    scenario, num_envs = Scenario.load(preset), 40
    env = RoughTurningVectorEnv(num_envs, scenario)
    observations, info = env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(3):
        actions = env.action_space.sample()
        speed, feed = commanded(
            actions, info["commanded_cutting_speed"], info["commanded_feed"], scenario
        )
        observations, _, _, _, info = env.step(actions)
        np.testing.assert_array_equal(speed, info["commanded_cutting_speed"])
        np.testing.assert_array_equal(feed, info["commanded_feed"])
    near = towards(read(observations, scenario), scenario, 0.99 * speed, 0.99 * feed)
    there = commanded(near, speed, feed, scenario)
    np.testing.assert_allclose(
        there[1], np.maximum(0.99 * feed, scenario.machine.feed_min), rtol=1e-5
    )
