"""Every id by every way into it; docs/ecosystem.md lists the exceptions."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from leaderboard import score
from leaderboard.__main__ import main as leaderboard
from tests.train.small import PARAMETERS
from train import export, ppo
from turning_env import ALL_IDS, FAMILY_ID, IDS
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv

SOURCES = {**IDS, FAMILY_ID: "shop"}
"""The scenario or family of each id."""


def idle(env_id: str) -> Callable[[Any], Any]:
    """Return a policy whose actions are all 0."""
    shape = gymnasium.make(env_id).action_space.shape

    def act(observations: Any) -> Any:
        return np.zeros((len(observations), *shape), np.float32)

    return act


def learns(env: Any) -> None:
    """Check that PPO of Stable-Baselines3 can learn on environments."""
    model = PPO(
        "MlpPolicy",
        env,
        n_steps=8,
        batch_size=16,
        n_epochs=1,
        device="cpu",
    )
    model.learn(total_timesteps=16)
    action, _ = model.predict(env.reset())
    assert np.isfinite(action).all()


def made_by_gymnasium(env_id: str, tmp_path: Path) -> None:
    """Check a batch that Gymnasium makes, and that it has the seeds of single environments."""
    envs = gymnasium.make_vec(
        env_id,
        num_envs=2,
        vectorization_mode="vector_entry_point",
        autoreset_mode="SameStep",
    )
    observations, _ = envs.reset(seed=0)
    assert observations in envs.observation_space
    # The second environment has the second seed.
    single = gymnasium.make(env_id)
    observation, _ = single.reset(seed=1)
    assert observation.tolist() == observations[1].tolist()


def drawn(env_id: str, tmp_path: Path) -> None:
    env = gymnasium.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    picture: Any = env.render()
    assert picture.std() > 0


def learned_with_make_vec_env(env_id: str, tmp_path: Path) -> None:
    learns(make_vec_env(env_id, n_envs=2))


def learned_in_a_batch(env_id: str, tmp_path: Path) -> None:
    learns(RoughTurningVecEnv(SOURCES[env_id], 2))


def taken_by_torchrl(env_id: str, tmp_path: Path) -> None:
    pytest.importorskip("torchrl")
    from torchrl.envs import GymWrapper, check_env_specs  # type: ignore[import-untyped]

    envs = gymnasium.make_vec(env_id, num_envs=2, autoreset_mode="Disabled")
    check_env_specs(GymWrapper(envs))


def scored(env_id: str, tmp_path: Path) -> None:
    result = score(idle(env_id), env_id, seeds=2)
    if result.rank is None:
        # The published simulation ranks rules only.
        assert "wear rule" in str(result.warning)
    else:
        assert 1 < result.rank <= result.ranked


FEW_STEPS = {"total_timesteps": 64, "n_steps": 8, "batch_size": 32}
"""Hyperparameters of a training of one update."""


def train_and_export(env_id: str, folder: Path) -> Path:
    """Train an agent for a few steps, and return its file."""
    train = ["--env", env_id, "--seed", "3", "--runs", str(folder)]
    for name, value in (PARAMETERS["ppo"] | FEW_STEPS).items():
        train += ["--set", f"{name}={value}"]
    assert ppo.main(train) == 0

    run = folder / env_id / SOURCES[env_id] / "ppo-seed3"
    assert export.main([str(run), "--out", str(folder)]) == 0
    return folder / "ppo-seed3.onnx"


def trained_exported_and_ranked(env_id: str, tmp_path: Path) -> None:
    """Check that an agent is trained, exported, played, shown and verified by the commands."""
    agent = train_and_export(env_id, tmp_path)
    results = ["--results", str(tmp_path / "results")]
    task = ["--env", env_id, *results]

    agents = ["--policies", "--agents", str(agent), "--keep-names"]
    assert leaderboard(["run", *task, "--seeds", "1", *agents]) == 0
    assert leaderboard(["show", *task]) == 0
    assert leaderboard(["page", *results]) == 0
    memory = ["--memory", str(tmp_path / "memory.json")]
    assert leaderboard(["verify", *task, *memory, "--agents", str(tmp_path)]) == 0


def recorded_for_minari(env_id: str, tmp_path: Path) -> None:
    pytest.importorskip("minari")
    from examples.offline import main

    behaviour = "load_rule" if env_id == "RoughTurning-v0" else "idle"
    make = ["make", "--env", env_id, "--behaviours", behaviour, "--episodes", "1"]
    assert main([*make, "--out", str(tmp_path)]) == 0


DOORS = (
    made_by_gymnasium,
    drawn,
    scored,
    pytest.param(learned_with_make_vec_env, marks=pytest.mark.slow),
    pytest.param(learned_in_a_batch, marks=pytest.mark.slow),
    pytest.param(taken_by_torchrl, marks=pytest.mark.slow),
    pytest.param(recorded_for_minari, marks=pytest.mark.slow),
    pytest.param(trained_exported_and_ranked, marks=pytest.mark.slow),
)


@pytest.mark.parametrize("env_id", ALL_IDS)
@pytest.mark.parametrize("door", DOORS)
def test_every_id_is(door: Callable[[str, Path], None], env_id: str, tmp_path: Path) -> None:
    door(env_id, tmp_path)
