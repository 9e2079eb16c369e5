"""Sets the figures and claims of the papers beside the project's, and fails if one no longer holds.

    python -m baselines.reproduce

What the project cannot reproduce is listed with the reason, and fails nothing until it holds after all.
"""

import sys
from collections.abc import Sequence

from baselines.reproduce import alaskari_oraby, constant_force, fuzzy_override, part_programming, servo_current
from baselines.reproduce.checks import Paper, print_checks, summary

PAPERS = (
    Paper("Alaskari and Oraby (2018), grid search", alaskari_oraby.checks, alaskari_oraby.tables),
    Paper("Fuzzy feed override", fuzzy_override.checks, fuzzy_override.tables),
    Paper("Roughness control by constant force", constant_force.checks, constant_force.tables),
    Paper("Sharmazanashvili (2008), adaptive part programming", part_programming.checks, part_programming.tables),
    Paper("Wang, Ai, Ze and He, servo current", servo_current.checks, servo_current.tables),
)
"""A further paper is added here."""


def main(papers: Sequence[Paper] = PAPERS) -> int:
    """Print the tables and checks of all papers, and a summary; return the exit status."""
    results = [(paper, list(paper.checks())) for paper in papers]
    for paper, _ in results:
        if lines := list(paper.tables()):
            print("", paper.title, "", *lines, sep="\n")
    for paper, checks in results:
        print_checks(paper.title, checks)
    print()
    for paper, checks in results:
        print(summary(paper.title, checks))
    return 0 if all(check.passed for _, checks in results for check in checks) else 1


if __name__ == "__main__":
    sys.exit(main())
