"""The page and the printed table."""

import hashlib
import math
import re
from base64 import b64encode
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from leaderboard import page, table
from leaderboard.board import Board, read_board
from leaderboard.page.courses import ALPHABET, GAP, LEVELS, chart_data, pack
from leaderboard.result import Task, result_path, write_part
from tests.leaderboard.conftest import MakeResult, contestant, play_all

HOSTILE = "<script>alert(1)"


@pytest.fixture
def board(task: Task, folder: Path, make_result: MakeResult) -> Board:
    """A rule with a hostile name, the two to compare with, and an infeasible agent of two training seeds."""
    rules = [contestant(name, (0.0, 0.1 * place)) for place, name in enumerate((HOSTILE, "fixed_tuned", "grid_search"))]
    play_all(task, rules, folder, fresh=False)
    for seed in (0, 1):
        result = make_result("ppo", seed, severe_overload_time=30.0)
        write_part(result, result_path(folder, result.policy))
    return read_board(folder)


class Outline(HTMLParser):
    """The elements of a page, and those that are still open."""

    VOID = ("meta", "input")

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
    assert not re.search(r"url\(|@import|src=|<link|<img|<iframe", html)
    assert not [attributes for _, attributes in outline.seen if attributes.keys() & {"src", "style", "onclick"}]
    assert all(str(attributes["href"]).startswith("#") for tag, attributes in outline.seen if tag == "a")


def test_only_the_page_s_own_script_may_run(board: Board) -> None:
    html = page.render([board])
    (script,) = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    digest = b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'" in html


def test_hostile_names_are_text(board: Board) -> None:
    html = page.render([board])
    assert HOSTILE not in html
    assert "&lt;script&gt;alert(1)" in html
    assert "\\u003cscript\\u003ealert(1)" in html
    assert html.count("<script>") == 1


def test_tables_are_accessible_and_say_who_is_not_feasible(board: Board) -> None:
    outline = Outline()
    html = page.render([board])
    outline.feed(html)
    heads = [attributes for tag, attributes in outline.seen if tag == "th"]
    assert all(head.get("scope") in ("col", "colgroup", "row") for head in heads)
    assert sum(head["scope"] == "row" for head in heads) == 4
    assert html.count(">✕ no<") == 1
    assert html.count(">✓ yes<") == 3
    assert html.count("<caption>") == 1
    ids = {attributes["id"] for _, attributes in outline.seen if "id" in attributes}
    controlled = [attributes["aria-controls"] for _, attributes in outline.seen if "aria-controls" in attributes]
    assert len(controlled) == 4
    assert ids.issuperset(controlled)


def test_every_column_has_a_unit_and_a_definition(board: Board) -> None:
    html = page.render([board])
    heads = re.findall(r'<th scope="col" class="g\d"><button type="button" data-first="\w+" title="[^"]+">(.*?)</button>', html)
    assert len(heads) == html.count('<th scope="col" class="g')
    assert all(re.fullmatch(r"[^<]+ <small>\[[^\]]+\]</small>", head) for head in heads)


def test_page_says_where_numbers_come_from(board: Board) -> None:
    html = page.render([board])
    assert board.results[0].digests.task in html
    assert "python -m leaderboard run --env RoughTurning-v0 --scenario SCENARIO.toml --draws 4" in html
    assert "--agents ppo-seed0.onnx ppo-seed1.onnx" in html
    assert "time_limit = 0.2" in html


def test_courses_are_those_of_the_standings_on_the_recorded_draws(board: Board) -> None:
    data = chart_data(board)
    assert data is not None
    assert data["draws"] == [7, 8, 9]
    labels = [policy and policy["label"] for policy in data["policies"]]
    assert labels == [None if standing.name == "ppo" else standing.name for standing in board.standings]
    assert labels[data["second"]] == "grid_search"
    course = data["policies"][0]["courses"][0]
    assert course["steps"] == 12
    assert {len(packed) for packed in course["series"].values()} == {24}
    assert {subject["series"]: subject["limit"] for subject in data["subjects"]} == {
        "cutting_speed": None,
        "feed": None,
        "thrust_force": board.task.scenario.limits.thrust_force,
        "power": board.task.scenario.limits.power,
        "wear": board.task.scenario.tool.wear_criterion,
    }


def test_packed_values_come_back() -> None:
    values = np.array([-1.0, 0.25, 3.0, math.nan])
    packed = pack(values, -1.0, 3.0)
    codes = [64 * ALPHABET.index(first) + ALPHABET.index(second) for first, second in zip(packed[::2], packed[1::2], strict=True)]
    assert codes[-1] == GAP
    np.testing.assert_allclose(np.array(codes[:-1]) / LEVELS * 4.0 - 1.0, values[:-1], atol=4.0 / LEVELS)
    assert pack([2.0, 2.0], 2.0, 2.0) == "AAAA"


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
    assert "application/json" not in html
    assert html.count("<small>no trajectory recorded</small>") == 4


def test_table_lists_policies_by_rank(board: Board) -> None:
    lines = table.render(board).splitlines()
    assert lines[0].startswith("RoughTurning-v0, scenario rough_turning, 4 draws, task ")
    ranked = [line.split()[:3] for line in lines if re.match(r" +\d+  ", line)]
    assert len(ranked) == 16
    assert ranked[:4] == ranked[4:8] == ranked[8:12] == ranked[12:]
    assert max(map(len, lines)) <= 160
    assert ranked[3] == ["4", "ppo", "2"]
    assert "NO" in next(line for line in lines if " ppo " in line)
