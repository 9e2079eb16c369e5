"""Many environments at once."""

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import logger
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from turning_env.batch.driver import MAX_SEED, Lathes, action_space, checked_seed, observation_space
from turning_env.batch.outputs import AnswerPool, Answers
from turning_env.info import EVERY_FIELD, with_values
from turning_env.physics.records import REPORT_FIELDS
from turning_env.scenario import Scenario

if TYPE_CHECKING:
    from turning_env.rendering.viewer import Viewer

_MASKS = ["_" + name for name in REPORT_FIELDS]

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
        render_mode: None, or "rgb_array": ``render()`` then returns a frame of each lane, as ``RoughTurningEnv`` draws it.
        threads: how many threads share the lanes, where these are enough for it to pay (8192); what a lane gives does not
            depend on it.
        rendered_lanes: of how many lanes, from the first on, frames are drawn; None: of all, a few milliseconds each.

    Raises:
        ScenarioError: the scenario cannot be loaded; the message names the field, its value and what is allowed.
        ValueError: ``num_envs`` or ``threads`` is below 1; ``rendered_lanes`` is not 1 to ``num_envs``; there is no such render
            mode; an action is not finite (names the lane) or not of shape (num_envs, 2); wrong seeds or reset mask.
        gymnasium.error.ResetNeeded: ``step`` or ``render`` before ``reset``, or ``step`` with DISABLED after an episode's end.
        gymnasium.error.DependencyNotInstalled: what rendering needs is not installed.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | os.PathLike[str] | Scenario = "rough_turning",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        threads: int = 1,
        rendered_lanes: int | None = None,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}, but must be at least 1")
        if threads < 1:
            raise ValueError(f"threads is {threads}, but must be at least 1")
        if rendered_lanes is not None and not 1 <= rendered_lanes <= num_envs:
            raise ValueError(f"rendered_lanes is {rendered_lanes}, but must be None or 1 to num_envs, which is {num_envs}")
        self.num_envs = num_envs
        self.scenario = Scenario.load(scenario)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 30, "autoreset_mode": self.autoreset_mode}
        self.render_mode = render_mode
        self.single_observation_space = observation_space(self.scenario)
        self.single_action_space = action_space(self.scenario)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._lathes = Lathes(self.scenario, num_envs, threads)
        self._viewer: Viewer | None = None
        if render_mode is not None:
            from turning_env.rendering import make_viewer  # only who renders needs what it needs

            self._viewer = make_viewer(self, self._lathes, rendered_lanes or num_envs)
        self._pool = AnswerPool(num_envs, self._lathes.entries)
        self._every_lane = np.ones(num_envs, np.bool_)
        self._every_lane.flags.writeable = False  # it goes out as a mask in every info
        self._entries = EVERY_FIELD | dict.fromkeys(_MASKS, self._every_lane)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], Infos]:
        """Start an episode in every lane, or in those of ``options["reset_mask"]`` (bool, shape (num_envs,)).

        Lane i starts episode 0 of ``seed + i`` or of ``seed[i]``; without a seed, the next episode of its present one.
        """
        lathes = self._lathes
        chosen = self._reset_mask(options)
        given, seeds = self._lane_seeds(seed)
        super().reset(seed=seed if isinstance(seed, int) else None)
        before, lathes.answers = lathes.answers, self._pool.next()
        lathes.answers.put(before)
        lanes = np.flatnonzero(chosen & given)
        lathes.seed(lanes, seeds[lanes])
        lathes.start(chosen & given)
        lathes.next_episode(chosen & ~given)
        lathes.answers.ends[:, chosen] = False
        lathes.seeded = True
        if self._viewer is not None:
            self._viewer.note()
        return lathes.answers.observations, self._infos(lathes.answers, chosen)

    def step(self, actions: Any) -> Step:
        """Run one control interval in every lane; actions of shape (num_envs, 2)."""
        lathes = self._lathes
        if not lathes.seeded:
            raise ResetNeeded("call reset() first: no episode is under way")
        if self.autoreset_mode is AutoresetMode.DISABLED and lathes.ended.any():
            raise ResetNeeded(f"the episodes of lanes {np.flatnonzero(lathes.ended).tolist()} have ended")
        before, lathes.answers = lathes.answers, self._pool.next()
        try:
            lathes.step(actions)
        except ValueError:
            lathes.answers = before
            raise
        answers = lathes.answers
        terminated, truncated = answers.ends
        final: Infos = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            ended = terminated | truncated
            if ended.any():
                final = self._final_infos(ended)
                lathes.next_episode(ended)
        if self._viewer is not None:
            self._viewer.note()
        return answers.observations, answers.rewards, terminated, truncated, final | self._infos(answers, self._every_lane)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A frame of each rendered lane, as it is now: uint8, shape (640, 960, 3)."""
        if self._viewer is None:
            logger.warn('nothing is rendered without a render mode: make the environment with render_mode="rgb_array"')
            return None
        return self._viewer.frames()

    def close_extras(self, **kwargs: Any) -> None:
        """Let the threads go."""
        self._lathes.close()

    def _lane_seeds(self, seed: int | Sequence[int | None] | None) -> tuple[NDArray[np.bool_], NDArray[np.uint64]]:
        """(whether a lane is given a new seed, the new seeds)."""
        count = self.num_envs
        given, seeds = np.ones(count, np.bool_), np.zeros(count, np.uint64)
        if seed is None:
            given[:] = False
        elif isinstance(seed, Sequence) or (isinstance(seed, np.ndarray) and seed.ndim > 0):
            if len(seed) != count:
                raise ValueError(f"there are {len(seed)} seeds, but must be one for each of {count} lanes")
            for lane, number in enumerate(seed):
                if number is None:
                    given[lane] = False
                else:
                    seeds[lane] = checked_seed(number, lane)
        else:
            first = checked_seed(seed, 0)
            fitting = min(count, MAX_SEED - first + 1)
            if fitting < count:
                checked_seed(first + fitting, fitting)
            seeds[:] = np.uint64(first) + np.arange(count, dtype=np.uint64)
        if not self._lathes.seeded:
            for unseeded in np.flatnonzero(~given):
                seeds[unseeded] = self.np_random.integers(2**63)
            given[:] = True
        return given, seeds

    def _reset_mask(self, options: dict[str, Any] | None) -> NDArray[np.bool_]:
        if not options or "reset_mask" not in options:
            return self._every_lane
        try:
            mask = np.array(options["reset_mask"])
        except ValueError as error:  # ragged
            raise ValueError(f"reset_mask must be bool of shape ({self.num_envs},), got {options['reset_mask']!r}") from error
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"reset_mask must be bool of shape ({self.num_envs},), got {mask.dtype} of {mask.shape}")
        if not self._lathes.seeded and not mask.all():
            raise ResetNeeded("the first reset() must start every lane")
        return mask

    def _infos(self, answers: Answers, mask: NDArray[np.bool_]) -> Infos:
        """One array per field of the report, with the mask of the lanes that it holds for."""
        entries = self._entries if mask is self._every_lane else EVERY_FIELD | dict.fromkeys(_MASKS, mask)
        return with_values(entries, answers.table)

    def _final_infos(self, ended: NDArray[np.bool_]) -> Infos:
        """The last observations and infos of the episodes that have ended; other lanes' are nothing and 0."""
        answers = self._lathes.answers
        final_obs = np.full(self.num_envs, None, dtype=object)
        for lane in np.flatnonzero(ended):
            final_obs[lane] = answers.observations[lane].copy()
        final = Answers(self.num_envs, 0)
        final.table[:, ended] = answers.table[:, ended]
        infos = self._infos(final, ended)
        return {"final_obs": final_obs, "_final_obs": ended, "final_info": infos, "_final_info": ended}
