"""Gymnasium's own wrappers, single and vector: each that can apply works."""

from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import gymnasium.wrappers as single
import gymnasium.wrappers.vector as vector
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.turning_env.playing import SHORT_LIVED
from turning_env import ALL_IDS, FAMILY_ID, RoughTurningEnv, RoughTurningVectorEnv

ZERO = np.float32(0)
ONE = np.float32(1)

# Gymnasium's Box compares float32 bounds with float64's range when it is made.
pytestmark = pytest.mark.filterwarnings("ignore:overflow encountered in cast")

ARGUMENTS: dict[str, Callable[[Any], tuple[Any, ...]]] = {
    "ClipReward": lambda env: (-1.0, 1.0),
    "DelayObservation": lambda env: (2,),
    "DiscretizeAction": lambda env: (3,),
    "DiscretizeObservation": lambda env: (3,),
    "DtypeObservation": lambda env: (np.float64,),
    "FrameStackObservation": lambda env: (4,),
    "MaxAndSkipObservation": lambda env: (2,),
    "RepeatAction": lambda env: (3,),
    "RescaleAction": lambda env: (ZERO, ONE),
    "RescaleObservation": lambda env: (ZERO, ONE),
    "ReshapeObservation": lambda env: (
        (1, *getattr(env, "single_observation_space", env.observation_space).shape),
    ),
    "StickyAction": lambda env: (0.25,),
    "TimeLimit": lambda env: (10,),
    "TransformAction": lambda env: (np.negative, *spaces_of(env, "action_space")),
    "TransformObservation": lambda env: (
        lambda seen: seen / 2,
        *spaces_of(env, "observation_space"),
    ),
    "TransformReward": lambda env: (lambda reward: reward / 3,),
    "VectorizeTransformAction": lambda env: (single.ClipAction,),
    "VectorizeTransformObservation": lambda env: (single.FlattenObservation,),
    "VectorizeTransformReward": lambda env: (
        partial(single.TransformReward, func=lambda reward: reward / 3),
    ),
}
"""The arguments of wrappers that take more than an environment."""
NOT_APPLICABLE = {
    "vector",  # the module
    # Of pictures.
    "AddRenderObservation",
    "AddWhiteNoise",
    "AtariPreprocessing",
    "GrayscaleObservation",
    "HumanRendering",
    "ObstructView",
    "RecordVideo",
    "RenderCollection",
    "ResizeObservation",
    # Of dictionaries and tuples.
    "FilterObservation",
    # These need array-api-compat.
    "ArrayConversion",
    "JaxToNumpy",
    "JaxToTorch",
    "NumpyToTorch",
}

SINGLE = sorted(set(single.__all__) - NOT_APPLICABLE)
VECTOR = sorted(set(vector.__all__) - NOT_APPLICABLE)


def spaces_of(env: Any, kind: str) -> tuple[Any, ...]:
    return () if hasattr(env, "num_envs") else (getattr(env, kind),)


def wrapped(module: Any, name: str, env: Any) -> Any:
    """Return an environment in the wrapper of a name."""
    arguments: tuple[Any, ...] = ()
    if name in ARGUMENTS:
        arguments = ARGUMENTS[name](env)
    wrapper = getattr(module, name)
    return wrapper(env, *arguments)


@pytest.mark.parametrize("name", SINGLE)
def test_single(name: str) -> None:
    env = wrapped(single, name, gymnasium.make("RoughTurning-v0", scenario=SHORT_LIVED))
    env.action_space.seed(0)
    seen, _ = env.reset(seed=0)
    for _ in range(40):
        assert seen in env.observation_space
        seen, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        assert np.isfinite(reward)
        if (terminated or truncated) and name != "Autoreset":
            seen, _ = env.reset()


@pytest.mark.parametrize("env_id", ALL_IDS)
def test_time_aware_observation_of_every_id(env_id: str) -> None:
    env = gymnasium.make(env_id)
    if env_id == FAMILY_ID:
        # Jobs last differently long, so no spec can state the number of steps.
        with pytest.raises(ValueError, match="max_episode_steps"):
            single.TimeAwareObservation(env)
        env = single.TimeLimit(env, 10)

    timed = single.TimeAwareObservation(env, flatten=True, normalize_time=False)
    first, _ = timed.reset(seed=0)
    second, *_ = timed.step(timed.action_space.sample())
    assert first[-1] == 0
    assert second[-1] == 1


def test_the_last_part_of_a_stored_batch_is_no_truncation() -> None:
    env = gymnasium.make(gymnasium.make("RoughTurning-Batch-v0").spec)
    env.reset(seed=0)
    for _ in range(20):
        *_, terminated, truncated, _ = env.step(np.zeros(10, np.float32))
    assert terminated
    assert not truncated


@pytest.mark.slow
@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("name", VECTOR)
def test_vector_as_gymnasiums_own_vector_environment(name: str, mode: AutoresetMode) -> None:
    envs: Any = RoughTurningVectorEnv(3, SHORT_LIVED, mode)
    functions = [lambda: RoughTurningEnv(SHORT_LIVED)] * 3
    sync: Any = gymnasium.vector.SyncVectorEnv(functions, autoreset_mode=mode)
    try:
        wrapped_sync = wrapped(vector, name, sync)
    except ValueError:  # Gymnasium refuses some modes, whatever the environment
        with pytest.raises(ValueError, match="autoreset_mode"):
            wrapped(vector, name, envs)
        return
    wrapped_envs = wrapped(vector, name, envs)
    wrapped_envs.action_space.seed(0)
    observations, _ = wrapped_envs.reset(seed=5)
    expected_observations, _ = wrapped_sync.reset(seed=5)
    np.testing.assert_array_equal(observations, expected_observations)
    for _ in range(70):
        actions = wrapped_envs.action_space.sample()
        step = wrapped_envs.step(actions)
        expected_step = wrapped_sync.step(actions)
        observations, _, terminated, truncated, _ = step
        assert observations in wrapped_envs.observation_space
        # All but the infos.
        for result, expected in zip(step[:4], expected_step[:4], strict=True):
            np.testing.assert_array_equal(result, expected)
        ended = terminated | truncated
        if mode is AutoresetMode.DISABLED and ended.any():
            first, _ = wrapped_envs.reset(options={"reset_mask": ended.copy()})
            expected_first, _ = wrapped_sync.reset(options={"reset_mask": ended.copy()})
            np.testing.assert_array_equal(first, expected_first)
