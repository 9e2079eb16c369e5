"""Actions and what they command."""

import numpy as np
import pytest

from turning_env import RoughTurningVectorEnv, Scenario, read
from turning_env.action import commanded, towards

NUM_ENVS = 40


@pytest.mark.parametrize("preset", ["rough_turning", "override", "shift", "paper"])
def test_actions_command_what_the_environment_reports(preset: str) -> None:
    scenario = Scenario.load(preset)
    env = RoughTurningVectorEnv(NUM_ENVS, scenario)
    _, infos = env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(3):
        actions = env.action_space.sample()
        speed, feed = commanded(
            actions,
            cutting_speed=infos["commanded_cutting_speed"],
            feed=infos["commanded_feed"],
            scenario=scenario,
        )
        infos = env.step(actions)[4]
        np.testing.assert_array_equal(speed, infos["commanded_cutting_speed"])
        np.testing.assert_array_equal(feed, infos["commanded_feed"])


@pytest.mark.parametrize("preset", ["rough_turning", "override", "shift", "paper"])
def test_actions_towards_a_feed_command_it(preset: str) -> None:
    scenario = Scenario.load(preset)
    env = RoughTurningVectorEnv(NUM_ENVS, scenario)
    env.reset(seed=0)
    env.action_space.seed(0)
    observations, _, _, _, infos = env.step(env.action_space.sample())
    speed = infos["commanded_cutting_speed"]
    feed = infos["commanded_feed"]
    reading = read(observations, scenario)
    actions = towards(
        reading,
        scenario,
        cutting_speed=0.99 * speed,
        feed=0.99 * feed,
    )
    _, commanded_feed = commanded(
        actions,
        speed,
        feed=feed,
        scenario=scenario,
    )
    expected = np.maximum(0.99 * feed, scenario.machine.feed_min)
    np.testing.assert_allclose(commanded_feed, expected, rtol=1e-5)
