"""The arrays in which an interval of all lanes is told, and how they are used again without a caller noticing."""

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.physics.records import REPORT_FIELDS

_LINE, _PAGE = 8, 512  # numbers of a cache line and of a memory page


class Answers:
    """What one interval of ``count`` lanes gave.

    Attributes:
        observations: float32, shape (count, entries).
        rewards: float64, shape (count,), in s of machine time.
        ends: bool, shape (2, count): terminated and truncated.
        padded_table: float64, what is reported, a row for each of ``REPORT_FIELDS``; rows may be longer than there are lanes.
    """

    def __init__(self, count: int, entries: int) -> None:
        self.observations = np.zeros((count, entries), np.float32)
        self.rewards = np.zeros(count, np.float64)
        self.ends = np.zeros((2, count), np.bool_)
        # Rows a whole number of memory pages apart would fall into the same few places of the processor's first cache.
        padding = _LINE if count % _PAGE < _LINE <= count else 0
        self.padded_table = np.zeros((len(REPORT_FIELDS), count + padding), np.float64)

    @property
    def table(self) -> NDArray[np.float64]:
        """What is reported of all lanes: shape (len(REPORT_FIELDS), count); see ``records.py`` for the fields and units."""
        return self.padded_table[:, : len(self.rewards)]

    def put(self, other: "Answers") -> None:
        """Take over what another interval of as many lanes gave."""
        for ours, theirs in zip(self._arrays(), other._arrays(), strict=True):
            ours[...] = theirs

    def move(
        self,
        observations: NDArray[np.float32],
        rewards: NDArray[np.float64],
        ends: NDArray[np.bool_],
        padded_table: NDArray[np.float64],
    ) -> None:
        """Go on in other arrays, with what these hold."""
        before = self._arrays()
        self.observations, self.rewards, self.ends, self.padded_table = observations, rewards, ends, padded_table
        for ours, earlier in zip(self._arrays(), before, strict=True):
            ours[...] = earlier

    def references(self) -> int:
        """The most references that any of the arrays has; a view of an array holds one to the array itself."""
        return max(sys.getrefcount(array) for array in self._arrays())

    def _arrays(self) -> tuple[NDArray[Any], ...]:
        return self.observations, self.rewards, self.ends, self.padded_table


_UNUSED = Answers(1, 1)
_UNHELD = _UNUSED.references()
"""References to arrays that nobody else holds, as ``references`` counts them."""


_MAX_KEPT = 3


class AnswerPool:
    """Arrays to answer in: those that nobody holds any more are used again, so that what was returned stays as it was.

    Who keeps nothing but the last answer makes two sets of arrays take turns.
    """

    def __init__(self, count: int, entries: int) -> None:
        self._count, self._entries = count, entries
        self._pool: list[Answers] = []

    def next(self) -> Answers:
        """Answers that nobody holds, with whatever they held before."""
        for place in reversed(range(len(self._pool))):  # the last one used first: it is still in the processor's cache
            if self._pool[place].references() <= _UNHELD:
                self._pool.append(self._pool.pop(place))
                return self._pool[-1]
        if len(self._pool) == _MAX_KEPT:
            del self._pool[0]  # whoever holds it keeps it
        self._pool.append(Answers(self._count, self._entries))
        return self._pool[-1]
