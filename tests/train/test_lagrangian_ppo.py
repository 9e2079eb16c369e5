"""The multiplier replaces the price of severe overload, and follows its share of cutting time."""

import math

import numpy as np
import pytest

from train.lagrangian_ppo import AllowanceVecEnv
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.vector_env import info_at_end_of_step

OVERLOADING = Scenario.model_validate(
    {"name": "weak", "tool": {"wear_criterion": 0.1}, "limits": {"thrust_force": 300.0}}
)
NUM_ENVS = 4
FASTER = np.ones((NUM_ENVS, 2), np.float32)
MULTIPLIER = 7.0


def test_severe_overload_costs_the_multiplier_in_place_of_its_price() -> None:
    env = AllowanceVecEnv(OVERLOADING, NUM_ENVS, reward_scale=0.5)
    env.multiplier = MULTIPLIER
    plain_env = RoughTurningVecEnv(OVERLOADING, NUM_ENVS)
    for vec_env in (env, plain_env):
        vec_env.seed(5)
        vec_env.reset()
    # Its infos hold the terms of the rewards.
    vector_env = RoughTurningVectorEnv(NUM_ENVS, OVERLOADING, "SameStep")
    vector_env.reset(seed=5)

    ended_episodes = 0
    severe_time = 0.0
    engaged_time = 0.0
    for _ in range(300):
        _, rewards, ended, infos = env.step(FASTER)
        _, plain_rewards, _, plain_infos = plain_env.step(FASTER)
        *_, terms = vector_env.step(FASTER)
        overload = info_at_end_of_step(terms, "reward_overload")
        severe = info_at_end_of_step(terms, "severe_overload_time")
        expected = 0.5 * (plain_rewards - overload - MULTIPLIER * severe)
        np.testing.assert_allclose(rewards, expected, rtol=1e-5, atol=1e-4)
        severe_time += severe.sum()
        engaged_time += info_at_end_of_step(terms, "engaged_time").sum()
        for index in np.flatnonzero(ended):
            # The return remains the environment's own.
            assert infos[index]["episode"] == plain_infos[index]["episode"]
            ended_episodes += 1
    assert ended_episodes > 3
    assert severe_time > 0.0

    share = severe_time / engaged_time
    env.adapt(target=0.5 * share, rate=2.0)
    assert env.severe_share == pytest.approx(share)
    adapted = MULTIPLIER * math.exp(2.0 * 0.5 * share)
    assert env.multiplier == pytest.approx(adapted)
    # Nothing is cut between the two, so there is no share to adapt to.
    env.adapt(target=2.0 * share, rate=2.0)
    assert env.multiplier == pytest.approx(adapted)
