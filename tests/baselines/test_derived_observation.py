"""Derived inputs behind the observation."""

import math
import pickle

import gymnasium
import numpy as np
import pytest

from baselines.belief import BeliefObservation
from baselines.derived_observation import (
    ENTRIES,
    DerivedObservation,
    VectorDerivedObservation,
)
from tests.turning_env.test_family_env import BRIEF_FAMILY
from turning_env import ALL_IDS, FAMILY_ID, FamilyEnv, FamilyVectorEnv, RoughTurningEnv


def derived(observation):
    """Return the derived entries of an observation by name."""
    return dict(zip(ENTRIES, observation[-len(ENTRIES) :].tolist(), strict=True))


def test_the_entries_of_a_job_are_as_computed_by_hand():
    env = DerivedObservation(FamilyEnv(BRIEF_FAMILY))
    env.reset(seed=25)
    job = env.unwrapped.job()
    scenario = job.scenario
    for _ in range(15):
        observation, *_, info = env.step(np.float32([-0.1, 0.1, -1.0]))
    assert info["cutting"]

    capacity = min(1.0, info["spindle_speed"] / scenario.spindle.base_speed)
    assert capacity < 0.9
    power = info["measured_power"] / (capacity * scenario.limits.power)
    force = info["measured_thrust_force"] / scenario.limits.thrust_force
    base_speed = math.pi * scenario.workpiece.diameter * scenario.spindle.base_speed / 1000.0
    highest_feed = min(scenario.swarf.chip_feed_max, scenario.machine.feed_max)
    speed = info["commanded_cutting_speed"]
    feed = info["commanded_feed"]
    expected = {
        "highest_load": 5.0 * (max(power, force) - 1.0),
        "speed_over_optimum": 3.0 * math.log(speed / job.cutting_speed),
        "feed_over_optimum": 3.0 * math.log(feed / job.feed),
        "feed_over_lowest": 3.0 * math.log(feed / scenario.swarf.chip_feed_min),
        "feed_below_highest": 3.0 * math.log(highest_feed / feed),
        "speed_over_base_speed": 3.0 * math.log(info["cutting_speed"] / base_speed),
    }
    assert derived(observation) == pytest.approx(expected, abs=1e-4)


def test_without_window_and_base_speed_the_machine_is_the_limit():
    env = DerivedObservation(RoughTurningEnv())
    observation, _ = env.reset(seed=0)
    entries = derived(observation)
    # The program is 125 m/min and 0.25 mm/rev, the machine's range of feeds 0.06 to 0.60 mm/rev.
    assert entries["feed_over_lowest"] == pytest.approx(3.0 * math.log(0.25 / 0.06), abs=1e-4)
    assert entries["feed_below_highest"] == pytest.approx(3.0 * math.log(0.60 / 0.25), abs=1e-4)
    assert entries["speed_over_base_speed"] == 10.0
    assert entries["highest_load"] == -5.0


@pytest.mark.parametrize("env_id", ALL_IDS)
def test_every_id_has_derived_entries_within_their_bounds(env_id):
    env = DerivedObservation(gymnasium.make(env_id))
    assert env.observation_space.shape[0] == env.env.observation_space.shape[0] + len(ENTRIES)
    env.action_space.seed(0)
    observation, _ = env.reset(seed=0)
    for _ in range(20):
        assert observation in env.observation_space
        observation, *_, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            break


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_a_batch_derives_what_single_environments_do_across_jobs(mode):
    envs = VectorDerivedObservation(FamilyVectorEnv(2, BRIEF_FAMILY, autoreset_mode=mode))
    singles = [DerivedObservation(FamilyEnv(BRIEF_FAMILY)) for _ in range(2)]
    observations, _ = envs.reset(seed=3)
    expected = np.stack([env.reset(seed=3 + i)[0] for i, env in enumerate(singles)])
    ended = np.zeros(2, bool)
    episodes = 0
    actions = np.random.default_rng(0).uniform(-1.0, 0.0, (100, 2, 3)).astype(np.float32)
    for row in actions:
        np.testing.assert_array_equal(observations, expected)
        if ended.any() and mode == "Disabled":
            observations, _ = envs.reset(options={"reset_mask": ended.copy()})
            for i in np.flatnonzero(ended):
                expected[i] = singles[i].reset()[0]
            ended[:] = False
        observations, *_, infos = envs.step(row)
        assert observations in envs.observation_space
        for i, env in enumerate(singles):
            if ended[i] and mode == "NextStep":
                expected[i] = env.reset()[0]
                ended[i] = False
                continue
            expected[i], _, terminated, truncated, _ = env.step(row[i])
            ended[i] = terminated or truncated
            episodes += int(ended[i])
            if ended[i] and mode == "SameStep":
                np.testing.assert_array_equal(infos["final_obs"][i], expected[i])
                expected[i] = env.reset()[0]
                ended[i] = False
    assert episodes >= 2


def test_it_stands_on_other_wrappers_and_survives_specification_and_pickle():
    env = DerivedObservation(BeliefObservation(gymnasium.make(FAMILY_ID)))
    plain = DerivedObservation(gymnasium.make(FAMILY_ID))
    observation, _ = env.reset(seed=1)
    expected, _ = plain.reset(seed=1)
    np.testing.assert_array_equal(observation[-len(ENTRIES) :], expected[-len(ENTRIES) :])
    again = gymnasium.make(plain.spec)
    np.testing.assert_array_equal(again.reset(seed=1)[0], expected)
    copied = pickle.loads(pickle.dumps(plain))
    action = np.zeros(3, np.float32)
    np.testing.assert_array_equal(copied.step(action)[0], plain.step(action)[0])


def test_it_refuses_other_environments():
    with pytest.raises(ValueError, match="a derived observation needs a RoughTurning"):
        DerivedObservation(gymnasium.make("Pendulum-v1"))
