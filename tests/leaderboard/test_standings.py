"""The numbers of a leaderboard against hand-computed values, and the order of rank."""

import pytest

from leaderboard import page, table
from leaderboard import policies as leaderboard_policies
from leaderboard.columns import LIMITS, WORKSHOP
from leaderboard.ranking import Leaderboard
from leaderboard.result import Result, Task
from leaderboard.standings import rank
from tests.leaderboard.conftest import ENV_ID, MakeResult, spec
from turning_env import SPLITS, Scenario
from turning_env.scoring.policy import PolicySpec, ScenarioId
from turning_env.scoring.statistics import Estimate


def value(estimate: Estimate | None) -> float:
    assert estimate is not None
    return estimate.value


def ends(estimate: Estimate | None) -> tuple[float, float, float]:
    assert estimate is not None
    return estimate.low, estimate.value, estimate.high


def test_physical_columns_by_hand(make_result: MakeResult) -> None:
    # One edge worn out, one broken at a fifth of its life, two cut off half-way: 1 + 1 + 0.5 + 0.5 edges.
    result = make_result(
        "rule",
        time=[600, 300, 600, 600],
        engaged_time=[500, 250, 500, 500],
        removed=[1000, 500, 1000, 1000],
        overload_time=[100, 0, 0, 75],
        severe_overload_time=[35, 0, 0, 0],
        excess=[7, 0, 0, 0],
        used_life=[1.001, 0.2, 0.5, 0.5],
        edges_used=[1, 1, 0.5, 0.5],
        edges_broken=[0, 1, 0, 0],
    )
    (standing,) = rank([result])
    minutes = 35.0 + 3 * 2.0 + 10.0
    assert standing.removal_rate == pytest.approx(3500 / minutes)
    assert value(standing.cost) == pytest.approx((minutes + 3 * 3.0) / 3.5)
    shares = (
        standing.overload_share,
        standing.severe_share,
        standing.excess,
        standing.broken_share,
        standing.used_life,
    )
    assert shares == pytest.approx((0.1, 0.02, 0.004, 1 / 3, 2.201 / 4))


def test_splits_are_ranked_by_full_cost(make_result: MakeResult, task: Task) -> None:
    def results(on: Task) -> list[Result]:
        return [
            make_result("ends_early", on=on, removed=100.0, **{"return": -10.0}),
            make_result("cheap", on=on, removed=200.0, **{"return": -20.0}),
            make_result("idle", on=on, removed=0.0, **{"return": -5.0}),
            make_result(
                "greedy", on=on, removed=900.0, severe_overload_time=6.0, **{"return": 100.0}
            ),
            make_result(
                "known",
                on=on,
                policy=spec("known", kind="oracle"),
                removed=800.0,
                **{"return": 200.0},
            ),
        ]

    worn = task.model_copy(update={"scenario": Scenario.load("worn_lot")})
    boards = {
        on.scenario.name: Leaderboard(on, results(on), rank(results(on)), None, [])
        for on in (task, worn)
    }
    by_return, by_full_cost = boards.values()
    assert [each.name for each in by_return.standings] == [
        "idle",
        "ends_early",
        "cheap",
        "greedy",
        "known",
    ]
    assert [each.name for each in by_full_cost.standings] == [
        "cheap",
        "ends_early",
        "idle",
        "greedy",
        "known",
    ]
    assert [each["ranked_by"] for each in table.as_data([*boards.values()])["leaderboards"]] == [
        "mean_return",
        "full_cost",
    ]
    assert "ranked by full cost" in page.render([by_full_cost])


def test_what_was_tuned_for_a_split_or_has_not_played_the_base_does_not_count_across_splits(
    make_result: MakeResult,
) -> None:
    def board(preset: str, *policies: PolicySpec) -> Leaderboard:
        task = Task(env_id=ENV_ID, scenario=Scenario.load(preset), seeds=[1, 2, 3, 4])
        results = [make_result(policy.name, policy=policy, on=task) for policy in policies]
        return Leaderboard(task, results, rank(results), None, [])

    base = ScenarioId.of(Scenario.load("rough_turning"))
    here, elsewhere, new = spec("rule"), spec("rule", tuned_for=base), spec("new", tuned_for=base)
    found = table.across(
        [board("rough_turning", here), board(SPLITS[0], elsewhere, new), board(SPLITS[1], here)]
    )
    assert found is not None
    assert {name: list(cells) for name, cells in found.rows.items()} == {
        "rule": ["rough_turning", SPLITS[0]]
    }


def test_comparisons_by_hand(make_result: MakeResult) -> None:
    results = [
        make_result("fixed_tuned", **{"return": [0, 0, 0, 0]}),
        make_result("grid_search", **{"return": [10, 20, 30, 40]}),
        make_result("also_good", **{"return": [40, 30, 20, 10]}),
        make_result("ppo", 0, **{"return": [101, 91, 81, 71]}),
        make_result("ppo", 1, **{"return": [103, 93, 83, 73]}),
        make_result("sac", 0, **{"return": [0, 0, 0, 0]}),
    ]
    standings = {standing.name: standing for standing in rank(results)}
    best = {name: "also_good" for name in ("ppo", "grid_search", "fixed_tuned", "sac")} | {
        "also_good": "grid_search"
    }
    assert {name: standing.best_rule for name, standing in standings.items()} == best
    first, published, fixed = (standings[name] for name in ("ppo", "grid_search", "fixed_tuned"))
    assert first.training_seeds == (0, 1)
    found = first.mean_return, first.interquartile_return, first.over_fixed, first.over_published
    assert [value(each) for each in found] == pytest.approx([87, (91 + 83 + 93 + 81) / 4, 87, 62])
    # On every seed each training is ahead by one and the same: what is left is the chance of training.
    assert ends(first.over_best_rule) == pytest.approx((61, 62, 63))
    assert (published.over_published, fixed.over_fixed) == (None, None)
    low, over, high = ends(fixed.over_best_rule)
    assert over == pytest.approx(-25)
    assert -40 <= low < over < high <= -10
    assert (
        fixed.median_over_best_rule,
        fixed.over_best_rule_without_largest,
        fixed.beats_best_rule,
    ) == (-25.0, -10.0, 0.0)


def test_tracks_and_classes_rank_for_themselves(make_result: MakeResult) -> None:
    learned = spec("learned", seed=0, command="python -m train.ppo --seed 0")
    taught = spec("taught", seed=0, command="python -m train.analytic_gradient --seed 0")
    results = [
        make_result("greedy", severe_overload_time=6.0, removed=900.0, **{"return": 100}),
        make_result("taught", policy=taught, removed=200.0, **{"return": 3}),
        make_result("learned", policy=learned, removed=400.0, **{"return": 2}),
        make_result("plain", removed=300.0, **{"return": 1}),
        make_result("known", policy=spec("known", kind="oracle"), removed=800.0, **{"return": 200}),
    ]
    standings = rank(results)
    assert [standing.name for standing in standings] == [
        "taught",
        "learned",
        "plain",
        "greedy",
        "known",
    ]
    assert [standing.class_rank for standing in standings] == [1, 1, 1, 2, None]
    assert [standing.constraint_rank for standing in standings] == [3, 1, 2, None, None]
    known = {standing.name: standing for standing in standings}
    for name, cheapest in {"taught": "learned", "learned": "plain", "greedy": "learned"}.items():
        gap = value(known[name].cost) - value(known[cheapest].cost)
        assert ends(known[name].over_least_cost) == pytest.approx((gap,) * 3)  # all seeds are alike


def test_agents_are_one_if_their_training_is_and_none_joins_one_that_ships(
    make_result: MakeResult, monkeypatch
) -> None:
    monkeypatch.setattr(leaderboard_policies, "shipped_agents", lambda: {"a": "ppo", "b": "ppo"})
    short, plain, framed = {"gamma": 0.9}, {"gamma": 0.9, "frames": 1}, {"gamma": 0.9, "frames": 4}
    trained = ("mine", short), ("a", short), ("b", plain), ("mine too", plain), ("another", framed)
    policies = [
        spec("ppo", seed=seed, parameters=settings, sha256=file)
        for seed, (file, settings) in enumerate(trained)
    ]
    standings = {
        each.name: each for each in rank([make_result("ppo", policy=policy) for policy in policies])
    }
    assert {name: (each.training_seeds, each.own) for name, each in standings.items()} == {
        "ppo": ((1, 2), False),
        "ppo-seed0,3": ((0, 3), True),
        "ppo-seed4": ((4,), True),
    }


def test_score_runs_from_fixed_parameters_to_the_causal_oracle(make_result: MakeResult) -> None:
    returns = {"fixed_tuned": -100.0, "grid_search": -40.0, "good": -10.0}
    bound, oracle = (spec(name, kind="oracle") for name in ("clairvoyant", "causal"))
    results = [make_result(name, **{"return": each}) for name, each in returns.items()]
    results.append(
        make_result(
            "clairvoyant", policy=bound, **{"return": 100.0, "time": 0.0, "engaged_time": 0.0}
        )
    )
    results.append(make_result("causal", policy=oracle, **{"return": 0.0}))
    standings = {standing.name: standing for standing in rank(results)}
    assert list(standings)[-2:] == ["clairvoyant", "causal"]  # oracles are listed, not ranked
    good, known = standings["good"], standings["clairvoyant"]
    assert [value(each) for each in (good.score, known.score, good.over_causal)] == pytest.approx(
        [0.9, 2.0, -10.0]
    )
    assert standings["fixed_tuned"].score is standings["causal"].score is None
    assert good.best_rule == "grid_search"
    assert known.minutes == 0.0
    assert all(column.cell(known).number is None for column in (*LIMITS, *WORKSHOP))


def test_feasibility_has_three_states_by_the_confidence_limits(make_result: MakeResult) -> None:
    results = [
        make_result("careful", severe_overload_time=1.0),
        make_result(
            "unclear", severe_overload_time=[0.0, 0.0, 0.0, 13.0]
        ),  # 5.4 % on average, by a single seed
        make_result("reckless", severe_overload_time=[6.0, 7.0, 6.0, 8.0]),
    ]
    standings = {each.name: each for each in rank(results)}
    found = {name: each.feasibility for name, each in standings.items()}
    assert found == {"careful": "feasible", "unclear": "not shown", "reckless": "infeasible"}
    assert [each.feasible for each in standings.values()] == [True, False, False]
    for each in standings.values():
        assert each.severe_lower_limit <= each.severe_share <= each.severe_limit
    board = Leaderboard(results[0].task, results, list(standings.values()), None, [])
    cells = [
        line.split("|")[2].strip()
        for line in table.selection([board], ["mean_return"], []).splitlines()[2:]
    ]
    assert cells == ["yes", "NO", "not shown"]  # in the order of rank, by return and name
    assert "feasibility not shown" in page.render([board])


def test_time_over_a_limit_is_shown_whole_if_the_results_hold_it(make_result: MakeResult) -> None:
    shares = {"overload_2_percent_time": 12.0, "overload_10_percent_time": 3.0}  # of a minute
    trained = [make_result("ppo", 0, **shares), make_result("ppo", 1)]
    (standing,) = rank(trained)
    assert (standing.share_above_2_percent, standing.share_above_10_percent) == pytest.approx(
        (0.1, 0.025)
    )
    older = [trained[0], trained[1].model_copy(update={"excess": None, "checksum": "other"})]
    (standing,) = rank(older)
    assert standing.share_above_2_percent is standing.share_above_10_percent is None


def test_the_best_other_rule_is_a_feasible_one(make_result: MakeResult) -> None:
    results = [
        make_result("reckless", severe_overload_time=30.0, **{"return": 100.0}),
        make_result("good", **{"return": 20.0}),
        make_result("poor", **{"return": 10.0}),
        make_result("ppo", 0, **{"return": 30.0}),
    ]
    standings = {each.name: each for each in rank(results)}
    assert {name: each.best_rule for name, each in standings.items()} == {
        "ppo": "good",
        "poor": "good",
        "reckless": "good",
        "good": "poor",
    }
    assert value(standings["good"].over_best_rule) == pytest.approx(10.0)  # its lead over the next


def test_agents_are_shown_without_a_rank_where_the_wear_rule_can_be_gamed(
    make_result: MakeResult, task: Task
) -> None:
    paper = task.model_copy(update={"scenario": Scenario.load("paper")})
    results = [
        make_result("gaming", 0, on=paper, **{"return": 647.0}),
        make_result("honest", on=paper, **{"return": 76.0}),
        make_result("poor", on=paper, **{"return": 7.0}),
        make_result("known", policy=spec("known", kind="oracle"), on=paper, **{"return": 80.0}),
    ]
    standings = rank(results)
    assert [each.name for each in standings] == ["honest", "poor", "gaming", "known"]
    assert [each.class_rank for each in standings] == [1, 2, None, None]
    assert [each.unranked is None for each in standings] == [True, True, False, False]
    board = Leaderboard(paper, results, standings, None, [])
    (line,) = table.agent_places(board, ["gaming-seed0"])
    assert "no rank" in line
    assert "wear rule" in line
    assert "not ranked: " in page.render([board])
    assert all(
        each.unranked is None for each in rank([make_result("learned", 0)])
    )  # elsewhere agents are ranked


def test_every_number_has_a_column_of_its_own(make_result: MakeResult) -> None:
    titles = [(column.heading, column.unit) for column in table.COLUMNS.values()]
    assert len(set(titles)) == len(titles)
    results = [
        make_result(name, **{"return": value})
        for name, value in (("fixed_tuned", 0.0), ("rule", 1.0))
    ]
    results.append(make_result("causal", policy=spec("causal", kind="oracle"), **{"return": 2.0}))
    board = Leaderboard(results[0].task, results, rank(results), None, [])
    head, *_ = table.selection([board], ["score", "job_score", "mean_return"], []).splitlines()
    assert len(head.split("|")) == 2 + 2 + 3


def test_decimals_follow_the_interval_or_without_one_the_value() -> None:
    cases = [
        (0.28, 0.15, 0.41),
        (152.0, 133.0, 168.0),
        (1.0, 1.0, 1.0),
        (76.4, 76.4, 76.4),
        (0.0, 0.0, 0.0),
        (5.4, 4.6, 6.1),
    ]
    assert [Estimate(*case).decimals() for case in cases] == [2, 0, 1, 0, 0, 1]
    assert Estimate(0.0028, 0.0015, 0.0041).decimals(factor=100.0) == 2
