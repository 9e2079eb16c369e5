import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from baselines.two_limits import TWO_LIMITS
from papers.figures.__main__ import FIGURES
from papers.reproduce import alaskari_oraby, part_programming
from papers.reproduce.__main__ import PAPERS, agreement, main, reproduce, unheld
from papers.reproduce.checks import Check, Item, Paper, at_least, at_most, claim, summary
from papers.reproduce.part_programming import Blank, divided_cost, gain, pass_cost, uncorrected_cost

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_every_figure_of_every_paper_agrees_and_the_page_tells_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    papers = [replace(paper, checks=partial(iter, list(paper.checks()))) for paper in PAPERS]
    monkeypatch.setattr("papers.reproduce.__main__.PAPERS", papers)
    assert main(["--markdown"]) == 0
    assert capsys.readouterr().out in (ROOT / "docs" / "papers" / "index.md").read_text("utf-8")
    grid_search = [check.what for check in papers[0].checks()]
    assert sum(what.startswith("Table 1") for what in grid_search) == 16 * 5
    assert sum(what.startswith("Table 2") for what in grid_search) == 16 * 8
    for paper in papers:
        patterns = [item.pattern for item in paper.items if item.pattern]
        for check in paper.checks():
            assert any(re.match(pattern, check.what) for pattern in patterns), f"{check.what} belongs to no item of {paper.title}"


def test_items_name_files_and_figures_that_exist_and_miss_no_figure() -> None:
    items = [item for paper in PAPERS for item in paper.items]
    for item in items:
        assert all((ROOT / path).is_file() for path in item.where.split(", ") if path), item
        assert item.where or item.remark, item
    assert {item.figure for item in items if item.figure} == FIGURES.keys()


def test_an_item_counts_its_checks_once_and_gives_reasons() -> None:
    checks = [claim("a: 1", True), claim("a: 2", False, "reason"), claim("b", True)]
    assert agreement(Item("item", pattern="a", remark="Remark."), checks) == "1 of 2 agree. Not: reason. Remark."
    assert agreement(Item("item", pattern="b"), checks) == "Agrees (1)."
    assert agreement(Item("item", remark="Not in the text."), checks) == "Not in the text."


@pytest.mark.slow
@pytest.mark.parametrize("column", ["feed_mm_rev", "total_wear_mm"])
def test_a_figure_that_is_off_fails(column: str, monkeypatch: pytest.MonkeyPatch) -> None:
    printed = alaskari_oraby.rows

    def altered(table: str) -> list[dict[str, str]]:
        rows = printed(table)
        for row in rows:
            if column in row:
                row[column] = str(float(row[column]) * 1.01)
        return rows

    monkeypatch.setattr(alaskari_oraby, "rows", altered)
    assert any(check.verdict == "MISMATCH" for check in PAPERS[0].checks())


@pytest.mark.parametrize(
    ("check", "verdict"),
    [
        (Check("figure", 1.0, 1.05, 0.1), "ok"),
        (Check("figure", 1.0, 1.2, 0.1), "MISMATCH"),
        (Check("figure", 1.0, math.nan, 0.1), "MISMATCH"),
        (at_least("figure", 1.0, 1.0), "ok"),
        (at_least("figure", 1.0, 0.9), "MISMATCH"),
        (at_most("figure", 1.0, 1.0), "ok"),
        (at_most("figure", 1.0, math.nan), "MISMATCH"),
        (claim("claim", True), "ok"),
        (claim("claim", False), "MISMATCH"),
        (claim("claim", False, not_reproduced="reason"), "not reproduced"),
        (claim("claim", True, not_reproduced="reason"), "REASON OUT OF DATE"),
        (Check("figure", 1.0, 1.2, 0.1, not_reproduced="reason"), "not reproduced"),
    ],
)
def test_verdicts_and_exit_status(check: Check, verdict: str, capsys: pytest.CaptureFixture[str]) -> None:
    def checks() -> Iterator[Check]:
        yield check

    assert check.verdict == verdict
    assert reproduce((Paper("a paper", checks),)) == (0 if verdict in ("ok", "not reproduced") else 1)
    printed = capsys.readouterr().out
    assert verdict in printed
    assert check.not_reproduced in printed
    assert "NO LONGER HOLD" in printed or check.passed


def test_a_summary_counts_what_holds_and_what_is_known_not_to() -> None:
    checks = [claim("a", True), claim("b", False), claim("c", False, not_reproduced="reason")]
    assert summary("a paper", checks) == "a paper: 1 of 3 agree, 1 not reproduced, 1 NO LONGER HOLD"


def test_json_holds_the_checks_and_verdicts_alone(capsys: pytest.CaptureFixture[str]) -> None:
    papers = (Paper("a paper", lambda: iter([claim("the claim", False)]), lambda: iter(["the table"])),)
    assert reproduce(papers, "json") == 1
    (paper,) = json.loads(capsys.readouterr().out)
    assert (paper["title"], [check["verdict"] for check in paper["checks"]]) == ("a paper", ["MISMATCH"])


def test_blanks_are_those_of_the_paper() -> None:
    found = {(blank.name, blank.source): (blank.least, blank.dispersion) for blank in part_programming.blanks()}
    assert found["rolling", "handbook"] == (pytest.approx(0.32 + 0.4 + 2.1), 4.32)
    assert found["welding", "experience"] == (pytest.approx(1.5 + 1.06), 8.1)  # no roughness or deviation of its own
    assert ("rolling", "experience") not in found  # no dispersion


@pytest.mark.slow
@pytest.mark.parametrize("rule", TWO_LIMITS)
def test_measuring_gains_nothing_where_blanks_are_alike_and_never_loses(rule: str) -> None:
    assert gain(rule, Blank("alike", "test", 5.0, 0.0))[1] == pytest.approx(0.0, abs=1e-9)
    assert all(gain(rule, blank)[1] > -1e-9 for blank in part_programming.blanks())


def test_a_path_for_the_largest_blank_meets_smaller_ones_with_thinner_passes_and_air() -> None:
    blank = Blank("blank", "test", 1.0, 5.0)
    costs = uncorrected_cost("PV", blank, 3)  # passes of 2 mm
    assert costs[-1] == pytest.approx(divided_cost("PV", np.array([6.0]))[2, 0])
    deep, thin, air = pass_cost("PV", np.array([2.0, 1.5, 0.0]))
    middle = int(np.argmin(np.abs(blank.allowances - 3.5)))
    assert costs[middle] == pytest.approx(deep + thin + air)


def test_a_pass_too_deep_for_a_limit_that_the_rule_does_not_name_is_not_planned() -> None:
    within, beyond = pass_cost("SN", np.array([4.9, 5.1]))  # twice the force of 2.5 mm
    assert np.isfinite(within)
    assert np.isinf(beyond)
    assert np.isfinite(pass_cost("PT", np.array([11.0]))[0])  # no lowest feed


@pytest.mark.slow
def test_the_claims_on_the_correction_hold_with_every_slack() -> None:
    for slack in part_programming.SLACKS:
        for source in ("handbook", "experience"):
            gains = {rule: part_programming.most_gain(rule, source, slack) for rule in TWO_LIMITS}
            assert min(gains[rule] for rule in part_programming.IMPROVED) >= part_programming.WORTH_HAVING
            assert max(gains[rule] for rule in part_programming.NOT_NECESSARY) <= part_programming.WORTH_HAVING


@pytest.mark.soak
def test_an_item_with_a_check_that_does_not_hold_is_counted_once() -> None:
    checks = [claim("equal wear: 1", False, "reason"), claim("equal wear: 2", False, "reason"), claim("pairs of the grid", True)]
    paper = Paper("a paper", lambda: iter(checks), page="grid_search")
    figures = [item for item in paper.items if item.figure]
    assert unheld(paper, checks) - unheld(paper, []) == 1
    assert unheld(paper, []) <= len(figures)
