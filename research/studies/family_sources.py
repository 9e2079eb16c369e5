"""Count the numbers of families by what their sources name: data, an assumption, or neither.

    python -m research.studies.family_sources
    python -m research.studies.family_sources unmodelled --list assumption

Counted are the two numbers of each distribution and of each deviation of the truth, the numbers of
tables, and fields that are plain numbers, which have no source. A source is read clause by clause:
"truth: " begins what holds for the deviation alone, "kc, mc: " what holds for these columns alone.
A clause that says "assumption" counts as one, even if it names data, too.
"""

import argparse
import re
import sys
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

from leaderboard.table import markdown
from turning_env import Family, ScenarioError
from turning_env.console import described, exits
from turning_env.scenario.family import families

ASSUMPTION, DATA, NEITHER = "assumption", "data", "neither"
TRUTH = "truth"
NUMBERS = 2  # of a distribution

NAMES_OF_DATA = (
    "AIST",
    "alr4::lathe1",
    "Ck 45",
    "Dormer Pramet",
    "H13",
    "handbooks",
    "ISCAR",
    "Mitsubishi",
    "paper",
    "Roehm",
    "Sumitomo",
    "Vicomtech",
)
"""Measurements, papers and catalogues, as sources call them."""

FIELDS_WITHOUT_SOURCE = ("reference_depth_of_cut", "depth_of_cut")
"""Last names of fields that say where a law's coefficient holds, or that follow from its form."""


class Numbers(NamedTuple):
    """Some numbers of a family with one source."""

    name: str
    size: int  # how many they are
    kind: str  # ``ASSUMPTION``, ``DATA`` or ``NEITHER``


def kind_of(clause: str) -> str:
    """Return what a clause of a source names."""
    if "assumption" in clause:
        return ASSUMPTION
    if any(name in clause for name in NAMES_OF_DATA):
        return DATA
    return NEITHER


def clause_for(source: str, name: str, names: Collection[str]) -> str:
    """Return the part of a source that holds for a name, such as a column's.

    Args:
        source: the source.
        name: name whose clause is wanted.
        names: all names that may begin a clause. Text before the first of them, and text of a
            source without any, holds for every name but ``truth``.
    """
    common = []
    of_name = []
    holds_for: set[str] = set()
    for part in re.split(r"; |\. ", source):
        head, colon, rest = part.partition(": ")
        heads = set(head.split(", "))
        if colon and heads <= set(names):
            holds_for = heads
            part = rest
        if name in holds_for:
            of_name.append(part)
        elif not holds_for and name != TRUTH:
            common.append(part)
    return "; ".join(of_name or common)


def numbers_of(family: Family) -> Iterator[Numbers]:
    """Yield all numbers of a family."""
    for name, variable in family.variables.items():
        clause = clause_for(variable.source, name, names=[TRUTH])
        yield Numbers(name, NUMBERS, kind_of(clause))
        if variable.truth:
            clause = clause_for(variable.source, TRUTH, names=[TRUTH])
            yield Numbers(f"{name}.{TRUTH}", NUMBERS, kind_of(clause))
    for table in family.tables.values():
        names = [*table.columns, TRUTH]
        rows = len(table.rows)
        for column in table.columns:
            clause = clause_for(table.source, column, names=names)
            yield Numbers(column, rows, kind_of(clause))
        for column in table.truth:
            clause = clause_for(table.source, TRUTH, names=names)
            yield Numbers(f"{column}.{TRUTH}", NUMBERS, kind_of(clause))
    for fields in (family.fields, family.hidden, family.planned):
        for name, value in fields.items():
            _, _, field = name.rpartition(".")
            is_number = not isinstance(value, bool | str)
            if is_number and field not in FIELDS_WITHOUT_SOURCE:
                yield Numbers(name, 1, NEITHER)


def counts_of(family: Family) -> Counter[str]:
    """Return how many numbers of a family have each kind of source."""
    counts = Counter({DATA: 0, ASSUMPTION: 0, NEITHER: 0})
    for numbers in numbers_of(family):
        counts[numbers.kind] += numbers.size
    return counts


@exits(ScenarioError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, or the numbers with one kind of source; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.family_sources", **described(__doc__)
    )
    parser.add_argument(
        "families",
        nargs="*",
        default=list(families()),
        help="families, or TOML files (default: all that ship)",
    )
    parser.add_argument(
        "--list",
        choices=(DATA, ASSUMPTION, NEITHER),
        help="list the numbers with this kind of source instead",
    )
    options = parser.parse_args(arguments)
    rows = []
    for source in options.families:
        family = Family.load(source)
        if options.list:
            for numbers in numbers_of(family):
                if numbers.kind == options.list:
                    print(f"{family.name}: {numbers.name} ({numbers.size})")
            continue
        counts = counts_of(family)
        rows.append(
            {
                "Family": f"`{family.name}`",
                "Data": str(counts[DATA]),
                "Assumption": str(counts[ASSUMPTION]),
                "Neither": str(counts[NEITHER]),
                "Data [%]": f"{100.0 * counts[DATA] / counts.total():.0f}",
            }
        )
    if rows:
        print(markdown(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
