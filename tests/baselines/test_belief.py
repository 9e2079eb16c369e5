"""The belief as an observation."""

import gymnasium
import numpy as np
import pytest

from baselines.belief import ENTRIES, BeliefObservation, VectorBeliefObservation
from tests.turning_env.test_family_env import BRIEF_FAMILY
from turning_env import (
    FAMILY_ID,
    FamilyEnv,
    FamilyVectorEnv,
    RoughTurningEnv,
    RoughTurningVectorEnv,
)
from turning_env.physics.quantities import DEVIATION_SCALE, OBS

STEPS = 150


def actions(size):
    """Return random actions, shape (STEPS, 2, size), which change the edge now and then."""
    random = np.random.default_rng(0)
    drawn = random.uniform(-0.3, 0.3, (STEPS, 2, size)).astype(np.float32)
    change_edge = np.random.default_rng(1).choice(
        [-1.0, 1.0], size=(STEPS, 2, size - 2), p=[0.95, 0.05]
    )
    drawn[:, :, 2:] = change_edge
    return drawn


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("source", ["family", {"base": "shift", "control": {"time_limit": 1.0}}])
def test_a_batch_believes_what_single_environments_do_across_episodes(mode, source):
    if source == "family":
        batch = FamilyVectorEnv(2, BRIEF_FAMILY, autoreset_mode=mode)
        singles = [BeliefObservation(FamilyEnv(BRIEF_FAMILY)) for _ in range(2)]
    else:
        batch = RoughTurningVectorEnv(2, source, mode)
        singles = [BeliefObservation(RoughTurningEnv(source)) for _ in range(2)]
    envs = VectorBeliefObservation(batch)
    observations, _ = envs.reset(seed=3)
    expected = np.stack([env.reset(seed=3 + i)[0] for i, env in enumerate(singles)])
    assert observations in envs.observation_space
    ended = np.zeros(2, bool)
    episodes = 0
    for row in actions(3):
        np.testing.assert_array_equal(observations, expected)
        observations, *_, infos = envs.step(row)
        for i, env in enumerate(singles):
            if ended[i] and mode == "NextStep":
                expected[i] = env.reset()[0]
                ended[i] = False
                continue
            expected[i], _, terminated, truncated, _ = env.step(row[i])
            ended[i] = terminated or truncated
            if ended[i] and mode == "SameStep":
                np.testing.assert_array_equal(infos["final_obs"][i], expected[i])
                expected[i] = env.reset()[0]
                ended[i] = False
                episodes += 1
        episodes += int(ended.sum())
        if ended.any() and mode == "Disabled":
            np.testing.assert_array_equal(observations, expected)
            observations, _ = envs.reset(options={"reset_mask": ended.copy()})
            for i in np.flatnonzero(ended):
                expected[i] = singles[i].reset()[0]
            ended[:] = False
    assert episodes >= 2


@pytest.mark.slow
def test_expected_loads_are_as_sure_as_they_say():
    """On unknown lathes, readings differ from the belief by about its deviations.

    Edges wear meanwhile.
    """
    num_envs = 64
    envs = VectorBeliefObservation(FamilyVectorEnv(num_envs, "shop", context="hidden"))

    def believed(name):
        """Return an entry of the belief before the last step."""
        return before[:, ENTRIES.index(name) - len(ENTRIES)]

    observations, _ = envs.reset(seed=0)
    sensors = [envs.unwrapped.job(i).scenario.sensors for i in range(num_envs)]
    noises = {
        "power": np.array([sensor.power_noise for sensor in sensors]),
        "force": np.array([sensor.force_noise for sensor in sensors]),
    }
    errors = []
    still = np.tile(np.float32([0.0, 0.0, -1.0]), (num_envs, 1))
    for step in range(120):
        before = observations
        observations, *_ = envs.step(still)
        far_from_next_bar = believed("log_time_to_bar") > np.log(3.0)
        steady = far_from_next_bar & (believed("bar_measured") > 0)
        steady &= before[:, OBS.cutting] > 0
        steady &= observations[:, OBS.cutting] > 0
        if step <= 40:
            continue
        for law, entry in (("power", OBS.power), ("force", OBS.thrust_force)):
            load = observations[:, entry] / DEVIATION_SCALE + 1.0
            log_load = np.log(np.maximum(load, 0.01))
            spread = np.hypot(believed(f"this_log_{law}_deviation"), noises[law])
            error = (log_load - believed(f"this_log_{law}")) / spread
            errors.append(error[steady])
    errors = np.concatenate(errors)
    assert len(errors) > 2000
    assert np.median(np.abs(errors)) < 1.0
    assert np.mean(np.abs(errors) < 3.0) > 0.9


def test_it_wraps_environments_of_gymnasium():
    env = gymnasium.make(FAMILY_ID)
    believing = BeliefObservation(env)
    (entries,) = env.observation_space.shape
    assert believing.observation_space.shape == (entries + len(ENTRIES),)
    observation, _ = believing.reset(seed=0)
    assert observation in believing.observation_space


@pytest.mark.parametrize(
    ("env_id", "complaint"),
    [
        pytest.param("RoughTurning-Override-v1", r"control.action 'override'", id="other actions"),
        pytest.param("Pendulum-v1", "needs a RoughTurning", id="other environment"),
    ],
)
def test_it_refuses_environments_without_a_belief(env_id, complaint):
    env = gymnasium.make(env_id)
    with pytest.raises(ValueError, match=complaint):
        BeliefObservation(env)
