"""Make, check and play every task of an installed wheel, single and as a batch, without the clone.

Then print the digest of all presets' trajectories, which must not depend on the version of Python.

``studies/wheel.py`` runs this file with the Python into which the wheel was installed, from an empty folder.
"""

import hashlib
import sys
from importlib.metadata import Distribution, distribution
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env

import turning_env

DIGEST = "digest of what all presets gave: "


def check_contents(installed: Distribution) -> None:
    """Check that the distribution holds one package, its own records and its licence only."""
    files = installed.files or []
    top = {file.parts[0] for file in files}
    records = {name for name in top if name.endswith(".dist-info")}
    assert top - records == {"turning_env", "turning_render", "turning_shop", "turning_nc", "turning_control"}, top
    assert len(records) == 1, records
    assert installed.metadata["License-Expression"] == "MIT"
    licences = [file for file in files if file.parts[1:] == ("licenses", "LICENSE")]
    assert [file.read_text().startswith("MIT License") for file in licences] == [True], licences


def check_task(env_id: str) -> None:
    """Check a task's interface with Gymnasium's checker, and play a few steps, single and as a batch."""
    env = gymnasium.make(env_id)
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=1)
    env.action_space.seed(1)
    rewards = [env.step(env.action_space.sample())[1] for _ in range(3)]
    assert np.isfinite(np.array(rewards, float)).all(), rewards
    envs = gymnasium.make_vec(env_id, num_envs=4, vectorization_mode="vector_entry_point")
    observations, _ = envs.reset(seed=1)
    assert observations.shape == (4, *env.observation_space.shape)  # type: ignore[misc]
    rewards = envs.step(envs.action_space.sample())[1]
    assert np.isfinite(rewards).all(), rewards
    env.close()
    envs.close()


def digest_of_plays(steps: int = 60) -> str:
    """Return the SHA-256 of every preset's first steps in two episodes, single and as a batch of three."""
    whole = hashlib.sha256()
    for preset in turning_env.presets():
        env, envs = turning_env.RoughTurningEnv(preset), turning_env.RoughTurningVectorEnv(3, preset)
        generator = np.random.default_rng(21)
        for seed in range(2):
            whole.update(env.reset(seed=seed)[0].tobytes() + envs.reset(seed=seed)[0].tobytes())
            ended = False
            for actions in generator.uniform(-1.0, 1.0, (steps, *envs.action_space.shape)):  # type: ignore[misc]
                observations, rewards, *_ = envs.step(actions)
                whole.update(observations.tobytes() + rewards.tobytes())
                if not ended:
                    observation, reward, terminated, truncated, info = env.step(actions[0])
                    whole.update(observation.tobytes() + repr((reward, sorted(info.items()))).encode())
                    ended = terminated or truncated
        envs.close()
    return whole.hexdigest()


def main() -> None:
    """Check everything and print progress."""
    home = Path(turning_env.__file__).resolve()
    assert home.is_relative_to(Path(sys.prefix).resolve()), f"{home} is not of this environment"
    check_contents(distribution("rough-turning"))
    for env_id in turning_env.IDS:
        check_task(env_id)
        print(f"{env_id}: made, checked and played", flush=True)
    print(f"{DIGEST}{digest_of_plays()}")
