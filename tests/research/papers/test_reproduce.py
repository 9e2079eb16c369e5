"""The checks of the papers: every one passes, and the pages state it."""

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from baselines.two_limits import TWO_LIMITS
from research.papers import rows
from research.papers.catalogue import FIGURES, PAPERS, Item, Paper
from research.papers.reproduce import part_programming
from research.papers.reproduce.__main__ import markdown, reproduce, text
from research.papers.reproduce.checks import PASSED, Check, at_least, at_most, claim
from research.papers.reproduce.part_programming import (
    CLAIMED,
    IMPROVED,
    NOT_NECESSARY,
    READINGS,
    SOURCES,
    WORTH_HAVING,
    Blank,
    gain,
    gain_by_reading,
)

ROOT = Path(__file__).parents[3]


class Checked(NamedTuple):
    """A paper and its checks."""

    paper: Paper
    checks: list[Check]


@pytest.fixture(scope="module", params=PAPERS, ids=lambda paper: paper.page)
def checked(request: pytest.FixtureRequest) -> Checked:
    """A paper with its checks, which take seconds to compute."""
    return Checked(request.param, request.param.checks())


def lines_of(*path: str) -> list[str]:
    """Return the lines of a file of the project."""
    return ROOT.joinpath(*path).read_text("utf-8").splitlines()


# Rows and columns of the tables of numbers, all of which are checked.
TABLE_SIZES = {"grid_search": {"Table 1": 16 * 5, "Table 2": 16 * 8}}


@pytest.mark.slow
def test_every_check_of_a_paper_passes_and_no_number_is_left_out(checked: Checked) -> None:
    assert checked.checks
    for check in checked.checks:
        assert check.passed, check
    for table, size in TABLE_SIZES.get(checked.paper.page, {}).items():
        of_table = [check for check in checked.checks if check.what.startswith(table)]
        assert len(of_table) == size


@pytest.mark.slow
def test_every_check_belongs_to_an_item(checked: Checked) -> None:
    patterns = [item.pattern for item in checked.paper.items if item.pattern]
    for check in checked.checks:
        has_item = any(re.match(pattern, check.what) for pattern in patterns)
        assert has_item, f"{check.what} belongs to no item"


@pytest.mark.slow
def test_every_input_of_the_project_is_a_check(checked: Checked) -> None:
    sources = {check.constructed for check in checked.checks}
    for row in rows("by_construction.csv"):
        if row["page"] == checked.paper.page:
            assert row["source"] in sources, f"{row['pattern']} is no check"


@pytest.mark.slow
def test_the_pages_state_the_checks(checked: Checked) -> None:
    printed = list(markdown([checked]))
    items = lines_of("research", "papers", "items.md")
    assert [line for line in printed if line not in items] == []
    summary = printed[: printed.index("")]
    page = lines_of("docs", "papers.md")
    assert [line for line in summary if line not in page] == []


@pytest.mark.slow
def test_the_captions_of_figures_state_the_checks(checked: Checked) -> None:
    figures = (ROOT / "docs" / "figures" / "README.md").read_text("utf-8")
    for item in checked.paper.items:
        if item.figure:
            caption, *remarks = item.description(checked.checks)
            heading = f"## {item.figure}\n\n![{item.figure}]({item.figure}.png)"
            listed = "".join(f"* {remark}\n" for remark in remarks)
            assert f"{heading}\n\n{caption}\n\n{listed}" in figures


ITEMS = [
    pytest.param(item, id=f"{paper.page}: {item.name}") for paper in PAPERS for item in paper.items
]


@pytest.mark.parametrize("item", ITEMS)
def test_an_item_is_in_files_that_exist_or_has_a_remark(item: Item) -> None:
    assert item.where or item.remark
    if item.where:
        for path in item.where.split(", "):
            assert (ROOT / path).is_file(), path


def test_every_figure_belongs_to_an_item() -> None:
    drawn = set()
    for paper in PAPERS:
        drawn |= {item.figure for item in paper.items if item.figure}
    assert drawn == FIGURES.keys()


VERDICTS = [
    pytest.param(
        Check("figure", paper=1.0, ours=1.05, tolerance=0.1),
        "agrees",
        id="within tolerance",
    ),
    pytest.param(
        Check("figure", paper=1.0, ours=math.nan, tolerance=0.1),
        "MISMATCH",
        id="NaN",
    ),
    pytest.param(
        at_least("figure", 1.0, ours=1.0),
        "agrees",
        id="least itself",
    ),
    pytest.param(
        at_least("figure", 1.0, ours=0.9),
        "MISMATCH",
        id="below least",
    ),
    pytest.param(
        at_most("figure", 1.0, ours=math.nan),
        "MISMATCH",
        id="NaN, at most",
    ),
    pytest.param(
        claim("claim", False),
        "MISMATCH",
        id="false",
    ),
    pytest.param(
        claim("claim", False, not_reproduced="reason"),
        "not reproduced",
        id="known to be false",
    ),
    pytest.param(
        claim("claim", True, not_reproduced="reason"),
        "REASON OUT OF DATE",
        id="true after all",
    ),
    pytest.param(
        Check("figure", paper=1.0, ours=1.0, constructed="reason"),
        "consistent by construction",
        id="input of the project",
    ),
    pytest.param(
        Check("figure", paper=1.0, ours=1.1, constructed="reason"),
        "MISMATCH",
        id="input that differs",
    ),
]


@pytest.mark.parametrize(("check", "verdict"), VERDICTS)
def test_a_check_has_a_verdict(check: Check, verdict: str) -> None:
    assert check.verdict == verdict


@pytest.mark.parametrize(("check", "verdict"), VERDICTS)
def test_the_command_prints_verdicts_and_fails_if_one_is_bad(
    check: Check, verdict: str, capsys: pytest.CaptureFixture[str]
) -> None:
    paper = Paper("a paper", compare=lambda: iter([check]), tables=lambda: iter(["the table"]))
    expected_status = 0 if verdict in PASSED else 1
    assert reproduce([paper], text) == expected_status
    printed = capsys.readouterr().out
    assert "the table" in printed
    assert verdict in printed
    assert check.reason in printed
    agreeing = int(verdict == "agrees")
    assert f"All papers: agrees {agreeing}" in printed
    total = printed.splitlines()[-2]
    assert f"{verdict} 1" in total


@pytest.mark.slow
@pytest.mark.parametrize("rule", TWO_LIMITS)
def test_measuring_gains_nothing_where_blanks_are_equal_and_never_loses(rule: str) -> None:
    equal = Blank("equal", "test", 5.0, 0.0)
    assert gain(rule, equal) == pytest.approx(0.0, abs=1e-9)
    gains = [gain(rule, blank) for blank in part_programming.blanks()]
    assert min(gains) > -1e-9


@pytest.mark.slow
@pytest.mark.parametrize("slack", [1.5, 2.0, 2.5, 3.0])
@pytest.mark.parametrize("source", SOURCES)
def test_the_claims_on_the_correction_hold_with_every_slack(source: str, slack: float) -> None:
    mean_gains = {}
    for rule in CLAIMED:
        gains_by_kind = part_programming.gains(rule, source, slack)
        mean_gains[rule] = np.mean(list(gains_by_kind.values()))
    assert min(mean_gains[rule] for rule in IMPROVED) >= WORTH_HAVING
    assert max(mean_gains[rule] for rule in NOT_NECESSARY) <= WORTH_HAVING


@pytest.mark.slow
def test_the_gain_of_rolled_blanks_rests_on_a_garbled_number() -> None:
    in_use, *other_readings = READINGS["rolling"]
    assert gain_by_reading("PV", "rolling", in_use) > 5.0
    other_gains = [gain_by_reading("PV", "rolling", reading) for reading in other_readings]
    assert min(other_gains) < WORTH_HAVING


@pytest.mark.slow
@pytest.mark.parametrize("rule", IMPROVED)
def test_the_claims_do_not_rest_on_garbled_numbers(rule: str) -> None:
    gains = []
    for kind, readings in READINGS.items():
        gains.append(gain_by_reading(rule, kind, min(readings)))
    assert max(gains) >= WORTH_HAVING
