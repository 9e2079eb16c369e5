"""The page is one file, its texts are no markup, and its tables are accessible."""

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
from tests.leaderboard.test_standings import leaderboard_of
from turning_env import IDS, Scenario

HOSTILE = "<script>alert(1)"


@pytest.fixture(scope="module")
def leaderboard(
    tmp_path_factory: pytest.TempPathFactory, task: Task, make_result: MakeResult
) -> Leaderboard:
    """A rule with a hostile name, two comparators, and an infeasible agent of two seeds."""
    folder = result_folder(tmp_path_factory.mktemp("page"), ENV_ID, task.scenario.name)
    names = (HOSTILE, "fixed_tuned", "grid_search")
    policies = [spec(name, (0.0, 0.1 * place)) for place, name in enumerate(names)]
    play_all(task, policies, folder)
    for seed in (0, 1):
        write_result(make_result("ppo", seed, severe_overload_time=30.0), folder)
    return read_leaderboard(folder)


@pytest.fixture(scope="module")
def html(leaderboard: Leaderboard) -> str:
    return page.render([leaderboard])


@pytest.fixture(scope="module")
def markup(html: str) -> str:
    """The page without its script and style."""
    return re.sub(r"(?s)<(script|style)\b.*?</\1>", "", html)


def test_a_page_needs_no_other_file_and_runs_its_own_script_alone(html: str, markup: str) -> None:
    (script,) = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    digest = b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'" in html
    assert not re.search(r"url\(|@import|\ssrc=|\sonclick=|<link|<img|<iframe", html)
    links = re.findall(r'href="([^"]*)', markup)
    assert links
    assert [link for link in links if not link.startswith("#")] == []


def test_a_hostile_name_is_no_markup(html: str) -> None:
    assert HOSTILE not in html
    assert "&lt;script&gt;alert(1)" in html
    assert "\\u003cscript\\u003ealert(1)" in html


def test_every_tag_is_closed(markup: str) -> None:
    opened = Counter(re.findall(r"<(\w+)\b[^>]*(?<!/)>", markup))
    closed = Counter(re.findall(r"</(\w+)>", markup))
    assert {name for name in opened if opened[name] != closed[name]} == {"meta", "input"}


def test_tables_are_accessible(markup: str) -> None:
    heads = re.findall(r"<th\b[^>]*>", markup)
    assert heads
    for head in heads:
        assert re.search(r'scope="(col|colgroup|row)"', head), head
    assert markup.count('scope="row"') == 4
    assert markup.count("<caption>") == 1
    controlled = set(re.findall(r'aria-controls="([^"]*)', markup))
    assert controlled
    assert controlled <= set(re.findall(r'\sid="([^"]*)', markup))


def test_an_infeasible_policy_is_marked(markup: str) -> None:
    assert markup.count(">\N{MULTIPLICATION X} infeasible<") == 1


def test_trajectories_are_those_of_the_standings_with_the_recorded_seeds(
    leaderboard: Leaderboard,
) -> None:
    data = chart_data(leaderboard)
    assert data is not None
    assert data["seeds"] == [7, 8, 9]
    for standing, policy in zip(leaderboard.standings, data["policies"], strict=True):
        if standing.name == "ppo":
            assert policy is None
        else:
            assert policy["label"] == standing.name
    assert data["policies"][data["second"]]["label"] == "grid_search"
    first = data["policies"][0]["trajectories"][0]
    assert first["steps"] == 12
    assert first["kept"] == 12


def test_charts_show_the_limits_of_the_scenario(leaderboard: Leaderboard) -> None:
    data = chart_data(leaderboard)
    assert data is not None
    scenario = leaderboard.task.scenario
    limits = {
        "thrust_force": scenario.limits.thrust_force,
        "power": scenario.limits.power,
        "wear": scenario.tool.wear_criterion,
    }
    assert data["limits"] == [limits] * 3


def board(make_result: MakeResult, env_id: str, fixed: str, agent: float) -> Leaderboard:
    """Return a leaderboard on which the best rule scores 80."""
    on = Task(env_id=env_id, scenario=Scenario.load(IDS[env_id]), seeds=[0, 1])
    parameters = {"training_information": ["rewards"]}
    learned = spec("ppo", seed=0, parameters=parameters)
    return leaderboard_of(
        [
            make_result(fixed, on=on, returns=0.0),
            make_result("rule", on=on, returns=80.0),
            make_result("ppo", on=on, policy=learned, returns=agent),
            make_result(
                "causal",
                on=on,
                policy=spec("causal", kind="oracle"),
                returns=100.0,
            ),
        ]
    )


@pytest.mark.parametrize(("agents", "opening"), [((70.0, 30.0), 1), ((-50.0, 30.0), 0)])
def test_the_page_opens_where_agents_are_farthest_behind_rules(
    agents: tuple[float, float], opening: int, make_result: MakeResult
) -> None:
    boards = [
        board(make_result, "RoughTurning-v0", "fixed_tuned", agents[0]),
        board(make_result, "RoughTurning-Override-v1", "override_tuned", agents[1]),
    ]
    html = page.render(boards)
    task = boards[opening].task
    assert f'data-opens="{task.env_id}/{task.scenario.name}"' in html
    assert html.count("No task has more room") == 1
