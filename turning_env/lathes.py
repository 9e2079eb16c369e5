"""Many lathes side by side, and the compiled loops over them. One lathe or thousands, the transition is the same."""

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from turning_env import observation
from turning_env.compilation import compiled, compiled_entry, source_digest
from turning_env.lathe import run_interval, start_episode
from turning_env.observation import observe
from turning_env.records import LANES, REPORT, REPORT_FIELDS, WIDTH, WORK, action_size, new_records, parameter_records
from turning_env.report import write_state
from turning_env.scenario import Scenario

MOST_SEED = 2**64 - 1


def observation_space(scenario: Scenario) -> spaces.Space[NDArray[np.float32]]:
    """The observations of one lane: a new space for every environment, since a space carries its own sampling state."""
    low, high = observation.bounds(scenario)
    return spaces.Box(low, high, dtype=np.float32)


def action_space(scenario: Scenario) -> spaces.Space[NDArray[np.float32]]:
    """The actions of one lane, likewise."""
    return spaces.Box(-1.0, 1.0, (action_size(scenario),), np.float32)


def checked_seed(seed: Any, lane: int) -> int:
    """The seed as an integer.

    Raises:
        ValueError: it is not a whole number of 0 to 2**64 - 1.
    """
    if not isinstance(seed, int | np.integer) or not 0 <= seed <= MOST_SEED:
        raise ValueError(f"seed {seed!r} of lane {lane} must be a whole number, 0 to {MOST_SEED}")
    return int(seed)


@compiled
def write_lanes(lanes, work, report, rows, first, last, parameters, start, observations, table):
    """Copy what some lanes of a block tell into the arrays of all lanes, in which the block begins at ``start``."""
    write_state(lanes, report, first, last, parameters)
    observe(lanes, work, first, last, parameters)
    for k in range(table.shape[0]):
        for i in range(first, last):
            table[k, start + i] = rows[k, i]
    for i in range(first, last):
        for k in range(observations.shape[1]):
            observations[start + i, k] = work.observation[k, i]


def _entries(digest: str) -> tuple[Any, Any]:
    @compiled_entry
    def start_lanes(blocks, parameters, works, reports, rows, chosen, observations, table):
        """Start an episode in every chosen lane (``chosen``: bool per lane)."""
        digest  # noqa: B018 - see compiled_entry
        lanes, work, report = blocks[0], works[0], reports[0]
        for lane in range(chosen.shape[0]):
            if chosen[lane]:
                lanes, i = blocks[lane // WIDTH], lane % WIDTH
                start_episode(lanes, work, report, i, parameters[0])
                write_lanes(lanes, work, report, rows, i, i + 1, parameters[0], lane - i, observations, table)

    @compiled_entry
    def step_lanes(blocks, parameters, works, reports, rows, actions, observations, rewards, ends, table, first_block, last_block):
        """Run one interval in every lane of the blocks from ``first_block`` to before ``last_block``; an ended lane starts its next episode instead."""
        digest  # noqa: B018 - see compiled_entry
        p, work, report = parameters[0], works[0], reports[0]
        for b in range(first_block, last_block):
            lanes, start = blocks[b], b * WIDTH
            count = min(WIDTH, rewards.shape[0] - start)
            for i in range(count):
                work.ended_before[i] = lanes.ended[i]
            run_interval(lanes, work, report, actions[start : start + WIDTH], 0, count, p)
            for i in range(count):
                if work.ended_before[i] > 0:
                    lanes.episode[i] += np.uint64(1)
                    start_episode(lanes, work, report, i, p)
                    work.reward[i] = 0.0
                    work.terminated[i] = 0
                    work.truncated[i] = 0
            for i in range(count):
                rewards[start + i] = work.reward[i]
                ends[0, start + i] = work.terminated[i] > 0
                ends[1, start + i] = work.truncated[i] > 0
            write_lanes(lanes, work, report, rows, 0, count, p, start, observations, table)

    return start_lanes, step_lanes


_start_lanes, _step_lanes = _entries(source_digest())


class Answers:
    """The arrays that an interval of all lanes is told in.

    Attributes:
        observations: float32, shape (count, 11), or 12 entries where there is one more.
        rewards: float64, shape (count,), in s of machine time.
        ends: bool, shape (2, count): terminated and truncated.
        table: float64, shape (len(REPORT_FIELDS), count); see ``records.py`` for the fields and units.
    """

    def __init__(self, count: int, entries: int) -> None:
        self.observations = np.zeros((count, entries), np.float32)
        self.rewards = np.zeros(count, np.float64)
        self.ends = np.zeros((2, count), np.bool_)
        self.table = np.zeros((len(REPORT_FIELDS), count), np.float64)


class Lathes:
    """The lanes of one scenario and what their last interval gave; both environments drive this.

    Attributes:
        answers: what the last interval gave.
    """

    def __init__(self, scenario: Scenario, count: int) -> None:
        self.parameters = parameter_records(scenario)
        self.blocks = new_records(LANES, -(-count // WIDTH))
        self.count = count
        self.seeded = False
        self.action_size = action_size(scenario)
        self.entries = len(observation.bounds(scenario)[0])
        self.answers = Answers(count, self.entries)
        self._actions = np.zeros((count, self.action_size), np.float64)
        self._note_down()

    def _note_down(self) -> None:
        """Make what holds nothing beyond a call: the records that the transition works with."""
        self._work = new_records(WORK, 1)
        self._report = new_records(REPORT, 1)
        self._rows = self._report.view(np.ndarray).view(np.float64).reshape(len(REPORT_FIELDS), WIDTH)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy or a pickle, in which the view of the report came out as an array of its own."""
        self.__dict__.update(state)
        self._note_down()

    def seed(self, lane: int, seed: int) -> None:
        """Key a lane's episodes: the next to start is the first of this seed (see ``checked_seed``)."""
        self.blocks.seed[lane // WIDTH, lane % WIDTH] = seed
        self.blocks.episode[lane // WIDTH, lane % WIDTH] = 0

    def start(self, chosen: NDArray[np.bool_]) -> None:
        """Start the keyed episode in every chosen lane."""
        answers = self.answers
        _start_lanes(
            self.blocks, self.parameters, self._work, self._report, self._rows, chosen, answers.observations, answers.table
        )
        answers.ends[:, chosen] = False

    def next_episode(self, chosen: NDArray[np.bool_]) -> None:
        """Move every chosen lane on to the next episode of its seed, and start it."""
        lanes = np.flatnonzero(chosen)
        self.blocks.episode[lanes // WIDTH, lanes % WIDTH] += np.uint64(1)
        self.start(chosen)

    def step(self, actions: Any) -> None:
        """Run one interval in every lane, or start the next episode where one has ended.

        Raises:
            ValueError: the actions are not numbers of shape (count, action_size), or not finite; no lane has moved then.
        """
        shape = (self.count, self.action_size)
        try:
            given = np.asarray(actions)
        except ValueError as error:  # ragged
            raise ValueError(f"actions must be numbers of shape {shape}, got {actions!r}") from error
        if given.dtype.kind not in "fiu":
            raise ValueError(f"actions must be numbers of shape {shape}, got {actions!r}")
        if given.shape != shape:
            raise ValueError(f"actions must have shape {shape}, got {given.shape}")
        np.copyto(self._actions, given)
        if not np.isfinite(self._actions).all():
            refused = int(np.flatnonzero(~np.isfinite(self._actions).all(axis=1))[0])
            raise ValueError(f"the action of lane {refused} must be finite, got {self._actions[refused].tolist()}")
        answers = self.answers
        _step_lanes(
            self.blocks,
            self.parameters,
            self._work,
            self._report,
            self._rows,
            self._actions,
            answers.observations,
            answers.rewards,
            answers.ends,
            answers.table,
            0,
            len(self.blocks),
        )
