"""Several threads that share out the blocks of one step.

Every thread, the caller's own among them, claims the next few blocks until none are left. So nobody waits for a thread that the
machine has not let run: at worst the caller does all by itself. What a lane gives does not depend on who works on it.
"""

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Generic, TypeVar

Place = TypeVar("Place")

BLOCKS_CLAIMED = 16
"""Blocks that a thread claims at a time: enough that claiming costs next to nothing, few enough that all end together."""
MIN_BLOCKS = 256
"""Blocks below which threads do not share: where others keep the cores busy, waiting for one would cost more than it saves."""


class Crew(Generic[Place]):
    """Threads, each with its own place to work at.

    Args:
        places: one for each thread, the caller's own first.
    """

    def __init__(self, places: list[Place]) -> None:
        self._places = places
        self._helpers = ThreadPoolExecutor(len(places) - 1, "lathes") if len(places) > 1 else None

    def run(self, step: Callable[[Place, int, int], object], blocks: int) -> None:
        """Call ``step(place, first, last)`` for all blocks from 0 to before ``blocks``, ``last`` not included."""
        if self._helpers is None or blocks < MIN_BLOCKS:
            step(self._places[0], 0, blocks)
            return
        claims = itertools.count(0, BLOCKS_CLAIMED)

        def work(place: Place) -> None:
            while (first := next(claims)) < blocks:
                step(place, first, min(first + BLOCKS_CLAIMED, blocks))

        futures = [self._helpers.submit(work, place) for place in self._places[1:]]
        try:
            work(self._places[0])
        finally:
            for future in futures:
                if not future.cancel():
                    future.result()

    def dismiss(self) -> None:
        """Let the threads go."""
        if self._helpers is not None:
            self._helpers.shutdown()
