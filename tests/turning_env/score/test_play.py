import numpy as np
import pytest

from baselines.catalogue import names, playable, spec
from baselines.rule import Rule
from tests.turning_env.playing import changed
from turning_env import SPLITS, RoughTurningEnv, RoughTurningVectorEnv, Scenario, presets
from turning_env.score.play import EPISODE_FIELDS, LAST, SUMS, play
from turning_env.score.policy import Policy

SHORT = Scenario.load("rough_turning").model_copy(update={"tool": Scenario().tool.model_copy(update={"wear_criterion": 0.13})})


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
            observation, reward, terminated, truncated, info = env.step(policy.act(observation[np.newaxis])[0])
            infos.append(info)
            rewards.append(reward)
            ended = terminated or truncated
        assert episodes["return"][index] == pytest.approx(sum(rewards), rel=1e-12)
        assert episodes["steps"][index] == len(rewards)
        for name in SUMS:
            assert episodes[name][index] == pytest.approx(sum(info[name] for info in infos), rel=1e-12)
        assert episodes["excess"][index] == pytest.approx(sum(info["cost"] * info["time"] for info in infos), rel=1e-12)
        for name in LAST:
            assert episodes[name][index] == info[name]
        assert episodes["truncated"][index] == truncated


# A few steps of every task.
FEW = {
    "rough_turning": {"control": {"time_limit": 1.0}},
    "paper": {"control": {"time_limit": 5.0}},
    "override": {"control": {"time_limit": 0.03}},
    "override_current": {"control": {"time_limit": 0.03}},
    "rough_turning_current": {"control": {"time_limit": 1.0}},
    "surface": {"control": {"time_limit": 0.03}},
    "shift": {"control": {"time_limit": 3.0}, "economics": {"edge_change_time": 0.5}},
    "batch_casting": {"workpiece": {"bars": 3}},
}
SLOW = ("optimiser", "predictive")
PLAYED = [
    pytest.param(preset, name, marks=[pytest.mark.slow] if name in SLOW else [])
    for preset in FEW
    for name in names(Scenario.load(preset))
]


def middle(rule: Rule) -> dict[str, float]:
    """Every tuned parameter in the middle of its range."""
    return rule.fixed | {name: 0.5 * (found.low + found.high) for name, found in rule.ranges.items()}


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "name"), PLAYED)
def test_a_rule_plays_an_environment_as_it_would_alone(preset: str, name: str) -> None:
    scenario = changed(Scenario.load(preset), **FEW[preset])
    rule = playable(name, scenario)

    def make(num_envs: int) -> Policy:
        return rule.build(scenario, num_envs, middle(rule))

    together = play(make, scenario, [1, 2, 3])
    alone = play(make, scenario, [2])
    for field in EPISODE_FIELDS:
        assert together[field][1] == alone[field][0]


@pytest.mark.parametrize(("preset", "name"), PLAYED)
def test_rules_are_policies(preset: str, name: str) -> None:
    """Whatever is observed, at the ends of the space and in its middle, the actions are within theirs."""
    scenario = Scenario.load(preset)
    rule = playable(name, scenario)
    env = RoughTurningVectorEnv(2, scenario)
    policy = rule.build(scenario, 2, middle(rule))
    policy.reset(np.ones(2, np.bool_))
    low, high = env.observation_space.low, env.observation_space.high
    for observations in (0.5 * (low + high), low, high, low, env.reset(seed=0)[0]):
        actions = policy.act(observations.astype(np.float32))
        assert actions.shape == env.action_space.shape
        assert actions.dtype == np.float32
        assert (np.abs(actions) <= 1.0).all()


@pytest.mark.parametrize("preset", presets())
def test_every_preset_is_tuned_or_a_split_of_one_that_is(preset: str) -> None:
    scenario = Scenario.load(preset)
    tuned_on = Scenario.load("rough_turning") if preset in SPLITS else None
    for name in names(scenario):
        assert spec(name, scenario, tuned_on).parameters.keys() == playable(name, scenario).parameters.keys()
