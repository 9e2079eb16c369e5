"""The vector environment.

``env.py`` specifies the task; ``batch/driver.py`` runs the steps.
"""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from turning_env.batch.driver import (
    Batch,
    Jobs,
    Trials,
    action_space,
    checked_seed,
    observation_space,
)
from turning_env.env import BaseEnv, check_options
from turning_env.info import INFO_KEYS, info_of
from turning_env.scenario import Source

_MASK_KEYS = [f"_{name}" for name in INFO_KEYS]

Array = NDArray[Any]
Mask = NDArray[np.bool_]
Infos = dict[str, Any]
Step = tuple[NDArray[np.float32], NDArray[np.float64], Mask, Mask, Infos]


class RoughTurningVectorEnv(BaseEnv, VectorEnv[NDArray[np.float32], NDArray[np.float32], Array]):
    """``num_envs`` independent environments, each exactly the ``RoughTurningEnv`` with its seed.

    See ``RoughTurningEnv`` for the specification. After ``reset(seed=s)``, environment i matches
    the single environment after ``reset(seed=s + i)`` bit for bit, across autoresets, for any
    number of environments. ``infos`` holds an array and a mask ``_key`` for each key of the single
    environment's info. All arrays that are returned are the caller's, to keep and to change.

    Args:
        num_envs: number of environments, at least 1.
        scenario: the name of a preset, the path of a TOML file, a dict of the values that differ,
            or a ``Scenario``.
        autoreset_mode: what follows on the end of an episode. NEXT_STEP (default): the next step
            ignores its action and starts the next episode, with reward 0. SAME_STEP: the last step
            of an episode returns the next one's first observation; the last observation and info
            are ``infos["final_obs"]`` and ``infos["final_info"]``. DISABLED: reset ended
            environments with ``options={"reset_mask": mask}``.
        render_mode: None, or "rgb_array": ``render()`` then returns a frame of each environment, as
            ``RoughTurningEnv`` draws it.
        rendered_envs: number of environments to draw, from the first on; each takes a few
            milliseconds. None: all.
        max_episode_steps: number of steps after which episodes are truncated, as by Gymnasium's
            ``TimeLimit`` around each environment. None or -1: when the scenario says.

    Raises:
        ValueError: an argument, a seed or the reset mask is not allowed, or an action not of shape
            (num_envs, action size).
        gymnasium.error.ResetNeeded: ``step`` or ``render`` before ``reset``, or ``step`` with
            DISABLED after an episode's end.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: Source | Jobs = "rough_turning",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        rendered_envs: int | None = None,
        max_episode_steps: int | None = None,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}, but must be at least 1")
        if rendered_envs is not None and not 1 <= rendered_envs <= num_envs:
            raise ValueError(
                f"rendered_envs is {rendered_envs}, "
                f"but must be None or 1 to num_envs, which is {num_envs}"
            )
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": 30,
            "autoreset_mode": self.autoreset_mode,
        }
        self._set_up(Batch(scenario, num_envs), render_mode, rendered_envs or num_envs)
        self._max_episode_steps = _checked_max_episode_steps(max_episode_steps)
        self.single_observation_space = observation_space(self.scenario, self._batch.context_size)
        self.single_action_space = action_space(self.scenario)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], Infos]:
        """Start an episode in every environment, or in those of ``options["reset_mask"]``.

        The mask is bool, shape (num_envs,). Environment i starts episode 0 of seed ``seed + i`` or
        ``seed[i]``; without a seed, the next episode of its present seed.
        """
        check_options(options, "reset_mask")
        batch = self._batch
        chosen = self._reset_mask(options)
        given, seeds = self._seeds(seed)
        super().reset(seed=int(seed) if isinstance(seed, int | np.integer) else None)
        seeded = np.flatnonzero(chosen & given)
        batch.seed(seeded, seeds[seeded])
        batch.start(chosen)
        if self._viewer is not None:
            self._viewer.note()
        return batch.observations.copy(), self._infos(np.where(chosen, batch.table, 0.0), chosen)

    def step(self, actions: Any) -> Step:
        """Run one step in every environment; actions of shape (num_envs, action size)."""
        batch = self._batch
        if not batch.seeded:
            raise ResetNeeded("call reset() first: no episode is under way")
        if self.autoreset_mode is AutoresetMode.DISABLED and batch.ended.any():
            ended_envs = np.flatnonzero(batch.ended).tolist()
            raise ResetNeeded(f"the episodes of environments {ended_envs} have ended")
        batch.step(actions)
        if self._max_episode_steps is not None:
            batch.truncate_after(self._max_episode_steps)
        # Read before the next episodes start, which write a new table.
        rewards = batch.rewards
        terminated = batch.terminated
        truncated = batch.truncated
        final: Infos = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            ended = terminated | truncated
            if ended.any():
                final = self._final_infos(ended)
                batch.start(ended)
        if self._viewer is not None:
            self._viewer.note()
        infos = self._infos(batch.table) | final
        # A copy, because a later reset of some environments returns the others' observations again.
        return batch.observations.copy(), rewards, terminated, truncated, infos

    def trials(self) -> Trials:
        """Return trials of the next step, which do not move the environments."""
        return Trials(self._batch)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a frame of each rendered environment: uint8, shape (640, 960, 3)."""
        return super().render() if self._viewer is None else tuple(self._viewer.frames())

    def _seeds(self, seed: int | Sequence[int | None] | None) -> tuple[Mask, NDArray[np.uint64]]:
        """Return which environments get a new seed, and the new seeds; both shape (num_envs,)."""
        numbers: Sequence[int | None] = [None] * self.num_envs
        if isinstance(seed, Sequence) or (isinstance(seed, np.ndarray) and seed.ndim > 0):
            numbers = seed
        elif seed is not None:
            first = checked_seed(seed, 0)
            numbers = range(first, first + self.num_envs)
        if len(numbers) != self.num_envs:
            raise ValueError(
                f"{len(numbers)} seeds given, "
                f"but there must be one for each of {self.num_envs} environments"
            )
        given = np.zeros(self.num_envs, np.bool_)
        seeds = np.zeros(self.num_envs, np.uint64)
        for i, number in enumerate(numbers):
            if number is not None:
                given[i] = True
                seeds[i] = checked_seed(number, i)
        if not self._batch.seeded:
            seeds[~given] = self.np_random.integers(2**63, size=np.count_nonzero(~given))
            given[:] = True
        return given, seeds

    def _reset_mask(self, options: dict[str, Any] | None) -> Mask:
        if not options or "reset_mask" not in options:
            return np.ones(self.num_envs, np.bool_)
        try:
            mask = np.array(options["reset_mask"])
        except ValueError:  # ragged
            mask = np.array(None)
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(
                f"reset_mask must be bool of shape ({self.num_envs},), "
                f"got {options['reset_mask']!r}"
            )
        if not self._batch.seeded and not mask.all():
            raise ResetNeeded("the first reset() must start every environment")
        return mask

    def _infos(self, table: Array, mask: Mask | Literal[True] = True) -> Infos:
        """Return an array per key of the info, each with the mask of the environments with a value.

        ``table`` has the rows of a report; entries of other environments are 0.
        """
        # Every key has a mask of its own, because callers may change one.
        masks = np.empty((len(_MASK_KEYS), self.num_envs), np.bool_)
        masks[...] = mask
        infos: Infos = info_of(table)
        infos.update(zip(_MASK_KEYS, masks, strict=True))
        if self._batch.jobs is not None:
            infos["job"] = np.where(mask, self._batch.job_numbers, 0)
            infos["_job"] = masks[0].copy()
        return infos

    def _final_infos(self, ended: Mask) -> Infos:
        """Return the last observations and infos of ended episodes.

        Entries of other environments are None and 0.
        """
        final_obs = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(ended):
            final_obs[i] = self._batch.observations[i]
        final_info = self._infos(np.where(ended, self._batch.table, 0.0), ended)
        return {
            "final_obs": final_obs,
            "_final_obs": ended.copy(),
            "final_info": final_info,
            "_final_info": ended.copy(),
        }


def _checked_max_episode_steps(steps: int | None) -> int | None:
    """Return a number of steps, or None for no limit; ValueError if it is neither, nor -1."""
    if steps is None or steps == -1:
        return None
    if not isinstance(steps, int | np.integer) or steps < 1:
        raise ValueError(f"max_episode_steps is {steps!r}, but must be None, -1 or at least 1")
    return int(steps)


def info_at_end_of_step(infos: dict[str, Any], name: str) -> NDArray[np.float64]:
    """Return an entry of ``infos`` at the step's end, shape (num_envs,).

    It is that of the ended episode, even if the next one has already begun.
    """
    values: NDArray[np.float64] = infos[name]
    if "final_info" not in infos:
        return values
    return np.where(infos["_final_info"], infos["final_info"][name], values)
