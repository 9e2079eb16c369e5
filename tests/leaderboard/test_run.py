"""Playing: what is played, what is resumed, what is refused, and the command line over all of it."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from leaderboard.__main__ import main
from leaderboard.ranking import read_leaderboard
from leaderboard.result import Task, read_part
from leaderboard.run import PoliciesFailedError
from leaderboard.trajectories import RECORDED_SEEDS, Trajectories
from tests.leaderboard.conftest import Steady, only, play_all, spec
from tests.train import onnx_agents
from turning_env import Scenario
from turning_env.scoring.policy import PolicySpec, ScenarioId


class Watched:
    """Makes policies of a feed action and notes, in order, the feed of each that plays all seeds."""

    def __init__(self) -> None:
        self.played: list[float] = []

    def __call__(
        self, name: str, feed: float, seed: int | None = None, **fields: object
    ) -> PolicySpec:
        def make(num_envs: int) -> Steady:
            self.played += [feed] if num_envs > 1 else []  # trajectories are recorded one by one
            return Steady(num_envs, (0.0, feed))

        return spec(name, (0.0, feed), seed, make=make, **fields)


def recorded_in(folder: Path) -> Trajectories:
    return read_part(Trajectories, folder / "trajectories.json.xz")


def test_only_what_is_missing_or_changed_is_played(task: Task, folder: Path) -> None:
    watched = Watched()
    play_all(task, [watched("one", 0.1), watched("two", 0.2)], folder)
    again = watched("one", 0.1, description="other words", command="other command")
    play_all(task, [again, watched("two", 0.3), watched("three", 0.4)], folder)
    assert watched.played == [0.1, 0.2, 0.3, 0.4]
    play_all(task, [watched("one", 0.1, version=2)], folder)
    play_all(task, [watched("one", 0.1, version=2)], folder, fresh=True)
    before = recorded_in(folder)
    for change in ({"seeds": [1, 2]}, {"model_version": 0}):
        play_all(task.model_copy(update=change), [watched("one", 0.1)], folder)
        assert [standing.name for standing in read_leaderboard(folder).standings] == ["one"]
        assert recorded_in(folder).task != before.task
    assert watched.played[4:] == [0.1] * 4


def test_an_agent_trained_anew_takes_the_place_of_its_result_and_stands_beside_others(
    task: Task, folder: Path, capsys
) -> None:
    play_all(
        task, [spec("ppo", (0, 0.1), 0, sha256="a"), spec("ppo", (0, 0.1), 1, sha256="b")], folder
    )
    play_all(task, [spec("ppo", (0, 0.2), 0, sha256="c")], folder, replace=True)
    assert "ppo-seed0" in capsys.readouterr().err
    names = {
        standing.name: standing.training_seeds for standing in read_leaderboard(folder).standings
    }
    assert names == {"ppo": (0,), "ppo-seed1": (1,)}
    recorded = {each.policy.label: each.policy.sha256 for each in recorded_in(folder).episodes}
    assert recorded["ppo-seed0"] == "c"


def test_the_result_of_another_file_or_other_code_stands_unless_it_is_to_be_replaced(
    task: Task, folder: Path
) -> None:
    rival = spec("team", (0, 0.1), 0, sha256="a")
    play_all(task, [rival], folder)
    before = only(folder / "team-seed0.json.xz")
    others = {"file": {"sha256": "b"}, "code": {"command": "some_module:team"}}
    for what, fields in others.items():
        for on in (task, task.model_copy(update={"seeds": [1, 2]})):
            with pytest.raises(
                PoliciesFailedError, match=r"team-seed0 .* is the result of another agent"
            ):
                play_all(
                    on,
                    [spec("team", (0, 0.2), 0, **fields), spec(f"beside {what}")],
                    folder,
                    fresh=True,
                )
            assert only(folder / "team-seed0.json.xz") == before, what
            assert only(folder / f"beside_{what}.json.xz").task == on
    play_all(task, [spec("team", (0, 0.2), 0, sha256="b")], folder, replace=True)
    assert only(folder / "team-seed0.json.xz").policy.sha256 == "b"


def test_code_that_raises_any_error_is_named_and_others_go_on(task: Task, folder: Path) -> None:
    def breaks(num_envs: int) -> Steady:
        raise ZeroDivisionError("lost")

    with pytest.raises(
        PoliciesFailedError, match=r"mine-seed0 cannot play: ZeroDivisionError: lost .*test_run\.py"
    ):
        play_all(task, [spec("mine", seed=0, make=breaks), spec("one")], folder)
    assert only(folder / "one.json.xz")


def test_a_policy_whose_actions_are_no_numbers_is_named_and_others_go_on(
    task: Task, folder: Path
) -> None:
    lost = spec("lost", make=lambda num_envs: Steady(num_envs, (math.nan, 0.0)))
    with pytest.raises(PoliciesFailedError, match=r"lost cannot play: .*finite"):
        play_all(task, [lost, spec("one")], folder)
    assert sorted(path.name for path in folder.iterdir()) == [
        "manifest.json",
        "one.json.xz",
        "trajectories.json.xz",
    ]
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
    labels = {
        "slow": "slow",
        "quick": "quick",
        "ppo": "ppo-seed1",
    }  # an agent's first training seed stands for it
    assert [(episode.policy.label, episode.seed) for episode in recorded.episodes] == [
        (labels[standing.name], seed)
        for standing in read_leaderboard(folder).standings
        for seed in task.seeds[:RECORDED_SEEDS]
    ]
    assert recorded.episodes[0].series["minutes"] == pytest.approx(np.arange(1, 13) / 60, rel=1e-4)
    assert recorded.episodes[0].steps == 12
    # A later run that lacks a policy keeps its trajectory.
    play_all(task, policies[:1], folder)
    assert recorded_in(folder) == recorded


@pytest.mark.slow
def test_splits_are_played_by_what_was_tuned_for_the_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    splits = ("harder_lot", "ck45")
    monkeypatch.setattr("leaderboard.__main__.SPLITS", splits)
    agent_path = onnx_agents.write(tmp_path, 0)
    words = [
        "run",
        "--results",
        str(tmp_path / "results"),
        "--splits",
        "--seeds",
        "2",
        "--split-seeds",
        "2",
    ]
    assert main([*words, "--policies", "fixed_tuned", "--agents", str(agent_path)]) == 0
    for name in splits:
        result = only(tmp_path / "results" / "RoughTurning-v0" / name / "fixed_tuned.json.xz")
        assert result.policy.tuned_for == ScenarioId.of(Scenario.load("rough_turning"))
    shown = capsys.readouterr().out
    table = shown[
        shown.index("full cost [min/dm3] of policies tuned for rough_turning") :
    ].splitlines()
    assert table[2].split() == ["policy", "rough_turning", *splits]
    assert table[3].split()[0] == "fixed_tuned"
    assert (
        main(
            [
                "run",
                "--results",
                str(tmp_path),
                "--env",
                "RoughTurning-Shift-v0",
                "--splits",
                "--policies",
            ]
        )
        == 2
    )
    assert "no splits of RoughTurning-Shift-v0" in capsys.readouterr().err


@pytest.mark.slow
def test_command_line(
    tmp_path: Path, scenario: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario.save(tmp_path / "short.toml")
    results = tmp_path / "results"
    common = ["--results", str(results)]
    played = [
        "--scenario",
        str(tmp_path / "short.toml"),
        "--seeds",
        "3",
        "--policies",
        "fixed_handbook",
        "grid_search",
    ]
    assert main(["run", *common, *played]) == 0
    shown = capsys.readouterr().out
    assert shown.splitlines()[-1] == f"wrote {results / 'index.html'}"
    assert "fixed_handbook" in shown
    assert main(["show", *common]) == 0
    assert capsys.readouterr().out.splitlines() == shown.splitlines()[:-1]
    # Machines are told all numbers, and nothing else.
    assert main(["run", *common, *played, "--json"]) == 0
    printed = capsys.readouterr()
    assert printed.err.endswith(f"wrote {results / 'index.html'}\n")
    told = json.loads(printed.out)
    (leaderboard,) = told["leaderboards"]
    ranked = read_leaderboard(results / "RoughTurning-v0" / "rough_turning").standings
    assert [standing["name"] for standing in leaderboard["standings"]] == [
        standing.name for standing in ranked
    ]
    first = leaderboard["standings"][0]
    assert first["mean_return"]["value"] == ranked[0].mean_return.value
    words = {
        "name",
        "kind",
        "policy_class",
        "information",
        "description",
        "own",
        "training_seeds",
        "best_rule",
    }
    words |= {"feasible", "feasibility", "unranked"}
    assert first.keys() - words == told["units"].keys()
    assert main(["show", *common, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == told
