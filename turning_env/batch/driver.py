"""The driver of environments: their jobs and records, and the compiled loops over them.

Equations of a step belong in ``physics``, Gymnasium's interface in ``env.py`` and
``vector_env.py``.
"""

from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from turning_env.info import Info, info_of
from turning_env.numerics.compilation import (
    FIRST_ENV,
    ONE_ENV,
    compiled,
    compiled_entry,
    env_range,
)
from turning_env.observation import bounds, observe
from turning_env.physics import quantities
from turning_env.physics.lathe import run_step, start_episode
from turning_env.physics.quantities import ROW, WIDTH, action_size
from turning_env.physics.records import (
    PARAMETERS,
    SCRATCH,
    SHARED_PARAMETERS,
    STATE,
    new_records,
    numbers_of,
    parameter_records,
)
from turning_env.physics.report import write_state
from turning_env.scenario import Scenario, Source
from turning_env.scenario.family import CHUNK, CONTEXT_LIMIT, Family, Job

Array32 = NDArray[np.float32]
Array64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAX_SEED = 2**64 - 1
_REAL_TYPES = "efdbhilqBHILQ"
"""Type codes of actions: real numbers of at most 8 bytes."""
_CACHE_LINE = 8  # numbers of a line of the processor's cache
_PAGE = 512  # numbers of a memory page


def observation_space(scenario: Scenario, context_size: int = 0) -> spaces.Space[Array32]:
    """Return a new space of one environment's observations.

    Spaces carry a sampling state of their own, so every environment needs a new one.
    """
    low, high = bounds(scenario)
    context = np.full(context_size, CONTEXT_LIMIT, np.float32)
    return spaces.Box(
        low=np.concatenate([low, -context]),
        high=np.concatenate([high, context]),
        dtype=np.float32,
    )


def action_space(scenario: Scenario) -> spaces.Space[Array32]:
    """Return a new space of one environment's actions; see ``observation_space``."""
    return spaces.Box(-1.0, 1.0, shape=(action_size(scenario),), dtype=np.float32)


def checked_seed(seed: Any, env_index: int) -> int:
    """Return the seed as an integer; ValueError if it is not a whole number from 0 to 2**64 - 1."""
    is_whole = isinstance(seed, int | np.integer)
    if not is_whole or not 0 <= seed <= MAX_SEED:
        raise ValueError(
            f"seed {seed!r} of environment {env_index} must be a whole number, 0 to {MAX_SEED}"
        )
    return int(seed)


@compiled
def write_out(state, scratch, p, first, last, start, observations, table):
    """Copy observations and reports of some environments of a block into the arrays of all.

    The block begins at environment ``start``. ``observations`` has shape (num_envs, entries),
    ``table``, with a row for each quantity of the report, shape (rows, num_envs).
    """
    work = scratch.work
    report = scratch.report
    write_state(state, report, first, last, p)
    observe(state, work, first, last, p)
    for k in range(table.shape[0]):
        for i in env_range(first, last):
            table[k, start + i] = report.table[k, i]
    # The scenario's entries, in its order.
    for k in range(p.entries):
        entry = p.observation_layout[k]
        for i in env_range(first, last):
            observations[start + i, k] = work.observation[entry, i]


@compiled_entry
def start_episodes(states, parameters, scratches, chosen, observations, table):
    """Start an episode in every chosen environment (``chosen``: bool, shape (environments,))."""
    scratch = scratches[0]
    for k in range(chosen.shape[0]):
        if chosen[k]:
            block = k // WIDTH
            i = np.uint64(k % WIDTH)
            state = states[block]
            p = parameters[block % parameters.shape[0]]
            start_episode(state, scratch.work, scratch.report, i, p)
            start = np.uint64(block * WIDTH)
            write_out(state, scratch, p, i, i + ONE_ENV, start, observations, table)


@compiled
def all_finite(actions):
    """Return whether all numbers are finite, without a branch, so that the loop is vectorised."""
    finite = True
    for i in env_range(0, actions.shape[0]):
        for k in range(actions.shape[1]):
            finite &= abs(actions[i, k]) < np.inf
    return finite


@compiled_entry
def step_blocks(states, parameters, scratches, actions, observations, table):
    """Run one step in every environment; ended ones start their next episode instead.

    ``parameters`` holds a record for every block, or one for all. Return whether the actions are
    finite; if not, no environment has moved.
    """
    if not all_finite(actions):
        return False
    scratch = scratches[0]
    work = scratch.work
    report = scratch.report
    for b in range(states.shape[0]):
        state = states[b]
        p = parameters[b % parameters.shape[0]]
        start = b * WIDTH
        # Without a sign: see ``compilation.ONE_ENV``.
        count = np.uint64(min(WIDTH, actions.shape[0] - start))
        for i in range(count):
            work.ended_before[i] = state.ended[i]
        # Ended environments run, too, because a loop over a whole block is quicker than one with
        # branches. Their results are overwritten.
        block_actions = actions[start : start + WIDTH]
        run_step(state, work, report, block_actions, count, p)
        for i in range(count):
            if work.ended_before[i] > 0:
                state.episode[i] += np.uint64(1)
                start_episode(state, work, report, i, p)
        write_out(state, scratch, p, FIRST_ENV, count, np.uint64(start), observations, table)
    return True


class JobValues(NamedTuple):
    """The values of a job in an environment, or of a chunk of jobs, with a row for each."""

    numbers: Array64  # those of ``numbers_of``, in their order
    context: Array32  # appended to observations


class Jobs:
    """The jobs of a split of a family, by number.

    Args:
        family: the family.
        split: name of the split.
        shows_context: whether the nominal model's numbers are appended to observations.

    Attributes:
        scenario: the scenario of one job. All jobs share its choices, such as action and sensors.
        context_names: names of the numbers that are appended to an observation.
        parameters: parameters of one block with this scenario, of which all jobs share those of
            ``SHARED_PARAMETERS``.
    """

    def __init__(self, family: Family, split: str, shows_context: bool) -> None:
        self.family = family
        self.split = split
        self.scenario: Scenario = family.job(0, split).scenario
        self.context_names = family.context_names if shows_context else ()
        self.parameters = parameter_records(self.scenario)
        # The first job may lack a fresh edge's share of the load that later jobs have.
        first = family.draw(split, 0)
        drawn = parameter_records(first.true, CHUNK, nominal=first.nominal)
        self.parameters["fresh_edges_load"] = drawn["fresh_edges_load"][0]
        self._shows_context = shows_context
        # Jobs are drawn in chunks, which takes much less time than one by one.
        self._chunks: dict[int, JobValues] = {}

    def __reduce__(self) -> Any:
        """Pickle and copy the split without its jobs, which can be drawn again."""
        return Jobs, (self.family, self.split, self._shows_context)

    def __getitem__(self, number: int) -> JobValues:
        """Return the values of a job."""
        chunk, row = divmod(number, CHUNK)
        if chunk not in self._chunks:
            self._chunks[chunk] = self._draw(chunk)
        values = self._chunks[chunk]
        return JobValues(numbers=values.numbers[row], context=values.context[row])

    def _draw(self, chunk: int) -> JobValues:
        """Return the values of a chunk of jobs.

        Raise ValueError if jobs differ in a parameter of ``SHARED_PARAMETERS``.
        """
        draw = self.family.draw(self.split, chunk)
        records = parameter_records(draw.true, CHUNK, nominal=draw.nominal)
        for name in SHARED_PARAMETERS:
            shared = self.parameters[name][0]
            if (records[name] != shared).any():
                raise ValueError(
                    f"the jobs of family {self.family.name!r} must all have the same {name}"
                )
        # Shape (blocks, numbers, WIDTH) becomes (jobs, numbers).
        by_env = numbers_of(records).swapaxes(1, 2)
        numbers = by_env.reshape(CHUNK, -1)
        if self._shows_context:
            context = self.family.context(draw.features)
        else:
            context = np.zeros((CHUNK, 0))
        return JobValues(numbers=numbers, context=context.astype(np.float32))


class Batch:
    """``num_envs`` environments of one scenario with the results of their last step.

    Both Gymnasium environments use it.

    Args:
        source: scenario to play, or jobs of which every episode plays one.
        num_envs: number of environments.
        single: whether actions have shape (action size,), and every step fills the same arrays,
            of which ``observation`` and ``report`` are views.

    Attributes:
        seeded: whether episodes have been started.
        actions: the last actions: float64, shape (num_envs, action size).
        observations: float32, shape (num_envs, entries). Every step fills a new array, unless
            ``single``.
        table: the report of the last step: float64, shape (len(quantities.REPORT), num_envs), a
            row for each quantity (``quantities.ROW``). Every step fills a new one, unless
            ``single``.
        job_numbers: numbers of the present jobs in their split, shape (num_envs,).
    """

    def __init__(self, source: Source | Jobs, num_envs: int, single: bool = False) -> None:
        blocks = -(-num_envs // WIDTH)
        self.num_envs = num_envs
        self.seeded = False
        self._single = single
        if isinstance(source, Jobs):
            self.jobs: Jobs | None = source
            self.scenario = source.scenario
            self.context_size = len(source.context_names)
            # Every block has its own numbers.
            self._parameters: Any = np.repeat(source.parameters, blocks)
        else:
            self.jobs = None
            self.scenario = Scenario.load(source)
            self.context_size = 0
            self._parameters = parameter_records(self.scenario)
        self._entries = len(quantities.layout(self.scenario))
        self._states = new_records(STATE, blocks)
        self._context = np.zeros((num_envs, self.context_size), np.float32)
        self.job_numbers = np.zeros(num_envs, np.int64)
        self.actions = np.zeros((num_envs, action_size(self.scenario)))
        size = self._entries + self.context_size
        rows = len(quantities.REPORT)
        self.observations = np.zeros((num_envs, size), np.float32)
        self.table = np.zeros((rows, num_envs))
        # Rows that are a whole number of memory pages apart would share a few places of the
        # processor's first cache.
        rest = num_envs % _PAGE
        padding = _CACHE_LINE if rest < _CACHE_LINE <= num_envs else 0
        self._table_shape = (rows, num_envs + padding)
        self._make_views()

    def _make_views(self) -> None:
        """Make the attributes that a copy or a pickle does not hold."""
        self._scratches = new_records(SCRATCH, 1)
        self._action_view = self.actions[0] if self._single else self.actions
        self._action_shape = self._action_view.shape
        self.observation: Array32 = self.observations[0]
        self.report: Array64 = self.table[:, 0]

    def __getstate__(self) -> dict[str, Any]:
        values = dict(vars(self))
        for name in ("_scratches", "_action_view", "observation", "report"):
            del values[name]
        return values

    def __setstate__(self, values: dict[str, Any]) -> None:
        vars(self).update(values)
        # A pickle's records have types of their own, and compiled calls know types by identity.
        self._states = new_records(STATE, len(values["_states"]))
        self._states[...] = values["_states"]
        self._parameters = new_records(PARAMETERS, len(values["_parameters"]))
        self._parameters[...] = values["_parameters"]
        self._make_views()

    @property
    def ended(self) -> Mask:
        """Whether the episodes have ended, shape (num_envs,)."""
        ended = self._states["ended"].ravel()
        return np.asarray(ended[: self.num_envs] > 0)

    @property
    def rewards(self) -> Array64:
        """Rewards of the last step [s], shape (num_envs,)."""
        return np.asarray(self.table[ROW.reward])

    @property
    def terminated(self) -> Mask:
        """Whether the last step has terminated the episodes, shape (num_envs,)."""
        return np.asarray(self.table[ROW.terminated] > 0.0)

    @property
    def truncated(self) -> Mask:
        """Whether the last step has truncated the episodes, shape (num_envs,)."""
        return np.asarray(self.table[ROW.truncated] > 0.0)

    def state(self, env_index: int, name: str) -> Any:
        """Return a quantity of an environment's state (``quantities.STATE``)."""
        block, i = divmod(env_index, WIDTH)
        return self._states[name][block, i].item()

    def info(self, env_index: int) -> Info:
        """Return an environment's info after its last step or reset."""
        report = self.table[:, env_index].tolist()
        info = info_of(report)
        if self.jobs is not None:
            info["job"] = int(self.job_numbers[env_index])
        return info

    def job(self, env_index: int) -> Job:
        """Return an environment's present job: its true scenario, nominal model and context."""
        assert self.jobs is not None
        number = int(self.job_numbers[env_index])
        return self.jobs.family.job(number, self.jobs.split)

    def seed(self, env_indices: Any, seeds: Any) -> None:
        """Set environments' seeds; the next episode is the first of its seed, episode 0.

        Check the seeds with ``checked_seed``.
        """
        slots = np.divmod(env_indices, WIDTH)
        self._states["seed"][slots] = seeds
        # Before episode 0, because unsigned numbers wrap to 0.
        self._states["episode"][slots] = MAX_SEED

    def start(self, chosen: Mask) -> None:
        """Start the next episode of its seed in every chosen environment, shape (num_envs,)."""
        if not self._single:
            self.observations = self.observations.copy()
            self.table = self.table.copy()
        env_indices = np.flatnonzero(chosen)
        slots = np.divmod(env_indices, WIDTH)
        self._states["episode"][slots] += np.uint64(1)
        self._take_jobs(env_indices)
        start_episodes(
            self._states,
            self._parameters,
            self._scratches,
            # A copy, because Numba compiles once more for a mask that is read-only.
            np.array(chosen),
            self.observations,
            self.table,
        )
        self.observations[:, self._entries :] = self._context
        self.seeded = True

    def _take_jobs(self, env_indices: NDArray[np.int64], ahead: int = 0) -> None:
        """Give environments the job of their episode, or of an episode ahead."""
        if self.jobs is None:
            return
        for env_index in env_indices.tolist():
            block, i = divmod(env_index, WIDTH)
            seed = self.state(env_index, "seed")
            episode = self.state(env_index, "episode")
            number = self.jobs.family.number(seed, episode + ahead, self.jobs.split)
            values = self.jobs[number]
            self.job_numbers[env_index] = number
            numbers_of(self._parameters)[block, :, i] = values.numbers
            self._context[env_index] = values.context

    def _take_next_jobs(self) -> None:
        """Give ended environments the job of their next episode, unless actions are refused."""
        ended = self.ended
        if ended.any() and np.isfinite(self.actions).all():
            self._take_jobs(np.flatnonzero(ended), ahead=1)

    def truncate_after(self, max_steps: int) -> None:
        """Truncate the episodes that have had ``max_steps`` steps."""
        has_had_all = self._states["step_count"] >= max_steps
        self._states["ended"] |= has_had_all
        truncated = has_had_all.ravel()[: self.num_envs]
        self.table[ROW.truncated, truncated] = 1.0

    def step(self, actions: Any) -> None:
        """Run one step in every environment, or start the next episode if one has ended.

        Raise ValueError if the actions are not finite numbers of shape (num_envs, action size).
        Then no environment has moved.
        """
        try:
            given = np.asarray(actions)
        except ValueError:  # ragged
            given = np.array(None)
        is_real = given.dtype.char in _REAL_TYPES
        if given.shape != self._action_shape or not is_real:
            got = f"shape {given.shape}" if is_real else repr(actions)
            raise ValueError(f"actions must be numbers of shape {self._action_shape}, got {got}")
        self._action_view[...] = given
        if self.jobs is not None:
            self._take_next_jobs()
        if self._single:
            observations = self.observations
            table = self.table
        else:
            observations = np.empty(self.observations.shape, np.float32)
            table = np.empty(self._table_shape)
        finite = step_blocks(
            self._states, self._parameters, self._scratches, self.actions, observations, table
        )
        if not finite:
            finite_rows = np.isfinite(self.actions).all(axis=1)
            i = int(finite_rows.argmin())
            action = self.actions[i].tolist()
            raise ValueError(f"the action of environment {i} must be finite, got {action}")
        if self.jobs is not None:
            observations[:, self._entries :] = self._context
        if not self._single:
            self.observations = observations
            self.table = table[:, : self.num_envs]


class Trials:
    """Steps that a batch could take next. The batch itself does not move.

        trials.begin()
        trials.set_state("tangle_margin", 1e3)  # no chips tangle in the copies
        trials.step(actions)
        trials.table[ROW.reward]

    All randomness is keyed, so a trial meets the bars, edges and noise of the batch's own next
    step, and with the same actions it is that step.

    Args:
        batch: the batch. No episode of it has ended when a trial begins.

    Attributes:
        table: the report of the last trial, shape (len(quantities.REPORT), num_envs).
    """

    def __init__(self, batch: Batch) -> None:
        self._batch = batch
        self._states = new_records(STATE, len(batch._states))
        self._scratches = new_records(SCRATCH, 1)
        self._observations = np.empty(batch.observations.shape, np.float32)
        self._table = np.empty(batch._table_shape)
        self.table: Array64 = self._table[:, : batch.num_envs]

    def begin(self) -> None:
        """Copy the states of the batch."""
        self._states[...] = self._batch._states

    def state(self, name: str) -> NDArray[Any]:
        """Return a quantity of the copied states (``quantities.STATE``), shape (num_envs,)."""
        values: NDArray[Any] = self._states[name].ravel()
        return values[: self._batch.num_envs]

    def set_state(self, name: str, value: float) -> None:
        """Set a quantity of the copied states to one value in all environments."""
        self._states[name] = value

    def step(self, actions: Array64) -> None:
        """Run one step of the copied states with finite actions, shape (num_envs, action size)."""
        batch = self._batch
        step_blocks(
            self._states,
            batch._parameters,
            self._scratches,
            actions,
            self._observations,
            self._table,
        )
