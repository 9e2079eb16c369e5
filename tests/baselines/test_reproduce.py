import math
from collections.abc import Iterator

import pytest

from baselines.reproduce import alaskari_oraby
from baselines.reproduce.__main__ import PAPERS, main
from baselines.reproduce.checks import Check, Paper, at_least, at_most, claim, summary

GRID_SEARCH = (PAPERS[0],)


def test_every_figure_of_every_paper_agrees(capsys: pytest.CaptureFixture[str]) -> None:
    assert main() == 0
    printed = capsys.readouterr().out
    assert "MISMATCH" not in printed
    assert sum(line.startswith("Table 1") for line in printed.splitlines()) == 16 * 5
    assert sum(line.startswith("Table 2") for line in printed.splitlines()) == 16 * 8
    for paper in PAPERS:
        assert f"\n{paper.title}: " in printed


@pytest.mark.parametrize("column", ["thrust_force_n", "feed_mm_rev", "total_wear_mm"])
def test_a_figure_that_is_off_fails(column: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    printed = alaskari_oraby.rows

    def altered(table: str) -> list[dict[str, str]]:
        rows = printed(table)
        for row in rows:
            if column in row:
                row[column] = str(float(row[column]) * 1.01)
        return rows

    monkeypatch.setattr(alaskari_oraby, "rows", altered)
    assert main(GRID_SEARCH) == 1
    assert "MISMATCH" in capsys.readouterr().out


def test_the_tests_ratios_per_minute_hold_and_their_totals_only_with_measured_lives() -> None:
    checks = {check.what: check for check in alaskari_oraby.rival_checks()}
    assert all(check.verdict == "ok" for what, check in checks.items() if what.endswith("per minute"))
    for name in ("T4", "T8", "T9"):
        total = f"grid search / {name}, metal per edge, "
        assert checks[f"{total}life as measured; grid search 15 min"].verdict == "ok"
        assert checks[f"{total}life as measured"].verdict == "not reproduced"
        assert checks[f"{total}nominal wear"].verdict == "not reproduced"


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
    assert main((Paper("a paper", checks),)) == (0 if verdict in ("ok", "not reproduced") else 1)
    printed = capsys.readouterr().out
    assert verdict in printed
    assert check.not_reproduced in printed
    assert "NO LONGER HOLD" in printed or check.passed


def test_a_summary_counts_what_holds_and_what_is_known_not_to() -> None:
    checks = [claim("a", True), claim("b", False), claim("c", False, not_reproduced="reason")]
    assert summary("a paper", checks) == "a paper: 1 of 3 agree, 1 not reproduced, 1 NO LONGER HOLD"


def test_tables_come_before_the_checks(capsys: pytest.CaptureFixture[str]) -> None:
    main((Paper("a paper", lambda: iter([claim("the claim", True)]), lambda: iter(["the table"])),))
    printed = capsys.readouterr().out
    assert printed.index("the table") < printed.index("the claim")
