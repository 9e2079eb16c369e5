"""The table over splits, from results made up to order."""

import numpy as np

from leaderboard import generalisation, page
from leaderboard.board import Board
from leaderboard.result import MadeFor, PolicyRecord, Result, Task
from leaderboard.standings import rank
from tests.leaderboard.conftest import ENV_ID, MakeResult, record_of
from tests.leaderboard.test_page import Outline
from turning_env import SPLITS, Scenario

BASE = Scenario.load("rough_turning")


def board(make_result: MakeResult, scenario: str, policies: dict[str, tuple[PolicyRecord, float]]) -> Board:
    task = Task(env_id=ENV_ID, scenario=Scenario.load(scenario), draws=[1, 2, 3, 4])
    results = []
    for name, (policy, value) in policies.items():
        severe = 30.0 if name == "greedy" and scenario != "rough_turning" else 0.0
        episodes = make_result(name, **{"return": value, "severe_overload_time": severe}).episodes
        results.append(Result.of(task, policy, {field: np.array(values) for field, values in episodes.items()}))
    return Board(task, results, rank(results), None, [])


def made(policy: PolicyRecord, scenario: Scenario) -> PolicyRecord:
    return policy.model_copy(update={"made_for": MadeFor.of(scenario)})


def test_policies_over_the_splits_for_which_they_were_not_made(make_result: MakeResult) -> None:
    agent, bound = made(record_of("ppo", 0), BASE), record_of("oracle").model_copy(update={"kind": "reference"})
    base = board(
        make_result,
        "rough_turning",
        {"greedy": (record_of("greedy"), 5.0), "tuned": (record_of("tuned"), 3.0), "ppo": (agent, 4.0), "oracle": (bound, 9.0)},
    )
    first, second = SPLITS[0], SPLITS[-1]
    splits = [
        board(make_result, second, {"ppo": (agent, 1.0), "tuned": (record_of("tuned"), 8.0), "oracle": (bound, 12.0)}),
        board(make_result, first, {"greedy": (made(record_of("greedy"), BASE), 2.0), "new": (made(record_of("new"), BASE), 7.0)}),
    ]
    foreign = board(make_result, "forging", {"ppo": (agent, 0.0)})
    table = generalisation.across([foreign, *splits, base])
    assert table is not None
    assert table.made_for == "rough_turning"
    assert table.scenarios == ["rough_turning", first, second]
    # What was tuned to the split does not count there, nor does what has not played the base.
    assert {name: list(cells) for name, cells in table.rows.items()} == {
        "greedy": ["rough_turning", first],
        "tuned": ["rough_turning"],
        "ppo": ["rough_turning", second],
        "oracle": ["rough_turning", second],
    }
    assert not table.feasible("greedy", first)
    lines = {line.split()[0]: line.split()[1:] for line in generalisation.render(table).splitlines()[3:]}
    html = page.render([base, *splits])
    outline = Outline()
    outline.feed(html)
    assert not outline.open
    assert "Where they were not made for" in html
    assert html.count('<td class="refused" data-value') == 1
    assert lines == {"greedy": ["5", "2", "NO"], "ppo": ["4", "1"], "tuned": ["3"], "oracle": ["9", "12"]}


def test_there_is_no_table_without_splits(make_result: MakeResult) -> None:
    base = board(make_result, "rough_turning", {"tuned": (record_of("tuned"), 3.0)})
    split = board(make_result, SPLITS[0], {"tuned": (record_of("tuned"), 3.0)})
    assert generalisation.across([base]) is None
    assert generalisation.across([base, split]) is None
    assert generalisation.across([board(make_result, SPLITS[0], {"tuned": (made(record_of("tuned"), BASE), 3.0)})]) is None
