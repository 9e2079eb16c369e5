"""An index of a part's blocks, labels and loops, so that a jump need not search all lines."""

import bisect
from collections import defaultdict
from collections.abc import Mapping, Sequence

from turning_nc.words import BlockError, Line


class Places:
    """Indices of the lines of a part.

    They are found by the numbers and the labels of blocks, and by the other ends of loops.
    """

    def __init__(self, lines: Sequence[Line]) -> None:
        """Look through the lines once."""
        self.lines = range(len(lines))
        """Indices of all lines; a slice of it is where to look for a block."""
        self._numbers: defaultdict[float, list[int]] = defaultdict(list)
        self._labels: defaultdict[str, list[int]] = defaultdict(list)
        for index, line in enumerate(lines):
            number = line.number_of("N")
            if number is not None:
                self._numbers[number].append(index)
            for word in line.words:
                if word.address.endswith(":"):
                    label = word.address[:-1]
                    self._labels[label].append(index)
        self._ends = _ends_of_loops(lines)
        self._begins = {end: begin for begin, end in self._ends.items()}
        self._branches = _ends_of_branches(lines)

    def block(self, number: float, within: range) -> int | None:
        """Return the first line whose block has a number; None if there is none."""
        return _first_within(self._numbers[number], within)

    def label(self, name: str, within: range) -> int | None:
        """Return the first line that begins with a label; None if there is none."""
        return _first_within(self._labels[name], within)

    def begin_of_loop(self, end: int) -> int:
        """Return the line at which the loop begins that ends in a line."""
        return _other_end(self._begins, end)

    def end_of_loop(self, begin: int) -> int:
        """Return the line at which the loop ends that begins in a line."""
        return _other_end(self._ends, begin)

    def end_of_branch(self, begin: int) -> int:
        """Return the line of ELSE or ENDIF at which the branch ends that begins in a line."""
        if begin not in self._branches:
            raise BlockError("IF needs a jump to a block, such as GOTO, or ELSE and ENDIF after it")
        return self._branches[begin]


def _first_within(indices: list[int], within: range) -> int | None:
    """Return the first of sorted indices that is within a range."""
    place = bisect.bisect_left(indices, within.start)
    if place < len(indices) and indices[place] in within:
        return indices[place]
    return None


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
        # Fanuc numbers its loops, from WHILE [...] DO1 to END1. SINUMERIK's end with
        # ENDWHILE or ENDFOR.
        if "END" in flow.jump:
            name = "FOR" if flow.jump == "ENDFOR" else flow.target
            if opened.get(name):
                begin = opened[name].pop()
                ends[begin] = index
        elif flow.word == "FOR":
            opened.setdefault("FOR", []).append(index)
        elif flow.word == "WHILE" or flow.jump == "DO":
            opened.setdefault(flow.target, []).append(index)
    return ends


def _ends_of_branches(lines: Sequence[Line]) -> dict[int, int]:
    """Return the lines of ELSE and ENDIF by the IF or ELSE whose branch they end."""
    ends: dict[int, int] = {}
    opened: list[int] = []
    for index, line in enumerate(lines):
        flow = line.flow
        if flow is None:
            continue
        if flow.jump in ("ELSE", "ENDIF") and opened:
            ends[opened.pop()] = index
        begins = flow.word == "IF" and not flow.jump and not flow.then
        if begins or flow.jump == "ELSE":
            opened.append(index)
    return ends
