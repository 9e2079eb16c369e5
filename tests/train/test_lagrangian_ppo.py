"""The multiplier replaces the price of severe overload, and follows the severe share of cutting time."""

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
FASTER = np.ones((4, 2), np.float32)


def test_severe_overload_costs_the_multiplier_in_place_of_its_price() -> None:
    ours, theirs = AllowanceVecEnv(OVERLOADING, 4, 0.5), RoughTurningVecEnv(OVERLOADING, 4)
    reference = RoughTurningVectorEnv(4, OVERLOADING, "SameStep")
    ours.multiplier = 7.0
    for each in (ours, theirs):
        each.seed(5)
        each.reset()
    reference.reset(seed=5)
    ends, severe_time, engaged_time = 0, 0.0, 0.0
    for _ in range(300):
        _, rewards, dones, infos = ours.step(FASTER)
        _, full_rewards, _, full_infos = theirs.step(FASTER)
        *_, terms = reference.step(FASTER)
        names = ("reward_overload", "severe_overload_time", "engaged_time")
        overload, severe, engaged = (info_at_end_of_step(terms, name) for name in names)
        np.testing.assert_allclose(
            rewards, 0.5 * (full_rewards - overload - 7.0 * severe), rtol=1e-5, atol=1e-4
        )
        severe_time, engaged_time = severe_time + severe.sum(), engaged_time + engaged.sum()
        for index in np.flatnonzero(dones):
            assert (
                infos[index]["episode"] == full_infos[index]["episode"]
            )  # the environment's own return
            ends += 1
    assert ends > 3
    assert severe_time > 0.0
    share = severe_time / engaged_time
    for target in (0.5 * share, 2.0 * share):  # nothing is cut between the two
        ours.adapt(target, 2.0)
    assert ours.severe_share == pytest.approx(share)
    assert ours.multiplier == pytest.approx(7.0 * math.exp(2.0 * 0.5 * share))
