"""Wrappers that changed the observations of a Stable-Baselines3 model in its training.

They are applied or refused when it plays. The model's file does not hold these wrappers: a model
trained with ``VecNormalize`` and shown plain observations acts on numbers that it has never seen.
"""

from collections.abc import Iterator
from typing import Any

import gymnasium
from gymnasium import logger
from gymnasium.vector import VectorObservationWrapper

_NEUTRAL = ("VecMonitor", "VecCheckNan")
"""Wrappers of Stable-Baselines3 that leave observations as they are."""
ADVICE = (
    "give a function that changes observations likewise, such as "
    "lambda observations: "
    "model.predict(statistics.normalize_obs(observations), deterministic=True)[0]; "
    "a stack of frames needs an object with reset and act"
)


def normalisation(model: Any) -> Any:
    """Return the ``VecNormalize`` whose statistics a model needs; None if it needs none.

    Raise ValueError if the statistics are missing, or another wrapper of the training's environment
    changes observations. The policy of a model does not say how it was trained: a notice asks for
    the model.
    """
    if not hasattr(model, "get_env"):
        logger.warn(
            f"a {type(model).__name__} does not say whether VecNormalize or another wrapper "
            "changed its observations in training: it acts on plain ones; score the whole model "
            "to be sure"
        )
        return None
    env = model.get_env()
    statistics = None
    is_normalised = False
    for wrapper in [] if env is None else _vec_wrappers(env):
        kind = type(wrapper).__name__
        if kind == "VecNormalize":
            is_normalised = True
            if wrapper.norm_obs:
                statistics = wrapper
        elif kind not in _NEUTRAL:
            raise ValueError(
                f"the model was trained behind {kind}, which may change observations: {ADVICE}"
            )
    # Also of a model that was loaded with another environment than that of its training.
    if was_normalised(model) and not is_normalised:
        raise ValueError(
            "the model was trained with VecNormalize, whose statistics its file does not hold: "
            "load it with its environment, such as "
            f"PPO.load(path, env=VecNormalize.load(statistics, env)), or {ADVICE}"
        )
    name = None if env is None else _changing_wrapper(env)
    if name:
        raise ValueError(
            f"the model was trained behind {name}, which changes observations: {ADVICE}"
        )
    return statistics


def was_normalised(model: Any) -> bool:
    """Return whether a model was trained with ``VecNormalize``.

    Such a training keeps the observations before normalisation, and the model's file holds its
    first. They are also there if only rewards were normalised: the file does not say which. A model
    with a replay buffer keeps observations there in every training, so its environment tells, if it
    has one; without one, it may have been normalised.
    """
    if hasattr(model, "replay_buffer") and model.get_env() is not None:
        return False
    return getattr(model, "_last_original_obs", None) is not None


def _vec_wrappers(env: Any) -> Iterator[Any]:
    """Yield the wrappers of Stable-Baselines3 around an environment, the outermost first."""
    while "venv" in vars(env):
        yield env
        env = env.venv


def _changing_wrapper(env: Any) -> str | None:
    """Return the class of a wrapper of Gymnasium that changes observations, if there is one."""
    innermost = env
    for wrapper in _vec_wrappers(env):
        innermost = wrapper.venv
    envs = [*getattr(innermost, "envs", [])]
    if hasattr(innermost, "vector_env"):  # of RoughTurningVecEnv
        envs.insert(0, innermost.vector_env)
    for env_of_batch in envs:
        wrapped = env_of_batch
        while isinstance(wrapped, gymnasium.Wrapper | gymnasium.vector.VectorWrapper):
            if isinstance(wrapped, gymnasium.ObservationWrapper | VectorObservationWrapper):
                return type(wrapped).__name__
            wrapped = wrapped.env
    return None
