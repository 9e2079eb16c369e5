"""An index of the blocks, labels and ends of loops in a part of a program, so that a jump need not search all lines."""

import bisect
from collections.abc import Hashable, Mapping, Sequence

from turning_nc.words import Line, Problem


class Places:
    """Indices of the lines of a part, by the numbers and labels of blocks, and of both ends of its loops."""

    def __init__(self, lines: Sequence[Line]) -> None:
        """Look through the lines once."""
        self._numbers: dict[Hashable, list[int]] = {}
        self._labels: dict[Hashable, list[int]] = {}
        for index, line in enumerate(lines):
            number = line.number_of("N")
            if number is not None:
                self._numbers.setdefault(number, []).append(index)
            for word in line.words:
                if word.address.endswith(":"):
                    self._labels.setdefault(word.address[:-1], []).append(index)
        self._begins, self._ends = _loops(lines)

    def block(self, number: float | None, first: int = 0, end: int | None = None) -> int | None:
        """Return the first line from ``first`` to before ``end`` whose block has a number; None if there is none."""
        return _first_within(self._numbers.get(number, []), first, end)

    def label(self, name: str | None, first: int = 0, end: int | None = None) -> int | None:
        """Return the first line from ``first`` to before ``end`` that begins with a label; None if there is none."""
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
        raise Problem("the loop has no other end")
    return ends[index]


def _loops(lines: Sequence[Line]) -> tuple[dict[int, int], dict[int, int]]:
    """Return the begins of loops by their ends, and the ends by their begins; loops of one number lie within each other."""
    begins: dict[int, int] = {}
    ends: dict[int, int] = {}
    opened: dict[str, list[int]] = {}
    for index, line in enumerate(lines):
        flow = line.flow or {}
        jump, target = flow.get("jump") or "", flow.get("target") or ""
        if "END" in jump:
            if opened.get(target):
                begins[index] = opened[target].pop()
                ends[begins[index]] = index
        elif flow.get("word") == "WHILE" or jump == "DO":
            opened.setdefault(target, []).append(index)
    return begins, ends
