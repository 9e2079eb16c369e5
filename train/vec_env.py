"""The vector environment as Stable-Baselines3 wants it, without a Python loop over lanes."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from turning_env import RoughTurningVectorEnv, Scenario


class RoughTurningVecEnv(VecEnv):
    """``count`` lathes behind Stable-Baselines3's ``VecEnv``.

    An episode's end puts ``terminal_observation``, ``TimeLimit.truncated`` and ``episode`` (return [s of machine time] and
    length, unscaled) into that lane's info; all other infos are empty. Rewards are multiplied by ``reward_scale``. A subclass
    from which something else is to be learned gives it as ``learned_rewards``.
    """

    def __init__(self, scenario: Scenario, count: int, reward_scale: float = 1.0) -> None:
        self.lathes_env = RoughTurningVectorEnv(count, scenario, AutoresetMode.SAME_STEP)
        self.reward_scale = reward_scale
        self._actions: NDArray[np.float32] = np.zeros(self.lathes_env.action_space.shape or (), np.float32)
        self._returns = np.zeros(count)
        self._lengths = np.zeros(count, np.int64)
        super().__init__(count, self.lathes_env.single_observation_space, self.lathes_env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """First observations, shape (count, 11). Lane i plays the seed given to ``seed`` plus i, else a random one."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations, _ = self.lathes_env.reset(seed=seeds)
        self._reset_seeds()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        observations, rewards, terminated, truncated, infos = self.lathes_env.step(self._actions)
        learned = self.learned_rewards(rewards, infos)
        ended = terminated | truncated
        self._returns += rewards
        self._lengths += 1
        lane_infos: list[dict[str, Any]] = [{}] * self.num_envs  # one dictionary for all that have nothing to say
        for lane in np.flatnonzero(ended).tolist():
            lane_infos[lane] = {
                "terminal_observation": infos["final_obs"][lane],
                "TimeLimit.truncated": bool(truncated[lane]),
                "episode": {"r": float(self._returns[lane]), "l": int(self._lengths[lane])},
            }
        self._returns[ended] = 0.0
        self._lengths[ended] = 0
        return observations, (learned * self.reward_scale).astype(np.float32), ended, lane_infos

    def learned_rewards(self, rewards: NDArray[np.float64], infos: dict[str, Any]) -> NDArray[np.float64]:
        """What is learned from, shape (count,) [s], for an interval's rewards and infos: here the rewards themselves."""
        return rewards

    def close(self) -> None:
        self.lathes_env.close()

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        return [getattr(self.lathes_env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        raise NotImplementedError("all lanes share one scenario: make a new environment instead")

    def env_method(
        self, method_name: str, *method_args: Any, indices: int | Iterable[int] | None = None, **method_kwargs: Any
    ) -> list[Any]:
        raise NotImplementedError("the lanes are not environments of their own: they have no methods to call")

    def env_is_wrapped(self, wrapper_class: type[Any], indices: int | Iterable[int] | None = None) -> list[bool]:
        return [False] * len(list(self._get_indices(indices)))


def of_interval(infos: dict[str, Any], name: str) -> NDArray[np.float64]:
    """An entry of the vector environment's infos as it was when the interval ended, also where the next episode has begun."""
    values: NDArray[np.float64] = infos[name]
    return np.where(infos["_final_info"], infos["final_info"][name], values) if "final_info" in infos else values
