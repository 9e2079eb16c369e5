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

WAYS: dict[str, Callable[[Any], Any]] = {
    "copy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
}


def outputs(env: Any, actions: Any) -> list[bytes]:
    """Return all outputs over some actions, across the ends of episodes."""
    found = []
    for action in actions:
        step = env.step(action)
        found.append(pickle.dumps([step[0].tobytes(), *map(repr, step[1:])]))
        if isinstance(env, gymnasium.Env) and (step[2] or step[3]):
            found.append(env.reset()[0].tobytes())
    return found


@pytest.mark.parametrize(("way", "render_mode"), [("copy", None), ("pickle", "rgb_array")])
@pytest.mark.parametrize("preset", ["surface", "shift", "batch_casting"])
def test_a_copy_in_the_middle_of_an_episode_gives_the_same_outputs(
    preset: str, render_mode: str | None, way: str
) -> None:
    env = RoughTurningEnv(preset, render_mode)
    env.reset(seed=3)
    actions = fixed_actions(8, 1, preset)[:, 0]
    outputs(env, actions[:4])
    before = None if render_mode is None else env.render()
    other = WAYS[way](env)
    there = outputs(other, actions[4:])
    if render_mode is not None:
        assert (env.render() == before).all()
    assert outputs(env, actions[4:]) == there
    if render_mode is not None:
        assert (env.render() == other.render()).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("way", "render_mode", "autoreset"),
    [("copy", "rgb_array", "NextStep"), ("pickle", None, "SameStep")],
)
@pytest.mark.parametrize("family", [False, True])
def test_a_copy_of_a_batch_gives_the_same_outputs(
    family: bool, autoreset: str, render_mode: str | None, way: str
) -> None:
    options = {"autoreset_mode": autoreset, "render_mode": render_mode}
    envs = (
        FamilyVectorEnv(3, **options)
        if family
        else RoughTurningVectorEnv(3, SHORT_LIVED, **options)
    )
    envs.reset(seed=0)
    actions = fixed_actions(60, 3, "shift" if family else SHORT_LIVED)
    outputs(envs, actions[:17])
    other = WAYS[way](envs)
    assert outputs(other, actions[17:]) == outputs(envs, actions[17:])
    if render_mode is not None:
        frames = envs.render()
        assert len(frames) == 3
        for frame, expected in zip(frames, other.render(), strict=True):
            np.testing.assert_array_equal(frame, expected)
    envs.close()
    other.close()
