"""TorchRL: its own checks of every id, and that a batch plays as single environments."""

from typing import Any

import numpy as np
import pytest

from turning_env import IDS, RoughTurningEnv

pytest.importorskip("torchrl")

from examples.torch_rl import batch, main, one


def test_every_id_passes_its_check(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--steps", "40", "--num-envs", "8"]) == 0
    said = capsys.readouterr().out
    assert all(f"{env_id}: checked; after " in said for env_id in IDS)
    assert "SerialEnv of 4: (4, 40)" in said
    assert "GymWrapper of 8 environments: (8, 5)" in said


def check_plays_alike(rollout: Any, seed: int) -> None:
    """See that a rollout is of the seed's second episode: TorchRL starts the first one when it sets the seed."""
    env = RoughTurningEnv()
    env.reset(seed=seed)
    observation, _ = env.reset()
    for step in range(len(rollout)):
        np.testing.assert_array_equal(rollout["observation"][step].numpy(), observation)
        observation, reward, _, _, info = env.step(rollout["action"][step].numpy())
        assert rollout["next", "reward"][step].item() == np.float32(reward)
        if "wear" in rollout["next"]:
            assert rollout["next", "wear"][step].item() == info["wear"]


def test_one_environment_plays_alike() -> None:
    check_plays_alike(one("RoughTurning-v0", 3).rollout(30), 3)


def test_a_batch_plays_as_environments_of_seeds_in_a_row() -> None:
    for index, rollout in enumerate(batch(3, 5).rollout(30)):
        check_plays_alike(rollout, 5 + index)
