"""Playing: what is played, resumed and refused, and the command line over all of it."""

import json
import math
import shlex
from pathlib import Path

import numpy as np
import pytest

from baselines.policy_spec import PolicySpec, ScenarioId
from leaderboard.__main__ import main
from leaderboard.ranking import read_leaderboard
from leaderboard.result import Task, read_part
from leaderboard.run import PoliciesFailedError
from leaderboard.trajectories import RECORDED_SEEDS, Trajectories
from tests.leaderboard.conftest import Steady, only, play_all, spec
from turning_env import Scenario


class Watched:
    """Makes policies of a feed action, and notes which play.

    ``played`` holds, in order, the feed of each that plays all seeds.
    """

    def __init__(self) -> None:
        self.played: list[float] = []

    def __call__(
        self, name: str, feed: float, seed: int | None = None, **fields: object
    ) -> PolicySpec:
        def make(num_envs: int) -> Steady:
            if num_envs > 1:  # trajectories are recorded one by one
                self.played.append(feed)
            return Steady(num_envs, (0.0, feed))

        return spec(name, (0.0, feed), seed, make=make, **fields)


def recorded_in(folder: Path) -> Trajectories:
    return read_part(Trajectories, folder / "trajectories.json.xz")


def test_only_what_is_missing_or_changed_is_played(task: Task, folder: Path) -> None:
    watched = Watched()
    play_all(task, [watched("one", 0.1), watched("two", 0.2)], folder)
    described_anew = watched(
        "one",
        0.1,
        description="other words",
        command="other command",
    )
    other_parameters = watched("two", 0.3)
    play_all(task, [described_anew, other_parameters, watched("three", 0.4)], folder)
    assert watched.played == [0.1, 0.2, 0.3, 0.4]


def test_another_version_is_played_and_all_is_played_afresh(task: Task, folder: Path) -> None:
    watched = Watched()
    play_all(task, [watched("one", 0.1)], folder)
    play_all(task, [watched("one", 0.1, version=2)], folder)
    assert watched.played == [0.1, 0.1]
    play_all(task, [watched("one", 0.1, version=2)], folder, fresh=True)
    assert watched.played == [0.1, 0.1, 0.1]


@pytest.mark.parametrize("change", [{"seeds": [1, 2]}, {"model_version": 0}], ids=str)
def test_another_task_takes_the_place_of_the_results(
    change: dict[str, object], task: Task, folder: Path
) -> None:
    watched = Watched()
    play_all(task, [watched("one", 0.1)], folder)
    before = recorded_in(folder)
    play_all(task.model_copy(update=change), [watched("one", 0.1)], folder)
    assert watched.played == [0.1, 0.1]
    assert [standing.name for standing in read_leaderboard(folder).standings] == ["one"]
    assert recorded_in(folder).task != before.task


def test_an_agent_trained_anew_takes_the_place_of_its_result_and_stands_beside_others(
    task: Task, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = spec("ppo", (0, 0.1), seed=0, sha256="a")
    second = spec("ppo", (0, 0.1), seed=1, sha256="b")
    play_all(task, [first, second], folder)
    trained_anew = spec("ppo", (0, 0.2), 0, sha256="c")
    play_all(task, [trained_anew], folder, replace=True)
    assert "ppo-seed0" in capsys.readouterr().err
    standings = read_leaderboard(folder).standings
    training_seeds = {standing.name: standing.about.training_seeds for standing in standings}
    assert training_seeds == {"ppo": (0,), "ppo-seed1": (1,)}
    policies = [episode.policy for episode in recorded_in(folder).episodes]
    files = {policy.label: policy.sha256 for policy in policies}
    assert files["ppo-seed0"] == "c"


RIVAL = spec("team", (0, 0.1), 0, sha256="a")
OTHER_FILE = spec("team", (0, 0.2), 0, sha256="b")
OTHER_CODE = spec("team", (0, 0.2), 0, command="some_module:team")


@pytest.mark.parametrize("seeds", [[7, 8, 9, 10], [1, 2]], ids=["same task", "another task"])
@pytest.mark.parametrize("other", [OTHER_FILE, OTHER_CODE], ids=["file", "code"])
def test_the_result_of_another_file_or_other_code_stands(
    other: PolicySpec, seeds: list[int], task: Task, folder: Path
) -> None:
    play_all(task, [RIVAL], folder)
    path = folder / "team-seed0.json.xz"
    before = only(path)
    present_task = task.model_copy(update={"seeds": seeds})
    with pytest.raises(PoliciesFailedError, match=r"team-seed0 .* is the result of another agent"):
        play_all(present_task, [other, spec("beside")], folder, fresh=True)
    assert only(path) == before
    assert only(folder / "beside.json.xz").task == present_task


def test_a_result_is_replaced_on_request(task: Task, folder: Path) -> None:
    play_all(task, [RIVAL], folder)
    play_all(task, [OTHER_FILE], folder, replace=True)
    assert only(folder / "team-seed0.json.xz").policy.sha256 == "b"


def test_code_that_raises_any_error_is_named_and_others_go_on(task: Task, folder: Path) -> None:
    def breaks(num_envs: int) -> Steady:
        raise ZeroDivisionError("lost")

    with pytest.raises(
        PoliciesFailedError, match=r"mine-seed0 cannot play: ZeroDivisionError: lost .*test_run\.py"
    ):
        play_all(task, [spec("mine", seed=0, make=breaks), spec("one")], folder)
    assert only(folder / "one.json.xz")


def test_a_value_error_in_own_code_is_placed(task: Task, folder: Path) -> None:
    def breaks(num_envs: int) -> Steady:
        raise ValueError("shapes do not fit")

    own = spec("mine", seed=0, make=breaks, command=f"{__name__}:breaks")
    with pytest.raises(PoliciesFailedError, match=r"shapes do not fit \(test_run\.py, line \d+\)"):
        play_all(task, [own], folder)


def test_a_policy_whose_actions_are_no_numbers_is_named_and_others_go_on(
    task: Task, folder: Path
) -> None:
    lost = spec("lost", make=lambda num_envs: Steady(num_envs, (math.nan, 0.0)))
    with pytest.raises(PoliciesFailedError, match=r"lost cannot play: .*finite"):
        play_all(task, [lost, spec("one")], folder)
    files = sorted(path.name for path in folder.iterdir())
    assert files == ["manifest.json", "one.json.xz", "trajectories.json.xz"]
    with pytest.raises(PoliciesFailedError, match="lost cannot play"):
        play_all(task, [lost], folder)


def test_trajectories_are_of_every_policy_on_the_first_seeds(task: Task, folder: Path) -> None:
    policies = [
        spec("slow"),
        spec("quick", (0.0, 0.1)),
        spec("ppo", (0.0, 0.2), 1),
        spec("ppo", (0.0, 0.2), 0),
    ]
    play_all(task, policies, folder)
    recorded = recorded_in(folder)
    # The first of an agent's training seeds stands for it.
    labels = {"slow": "slow", "quick": "quick", "ppo": "ppo-seed1"}
    expected = []
    for standing in read_leaderboard(folder).standings:
        for seed in task.seeds[:RECORDED_SEEDS]:
            expected.append((labels[standing.name], seed))
    assert [(episode.policy.label, episode.seed) for episode in recorded.episodes] == expected

    # Twelve steps of a second each, in few digits.
    first = recorded.episodes[0]
    assert first.steps == 12
    assert first.series["minutes"] == pytest.approx(np.arange(1, 13) / 60, rel=1e-4)
    # A later run that lacks a policy keeps its trajectory.
    play_all(task, policies[:1], folder)
    assert recorded_in(folder) == recorded


@pytest.mark.slow
def test_splits_are_played_by_what_was_tuned_for_the_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    splits = ("harder_lot", "ck45")
    monkeypatch.setattr("leaderboard.run_command.SPLITS", splits)
    results = tmp_path / "results"
    seeds = ["--seeds", "1", "--split-seeds", "1"]
    run = ["run", "--results", str(results), "--splits", *seeds, "--policies", "fixed_tuned"]
    assert main(run) == 0
    for name in splits:
        result = only(results / "RoughTurning-v0" / name / "fixed_tuned.json.xz")
        assert result.policy.tuned_for == ScenarioId.of(Scenario.load("rough_turning"))
    printed = capsys.readouterr().out
    _, _, table = printed.partition("full cost [min/dm3] of policies tuned for rough_turning")
    _, _, head, first, *_ = table.splitlines()
    assert head.split() == ["policy", "rough_turning", *splits]
    assert first.split()[0] == "fixed_tuned"
    # This is the only table, and a command prints the rankings.
    assert "ranked by" not in printed
    assert f"all 3 rankings: python -m leaderboard show --results {results} --all" in printed


def test_other_ids_have_no_splits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = ["run", "--results", str(tmp_path), "--env", "RoughTurning-Shift-v0"]
    assert main([*run, "--splits", "--policies"]) == 2
    assert "no splits of RoughTurning-Shift-v0" in capsys.readouterr().err


@pytest.mark.slow
def test_run_prints_the_ranking_and_the_command_that_shows_all_numbers(
    tmp_path: Path, scenario: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario.save(tmp_path / "short.toml")
    results = tmp_path / "results"
    run = ["run", "--scenario", str(tmp_path / "short.toml"), "--seeds", "3"]
    run += ["--results", str(results), "--policies", "fixed_handbook", "grid_search"]
    show = ["show", "--results", str(results)]

    assert main(run) == 0
    title, *ranking, numbers, last = capsys.readouterr().out.splitlines()
    assert last == f"wrote {results / 'index.html'}"
    assert "full cost" not in "\n".join(ranking)
    _, _, command = numbers.partition("python -m leaderboard ")
    assert main(shlex.split(command)) == 0
    shown = capsys.readouterr().out
    assert shown.splitlines()[0] == title
    assert "full cost" in shown
    for name in ("fixed_handbook", "grid_search"):
        assert any(name in row for row in ranking)
        assert name in shown
    assert main(show) == 0
    assert capsys.readouterr().out == shown

    # With --json, stdout holds all numbers and nothing else.
    assert main([*run, "--json"]) == 0
    captured = capsys.readouterr()
    assert captured.err.endswith(f"wrote {results / 'index.html'}\n")
    assert main([*show, "--json"]) == 0
    assert capsys.readouterr().out == captured.out

    data = json.loads(captured.out)
    (leaderboard,) = data["leaderboards"]
    standings = read_leaderboard(results / "RoughTurning-v0" / "rough_turning").standings
    names = [standing["name"] for standing in leaderboard["standings"]]
    assert names == [standing.name for standing in standings]
    first = leaderboard["standings"][0]
    assert first["mean_return"]["value"] == standings[0].mean_return.value
    without_unit = {
        "name",
        "kind",
        "policy_class",
        "inputs",
        "rank",
        "knows",
        "forgets",
        "description",
        "own",
        "training_seeds",
        "best_rule",
        "feasible",
        "feasibility",
        "unranked",
    }
    assert first.keys() - without_unit == data["units"].keys()
