"""The checks of the papers: every one agrees or has its reason, and the page tells it."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from baselines.two_limits import TWO_LIMITS
from research.papers import rows
from research.papers.catalogue import FIGURES, PAPERS, Paper
from research.papers.reproduce import part_programming
from research.papers.reproduce.__main__ import markdown, reproduce, text
from research.papers.reproduce.checks import PASSED, Check, at_least, at_most, claim
from research.papers.reproduce.part_programming import Blank, gain

ROOT = Path(__file__).parents[3]


@pytest.mark.slow
@pytest.mark.parametrize("paper", PAPERS, ids=lambda paper: paper.page)
def test_every_figure_of_a_paper_agrees_and_the_pages_tell_it(paper: Paper) -> None:
    checks = paper.checks()
    text = (ROOT / "docs" / "papers" / "index.md").read_text("utf-8").splitlines()
    assert [line for line in markdown([(paper, checks)]) if line not in text] == []
    figures = (ROOT / "docs" / "figures" / "README.md").read_text("utf-8")
    patterns = [item.pattern for item in paper.items if item.pattern]
    for check in checks:
        assert check.passed, check
        assert any(re.match(pattern, check.what) for pattern in patterns), (
            f"{check.what} belongs to no item"
        )
    for row in (row for row in rows("by_construction.csv") if row["page"] == paper.page):
        assert any(check.constructed == row["source"] for check in checks), (
            f"{row['pattern']} is no check"
        )
    for item in (item for item in paper.items if item.figure):
        caption, *lines = item.description(checks)
        said = "".join(f"* {line}\n" for line in lines)
        assert (
            f"## {item.figure}\n\n![{item.figure}]({item.figure}.png)\n\n{caption}\n\n{said}"
            in figures
        )
    if paper.page == "grid_search":
        assert sum(check.what.startswith("Table 1") for check in checks) == 16 * 5
        assert sum(check.what.startswith("Table 2") for check in checks) == 16 * 8


def test_items_name_files_and_figures_that_exist_and_miss_no_figure() -> None:
    items = [item for paper in PAPERS for item in paper.items]
    for item in items:
        assert all((ROOT / path).is_file() for path in item.where.split(", ") if path), item
        assert item.where or item.remark, item
    assert {item.figure for item in items if item.figure} == FIGURES.keys()


@pytest.mark.parametrize(
    ("check", "verdict"),
    [
        (Check("figure", 1.0, 1.05, 0.1), "agrees"),
        (Check("figure", 1.0, math.nan, 0.1), "MISMATCH"),
        (at_least("figure", 1.0, 1.0), "agrees"),
        (at_least("figure", 1.0, 0.9), "MISMATCH"),
        (at_most("figure", 1.0, math.nan), "MISMATCH"),
        (claim("claim", False), "MISMATCH"),
        (claim("claim", False, not_reproduced="reason"), "not reproduced"),
        (claim("claim", True, not_reproduced="reason"), "REASON OUT OF DATE"),
        (Check("figure", 1.0, 1.0, constructed="reason"), "consistent by construction"),
        (Check("figure", 1.0, 1.1, constructed="reason"), "MISMATCH"),
    ],
)
def test_verdicts_and_exit_status(
    check: Check, verdict: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check.verdict == verdict
    status = 0 if verdict in PASSED else 1
    assert (
        reproduce((Paper("a paper", lambda: iter([check]), lambda: iter(["the table"])),), text)
        == status
    )
    printed = capsys.readouterr().out
    assert "the table" in printed
    assert verdict in printed
    assert check.reason in printed
    assert f"All papers: agrees {int(verdict == 'agrees')}" in printed
    assert f"{verdict} 1" in printed.splitlines()[-2]


@pytest.mark.slow
@pytest.mark.parametrize("rule", TWO_LIMITS)
def test_measuring_gains_nothing_where_blanks_are_equal_and_never_loses(rule: str) -> None:
    assert gain(rule, Blank("equal", "test", 5.0, 0.0)) == pytest.approx(0.0, abs=1e-9)
    assert all(gain(rule, blank) > -1e-9 for blank in part_programming.blanks())


@pytest.mark.slow
def test_the_claims_on_the_correction_hold_with_every_slack() -> None:
    for slack in (1.5, 2.0, 2.5, 3.0):
        for source in part_programming.SOURCES:
            gains = {
                rule: np.mean([*part_programming.gains(rule, source, slack).values()])
                for rule in TWO_LIMITS
            }
            assert (
                min(gains[rule] for rule in part_programming.IMPROVED)
                >= part_programming.WORTH_HAVING
            )
            assert (
                max(gains[rule] for rule in part_programming.NOT_NECESSARY)
                <= part_programming.WORTH_HAVING
            )


@pytest.mark.slow
def test_what_rolled_blanks_gain_rests_on_a_garbled_number_and_the_conclusions_do_not() -> None:
    in_use, *others = (
        part_programming.gain_by_reading("PV", "rolling", each)
        for each in part_programming.READINGS["rolling"]
    )
    assert in_use > 5.0
    assert min(others) < part_programming.WORTH_HAVING
    smallest = {kind: min(readings) for kind, readings in part_programming.READINGS.items()}
    for rule in part_programming.IMPROVED:
        found = [
            part_programming.gain_by_reading(rule, kind, deviation)
            for kind, deviation in smallest.items()
        ]
        assert max(found) >= part_programming.WORTH_HAVING
