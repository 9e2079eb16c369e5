"""Every id by every way into it: the cells of the table in docs/ecosystem.md."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from leaderboard.__main__ import main as leaderboard
from tests.train.small import PARAMETERS
from train import export, ppo
from turning_env import FAMILY_ID, IDS, score
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv

ALL = (*IDS, FAMILY_ID)
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
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=16, n_epochs=1, device="cpu")
    model.learn(total_timesteps=16)
    action, _ = model.predict(env.reset())
    assert np.isfinite(action).all()


def made_by_gymnasium(env_id: str, tmp_path: Path) -> None:
    envs = gymnasium.make_vec(
        env_id, num_envs=2, vectorization_mode="vector_entry_point", autoreset_mode="SameStep"
    )
    observations, _ = envs.reset(seed=0)
    assert observations in envs.observation_space
    # The second environment has the second seed.
    observation, _ = gymnasium.make(env_id).reset(seed=1)
    assert observation.tolist() == observations[1].tolist()


def drawn(env_id: str, tmp_path: Path) -> None:
    env = gymnasium.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    assert env.render().std() > 0  # type: ignore[union-attr]


def learned_with_make_vec_env(env_id: str, tmp_path: Path) -> None:
    learns(make_vec_env(env_id, n_envs=2))


def learned_in_a_batch(env_id: str, tmp_path: Path) -> None:
    learns(RoughTurningVecEnv(SOURCES[env_id], 2))


def taken_by_torchrl(env_id: str, tmp_path: Path) -> None:
    pytest.importorskip("torchrl")
    from torchrl.envs import GymWrapper, check_env_specs  # type: ignore[import-untyped]

    check_env_specs(GymWrapper(gymnasium.make_vec(env_id, 2, autoreset_mode="Disabled")))


def scored(env_id: str, tmp_path: Path) -> None:
    result = score(idle(env_id), env_id, seeds=2)
    assert 1 < result.rank <= result.ranked


def trained_exported_and_ranked(env_id: str, tmp_path: Path) -> None:
    few = PARAMETERS["ppo"] | {"total_timesteps": 64, "n_steps": 8, "batch_size": 32}
    words = ["--env", env_id, "--seed", "3", "--runs", str(tmp_path)]
    for name, value in few.items():
        words += ["--set", f"{name}={value}"]
    assert ppo.main(words) == 0
    folder = tmp_path / env_id / SOURCES[env_id] / "ppo-seed3"
    assert export.main([str(folder), "--out", str(tmp_path)]) == 0
    results = ["--results", str(tmp_path / "results")]
    played = ["--policies", "--agents", str(tmp_path / "ppo-seed3.onnx"), "--keep-names"]
    assert leaderboard(["run", "--env", env_id, "--seeds", "2", *results, *played]) == 0
    assert leaderboard(["show", "--env", env_id, *results]) == 0
    assert leaderboard(["page", *results]) == 0
    verified = ["--memory", str(tmp_path / "memory.json"), "--agents", str(tmp_path)]
    assert leaderboard(["verify", "--env", env_id, *results, *verified]) == 0


def recorded_for_minari(env_id: str, tmp_path: Path) -> None:
    pytest.importorskip("minari")
    from examples.offline import main

    behaviour = "load_rule" if env_id == "RoughTurning-v0" else "idle"
    words = ["make", "--env", env_id, "--behaviours", behaviour]
    words += ["--episodes", "1", "--out", str(tmp_path)]
    assert main(words) == 0


DOORS = (
    made_by_gymnasium,
    drawn,
    learned_with_make_vec_env,
    learned_in_a_batch,
    taken_by_torchrl,
    scored,
    recorded_for_minari,
    pytest.param(trained_exported_and_ranked, marks=pytest.mark.slow),
)


@pytest.mark.parametrize("env_id", ALL)
@pytest.mark.parametrize("door", DOORS)
def test_every_id_is(door: Callable[[str, Path], None], env_id: str, tmp_path: Path) -> None:
    door(env_id, tmp_path)
