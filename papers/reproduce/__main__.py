"""Compare the numbers and claims of the papers with the project's, and fail if one no longer holds.

    python -m papers.reproduce
    python -m papers.reproduce --json

A number that the project cannot reproduce is listed with the reason. Its check fails only if it holds after all.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict

from tqdm import tqdm

from papers.reproduce import alaskari_oraby, constant_force, fuzzy_override, part_programming, servo_current
from papers.reproduce.checks import Paper, print_checks, summary
from turning_env.console import DONE, FAILED, described, exits, print_json

PAPERS = (
    Paper("Alaskari and Oraby (2018), grid search", alaskari_oraby.checks, alaskari_oraby.tables),
    Paper("Fuzzy feed override", fuzzy_override.checks, fuzzy_override.tables),
    Paper("Cus and Zuperl (2015), roughness control", constant_force.checks, constant_force.tables),
    Paper("Sharmazanashvili (2008), adaptive part programming", part_programming.checks, part_programming.tables),
    Paper("Wang, Ai, Ze and He, servo current", servo_current.checks, servo_current.tables),
)
"""A further paper is added here."""


@exits(interrupted="interrupted: nothing is kept, and the same command checks all again", checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m papers.reproduce", **described(__doc__))
    parser.add_argument("--json", action="store_true", help="print the checks as JSON, without the tables")
    return reproduce(PAPERS, parser.parse_args(arguments).json)


def reproduce(papers: Sequence[Paper], as_json: bool = False) -> int:
    """Print tables, checks and summary of all papers, or the checks as JSON; return the exit status."""
    results = [(paper, list(paper.checks())) for paper in tqdm(papers, unit="paper", disable=None, leave=False)]
    status = DONE if all(check.passed for _, checks in results for check in checks) else FAILED
    if as_json:
        print_json(
            [
                {"title": paper.title, "checks": [asdict(check) | {"verdict": check.verdict} for check in checks]}
                for paper, checks in results
            ]
        )
        return status
    for paper, _ in results:
        if lines := list(paper.tables()):
            print("", paper.title, "", *lines, sep="\n")
    for paper, checks in results:
        print_checks(paper.title, checks)
    print()
    for paper, checks in results:
        print(summary(paper.title, checks))
    return status


if __name__ == "__main__":
    sys.exit(main())
