"""Compare the numbers and claims of the papers with the project's, and fail if one no longer holds.

    python -m papers.reproduce
    python -m papers.reproduce --json
    python -m papers.reproduce --markdown

A number that the project cannot reproduce is listed with the reason. Its check fails only if it holds after all.
"""

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict

from tqdm import tqdm

from papers.reproduce import alaskari_oraby, constant_force, fuzzy_override, part_programming, servo_current
from papers.reproduce.checks import Check, Item, Paper, print_checks, summary
from turning_env.console import DONE, FAILED, described, exits, print_json

PAPERS = (
    Paper("Alaskari and Oraby (2018), grid search", alaskari_oraby.checks, alaskari_oraby.tables, "grid_search"),
    Paper("Fuzzy feed override", fuzzy_override.checks, fuzzy_override.tables, "fuzzy_override"),
    Paper("Cus and Zuperl (2015), roughness control", constant_force.checks, constant_force.tables, "constant_force"),
    Paper(
        "Sharmazanashvili (2008), adaptive part programming",
        part_programming.checks,
        part_programming.tables,
        "part_programming",
    ),
    Paper("Wang, Ai, Ze and He, servo current", servo_current.checks, servo_current.tables, "servo_current"),
)
"""A further paper is added here, and its items in ``papers/data/items.csv``."""


@exits(interrupted="interrupted: nothing is kept, and the same command checks all again", checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m papers.reproduce", **described(__doc__))
    form = parser.add_mutually_exclusive_group()
    form.add_argument(
        "--json", dest="form", action="store_const", const="json", help="print the checks as JSON, without the tables"
    )
    text = "print a table of every equation, table, figure and claim, as in docs/papers/index.md"
    form.add_argument("--markdown", dest="form", action="store_const", const="markdown", help=text)
    return reproduce(PAPERS, parser.parse_args(arguments).form)


def reproduce(papers: Sequence[Paper], form: str | None = None) -> int:
    """Print tables, checks and summary of all papers, or in another form ("json", "markdown"); return the exit status."""
    results = [(paper, list(paper.checks())) for paper in tqdm(papers, unit="paper", disable=None, leave=False)]
    status = DONE if all(check.passed for _, checks in results for check in checks) else FAILED
    if form == "markdown":
        print(*markdown(results), sep="\n")
        return status
    if form == "json":
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
    print(f"Items (equations, tables, figures and claims) that do not hold: {sum(unheld(*result) for result in results)}")
    return status


def markdown(results: Sequence[tuple[Paper, Sequence[Check]]]) -> Iterator[str]:
    """Yield the lines of the summary of all papers and of the table of each paper's items."""
    yield from ("| Paper | Items that do not hold | Numbers and claims that agree | Not reproduced |", "|---|---|---|---|")
    for paper, checks in results:
        agreeing = sum(check.verdict == "ok" for check in checks)
        items = f"{unheld(paper, checks)} of {len(paper.items)}"
        yield f"| [{paper.title}]({paper.page}.md) | {items} | {agreeing} of {len(checks)} | {len(checks) - agreeing} |"
    for paper, checks in results:
        yield from ("", f"## {paper.page.replace('_', ' ').capitalize()}", "")
        yield from ("| Item | In the code | Agreement |", "|---|---|---|")
        for item in paper.items:
            files = ", ".join(f"`{path}`" for path in item.where.split(", ") if path)
            yield f"| {item.name} | {files} | {agreement(item, checks)} |"


def agreement(item: Item, checks: Sequence[Check]) -> str:
    """Return how many checks of an item hold, why others do not, and its remark."""
    link = f"[Drawn anew](../figures/README.md#{item.figure}). " if item.figure else ""
    found = checks_of(item, checks)
    if not found:
        return (link + item.remark).rstrip()
    agreeing = sum(check.verdict == "ok" for check in found)
    count = f"Agrees ({agreeing}). " if agreeing == len(found) else f"{agreeing} of {len(found)} agree. "
    reasons = "; ".join(dict.fromkeys(check.not_reproduced or check.what for check in found if check.verdict != "ok"))
    return f"{link}{count}{f'Not: {reasons}. ' if reasons else ''}{item.remark}".rstrip()


def checks_of(item: Item, checks: Sequence[Check]) -> Sequence[Check]:
    """Return the checks of an item: those of its paper that it names, and those of its figure."""
    found = {check.what: check for check in checks if item.pattern and re.match(item.pattern, check.what)}
    if item.figure:
        from papers.figures.__main__ import FIGURES  # needs Matplotlib

        found |= {check.what: check for check in FIGURES[item.figure].checks()}
    return list(found.values())


def unheld(paper: Paper, checks: Sequence[Check]) -> int:
    """Return how many items of a paper do not hold: at least one of their checks does not."""
    return sum(any(check.verdict != "ok" for check in checks_of(item, checks)) for item in paper.items)


if __name__ == "__main__":
    sys.exit(main())
