import numpy as np
import pytest

from baselines.catalogue import RULES, entry
from baselines.play import EPISODE_FIELDS, LAST, SUMS, play
from baselines.policy import Policy
from turning_env import RoughTurningEnv, Scenario, presets

SHORT = Scenario.load("rough_turning").model_copy(update={"tool": Scenario().tool.model_copy(update={"wear_criterion": 0.13})})


class Wavy:
    """Acts by the clock of each lane, so that a missed reset shows."""

    def __init__(self, lanes: int) -> None:
        self.age = np.zeros(lanes)

    def reset(self, lanes: np.ndarray) -> None:
        self.age[lanes] = 0

    def act(self, observations: np.ndarray) -> np.ndarray:
        self.age += 1
        return np.stack([np.sin(self.age), np.cos(self.age)], axis=1).astype(np.float32)


def test_every_sum_is_that_of_the_single_environment() -> None:
    seeds = [5, 900, 17]
    episodes = play(Wavy, SHORT, seeds)
    assert set(episodes) == set(EPISODE_FIELDS)
    for lane, seed in enumerate(seeds):
        env, policy = RoughTurningEnv(SHORT), Wavy(1)
        observation, info = env.reset(seed=seed)
        policy.reset(np.ones(1, np.bool_))
        infos, rewards, ended = [], [], False
        while not ended:
            observation, reward, terminated, truncated, info = env.step(policy.act(observation[np.newaxis])[0])
            infos.append(info)
            rewards.append(reward)
            ended = terminated or truncated
        assert episodes["return"][lane] == pytest.approx(sum(rewards), rel=1e-12)
        assert episodes["intervals"][lane] == len(rewards)
        for name in SUMS:
            assert episodes[name][lane] == pytest.approx(sum(info[name] for info in infos), rel=1e-12)
        assert episodes["excess"][lane] == pytest.approx(sum(info["cost"] * info["time"] for info in infos), rel=1e-12)
        for name in LAST:
            assert episodes[name][lane] == info[name]
        assert episodes["truncated"][lane] == truncated


@pytest.mark.parametrize("name", RULES)
def test_a_rule_plays_a_lane_as_it_would_alone(name: str) -> None:
    make = entry(name, Scenario.load("rough_turning")).make
    together = play(make, SHORT, [1, 2, 3])
    alone = play(make, SHORT, [2])
    for field in EPISODE_FIELDS:
        assert together[field][1] == alone[field][0]


def test_progress_is_told() -> None:
    counts: list[int] = []
    play(Wavy, SHORT, [1, 2], counts.append)
    assert counts[0] == 0
    assert counts[-1] == 2
    assert counts == sorted(counts)


def test_rules_are_policies() -> None:
    for name in RULES:
        policy: Policy = entry(name, Scenario.load("rough_turning")).make(2)
        policy.reset(np.ones(2, np.bool_))
        actions = policy.act(np.zeros((2, 11), np.float32))
        assert actions.shape == (2, 2)
        assert actions.dtype == np.float32


@pytest.mark.parametrize("preset", presets())
def test_every_preset_is_tuned(preset: str) -> None:
    scenario = Scenario.load(preset)
    assert entry("rescaled_grid_search", scenario).parameters["margin"] > 0
