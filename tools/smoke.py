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
    assert envs.reset(seed=1)[0].shape == (4, *env.observation_space.shape)  # type: ignore[misc]
    for each in (env, envs):
        each.action_space.seed(1)
        rewards: Any = [each.step(each.action_space.sample())[1] for _ in range(3)]
        assert np.isfinite(rewards).all(), rewards
        each.close()


def digest_of_plays(steps: int = 60) -> str:
    """Return the SHA-256 of every preset's first steps in two episodes, single and as a batch."""
    whole = hashlib.sha256()
    for preset in turning_env.presets():
        env, envs = (
            turning_env.RoughTurningEnv(preset),
            turning_env.RoughTurningVectorEnv(3, preset),
        )
        generator = np.random.default_rng(21)
        for seed in range(2):
            whole.update(env.reset(seed=seed)[0].tobytes() + envs.reset(seed=seed)[0].tobytes())
            ended = False
            for actions in generator.uniform(-1.0, 1.0, (steps, *envs.action_space.shape)):  # type: ignore[misc]
                observations, rewards, *_ = envs.step(actions)
                whole.update(observations.tobytes() + rewards.tobytes())
                if not ended:
                    observation, reward, terminated, truncated, info = env.step(actions[0])
                    whole.update(
                        observation.tobytes() + repr((reward, sorted(info.items()))).encode()
                    )
                    ended = terminated or truncated
        envs.close()
    return whole.hexdigest()


def main() -> None:
    """Check everything and print the digest."""
    home = Path(turning_env.__file__).resolve()
    assert home.is_relative_to(Path(sys.prefix).resolve()), f"{home} is not of this environment"
    for env_id in turning_env.IDS:
        check_task(env_id)
    print(f"{DIGEST}{digest_of_plays()}")
