"""Many lathes side by side, and the compiled loops over them. One lathe or thousands, the transition is the same."""

from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from turning_env import observation
from turning_env.batch.outputs import Answers
from turning_env.batch.threads import Crew
from turning_env.numerics.compilation import compiled, compiled_entry, handed_over, source_digest
from turning_env.observation import observe
from turning_env.physics.lathe import run_step, start_episode
from turning_env.physics.records import LANES, REPORT, REPORT_FIELDS, WIDTH, WORK, action_size, new_records, parameter_records
from turning_env.physics.report import write_state
from turning_env.scenario import Scenario

MAX_SEED = 2**64 - 1


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
    if not isinstance(seed, int | np.integer) or not 0 <= seed <= MAX_SEED:
        raise ValueError(f"seed {seed!r} of lane {lane} must be a whole number, 0 to {MAX_SEED}")
    return int(seed)


@compiled
def write_lanes(state, work, report, rows, first, last, parameters, start, observations, table):
    """Copy what some lanes of a block tell into the arrays of all lanes, in which the block begins at ``start``."""
    write_state(state, report, first, last, parameters)
    observe(state, work, first, last, parameters)
    for k in range(table.shape[0]):
        for i in range(first, last):
            table[k, start + i] = rows[k, i]
    for i in range(first, last):
        for k in range(observations.shape[1]):
            observations[start + i, k] = work.observation[k, i]


@compiled
def count_unfit(actions):
    """How many numbers of some actions are not finite."""
    unfit = 0
    for lane in range(actions.shape[0]):
        for k in range(actions.shape[1]):
            unfit += 0 if abs(actions[lane, k]) < np.inf else 1
    return unfit


def _entries(digest: str) -> tuple[Any, Any, Any]:
    @compiled_entry
    def first_unfit(actions):
        """The first lane whose action, of shape (lanes, action size), is not finite, or -1."""
        digest  # noqa: B018 - see compiled_entry
        if count_unfit(actions) > 0:
            for lane in range(actions.shape[0]):
                for k in range(actions.shape[1]):
                    if not np.isfinite(actions[lane, k]):
                        return lane
        return -1

    @compiled_entry
    def start_lanes(blocks, parameters, works, reports, rows, chosen, observations, table):
        """Start an episode in every chosen lane (``chosen``: bool per lane)."""
        digest  # noqa: B018 - see compiled_entry
        p, work, report = parameters[0], works[0], reports[0]
        for lane in range(chosen.shape[0]):
            if chosen[lane]:
                lanes, i = blocks[lane // WIDTH], lane % WIDTH
                start_episode(lanes, work, report, i, p)
                write_lanes(lanes, work, report, rows, i, i + 1, p, lane - i, observations, table)

    @compiled_entry
    def step_blocks(
        blocks, parameters, works, reports, rows, actions, observations, rewards, ends, table, first_block, last_block
    ):
        """Run one interval in every lane of the blocks from ``first_block`` to before ``last_block``.

        A lane that has ended starts its next episode instead.
        """
        digest  # noqa: B018 - see compiled_entry
        p, work, report = parameters[0], works[0], reports[0]
        for b in range(first_block, last_block):
            lanes, start = blocks[b], b * WIDTH
            count = min(WIDTH, rewards.shape[0] - start)
            for i in range(count):
                work.ended_before[i] = lanes.ended[i]
            run_step(lanes, work, report, actions[start : start + WIDTH], count, p)
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

    return first_unfit, start_lanes, step_blocks


_first_unfit, _start_lanes, _step_blocks = _entries(source_digest())


class Desk:
    """Where the transition notes things down, with the records of the lanes that it works on.

    Attributes:
        records: what the entries take first.
        rows: a report's fields as the rows of one array, float64, shape (len(REPORT_FIELDS), lanes of a block).
    """

    def __init__(self, blocks: Any, parameters: Any, work: Any, report: Any) -> None:
        self.rows = np.ndarray((len(REPORT_FIELDS), report.itemsize // 8 // len(REPORT_FIELDS)), np.float64, report)
        self.records = (*(handed_over(record) for record in (blocks, parameters, work, report)), self.rows)


class Lathes:
    """The lanes of one scenario and what their last interval gave; both environments drive this.

    Args:
        scenario: what is played.
        count: number of lanes.
        threads: how many share the work.

    Attributes:
        answers: what the last interval gave.
        ended: whether the episode of a lane has ended, 0 or 1, shape (blocks, WIDTH).
    """

    _BLOCK: ClassVar[np.dtype[Any]] = LANES
    _NOT_KEPT: ClassVar[tuple[str, ...]] = ("ended", "_given", "_desk", "_crew")

    def __init__(self, scenario: Scenario, count: int, threads: int = 1) -> None:
        self.count = count
        self._threads = threads
        self.seeded = False
        self.action_size = action_size(scenario)
        self.entries = len(observation.bounds(scenario)[0])
        self._parameters = parameter_records(scenario)
        self._blocks = new_records(self._BLOCK, -(-count // WIDTH))
        self._actions = np.zeros((count, self.action_size), np.float64)
        self.answers = Answers(count, self.entries)
        self._prepare()

    def _prepare(self) -> None:
        """Make what is not kept with a copy or a pickle: views, and the records that the transition notes things down in."""
        self._given = self._actions
        places = [(new_records(WORK, 1), new_records(REPORT, 1)) for _ in range(self._threads)]
        self._set_up([Desk(self._blocks, self._parameters, work, report) for work, report in places])

    def _set_up(self, desks: list[Desk]) -> None:
        self.ended: NDArray[np.int64] = self._blocks["ended"]
        self._shape = self._given.shape
        self._desk = desks[0]
        self._crew = Crew(desks)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in self._NOT_KEPT}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._prepare()

    def seed(self, lanes: Any, seeds: Any) -> None:
        """Key the episodes of lanes: the next to start is the first of its seed (see ``checked_seed``)."""
        block, i = np.divmod(lanes, WIDTH)
        self._blocks["seed"][block, i] = seeds
        self._blocks["episode"][block, i] = 0

    def state(self, lane: int, field: str) -> Any:
        """A field of a lane's record (``records.LANES``), for who draws it."""
        block, i = divmod(lane, WIDTH)
        return self._blocks[field][block, i]

    def action(self, lane: int) -> NDArray[np.float64]:
        """The last action of a lane, shape (action_size,)."""
        action: NDArray[np.float64] = self._actions[lane]
        return action

    def start(self, chosen: NDArray[np.bool_]) -> None:
        """Start the keyed episode in every chosen lane."""
        _start_lanes(*self._desk.records, chosen, self.answers.observations, self.answers.padded_table)

    def next_episode(self, chosen: NDArray[np.bool_]) -> None:
        """Move every chosen lane on to the next episode of its seed, and start it."""
        block, i = np.divmod(np.flatnonzero(chosen), WIDTH)
        self._blocks["episode"][block, i] += np.uint64(1)
        self.start(chosen)

    def step(self, actions: Any) -> None:
        """Run one interval in every lane, or start the next episode where one has ended.

        Raises:
            ValueError: the actions are not numbers of shape (count, action_size), or not finite; no lane has moved then.
        """
        self._take(actions)
        refused = _first_unfit(self._actions)
        if refused >= 0:
            raise ValueError(f"the action of lane {refused} must be finite, got {self._actions[refused].tolist()}")
        answers, given = self.answers, self._actions
        told = (given, answers.observations, answers.rewards, answers.ends, answers.padded_table)
        self._crew.run(lambda desk, first, last: _step_blocks(*desk.records, *told, first, last), len(self.ended))

    def close(self) -> None:
        """Let the threads go."""
        self._crew.dismiss()

    def _take(self, actions: Any) -> None:
        try:
            given = np.asarray(actions)
        except ValueError as error:  # ragged
            raise ValueError(f"actions must be numbers of shape {self._shape}, got {actions!r}") from error
        if given.dtype.kind not in "fiu" or given.dtype.itemsize > 8:
            raise ValueError(f"actions must be numbers of shape {self._shape}, got {actions!r}")
        if given.shape != self._shape:
            raise ValueError(f"actions must have shape {self._shape}, got {given.shape}")
        self._given[...] = given
