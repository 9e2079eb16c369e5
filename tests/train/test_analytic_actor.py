"""The analytic-gradient agent's own computations agree with the environment."""

import numpy as np
import pytest
import torch

from train.agent_inputs import DistanceTracker
from train.analytic_actor import TargetCommands
from turning_env import RoughTurningVectorEnv, Scenario, read
from turning_env.action import towards

NUM_ENVS = 64


def position(value: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the position -1..1 of a value in a range with a logarithmic scale."""
    return 2 * np.log(value / low) / np.log(high / low) - 1


def positions(scenario: Scenario, speed: np.ndarray, feed: np.ndarray) -> torch.Tensor:
    """Return positions of cutting speed and feed in the machine's ranges, shape (num_envs, 2)."""
    machine = scenario.machine
    speed_position = position(speed, machine.cutting_speed_min, machine.cutting_speed_max)
    feed_position = position(feed, machine.feed_min, machine.feed_max)
    return torch.tensor(np.stack([speed_position, feed_position], axis=1)).float()


@pytest.mark.parametrize("preset", ["rough_turning", "shift", "override"])
def test_actions_and_commands_are_those_of_the_environment(preset: str) -> None:
    scenario = Scenario.load(preset)
    env = RoughTurningVectorEnv(NUM_ENVS, scenario)
    commands = TargetCommands(scenario)
    random = np.random.default_rng(0)
    observations, _ = env.reset(seed=0)
    for _ in range(5):
        speed = random.uniform(60, 190, NUM_ENVS)
        feed = random.uniform(0.07, 0.55, NUM_ENVS)
        change = random.random(NUM_ENVS) < 0.1
        if commands.override:
            target = torch.rand(NUM_ENVS, 1) * 2 - 1
        else:
            target = positions(scenario, speed, feed)
        if commands.changes_edges:
            score = torch.tensor(np.where(change, 3.0, -3.0), dtype=torch.float32)
            target = torch.cat([target, score[:, None]], dim=1)

        observed = torch.from_numpy(observations)
        action = commands.action(target, observed).numpy()
        if not commands.override:
            reading = read(observations, scenario)
            expected = towards(reading, scenario, speed, feed, change)
            np.testing.assert_allclose(action, expected, atol=2e-5)
        log_commanded = commands.commanded(target, observed)
        observations, _, _, _, infos = env.step(action)
        commanded_speed = infos["commanded_cutting_speed"]
        np.testing.assert_allclose(log_commanded.speed.exp(), commanded_speed, rtol=1e-5)
        np.testing.assert_allclose(log_commanded.feed.exp(), infos["commanded_feed"], rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["rough_turning", "override", "shift"])
def test_the_tracker_knows_where_the_tool_is(preset: str) -> None:
    scenario = Scenario.load(preset)
    pitch = scenario.workpiece.bar_length + scenario.workpiece.approach
    env = RoughTurningVectorEnv(4, scenario)
    tracker = DistanceTracker(scenario)
    state = torch.zeros(4, DistanceTracker.STATES)
    random = np.random.default_rng(0)
    size = env.single_action_space.shape[0]  # type: ignore[index]
    observations, infos = env.reset(seed=0)
    for step in range(300):
        readings, state = tracker(torch.from_numpy(observations), state)
        tracked = state[:, 0].numpy()
        difference = np.abs(tracked - infos["path"] % pitch)
        # The end of a bar is the start of the next.
        assert np.minimum(difference, pitch - difference).max() < 0.05

        np.testing.assert_allclose(readings[:, 0], 2.0 * tracked / pitch - 1.0, atol=1e-5)
        time_left = (pitch - tracked) / (infos["feed_velocity"] / 60.0)
        expected = 2.0 * np.minimum(time_left, 4.0) / 4.0 - 1.0
        np.testing.assert_allclose(readings[:, 1], expected, atol=1e-3)

        actions = random.uniform(-1, 1, (4, size))
        if scenario.control.edge_changes == "commanded":
            actions[:, -1] = -1.0
        observations, _, terminated, truncated, infos = env.step(actions)
        if (terminated | truncated).any():
            assert step > 100
            return
