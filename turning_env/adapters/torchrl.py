"""The vector environment as an environment of TorchRL."""

import os
from collections.abc import Iterable
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from turning_env.extras import needed
from turning_env.family_env import vector_env
from turning_env.info import INFO_KEYS
from turning_env.scenario import Scenario
from turning_env.scenario.family import Family

with needed():
    import torch
    from tensordict import TensorDict, TensorDictBase  # type: ignore[import-untyped]
    from torchrl.data import Bounded, Categorical, Composite, Unbounded  # type: ignore[import-untyped]
    from torchrl.envs import EnvBase  # type: ignore[import-untyped]


class RoughTurningTorchEnv(EnvBase):  # type: ignore[misc]
    """``num_envs`` environments as one TorchRL environment of batch size (num_envs,), on the CPU.

    See ``RoughTurningEnv`` for the specification. TorchRL resets environments whose episodes have ended. After ``set_seed(s)``,
    the next ``reset`` or ``rollout`` starts episode 0 of seed s + i in environment i; other resets start the next episode.

    Args:
        num_envs: number of environments, at least 1.
        scenario: the name of a preset, the path of a TOML file, a ``Scenario``, or a ``Family`` or its name, whose training jobs
            are played.
        info: entries of the info to record beside the observation: float32, shape (num_envs, 1), in the info's units.
        threads: see ``RoughTurningVectorEnv``.

    Raises:
        ModuleNotFoundError: TorchRL is not installed.
        ScenarioError: the scenario cannot be loaded.
        ValueError: ``info`` names an unknown entry; or ``RoughTurningVectorEnv`` raises it.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | os.PathLike[str] | Scenario | Family = "rough_turning",
        info: Iterable[str] = (),
        threads: int = 1,
    ) -> None:
        self.info = tuple(info)
        if unknown := [name for name in self.info if name not in INFO_KEYS]:
            raise ValueError(f"info is {unknown[0]!r}, but must be among {', '.join(INFO_KEYS)}")
        self.vector_env = vector_env(scenario, num_envs, AutoresetMode.DISABLED, threads)
        super().__init__(device=torch.device("cpu"), batch_size=torch.Size([num_envs]))
        self._next_seed: int | None = None
        column = torch.Size([num_envs, 1])
        seen = {"observation": _bounded(self.vector_env.observation_space)}
        seen |= {name: Unbounded(column, dtype=torch.float32) for name in self.info}
        self.observation_spec = Composite(seen, shape=self.batch_size)
        self.action_spec = _bounded(self.vector_env.action_space)
        self.reward_spec = Unbounded(column, dtype=torch.float32)
        ends = ("done", "terminated", "truncated")
        self.done_spec = Composite(dict.fromkeys(ends, Categorical(2, column, dtype=torch.bool)), shape=self.batch_size)

    def close(self, *, raise_if_closed: bool = True) -> None:
        super().close(raise_if_closed=raise_if_closed)
        self.vector_env.close()

    def _set_seed(self, seed: int | None) -> None:
        self._next_seed = seed

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: Any) -> TensorDictBase:
        seed, self._next_seed = self._next_seed, None
        options: dict[str, Any] = {}
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if seed is None and mask is not None:
            options["reset_mask"] = mask.reshape(-1).numpy()
        observations, infos = self.vector_env.reset(seed=seed, options=options)
        return TensorDict(self._seen(observations, infos), self.batch_size)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        observations, rewards, terminated, truncated, infos = self.vector_env.step(tensordict["action"].numpy())
        results = {
            "reward": _column(rewards.astype(np.float32)),
            "done": _column(terminated | truncated),
            "terminated": _column(terminated),
            "truncated": _column(truncated),
        }
        return TensorDict(self._seen(observations, infos) | results, self.batch_size)

    def _seen(self, observations: Any, infos: dict[str, Any]) -> dict[str, torch.Tensor]:
        seen = {"observation": torch.from_numpy(observations)}
        return seen | {name: _column(infos[name].astype(np.float32)) for name in self.info}


def _bounded(space: Any) -> Bounded:
    return Bounded(torch.from_numpy(space.low), torch.from_numpy(space.high), space.shape, dtype=torch.float32)


def _column(values: Any) -> torch.Tensor:
    return torch.from_numpy(values[:, np.newaxis])
