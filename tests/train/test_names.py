"""Hyperparameters have Stable-Baselines3's names, in the files of agents as well."""

import shlex
from itertools import pairwise
from pathlib import Path

import pytest

from leaderboard.agents import agent_file
from tests.train.small import ALGORITHMS, small_run
from train import dagger
from train.run import Run, examples, hyperparameters, overrides

AGENTS = Path(__file__).parents[2] / "agents"
SHIPPED = sorted(AGENTS.glob("*/*/*-seed0.onnx"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_hyperparameter_of_a_shipped_agent_is_known(path: Path) -> None:
    metadata = agent_file.read(path).metadata
    known = set(hyperparameters(metadata.algorithm, metadata.env_id))
    known |= set(hyperparameters("ppo", metadata.env_id)) | {
        "family",
        "context",
        "training_information",
    }
    unknown = set(metadata.parameters) - known
    assert unknown == set()


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_the_command_of_a_shipped_agent_is_understood(path: Path) -> None:
    metadata = agent_file.read(path).metadata
    words = shlex.split(metadata.command)
    settings = [setting for word, setting in pairwise(words) if word == "--set"]
    for name, value in overrides(metadata.algorithm, settings).items():
        assert metadata.parameters[name] == value


def test_a_count_may_be_written_as_a_power_of_ten() -> None:
    assert overrides("ppo", ["total_timesteps=1e6"]) == {"total_timesteps": 1_000_000}
    with pytest.raises(ValueError, match=r"total_timesteps is 1\.5, but must be a int"):
        overrides("ppo", ["total_timesteps=1.5"])


def test_a_switch_is_true_or_false() -> None:
    with pytest.raises(ValueError, match="belief is 'maybe', but must be true or false"):
        overrides("ppo", ["belief=maybe"])


def test_an_id_has_the_defaults_but_for_its_own_values() -> None:
    defaults = ALGORITHMS["sac"].defaults
    assert hyperparameters("sac", "RoughTurning-Shift-v0") == defaults
    assert hyperparameters("sac", "RoughTurning-v0") == {**defaults, "gamma": 0.6, "tau": 0.01}


def test_an_algorithm_without_a_hyperparameter_file_has_its_defaults() -> None:
    defaults = dagger.ALGORITHM.defaults
    assert hyperparameters("dagger", "RoughTurning-Family-v1") == defaults


def test_hyperparameters_of_single_ids_can_be_set() -> None:
    assert "initial_actions" not in ALGORITHMS["ppo"].defaults
    assert examples("ppo")["initial_actions"] == [0.0, 0.0, -1.0]
    assert overrides("ppo", ["initial_actions=[0.5]"]) == {"initial_actions": [0.5]}


def test_an_unknown_algorithm_is_refused() -> None:
    with pytest.raises(ValueError, match=r"no algorithm is called 'pppo'; did you mean ppo"):
        hyperparameters("pppo", "RoughTurning-v0")


def test_the_folder_of_all_runs_leads_to_a_run(tmp_path: Path) -> None:
    run = small_run(ALGORITHMS["ppo"], tmp_path)
    run.begin()
    with pytest.raises(ValueError, match=f"no run.json, but in {run.folder}"):
        Run.read(tmp_path)
