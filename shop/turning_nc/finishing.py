"""Finishing cuts of a program: they leave the surface of the part, so that their feeds do not rise.

``surface`` finds which cuts these are. A finishing contour is a chain of moves at feed, such as a
pass along the contour. A jump of the speed within it leaves a mark, so ``adaptable_words`` gives
its words one speed.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import Situation
from turning_nc.moves import Move

# A move finishes if it leaves this length of the part's surface [mm], or this share of its length
# in metal [-]. A roughing pass leaves less: a ledge at its end, as an insert's front leans back.
MIN_SURFACE = 1.0
MIN_SHARE = 0.25


class Finishing:
    """Cuts of a program that finish: they leave the part's surface, or cut a groove.

    Attributes:
        contours: the moves of each finishing contour, of a chain those from the first that
            finishes to the last.
    """

    def __init__(self, situation: Situation) -> None:
        """Look through the moves of a program on its stock."""
        slices = situation.removal.slices
        moves = situation.moves.moves
        count = len(moves)
        in_metal = situation.engaged
        kinds = situation.removal.tools
        is_groover = np.array(["groove" in kinds.get(move.tool, "") for move in moves])
        length = np.bincount(slices.move, slices.length * in_metal, minlength=count)
        surface = np.bincount(slices.move, slices.surface * in_metal, minlength=count)
        makes_surface = (surface > MIN_SURFACE) | (surface > MIN_SHARE * length)
        finishes = (length > 0.0) & (makes_surface | is_groover)
        self._engaged = in_metal
        self._finishes = finishes[slices.move] & in_metal
        self.contours: list[range] = []
        for chain in _chains(moves):
            cuts = chain.start + np.flatnonzero(finishes[chain.start : chain.stop])
            if len(cuts):
                self.contours.append(range(int(cuts[0]), int(cuts[-1]) + 1))

    def is_finishing(self, slices: NDArray[np.int64]) -> bool:
        """Return whether slices (their indices) finish, or cut no metal at all."""
        return bool(self._finishes[slices].any() or not self._engaged[slices].any())


def _chains(moves: Sequence[Move]) -> Iterator[range]:
    """Yield chains of moves at feed by one tool, without a rapid move between; a dwell may be."""
    first = 0
    for number, move in enumerate(moves):
        is_fed = move.kind in ("feed", "dwell")
        if is_fed and move.tool == moves[first].tool:
            continue
        if number > first:
            yield range(first, number)
        first = number if is_fed else number + 1
    if first < len(moves):
        yield range(first, len(moves))
