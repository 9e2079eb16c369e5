"""The batch behind other libraries' interfaces gives what single environments give."""

from typing import Any

import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from tests.turning_env.playing import changed
from tests.turning_env.test_family_env import BRIEF_FAMILY
from turning_env import Family, FamilyEnv, RoughTurningEnv, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv

# Episodes of at most 12 steps, ending in breakage as well as out of time.
SHORT = Scenario.model_validate({"tool": {"edge_strength": 900.0}, "control": {"time_limit": 0.2}})


NUM_ENVS = 5
SCALE = 0.5  # of rewards
STEPS = 60


def single_environment(scenario: Scenario | Family) -> Monitor:
    """Return an environment with the wrapper of Stable-Baselines3 that sums up episodes."""
    if isinstance(scenario, Family):
        return Monitor(FamilyEnv(scenario))
    return Monitor(RoughTurningEnv(scenario))


def assert_same_info(info: dict[str, Any], expected: dict[str, Any]) -> None:
    """Assert that the infos of an environment whose episode has ended agree."""
    np.testing.assert_array_equal(info["terminal_observation"], expected["terminal_observation"])
    assert info["TimeLimit.truncated"] == expected["TimeLimit.truncated"]
    # Returns are not scaled.
    returned = expected["episode"]["r"]
    assert info["episode"]["r"] == pytest.approx(returned, rel=1e-5, abs=1e-5)
    assert info["episode"]["l"] == expected["episode"]["l"]


@pytest.mark.parametrize(
    ("scenario", "kinds_of_end"),
    [
        pytest.param(SHORT, {True, False}, id="rough_turning"),
        pytest.param(
            changed("override", workpiece={"bar_length": 1.0, "approach": 0.1}),
            {False},
            id="override",
        ),
        pytest.param(changed("surface", control={"time_limit": 0.003}), {True}, id="surface"),
        pytest.param(
            changed("shift", control={"time_limit": 5.0}, tool={"edge_strength": 900.0}),
            {True},
            id="shift",
        ),
        pytest.param(changed("batch_casting", workpiece={"bars": 3}), {False}, id="batch"),
        pytest.param(BRIEF_FAMILY, {True}, id="family"),
    ],
)
def test_it_agrees_with_the_vector_environment_of_stable_baselines3(
    scenario: Scenario | Family, kinds_of_end: set[bool]
) -> None:
    env = RoughTurningVecEnv(scenario, NUM_ENVS, SCALE)
    expected_env = DummyVecEnv([lambda: single_environment(scenario)] * NUM_ENVS)
    env.seed(40)
    expected_env.seed(40)
    np.testing.assert_array_equal(env.reset(), expected_env.reset())
    (size,) = env.action_space.shape or ()
    phase = np.arange(NUM_ENVS * size).reshape(NUM_ENVS, size)
    truncated = set()
    for step in range(STEPS):
        actions = np.sin(phase + 0.2 * step).astype(np.float32)
        observations, rewards, dones, infos = env.step(actions)
        expected_observations, expected_rewards, expected_dones, expected_infos = expected_env.step(
            actions
        )
        np.testing.assert_array_equal(observations, expected_observations)
        np.testing.assert_array_equal(dones, expected_dones)
        np.testing.assert_allclose(rewards, SCALE * expected_rewards, rtol=1e-6)
        assert rewards.dtype == np.float32
        for done, info, expected_info in zip(
            dones,
            infos,
            expected_infos,
            strict=True,
        ):
            if done:
                assert_same_info(info, expected_info)
                truncated.add(info["TimeLimit.truncated"])
            else:
                assert info == {}
    assert truncated == kinds_of_end


def test_evaluate_policy_reports_returns_whatever_the_scale_of_rewards() -> None:
    """Warnings, such as that there is no Monitor, count as errors."""

    def evaluated(reward_scale: float) -> Any:
        env = RoughTurningVecEnv(SHORT, NUM_ENVS, reward_scale)
        env.seed(40)
        model = PPO("MlpPolicy", env, seed=1, device="cpu")
        return evaluate_policy(
            model,
            env,
            2 * NUM_ENVS,
            return_episode_rewards=True,
        )

    assert evaluated(SCALE) == evaluated(1.0)
