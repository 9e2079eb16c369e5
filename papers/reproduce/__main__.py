"""Compare the numbers and claims of the papers with the project's, and fail if one no longer holds.

    python -m papers.reproduce
    python -m papers.reproduce --markdown

A number that the project cannot reproduce is listed with the reason. Its check fails only if it holds after all.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence

from tqdm import tqdm

from papers.catalogue import PAPERS, Paper
from papers.reproduce.checks import WIDTH, Check
from turning_env.console import DONE, FAILED, described, exits

Results = Sequence[tuple[Paper, Sequence[Check]]]


@exits(interrupted="interrupted: nothing is kept, and the same command checks all again", checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m papers.reproduce", **described(__doc__))
    which = "print a table of every equation, table, figure and claim, as in docs/papers/index.md"
    parser.add_argument("--markdown", action="store_true", help=which)
    return reproduce(PAPERS, markdown if parser.parse_args(arguments).markdown else text)


def reproduce(papers: Sequence[Paper], form: Callable[["Results"], Iterator[str]]) -> int:
    """Print the results of all papers in a form, ``text`` or ``markdown``; return the exit status."""
    results = [(paper, list(paper.checks())) for paper in tqdm(papers, unit="paper", disable=None, leave=False)]
    print(*form(results), sep="\n")
    return DONE if all(check.passed for _, checks in results for check in checks) else FAILED


def text(results: Results) -> Iterator[str]:
    """Yield the lines of tables, checks and summary."""
    for paper, _ in results:
        if lines := list(paper.tables()):
            yield from ("", paper.title, "", *lines)
    for paper, checks in results:
        yield from ("", paper.title, "", f"{'figure or claim':<{WIDTH}} {'paper':>14} {'project':>14}", *map(str, checks))
    yield ""
    for paper, checks in results:
        count = [check.verdict for check in checks].count
        known, wrong = count("not reproduced"), sum(not check.passed for check in checks)
        line = f"{paper.title}: {count('ok')} of {len(checks)} agree"
        yield line + (f", {known} not reproduced" if known else "") + (f", {wrong} NO LONGER HOLD" if wrong else "")
    yield f"Items (equations, tables, figures and claims) that do not hold: {sum(unheld(*result) for result in results)}"


def markdown(results: Results) -> Iterator[str]:
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
            yield f"| {item.name} | {files} | {item.agreement(checks)} |"


def unheld(paper: Paper, checks: Sequence[Check]) -> int:
    """Return how many items of a paper do not hold: at least one of their checks does not."""
    return sum(any(check.verdict != "ok" for check in item.checks(checks)) for item in paper.items)


if __name__ == "__main__":
    sys.exit(main())
