"""The papers, their items and their figures: which checks belong to which, and how they agree."""

import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from research.papers import DATA, rows
from research.papers.reproduce import (
    alaskari_oraby,
    constant_force,
    fuzzy_override,
    part_programming,
    servo_current,
)
from research.papers.reproduce.checks import VERDICTS, Check

FIGURES: dict[str, dict[str, str]] = tomllib.loads((DATA / "figures.toml").read_text("utf-8"))
"""Figures by name, in the order of the index; each has the ``source`` that it reproduces, a ``caption`` and a ``remark``."""


@dataclass(frozen=True)
class Item:
    """An equation, table, figure or claim of a paper."""

    name: str
    where: str = ""  # files of the project that hold it, separated by commas; empty if none does
    pattern: str = ""  # regular expression that the descriptions of its checks begin with; empty if it has none
    remark: str = ""  # the part of the verdict that the checks do not say, as a sentence; all of it if there are no checks
    figure: str = ""  # name in FIGURES of the figure that draws it anew

    def checks(self, checks: Sequence[Check]) -> list[Check]:
        """Return its checks among those of its paper, each description once."""
        return list(
            {
                check.what: check
                for check in checks
                if self.pattern and re.match(self.pattern, check.what)
            }.values()
        )

    def agreement(self, checks: Sequence[Check]) -> str:
        """Return the number of its checks by verdict, with the reasons."""
        texts, found = [], self.checks(checks)
        for verdict in VERDICTS:
            if same := [check for check in found if check.verdict == verdict]:
                reasons = "; ".join(dict.fromkeys(check.reason for check in same if check.reason))
                texts.append(
                    f"{verdict.capitalize()} ({len(same)}){': ' * bool(reasons)}{reasons}."
                )
        return " ".join(texts)

    def description(self, checks: Sequence[Check]) -> list[str]:
        """Return the lines below its figure: caption and source, agreement, a remark."""
        figure, agreement = FIGURES[self.figure], self.agreement(checks)
        lines = f"{figure['caption']} ({figure['source']}.)", agreement, figure.get("remark", "")
        return [line for line in lines if line]


@dataclass(frozen=True)
class Paper:
    """The checks, items and tables of one paper."""

    title: str
    compare: Callable[[], Iterator[Check]]
    tables: Callable[[], Iterator[str]] = lambda: iter(())  # lines printed before the checks
    page: str = ""  # name of its page in docs/papers, without suffix

    def checks(self) -> list[Check]:
        """Return all checks; those of ``by_construction.csv`` say from what they follow."""
        known = {
            row["pattern"]: row["source"]
            for row in rows("by_construction.csv")
            if row["page"] == self.page
        }
        sources = (
            (check, [known[pattern] for pattern in known if re.match(pattern, check.what)])
            for check in self.compare()
        )
        return [
            replace(check, constructed=found[0] if found else check.constructed)
            for check, found in sources
        ]

    @property
    def items(self) -> list[Item]:
        """Equations, tables, figures and claims of the paper in the order of the page."""
        own = (row for row in rows("items.csv") if row["page"] == self.page)
        return [
            Item(**{name: value for name, value in row.items() if name != "page"}) for row in own
        ]


PAPERS = (
    Paper(
        "Alaskari and Oraby (2018), grid search",
        alaskari_oraby.checks,
        alaskari_oraby.tables,
        "grid_search",
    ),
    Paper("Fuzzy feed override", fuzzy_override.checks, fuzzy_override.tables, "fuzzy_override"),
    Paper(
        "Cus and Zuperl (2015), roughness control",
        constant_force.checks,
        constant_force.tables,
        "constant_force",
    ),
    Paper(
        "Sharmazanashvili (2008), part programming",
        part_programming.checks,
        part_programming.tables,
        "part_programming",
    ),
    Paper(
        "Wang, Ai, Ze and He, servo current",
        servo_current.checks,
        servo_current.tables,
        "servo_current",
    ),
)
"""All papers. To add one, also add its items to ``research/papers/data/items.csv``."""
