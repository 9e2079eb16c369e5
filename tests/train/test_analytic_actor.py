"""The analytic-gradient agent's own computations agree with the environment."""

import numpy as np
import pytest
import torch

from train.agent_inputs import DistanceTracker
from train.analytic_actor import TargetCommands
from turning_env import RoughTurningVectorEnv, Scenario, read
from turning_env.action import towards


def positions(scenario: Scenario, speed: np.ndarray, feed: np.ndarray) -> torch.Tensor:
    """Positions -1..1 in the machine's ranges."""
    machine = scenario.machine
    ranges = (
        (speed, machine.cutting_speed_min, machine.cutting_speed_max),
        (feed, machine.feed_min, machine.feed_max),
    )
    return torch.tensor(
        np.stack([2 * np.log(v / low) / np.log(high / low) - 1 for v, low, high in ranges], 1)
    ).float()


@pytest.mark.parametrize("preset", ["rough_turning", "shift", "override"])
def test_actions_and_commands_are_those_of_the_environment(preset: str) -> None:
    scenario = Scenario.load(preset)
    env, commands = RoughTurningVectorEnv(64, scenario), TargetCommands(scenario)
    random = np.random.default_rng(0)
    observations, _ = env.reset(seed=0)
    for _ in range(5):
        speed, feed = random.uniform(60, 190, 64), random.uniform(0.07, 0.55, 64)
        change = random.random(64) < 0.1
        target = (
            torch.rand(64, 1) * 2 - 1 if commands.override else positions(scenario, speed, feed)
        )
        if commands.changes_edges:
            target = torch.cat(
                [target, torch.tensor(np.where(change, 3.0, -3.0), dtype=torch.float32)[:, None]], 1
            )
        seen = torch.from_numpy(observations)
        action = commands.action(target, seen).numpy()
        if not commands.override:
            np.testing.assert_allclose(
                action,
                towards(read(observations, scenario), scenario, speed, feed, change),
                atol=2e-5,
            )
        log_speed, log_feed = commands.commanded(target, seen)
        observations, _, _, _, infos = env.step(action)
        np.testing.assert_allclose(log_speed.exp(), infos["commanded_cutting_speed"], rtol=1e-5)
        np.testing.assert_allclose(log_feed.exp(), infos["commanded_feed"], rtol=1e-5)


@pytest.mark.parametrize("preset", ["rough_turning", "override", "shift"])
def test_the_tracker_knows_where_the_tool_is(preset: str) -> None:
    scenario = Scenario.load(preset)
    pitch = scenario.workpiece.bar_length + scenario.workpiece.approach
    env = RoughTurningVectorEnv(4, scenario)
    tracker, state = DistanceTracker(scenario), torch.zeros(4, DistanceTracker.STATES)
    random = np.random.default_rng(0)
    size = env.single_action_space.shape[0]  # type: ignore[index]
    observations, infos = env.reset(seed=0)
    for step in range(300):
        readings, state = tracker(torch.from_numpy(observations), state)
        difference = np.abs(state[:, 0].numpy() - infos["path"] % pitch)
        assert np.minimum(difference, pitch - difference).max() < 0.05
        np.testing.assert_allclose(readings[:, 0], 2.0 * state[:, 0] / pitch - 1.0, atol=1e-5)
        left = (pitch - state[:, 0].numpy()) / (infos["feed_velocity"] / 60.0)
        np.testing.assert_allclose(
            readings[:, 1], 2.0 * np.minimum(left, 4.0) / 4.0 - 1.0, atol=1e-3
        )
        actions = random.uniform(-1, 1, (4, size))
        if scenario.control.edge_changes == "commanded":
            actions[:, -1] = -1.0
        observations, _, terminated, truncated, infos = env.step(actions)
        if (terminated | truncated).any():
            assert step > 100
            return
