"""The vector environment behind the interface of Stable-Baselines3.

No Python loop runs over the environments.
"""

import os
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from turning_env.extras import needed
from turning_env.family_env import vector_env
from turning_env.scenario import Scenario
from turning_env.scenario.family import Family

with needed():
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv

Indices = int | Iterable[int] | None


class RoughTurningVecEnv(VecEnv):
    """``num_envs`` environments behind Stable-Baselines3's ``VecEnv``.

        PPO("MlpPolicy", RoughTurningVecEnv("rough_turning", 64)).learn(500_000)

    Override ``training_rewards`` in a subclass to train on other rewards. At an episode's end, an
    environment's info holds ``terminal_observation``, ``TimeLimit.truncated`` and ``episode``
    (return [s of machine time] and length, unscaled). All other infos are empty. As these are what
    ``Monitor`` adds, ``evaluate_policy`` and ``EvalCallback`` report returns, not scaled rewards.

    Args:
        scenario: the name of a preset, the path of a TOML file, a ``Scenario``, or a ``Family`` or
            its name, such as "shop", whose training jobs are played.
        num_envs: number of environments.
        reward_scale: factor on the rewards.
        wrapper: vector wrapper of Gymnasium.
    """

    def __init__(
        self,
        scenario: str | os.PathLike[str] | Scenario | Family,
        num_envs: int,
        reward_scale: float = 1.0,
        wrapper: Callable[[Any], Any] = lambda env: env,
    ) -> None:
        env = wrapper(vector_env(scenario, num_envs, AutoresetMode.SAME_STEP))
        self.vector_env = env
        self.reward_scale = reward_scale
        self._actions: NDArray[np.float32] = np.zeros(env.action_space.shape or (), np.float32)
        self._returns = np.zeros(num_envs)
        self._lengths = np.zeros(num_envs, np.int64)
        super().__init__(num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Return first observations, shape (num_envs, entries).

        After ``seed(s)``, environment i has the seed s + i; otherwise seeds are random.
        """
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations: NDArray[np.float32]
        observations, _ = self.vector_env.reset(seed=seeds)
        self._reset_seeds()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return observations

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
        # All environments whose episode goes on share one empty dictionary.
        env_infos: list[dict[str, Any]] = [{}] * self.num_envs
        for index in np.flatnonzero(ended).tolist():
            env_infos[index] = self.info_at_end(index, infos["final_obs"][index], truncated[index])
        self._returns[ended] = 0.0
        self._lengths[ended] = 0
        scaled_rewards = (training_rewards * self.reward_scale).astype(np.float32)
        return observations, scaled_rewards, ended, env_infos

    def info_at_end(
        self, index: int, observation: NDArray[np.float32], truncated: bool
    ) -> dict[str, Any]:
        """Return the info of an environment whose episode has ended with an observation."""
        episode = {"r": float(self._returns[index]), "l": int(self._lengths[index])}
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
        return [getattr(self.vector_env, attr_name)] * num_indices

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        raise NotImplementedError(
            "all environments share one scenario: make a new vector environment instead"
        )

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        raise NotImplementedError(
            "the batch has no separate environments whose methods could be called"
        )

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Indices = None) -> list[bool]:
        # ``evaluate_policy`` asks, and then takes returns and lengths from the infos.
        is_wrapped = wrapper_class is Monitor
        return [is_wrapped] * len(list(self._get_indices(indices)))
