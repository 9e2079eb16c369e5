"""The vector environment behind the interface of Stable-Baselines3, without a Python loop over environments."""

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
    from stable_baselines3.common.vec_env import VecEnv

Indices = int | Iterable[int] | None


class RoughTurningVecEnv(VecEnv):
    """``num_envs`` environments behind Stable-Baselines3's ``VecEnv``.

        PPO("MlpPolicy", RoughTurningVecEnv("rough_turning", 64)).learn(500_000)

    ``scenario`` is the name of a preset, the path of a TOML file, a ``Scenario``, or a ``Family`` or its name, such as "shop",
    whose training jobs are played. Rewards are multiplied by ``reward_scale``. ``wrapper`` is a vector wrapper of Gymnasium.
    Override ``training_rewards`` in a subclass to train on other rewards. At an episode's end, an environment's info holds
    ``terminal_observation``, ``TimeLimit.truncated`` and ``episode`` (return [s of machine time] and length, unscaled). All other
    infos are empty.
    """

    def __init__(
        self,
        scenario: str | os.PathLike[str] | Scenario | Family,
        num_envs: int,
        reward_scale: float = 1.0,
        wrapper: Callable[[Any], Any] = lambda env: env,
    ) -> None:
        self.vector_env = wrapper(vector_env(scenario, num_envs, AutoresetMode.SAME_STEP))
        self.reward_scale = reward_scale
        self._actions: NDArray[np.float32] = np.zeros(
            self.vector_env.action_space.shape or (), np.float32
        )
        self._returns = np.zeros(num_envs)
        self._lengths = np.zeros(num_envs, np.int64)
        super().__init__(
            num_envs, self.vector_env.single_observation_space, self.vector_env.single_action_space
        )

    def reset(self) -> NDArray[np.float32]:
        """Return first observations, shape (num_envs, entries); after ``seed(s)`` of seeds s + i, otherwise of random ones."""
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
        env_infos: list[dict[str, Any]] = [
            {}
        ] * self.num_envs  # one empty dictionary for all whose episode goes on
        for index in np.flatnonzero(ended).tolist():
            env_infos[index] = self.info_at_end(index, infos["final_obs"][index], truncated[index])
        self._returns[ended] = 0.0
        self._lengths[ended] = 0
        return (
            observations,
            (training_rewards * self.reward_scale).astype(np.float32),
            ended,
            env_infos,
        )

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
        """Return the rewards to train on, shape (num_envs,) [s], from a step's rewards and infos; here the rewards unchanged."""
        return rewards

    def close(self) -> None:
        self.vector_env.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        return [getattr(self.vector_env, attr_name)] * len(list(self._get_indices(indices)))

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
        return [False] * len(list(self._get_indices(indices)))
