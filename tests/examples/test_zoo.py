"""rl-baselines3-zoo: its files say what the project's own do, and its commands work."""

import sys
from importlib import import_module
from pathlib import Path

import pytest

from train.run import hyperparameters

pytest.importorskip("rl_zoo3")
import yaml

ROOT = Path(__file__).parents[2]
ENV_ID = "RoughTurning-v0"
SHARED = {
    **{"steps": "n_timesteps", "num_envs": "n_envs", "rollout": "n_steps", "batch_size": "batch_size", "epochs": "n_epochs"},
    **{"discount": "gamma", "gae_lambda": "gae_lambda", "clip_range": "clip_range", "entropy_coefficient": "ent_coef"},
    **{"value_coefficient": "vf_coef", "max_gradient_norm": "max_grad_norm", "memory": "buffer_size"},
    **{"random_steps": "learning_starts", "batches_per_step": "gradient_steps", "target_rate": "tau"},
    **{"dropped_quantiles": "top_quantiles_to_drop_per_net"},
}
"""The zoo's name for each of the project's hyperparameters that have the same value."""


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "tqc"])
def test_settings_are_those_of_the_projects_own_training(algorithm: str) -> None:
    ours = hyperparameters(algorithm, ENV_ID)
    theirs = yaml.safe_load((ROOT / "examples" / "zoo" / f"{algorithm}.yml").read_text("utf-8"))[ENV_ID]
    expected = {SHARED[name]: value for name, value in ours.items() if name in SHARED}
    assert {name: theirs[name] for name in expected} == expected
    assert float(theirs["learning_rate"].removeprefix("lin_")) == ours["learning_rate"]
    assert f"net_arch={ours['hidden_layers']}" in theirs["policy_kwargs"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # what the zoo does is not this project's
def test_the_zoo_trains_and_plays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(ROOT)
    common = f"--algo ppo --env {ENV_ID} --gym-packages turning_env -f {tmp_path} --seed 0 --num-threads 1 --device cpu"
    few = "--conf-file examples/zoo/ppo.yml --n-timesteps 256 --eval-freq -1 -params n_envs:4 n_steps:64 batch_size:64"
    for program, options, said in (
        ("train", few, "Saving to"),
        ("enjoy", "--no-render --n-timesteps 3700", "Mean reward: -"),  # an episode ends after 3600 steps at the latest
    ):
        monkeypatch.setattr(sys, "argv", [program, *common.split(), *options.split()])
        getattr(import_module(f"rl_zoo3.{program}"), program)()
        assert said in capsys.readouterr().out
