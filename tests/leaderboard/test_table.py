"""The table over splits, from made-up results."""

from leaderboard.ranking import Leaderboard
from leaderboard.result import Task
from leaderboard.standings import rank
from leaderboard.table import across, render_across
from tests.leaderboard.conftest import ENV_ID, MakeResult, spec
from turning_env import SPLITS, Scenario
from turning_env.scoring.policy import PolicySpec, ScenarioId

BASE = ScenarioId.of(Scenario.load("rough_turning"))
TUNED_HERE = spec("tuned")


def leaderboard(make_result: MakeResult, scenario: str, costs: list[tuple[PolicySpec, float]]) -> Leaderboard:
    task = Task(env_id=ENV_ID, scenario=Scenario.load(scenario), seeds=[1, 2, 3, 4])
    results = []
    for policy, cost in costs:  # [min/dm3], of a minute's cutting
        severe = 30.0 if policy.name == "greedy" and scenario != "rough_turning" else 0.0
        results.append(make_result(policy.name, policy=policy, on=task, severe_overload_time=severe, removed=1000.0 / cost))
    return Leaderboard(task, results, rank(results), None, [])


def test_policies_over_the_splits_that_they_were_not_tuned_for(make_result: MakeResult) -> None:
    agent, bound = spec("ppo", seed=0, tuned_for=BASE), spec("oracle", kind="oracle")
    greedy, elsewhere, new = spec("greedy"), spec("greedy", tuned_for=BASE), spec("new", tuned_for=BASE)
    base = leaderboard(make_result, "rough_turning", [(greedy, 5.0), (TUNED_HERE, 3.0), (agent, 4.0), (bound, 1.0)])
    first, second = SPLITS[0], SPLITS[-1]
    splits = [
        leaderboard(make_result, second, [(agent, 1.0), (TUNED_HERE, 8.0), (bound, 0.5)]),
        leaderboard(make_result, first, [(elsewhere, 2.0), (new, 7.0)]),
    ]
    table = across([leaderboard(make_result, "forging", [(agent, 1.0)]), *splits, base])
    assert table is not None
    assert (table.tuned_for, table.scenarios) == ("rough_turning", ["rough_turning", first, second])
    # What was tuned for the split does not count there, nor does what has not played the base.
    assert {name: list(cells) for name, cells in table.rows.items()} == {
        "greedy": ["rough_turning", first],
        "tuned": ["rough_turning"],
        "ppo": ["rough_turning", second],
        "oracle": ["rough_turning", second],
    }
    lines = {line.split()[0]: line.split()[1:] for line in render_across(table).splitlines()[3:]}
    assert lines == {"greedy": ["5.00", "2.00", "NO"], "ppo": ["4.00", "1.00"], "tuned": ["3.00"], "oracle": ["1.00", "0.50"]}
