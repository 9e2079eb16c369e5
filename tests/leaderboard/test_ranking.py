"""Results on one task are ranked together, whatever else their folder holds."""

from pathlib import Path

import pytest

from baselines.catalogue import RULES
from baselines.policy_spec import ScenarioId
from leaderboard import policies as leaderboard_policies
from leaderboard.ranking import names_of, rank, read_if_usable, read_leaderboard, read_leaderboards
from leaderboard.result import (
    MANIFEST_FILE,
    TRAJECTORIES_FILE,
    Manifest,
    Result,
    ResultError,
    Task,
    result_folder,
    write_manifest,
    write_part,
    write_result,
)
from leaderboard.trajectories import SERIES, Trajectories, Trajectory
from tests.leaderboard.conftest import ENV_ID, MakeResult, spec
from tests.turning_env.playing import changed
from turning_env import IDS, Scenario


@pytest.fixture
def other(task: Task) -> Task:
    """The same scenario on other seeds: another task."""
    return task.model_copy(update={"seeds": [1, 2, 3]})


def write(folder: Path, *results: Result) -> None:
    for result in results:
        write_result(result, folder)


def test_the_task_of_most_results_is_ranked_and_others_are_left_out(
    folder: Path, make_result: MakeResult, task: Task, other: Task
) -> None:
    write(folder, make_result("first", returns=1.0), make_result("second", returns=2.0))
    write(folder, make_result("elsewhere", on=other))
    leaderboard = read_leaderboard(folder)
    assert leaderboard.task == task
    assert [standing.name for standing in leaderboard.standings] == ["second", "first"]
    assert [result.policy.name for result in leaderboard.results] == ["first", "second"]
    assert leaderboard.left_out == [str(folder / "elsewhere")]
    assert leaderboard.names == {"first": "first", "second": "second"}
    assert leaderboard.trajectories is None


def test_the_manifest_names_the_task_and_a_given_one_comes_first(
    folder: Path, make_result: MakeResult, task: Task, other: Task
) -> None:
    write(folder, make_result("first"), make_result("second"))
    write(folder, make_result("elsewhere", on=other))
    write_manifest(folder, other)
    assert read_leaderboard(folder).task == other
    assert read_leaderboard(folder, task).task == task
    assert read_leaderboard(folder, task).left_out == [str(folder / "elsewhere")]


def test_of_two_tasks_with_as_many_results_one_is_chosen_by_its_digest(
    folder: Path, make_result: MakeResult, task: Task, other: Task
) -> None:
    write(folder, make_result("first"), make_result("elsewhere", on=other))
    assert read_leaderboard(folder).task.digest == max(task.digest, other.digest)


def test_folders_without_results_on_the_task_are_refused(
    folder: Path, make_result: MakeResult, other: Task
) -> None:
    folder.mkdir(parents=True)
    with pytest.raises(ResultError, match="holds no results"):
        read_leaderboard(folder)
    write(folder, make_result("first"))
    with pytest.raises(ResultError, match=f"no results on task {other.digest[:12]}"):
        read_leaderboard(folder, other)
    write_manifest(folder, other)
    with pytest.raises(ResultError, match=f"no results on task {other.digest[:12]}"):
        read_leaderboard(folder)


@pytest.fixture
def results(tmp_path: Path, make_result: MakeResult, task: Task) -> Path:
    """A folder with results on three ids, of two presets of one, and on two splits of a family."""
    root = tmp_path / "results"
    places = [
        ("RoughTurning-Shift-v0", "shift"),
        (ENV_ID, "worn_lot"),
        (ENV_ID, "rough_turning"),
        ("RoughTurning-Family-v1", "shop-train"),
        ("RoughTurning-Family-v1", "shop-unseen"),
        ("Unknown-v9", "odd"),
    ]
    for env_id, scenario_name in places:
        place = result_folder(root, env_id, scenario_name)
        scenario = task.scenario.model_copy(update={"name": scenario_name})
        on = task.model_copy(update={"env_id": env_id, "scenario": scenario})
        write(place, make_result("rule", on=on))
    result_folder(root, ENV_ID, "empty").mkdir()
    return root


def tasks_of(results: Path, **options: object) -> list[str]:
    """Return the ids of the leaderboards, in order."""
    return [board.task.env_id for board in read_leaderboards(results, **options)]  # type: ignore[arg-type]


def test_ids_come_in_the_order_in_which_they_are_declared(results: Path) -> None:
    found = tasks_of(results)
    known = [env_id for env_id in found if env_id in IDS]
    order = list(IDS)
    assert known == sorted(known, key=order.index)
    assert known == [ENV_ID, ENV_ID, "RoughTurning-Shift-v0"]
    assert found[-1] == "Unknown-v9"
    assert len(found) == 6
    assert tasks_of(results, max_count=2) == found[:2]
    assert tasks_of(results, env_id="RoughTurning-Shift-v0") == ["RoughTurning-Shift-v0"]


def test_an_ids_own_preset_comes_before_other_scenarios(
    results: Path, make_result: MakeResult, other: Task
) -> None:
    own = result_folder(results, ENV_ID, "rough_turning")
    write(own, make_result("rule", on=other), make_result("another", on=other))
    boards = read_leaderboards(results, env_id=ENV_ID)
    assert [len(board.results) for board in boards] == [2, 1]
    only_one = read_leaderboards(results, env_id=ENV_ID, max_count=1)
    assert [len(board.results) for board in only_one] == [2]


@pytest.mark.parametrize(
    ("scenarios", "count"),
    [
        ([], 6),
        (["shift"], 1),
        (["shop"], 2),
        (["shop-train"], 1),
        (["shift", "shop"], 3),
    ],
)
def test_scenarios_are_chosen_by_name_and_families_with_all_splits(
    results: Path, scenarios: list[str], count: int
) -> None:
    assert len(tasks_of(results, scenarios=scenarios)) == count


def test_the_task_of_a_folder_can_be_given(
    results: Path, make_result: MakeResult, other: Task
) -> None:
    place = result_folder(results, ENV_ID, "rough_turning")
    write(place, make_result("less", on=other))
    boards = read_leaderboards(results, {place: other}, env_id=ENV_ID)
    assert [board.task.seeds for board in boards] == [other.seeds, [7, 8, 9, 10]]


def test_a_folder_that_cannot_be_used_is_named_and_the_others_are_ranked(
    results: Path, other: Task, capsys: pytest.CaptureFixture[str]
) -> None:
    place = result_folder(results, "Unknown-v9", "odd")
    assert len(read_leaderboards(results, {place: other})) == 5
    assert f"skipped: {place} holds no results on task" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param(
            {"env_id": ENV_ID, "scenarios": ["casting"]},
            f"holds no results of {ENV_ID} of casting yet, only empty, rough_turning, worn_lot: "
            f"python -m leaderboard run --env {ENV_ID}",
            id="id and scenario",
        ),
        pytest.param(
            {"scenarios": ["casting"]},
            "of casting yet, only empty, odd, rough_turning, shift, shop-train, shop-unseen, "
            "worn_lot: python -m leaderboard run$",
            id="scenario",
        ),
        pytest.param(
            {"env_id": "RoughTurning-Paper-v0"},
            "of RoughTurning-Paper-v0 yet: python -m leaderboard run --env RoughTurning-Paper-v0",
            id="nothing there",
        ),
    ],
)
def test_without_results_the_error_says_what_is_there(
    results: Path, options: dict[str, object], message: str
) -> None:
    with pytest.raises(ResultError, match=message):
        tasks_of(results, **options)


def trajectory_of(result: Result) -> Trajectory:
    series = {name: [1.0, 2.0] for name in ("minutes", *SERIES)}
    return Trajectory(policy=result.policy, seed=7, steps=2, series=series)


def write_trajectories(folder: Path, task: Task, *results: Result) -> None:
    episodes = [trajectory_of(result) for result in results]
    write_part(Trajectories(task=task.digest, episodes=episodes), folder / TRAJECTORIES_FILE)


def test_recorded_trajectories_are_those_of_the_ranked_results(
    folder: Path, make_result: MakeResult, task: Task, other: Task
) -> None:
    played = make_result("played")
    gone = make_result("gone")
    write(folder, played)
    write_trajectories(folder, task, played, gone)
    trajectories = read_leaderboard(folder).trajectories
    assert trajectories is not None
    assert [episode.policy.name for episode in trajectories.episodes] == ["played"]

    write_trajectories(folder, task, gone)
    assert read_leaderboard(folder).trajectories is None
    write_trajectories(folder, other, played)
    assert read_leaderboard(folder).trajectories is None


def test_a_file_that_a_run_writes_again_may_be_missing_or_damaged(
    folder: Path, task: Task, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / MANIFEST_FILE
    assert read_if_usable(Manifest, path) is None
    assert capsys.readouterr().err == ""
    folder.mkdir(parents=True)
    write_manifest(folder, task)
    manifest = read_if_usable(Manifest, path)
    assert manifest is not None
    assert manifest.task == task
    path.write_text("{")
    assert read_if_usable(Manifest, path) is None
    notice = capsys.readouterr().err
    assert notice.startswith("skipped: ")
    assert "the next python -m leaderboard run writes it anew" in notice


def test_time_over_a_limit_is_a_share_of_the_cutting_time_of_all_trainings(
    make_result: MakeResult,
) -> None:
    """12 s and 3 s of a minute in one training; the other cuts for three minutes."""
    over = {"overload_2_percent_time": 12.0, "overload_10_percent_time": 3.0}
    first = make_result("ppo", 0, **over)
    second = make_result("ppo", 1, engaged_time=180.0, time=180.0)
    (standing,) = rank([first, second])
    assert standing.overload.share_above_2_percent == pytest.approx(12.0 / 240.0)
    assert standing.overload.share_above_10_percent == pytest.approx(3.0 / 240.0)
    older = second.model_copy(update={"excess": None})
    (standing,) = rank([first, older])
    assert standing.overload.share_above_2_percent is None
    assert standing.overload.share_above_10_percent is None
    (standing,) = rank([make_result("idle", engaged_time=0.0)])
    assert standing.overload.share_above_2_percent == 0.0
    assert standing.overload.share_above_10_percent == 0.0


def test_short_cutting_has_shares_too(make_result: MakeResult) -> None:
    (standing,) = rank(
        [make_result("rule", engaged_time=0.1, time=0.1, overload_2_percent_time=0.05)]
    )
    assert standing.overload.share_above_2_percent == pytest.approx(0.5)


def test_what_a_policy_is_follows_from_the_present_code(
    make_result: MakeResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(leaderboard_policies, "shipped_agents", lambda: {"a": "ppo"})
    base = ScenarioId.of(Scenario.load("rough_turning"))
    parameters = {"total_timesteps": 6_000_000}
    ours = spec("ppo", seed=0, parameters=parameters, sha256="a", tuned_for=base)
    theirs = spec("sac", seed=3, parameters=parameters, sha256="b", tuned_for=base)
    standings = {}
    for name, policy in (("ppo", ours), ("sac", theirs), ("grid_search", spec("grid_search"))):
        (standings[name],) = rank([make_result(name, policy=policy)])
    about = {name: standing.about for name, standing in standings.items()}
    assert about["ppo"].description == (
        "trained for 6,000,000 environment steps on scenario rough_turning"
    )
    assert about["sac"].description == "made up"
    assert about["grid_search"].description == RULES["grid_search"].description
    assert (about["ppo"].own, about["sac"].own, about["grid_search"].own) == (False, True, False)
    assert about["ppo"].training_seeds == (0,)
    assert about["sac"].training_seeds == (3,)
    assert about["grid_search"].training_seeds == ()
    assert about["grid_search"].inputs is None
    assert about["ppo"].inputs is not None


def test_inputs_count_on_the_scenario_of_the_training(make_result: MakeResult, task: Task) -> None:
    """The scored edge ends with the episode. In one training it outlived the job of three bars."""
    ends_with_edge = changed(task.scenario, workpiece={"bars": 0}, control={"edge_changes": "end"})
    ends_with_job = changed(ends_with_edge, workpiece={"bars": 3})
    scored = task.model_copy(update={"scenario": ends_with_edge})
    parameters = {"training_information": ["rewards", "life price", "spreads"]}
    inputs = {}
    for trained_on in (None, ends_with_job):
        policy = spec("ppo", seed=0, parameters=parameters, trained_on=trained_on)
        (standing,) = rank([make_result("ppo", policy=policy, on=scored)])
        assert standing.about.inputs is not None
        inputs[trained_on] = standing.about.inputs.training
    assert inputs == {None: ("rewards", "life price", "spreads"), ends_with_job: ("rewards",)}


def test_agents_of_one_training_share_a_name_and_others_name_their_seeds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(leaderboard_policies, "shipped_agents", lambda: {"a": "ppo"})
    policies = [
        spec("ppo", seed=5, parameters={"gamma": 0.9}, sha256="own"),
        spec("ppo", seed=0, parameters={"gamma": 0.9}, sha256="a"),
        spec("ppo", seed=6, parameters={"gamma": 0.9}, sha256="own too"),
    ]
    assert names_of(policies) == {
        "ppo-seed0": "ppo",
        "ppo-seed5": "ppo-seed5,6",
        "ppo-seed6": "ppo-seed5,6",
    }


def test_a_ranking_follows_its_results(folder: Path, make_result: MakeResult) -> None:
    """A process that ranks equal results once must see that they have changed."""
    write(folder, make_result("rule", returns=1.0))
    (before,) = read_leaderboard(folder).standings
    write(folder, make_result("rule", returns=2.0))
    (after,) = read_leaderboard(folder).standings
    assert (before.mean_return.value, after.mean_return.value) == (1.0, 2.0)
