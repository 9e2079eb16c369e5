"""Families as tasks: policies are built for each job, ranked, verified and described as on other leaderboards."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomli_w

from leaderboard.__main__ import main
from leaderboard.family import CAUSAL, NOMINAL_OPTIMUM, Forgetful, family_task
from leaderboard.policies import one_named
from leaderboard.result import PACK_FILE, Result, ResultError, read_results, result_folder
from leaderboard.standings import Standing, rank
from tests.train import onnx_agents
from tests.turning_env.test_family_env import BRIEF
from turning_env import FAMILY_ID, Family
from turning_env.physics.quantities import OBS
from turning_env.scoring.policy import PolicySpec

FAMILY = Family.load(BRIEF)
JOBS = 16
SPLITS = ("unseen_jobs", "unseen_machines", "unseen_materials")
TASK = family_task(FAMILY, None, JOBS)


def ranked(**returns: Any) -> dict[str, Standing]:
    """Rank made-up policies, given by their returns; metal is worth 400 s."""
    results = []
    for title, values in returns.items():
        name, _, knows = title.partition("__")
        kind = (
            "agent" if name.startswith("agent") else "oracle" if knows or name == CAUSAL else "rule"
        )
        for seed, row in enumerate(np.broadcast_to(values, (2 if kind == "agent" else 1, JOBS))):
            policy = PolicySpec(
                name=name,
                kind=kind,
                knows=knows or "nominal",
                training_seed=seed if kind == "agent" else None,
            )
            severe = (
                np.where(np.arange(JOBS) < JOBS // 4, 90.0, 0.0)
                if name == "reckless"
                else np.zeros(JOBS)
            )
            episodes = {
                "return": row,
                "reward_metal": np.full(JOBS, 400.0),
                "steps": np.full(JOBS, 60.0),
            }
            episodes |= {
                "engaged_time": np.full(JOBS, 100.0),
                "severe_overload_time": severe,
                "overload_time": 1.1 * severe,
            }
            results.append(Result.of(TASK, policy, episodes))
    return {each.name: each for each in rank(results)}


def test_jobs_are_compared_pairwise() -> None:
    base = np.linspace(-100.0, 100.0, JOBS)
    found = ranked(
        bad=base - 50.0,
        rule=base,
        rule__true_laws=base + 10.0,
        agent=base + np.where(np.arange(JOBS) < 4, -1.0, 7.0),
    )
    agent, rule = found["agent"], found["rule"]
    assert agent.best_rule == "rule"
    assert agent.over_best_rule is not None
    assert agent.over_best_rule.value == pytest.approx(5.0)
    assert agent.over_best_rule.low < 5.0 < agent.over_best_rule.high
    assert (agent.median_over_best_rule, agent.beats_best_rule) == pytest.approx((7.0, 0.75))
    assert agent.worst_return == pytest.approx(-101.0)
    assert agent.over_best_rule_without_largest == pytest.approx((12 * 7.0 - 3 * 7.0 - 4.0) / 13)
    assert agent.over_truth is not None
    assert agent.over_truth.value == pytest.approx(-5.0)
    assert (agent.policy_class, agent.training_seeds, agent.feasible_jobs) == (
        "other agent",
        (0, 1),
        1.0,
    )
    assert agent.full_cost_share is not None
    assert agent.full_cost_share.value == pytest.approx(395.0 / 400.0)
    assert (rule.best_rule, found["rule with true laws"].over_truth) == ("bad", None)
    assert list(found) == [
        "agent",
        "rule",
        "bad",
        "rule with true laws",
    ]  # told more than others, it is not ranked


def test_scores_lie_between_the_nominal_optimum_and_the_oracle_of_each_job() -> None:
    base, gap = np.linspace(-1000.0, 0.0, JOBS), np.linspace(10.0, 500.0, JOBS)
    rows = {NOMINAL_OPTIMUM: base, CAUSAL: base + gap, "reckless": base + 0.5 * gap}
    found = ranked(**rows)
    assert [found[name].job_score.value for name in rows] == pytest.approx([0.0, 1.0, 0.5])  # type: ignore[union-attr]
    assert (found["reckless"].feasible, found["reckless"].feasible_jobs) == (False, 0.75)
    assert found["reckless"].overload_share == pytest.approx(1.1 * found["reckless"].severe_share)
    del rows[CAUSAL]
    assert all(each.job_score is None for each in ranked(**rows).values())


def test_a_forgetful_policy_is_reset_where_the_edge_is_fresh() -> None:
    masks: list[Any] = []
    forgetful = Forgetful(
        SimpleNamespace(reset=masks.append, act=lambda observations: np.zeros((2, 3), np.float32))
    )
    for wear in ((0.0, 0.0), (0.2, 0.1), (0.3, 0.0), (0.4, 0.1)):
        observations = np.zeros((2, 11), np.float32)
        observations[:, OBS.nominal_wear] = wear
        forgetful.act(observations)
    assert np.sum(masks, axis=0).tolist() == [0, 1]


def test_a_job_does_not_depend_on_those_that_are_played_with_it() -> None:
    task = family_task(FAMILY, "unseen_jobs", 70)
    policy = one_named("idle", task)
    ended: list[int] = []
    episodes = policy.compute(task.scenario, task.seeds, ended.append)  # type: ignore[misc]
    some = [3, 41, 69]
    alone = policy.compute(task.scenario, some, lambda ended: None)  # type: ignore[misc]
    assert len(set(episodes["steps"])) > 3
    for name, values in alone.items():
        np.testing.assert_array_equal(episodes[name][some], values)
    assert ended == sorted(ended)
    assert ended[-1] == 70


def test_variants_are_of_controllers_and_jobs_are_counted() -> None:
    assert one_named("rescaled_grid_search", TASK, None, "true_laws").kind == "oracle"
    for wrong in (
        lambda: one_named(CAUSAL, TASK, None, "true_laws"),
        lambda: family_task(FAMILY, None, 10_000),
    ):
        with pytest.raises(ResultError, match=r"no variants|jobs"):
            wrong()
    with pytest.raises(ResultError, match="no split 'nothing'; it has train"):
        family_task(FAMILY, "nothing", 1)


def test_a_family_with_forms_has_parameters_and_a_variant_of_its_own() -> None:
    shop, unmodelled = (family_task(name, "validation", 1) for name in ("shop", "unmodelled"))
    private = family_task(
        Family.load("unmodelled").model_copy(update={"held_out_key": "of an organiser"}),
        "validation",
        1,
    )
    usual, own, again = (
        one_named("self_tuning", task).parameters for task in (shop, unmodelled, private)
    )
    assert own.keys() - usual.keys() == {"top_speed", "change_at"}
    assert again == own
    assert (
        one_named("self_tuning", unmodelled, None, "true_forms").title
        == "self_tuning with true forms"
    )


@pytest.mark.slow
def test_a_family_of_ones_own_is_played_ranked_and_packed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "brief.toml").write_text(tomli_w.dumps(BRIEF))
    paths = [
        str(onnx_agents.write_of_family(tmp_path / "agents" / FAMILY_ID / "brief", FAMILY, seed))
        for seed in (0, 1)
    ]
    results = ["--results", str(tmp_path / "results")]
    theirs = ["--agents", *paths, "--keep-names", "--jobs", "2"]
    run = [
        "run",
        "--env",
        FAMILY_ID,
        "--scenario",
        str(tmp_path / "brief.toml"),
        "--seeds",
        "3",
        "--splits",
        *results,
    ]
    assert main([*run, "--policies", NOMINAL_OPTIMUM, CAUSAL, "rescaled_grid_search", *theirs]) == 0
    printed = capsys.readouterr().out
    assert main([*run, "--policies", "rescaled_grid_search", "--forgets"]) == 0
    assert "rescaled_grid_search without memory between edges" in capsys.readouterr().out
    folders = [result_folder(tmp_path / "results", FAMILY_ID, f"brief-{split}") for split in SPLITS]
    before = [read_results(folder) for folder in folders]
    assert main(["pack", *results]) == 0
    assert [read_results(folder) for folder in folders] == before
    assert {path.name for path in folders[0].iterdir()} == {PACK_FILE, "manifest.json"}
    capsys.readouterr()
    assert main(["show", *results, "--env", FAMILY_ID, "--all", "--json"]) == 0
    boards = json.loads(capsys.readouterr().out)["leaderboards"]
    assert [board["scenario"] for board in boards] == [f"brief-{split}" for split in SPLITS]
    assert all(
        each["name"] in printed for each in boards[0]["standings"] if "without" not in each["name"]
    )
    assert main(["pack", *results, "--without", "mine"]) == 0
    assert "mine" not in {each.policy.name for each in read_results(folders[0]).values()}
    assert main(["verify", *results, "--check", "--agents", str(tmp_path)]) == 1
    assert (
        "cannot be played again: no family and no file is called 'brief'" in capsys.readouterr().out
    )


def test_private_jobs_are_others_and_no_result_tells_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key, returns = "a key of the organiser", []
    for name, more in (("public", []), ("private", ["--private-key", key])):
        results = tmp_path / name
        words = [
            "run",
            "--env",
            FAMILY_ID,
            "--results",
            str(results),
            "--policies",
            "idle",
            "--seeds",
            "2",
            *more,
        ]
        assert main(words) == 0
        result = read_results(result_folder(results, FAMILY_ID, "shop-unseen_jobs"))["idle"]
        assert (result.task.private is None) == (not more)
        returns.append(result.episodes["return"])
        assert key not in "".join(path.read_text("latin-1") for path in results.rglob("*.*"))
    assert not set(returns[0]) & set(returns[1])
