"""A load target as the action."""

import pickle

import gymnasium
import numpy as np
import pytest

from baselines.load_target import (
    CHANGE_WEAR,
    LOG_SPEED,
    LOG_TARGET,
    LoadTargetAction,
    VectorLoadTargetAction,
)
from tests.turning_env.playing import NO_SPREAD
from tests.turning_env.test_family_env import BRIEF_FAMILY
from turning_env import (
    FAMILY_ID,
    FamilyEnv,
    FamilyVectorEnv,
    RoughTurningEnv,
    RoughTurningVectorEnv,
)
from turning_env.physics.quantities import OBS

STEADY = {
    "workpiece": NO_SPREAD | {"bar_length": 5000.0},
    "sensors": {"power_noise": 0.0, "force_noise": 0.0},
    "tool": {"edge_strength": 1e6, "wear_factor_spread": 0.0},
}
"""One long bar of one metal, measured without noise."""
SHORT_SHIFT = {"base": "shift", "control": {"time_limit": 1.0}}


def action_for(value, meaning):
    """Return the action that stands for a value."""
    middle, half_width = meaning
    return (value - middle) / half_width


def final_info(scenario, target, speed, steps=40):
    """Return the info after some steps with a load target and a share of the optimum's speed."""
    env = LoadTargetAction(RoughTurningEnv(scenario))
    env.reset(seed=0)
    action = np.float32(
        [action_for(np.log(target), LOG_TARGET), action_for(np.log(speed), LOG_SPEED)]
    )
    for _ in range(steps):
        *_, info = env.step(action)
    return info


@pytest.mark.parametrize("target", [0.7, 0.95])
def test_the_loop_holds_the_target_of_the_higher_load(target):
    info = final_info(STEADY, target, speed=0.8)
    highest = max(info["thrust_force"] / 1500.0, info["power"] / 7.0)
    assert highest == pytest.approx(target, rel=0.02)


def test_below_the_base_speed_the_target_is_a_share_of_the_limit_of_torque():
    # At 1000 rev/min and 100 mm, the base speed is 314 m/min, above the machine's 200 m/min.
    scenario = STEADY | {"spindle": {"base_speed": 1000.0}, "limits": {"thrust_force": 1e4}}
    info = final_info(scenario, target=0.9, speed=0.7)
    capacity = info["spindle_speed"] / 1000.0
    assert capacity < 0.7
    assert info["power"] / (7.0 * capacity) == pytest.approx(0.9, rel=0.02)


def test_the_speed_is_a_share_of_the_nominal_optimum_and_the_feed_stays_in_the_window():
    env = LoadTargetAction(FamilyEnv(BRIEF_FAMILY))
    env.reset(seed=5)
    job = env.unwrapped.job()
    action = np.float32([1.0, action_for(np.log(0.7), LOG_SPEED), 1.0])
    feeds = []
    for _ in range(12):
        *_, info = env.step(action)
        feeds.append(info["commanded_feed"])
    lowest = job.scenario.machine.cutting_speed_min
    assert info["commanded_cutting_speed"] == pytest.approx(max(0.7 * job.cutting_speed, lowest))
    swarf = job.scenario.swarf
    assert swarf.chip_feed_min < min(feeds)
    assert max(feeds) < swarf.chip_feed_max


def test_edges_are_changed_at_the_wear_of_the_action():
    env = LoadTargetAction(RoughTurningEnv("shift"))
    observation, _ = env.reset(seed=0)
    action = np.float32([0.0, 0.0, action_for(0.6, CHANGE_WEAR)])
    worn = []
    for _ in range(300):
        before = observation
        observation, *_ = env.step(action)
        if observation[OBS.cutting_time] < before[OBS.cutting_time]:
            worn.append(before[OBS.nominal_wear])
    assert len(worn) >= 2
    assert worn == pytest.approx([0.6] * len(worn), abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("source", ["family", SHORT_SHIFT])
def test_a_batch_does_what_single_environments_do_across_episodes(mode, source):
    if source == "family":
        batch = FamilyVectorEnv(2, BRIEF_FAMILY, autoreset_mode=mode)
        singles = [LoadTargetAction(FamilyEnv(BRIEF_FAMILY)) for _ in range(2)]
    else:
        batch = RoughTurningVectorEnv(2, source, mode)
        singles = [LoadTargetAction(RoughTurningEnv(source)) for _ in range(2)]
    envs = VectorLoadTargetAction(batch)
    assert envs.single_action_space == singles[0].action_space
    observations, _ = envs.reset(seed=3)
    expected = np.stack([env.reset(seed=3 + i)[0] for i, env in enumerate(singles)])
    ended = np.zeros(2, bool)
    episodes = 0
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, (150, 2, 3)).astype(np.float32)
    for row in drawn:
        np.testing.assert_array_equal(observations, expected)
        if ended.any() and mode == "Disabled":
            observations, _ = envs.reset(options={"reset_mask": ended.copy()})
            for i in np.flatnonzero(ended):
                expected[i] = singles[i].reset()[0]
            ended[:] = False
        observations, *_ = envs.step(row)
        for i, env in enumerate(singles):
            if ended[i] and mode == "NextStep":
                expected[i] = env.reset()[0]
                ended[i] = False
                continue
            expected[i], _, terminated, truncated, _ = env.step(row[i])
            ended[i] = terminated or truncated
            episodes += int(ended[i])
            if ended[i] and mode == "SameStep":
                expected[i] = env.reset()[0]
                ended[i] = False
    assert episodes >= 2


def test_it_wraps_environments_of_gymnasium_and_its_specification_makes_it_again():
    env = LoadTargetAction(gymnasium.make(FAMILY_ID))
    again = gymnasium.make(env.spec)
    assert again.action_space.shape == (3,)
    first, _ = env.reset(seed=1)
    copied = pickle.loads(pickle.dumps(env))
    again.reset(seed=1)
    action = np.float32([0.2, -0.1, 0.0])
    expected, *_ = env.step(action)
    np.testing.assert_array_equal(again.step(action)[0], expected)
    np.testing.assert_array_equal(copied.step(action)[0], expected)
    assert not np.array_equal(first, expected)


def test_a_batch_survives_a_pickle():
    envs = VectorLoadTargetAction(FamilyVectorEnv(2, BRIEF_FAMILY))
    envs.reset(seed=0)
    copied = pickle.loads(pickle.dumps(envs))
    actions = np.zeros((2, 3), np.float32)
    np.testing.assert_array_equal(copied.step(actions)[0], envs.step(actions)[0])


@pytest.mark.parametrize(
    "actions", [np.zeros(3), np.zeros((1, 3)), np.full((2, 3), np.nan), np.zeros((2, 2))]
)
def test_malformed_load_targets_are_refused(actions):
    envs = VectorLoadTargetAction(FamilyVectorEnv(2, BRIEF_FAMILY))
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=r"load targets must be finite, of shape \(2, 3\)"):
        envs.step(actions)


@pytest.mark.parametrize(
    ("env_id", "complaint"),
    [
        pytest.param("RoughTurning-Override-v1", "control.action 'override'", id="an override"),
        pytest.param("RoughTurning-Batch-v0", "control.action 'part'", id="a plan"),
        pytest.param("Pendulum-v1", "needs a RoughTurning", id="other environment"),
    ],
)
def test_it_refuses_environments_whose_actions_set_no_speed_and_feed(env_id, complaint):
    env = gymnasium.make(env_id)
    with pytest.raises(ValueError, match=complaint):
        LoadTargetAction(env)
