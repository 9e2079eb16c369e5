import numpy as np
import pytest

from turning_env import RoughTurningEnv, Scenario
from turning_env.scoring.play import EPISODE_FIELDS, LAST, SUMS, play

SHORT = Scenario.load("rough_turning").model_copy(
    update={"tool": Scenario().tool.model_copy(update={"wear_criterion": 0.13})}
)


class Wavy:
    """Acts by the clock of each environment, so that a missed reset shows."""

    def __init__(self, num_envs: int) -> None:
        self.age = np.zeros(num_envs)

    def reset(self, mask: np.ndarray) -> None:
        self.age[mask] = 0

    def act(self, observations: np.ndarray) -> np.ndarray:
        self.age += 1
        return np.stack([np.sin(self.age), np.cos(self.age)], axis=1).astype(np.float32)


def test_every_sum_is_that_of_the_single_environment() -> None:
    seeds = [5, 900, 17]
    episodes = play(Wavy, SHORT, seeds)
    assert set(episodes) == set(EPISODE_FIELDS)
    for index, seed in enumerate(seeds):
        env, policy = RoughTurningEnv(SHORT), Wavy(1)
        observation, info = env.reset(seed=seed)
        policy.reset(np.ones(1, np.bool_))
        infos, rewards, ended = [], [], False
        while not ended:
            observation, reward, terminated, truncated, info = env.step(
                policy.act(observation[np.newaxis])[0]
            )
            infos.append(info)
            rewards.append(reward)
            ended = terminated or truncated
        assert episodes["return"][index] == pytest.approx(sum(rewards), rel=1e-12)
        assert episodes["steps"][index] == len(rewards)
        for name in SUMS:
            assert episodes[name][index] == pytest.approx(
                sum(info[name] for info in infos), rel=1e-12
            )
        assert episodes["excess"][index] == pytest.approx(
            sum(info["cost"] * info["time"] for info in infos), rel=1e-12
        )
        for name in LAST:
            assert episodes[name][index] == info[name]
        assert episodes["truncated"][index] == truncated
