"""Compare the numbers and claims of the papers with the project's, and fail if one no longer holds.

    python -m research.papers.reproduce
    python -m research.papers.reproduce --markdown

A number that the project cannot reproduce is listed with the reason; its check fails only if it
holds after all. Numbers that are inputs of what they are compared with count apart, as consistent
by construction.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence

from tqdm import tqdm

from research.papers.catalogue import PAPERS, Paper
from research.papers.reproduce.checks import PASSED, WIDTH, Check, counted
from turning_env.console import DONE, FAILED, described, exits

Results = Sequence[tuple[Paper, Sequence[Check]]]


@exits(
    interrupted="interrupted: nothing is kept, and the same command checks all again", checks=True
)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.papers.reproduce", **described(__doc__)
    )
    parser.add_argument(
        "--markdown",
        action="store_true",
        help="print a table of every equation, table, figure and claim, "
        "as in research/papers/items.md",
    )
    options = parser.parse_args(arguments)
    form = markdown if options.markdown else text
    return reproduce(PAPERS, form)


def reproduce(papers: Sequence[Paper], form: Callable[["Results"], Iterator[str]]) -> int:
    """Print the results of all papers as ``text`` or ``markdown``; return the exit status."""
    results = []
    for paper in tqdm(papers, unit="paper", disable=None, leave=False):
        results.append((paper, paper.checks()))

    # The text also computes the papers' tables, so no line is printed before all are known.
    lines = list(form(results))
    print("\n".join(lines))

    all_passed = all(check.passed for _, checks in results for check in checks)
    return DONE if all_passed else FAILED


def text(results: Results) -> Iterator[str]:
    """Yield the lines of tables, checks and summary."""
    for paper, _ in results:
        table = list(paper.tables())
        if table:
            yield from ("", paper.title, "")
            yield from table

    for paper, checks in results:
        yield from ("", paper.title, "")
        yield f"{'figure or claim':<{WIDTH}} {'paper':>14} {'project':>14}"
        for check in checks:
            yield str(check)

    yield ""
    all_checks: list[Check] = []
    unheld_items = 0
    for paper, checks in results:
        yield f"{paper.title}: {counted(checks)}"
        all_checks.extend(checks)
        unheld_items += unheld(paper, checks)
    yield f"All papers: {counted(all_checks)}"
    yield f"Items (equations, tables, figures and claims) that do not hold: {unheld_items}"


def markdown(results: Results) -> Iterator[str]:
    """Yield the lines of the summary of all papers and of the table of each paper's items."""
    headings = " | ".join(verdict.capitalize() for verdict in PASSED)
    yield f"| Paper | Items that do not hold | {headings} |"
    yield "|---|---|---|---|---|"
    for paper, checks in results:
        verdicts = [check.verdict for check in checks]
        counts = [str(verdicts.count(verdict)) for verdict in PASSED]
        anchor = paper.page.replace("_", "-")
        title = f"[{paper.title}](#{anchor})"
        items = f"{unheld(paper, checks)} of {len(paper.items)}"
        yield f"| {title} | {items} | {' | '.join(counts)} |"

    for paper, checks in results:
        heading = paper.page.replace("_", " ").capitalize()
        yield ""
        yield f"## {heading}"
        yield ""
        yield "| Item | In the code | Agreement |"
        yield "|---|---|---|"
        for item in paper.items:
            paths = [path for path in item.where.split(", ") if path]
            files = ", ".join(f"`{path}`" for path in paths)
            drawn = ""
            if item.figure:
                drawn = f"[Drawn anew](../../docs/figures/README.md#{item.figure})."
            remarks = (drawn, item.agreement(checks), item.remark)
            agreement = " ".join(remark for remark in remarks if remark)
            yield f"| {item.name} | {files} | {agreement} |"


def unheld(paper: Paper, checks: Sequence[Check]) -> int:
    """Return how many items of a paper do not hold: at least one of their checks does not."""
    count = 0
    for item in paper.items:
        item_checks = item.checks(checks)
        if not all(check.holds for check in item_checks):
            count += 1
    return count


if __name__ == "__main__":
    sys.exit(main())
