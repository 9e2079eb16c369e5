"""PPO in one file: its returns, that it learns, and what it refuses."""

import pytest
import torch

from examples.single_file_ppo import Agent, Settings, main, train
from turning_env import Scenario
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.play import play
from turning_env.scoring.seeds import tuning_seeds


@pytest.mark.slow
def test_it_learns() -> None:
    torch.manual_seed(0)
    untrained, trained = Agent(11, 2), train(Settings(steps=60_000))
    before, after = (
        play(as_factory(agent.mean), Scenario(), tuning_seeds(8))["return"].mean()
        for agent in (untrained, trained)
    )
    assert after > before + 500


def test_the_command_says_what_it_reaches(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--steps", "1", "--num-envs", "2", "--rollout", "8", "--tuning-seeds", "1"]) == 0
    assert capsys.readouterr().out.startswith("PPO after 1 steps: -")
