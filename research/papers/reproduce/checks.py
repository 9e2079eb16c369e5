"""Checks of a paper's numbers and claims against the project's, and tables of text."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

WIDTH = 72  # columns of a check's description
PASSED = AGREES, CONSTRUCTED, NOT_REPRODUCED = (
    "agrees",
    "consistent by construction",
    "not reproduced",
)
VERDICTS = (
    *PASSED,
    "MISMATCH",
    "REASON OUT OF DATE",
)  # verdicts in words; the last two mean that something no longer holds


@dataclass(frozen=True)
class Check:
    """A paper's number, the project's, and the relation that should hold between them.

    A check with a reason is known not to hold: it is listed with the reason and passes, unless it holds after all. A check that
    cannot disagree, because the paper's number is an input of the project's, says from what it follows.
    """

    what: str
    paper: float
    ours: float
    tolerance: float = 0.0  # absolute tolerance of the relation
    relation: Literal["=", ">=", "<=", "true"] = "="
    """The project's number equals, is at least or is at most the paper's; or a claim is true (1) or not (0)."""
    not_reproduced: str = (
        ""  # reason why the project cannot reproduce this, in one line; empty where it must
    )
    constructed: str = (
        ""  # the reason that it holds by construction, in one line; empty if it could disagree
    )

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
            return "REASON OUT OF DATE" if self.holds else NOT_REPRODUCED
        return (CONSTRUCTED if self.constructed else AGREES) if self.holds else "MISMATCH"

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
            paper, ours = "true", "true" if self.holds else "false"
        else:
            paper, ours = f"{self.paper:.8g}", f"{self.ours:.8g}"
            if self.relation != "=":
                paper = f"{self.relation} {paper}"
        line = f"{self.what:<{WIDTH}} {paper:>14} {ours:>14}  {self.verdict}"
        return f"{line}: {self.reason}" if self.reason else line


def counted(checks: Iterable[Check]) -> str:
    """Return the number of checks by verdict, as text; those that no longer hold only if there are any."""
    found = Counter(check.verdict for check in checks)
    return ", ".join(
        f"{verdict} {found[verdict]}" for verdict in VERDICTS if found[verdict] or verdict in PASSED
    )


def at_least(what: str, paper: float, ours: float, not_reproduced: str = "") -> Check:
    """Return a check that the project's number is the paper's or more."""
    return Check(what, paper, ours, relation=">=", not_reproduced=not_reproduced)


def at_most(what: str, paper: float, ours: float, not_reproduced: str = "") -> Check:
    """Return a check that the project's number is the paper's or less."""
    return Check(what, paper, ours, relation="<=", not_reproduced=not_reproduced)


def claim(what: str, holds: Any, not_reproduced: str = "") -> Check:
    """Return a check of a statement, or of one for each element of an array."""
    return Check(what, 1.0, float(np.all(holds)), relation="true", not_reproduced=not_reproduced)


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table: the first column to the left, the others to the right, as wide as their widest cell."""
    cells = [heads, *rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for first, *others in cells:
        line = [
            first.ljust(widths[0]),
            *(cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)),
        ]
        yield "  ".join(line).rstrip()
