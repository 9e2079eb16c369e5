import numpy as np
import pytest
import torch

from train.commands import Commands
from train.odometer import Odometer
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.physics.quantities import OBS


@pytest.mark.parametrize("preset", ["rough_turning", "override", "shift"])
def test_it_knows_where_the_tool_is(preset: str) -> None:
    scenario = Scenario.load(preset)
    pitch = scenario.workpiece.bar_length + scenario.workpiece.approach
    env, commands = RoughTurningVectorEnv(4, scenario), Commands(scenario)
    odometer, state = Odometer(scenario, commands), torch.zeros(4, Odometer.STATES)
    random = np.random.default_rng(0)
    size = env.single_action_space.shape[0]  # type: ignore[index]
    observations, infos = env.reset(seed=0)
    for step in range(300):
        seen = torch.from_numpy(observations)
        readings, state = odometer(seen, state)
        along = infos["path"] % pitch
        difference = np.abs(state[:, 0].numpy() - along)
        assert np.minimum(difference, pitch - difference).max() < 0.05
        np.testing.assert_allclose(readings[:, 0], 2.0 * state[:, 0] / pitch - 1.0, atol=1e-5)
        left = (pitch - state[:, 0].numpy()) / (infos["feed_velocity"] / 60.0)
        np.testing.assert_allclose(readings[:, 1], 2.0 * np.minimum(left, 4.0) / 4.0 - 1.0, atol=1e-3)
        actions = random.uniform(-1, 1, (4, size))
        if scenario.control.edge_changes == "commanded":
            actions[:, -1] = -1.0
        observations, _, terminated, truncated, infos = env.step(actions)
        if (terminated | truncated).any():
            assert step > 100
            return


def test_the_control_is_right_about_metal_and_air() -> None:
    scenario = Scenario.load("rough_turning")
    odometer = Odometer(scenario, Commands(scenario))
    observations, _ = RoughTurningVectorEnv(2, scenario).reset(seed=0)
    seen = torch.from_numpy(observations)
    seen[:, OBS.cutting] = torch.tensor([1.0, 0.0])
    _, state = odometer(seen, torch.tensor([[2.0, 0.0, 0.0], [250.0, 0.0, 0.0]]))
    assert state[:, 0].tolist() == [scenario.workpiece.approach, 0.5 * scenario.workpiece.approach]
