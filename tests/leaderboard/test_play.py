"""Episodes that are played in a batch."""

from typing import Any

import numpy as np
import pytest

from leaderboard.play import EPISODE_FIELDS, LAST, SUMS, play
from tests.turning_env.playing import changed
from turning_env import RoughTurningEnv

SHORT = changed("rough_turning", tool={"wear_criterion": 0.13})
SEEDS = [5, 900, 17]


class Wavy:
    """Acts by the clock of each environment, so that a missed reset shows."""

    def __init__(self, num_envs: int) -> None:
        self.age = np.zeros(num_envs)

    def reset(self, mask: np.ndarray) -> None:
        self.age[mask] = 0

    def act(self, observations: np.ndarray) -> np.ndarray:
        self.age += 1
        return np.stack([np.sin(self.age), np.cos(self.age)], axis=1).astype(np.float32)


def infos_of_episode(seed: int) -> list[dict[str, Any]]:
    """Play an episode in a single environment; return the infos of its steps, with rewards."""
    env = RoughTurningEnv(SHORT)
    policy = Wavy(1)
    policy.reset(np.ones(1, np.bool_))
    observation, _ = env.reset(seed=seed)
    infos: list[dict[str, Any]] = []
    ended = False
    while not ended:
        action = policy.act(observation[np.newaxis])[0]
        observation, reward, terminated, truncated, info = env.step(action)
        infos.append(info | {"reward": reward, "truncated": truncated})
        ended = terminated or truncated
    return infos


def test_every_sum_is_that_of_the_single_environment() -> None:
    episodes = play(Wavy, SHORT, SEEDS)
    assert set(episodes) == set(EPISODE_FIELDS)
    for index, seed in enumerate(SEEDS):
        infos = infos_of_episode(seed)
        expected = {name: sum(info[name] for info in infos) for name in SUMS}
        expected["return"] = sum(info["reward"] for info in infos)
        expected["excess"] = sum(info["excess"] * info["time"] for info in infos)
        for name, value in expected.items():
            assert episodes[name][index] == pytest.approx(value, rel=1e-12), name
        assert episodes["steps"][index] == len(infos)
        for name in (*LAST, "truncated"):
            assert episodes[name][index] == infos[-1][name], name
