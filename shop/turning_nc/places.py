"""An index of a part's blocks, labels and loops, so that a jump need not search all lines."""

import bisect
from collections.abc import Mapping, Sequence

from turning_nc.words import BlockError, Line


class Places:
    """Indices of the lines of a part.

    They are found by the numbers and the labels of blocks, and by the other ends of loops.
    """

    def __init__(self, lines: Sequence[Line]) -> None:
        """Look through the lines once."""
        self._numbers: dict[float, list[int]] = {}
        self._labels: dict[str, list[int]] = {}
        for index, line in enumerate(lines):
            number = line.number_of("N")
            if number is not None:
                self._numbers.setdefault(number, []).append(index)
            for word in line.words:
                if word.address.endswith(":"):
                    self._labels.setdefault(word.address[:-1], []).append(index)
        self._ends = _ends_of_loops(lines)
        self._begins = {end: begin for begin, end in self._ends.items()}

    def block(self, number: float, first: int = 0, end: int | None = None) -> int | None:
        """Return the first line from ``first`` to before ``end`` whose block has a number.

        It is None if there is none.
        """
        return _first_within(self._numbers.get(number, []), first, end)

    def label(self, name: str, first: int = 0, end: int | None = None) -> int | None:
        """Return the first line from ``first`` to before ``end`` that begins with a label.

        It is None if there is none.
        """
        return _first_within(self._labels.get(name, []), first, end)

    def begin_of_loop(self, end: int) -> int:
        """Return the line at which the loop begins that ends in a line."""
        return _other_end(self._begins, end)

    def end_of_loop(self, begin: int) -> int:
        """Return the line at which the loop ends that begins in a line."""
        return _other_end(self._ends, begin)


def _first_within(indices: list[int], first: int, end: int | None) -> int | None:
    place = bisect.bisect_left(indices, first)
    if place == len(indices) or (end is not None and indices[place] >= end):
        return None
    return indices[place]


def _other_end(ends: Mapping[int, int], index: int) -> int:
    if index not in ends:
        raise BlockError("the loop has no other end")
    return ends[index]


def _ends_of_loops(lines: Sequence[Line]) -> dict[int, int]:
    """Return the ends of loops by their begins; loops of one number lie within each other."""
    ends: dict[int, int] = {}
    opened: dict[str, list[int]] = {}
    for index, line in enumerate(lines):
        flow = line.flow
        if flow is None:
            continue
        # Fanuc numbers its loops, from WHILE [...] DO1 to END1. SINUMERIK's end with ENDWHILE.
        if "END" in flow.jump:
            if opened.get(flow.target):
                begin = opened[flow.target].pop()
                ends[begin] = index
        elif flow.word == "WHILE" or flow.jump == "DO":
            opened.setdefault(flow.target, []).append(index)
    return ends
