"""Finishing cuts of a program: they make the surface, so that their feeds stay.

A finishing contour is a chain of moves at feed, such as a pass along the contour. A jump of the
speed within it leaves a mark, so ``adaptable_words`` gives its words one speed.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import Situation
from turning_nc.moves import Move


class Finishing:
    """Cuts of a program that finish.

    Attributes:
        contours: the moves of each finishing contour, from the first that cuts to the last. Of a
            chain that mostly roughs, they are those from the first finishing cut to the last.
    """

    def __init__(self, situation: Situation, max_depth: float) -> None:
        """Look through the moves once.

        Args:
            situation: a program on its stock.
            max_depth: depth of cut up to which a cut finishes [mm].
        """
        slices = situation.removal.slices
        moves = situation.moves.moves
        count = len(moves)
        is_deep = slices.depth > max_depth
        self._length = np.where(situation.engaged, slices.length, 0.0)
        deep_length = np.where(is_deep, self._length, 0.0)
        length_of_move = np.bincount(slices.move, self._length, minlength=count)
        deep_of_move = np.bincount(slices.move, deep_length, minlength=count)
        in_metal = length_of_move > 0.0

        kinds = situation.removal.tools
        is_groover = ["groove" in kinds.get(move.tool, "") for move in moves]
        grooves = np.array(is_groover)
        finishes = grooves | (deep_of_move <= 0.5 * length_of_move)

        self.contours: list[range] = []
        is_within = np.zeros(count, np.bool_)  # whether a move is one of a chain that finishes
        for chain in _chains(moves):
            part = slice(chain.start, chain.stop)
            chain_length = length_of_move[part].sum()
            is_shallow = deep_of_move[part].sum() <= 0.5 * chain_length
            chain_finishes = grooves[chain.start] or is_shallow
            is_within[part] = chain_finishes
            counts = in_metal[part] & (finishes[part] | chain_finishes)
            cuts = (chain.start + np.flatnonzero(counts)).tolist()
            if cuts:
                contour = range(cuts[0], cuts[-1] + 1)
                self.contours.append(contour)
        may_be_deep = is_within | grooves
        self._roughs = is_deep & ~may_be_deep[slices.move]
        self._grooves = situation.engaged & grooves[slices.move]

    def is_finishing(self, slices: NDArray[np.int64]) -> bool:
        """Return whether slices (their indices) finish.

        They do if at most half of their path in metal is deeper than the depth of finishing, apart
        from passes that finish as a whole; or if a grooving tool cuts.
        """
        if self._grooves[slices].any():
            return True
        length = self._length[slices]
        return float(length[self._roughs[slices]].sum()) <= 0.5 * float(length.sum())


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
