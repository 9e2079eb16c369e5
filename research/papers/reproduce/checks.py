"""Checks of a paper's numbers and claims against the project's, and tables of text."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

WIDTH = 72  # columns of a check's description

AGREES = "agrees"
CONSTRUCTED = "consistent by construction"
NOT_REPRODUCED = "not reproduced"
MISMATCH = "MISMATCH"
OUT_OF_DATE = "REASON OUT OF DATE"
PASSED = (AGREES, CONSTRUCTED, NOT_REPRODUCED)
VERDICTS = (*PASSED, MISMATCH, OUT_OF_DATE)  # the last two mean that something no longer holds


@dataclass(frozen=True)
class Check:
    """A paper's number, the project's, and the relation that should hold between them.

    A check with a reason is known not to hold: it is listed with the reason and passes, unless it
    holds after all. If the paper's number is an input of the project's, the check cannot disagree:
    it says from what it follows.
    """

    what: str
    paper: float
    ours: float
    tolerance: float = 0.0  # absolute tolerance of the relation
    # The project's number equals, is at least or is at most the paper's; or a claim is true (1).
    relation: Literal["=", ">=", "<=", "true"] = "="
    # Reason why the project cannot reproduce the number, in one line; empty where it must.
    not_reproduced: str = ""
    # Reason why the check holds by construction, in one line; empty if it could disagree.
    constructed: str = ""

    @property
    def holds(self) -> bool:
        """Whether the relation holds; with NaN it does not."""
        if self.relation == ">=":
            return self.ours >= self.paper - self.tolerance
        if self.relation == "<=":
            return self.ours <= self.paper + self.tolerance
        return abs(self.ours - self.paper) <= self.tolerance

    @property
    def verdict(self) -> str:
        """The verdict, one of ``VERDICTS``."""
        if self.not_reproduced:
            return OUT_OF_DATE if self.holds else NOT_REPRODUCED
        if not self.holds:
            return MISMATCH
        return CONSTRUCTED if self.constructed else AGREES

    @property
    def passed(self) -> bool:
        """Whether it holds, or is known not to."""
        return self.verdict in PASSED

    @property
    def reason(self) -> str:
        """The reason of its verdict; empty if it agrees."""
        return self.not_reproduced or self.constructed

    def __str__(self) -> str:
        if self.relation == "true":
            paper = "true"
            ours = "true" if self.holds else "false"
        else:
            paper = f"{self.paper:.8g}"
            ours = f"{self.ours:.8g}"
            if self.relation != "=":
                paper = f"{self.relation} {paper}"
        line = f"{self.what:<{WIDTH}} {paper:>14} {ours:>14}  {self.verdict}"
        if self.reason:
            line = f"{line}: {self.reason}"
        return line


def counted(checks: Iterable[Check]) -> str:
    """Return the number of checks by verdict, as text.

    Verdicts that do not pass appear only if there are any.
    """
    counts = Counter(check.verdict for check in checks)
    shown = []
    for verdict in VERDICTS:
        if counts[verdict] or verdict in PASSED:
            shown.append(f"{verdict} {counts[verdict]}")
    return ", ".join(shown)


def at_least(what: str, paper: float, ours: float, not_reproduced: str = "") -> Check:
    """Return a check that the project's number is the paper's or more."""
    return Check(what, paper, ours=ours, relation=">=", not_reproduced=not_reproduced)


def at_most(what: str, paper: float, ours: float, not_reproduced: str = "") -> Check:
    """Return a check that the project's number is the paper's or less."""
    return Check(what, paper, ours=ours, relation="<=", not_reproduced=not_reproduced)


def claim(what: str, holds: Any, not_reproduced: str = "") -> Check:
    """Return a check of a statement, or of one for each element of an array."""
    ours = float(np.all(holds))
    return Check(what, 1.0, ours=ours, relation="true", not_reproduced=not_reproduced)


def aligned_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table whose columns are as wide as their widest cell.

    The first column is aligned to the left, the others to the right.
    """
    lines = [heads, *rows]
    widths = []
    for column in zip(*lines, strict=True):
        widths.append(max(len(cell) for cell in column))
    for first, *others in lines:
        cells = [first.ljust(widths[0])]
        for cell, width in zip(others, widths[1:], strict=True):
            cells.append(cell.rjust(width))
        yield "  ".join(cells).rstrip()
