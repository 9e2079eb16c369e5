"""rl-baselines3-zoo: its commands work on every id with the project's settings."""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from turning_env import ALL_IDS, FAMILY_ID

# The zoo changes Gymnasium's TimeLimit when it is imported, so only the slow tests import it.
pytestmark = pytest.mark.skipif(find_spec("rl_zoo3") is None, reason="rl_zoo3 is not installed")

TRAININGS = [("ppo", env_id) for env_id in ALL_IDS]
TRAININGS += [("sac", FAMILY_ID), ("tqc", "RoughTurning-v0")]
SMALL = {
    "ppo": "n_envs:4 n_steps:64 batch_size:64",
    "sac": "n_envs:4 buffer_size:1000 learning_starts:100",
    "tqc": "n_envs:4 buffer_size:1000 learning_starts:100",
}


def common_options(algorithm: str, env_id: str, folder: Path) -> str:
    return (
        f"--algo {algorithm} --env {env_id} --gym-packages turning_env -f {folder} "
        "--seed 0 --num-threads 1 --device cpu"
    )


def run(program: str, options: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [program, *options.split()])
    module = import_module(f"rl_zoo3.{program}")
    getattr(module, program)()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # the zoo's warnings are not this project's
@pytest.mark.parametrize(("algorithm", "env_id"), TRAININGS)
def test_the_zoo_trains_and_plays(
    algorithm: str, env_id: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    common = common_options(algorithm, env_id, tmp_path)
    small = f"--n-timesteps 256 --eval-freq -1 -params {SMALL[algorithm]}"
    run("train", f"{common} --conf-file examples.zoo.{algorithm} {small}", monkeypatch)
    assert "Saving to" in capsys.readouterr().out
    if algorithm == "ppo" and env_id == "RoughTurning-v0":
        # An episode has at most 3600 steps.
        run("enjoy", f"{common} --no-render --n-timesteps 3700", monkeypatch)
        assert "Mean reward: -" in capsys.readouterr().out
