"""The single environment: Gymnasium's contract, determinism, refusal of nonsense."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_agents

from tests.turning_env.playing import SHORT_LIVED, assert_same_bytes, fixed_actions, play
from turning_env import IDS, RoughTurningEnv, Scenario, presets

ACTIONS = fixed_actions(100, 1)[:, 0]
MAKEABLE = [*((env_id, None) for env_id in IDS), *(("RoughTurning-v0", preset) for preset in presets())]


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "preset"), MAKEABLE)
@pytest.mark.parametrize("check", [check_env, check_env_for_agents])
def test_checkers_are_content(check, env_id, preset):
    """Warnings count as errors throughout this suite."""
    check(gymnasium.make(env_id, **({"scenario": preset} if preset else {})).unwrapped)


@pytest.mark.parametrize(("env_id", "preset"), IDS.items())
def test_ids_can_be_made_by_module_and_name(env_id, preset):
    env = gymnasium.make(f"turning_env:{env_id}")
    assert env.unwrapped.scenario == Scenario.load(preset)
    env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert env.observation_space.contains(observation)
    assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
    assert {"cutting_speed", "feed", "depth_of_cut", "hardness", "wear", "used_life", "thrust_force", "power"} <= info.keys()
    assert {"removed", "cost", "cost_force", "cost_power", "reward_metal", "reward_time", "reward_edge"} <= info.keys()
    assert {"reward_overload", "reward_breakage"} <= info.keys()


def test_environments_do_not_share_their_spaces():
    one, other = RoughTurningEnv(), RoughTurningEnv()
    one.action_space.seed(1)
    expected = one.action_space.sample()
    one.action_space.seed(1)
    other.action_space.seed(2)
    assert np.array_equal(one.action_space.sample(), expected)


def test_seeds_and_episodes_have_bars_and_edges_of_their_own():
    env = RoughTurningEnv()
    starts = [env.reset(seed=seed)[1] for seed in (0, 1, 2**63, 2**64 - 1)]
    starts += [env.reset()[1] for _ in range(4)]
    assert len({info["wear_factor"] for info in starts}) == len({info["edge_strength"] for info in starts}) == 8
    depths = []
    for _ in range(2):
        env.reset()
        depths.append([env.step((1.0, 1.0))[-1]["depth_of_cut"] for _ in range(10)][-1])
    assert depths[0] != depths[1]


def test_reset_without_seed_plays_the_next_episode_whether_or_not_the_last_one_ended():
    ended, broken_off = RoughTurningEnv(SHORT_LIVED), RoughTurningEnv(SHORT_LIVED)
    record = play(ended, 3, ACTIONS)
    assert (record["terminated"] | record["truncated"]).sum() > 1
    broken_off.reset(seed=3)
    play(ended, 3, ACTIONS[:1])
    assert_same_bytes(play(ended, None, ACTIONS), play(broken_off, None, ACTIONS))


def test_without_any_seed_episodes_differ():
    assert RoughTurningEnv().reset()[1]["wear_factor"] != RoughTurningEnv().reset()[1]["wear_factor"]


def test_what_was_returned_stays_as_it_was():
    env = RoughTurningEnv()
    observation, info = env.reset(seed=0)
    kept, kept_info = observation.copy(), dict(info)
    env.step((1.0, 1.0))
    assert np.array_equal(observation, kept)
    assert info == kept_info


def test_actions_beyond_the_space_are_clipped():
    beyond, at_its_edge = RoughTurningEnv(), RoughTurningEnv()
    assert_same_bytes(play(beyond, 1, 50 * ACTIONS), play(at_its_edge, 1, np.clip(50 * ACTIONS, -1, 1)))


def test_step_needs_an_episode_under_way():
    env = RoughTurningEnv(SHORT_LIVED)
    with pytest.raises(ResetNeeded):
        env.step((0.0, 0.0))
    env.reset(seed=0)
    for _ in range(1000):
        *_, terminated, truncated, _ = env.step((0.0, 0.0))
        if terminated or truncated:
            break
    with pytest.raises(ResetNeeded):
        env.step((0.0, 0.0))
    env.reset()
    env.step((0.0, 0.0))


@pytest.mark.parametrize("seed", [-1, 2**64, 1.0, "1", [1]])
def test_bad_seeds_are_refused_and_nothing_moves(seed):
    env, untouched = RoughTurningEnv(), RoughTurningEnv()
    env.reset(seed=1)
    untouched.reset(seed=1)
    with pytest.raises(ValueError, match=r"seed .* of environment 0 must be a whole number, 0 to 18446744073709551615"):
        env.reset(seed=seed)
    assert env.step((1.0, 1.0))[1:] == untouched.step((1.0, 1.0))[1:]


def test_unknown_arguments_are_refused():
    with pytest.raises(TypeError, match="scenari"):
        gymnasium.make("RoughTurning-v0", scenari="paper")
