"""A copy or a pickle goes on as the original does."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from tests.turning_env.playing import SHORT_LIVED, fixed_actions
from turning_env import FamilyVectorEnv, RoughTurningEnv, RoughTurningVectorEnv

METHODS: dict[str, Callable[[Any], Any]] = {
    "copy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
}


def outputs(env: Any, actions: Any) -> list[bytes]:
    """Return all outputs over some actions, across the ends of episodes."""
    contents = []
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        contents.append(observation.tobytes())
        contents.append(repr((reward, terminated, truncated, info)).encode())
        if isinstance(env, gymnasium.Env) and (terminated or truncated):
            observation, _ = env.reset()
            contents.append(observation.tobytes())
    return contents


@pytest.mark.parametrize(("method", "render_mode"), [("copy", None), ("pickle", "rgb_array")])
@pytest.mark.parametrize("preset", ["surface", "shift", "batch_casting"])
def test_a_copy_in_the_middle_of_an_episode_gives_the_same_outputs(
    preset: str, render_mode: str | None, method: str
) -> None:
    env = RoughTurningEnv(preset, render_mode)
    env.reset(seed=3)
    actions = fixed_actions(8, 1, preset)[:, 0]
    outputs(env, actions[:4])
    before = None if render_mode is None else env.render()
    duplicate = METHODS[method](env)
    outputs_of_duplicate = outputs(duplicate, actions[4:])
    # The steps of the duplicate leave the original as it was.
    if render_mode is not None:
        assert (env.render() == before).all()
    assert outputs(env, actions[4:]) == outputs_of_duplicate
    if render_mode is not None:
        assert (env.render() == duplicate.render()).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "render_mode", "autoreset"),
    [("copy", "rgb_array", "NextStep"), ("pickle", None, "SameStep")],
)
@pytest.mark.parametrize("family", [False, True])
def test_a_copy_of_a_batch_gives_the_same_outputs(
    family: bool, autoreset: str, render_mode: str | None, method: str
) -> None:
    options = {"autoreset_mode": autoreset, "render_mode": render_mode}
    if family:
        envs = FamilyVectorEnv(3, **options)
        actions = fixed_actions(60, 3, "shift")
    else:
        envs = RoughTurningVectorEnv(3, SHORT_LIVED, **options)
        actions = fixed_actions(60, 3, SHORT_LIVED)
    envs.reset(seed=0)
    outputs(envs, actions[:17])
    duplicate = METHODS[method](envs)
    assert outputs(duplicate, actions[17:]) == outputs(envs, actions[17:])
    if render_mode is not None:
        frames = envs.render()
        assert len(frames) == 3
        for frame, expected in zip(frames, duplicate.render(), strict=True):
            np.testing.assert_array_equal(frame, expected)
    envs.close()
    duplicate.close()
