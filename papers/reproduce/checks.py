"""One figure or claim of a paper beside the project's, and the table of them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Check:
    """A paper's figure and the project's, and whether they stand in the relation that the paper states.

    A check with a reason is one that is known not to hold: it is listed with the reason and fails nothing, until it holds
    after all. Then the reason is out of date, and that does fail.
    """

    what: str
    paper: float
    ours: float
    tolerance: float = 0.0
    """How far beyond the relation the project's figure may lie, absolutely."""
    relation: Literal["=", ">=", "<=", "true"] = "="
    """The project's figure is equal to, at least or at most the paper's; or it is a claim, which is true (1) or not (0)."""
    not_reproduced: str = ""
    """Why the project cannot reproduce this, in one line; empty where it must."""

    @property
    def holds(self) -> bool:
        """Whether the project's figure stands in the relation; NaN stands in none."""
        if self.relation == ">=":
            return self.ours >= self.paper - self.tolerance
        if self.relation == "<=":
            return self.ours <= self.paper + self.tolerance
        return abs(self.ours - self.paper) <= self.tolerance

    @property
    def verdict(self) -> Literal["ok", "MISMATCH", "not reproduced", "REASON OUT OF DATE"]:
        """What to make of it."""
        if self.not_reproduced:
            return "REASON OUT OF DATE" if self.holds else "not reproduced"
        return "ok" if self.holds else "MISMATCH"

    @property
    def passed(self) -> bool:
        """Whether what the project says of it is right."""
        return self.verdict in ("ok", "not reproduced")

    def __str__(self) -> str:
        if self.relation == "true":
            paper, ours = "true", "true" if self.holds else "false"
        else:
            paper, ours = f"{self.paper:.8g}", f"{self.ours:.8g}"
            if self.relation != "=":
                paper = f"{self.relation} {paper}"
        line = f"{self.what:<{WIDTH}} {paper:>14} {ours:>14}  {self.verdict}"
        return f"{line}: {self.not_reproduced}" if self.not_reproduced else line


WIDTH = 72
"""Columns of the description."""


def at_least(what: str, paper: float, ours: float, not_reproduced: str = "") -> Check:
    """The project's figure is the paper's or more."""
    return Check(what, paper, ours, relation=">=", not_reproduced=not_reproduced)


def at_most(what: str, paper: float, ours: float, not_reproduced: str = "") -> Check:
    """The project's figure is the paper's or less."""
    return Check(what, paper, ours, relation="<=", not_reproduced=not_reproduced)


def claim(what: str, holds: bool, not_reproduced: str = "") -> Check:
    """A statement of the paper that the project finds true or false."""
    return Check(what, 1.0, float(holds), relation="true", not_reproduced=not_reproduced)


def no_tables() -> Iterator[str]:
    """The tables of a paper that needs none."""
    yield from ()


@dataclass(frozen=True)
class Paper:
    """What is reproduced of one paper."""

    title: str
    checks: Callable[[], Iterator[Check]]
    tables: Callable[[], Iterator[str]] = no_tables
    """Lines printed before the checks."""


def print_checks(title: str, checks: Sequence[Check]) -> None:
    """Print a paper's checks under their heading."""
    print(f"\n{title}\n\n{'figure or claim':<{WIDTH}} {'paper':>14} {'project':>14}")
    for check in checks:
        print(check)


def summary(title: str, checks: Sequence[Check]) -> str:
    """One line: how many checks hold, how many are known not to, how many are wrong."""
    count = [check.verdict for check in checks].count
    known, wrong = count("not reproduced"), sum(not check.passed for check in checks)
    line = f"{title}: {count('ok')} of {len(checks)} agree"
    line += f", {known} not reproduced" if known else ""
    return line + (f", {wrong} NO LONGER HOLD" if wrong else "")
