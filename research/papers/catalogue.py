"""The papers, their items and their figures.

An item is an equation, a table, a figure or a claim. The catalogue says which checks belong to it,
and whether they agree. The checks themselves are in ``reproduce``, one file per paper.
"""

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
"""Figures by name, in the order of the index.

Each has the ``source`` that it reproduces, a ``caption`` and perhaps a ``remark``.
"""


@dataclass(frozen=True)
class Item:
    """An equation, table, figure or claim of a paper."""

    name: str
    where: str = ""  # files of the project that hold it, separated by commas
    # Regular expression that matches the start of its checks' descriptions; empty if it has none.
    pattern: str = ""
    # Sentence on what the checks do not say, or the whole verdict if there are no checks.
    remark: str = ""
    figure: str = ""  # name in FIGURES of the figure that draws it anew

    def checks(self, checks: Sequence[Check]) -> list[Check]:
        """Return its checks among those of its paper, each description once."""
        if not self.pattern:
            return []
        by_description = {}
        for check in checks:
            if re.match(self.pattern, check.what):
                by_description[check.what] = check
        return list(by_description.values())

    def agreement(self, checks: Sequence[Check]) -> str:
        """Return the number of its checks by verdict, with the reasons."""
        own_checks = self.checks(checks)
        sentences = []
        for verdict in VERDICTS:
            same_verdict = [check for check in own_checks if check.verdict == verdict]
            if not same_verdict:
                continue
            sentence = f"{verdict.capitalize()} ({len(same_verdict)})"
            # A dict keeps each reason once, in order.
            reasons = dict.fromkeys(check.reason for check in same_verdict if check.reason)
            if reasons:
                sentence += ": " + "; ".join(reasons)
            sentences.append(f"{sentence}.")
        return " ".join(sentences)

    def description(self, checks: Sequence[Check]) -> list[str]:
        """Return the lines below its figure: caption and source, agreement, a remark."""
        figure = FIGURES[self.figure]
        lines = [
            f"{figure['caption']} ({figure['source']}.)",
            self.agreement(checks),
            figure.get("remark", ""),
        ]
        return [line for line in lines if line]


@dataclass(frozen=True)
class Paper:
    """The checks, items and tables of one paper."""

    title: str
    compare: Callable[[], Iterator[Check]]
    tables: Callable[[], Iterator[str]] = lambda: iter(())  # lines printed before the checks
    page: str = ""  # name of its section in docs/papers.md, with underscores

    def checks(self) -> list[Check]:
        """Return all checks; those of ``by_construction.csv`` say from what they follow."""
        by_construction = [row for row in rows("by_construction.csv") if row["page"] == self.page]
        checks = []
        for check in self.compare():
            for row in by_construction:
                if re.match(row["pattern"], check.what):
                    check = replace(check, constructed=row["source"])
                    break
            checks.append(check)
        return checks

    @property
    def items(self) -> list[Item]:
        """Equations, tables, figures and claims of the paper in the order of the page."""
        items = []
        for row in rows("items.csv"):
            if row.pop("page") == self.page:
                items.append(Item(**row))
        return items


PAPERS = (
    Paper(
        title="Alaskari and Oraby (2018), grid search",
        compare=alaskari_oraby.checks,
        tables=alaskari_oraby.tables,
        page="grid_search",
    ),
    Paper(
        title="Fuzzy feed override",
        compare=fuzzy_override.checks,
        tables=fuzzy_override.tables,
        page="fuzzy_override",
    ),
    Paper(
        title="Cus and Zuperl (2015), roughness control",
        compare=constant_force.checks,
        tables=constant_force.tables,
        page="constant_force",
    ),
    Paper(
        title="Sharmazanashvili (2008), part programming",
        compare=part_programming.checks,
        tables=part_programming.tables,
        page="part_programming",
    ),
    Paper(
        title="Wang, Ai, Ze and He, servo current",
        compare=servo_current.checks,
        tables=servo_current.tables,
        page="servo_current",
    ),
)
"""All papers. To add one, also add its items to ``research/papers/data/items.csv``."""
