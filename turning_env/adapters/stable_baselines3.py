"""The vector environment behind the interface of Stable-Baselines3.

No Python loop runs over the environments.
"""

import os
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorWrapper
from numpy.typing import NDArray

from turning_env.env import check_options
from turning_env.extras import needed
from turning_env.family_env import vector_env
from turning_env.scenario import Scenario
from turning_env.scenario.family import Family
from turning_env.vector_env import info_at_end_of_step

with needed():
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv

Indices = int | Iterable[int] | None
_SINGLE = {
    "observation_space": "single_observation_space",
    "action_space": "single_action_space",
}
"""Attributes of a single environment that a vector environment names otherwise."""


class RoughTurningVecEnv(VecEnv):
    """``num_envs`` environments behind Stable-Baselines3's ``VecEnv``.

        PPO("MlpPolicy", RoughTurningVecEnv("rough_turning", 64)).learn(500_000)

    Override ``training_rewards`` in a subclass to train on other rewards. At an episode's end, an
    environment's info is that of the last step, with ``terminal_observation``,
    ``TimeLimit.truncated`` and ``episode``: return "r" [s of machine time], unscaled, length "l",
    and "cost", the sum of ``info["cost"]`` [s], at most 0 on average if a policy is feasible. All
    other infos, and ``reset_infos``, are empty. As these are what ``Monitor`` adds,
    ``evaluate_policy`` and ``EvalCallback`` report returns, not scaled rewards.

    ``get_attr`` reads what a single environment has. ``env_method`` calls ``render``, ``job`` (of a
    family), ``get_wrapper_attr`` and ``has_wrapper_attr``.

    Args:
        scenario: the name of a preset, the path of a TOML file, a ``Scenario``, or a ``Family`` or
            its name, such as "shop", whose training jobs are played.
        num_envs: number of environments.
        reward_scale: factor on the rewards.
        wrapper: vector wrapper of Gymnasium.
        render_mode: None, or "rgb_array", which ``VecVideoRecorder`` needs.
        rendered_envs: number of environments to draw, from the first on. None: all.
    """

    def __init__(
        self,
        scenario: str | os.PathLike[str] | Scenario | Family,
        num_envs: int,
        reward_scale: float = 1.0,
        wrapper: Callable[[Any], Any] = lambda env: env,
        render_mode: str | None = None,
        rendered_envs: int | None = None,
    ) -> None:
        batch = vector_env(
            scenario,
            num_envs,
            autoreset_mode=AutoresetMode.SAME_STEP,
            render_mode=render_mode,
            rendered_envs=rendered_envs,
        )
        env = wrapper(batch)
        self.vector_env = env
        self.reward_scale = reward_scale
        self._actions: NDArray[np.float32] = np.zeros(env.action_space.shape or (), np.float32)
        self._returns = np.zeros(num_envs)
        self._lengths = np.zeros(num_envs, np.int64)
        self._costs = np.zeros(num_envs)
        super().__init__(num_envs, env.single_observation_space, env.single_action_space)
        self.metadata = env.metadata

    def reset(self) -> NDArray[np.float32]:
        """Return first observations, shape (num_envs, entries).

        After ``seed(s)``, environment i has the seed s + i; otherwise seeds are random.
        """
        for options in self._options:
            check_options(options)
        self._reset_options()
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations: NDArray[np.float32]
        observations, _ = self.vector_env.reset(seed=seeds)
        self._reset_seeds()
        self._clear_sums(np.ones(self.num_envs, np.bool_))
        return observations

    def _clear_sums(self, mask: NDArray[np.bool_]) -> None:
        """Set the sums over an episode to 0 in the environments of a mask, shape (num_envs,)."""
        self._returns[mask] = 0.0
        self._lengths[mask] = 0
        self._costs[mask] = 0.0

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        observations, rewards, terminated, truncated, infos = self.vector_env.step(self._actions)
        training_rewards = self.training_rewards(rewards, infos)
        ended = terminated | truncated
        self._returns += rewards
        self._lengths += 1
        self._costs += info_at_end_of_step(infos, "cost")
        # All environments whose episode goes on share one empty dictionary.
        env_infos: list[dict[str, Any]] = [{}] * self.num_envs
        if ended.any():
            env_indices = np.flatnonzero(ended)
            last_infos = _infos_by_env(infos["final_info"], env_indices)
            for index, info in zip(env_indices.tolist(), last_infos, strict=True):
                observation = infos["final_obs"][index]
                env_infos[index] = info | self._info_at_end(index, observation, truncated[index])
            self._clear_sums(ended)
        scaled_rewards = (training_rewards * self.reward_scale).astype(np.float32)
        return observations, scaled_rewards, ended, env_infos

    def _info_at_end(
        self, index: int, observation: NDArray[np.float32], truncated: bool
    ) -> dict[str, Any]:
        """Return what an environment's info holds besides if its episode has ended."""
        episode = {
            "r": float(self._returns[index]),
            "l": int(self._lengths[index]),
            "cost": float(self._costs[index]),
        }
        return {
            "terminal_observation": observation,
            "TimeLimit.truncated": bool(truncated),
            "episode": episode,
        }

    def training_rewards(
        self, rewards: NDArray[np.float64], infos: dict[str, Any]
    ) -> NDArray[np.float64]:
        """Return the rewards to train on [s], shape (num_envs,), from a step's rewards and infos.

        Here they are the rewards unchanged.
        """
        return rewards

    def close(self) -> None:
        self.vector_env.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        num_indices = len(list(self._get_indices(indices)))
        return [self._wrapper_attr(_SINGLE.get(attr_name, attr_name))] * num_indices

    def _wrapper_attr(self, name: str) -> Any:
        """Return an attribute of the outermost wrapper that has it, or of the batch."""
        env = self.vector_env
        while not hasattr(env, name) and isinstance(env, VectorWrapper):
            env = env.env
        return getattr(env, name)

    def get_images(self) -> list[NDArray[np.uint8]]:
        """Return a frame of each rendered environment."""
        return list(self.vector_env.render())

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        raise NotImplementedError(
            "all environments share one scenario: make a new vector environment instead"
        )

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        env_indices = list(self._get_indices(indices))
        if method_name == "render":
            frames = self.vector_env.render()
            return [frames[index] for index in env_indices]
        if method_name == "job":
            job = self._wrapper_attr("job")
            return [job(index) for index in env_indices]
        if method_name == "get_wrapper_attr":
            return self.get_attr(method_args[0], env_indices)
        if method_name == "has_wrapper_attr":
            return [self.has_attr(method_args[0])] * len(env_indices)
        raise NotImplementedError(
            f"env_method cannot call {method_name!r} of one environment of a batch, only render, "
            "job, get_wrapper_attr and has_wrapper_attr"
        )

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Indices = None) -> list[bool]:
        # ``evaluate_policy`` asks, and then takes returns and lengths from the infos.
        is_wrapped = wrapper_class is Monitor
        return [is_wrapped] * len(list(self._get_indices(indices)))


def _infos_by_env(infos: dict[str, Any], env_indices: NDArray[np.int64]) -> list[dict[str, Any]]:
    """Return the infos of some environments as of single ones, from those of a batch."""
    names = [name for name in infos if not name.startswith("_")]
    columns = [infos[name][env_indices].tolist() for name in names]
    return [dict(zip(names, values, strict=True)) for values in zip(*columns, strict=True)]
