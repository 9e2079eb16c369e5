"""The page and the printed table."""

import hashlib
import re
from base64 import b64encode
from html.parser import HTMLParser
from pathlib import Path

import pytest

from leaderboard import page
from leaderboard.page.charts import chart_data
from leaderboard.ranking import Leaderboard, read_leaderboard
from leaderboard.result import Task, result_folder, write_result
from tests.leaderboard.conftest import ENV_ID, MakeResult, play_all, spec

HOSTILE = "<script>alert(1)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, task: Task, make_result: MakeResult) -> Path:
    """Results of a rule with a hostile name, the two to compare with, and an infeasible agent of two training seeds."""
    folder = result_folder(tmp_path_factory.mktemp("page"), ENV_ID, task.scenario.name)
    rules = [spec(name, (0.0, 0.1 * place)) for place, name in enumerate((HOSTILE, "fixed_tuned", "grid_search"))]
    play_all(task, rules, folder, fresh=False)
    for seed in (0, 1):
        write_result(make_result("ppo", seed, severe_overload_time=30.0), folder)
    return folder


@pytest.fixture(scope="module")
def leaderboard(folder: Path) -> Leaderboard:
    return read_leaderboard(folder)


@pytest.fixture(scope="module")
def html(leaderboard: Leaderboard) -> str:
    return page.render([leaderboard])


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


def test_page_is_well_formed_and_needs_nothing_beside_itself(html: str) -> None:
    outline = Outline()
    outline.feed(html)
    assert not outline.open
    assert not re.search(r"url\(|@import|src=|<link|<img|<iframe", html)
    assert not [attributes for _, attributes in outline.seen if attributes.keys() & {"src", "onclick"}]
    styles = {str(attributes["style"]) for _, attributes in outline.seen if "style" in attributes}
    assert all(re.fullmatch("--own: #[0-9A-Fa-f]{6}", style) for style in styles)
    assert all(str(attributes["href"]).startswith("#") for tag, attributes in outline.seen if tag == "a")
    # Only the page's own script may run, and hostile names are text.
    (script,) = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    digest = b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'" in html
    assert HOSTILE not in html
    assert "&lt;script&gt;alert(1)" in html
    assert "\\u003cscript\\u003ealert(1)" in html


def test_tables_are_accessible_and_say_who_is_not_feasible(html: str) -> None:
    outline = Outline()
    outline.feed(html)
    heads = [attributes for tag, attributes in outline.seen if tag == "th"]
    assert all(head.get("scope") in ("col", "colgroup", "row") for head in heads)
    assert sum(head["scope"] == "row" for head in heads) == 4
    assert html.count(">✕ not feasible<") == 1
    assert html.count("<caption>") == 1
    ids = {attributes["id"] for _, attributes in outline.seen if "id" in attributes}
    controlled = [attributes["aria-controls"] for _, attributes in outline.seen if "aria-controls" in attributes]
    assert ids.issuperset(controlled)


def test_trajectories_are_those_of_the_standings_with_the_recorded_seeds(leaderboard: Leaderboard) -> None:
    data = chart_data(leaderboard)
    assert data is not None
    assert data["seeds"] == [7, 8, 9]
    labels = [policy and policy["label"] for policy in data["policies"]]
    assert labels == [None if standing.name == "ppo" else standing.name for standing in leaderboard.standings]
    assert labels[data["second"]] == "grid_search"
    trajectory = data["policies"][0]["trajectories"][0]
    assert trajectory["steps"] == 12
    assert trajectory["kept"] == 12
    assert {subject["series"]: subject["limit"] for subject in data["subjects"]} == {
        "cutting_speed": None,
        "feed": None,
        "thrust_force": leaderboard.task.scenario.limits.thrust_force,
        "power": leaderboard.task.scenario.limits.power,
        "wear": leaderboard.task.scenario.tool.wear_criterion,
    }
