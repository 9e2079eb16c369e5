"""Many environments at once."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from turning_env.lathes import Lathes, action_space, checked_seed, observation_space
from turning_env.records import REPORT_FIELDS, REPORT_FLAGS
from turning_env.scenario import Scenario

Array = NDArray[Any]
Infos = dict[str, Any]
Step = tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Infos]


class RoughTurningVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], Array]):
    """``num_envs`` independent lathes, each exactly the ``RoughTurningEnv`` that is seeded as its lane is.

    Specification: see ``RoughTurningEnv``. Lane i of ``reset(seed=s)`` is the single environment of ``reset(seed=s + i)``, bit
    for bit, across autoresets, for any number of lanes. ``infos`` holds an array per key of the single environment's info,
    and a mask ``_key`` beside it.

    Args:
        num_envs: number of lanes, at least 1.
        scenario: the name of a preset, the path of a TOML file, or a ``Scenario``.
        autoreset_mode: NEXT_STEP (default: the step after an episode's end ignores its action and starts the next episode,
            with reward 0), SAME_STEP (the last step of an episode returns the next one's first observation; the last
            observation and info are ``infos["final_obs"]`` and ``infos["final_info"]``) or DISABLED (ended lanes must be
            reset with ``options={"reset_mask": mask}``).
        render_mode: only None.

    Raises:
        ScenarioError: the scenario cannot be loaded; the message names the field, its value and what is allowed.
        ValueError: an action is not finite (names the lane) or not of shape (num_envs, 2); wrong seeds or reset mask.
        gymnasium.error.ResetNeeded: ``step`` before ``reset``, or with DISABLED after an episode's end.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | os.PathLike[str] | Scenario = "rough_turning",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}, but must be at least 1")
        if render_mode is not None:
            raise ValueError(f"render_mode is {render_mode!r}, but this environment has no render modes: only None")
        self.num_envs = num_envs
        self.scenario = Scenario.load(scenario)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.render_mode = None
        self.single_observation_space = observation_space(self.scenario)
        self.single_action_space = action_space(self.scenario)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._lathes = Lathes(self.scenario, num_envs)
        self._every_lane = np.ones(num_envs, np.bool_)
        self._every_lane.flags.writeable = False  # it goes out as a mask in every info

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], Infos]:
        """Start an episode in every lane, or in those of ``options["reset_mask"]`` (bool, shape (num_envs,)).

        Lane i starts episode 0 of ``seed + i`` or of ``seed[i]``; without a seed, the next episode of its present one.
        """
        lathes = self._lathes
        chosen = self._reset_mask(options)
        seeds = self._lane_seeds(seed)
        super().reset(seed=seed if isinstance(seed, int) else None)
        continued = chosen.copy()
        for lane in np.flatnonzero(chosen).tolist():
            lane_seed = seeds[lane]
            if lane_seed is not None:
                lathes.seed(lane, lane_seed)
                continued[lane] = False
        lathes.start(chosen & ~continued)
        lathes.next_episode(continued)
        lathes.seeded = True
        return lathes.answers.observations.copy(), self._infos(chosen)

    def step(self, actions: Any) -> Step:
        """Run one control interval in every lane; actions of shape (num_envs, 2)."""
        lathes = self._lathes
        if not lathes.seeded:
            raise ResetNeeded("call reset() first: no episode is under way")
        if self.autoreset_mode is AutoresetMode.DISABLED and lathes.answers.ends.any():
            raise ResetNeeded(f"the episodes of lanes {np.flatnonzero(lathes.answers.ends.any(axis=0)).tolist()} have ended")
        lathes.step(actions)
        terminated, truncated = lathes.answers.ends[0].copy(), lathes.answers.ends[1].copy()
        final: Infos = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            ended = terminated | truncated
            if ended.any():
                final = self._final_infos(ended)
                lathes.next_episode(ended)
        return (
            lathes.answers.observations.copy(),
            lathes.answers.rewards.copy(),
            terminated,
            truncated,
            final | self._infos(self._every_lane),
        )

    def _lane_seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        """The new seed of every lane; None where a lane goes on with the one it has."""
        given: Sequence[int | None]
        if seed is None:
            given = [None] * self.num_envs
        elif isinstance(seed, Sequence | np.ndarray):
            given = seed
        else:
            first = checked_seed(seed, 0)
            given = range(first, first + self.num_envs)
        if len(given) != self.num_envs:
            raise ValueError(f"there are {len(given)} seeds, but must be one for each of {self.num_envs} lanes")
        seeds = [None if number is None else checked_seed(number, lane) for lane, number in enumerate(given)]
        if self._lathes.seeded:
            return seeds
        return [int(self.np_random.integers(2**63)) if number is None else number for number in seeds]

    def _reset_mask(self, options: dict[str, Any] | None) -> NDArray[np.bool_]:
        if not options or "reset_mask" not in options:
            return self._every_lane
        mask = np.array(options["reset_mask"])
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"reset_mask must be bool of shape ({self.num_envs},), got {mask.dtype} of {mask.shape}")
        if not self._lathes.seeded and not mask.all():
            raise ResetNeeded("the first reset() must start every lane")
        return mask

    def _infos(self, lanes: NDArray[np.bool_]) -> Infos:
        """One array per field of the report, with the mask of the lanes that it holds for."""
        table = self._lathes.answers.table.copy()
        infos: Infos = {}
        for name, values in zip(REPORT_FIELDS, table, strict=True):
            infos[name] = values.astype(np.bool_) if name in REPORT_FLAGS else values
            infos["_" + name] = lanes
        return infos

    def _final_infos(self, ended: NDArray[np.bool_]) -> Infos:
        final_obs = np.full(self.num_envs, None, dtype=object)
        for lane in np.flatnonzero(ended):
            final_obs[lane] = self._lathes.answers.observations[lane].copy()
        return {"final_obs": final_obs, "_final_obs": ended, "final_info": self._infos(ended), "_final_info": ended}
