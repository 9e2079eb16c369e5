"""The single environment: Gymnasium's contract, determinism, refusal of nonsense."""

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_agents

from tests.turning_env.playing import SHORT_LIVED, UNDISTURBED, changed, fixed_actions, infos
from turning_env import IDS, RoughTurningEnv

ACTIONS = fixed_actions(100, 1)[:, 0]
MAKEABLE = [
    *((env_id, None) for env_id in IDS),
    ("RoughTurning-v0", "override_current"),
    ("RoughTurning-v0", "forging_skin"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "preset"), MAKEABLE)
@pytest.mark.parametrize("check", [check_env, check_env_for_agents])
def test_checkers_are_content(check, env_id, preset):
    """Warnings count as errors throughout this suite."""
    check(gymnasium.make(env_id, **({"scenario": preset} if preset else {})).unwrapped)


@pytest.mark.parametrize(
    "make", [gymnasium.make, lambda spec, **kwargs: gymnasium.make_vec(spec, num_envs=2, **kwargs)]
)
@pytest.mark.parametrize("source", ["preset", "scenario", "file", "dict"])
def test_a_stored_spec_makes_the_same_environment(make, source, tmp_path):
    scenario = SHORT_LIVED.model_copy(update={"name": "mine"})
    scenario.save(tmp_path / "mine.toml")
    short = {"base": "casting", "control": {"time_limit": 0.5}}
    sources = {
        "preset": "forging",
        "scenario": scenario,
        "file": tmp_path / "mine.toml",
        "dict": short,
    }
    env = make("RoughTurning-v0", scenario=sources[source])
    text = env.spec.to_json()
    assert str(tmp_path) not in text
    (tmp_path / "mine.toml").unlink()
    again = make(EnvSpec.from_json(text))
    assert again.spec == env.spec
    assert again.unwrapped.scenario == env.unwrapped.scenario
    assert env.spec.max_episode_steps == (3600 if source == "preset" else 30)
    env.reset(seed=1)
    again.reset(seed=1)
    for actions in fixed_actions(30, 2):
        answers = [
            one.step(actions if one.unwrapped.action_space.shape == (2, 2) else actions[0])
            for one in (env, again)
        ]
        for answer in answers:
            answer[-1].pop(
                "TimeLimit.truncated", None
            )  # of rl_zoo3, which patches Gymnasium's wrapper when it is imported
        assert [repr(answer) for answer in answers[0]] == [repr(answer) for answer in answers[1]]
        if np.any(answers[0][2] | answers[0][3]):
            break


@pytest.mark.parametrize(
    ("scenario", "action", "steps"),
    [
        (
            changed(
                UNDISTURBED, control={"interval": 7, "time_limit": 0.7}, tool={"wear_criterion": 5}
            ),
            (0.0, 0.0),
            6,
        ),
        (changed("shift", control={"interval": 7.0, "time_limit": 1.09}), (0.0, 0.0, -1.0), 10),
        ("batch_casting", [0.0] * 10, 20),
    ],
)
def test_episodes_last_as_long_as_they_may(scenario, action, steps):
    assert (
        len(infos(scenario, [action] * (steps + 1)))
        == steps
        == RoughTurningEnv(scenario).scenario.max_episode_steps
    )
