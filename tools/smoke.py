"""Make, check and play every task of an installed wheel, single and as a batch, without the clone.

Then print the digest of all presets' trajectories, which must not depend on the version of Python.
``tools/wheel.py`` runs this file with the Python into which the wheel was installed, from an empty
folder.
"""

import hashlib
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env

import turning_env

DIGEST = "digest of what all presets gave: "


def check_task(env_id: str) -> None:
    """Check a task with Gymnasium's checker, and play a few steps, single and as a batch."""
    env = gymnasium.make(env_id)
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=1)
    envs = gymnasium.make_vec(env_id, num_envs=4, vectorization_mode="vector_entry_point")
    observations, _ = envs.reset(seed=1)
    assert observations.shape == (4, *env.observation_space.shape)  # type: ignore[misc]
    steps_finitely(env)
    steps_finitely(envs)


def steps_finitely(env: Any) -> None:
    """Take a few steps, single or as a batch, check that rewards are finite, and close."""
    env.action_space.seed(1)
    for _ in range(3):
        _, rewards, *_ = env.step(env.action_space.sample())
        assert np.isfinite(rewards).all(), rewards
    env.close()


def digest_of_plays(steps: int = 60) -> str:
    """Return the SHA-256 of every preset's first steps in two episodes, single and as a batch."""
    digest = hashlib.sha256()
    for preset in turning_env.presets():
        env = turning_env.RoughTurningEnv(preset)
        envs = turning_env.RoughTurningVectorEnv(3, preset)
        generator = np.random.default_rng(21)
        for seed in range(2):
            observation, _ = env.reset(seed=seed)
            observations, _ = envs.reset(seed=seed)
            digest.update(observation.tobytes())
            digest.update(observations.tobytes())
            ended = False
            shape = (steps, *envs.action_space.shape)  # type: ignore[misc]
            for actions in generator.uniform(-1.0, 1.0, shape):
                observations, rewards, *_ = envs.step(actions)
                digest.update(observations.tobytes())
                digest.update(rewards.tobytes())
                if not ended:
                    observation, reward, terminated, truncated, info = env.step(actions[0])
                    digest.update(observation.tobytes())
                    digest.update(repr((reward, sorted(info.items()))).encode())
                    ended = terminated or truncated
        envs.close()
    return digest.hexdigest()


def main() -> None:
    """Check everything and print the digest."""
    home = Path(turning_env.__file__).resolve()
    assert home.is_relative_to(Path(sys.prefix).resolve()), f"{home} is not of this environment"
    for env_id in turning_env.IDS:
        check_task(env_id)
    print(f"{DIGEST}{digest_of_plays()}")
