"""The belief as an observation."""

import gymnasium
import numpy as np
import pytest

from baselines.belief import ENTRIES, BeliefObservation, VectorBeliefObservation
from tests.turning_env.test_family_env import BRIEF
from turning_env import (
    FAMILY_ID,
    FamilyEnv,
    FamilyVectorEnv,
    RoughTurningEnv,
    RoughTurningVectorEnv,
)

STEPS = 150


def actions(size):
    """Return random actions of small changes, which change the edge now and then, shape (STEPS, 2, size)."""
    found = np.random.default_rng(0).uniform(-0.3, 0.3, (STEPS, 2, size)).astype(np.float32)
    found[:, :, 2:] = np.random.default_rng(1).choice(
        [-1.0, 1.0], (STEPS, 2, size - 2), p=[0.95, 0.05]
    )
    return found


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("source", ["family", {"base": "shift", "control": {"time_limit": 1.0}}])
def test_a_batch_believes_what_single_environments_do_across_episodes(mode, source):
    if source == "family":
        single, batch = (lambda: FamilyEnv(BRIEF)), FamilyVectorEnv(2, BRIEF, autoreset_mode=mode)
    else:
        single, batch = (lambda: RoughTurningEnv(source)), RoughTurningVectorEnv(2, source, mode)
    envs = VectorBeliefObservation(batch)
    ones = [BeliefObservation(single()) for _ in range(2)]
    observations, _ = envs.reset(seed=3)
    expected = np.stack([env.reset(seed=3 + i)[0] for i, env in enumerate(ones)])
    assert observations in envs.observation_space
    ended, episodes = np.zeros(2, bool), 0
    for row in actions(3):
        np.testing.assert_array_equal(observations, expected)
        observations, *_, infos = envs.step(row)
        for i, env in enumerate(ones):
            if ended[i] and mode == "NextStep":
                expected[i], ended[i] = env.reset()[0], False
                continue
            expected[i], _, term, trunc, _ = env.step(row[i])
            ended[i] = term or trunc
            if ended[i] and mode == "SameStep":
                np.testing.assert_array_equal(infos["final_obs"][i], expected[i])
                expected[i], ended[i] = env.reset()[0], False
                episodes += 1
        episodes += int(ended.sum())
        if ended.any() and mode == "Disabled":
            np.testing.assert_array_equal(observations, expected)
            observations, _ = envs.reset(options={"reset_mask": ended.copy()})
            for i in np.flatnonzero(ended):
                expected[i] = ones[i].reset()[0]
            ended[:] = False
    assert episodes >= 2


def test_expected_loads_are_as_sure_as_they_say():
    """Readings of force and power differ from the belief by about its deviations, on unknown lathes; edges wear meanwhile."""
    num_envs = 64
    envs = VectorBeliefObservation(FamilyVectorEnv(num_envs, "shop", context="hidden"))
    belief = {name: place - len(ENTRIES) for place, name in enumerate(ENTRIES)}
    observations, _ = envs.reset(seed=0)
    errors = []
    still = np.tile(np.float32([0.0, 0.0, -1.0]), (num_envs, 1))
    for step in range(120):
        before = observations
        observations, *_ = envs.step(still)
        in_bar = (before[:, 7] > 0) & (before[:, belief["log_time_to_bar"]] > np.log(3.0))
        steady = in_bar & (observations[:, 7] > 0) & (before[:, belief["bar_measured"]] > 0)
        if step > 40:
            ratios = observations[:, :2] / 5.0 + 1.0  # power, force
            for column, law in enumerate(("power", "force")):
                expected = before[:, belief[f"this_log_{law}"]]
                spread = np.hypot(before[:, belief[f"this_log_{law}_deviation"]], 0.02)
                errors.append(
                    ((np.log(np.maximum(ratios[:, column], 0.01)) - expected) / spread)[steady]
                )
    errors = np.concatenate(errors)
    assert len(errors) > 2000
    assert np.median(np.abs(errors)) < 1.0
    assert np.mean(np.abs(errors) < 3.0) > 0.9


def test_it_wraps_environments_of_gymnasium_and_refuses_others():
    env = gymnasium.make(FAMILY_ID)
    believing = BeliefObservation(env)
    assert believing.observation_space.shape == (env.observation_space.shape[0] + len(ENTRIES),)
    assert believing.reset(seed=0)[0] in believing.observation_space
    for other, message in (
        ("RoughTurning-Override-v1", "control.action 'override'"),
        ("Pendulum-v1", "needs a RoughTurning"),
    ):
        with pytest.raises(ValueError, match=message):
            BeliefObservation(gymnasium.make(other))
