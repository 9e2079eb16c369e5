"""One lathe by itself, quick to step: all that it needs and tells lies close together in one record.

A compiled call takes one argument far faster than ten, and finds what lies in a few lines of the processor's cache far faster
than what stands as wide apart as in a block of many. The transition is that of ``lathes.py``.
"""

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from turning_env.batch.driver import Desk, Lathes, count_unfit
from turning_env.numerics.compilation import compiled_entry, handed_over, source_digest
from turning_env.observation import observe
from turning_env.physics.lathe import run_step
from turning_env.physics.records import LANES, MAX_ENTRIES, PARAMETERS, REPORT, WORK, narrowed, new_records
from turning_env.physics.report import write_state
from turning_env.scenario import Scenario
from turning_env.scenario.sections import MAX_PASSES

MAX_ACTIONS = 3 + 2 * MAX_PASSES
"""Numbers that an action may have."""

UNFIT, UNDER_WAY, TERMINATED, TRUNCATED = range(-1, 3)
"""What became of an interval: unfit if it was not run, as the action is not finite."""

LONE = np.dtype(
    [
        ("parameters", PARAMETERS),
        ("lanes", narrowed(LANES)),
        ("work", narrowed(WORK)),
        ("report", narrowed(REPORT)),
        ("actions", np.float64, (1, MAX_ACTIONS)),
        ("observations", np.float32, (1, MAX_ENTRIES)),
        ("rewards", np.float64, (1,)),
        ("ends", np.uint8, (2, 1)),  # 0 or 1, as Numba has no arrays of bool in a record
    ],
    align=True,
)


def _entry(digest: str) -> Any:
    @compiled_entry
    def step_lone(records: Any) -> int:
        """Run one interval of the lathe in a record of ``LONE``; return what became of it."""
        digest  # noqa: B018 - see compiled_entry
        lone = records[0]
        lanes, work, report, p = lone.lanes, lone.work, lone.report, lone.parameters
        actions = lone.actions[0:1]
        if count_unfit(actions) > 0:
            return UNFIT
        run_step(lanes, work, report, actions, 1, p)
        write_state(lanes, report, 0, 1, p)
        observe(lanes, work, 0, 1, p)
        for k in range(MAX_ENTRIES):
            lone.observations[0, k] = work.observation[k, 0]
        lone.rewards[0] = work.reward[0]
        lone.ends[0, 0] = work.terminated[0]
        lone.ends[1, 0] = work.truncated[0]
        return TERMINATED if work.terminated[0] > 0 else TRUNCATED if work.truncated[0] > 0 else UNDER_WAY

    return step_lone


_step_lone = _entry(source_digest())


class LoneLathe(Lathes):
    """``Lathes`` of one lane whose arrays all are views of one record.

    Attributes:
        under_way: whether an episode is.
        observation: of the last interval, float32, shape (entries,).
        report: of the last interval, float64, shape (len(REPORT_FIELDS),).
    """

    _BLOCK: ClassVar[np.dtype[Any]] = LONE["lanes"]
    _NOT_KEPT: ClassVar[tuple[str, ...]] = (*Lathes._NOT_KEPT, "_record", "observation", "report")

    def __init__(self, scenario: Scenario) -> None:
        self.under_way = False
        super().__init__(scenario, 1)

    def _prepare(self) -> None:
        record = new_records(LONE, 1)
        record["parameters"], record["lanes"] = self._parameters, self._blocks
        self._parameters, self._blocks = record["parameters"], record["lanes"]
        actions: NDArray[np.float64] = record["actions"][0, :, : self.action_size]
        actions[...] = self._actions
        self._actions, self._given = actions, actions[0]
        desk = Desk(self._blocks, self._parameters, record["work"], record["report"])
        observations, ends = record["observations"][0, :, : self.entries], record["ends"][0].view(np.bool_)
        self.answers.move(observations, record["rewards"][0], ends, desk.rows)
        self.observation, self.report = observations[0], desk.rows[:, 0]
        self._record = handed_over(record)
        self._set_up([desk])

    def start(self, chosen: NDArray[np.bool_]) -> None:
        """Start the keyed episode."""
        super().start(chosen)
        self.under_way = True

    def step(self, action: Any) -> int:  # type: ignore[override] # not as many at once: one action, and one end
        """Run one interval of the episode under way; return ``UNDER_WAY``, ``TERMINATED`` or ``TRUNCATED``.

        Raises:
            ValueError: the action is not numbers of shape (action_size,), or not finite; nothing has moved then.
        """
        self._take(action)
        end: int = _step_lone(self._record)
        if end == UNFIT:
            raise ValueError(f"actions must be finite, got {self._given.tolist()}")
        self.under_way = end == UNDER_WAY
        return end
