"""Gymnasium's own wrappers, single and vector, on every id: each that can apply works."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import gymnasium.wrappers as single
import gymnasium.wrappers.vector as vector
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.turning_env.playing import SHORT_LIVED
from turning_env import IDS, RoughTurningEnv, RoughTurningVectorEnv

ZERO, ONE = np.float32(0), np.float32(1)

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
    "ReshapeObservation": lambda env: ((1, *getattr(env, "single_observation_space", env.observation_space).shape),),
    "StickyAction": lambda env: (0.25,),
    "TimeLimit": lambda env: (10,),
    "TransformAction": lambda env: (np.negative, *spaces_of(env, "action_space")),
    "TransformObservation": lambda env: (lambda seen: seen / 2, *spaces_of(env, "observation_space")),
    "TransformReward": lambda env: (lambda reward: reward / 3,),
    "VectorizeTransformAction": lambda env: (single.ClipAction,),
    "VectorizeTransformObservation": lambda env: (single.FlattenObservation,),
    "VectorizeTransformReward": lambda env: (partial(single.TransformReward, func=lambda reward: reward / 3),),
}
"""The arguments of wrappers that take more than an environment."""
PICTURES: dict[str, Callable[[Any, Path], Any]] = {
    "AddRenderObservation": lambda env, folder: single.AddRenderObservation(env),
    "AddWhiteNoise": lambda env, folder: single.AddWhiteNoise(single.AddRenderObservation(env), 0.1),
    "GrayscaleObservation": lambda env, folder: single.GrayscaleObservation(single.AddRenderObservation(env)),
    "HumanRendering": lambda env, folder: single.HumanRendering(env),
    "ObstructView": lambda env, folder: single.ObstructView(single.AddRenderObservation(env), 0.1, 8),
    "RecordVideo": lambda env, folder: single.RecordVideo(env, str(folder), lambda number: True, disable_logger=True),
    "RenderCollection": lambda env, folder: single.RenderCollection(env),
}
NOT_APPLICABLE = {
    "vector",  # the module
    "AtariPreprocessing",
    "ResizeObservation",  # needs OpenCV, as does the vector HumanRendering
    "FilterObservation",  # of dictionaries and tuples
    *("ArrayConversion", "JaxToNumpy", "JaxToTorch", "NumpyToTorch"),  # need array-api-compat
}

SINGLE = sorted(set(single.__all__) - PICTURES.keys() - NOT_APPLICABLE)
VECTOR = sorted(set(vector.__all__) - PICTURES.keys() - NOT_APPLICABLE)

# Gymnasium refuses these itself, whatever the environment.
REFUSED = {
    AutoresetMode.NEXT_STEP: set(),
    AutoresetMode.SAME_STEP: {name for name in VECTOR if "Observation" in name},
    AutoresetMode.DISABLED: {"NormalizeObservation"},
}


def spaces_of(env: Any, kind: str) -> tuple[Any, ...]:
    """Return the space that a single environment's wrapper takes."""
    return () if hasattr(env, "num_envs") else (getattr(env, kind),)


def wrapped(module: Any, name: str, env: Any) -> Any:
    """The environment in Gymnasium's wrapper of a name."""
    if name == "TimeAwareObservation":  # wants to know a time limit; the ids state none, as limits are the scenario's
        env = single.TimeLimit(env, 10)
    arguments: tuple[Any, ...] = ARGUMENTS[name](env) if name in ARGUMENTS else ()
    return getattr(module, name)(env, *arguments)


@pytest.mark.slow
@pytest.mark.parametrize("name", PICTURES)
def test_pictures(name: str, tmp_path: Path) -> None:
    env = PICTURES[name](gymnasium.make("RoughTurning-v0", render_mode="rgb_array"), tmp_path / "films")
    env.action_space.seed(0)
    seen, _ = env.reset(seed=0)
    for _ in range(3):
        assert seen in env.observation_space
        seen, *_ = env.step(env.action_space.sample())
    shown = env.render()
    assert len(shown) == 4 if name == "RenderCollection" else (shown is None) == (name == "HumanRendering")
    env.close()
    assert len(list(tmp_path.glob("films/*.mp4"))) == (name == "RecordVideo")


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("name", SINGLE)
def test_single(name: str, env_id: str) -> None:
    scenario = SHORT_LIVED if env_id == "RoughTurning-v0" else IDS[env_id]
    env = wrapped(single, name, gymnasium.make(env_id, scenario=scenario))
    env.action_space.seed(0)
    seen, _ = env.reset(seed=0)
    for _ in range(40):
        assert seen in env.observation_space
        seen, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        assert np.isfinite(reward)
        if (terminated or truncated) and name != "Autoreset":
            seen, _ = env.reset()


@pytest.mark.slow
@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("name", VECTOR)
def test_vector_as_gymnasiums_own_vector_environment(name: str, mode: AutoresetMode) -> None:
    num_envs = 3
    ours: Any = RoughTurningVectorEnv(num_envs, SHORT_LIVED, mode)
    theirs: Any = gymnasium.vector.SyncVectorEnv([lambda: RoughTurningEnv(SHORT_LIVED)] * num_envs, autoreset_mode=mode)
    if name in REFUSED[mode]:
        for envs in (ours, theirs):
            with pytest.raises(ValueError, match="autoreset_mode"):
                wrapped(vector, name, envs)
        return
    ours, theirs = wrapped(vector, name, ours), wrapped(vector, name, theirs)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    ours.action_space.seed(0)
    seen, _ = ours.reset(seed=5)
    np.testing.assert_array_equal(seen, theirs.reset(seed=5)[0])
    ends, returns = 0, np.zeros(num_envs)
    for _ in range(70):
        assert seen in ours.observation_space
        actions = ours.action_space.sample()
        seen, rewards, terminated, truncated, infos = ours.step(actions)
        expected = theirs.step(actions)
        for mine, their in zip((seen, rewards, terminated, truncated), expected, strict=False):
            np.testing.assert_array_equal(mine, their)
        ended = terminated | truncated
        ends += ended.sum()
        returns += rewards
        # Not compared with theirs: when some of the environments of Gymnasium's own are reset, the wrapper forgets all.
        if name == "RecordEpisodeStatistics" and ended.any():
            np.testing.assert_allclose(infos["episode"]["r"][ended], returns[ended])
        returns[ended] = 0.0
        if mode is AutoresetMode.DISABLED and ended.any():
            seen, _ = ours.reset(options={"reset_mask": ended})
            np.testing.assert_array_equal(seen, theirs.reset(options={"reset_mask": ended})[0])
    assert ends > num_envs
