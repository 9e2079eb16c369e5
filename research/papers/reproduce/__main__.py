"""Compare the numbers and claims of the papers with the project's, and fail if one no longer holds.

    python -m research.papers.reproduce
    python -m research.papers.reproduce --markdown

A number that the project cannot reproduce is listed with the reason; its check fails only if it holds after all. Numbers that are
inputs of what they are compared with count apart, as consistent by construction.
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
    which = "print a table of every equation, table, figure and claim, as in docs/papers/index.md"
    parser.add_argument("--markdown", action="store_true", help=which)
    return reproduce(PAPERS, markdown if parser.parse_args(arguments).markdown else text)


def reproduce(papers: Sequence[Paper], form: Callable[["Results"], Iterator[str]]) -> int:
    """Print the results of all papers in a form, ``text`` or ``markdown``; return the exit status."""
    results = [
        (paper, paper.checks()) for paper in tqdm(papers, unit="paper", disable=None, leave=False)
    ]
    print(*form(results), sep="\n")
    return DONE if all(check.passed for _, checks in results for check in checks) else FAILED


def text(results: Results) -> Iterator[str]:
    """Yield the lines of tables, checks and summary."""
    for paper, _ in results:
        if lines := list(paper.tables()):
            yield from ("", paper.title, "", *lines)
    for paper, checks in results:
        yield from (
            "",
            paper.title,
            "",
            f"{'figure or claim':<{WIDTH}} {'paper':>14} {'project':>14}",
            *map(str, checks),
        )
    yield ""
    yield from (f"{paper.title}: {counted(checks)}" for paper, checks in results)
    yield f"All papers: {counted(check for _, checks in results for check in checks)}"
    yield f"Items (equations, tables, figures and claims) that do not hold: {sum(unheld(*result) for result in results)}"


def markdown(results: Results) -> Iterator[str]:
    """Yield the lines of the summary of all papers and of the table of each paper's items."""
    yield f"| Paper | Items that do not hold | {' | '.join(map(str.capitalize, PASSED))} |"
    yield "|---|---|---|---|---|"
    for paper, checks in results:
        counts = (str(sum(check.verdict == verdict for check in checks)) for verdict in PASSED)
        yield f"| [{paper.title}]({paper.page}.md) | {unheld(paper, checks)} of {len(paper.items)} | {' | '.join(counts)} |"
    for paper, checks in results:
        yield from ("", f"## {paper.page.replace('_', ' ').capitalize()}", "")
        yield from ("| Item | In the code | Agreement |", "|---|---|---|")
        for item in paper.items:
            files = ", ".join(f"`{path}`" for path in item.where.split(", ") if path)
            drawn = f"[Drawn anew](../figures/README.md#{item.figure})." if item.figure else ""
            yield f"| {item.name} | {files} | {' '.join(filter(None, (drawn, item.agreement(checks), item.remark)))} |"


def unheld(paper: Paper, checks: Sequence[Check]) -> int:
    """Return how many items of a paper do not hold: at least one of their checks does not."""
    return sum(not all(check.holds for check in item.checks(checks)) for item in paper.items)


if __name__ == "__main__":
    sys.exit(main())
