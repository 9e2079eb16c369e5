import numpy as np
import pytest
import torch

from train.commands import Commands
from turning_env import RoughTurningVectorEnv, Scenario, read
from turning_env.action import towards


def wanted_places(scenario: Scenario, speed: np.ndarray, feed: np.ndarray) -> torch.Tensor:
    """Places -1..1 in the machine's ranges."""
    machine = scenario.machine
    ranges = ((speed, machine.cutting_speed_min, machine.cutting_speed_max), (feed, machine.feed_min, machine.feed_max))
    return torch.tensor(
        np.stack([2 * np.log(v / low) / np.log(high / low) - 1 for v, low, high in ranges], 1), dtype=torch.float32
    )


@pytest.mark.parametrize("preset", ["rough_turning", "shift"])
def test_actions_are_those_of_a_rule_that_wants_the_same(preset: str) -> None:
    scenario = Scenario.load(preset)
    env, commands = RoughTurningVectorEnv(64, scenario), Commands(scenario)
    random = np.random.default_rng(0)
    observations, _ = env.reset(seed=0)
    for _ in range(5):
        speed, feed = random.uniform(60, 190, 64), random.uniform(0.07, 0.55, 64)
        change = random.random(64) < 0.1
        wanted = wanted_places(scenario, speed, feed)
        if commands.changes_edges:
            wanted = torch.cat([wanted, torch.tensor(np.where(change, 3.0, -3.0), dtype=torch.float32)[:, None]], 1)
        seen = torch.from_numpy(observations)
        action = commands.action(wanted, seen).numpy()
        np.testing.assert_allclose(action, towards(read(observations, scenario), scenario, speed, feed, change), atol=2e-5)
        log_speed, log_feed = commands.commanded(wanted, seen)
        observations, _, _, _, infos = env.step(action)
        np.testing.assert_allclose(log_speed.exp(), infos["commanded_cutting_speed"], rtol=1e-5)
        np.testing.assert_allclose(log_feed.exp(), infos["commanded_feed"], rtol=1e-5)


def test_an_override_is_commanded_as_the_lathe_does() -> None:
    scenario = Scenario.load("override")
    env, commands = RoughTurningVectorEnv(8, scenario), Commands(scenario)
    observations, _ = env.reset(seed=0)
    wanted = torch.linspace(-1, 1, 8)[:, None]
    action = commands.action(wanted, torch.from_numpy(observations))
    _, _, _, _, infos = env.step(action.numpy())
    log_speed, log_feed = commands.commanded(wanted, torch.from_numpy(observations))
    np.testing.assert_allclose(log_speed.exp(), infos["commanded_cutting_speed"], rtol=1e-5)
    np.testing.assert_allclose(log_feed.exp(), infos["commanded_feed"], rtol=1e-5)


def test_what_is_out_of_reach_is_still_wanted() -> None:
    scenario = Scenario.load("rough_turning")
    observations, _ = RoughTurningVectorEnv(1, scenario).reset(seed=0)
    wanted = torch.tensor([[1.0, 1.0]], requires_grad=True)
    sum(Commands(scenario).commanded(wanted, torch.from_numpy(observations))).sum().backward()  # type: ignore[union-attr]
    assert wanted.grad is not None
    assert (wanted.grad > 0.0).all()


@pytest.mark.parametrize("preset", ["paper", "batch_casting"])
def test_other_actions_are_refused(preset: str) -> None:
    with pytest.raises(ValueError, match=r"control\.action is .* but must be"):
        Commands(Scenario.load(preset))
