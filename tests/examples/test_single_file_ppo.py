"""PPO in one file: its returns, that it learns, and what it refuses."""

import pytest
import torch

from examples.single_file_ppo import Agent, Settings, main, train
from leaderboard.adapt import as_factory
from leaderboard.play import play
from leaderboard.seeds import tuning_seeds
from turning_env import Scenario


def mean_return(agent: Agent) -> float:
    episodes = play(as_factory(agent.mean), Scenario(), tuning_seeds(8))
    return float(episodes["return"].mean())


@pytest.mark.slow
def test_it_learns() -> None:
    torch.manual_seed(0)
    untrained = Agent(11, 2)
    trained = train(Settings(total_timesteps=60_000))
    assert mean_return(trained) > mean_return(untrained) + 500


@pytest.mark.slow
def test_the_command_says_what_it_reaches(capsys: pytest.CaptureFixture[str]) -> None:
    small = "--total-timesteps 1 --num-envs 2 --n-steps 8 --tuning-seeds 1"
    assert main(small.split()) == 0
    assert capsys.readouterr().out.startswith("PPO after 1 steps: -")


@pytest.mark.parametrize("option", ["--gamma 1.5", "--gae-lambda 2", "--n-steps 0", "--seed -1"])
def test_settings_out_of_range_are_refused(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(option.split()) == 2
    assert option.split()[0] in capsys.readouterr().err
