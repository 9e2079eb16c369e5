"""Observations by name: the same numbers as without names, single and in a batch."""

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import FilterObservation, FrameStackObservation
from stable_baselines3 import PPO

from tests.turning_env.playing import SHORT_LIVED
from turning_env import (
    FAMILY_ID,
    OBS,
    NamedObservation,
    NamedVectorObservation,
    RoughTurningEnv,
    RoughTurningVectorEnv,
)
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv


def test_entries_have_the_names_of_the_specification() -> None:
    env = NamedObservation(gymnasium.make("RoughTurning-v0"))
    observation, _ = env.reset(seed=3)
    plain, _ = gymnasium.make("RoughTurning-v0").reset(seed=3)
    assert observation in env.observation_space
    assert list(observation)[:2] == ["power", "thrust_force"]
    assert observation["cutting_speed"].tolist() == [plain[OBS.cutting_speed]]
    np.testing.assert_array_equal(np.concatenate([*observation.values()]), plain)


def test_numbers_of_a_nominal_model_are_the_context() -> None:
    env = NamedObservation(gymnasium.make(FAMILY_ID))
    observation, _ = env.reset(seed=3)
    plain, _ = gymnasium.make(FAMILY_ID).reset(seed=3)
    assert observation in env.observation_space
    np.testing.assert_array_equal(observation["context"], plain[-observation["context"].size :])
    assert observation["removed_wear"].shape == (1,)


def test_a_batch_gives_what_single_environments_give() -> None:
    batch = RoughTurningVectorEnv(3, SHORT_LIVED, "SameStep")
    envs = NamedVectorObservation(batch)
    plain = RoughTurningVectorEnv(3, SHORT_LIVED, "SameStep")
    observations, _ = envs.reset(seed=5)
    plain.reset(seed=5)
    assert observations in envs.observation_space
    num_ended = 0
    for step in range(40):
        actions = np.full((3, 2), np.sin(step), np.float32)
        observations, _, _, _, infos = envs.step(actions)
        expected, _, _, _, expected_infos = plain.step(actions)
        np.testing.assert_array_equal(np.hstack([*observations.values()]), expected)
        for index in np.flatnonzero(infos.get("_final_obs", np.zeros(3))):
            num_ended += 1
            final = infos["final_obs"][index]
            assert final in envs.single_observation_space
            expected_final = expected_infos["final_obs"][index]
            np.testing.assert_array_equal(np.concatenate([*final.values()]), expected_final)
    assert num_ended > 0


def test_a_policy_for_dictionaries_learns_on_the_batch() -> None:
    env = RoughTurningVecEnv(SHORT_LIVED, 2, wrapper=NamedVectorObservation)
    PPO(
        "MultiInputPolicy",
        env,
        n_steps=32,
        batch_size=16,
        n_epochs=1,
        device="cpu",
    ).learn(64)


def test_a_stored_spec_holds_the_wrapper() -> None:
    env = NamedObservation(gymnasium.make("RoughTurning-Surface-v1"))
    assert env.spec is not None
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.observation_space == env.observation_space


def test_entries_can_be_hidden() -> None:
    env = FilterObservation(NamedObservation(RoughTurningEnv()), ["power", "feed"])
    observation, _ = env.reset(seed=0)
    assert list(observation) == ["power", "feed"]


def test_changed_observations_have_no_names() -> None:
    with pytest.raises(ValueError, match="apply this wrapper before others"):
        NamedObservation(FrameStackObservation(RoughTurningEnv(), 2))
