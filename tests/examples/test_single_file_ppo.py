"""PPO in one file: its returns, that it learns, and what it refuses."""

import pytest
import torch

from examples.single_file_ppo import Agent, Rollouts, Settings, main, train
from turning_env import Scenario
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.play import play
from turning_env.scoring.seeds import tuning_seeds


def test_without_ends_returns_are_discounted_sums() -> None:
    settings = Settings(num_envs=3, rollout=12, gae_lambda=1.0, discount=0.7, reward_scale=0.5)
    torch.manual_seed(0)
    rollouts, agent = Rollouts(settings), Agent(11, 2)
    rollout = rollouts.next(agent)
    assert not rollout["end"].any()
    expected = agent.values(rollouts.observations).detach()
    for step in reversed(range(12)):
        expected = rollout["reward"][step] + 0.7 * expected
        torch.testing.assert_close(rollout["return"][step], expected)
    torch.testing.assert_close(rollout["advantage"], rollout["return"] - agent.values(rollout["observation"]).detach())


@pytest.mark.slow
def test_it_learns() -> None:
    torch.manual_seed(0)
    untrained, trained = Agent(11, 2), train(Settings(steps=60_000))
    before, after = (play(as_factory(agent.mean), Scenario(), tuning_seeds(8))["return"].mean() for agent in (untrained, trained))
    assert after > before + 500


def test_the_command_says_what_it_reaches(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--steps", "1", "--num-envs", "2", "--rollout", "8", "--tuning-seeds", "1"]) == 0
    assert capsys.readouterr().out.startswith("PPO after 1 steps: -")


def test_bad_settings_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--learning-rate", "nan"]) == 2
    assert "--learning-rate is nan" in capsys.readouterr().err
