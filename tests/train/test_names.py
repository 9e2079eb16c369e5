"""Hyperparameters have Stable-Baselines3's names; older names are still understood."""

from dataclasses import replace
from pathlib import Path

import pytest

from leaderboard.agents import agent_file
from tests.train.small import ALGORITHMS, small_run
from train import dagger
from train import run as runs
from train.run import OLD_NAMES, Run, current_names, examples, hyperparameters, overrides

AGENTS = Path(__file__).parents[2] / "agents"


@pytest.mark.parametrize(
    "path", sorted(AGENTS.glob("*/*/*-seed0.onnx")), ids=lambda path: path.stem
)
def test_every_hyperparameter_of_a_shipped_agent_has_a_present_name(path: Path) -> None:
    metadata = agent_file.read(path).metadata
    known = set(hyperparameters(metadata.algorithm, metadata.env_id))
    known |= set(hyperparameters("ppo", metadata.env_id)) | {
        "family",
        "context",
        "training_information",
    }
    unknown = set(current_names(metadata.parameters)) - known
    assert unknown == set()


def test_old_names_are_no_present_names_but_for_the_switch_of_memory() -> None:
    present: set[str] = set()
    for algorithm in runs.ALGORITHMS:
        present |= hyperparameters(algorithm, "RoughTurning-v0").keys()
    assert present & set(OLD_NAMES) == {"memory"}
    assert set(OLD_NAMES.values()) <= present


def test_memory_is_a_size_or_a_switch() -> None:
    assert current_names({"memory": 1_000}) == {"buffer_size": 1_000}
    assert current_names({"memory": True}) == {"memory": True}
    assert overrides("sac", ["memory=1000"]) == {"buffer_size": 1000}
    assert overrides("analytic_gradient", ["memory=false"]) == {"memory": False}


def test_a_count_may_be_written_as_a_power_of_ten() -> None:
    assert overrides("ppo", ["total_timesteps=1e6"]) == {"total_timesteps": 1_000_000}
    with pytest.raises(ValueError, match=r"total_timesteps is 1\.5, but must be a int"):
        overrides("ppo", ["total_timesteps=1.5"])


def test_a_switch_is_true_or_false() -> None:
    with pytest.raises(ValueError, match="belief is 'maybe', but must be true or false"):
        overrides("ppo", ["belief=maybe"])


def test_commands_on_cards_are_understood() -> None:
    assert overrides("ppo", ["discount=0.9", "hidden_layers=[8]"]) == {
        "gamma": 0.9,
        "net_arch": [8],
    }


def test_a_run_with_old_names_is_read(tmp_path: Path) -> None:
    run = small_run(ALGORITHMS["ppo"], tmp_path)
    present_names = {new: old for old, new in OLD_NAMES.items()}
    old_parameters = {present_names.get(name, name): v for name, v in run.parameters.items()}
    replace(run, parameters=old_parameters).begin()
    assert Run.read(run.folder) == run


def test_an_id_has_the_defaults_but_for_its_own_values() -> None:
    defaults = ALGORITHMS["sac"].defaults
    assert hyperparameters("sac", "RoughTurning-Shift-v0") == defaults
    assert hyperparameters("sac", "RoughTurning-v0") == {**defaults, "gamma": 0.6, "tau": 0.01}


def test_an_algorithm_without_a_hyperparameter_file_has_its_defaults() -> None:
    defaults = dagger.ALGORITHM.defaults
    assert hyperparameters("dagger", "RoughTurning-Family-v0") == defaults


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
