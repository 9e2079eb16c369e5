"""The driver of environments: their jobs and records, and the compiled loops over them."""

from functools import cache
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from turning_env.info import Info, info_of
from turning_env.numerics.compilation import compiled, compiled_entry, env_range
from turning_env.observation import bounds, observe
from turning_env.physics import quantities
from turning_env.physics.lathe import run_step, start_episode
from turning_env.physics.quantities import WIDTH, action_size
from turning_env.physics.records import (
    CHOICES,
    PARAMETERS,
    SCRATCH,
    STATE,
    new_records,
    numbers_of,
    parameter_records,
)
from turning_env.physics.report import write_state
from turning_env.scenario import Scenario, Source
from turning_env.scenario.family import CHUNK, CONTEXT_LIMIT, Family, Job

MAX_SEED = 2**64 - 1
_NUMBERS = "efdbhilqBHILQ"  # types of actions: real numbers of at most 8 bytes
_PADDING, _PAGE = 8, 512  # numbers of a cache line and of a memory page


def observation_space(
    scenario: Scenario, context_size: int = 0
) -> spaces.Space[NDArray[np.float32]]:
    """Return a new space of one environment's observations; a space carries its own sampling state."""
    low, high = bounds(scenario)
    context = np.full(context_size, CONTEXT_LIMIT, np.float32)
    return spaces.Box(
        np.concatenate([low, -context]), np.concatenate([high, context]), dtype=np.float32
    )


def action_space(scenario: Scenario) -> spaces.Space[NDArray[np.float32]]:
    """Return a new space of one environment's actions; a space carries its own sampling state."""
    return spaces.Box(-1.0, 1.0, (action_size(scenario),), np.float32)


def checked_seed(seed: Any, env_index: int) -> int:
    """Return the seed as an integer; ValueError if it is not a whole number from 0 to 2**64 - 1."""
    if not isinstance(seed, int | np.integer) or not 0 <= seed <= MAX_SEED:
        raise ValueError(
            f"seed {seed!r} of environment {env_index} must be a whole number, 0 to {MAX_SEED}"
        )
    return int(seed)


@compiled
def write_out(state, scratch, p, first, last, start, observations, table):
    """Copy observations and reports of some environments of a block into the arrays of all; the block begins at ``start``."""
    work, report = scratch.work, scratch.report
    write_state(state, report, first, last, p)
    observe(state, work, first, last, p)
    start = np.uint64(start)  # without a sign, as the numbers of environments
    for k in range(table.shape[0]):
        for i in env_range(first, last):
            table[k, start + i] = report.table[k, i]
    for k in range(p.entries):
        place = p.observation_layout[k]
        for i in env_range(first, last):
            observations[start + i, k] = work.observation[place, i]


@compiled_entry
def start_episodes(states, parameters, scratches, chosen, observations, table):
    """Start an episode in every chosen environment (``chosen``: bool, shape (environments,))."""
    scratch = scratches[0]
    for k in range(chosen.shape[0]):
        if chosen[k]:
            state, i = states[k // WIDTH], k % WIDTH
            p = parameters[k // WIDTH % parameters.shape[0]]
            start_episode(state, scratch.work, scratch.report, i, p)
            write_out(state, scratch, p, i, i + 1, k - i, observations, table)


@compiled_entry
def step_blocks(states, parameters, scratches, actions, observations, table):
    """Run one step in every environment; ended ones start their next episode instead.

    ``parameters`` holds a record for every block, or one for all.

    Return whether the actions are finite; if not, none has moved.
    """
    finite = True
    for i in env_range(0, actions.shape[0]):
        for k in range(actions.shape[1]):
            finite &= abs(actions[i, k]) < np.inf
    if not finite:
        return False
    scratch = scratches[0]
    work, report = scratch.work, scratch.report
    for b in range(states.shape[0]):
        state, start, p = states[b], b * WIDTH, parameters[b % parameters.shape[0]]
        count = min(WIDTH, actions.shape[0] - start)
        for i in range(count):
            work.ended_before[i] = state.ended[i]
        run_step(state, work, report, actions[start : start + WIDTH], count, p)
        for i in range(count):
            if work.ended_before[i] > 0:
                state.episode[i] += np.uint64(1)
                start_episode(state, work, report, i, p)
        write_out(state, scratch, p, 0, count, start, observations, table)
    return True


class Jobs:
    """The jobs of a split, by number; ``told``: whether the nominal model's numbers are appended to observations."""

    def __init__(self, family: Family, split: str, told: bool) -> None:
        self.family, self.split = family, split
        self._told = told
        self._chunk = cache(self._draw)
        # A job's scenario, of which every job has the choices, such as its action and its sensors.
        self.scenario: Scenario = family.job(0, split).scenario
        self.context_names = (
            family.context_names if told else ()
        )  # of what is appended to an observation
        self.parameters = parameter_records(
            self.scenario
        )  # of one block; the jobs share those of ``CHOICES``

    def __reduce__(self) -> Any:
        """Pickle and copy the split without its jobs."""
        return Jobs, (self.family, self.split, self._told)

    def __getitem__(self, number: int) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Return a job's numbers, in the order of ``PARAMETERS``, and its context."""
        numbers, context = self._chunk(number // CHUNK)
        return numbers[number % CHUNK], context[number % CHUNK]

    def _draw(self, chunk: int) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        draw = self.family.draw(self.split, chunk)
        records = parameter_records(draw.true, CHUNK, draw.nominal)
        for name in CHOICES:
            if (records[name] != self.parameters[name][0]).any():
                raise ValueError(
                    f"the jobs of family {self.family.name!r} must all have the same {name}"
                )
        numbers = numbers_of(records).swapaxes(1, 2).reshape(CHUNK, -1)
        context = self.family.context(draw.features) if self._told else np.zeros((CHUNK, 0))
        return numbers, context.astype(np.float32)


class Batch:
    """``num_envs`` environments of one scenario with the results of their last step. Both Gymnasium environments use it.

    Args:
        source: scenario to play, or jobs of which every episode plays one.
        num_envs: number of environments.
        single: whether actions have shape (action size,), and every step fills the same arrays, which ``observation`` and
            ``report`` view.

    Attributes:
        seeded: whether episodes have been started.
        actions: float64, shape (num_envs, action size): the last.
        observations: float32, shape (num_envs, entries). Every step fills a new array, unless ``single``.
        table: float64, shape (len(quantities.REPORT), num_envs), a row for each quantity. Likewise.
    """

    def __init__(self, source: Source | Jobs, num_envs: int, single: bool = False) -> None:
        self.num_envs, self._single = num_envs, single
        self.seeded = False
        self.jobs = jobs = source if isinstance(source, Jobs) else None
        self.scenario = scenario = (
            source.scenario if isinstance(source, Jobs) else Scenario.load(source)
        )
        blocks = -(-num_envs // WIDTH)
        self._parameters: Any = (
            np.repeat(jobs.parameters, blocks) if jobs else parameter_records(scenario)
        )
        self.context_size = len(jobs.context_names) if jobs else 0
        self._context = np.zeros((num_envs, self.context_size), np.float32)
        self.job_numbers = np.zeros(num_envs, np.int64)
        self._states = new_records(STATE, blocks)
        self.actions = np.zeros((num_envs, action_size(scenario)))
        self._entries = len(quantities.layout(scenario))
        self.observations = np.zeros((num_envs, self._entries + self.context_size), np.float32)
        self.table = np.zeros((len(quantities.REPORT), num_envs))
        # Rows a whole number of memory pages apart would share a few places of the processor's first cache.
        padding = _PADDING if num_envs % _PAGE < _PADDING <= num_envs else 0
        self._table_shape = len(quantities.REPORT), num_envs + padding
        self._prepare()

    def _prepare(self) -> None:
        """Make the attributes that a copy or a pickle does not hold."""
        self._scratches = new_records(SCRATCH, 1)
        self._given = self.actions[0] if self._single else self.actions
        self._shape = self._given.shape
        self.observation: NDArray[np.float32] = self.observations[0]
        self.report: NDArray[np.float64] = self.table[:, 0]

    def __getstate__(self) -> dict[str, Any]:
        made_again = ("_scratches", "_given", "observation", "report")
        return {name: value for name, value in vars(self).items() if name not in made_again}

    def __setstate__(self, values: dict[str, Any]) -> None:
        vars(self).update(values)
        for name, dtype in (("_states", STATE), ("_parameters", PARAMETERS)):
            records = vars(self)[name] = new_records(dtype, len(values[name]))
            records[...] = values[name]
        self._prepare()

    @property
    def ended(self) -> NDArray[np.bool_]:
        """Whether the episodes have ended, shape (num_envs,)."""
        return np.asarray(self._states["ended"].ravel()[: self.num_envs] > 0)

    def state(self, env_index: int, name: str) -> Any:
        """Return a quantity of an environment's state (``quantities.STATE``)."""
        block, i = divmod(env_index, WIDTH)
        return self._states[name][block, i].item()

    def info(self, env_index: int) -> Info:
        """Return an environment's info after its last step or reset."""
        info = info_of(self.table[:, env_index].tolist())
        return info | {"job": int(self.job_numbers[env_index])} if self.jobs else info

    def job(self, env_index: int) -> Job:
        """Return an environment's present job: its true scenario, nominal model and context."""
        assert self.jobs is not None
        return self.jobs.family.job(int(self.job_numbers[env_index]), self.jobs.split)

    def seed(self, env_indices: Any, seeds: Any) -> None:
        """Set environments' seeds; the next episode is the first of its seed, episode 0. See ``checked_seed``."""
        block, i = np.divmod(env_indices, WIDTH)
        self._states["seed"][block, i] = seeds
        self._states["episode"][block, i] = (
            MAX_SEED  # before 0, as numbers without a sign begin anew
        )

    def start(self, chosen: NDArray[np.bool_]) -> None:
        """Start the next episode of its seed in every chosen environment, shape (num_envs,)."""
        if not self._single:
            self.observations, self.table = self.observations.copy(), self.table.copy()
        env_indices = np.flatnonzero(chosen)
        block, i = np.divmod(env_indices, WIDTH)
        self._states["episode"][block, i] += np.uint64(1)
        self._take_jobs(env_indices)
        start_episodes(
            self._states, self._parameters, self._scratches, chosen, self.observations, self.table
        )
        self.observations[:, self._entries :] = self._context
        self.seeded = True

    def _take_jobs(self, env_indices: NDArray[np.int64], ahead: int = 0) -> None:
        """Give environments the job of their episode, or of an episode ahead."""
        if self.jobs is None:
            return
        for k in env_indices.tolist():
            block, i = divmod(k, WIDTH)
            seed, episode = self._states["seed"][block, i], self._states["episode"][block, i]
            number = self.jobs.family.number(int(seed), int(episode) + ahead, self.jobs.split)
            self.job_numbers[k] = number
            numbers_of(self._parameters)[block, :, i], self._context[k] = self.jobs[number]

    def step(self, actions: Any) -> None:
        """Run one step in every environment, or start the next episode if one has ended.

        ValueError if the actions are not finite numbers of shape (num_envs, action size); then no environment has moved.
        """
        try:
            given = np.asarray(actions)
        except ValueError:  # ragged
            given = np.array(None)
        if given.shape != self._shape or given.dtype.char not in _NUMBERS:
            got = f"shape {given.shape}" if given.dtype.char in _NUMBERS else repr(actions)
            raise ValueError(f"actions must be numbers of shape {self._shape}, got {got}")
        self._given[...] = given
        if self.jobs is not None and self.ended.any() and np.isfinite(self._given).all():
            self._take_jobs(np.flatnonzero(self.ended), 1)
        observations, table = self.observations, self.table
        if not self._single:
            observations, table = (
                np.empty(observations.shape, np.float32),
                np.empty(self._table_shape),
            )
        if not step_blocks(
            self._states, self._parameters, self._scratches, self.actions, observations, table
        ):
            i = int(np.isfinite(self.actions).all(axis=1).argmin())
            raise ValueError(
                f"the action of environment {i} must be finite, got {self.actions[i].tolist()}"
            )
        if self.jobs is not None:
            observations[:, self._entries :] = self._context
        if not self._single:
            self.observations, self.table = observations, table[:, : self.num_envs]


REWARD, TERMINATED, TRUNCATED = range(
    len(quantities.INFO), len(quantities.REPORT)
)  # rows of ``Batch.table``
