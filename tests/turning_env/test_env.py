"""The single environment: Gymnasium's contract and stored specifications."""

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

from tests.turning_env.playing import SHORT_LIVED, UNDISTURBED, changed, fixed_actions, infos
from turning_env import IDS, RoughTurningEnv

MAKEABLE = [(env_id, {}) for env_id in IDS]
MAKEABLE.append(("RoughTurning-v0", {"scenario": "override_current"}))
MAKEABLE.append(("RoughTurning-v0", {"scenario": "forging_skin"}))


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "arguments"), MAKEABLE)
@pytest.mark.parametrize("check", [check_env, check_env_of_sb3])
def test_the_checkers_have_no_complaint(check, env_id, arguments):
    """Warnings count as errors throughout this suite."""
    check(gymnasium.make(env_id, **arguments).unwrapped)


def make_vector(spec, **arguments):
    return gymnasium.make_vec(spec, num_envs=2, **arguments)


def step(env, actions):
    """Step a single or a vector environment with the actions of two; return what it says."""
    is_vector = env.unwrapped.action_space.shape == (2, 2)
    answer = env.step(actions if is_vector else actions[0])
    # rl_zoo3 patches Gymnasium's wrapper when it is imported, and adds this key.
    answer[4].pop("TimeLimit.truncated", None)
    return answer


@pytest.mark.slow
@pytest.mark.parametrize("make", [gymnasium.make, make_vector])
@pytest.mark.parametrize("source", ["preset", "scenario", "file", "dict"])
def test_a_stored_spec_makes_the_same_environment(make, source, tmp_path):
    scenario = SHORT_LIVED.model_copy(update={"name": "own"})
    path = tmp_path / "own.toml"
    scenario.save(path)
    sources = {
        "preset": "forging",
        "scenario": scenario,
        "file": path,
        "dict": {"base": "casting", "control": {"time_limit": 0.5}},
    }
    env = make("RoughTurning-v0", scenario=sources[source])
    assert env.spec.max_episode_steps == (3600 if source == "preset" else 30)

    stored = env.spec.to_json()
    assert str(tmp_path) not in stored
    path.unlink()
    again = make(EnvSpec.from_json(stored))
    assert again.spec == env.spec
    assert again.unwrapped.scenario == env.unwrapped.scenario

    env.reset(seed=1)
    again.reset(seed=1)
    for actions in fixed_actions(30, 2):
        answer = step(env, actions)
        assert [repr(part) for part in step(again, actions)] == [repr(part) for part in answer]
        if np.any(answer[2] | answer[3]):
            break


SEVEN_SECONDS = changed(
    UNDISTURBED, control={"interval": 7, "time_limit": 0.7}, tool={"wear_criterion": 5}
)
SHIFT_OF_A_MINUTE = changed("shift", control={"interval": 7.0, "time_limit": 1.09})


@pytest.mark.parametrize(
    ("scenario", "action", "steps"),
    [
        pytest.param(SEVEN_SECONDS, [0.0, 0.0], 6, id="whole number of steps"),
        pytest.param(SHIFT_OF_A_MINUTE, [0.0, 0.0, -1.0], 10, id="broken number of steps"),
        pytest.param("batch_casting", [0.0] * 10, 20, id="parts"),
    ],
)
def test_episodes_last_as_long_as_they_may(scenario, action, steps):
    assert len(infos(scenario, [action] * (steps + 1))) == steps
    assert RoughTurningEnv(scenario).scenario.max_episode_steps == steps
