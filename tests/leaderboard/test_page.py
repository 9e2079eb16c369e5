"""The page and the printed table."""

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from leaderboard import page, table
from leaderboard.board import Board, read_board
from leaderboard.charts import Scale, scale
from leaderboard.results import Task, result_path, write_part
from tests.leaderboard.conftest import MakeResult, contestant, play_all

HOSTILE = "<script>alert(1)"


@pytest.fixture
def board(task: Task, folder: Path, make_result: MakeResult) -> Board:
    """A rule with a hostile name, the two to compare with, and an inadmissible agent of two training seeds."""
    rules = [contestant(name, (0.0, 0.1 * place)) for place, name in enumerate((HOSTILE, "fixed_tuned", "grid_search"))]
    play_all(task, rules, folder, fresh=False)
    for seed in (0, 1):
        result = make_result("ppo", seed, severe_overload_time=30.0)
        write_part(result, result_path(folder, result.policy))
    return read_board(folder)


class Outline(HTMLParser):
    """The elements of a page, and those that are still open."""

    VOID = ("meta", "line", "circle", "polyline")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_page_is_well_formed_and_needs_nothing_beside_itself(board: Board) -> None:
    html = page.render([board])
    outline = Outline()
    outline.feed(html)
    assert not outline.open
    assert not re.search(r"https?:|url\(|@import|src=|<link|<img|<iframe", html)
    assert not [attributes for _, attributes in outline.seen if attributes.keys() & {"src", "href", "style", "onclick"}]


def test_hostile_names_are_text(board: Board) -> None:
    html = page.render([board])
    assert HOSTILE not in html
    assert "&lt;script&gt;alert(1)" in html
    assert html.count("<script>") == 1


def test_tables_are_accessible_and_say_who_is_not_admissible(board: Board) -> None:
    outline = Outline()
    html = page.render([board])
    outline.feed(html)
    heads = [attributes for tag, attributes in outline.seen if tag == "th"]
    assert all(head.get("scope") in ("col", "colgroup", "row") for head in heads)
    assert sum(head["scope"] == "row" for head in heads) == 4
    assert "✕ no" in html
    assert html.count("<caption>") == 1


def test_page_draws_trajectories_and_says_where_numbers_come_from(board: Board) -> None:
    html = page.render([board])
    assert html.count("<polyline") == 3 * 7
    assert board.results[0].digests.task in html
    assert "python -m leaderboard run --env RoughTurning-v0 --scenario SCENARIO.toml --draws 4" in html
    assert "--agents ppo-seed0.onnx ppo-seed1.onnx" in html
    assert "time_limit = 0.2" in html


def test_page_names_the_best_rule(board: Board, folder: Path) -> None:
    first, second = sorted(
        (standing for standing in board.standings if standing.kind == "rule"), key=lambda standing: -standing.mean_return.value
    )[:2]
    assert first.over_best_rule is not None
    assert first.over_best_rule.value == pytest.approx(first.mean_return.value - second.mean_return.value)
    html = page.render([board]).replace("&lt;", "<").replace("&gt;", ">")
    assert f"<dt>best rule</dt><dd>{first.name}, itself compared with {second.name}.</dd>" in html
    for result in board.results:
        if result.policy.kind == "rule":
            result_path(folder, result.policy).unlink()
    assert "<dt>best rule</dt><dd>none has played.</dd>" in page.render([read_board(folder)])


def test_page_without_trajectories(board: Board, folder: Path) -> None:
    (folder / "trajectories.json.xz").unlink()
    html = page.render([read_board(folder)])
    assert "<polyline" not in html
    assert "On the same bars" not in html


def test_table_lists_policies_by_rank(board: Board) -> None:
    lines = table.render(board).splitlines()
    assert lines[0].startswith("RoughTurning-v0, scenario rough_turning, 4 draws, task ")
    ranked = [line.split()[:3] for line in lines if re.match(r" +\d+  ", line)]
    assert len(ranked) == 16
    assert ranked[:4] == ranked[4:8] == ranked[8:12] == ranked[12:]
    assert max(map(len, lines)) <= 160
    assert ranked[3] == ["4", "ppo", "2"]
    assert "NO" in next(line for line in lines if " ppo " in line)


def test_scales_have_round_ticks() -> None:
    assert Scale(0.0, 1.0, 0, 100).ticks(6) == pytest.approx([0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert Scale(-2400.0, -600.0, 0, 100).ticks(8) == [-2000, -1500, -1000]
    assert scale([5.0, 5.0], 0, 10)(5.0) == 5.0
