"""The numbers of a leaderboard against values computed by hand, and the order of rank."""

from collections.abc import Sequence

import numpy as np
import pytest

from baselines.policy_spec import PolicySpec, ScenarioId
from leaderboard import page, table
from leaderboard import policies as leaderboard_policies
from leaderboard.columns import LIMITS, WORKSHOP
from leaderboard.ranking import Leaderboard, rank
from leaderboard.result import FamilySplit, Result, Task
from leaderboard.scoring import compare
from leaderboard.standings import Played, Standing, best_rule
from leaderboard.statistics import Estimate, Floats, Mean
from tests.leaderboard.conftest import ENV_ID, MakeResult, spec
from tests.turning_env.playing import changed
from turning_env import FAMILY_ID, SPLITS, Scenario


def standings_of(results: Sequence[Result]) -> dict[str, Standing]:
    """Return the standings by name, in the order of rank."""
    return {standing.name: standing for standing in rank(results)}


def leaderboard_of(results: Sequence[Result]) -> Leaderboard:
    return Leaderboard(
        task=results[0].task,
        results=list(results),
        standings=rank(results),
        trajectories=None,
        left_out=[],
    )


def value(estimate: Estimate | Mean | None) -> float:
    assert estimate is not None
    return estimate.value


def test_physical_columns_by_hand(make_result: MakeResult) -> None:
    # One edge worn out, one broken at a fifth of its life, two cut off half-way.
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
    # 35 min of cutting and moves, three edges of 2 min each, and a breakage of 10 min.
    minutes = 35.0 + 3 * 2.0 + 10.0
    assert standing.operation.removal_rate == pytest.approx(3500 / minutes)
    # An edge costs 3 min.
    assert value(standing.costs.cost) == pytest.approx((minutes + 3 * 3.0) / 3.5)
    assert standing.overload.overload_share == pytest.approx(0.1)
    assert standing.overload.severe_share == pytest.approx(0.02)
    assert standing.overload.excess == pytest.approx(0.004)
    assert standing.operation.broken_share == pytest.approx(1 / 3)
    assert standing.operation.used_life == pytest.approx(2.201 / 4)


def test_splits_are_ranked_by_full_cost(make_result: MakeResult, task: Task) -> None:
    def board(on: Task) -> Leaderboard:
        oracle = spec("known", kind="oracle")
        results = [
            make_result("ends_early", on=on, removed=100.0, returns=-10.0),
            make_result("cheap", on=on, removed=200.0, returns=-20.0),
            make_result("idle", on=on, removed=0.0, returns=-5.0),
            make_result(
                "greedy",
                on=on,
                removed=900.0,
                severe_overload_time=6.0,
                returns=100.0,
            ),
            make_result(
                "known",
                on=on,
                policy=oracle,
                removed=800.0,
                returns=200.0,
            ),
        ]
        return leaderboard_of(results)

    worn_lot = task.model_copy(update={"scenario": Scenario.load("worn_lot")})
    by_return = board(task)
    by_full_cost = board(worn_lot)
    names = [standing.name for standing in by_return.standings]
    assert names == ["idle", "ends_early", "cheap", "greedy", "known"]
    names = [standing.name for standing in by_full_cost.standings]
    assert names == ["cheap", "ends_early", "idle", "greedy", "known"]
    data = table.as_data([by_return, by_full_cost])
    ranked_by = [leaderboard["ranked_by"] for leaderboard in data["leaderboards"]]
    assert ranked_by == ["mean_return", "full_cost"]
    assert "ranked by full cost" in page.render([by_full_cost])


def test_what_was_tuned_for_a_split_or_has_not_played_the_base_does_not_count_across_splits(
    make_result: MakeResult,
) -> None:
    def board(preset: str, *policies: PolicySpec) -> Leaderboard:
        task = Task(env_id=ENV_ID, scenario=Scenario.load(preset), seeds=[1, 2, 3, 4])
        return leaderboard_of(
            [make_result(policy.name, policy=policy, on=task) for policy in policies]
        )

    base = ScenarioId.of(Scenario.load("rough_turning"))
    tuned_for_the_split = spec("rule")
    tuned_for_the_base = spec("rule", tuned_for=base)
    not_on_the_base = spec("new", tuned_for=base)
    across = table.across(
        [
            board("rough_turning", spec("rule")),
            board(SPLITS[0], tuned_for_the_base, not_on_the_base),
            board(SPLITS[1], tuned_for_the_split),
        ]
    )
    assert across is not None
    scenarios = {name: list(costs) for name, costs in across.rows.items()}
    assert scenarios == {"rule": ["rough_turning", SPLITS[0]]}


@pytest.fixture(scope="module")
def compared(make_result: MakeResult) -> dict[str, Standing]:
    """Two comparators, another rule, an agent of two training seeds, and one that is no better."""
    return standings_of(
        [
            make_result("fixed_tuned", returns=[0, 0, 0, 0]),
            make_result("grid_search", returns=[10, 20, 30, 40]),
            make_result("also_good", returns=[40, 30, 20, 10]),
            make_result("ppo", 0, returns=[101, 91, 81, 71]),
            make_result("ppo", 1, returns=[103, 93, 83, 73]),
            make_result("sac", 0, returns=[0, 0, 0, 0]),
        ]
    )


def test_policies_are_compared_with_the_best_other_rule(compared: dict[str, Standing]) -> None:
    best = {name: standing.leads.best_rule for name, standing in compared.items()}
    assert best == {
        "ppo": "also_good",
        "also_good": "grid_search",
        "grid_search": "also_good",
        "fixed_tuned": "also_good",
        "sac": "also_good",
    }


def test_a_rule_whose_feasibility_is_not_shown_is_no_best_rule(make_result: MakeResult) -> None:
    """12 s of four minutes are the 5 % that are allowed, but the confidence limit is above them."""
    standings = standings_of(
        [
            make_result("doubtful", severe_overload_time=[12.0, 0.0, 0.0, 0.0], returns=100.0),
            make_result("safe", returns=10.0),
        ]
    )
    assert standings["doubtful"].overload.feasibility == "not shown"
    best = best_rule(standings.values())
    assert best is not None
    assert best.name == "safe"


def test_returns_and_leads_by_hand(compared: dict[str, Standing]) -> None:
    ppo = compared["ppo"]
    assert ppo.about.training_seeds == (0, 1)
    assert value(ppo.mean_return) == pytest.approx(87)
    assert value(ppo.interquartile_return) == pytest.approx((91 + 83 + 93 + 81) / 4)
    assert value(ppo.leads.over_fixed) == pytest.approx(87)
    assert value(ppo.leads.over_published) == pytest.approx(62)
    assert compared["grid_search"].leads.over_published is None
    assert compared["fixed_tuned"].leads.over_fixed is None


def test_intervals_hold_the_chance_of_seeds_and_of_training(compared: dict[str, Standing]) -> None:
    # On every seed each training is ahead by the same: what is left is the chance of training.
    lead = compared["ppo"].leads.over_best_rule
    assert lead is not None
    assert (lead.low, lead.value, lead.high) == pytest.approx((61, 62, 63))

    behind = compared["fixed_tuned"].leads.over_best_rule
    assert behind is not None
    assert behind.value == pytest.approx(-25)
    assert -40 <= behind.low < behind.value < behind.high <= -10


def test_leads_are_shown_also_without_the_largest_differences(
    compared: dict[str, Standing],
) -> None:
    fixed = compared["fixed_tuned"]
    assert fixed.leads.median_over_best_rule == -25.0
    assert fixed.leads.over_best_rule_without_largest == -10.0
    assert fixed.leads.beats_best_rule == 0.0


def test_tracks_and_classes_rank_for_themselves(make_result: MakeResult) -> None:
    learned = spec("learned", seed=0, parameters={"training_information": ["rewards"]})
    taught = spec("taught", seed=0, parameters={"training_information": ["true states"]})
    oracle = spec("known", kind="oracle")
    standings = standings_of(
        [
            make_result(
                "greedy",
                severe_overload_time=6.0,
                removed=900.0,
                returns=100,
            ),
            make_result("taught", policy=taught, removed=200.0, returns=3),
            make_result("learned", policy=learned, removed=400.0, returns=2),
            make_result("plain", removed=300.0, returns=1),
            make_result("known", policy=oracle, removed=800.0, returns=200),
        ]
    )
    assert list(standings) == ["taught", "learned", "plain", "greedy", "known"]
    class_ranks = [standing.class_rank for standing in standings.values()]
    assert class_ranks == [1, 1, 1, 2, None]
    constraint_ranks = [standing.constraint_rank for standing in standings.values()]
    assert constraint_ranks == [3, 1, 2, None, None]
    for name, cheapest in [("taught", "learned"), ("learned", "plain"), ("greedy", "learned")]:
        gap = value(standings[name].costs.cost) - value(standings[cheapest].costs.cost)
        over = standings[name].costs.over_least_cost
        assert over is not None
        # All seeds are alike, so the interval has no width.
        assert (over.low, over.value, over.high) == pytest.approx((gap, gap, gap))


def test_agents_share_a_name_if_their_training_is_the_same_and_none_joins_one_that_ships(
    make_result: MakeResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(leaderboard_policies, "shipped_agents", lambda: {"a": "ppo", "b": "ppo"})
    plain = {"gamma": 0.9, "frames": 1}
    framed = {"gamma": 0.9, "frames": 4}
    policies = [
        spec("ppo", seed=0, parameters=plain, sha256="mine"),
        spec("ppo", seed=1, parameters=plain, sha256="a"),
        spec("ppo", seed=2, parameters=plain, sha256="b"),
        spec("ppo", seed=3, parameters=plain, sha256="mine too"),
        spec("ppo", seed=4, parameters=framed, sha256="another"),
    ]
    standings = standings_of([make_result("ppo", policy=policy) for policy in policies])
    training_seeds = {name: standing.about.training_seeds for name, standing in standings.items()}
    assert training_seeds == {"ppo": (1, 2), "ppo-seed0,3": (0, 3), "ppo-seed4": (4,)}
    own = {name for name, standing in standings.items() if standing.about.own}
    assert own == {"ppo-seed0,3", "ppo-seed4"}


def test_trainings_with_other_inputs_have_names_of_their_own(make_result: MakeResult) -> None:
    rewards = {"training_information": ["rewards"]}
    taught = {"training_information": ["rewards", "true states"]}
    policies = [
        spec("ppo", seed=0, parameters=rewards),
        spec("ppo", seed=1, parameters=rewards),
        spec("ppo", seed=2, parameters=taught),
    ]
    standings = standings_of([make_result("ppo", policy=policy) for policy in policies])
    classes = {
        standing.about.training_seeds: standing.about.policy_class
        for standing in standings.values()
    }
    assert classes == {(0, 1): "model-free agent", (2,): "privileged agent"}


def test_score_runs_from_fixed_parameters_to_the_causal_oracle(make_result: MakeResult) -> None:
    bound = spec("clairvoyant", kind="oracle")
    no_episodes = {"returns": 100.0, "time": 0.0, "engaged_time": 0.0}
    oracle = spec("causal", kind="oracle")
    standings = standings_of(
        [
            make_result("fixed_tuned", returns=-100.0),
            make_result("grid_search", returns=-40.0),
            make_result("good", returns=-10.0),
            make_result("clairvoyant", policy=bound, **no_episodes),
            make_result("causal", policy=oracle, returns=0.0),
        ]
    )
    assert list(standings)[-2:] == ["clairvoyant", "causal"]  # oracles are listed, not ranked
    assert value(standings["good"].score) == pytest.approx(90.0)
    assert value(standings["good"].leads.over_causal) == pytest.approx(-10.0)
    assert value(standings["clairvoyant"].score) == pytest.approx(200.0)
    assert value(standings["fixed_tuned"].score) == 0.0
    assert value(standings["causal"].score) == 100.0
    assert standings["good"].leads.best_rule == "grid_search"


@pytest.mark.parametrize("column", [*LIMITS, *WORKSHOP], ids=lambda column: column.key)
def test_a_bound_without_episodes_has_no_number_of_play(column, make_result: MakeResult) -> None:
    bound = spec("clairvoyant", kind="oracle")
    result = make_result(
        "clairvoyant",
        policy=bound,
        time=0.0,
        engaged_time=0.0,
    )
    (standing,) = rank([result])
    assert standing.operation.minutes == 0.0
    assert column.cell(standing).number is None


@pytest.fixture
def of_three_states(make_result: MakeResult) -> Leaderboard:
    """A policy that is feasible, one that is not shown to be, and one that is infeasible."""
    # 5.4 % on average, by a single seed.
    once = [0.0, 0.0, 0.0, 13.0]
    return leaderboard_of(
        [
            make_result("careful", severe_overload_time=1.0),
            make_result("unclear", severe_overload_time=once),
            make_result("reckless", severe_overload_time=[6.0, 7.0, 6.0, 8.0]),
        ]
    )


def test_feasibility_has_three_states_by_the_confidence_limits(
    of_three_states: Leaderboard,
) -> None:
    standings = {standing.name: standing for standing in of_three_states.standings}
    feasibility = {name: standing.overload.feasibility for name, standing in standings.items()}
    assert feasibility == {
        "careful": "feasible",
        "unclear": "not shown",
        "reckless": "infeasible",
    }
    assert [name for name, standing in standings.items() if standing.feasible] == ["careful"]
    for standing in standings.values():
        assert (
            standing.overload.severe_lower_limit
            <= standing.overload.severe_share
            <= standing.overload.severe_limit
        )


def test_tables_and_page_show_the_three_states(of_three_states: Leaderboard) -> None:
    printed = table.selection([of_three_states], ["mean_return"], policies=[])
    _, _, *rows = printed.splitlines()
    cells = [row.split("|")[2].strip() for row in rows]
    # In the order of rank: by feasibility, then by return, then by name.
    assert cells == ["yes", "NO", "not shown"]
    assert "feasibility not shown" in page.render([of_three_states])


def test_time_over_a_limit_is_shown_whole_if_the_results_hold_it(make_result: MakeResult) -> None:
    over = {"overload_2_percent_time": 12.0, "overload_10_percent_time": 3.0}  # of a minute
    results = [make_result("ppo", 0, **over), make_result("ppo", 1)]
    (standing,) = rank(results)
    assert standing.overload.share_above_2_percent == pytest.approx(0.1)
    assert standing.overload.share_above_10_percent == pytest.approx(0.025)

    older = results[1].model_copy(update={"excess": None})
    (standing,) = rank([results[0], older])
    assert standing.overload.share_above_2_percent is None
    assert standing.overload.share_above_10_percent is None


def test_the_best_other_rule_is_a_feasible_one(make_result: MakeResult) -> None:
    standings = standings_of(
        [
            make_result("reckless", severe_overload_time=30.0, returns=100.0),
            make_result("good", returns=20.0),
            make_result("poor", returns=10.0),
            make_result("ppo", 0, returns=30.0),
        ]
    )
    best = {name: standing.leads.best_rule for name, standing in standings.items()}
    assert best == {
        "ppo": "good",
        "poor": "good",
        "reckless": "good",
        "good": "poor",
    }
    # Of the best rule, the number is its lead over the next.
    assert value(standings["good"].leads.over_best_rule) == pytest.approx(10.0)


def test_agents_are_shown_without_a_rank_where_the_wear_rule_can_be_gamed(
    make_result: MakeResult, task: Task
) -> None:
    paper = task.model_copy(update={"scenario": Scenario.load("paper")})
    oracle = spec("known", kind="oracle")
    board = leaderboard_of(
        [
            make_result("gaming", 0, on=paper, returns=647.0),
            make_result("honest", on=paper, returns=76.0),
            make_result("poor", on=paper, returns=7.0),
            make_result("known", policy=oracle, on=paper, returns=80.0),
        ]
    )
    names = [standing.name for standing in board.standings]
    assert names == ["honest", "poor", "gaming", "known"]
    class_ranks = [standing.class_rank for standing in board.standings]
    assert class_ranks == [1, 2, None, None]
    ranked = [standing.name for standing in board.standings if standing.unranked is None]
    assert ranked == ["honest", "poor"]
    place, merit = table.agent_places(board, ["gaming-seed0"])
    assert "no rank" in place
    assert "wear rule" in place
    assert merit.startswith("feasible: severe overload in ")
    assert "not ranked: " in page.render([board])


def test_policies_with_the_same_returns_are_named(make_result: MakeResult) -> None:
    board = leaderboard_of(
        [
            make_result("copy", 0, returns=[1.0, 2.0, 3.0, 4.0]),
            make_result("first", returns=[1.0, 2.0, 3.0, 4.0]),
            make_result("other", returns=[1.0, 2.0, 3.0, 5.0]),
            # Training seeds of one agent that are alike.
            make_result("agent", 0, returns=7.0),
            make_result("agent", 1, returns=7.0),
        ]
    )
    same = "copy, first: same returns on all 4 seeds"
    assert table.same_returns(board, ["copy-seed0", "other", "agent-seed0"]) == [same]
    assert table.same_returns(board, ["other"]) == []
    assert table.render(board).splitlines()[-1] == same


def test_the_ranking_is_one_table_with_the_score(make_result: MakeResult) -> None:
    oracle = spec("causal", kind="oracle")
    board = leaderboard_of(
        [
            make_result("fixed_tuned", returns=0.0),
            make_result("mine", 0, returns=50.0),
            make_result("causal", policy=oracle, returns=100.0),
        ]
    )
    _, _, titles, _, *rows = table.ranking_table(board).splitlines()
    assert titles.split() == ["rank", "policy", "kind", "feasible", "return", "score"]
    cells = [row.split() for row in rows]
    assert cells[0][:6] == ["1", "mine", "(yours)", "agent", "yes", "50"]
    assert cells[1][:5] == ["2", "fixed_tuned", "rule", "yes", "0"]
    assert cells[2][:3] == ["causal", "oracle", "100"]


def test_agents_are_ranked_elsewhere(make_result: MakeResult) -> None:
    (standing,) = rank([make_result("learned", 0)])
    assert standing.unranked is None


def test_every_number_has_a_column_of_its_own(make_result: MakeResult) -> None:
    titles = [(column.heading, column.unit) for column in table.COLUMNS.values()]
    assert len(set(titles)) == len(titles)
    oracle = spec("causal", kind="oracle")
    board = leaderboard_of(
        [
            make_result("fixed_tuned", returns=0.0),
            make_result("rule", returns=1.0),
            make_result("causal", policy=oracle, returns=2.0),
        ]
    )
    fields = ["score", "over_causal", "mean_return"]
    head, *_ = table.selection([board], fields, policies=[]).splitlines()
    # Policy and feasibility stand before the numbers.
    assert len(head.strip("| ").split("|")) == 2 + len(fields)


@pytest.mark.parametrize(
    ("estimate", "decimals"),
    [
        (Estimate(0.28, 0.15, 0.41), 2),
        (Estimate(152.0, 133.0, 168.0), 0),
        (Estimate(5.4, 4.6, 6.1), 1),
        pytest.param(Estimate(1.0, 1.0, 1.0), 1, id="no interval"),
        pytest.param(Estimate(76.4, 76.4, 76.4), 0, id="no interval, large"),
        pytest.param(Estimate(0.0, 0.0, 0.0), 0, id="nothing"),
    ],
)
def test_decimals_follow_the_interval_or_without_one_the_value(
    estimate: Estimate, decimals: int
) -> None:
    assert estimate.decimals() == decimals


def test_decimals_are_those_of_the_unit_that_is_shown() -> None:
    assert Estimate(0.0028, 0.0015, 0.0041).decimals(factor=100.0) == 2


def test_a_rule_that_forgets_is_not_the_best_rule(make_result: MakeResult) -> None:
    standings = rank(
        [
            make_result("self_tuning", policy=spec("self_tuning", forgets=True), returns=20.0),
            make_result("predictive", returns=10.0),
        ]
    )
    best = best_rule(standings)
    assert best is not None
    assert best.name == "predictive"


def test_a_score_is_the_standing_on_the_leaderboard(make_result: MakeResult, task: Task) -> None:
    """Intervals, ranks and verdicts of ``leaderboard.score`` are those of ``leaderboard run``."""
    results = [
        make_result("fixed_tuned", returns=[-90.0, -120.0, -100.0, -80.0]),
        make_result("causal", policy=spec("causal", kind="oracle"), returns=[5.0, 0.0, -5.0, 9.0]),
        make_result(
            "mine", 0, returns=[-10.0, -40.0, -20.0, -5.0], severe_overload_time=[0, 0, 0, 4]
        ),
    ]
    fixed, oracle, mine = (
        {name: np.array(values) for name, values in result.episodes.items()} for result in results
    )
    others = [played("fixed_tuned", "rule", fixed), played("causal", "oracle", oracle)]
    scored = compare(ENV_ID, mine, task.scenario, others)
    (on_board,) = (standing for standing in rank(results) if standing.name == "mine")
    assert scored.mean_return == on_board.mean_return.estimate
    assert on_board.score is not None
    assert scored.score == on_board.score.estimate
    assert scored.rank == on_board.rank
    assert scored.overload.feasibility == on_board.overload.feasibility
    assert scored.overload.severe_limit == on_board.overload.severe_limit


def played(name: str, kind: str, episodes: dict[str, Floats]) -> Played:
    """Return the episodes of a policy with one training."""
    by_training = {field: values[np.newaxis] for field, values in episodes.items()}
    return Played(name=name, kind=kind, episodes=by_training)


def test_the_best_rule_is_a_feasible_one_and_the_first_by_name(make_result: MakeResult) -> None:
    standings = rank(
        [
            make_result("b", returns=5.0),
            make_result("a", returns=5.0),
            make_result("reckless", severe_overload_time=30.0, returns=9.0),
            make_result("ppo", 0, returns=99.0),
        ]
    )
    best = best_rule(standings)
    assert best is not None
    assert best.name == "a"
    infeasible = [standing for standing in standings if standing.name == "reckless"]
    assert best_rule(infeasible) == infeasible[0]
    assert best_rule([standing for standing in standings if standing.kind == "agent"]) is None


def only_standing(result: Result) -> Standing:
    (standing,) = rank([result])
    return standing


def test_costs_of_metal_by_hand(make_result: MakeResult) -> None:
    """v0: an edge costs 3 min, its change 2 min, a breakage 10 min."""
    result = make_result(
        "rule",
        time=[600, 300, 600, 300],
        removed=[1000, 500, 1000, 1500],
        edges_used=[1, 1, 0.5, 0.5],
        edges_broken=[0, 1, 0, 0],
        reward_overload=[-60, 0, -30, 0],
    )
    standing = only_standing(result)
    # 30 min at work, 3 edges of 5 min each, and a breakage, for 4 dm3.
    assert value(standing.costs.cost) == pytest.approx((30.0 + 15.0 + 10.0) / 4.0)
    assert value(standing.costs.full_cost) == pytest.approx((30.0 + 15.0 + 10.0 + 1.5) / 4.0)
    assert standing.operation.minutes == pytest.approx((30.0 + 6.0 + 10.0) / 4.0)
    assert standing.operation.edges == pytest.approx(0.75)
    assert standing.costs.part_cost is None
    assert standing.operation.roughness_deviation is None


def test_shares_of_short_times(make_result: MakeResult) -> None:
    """Half a second of cutting in all is a time to divide by."""
    standing = only_standing(
        make_result("rule", engaged_time=0.125, severe_overload_time=0.0625, time=0.125)
    )
    assert standing.overload.severe_share == pytest.approx(0.5)


def test_without_cutting_no_time_is_over_a_limit(make_result: MakeResult) -> None:
    standing = only_standing(make_result("idle", engaged_time=0.0, removed=0.0))
    assert standing.overload.severe_share == 0.0
    assert standing.overload.overload_share == 0.0
    assert standing.overload.share_above_2_percent == 0.0
    assert standing.overload.share_above_10_percent == 0.0
    assert standing.costs.cost is None
    assert standing.costs.full_cost is None


def test_small_leads_count_as_wins(make_result: MakeResult) -> None:
    standings = standings_of(
        [
            make_result("rule", returns=[1.0, 1.0, 1.0, 1.0]),
            make_result("ppo", 0, returns=[1.5, 1.0, 1.25, 0.0]),
        ]
    )
    assert standings["ppo"].leads.beats_best_rule == 0.5
    assert standings["ppo"].leads.median_over_best_rule == 0.125
    # Without the three largest, of which the first is that of the last seed.
    assert standings["ppo"].leads.over_best_rule_without_largest == 0.0


def test_parts_and_roughness_have_numbers_of_their_own(make_result: MakeResult, task: Task) -> None:
    def on(preset: str) -> Task:
        return task.model_copy(update={"scenario": Scenario.load(preset)})

    part = only_standing(
        make_result(
            "rule",
            on=on("batch_casting"),
            time=[600.0, 600.0, 600.0, 900.0],
            steps=[8.0, 8.0, 8.0, 4.0],
            edges_used=0.5,
            removed=500.0,
        )
    )
    economics = Scenario.load("batch_casting").economics
    # 45 min at work and 2 edges, for 28 parts.
    assert part.costs.part_cost == pytest.approx((45.0 + 2.0 * economics.edge_cost) / 28.0)
    assert part.operation.roughness_deviation is None
    surface = only_standing(
        make_result(
            "rule",
            on=on("surface"),
            time=[50.0, 50.0, 50.0, 150.0],
            roughness_deviation=[20.0, 20.0, 20.0, 0.0],
        )
    )
    assert surface.operation.roughness_deviation == pytest.approx(60.0 / 300.0)
    assert surface.costs.part_cost is None
    # A roughness that is held earns nothing for metal.
    assert surface.costs.full_cost is None
    assert surface.costs.cost is not None


@pytest.fixture
def family_task(task: Task) -> Task:
    identity = ScenarioId(name="shop", digest="0" * 64)
    split = FamilySplit(family=identity, split="unseen_jobs")
    return task.model_copy(update={"env_id": FAMILY_ID, "of_family": split})


def test_the_allowance_decides_and_not_the_tolerance(
    make_result: MakeResult, task: Task, family_task: Task
) -> None:
    """Cutting is in severe overload for 7 % of the time, of which 10 % are allowed.

    The tolerance, beyond which an overload is severe, is 5 %.
    """
    allowing = []
    for on in (task, family_task):
        scenario = changed(on.scenario, limits={"overload_allowance": 0.1})
        assert scenario.limits.overload_tolerance == 0.05
        allowing.append(on.model_copy(update={"scenario": scenario}))
    severe = {"engaged_time": 100.0, "severe_overload_time": 7.0}
    assert only_standing(make_result("rule", on=allowing[0], **severe)).feasible
    assert not only_standing(make_result("rule", **severe)).feasible
    jobs = only_standing(make_result("rule", on=allowing[1], **severe))
    assert jobs.feasible
    assert jobs.operation.feasible_jobs == 1.0


def test_jobs_of_families_by_hand(make_result: MakeResult, family_task: Task) -> None:
    allowance = family_task.scenario.limits.overload_allowance
    told = spec("told", knows="true_laws")
    standings = standings_of(
        [
            make_result(
                "rule",
                on=family_task,
                returns=[10.0, -20.0, 30.0, 40.0],
                reward_metal=[100.0, 100.0, 100.0, 300.0],
                engaged_time=100.0,
                severe_overload_time=[0.0, 100.0 * allowance, 100.0 * allowance + 1.0, 0.0],
            ),
            make_result("told", policy=told, on=family_task, returns=50.0, reward_metal=100.0),
        ]
    )
    rule = standings["rule"]
    # Of metal worth 600 s, 60 s are left.
    assert value(rule.costs.full_cost_share) == pytest.approx(0.9)
    assert rule.costs.full_cost_share is not None
    assert rule.costs.full_cost_share.low < 0.9 < rule.costs.full_cost_share.high
    assert rule.operation.worst_return == -20.0
    assert rule.operation.feasible_jobs == 0.75
    (other,) = [name for name in standings if name != "rule"]
    assert value(rule.leads.over_truth) == pytest.approx(15.0 - 50.0)
    assert standings[other].leads.over_truth is None
    assert rule.costs.cost is None
    assert rule.operation.minutes is None


def test_the_best_rule_with_true_laws_has_no_lead_over_truth(
    make_result: MakeResult, family_task: Task
) -> None:
    best = spec("best", knows="true_laws")
    second = spec("second", knows="true_laws")
    standings = rank(
        [
            make_result("best", policy=best, on=family_task, returns=50.0, reward_metal=100.0),
            make_result("second", policy=second, on=family_task, returns=20.0, reward_metal=100.0),
        ]
    )
    first, other = standings
    assert first.leads.over_truth is None
    assert value(other.leads.over_truth) == pytest.approx(-30.0)


def test_policies_of_equal_cost_keep_the_order_of_rank(make_result: MakeResult) -> None:
    standings = standings_of(
        [
            make_result("a", removed=300.0, returns=1.0),
            make_result("b", removed=300.0, returns=2.0),
        ]
    )
    places = {name: standing.constraint_rank for name, standing in standings.items()}
    assert places == {"b": 1, "a": 2}


@pytest.mark.parametrize(("worth", "share"), [(0.5, 3.0), (0.0, None)])
def test_jobs_without_metal_have_no_share_of_its_worth(
    worth: float, share: float | None, make_result: MakeResult, family_task: Task
) -> None:
    standing = only_standing(make_result("rule", on=family_task, returns=-1.0, reward_metal=worth))
    if share is None:
        assert standing.costs.full_cost_share is None
    else:
        assert value(standing.costs.full_cost_share) == pytest.approx(share)
