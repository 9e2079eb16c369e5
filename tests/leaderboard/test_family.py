"""Families as tasks: policies are built for each job, ranked and verified as on other tasks."""

import contextlib
import io
import json
import pickle
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cloudpickle
import numpy as np
import pytest
import tomli_w

from baselines.comparators import CAUSAL, NOMINAL_OPTIMUM, NOMINAL_SHARE
from baselines.policy_spec import PolicySpec
from leaderboard.__main__ import main
from leaderboard.family import KNOWN_FORMS, FamilyPlay, family_task
from leaderboard.pieces import Piece, attempt
from leaderboard.policies import named, one_named
from leaderboard.ranking import rank
from leaderboard.result import (
    MANIFEST_FILE,
    PACK_FILE,
    TRAJECTORIES_FILE,
    Result,
    ResultError,
    read_part,
    read_results,
    result_folder,
)
from leaderboard.standings import Standing
from leaderboard.statistics import Estimate, Floats
from leaderboard.trajectories import Trajectories
from tests.leaderboard.agents import onnx_agents
from tests.leaderboard.conftest import play_all
from tests.turning_env.test_family_env import BRIEF, BRIEF_FAMILY
from turning_env import FAMILY_ID
from turning_env.scenario.sections import EdgeFailure

JOBS = 16
SPLITS = ("unseen_jobs", "unseen_machines", "unseen_materials")
TASK = family_task(BRIEF_FAMILY, None, JOBS)


WORTH = 400.0  # of the metal of each job [s]
RULE = PolicySpec(name="rule")
WITH_TRUE_LAWS = PolicySpec(name="rule", kind="oracle", knows="true_laws")
LEARNED = [PolicySpec(name="agent", kind="agent", training_seed=seed) for seed in (0, 1)]
LOWEST = PolicySpec(name=NOMINAL_SHARE)
ORACLE = PolicySpec(name=CAUSAL, kind="oracle")


def played(
    policy: PolicySpec,
    returns: Floats,
    severe_time: Floats | float = 0.0,
    worth: Floats | float = WORTH,
) -> Result:
    """Return a made-up result of a policy, given its returns, shape (JOBS,)."""
    severe_overload_time = np.broadcast_to(np.asarray(severe_time), JOBS)
    episodes = {
        "return": returns,
        "reward_metal": np.broadcast_to(np.asarray(worth), JOBS),
        "steps": np.full(JOBS, 60.0),
        "engaged_time": np.full(JOBS, 100.0),
        "severe_overload_time": severe_overload_time,
        "overload_time": 1.1 * severe_overload_time,
    }
    return Result.of(TASK, policy, episodes)


def standings_of(results: Sequence[Result]) -> dict[str, Standing]:
    """Return the standings by name, in the order of rank."""
    return {standing.name: standing for standing in rank(results)}


def value(estimate: Estimate | None) -> float:
    assert estimate is not None
    return estimate.value


@pytest.fixture(scope="module")
def compared() -> dict[str, Standing]:
    """An agent that loses 1 s on four jobs and gains 7 s on the other twelve over a rule."""
    base = np.linspace(-100.0, 100.0, JOBS)
    with_lead = base + np.where(np.arange(JOBS) < 4, -1.0, 7.0)
    results = [
        played(PolicySpec(name="bad"), base - 50.0),
        played(RULE, base),
        played(WITH_TRUE_LAWS, base + 10.0),
        *(played(policy, with_lead) for policy in LEARNED),
    ]
    return standings_of(results)


def test_policies_that_know_more_than_others_are_not_ranked(compared: dict[str, Standing]) -> None:
    assert list(compared) == ["agent", "rule", "bad", "rule with true laws"]
    assert compared["rule"].leads.best_rule == "bad"
    assert compared["rule with true laws"].leads.over_truth is None


def test_jobs_are_compared_pairwise(compared: dict[str, Standing]) -> None:
    agent = compared["agent"]
    assert agent.leads.best_rule == "rule"
    assert agent.leads.over_best_rule is not None
    assert agent.leads.over_best_rule.value == pytest.approx(5.0)
    assert agent.leads.over_best_rule.low < 5.0 < agent.leads.over_best_rule.high
    assert agent.leads.median_over_best_rule == pytest.approx(7.0)
    assert agent.leads.beats_best_rule == pytest.approx(0.75)
    # Three of the twelve leads of 7 s are left out.
    total = 9 * 7.0 - 4 * 1.0
    assert agent.leads.over_best_rule_without_largest == pytest.approx(total / 13)
    assert value(agent.leads.over_truth) == pytest.approx(-5.0)


def test_numbers_of_jobs_by_hand(compared: dict[str, Standing]) -> None:
    agent = compared["agent"]
    assert agent.about.policy_class == "other agent"
    assert agent.about.training_seeds == (0, 1)
    assert agent.operation.feasible_jobs == 1.0
    assert agent.operation.worst_return == pytest.approx(-101.0)
    assert value(agent.costs.full_cost_share) == pytest.approx((WORTH - 5.0) / WORTH)


@pytest.mark.filterwarnings("error")
def test_a_policy_that_may_remove_no_metal_has_no_share_of_its_worth() -> None:
    # Some resamples leave out the only job with metal.
    worth = np.where(np.arange(JOBS) == 0, WORTH, 0.0)
    (standing,) = rank([played(RULE, np.full(JOBS, -9.0), worth=worth)])
    assert standing.costs.full_cost_share is None


def test_scores_lie_between_fixed_parameters_and_the_oracle() -> None:
    base = np.linspace(-1000.0, 0.0, JOBS)
    gap = np.linspace(10.0, 500.0, JOBS)
    standings = standings_of(
        [
            played(LOWEST, base),
            played(ORACLE, base + gap),
            played(RULE, base + 0.5 * gap),
        ]
    )
    assert value(standings[NOMINAL_SHARE].score) == pytest.approx(0.0)
    assert value(standings[CAUSAL].score) == pytest.approx(100.0)
    assert value(standings["rule"].score) == pytest.approx(50.0)


def test_without_the_oracle_there_is_no_score() -> None:
    base = np.linspace(-1000.0, 0.0, JOBS)
    standings = standings_of([played(LOWEST, base), played(RULE, base + 5.0)])
    assert {name: standing.score for name, standing in standings.items()} == {
        NOMINAL_SHARE: None,
        "rule": None,
    }


def test_overload_is_counted_over_all_jobs_and_by_job() -> None:
    on_a_quarter = np.where(np.arange(JOBS) < JOBS // 4, 90.0, 0.0)
    (standing,) = rank([played(RULE, np.zeros(JOBS), severe_time=on_a_quarter)])
    assert not standing.feasible
    assert standing.operation.feasible_jobs == 0.75
    assert standing.overload.severe_share == pytest.approx(0.9 / 4)
    assert standing.overload.overload_share == pytest.approx(1.1 * standing.overload.severe_share)


@pytest.mark.slow
def test_a_job_does_not_depend_on_those_that_are_played_with_it() -> None:
    task = family_task(BRIEF_FAMILY, "unseen_jobs", 70)
    policy = one_named("idle", task)
    assert policy.compute is not None
    ended: list[int] = []
    episodes = policy.compute(task.scenario, task.seeds, ended.append)
    some = [3, 41, 69]
    alone = policy.compute(task.scenario, some, lambda ended: None)
    assert len(set(episodes["steps"])) > 3
    for name, values in alone.items():
        np.testing.assert_array_equal(episodes[name][some], values)
    # Progress is told over all batches.
    assert ended == sorted(ended)
    assert ended[-1] == 70


def test_only_controllers_have_variants() -> None:
    assert one_named("rescaled_grid_search", TASK, knows="true_laws").kind == "oracle"
    with pytest.raises(ResultError, match="causal has no variants"):
        one_named(CAUSAL, TASK, knows="true_laws")


def test_a_split_has_a_name_and_a_number_of_jobs() -> None:
    with pytest.raises(ResultError, match="no split 'nothing'; it has train"):
        family_task(BRIEF_FAMILY, "nothing", 1)
    with pytest.raises(ResultError, match=r"10000 seeds asked for, but .* has \d+ jobs"):
        family_task(BRIEF_FAMILY, None, 10_000)


@pytest.mark.slow
def test_known_forms_play_only_families_that_hide_some() -> None:
    unmodelled = family_task("unmodelled", "validation", 1)
    known = one_named(KNOWN_FORMS, unmodelled)
    assert known.kind == "oracle"
    play = known.compute
    assert isinstance(play, FamilyPlay)
    nominal = play.family.job(0, "validation").scenario.nominal()
    assert nominal.edge_failure != EdgeFailure()
    with pytest.raises(ResultError, match="no policy is called known_forms"):
        named([KNOWN_FORMS], family_task("shop", "validation", 1))


@pytest.mark.slow
def test_trajectories_of_jobs_are_those_that_were_played(tmp_path: Path) -> None:
    task = family_task(BRIEF_FAMILY, "unseen_jobs", 8)
    folder = result_folder(tmp_path, FAMILY_ID, task.scenario.name)
    policies = [one_named(name, task) for name in (NOMINAL_SHARE, CAUSAL)]
    play_all(task, policies, folder)
    results = read_results(folder)
    trajectories = read_part(Trajectories, folder / TRAJECTORIES_FILE).episodes
    assert len(trajectories) == 6
    for trajectory in trajectories:
        job = trajectory.seed
        assert trajectory.steps == results[trajectory.policy.label].episodes["steps"][job]
        scenario = BRIEF_FAMILY.job(job, "unseen_jobs").scenario
        assert trajectory.limits is not None
        assert trajectory.limits.power == scenario.limits.power
        assert trajectory.limits.wear == scenario.tool.wear_criterion


class Run(NamedTuple):
    """A run of rules and of an agent on the splits of a family of one's own."""

    command: list[str]  # without policies and results
    results: Path
    printed: str


PLAYED = {NOMINAL_OPTIMUM, CAUSAL, "rescaled_grid_search", "mine_brief"}


@pytest.fixture(scope="module")
def own_run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("own_family")
    toml = folder / "brief.toml"
    toml.write_text(tomli_w.dumps(BRIEF))
    agents = folder / "agents" / FAMILY_ID / "brief"
    first = onnx_agents.write_of_family(agents, BRIEF_FAMILY, 0)
    second = onnx_agents.write_of_family(agents, BRIEF_FAMILY, 1)

    family = ["--env", FAMILY_ID, "--scenario", str(toml)]
    command = ["run", *family, "--seeds", "3", "--splits"]
    rules = ["--policies", NOMINAL_OPTIMUM, CAUSAL, "rescaled_grid_search"]
    files = ["--agents", str(first), str(second), "--keep-names"]
    results = folder / "results"
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main([*command, *rules, *files, "--results", str(results)]) == 0
    return Run(command, results, printed.getvalue())


@pytest.fixture
def results(own_run: Run, tmp_path: Path) -> Path:
    """A copy of the results of the run, which a test may change."""
    return Path(shutil.copytree(own_run.results, tmp_path / "results"))


def folders_in(results: Path) -> list[Path]:
    """Return the folder of each split of the family of one's own."""
    return [result_folder(results, FAMILY_ID, f"brief-{split}") for split in SPLITS]


@pytest.mark.slow
def test_a_family_of_ones_own_is_played_and_ranked_on_its_splits(
    own_run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    show = ["show", "--results", str(own_run.results), "--env", FAMILY_ID]
    assert main([*show, "--all", "--json"]) == 0
    boards = json.loads(capsys.readouterr().out)["leaderboards"]
    assert [board["scenario"] for board in boards] == [f"brief-{split}" for split in SPLITS]
    for board in boards:
        assert {standing["name"] for standing in board["standings"]} == PLAYED
    for name in PLAYED:
        assert name in own_run.printed
    assert own_run.printed.count("ranked by") == 1
    assert f"all {len(SPLITS)} rankings: " in own_run.printed


@pytest.mark.slow
def test_a_rule_that_forgets_has_a_name_of_its_own(
    own_run: Run, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--policies", "rescaled_grid_search", "--forgets", "--results", str(results)]
    assert main([*own_run.command, *words]) == 0
    assert "rescaled_grid_search without memory between edges" in capsys.readouterr().out


@pytest.mark.slow
def test_packing_changes_no_result(results: Path) -> None:
    folders = folders_in(results)
    before = [read_results(folder) for folder in folders]
    assert main(["pack", "--results", str(results)]) == 0
    assert [read_results(folder) for folder in folders] == before
    files = {PACK_FILE, TRAJECTORIES_FILE, MANIFEST_FILE}
    assert {path.name for path in folders[0].iterdir()} == files


@pytest.mark.slow
def test_results_can_be_packed_without_a_policy(results: Path) -> None:
    assert main(["pack", "--results", str(results), "--without", "mine_brief"]) == 0
    for folder in folders_in(results):
        names = {result.policy.name for result in read_results(folder).values()}
        assert names == PLAYED - {"mine_brief"}


@pytest.mark.slow
def test_results_on_a_family_that_is_not_there_cannot_be_verified(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--results", str(results), "--agents", str(tmp_path)]
    assert main(["verify", *words, "--check"]) == 1
    complaint = "cannot be played again: no family and no file is called 'brief'"
    assert complaint in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rescaled_grid_search", CAUSAL])
def test_a_policy_that_travels_to_another_process_plays_alike(name: str) -> None:
    policy = one_named(name, TASK)
    # Workers receive what they play by cloudpickle.
    travelled = pickle.loads(cloudpickle.dumps(policy))
    expected = attempt(Piece(policy, TASK.scenario, seeds=[3]))
    played = attempt(Piece(travelled, TASK.scenario, seeds=[3]))
    assert isinstance(expected, dict)
    assert isinstance(played, dict)
    for field, values in expected.items():
        assert values.tolist() == played[field].tolist(), field


@pytest.mark.slow
def test_private_jobs_are_others_and_no_result_tells_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = "a key of the organiser"
    run = ["run", "--env", FAMILY_ID, "--policies", "idle", "--seeds", "2", "--results"]

    def result_in(results: Path) -> Result:
        return read_results(result_folder(results, FAMILY_ID, "shop-unseen_jobs"))["idle"]

    public_results = tmp_path / "public"
    private_results = tmp_path / "private"
    assert main([*run, str(public_results)]) == 0
    assert main([*run, str(private_results), "--private-key", key]) == 0
    public = result_in(public_results)
    private = result_in(private_results)
    assert public.task.private is None
    assert private.task.private is not None
    assert not set(public.episodes["return"]) & set(private.episodes["return"])

    texts = [path.read_text("latin-1") for path in private_results.rglob("*.*")]
    assert texts
    for text in (*texts, capsys.readouterr().out):
        assert key not in text
