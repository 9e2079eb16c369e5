"""The page: it needs nothing beside itself, texts are texts, tables are accessible, and trajectories are those recorded."""

import hashlib
import re
from base64 import b64encode
from collections import Counter

import pytest

from leaderboard import page
from leaderboard.page.charts import chart_data
from leaderboard.ranking import Leaderboard, read_leaderboard
from leaderboard.result import Task, result_folder, write_result
from tests.leaderboard.conftest import ENV_ID, MakeResult, play_all, spec

HOSTILE = "<script>alert(1)"


@pytest.fixture(scope="module")
def leaderboard(
    tmp_path_factory: pytest.TempPathFactory, task: Task, make_result: MakeResult
) -> Leaderboard:
    """Results of a rule with a hostile name, the two to compare with, and an infeasible agent of two training seeds."""
    folder = result_folder(tmp_path_factory.mktemp("page"), ENV_ID, task.scenario.name)
    play_all(
        task,
        [
            spec(name, (0.0, 0.1 * i))
            for i, name in enumerate((HOSTILE, "fixed_tuned", "grid_search"))
        ],
        folder,
    )
    for seed in (0, 1):
        write_result(make_result("ppo", seed, severe_overload_time=30.0), folder)
    return read_leaderboard(folder)


def test_a_page_is_whole_and_accessible_and_runs_its_own_script_alone(
    leaderboard: Leaderboard,
) -> None:
    html = page.render([leaderboard])
    (script,) = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    digest = b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'" in html
    assert not re.search(r"url\(|@import|\ssrc=|\sonclick=|<link|<img|<iframe", html)
    assert HOSTILE not in html
    assert "&lt;script&gt;alert(1)" in html
    assert "\\u003cscript\\u003ealert(1)" in html
    markup = re.sub(r"(?s)<(script|style)\b.*?</\1>", "", html)
    opened, closed = (
        Counter(re.findall(tag, markup)) for tag in (r"<(\w+)\b[^>]*(?<!/)>", r"</(\w+)>")
    )
    assert {name for name in opened if opened[name] != closed[name]} == {"meta", "input"}
    assert all(
        re.search(r'scope="(col|colgroup|row)"', head)
        for head in re.findall(r"<th\b[^>]*>", markup)
    )
    assert (
        markup.count('scope="row"'),
        markup.count(">✕ infeasible<"),
        markup.count("<caption>"),
    ) == (4, 1, 1)
    assert set(re.findall(r'aria-controls="([^"]*)', markup)) <= set(
        re.findall(r'\sid="([^"]*)', markup)
    )
    assert all(target.startswith("#") for target in re.findall(r'href="([^"]*)', markup))


def test_trajectories_are_those_of_the_standings_with_the_recorded_seeds(
    leaderboard: Leaderboard,
) -> None:
    data = chart_data(leaderboard)
    assert data is not None
    assert data["seeds"] == [7, 8, 9]
    labels = [policy and policy["label"] for policy in data["policies"]]
    assert labels == [
        None if standing.name == "ppo" else standing.name for standing in leaderboard.standings
    ]
    assert labels[data["second"]] == "grid_search"
    assert [data["policies"][0]["trajectories"][0][name] for name in ("steps", "kept")] == [12, 12]
    limits, wear = leaderboard.task.scenario.limits, leaderboard.task.scenario.tool.wear_criterion
    expected = {
        "cutting_speed": None,
        "feed": None,
        "thrust_force": limits.thrust_force,
        "power": limits.power,
        "wear": wear,
    }
    assert {subject["series"]: subject["limit"] for subject in data["subjects"]} == expected
