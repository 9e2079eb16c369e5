"""The batch behind other libraries' interfaces gives what single environments give."""

import numpy as np
import pytest
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from tests.turning_env.playing import changed
from tests.turning_env.test_family_env import BRIEF
from turning_env import Family, FamilyEnv, RoughTurningEnv, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv

# Episodes of at most 12 steps, ending in breakage as well as out of time.
SHORT = Scenario.model_validate({"tool": {"edge_strength": 900.0}, "control": {"time_limit": 0.2}})


@pytest.mark.parametrize(
    ("scenario", "kinds"),
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
        pytest.param(Family.load(BRIEF), {True}, id="family"),
    ],
)
def test_it_says_what_stable_baselines_own_vec_env_says(
    scenario: Scenario | Family, kinds: set[bool]
) -> None:
    num_envs, scale = 5, 0.5
    ours = RoughTurningVecEnv(scenario, num_envs, scale)
    theirs = DummyVecEnv(
        [
            lambda: Monitor(
                FamilyEnv(scenario) if isinstance(scenario, Family) else RoughTurningEnv(scenario)
            )
        ]
        * num_envs
    )
    size = (ours.action_space.shape or (0,))[0]
    ours.seed(40)
    theirs.seed(40)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    ends = {True: 0, False: 0}
    for step in range(60):
        actions = np.sin(np.arange(num_envs * size).reshape(num_envs, size) + 0.2 * step).astype(
            np.float32
        )
        observations, rewards, dones, infos = ours.step(actions)
        expected_observations, expected_rewards, expected_dones, expected_infos = theirs.step(
            actions
        )
        np.testing.assert_array_equal(observations, expected_observations)
        np.testing.assert_array_equal(dones, expected_dones)
        np.testing.assert_allclose(rewards, scale * expected_rewards, rtol=1e-6)
        assert rewards.dtype == np.float32
        for done, info, expected in zip(dones, infos, expected_infos, strict=True):
            if done:
                np.testing.assert_array_equal(
                    info["terminal_observation"], expected["terminal_observation"]
                )
                assert info["TimeLimit.truncated"] == expected["TimeLimit.truncated"]
                assert info["episode"]["r"] == pytest.approx(
                    expected["episode"]["r"], rel=1e-5, abs=1e-5
                )  # unscaled
                assert info["episode"]["l"] == expected["episode"]["l"]
                ends[info["TimeLimit.truncated"]] += 1
            else:
                assert info == {}
    assert {kind for kind, count in ends.items() if count} == kinds
