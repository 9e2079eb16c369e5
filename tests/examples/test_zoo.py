"""rl-baselines3-zoo: its commands work on every id with the project's settings."""

import sys
from importlib import import_module
from pathlib import Path

import pytest

from turning_env import FAMILY_ID, IDS

pytest.importorskip("rl_zoo3")


CASES = [
    *(("ppo", each) for each in (*IDS, FAMILY_ID)),
    ("sac", FAMILY_ID),
    ("tqc", "RoughTurning-v0"),
]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # what the zoo does is not this project's
@pytest.mark.parametrize(("algorithm", "env_id"), CASES)
def test_the_zoo_trains_and_plays(
    algorithm: str, env_id: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    common = f"--algo {algorithm} --env {env_id} --gym-packages turning_env -f {tmp_path} --seed 0 --num-threads 1 --device cpu"
    few = (
        "n_envs:4 n_steps:64 batch_size:64"
        if algorithm == "ppo"
        else "n_envs:4 buffer_size:1000 learning_starts:100"
    )
    programs = [
        (
            "train",
            f"--conf-file examples.zoo.{algorithm} --n-timesteps 256 --eval-freq -1 -params {few}",
            "Saving to",
        )
    ]
    if env_id == "RoughTurning-v0" and algorithm == "ppo":
        programs.append(
            ("enjoy", "--no-render --n-timesteps 3700", "Mean reward: -")
        )  # an episode has at most 3600 steps
    for program, options, said in programs:
        monkeypatch.setattr(sys, "argv", [program, *common.split(), *options.split()])
        getattr(import_module(f"rl_zoo3.{program}"), program)()
        assert said in capsys.readouterr().out
