"""rl-baselines3-zoo: its files say what the project's own do, and its commands work."""

import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from train.run import hyperparameters

pytest.importorskip("rl_zoo3")
import yaml

ROOT = Path(__file__).parents[2]
ENV_ID = "RoughTurning-v0"

# The zoo's name for each of the project's, where the values are the same.
SHARED = {
    "steps": "n_timesteps",
    "num_envs": "n_envs",
    "rollout": "n_steps",
    "batch_size": "batch_size",
    "epochs": "n_epochs",
    "discount": "gamma",
    "gae_lambda": "gae_lambda",
    "clip_range": "clip_range",
    "entropy_coefficient": "ent_coef",
    "value_coefficient": "vf_coef",
    "max_gradient_norm": "max_grad_norm",
    "memory": "buffer_size",
    "random_steps": "learning_starts",
    "batches_per_step": "gradient_steps",
    "target_rate": "tau",
    "dropped_quantiles": "top_quantiles_to_drop_per_net",
}
NETWORK = {
    "hidden_layers": "net_arch",
    "initial_log_deviation": "log_std_init",
    "critics": "n_critics",
    "quantiles": "n_quantiles",
}


def settings(algorithm: str) -> dict[str, Any]:
    """Return the settings in the zoo's file."""
    values: dict[str, Any] = yaml.safe_load((ROOT / "examples" / "zoo" / f"{algorithm}.yml").read_text("utf-8"))[ENV_ID]
    return values


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "tqc"])
def test_settings_are_those_of_the_projects_own_training(algorithm: str) -> None:
    ours, theirs = hyperparameters(algorithm, ENV_ID), settings(algorithm)
    expected = {SHARED[name]: value for name, value in ours.items() if name in SHARED}
    assert {name: theirs[name] for name in expected} == expected
    assert theirs["learning_rate"].startswith("lin_")
    assert float(theirs["learning_rate"].removeprefix("lin_")) == ours["learning_rate"]
    network = ", ".join(f"{NETWORK[name]}={ours[name]}" for name in NETWORK if name in ours and name != "hidden_layers")
    start = f"dict(net_arch={ours['hidden_layers']}, activation_fn=nn.ReLU"
    assert theirs["policy_kwargs"] == start + (f", {network})" if network else ")")
    if "target_entropy_per_action" in ours:
        assert theirs["target_entropy"] == 2 * ours["target_entropy_per_action"]
        assert theirs["ent_coef"] == f"auto_{ours['initial_entropy_coefficient']}"


@pytest.fixture
def zoo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs one of the zoo's programs, and gives what it prints."""
    monkeypatch.chdir(ROOT)

    def run(program: str, algorithm: str, *arguments: str) -> str:
        words = ["--algo", algorithm, "--env", ENV_ID, "--gym-packages", "turning_env", "-f", str(tmp_path)]
        common = ["--seed", "0", "--num-threads", "1", "--device", "cpu"]
        monkeypatch.setattr(sys, "argv", [program, *words, *common, *arguments])
        getattr(import_module(f"rl_zoo3.{program}"), program)()
        return capsys.readouterr().out

    return run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "smaller"),
    [
        ("ppo", ["n_envs:4", "n_steps:64", "batch_size:64"]),
        ("tqc", ["n_envs:4", "learning_starts:200"]),
    ],
)
@pytest.mark.filterwarnings("ignore")  # what the zoo does is not this project's
def test_the_zoo_trains(algorithm: str, smaller: list[str], tmp_path: Path, zoo: Callable[..., str]) -> None:
    few = ["--n-timesteps", "256", "--eval-freq", "-1", "-params", *smaller]
    said = zoo("train", algorithm, "--conf-file", f"examples/zoo/{algorithm}.yml", *few)
    assert "Saving to" in said
    assert (tmp_path / algorithm / f"{ENV_ID}_1" / f"{ENV_ID}.zip").stat().st_size > 0
    if algorithm == "ppo":
        # An episode ends after 60 min at the latest, which are 3600 intervals.
        assert "Mean reward: -" in zoo("enjoy", algorithm, "--no-render", "--n-timesteps", "3700")
