"""Playing: what is played, what is resumed, what is refused, and the command line over all of it."""

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from leaderboard import contestants, run
from leaderboard.__main__ import main
from leaderboard.board import read_board
from leaderboard.contestants import Contestant, Reference
from leaderboard.result import MadeFor, ResultError, Task, read_part, read_result
from leaderboard.run import PlayersFailed
from leaderboard.trajectories import RECORDED_DRAWS, Trajectories, record
from tests.leaderboard.conftest import Steady, contestant, play_all, record_of
from tests.train import onnx_agents
from train.agents import run_folder as agent
from turning_env import Scenario
from turning_env.score.play import EPISODE_FIELDS, Episodes, play


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The feed action of every policy that plays, in order."""
    actions: list[float] = []

    def watched(make, *arguments):
        actions.append(float(make(1)._actions[0, 1]))
        return play(make, *arguments)

    monkeypatch.setattr(contestants, "play", watched)
    return actions


def test_results_are_what_the_policies_do(task: Task, folder: Path) -> None:
    play_all(task, [contestant("slow"), contestant("quick", (0.0, 1.0))], folder, fresh=False)
    for name, action in (("slow", (0.0, 0.0)), ("quick", (0.0, 1.0))):
        result = read_result(folder / f"{name}.json.xz")
        for field, values in play(lambda num_envs, action=action: Steady(num_envs, action), task.scenario, task.draws).items():
            np.testing.assert_array_equal(result.episodes[field], values)


def test_only_what_is_missing_or_changed_is_played(task: Task, folder: Path, played: list[float]) -> None:
    play_all(task, [contestant("one", (0, 0.1)), contestant("two", (0, 0.2))], folder, fresh=False)
    assert played == pytest.approx([0.1, 0.2])
    play_all(task, [contestant("one", (0, 0.1)), contestant("two", (0, 0.3)), contestant("three", (0, 0.4))], folder, False)
    assert played[2:] == pytest.approx([0.3, 0.4])
    play_all(task, [contestant("one", (0, 0.1))], folder, fresh=True)
    assert played[4:] == pytest.approx([0.1])
    play_all(task.model_copy(update={"draws": [1, 2]}), [contestant("one", (0, 0.1))], folder, fresh=False)
    assert played[5:] == pytest.approx([0.1])


def test_what_other_code_has_made_is_played_again(
    task: Task, folder: Path, played: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    contestants = [contestant("fixed_tuned", (0, 0.1)), contestant("grid_search", (0, 0.2))]
    play_all(task, contestants, folder, fresh=False)
    recorded = read_part(Trajectories, folder / "trajectories.json.xz")
    monkeypatch.setattr("leaderboard.results.code_digest", lambda: "0" * 64)
    play_all(task, contestants[:1], folder, fresh=False)
    assert played == pytest.approx([0.1, 0.2, 0.1])
    assert read_part(Trajectories, folder / "trajectories.json.xz").task != recorded.task
    play_all(task, contestants, folder, fresh=False)
    assert played == pytest.approx([0.1, 0.2, 0.1, 0.2])


def test_an_interrupted_run_goes_on(task: Task, folder: Path, played: list[float]) -> None:
    def interrupted(num_envs: int) -> Steady:
        raise KeyboardInterrupt

    second = contestant("two", (0, 0.2))
    with pytest.raises(KeyboardInterrupt):
        play_all(task, [contestant("one", (0, 0.1)), Contestant(second.policy, interrupted)], folder, fresh=False)
    assert [path.name for path in folder.iterdir()] == ["one.json.xz"]
    play_all(task, [contestant("one", (0, 0.1)), second], folder, fresh=False)
    assert played == pytest.approx([0.1, 0.2])


def test_an_unreadable_file_is_played_again_or_else_named(task: Task, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    play_all(task, [contestant("one")], folder, fresh=False)
    (folder / "one.json.xz").write_text("{")
    (folder / "trajectories.json.xz").write_text("{")
    play_all(task, [contestant("one")], folder, fresh=False)
    assert "one.json.xz cannot be read" in capsys.readouterr().err
    read_result(folder / "one.json.xz")
    (folder / "foreign.json.xz").write_text("{}")
    with pytest.raises(ResultError, match=r"foreign\.json\.xz"):
        play_all(task, [contestant("one")], folder, fresh=False)


def test_agents_that_cannot_be_ranked_are_refused_before_play(task: Task, folder: Path, played: list[float]) -> None:
    with pytest.raises(ResultError, match="ppo-seed0 and ppo-seed1 cannot be one policy"):
        play_all(task, [contestant("ppo", (0, 0.1), 0), contestant("ppo", (0, 0.2), 1)], folder, fresh=False)
    assert not played


def test_a_policy_whose_actions_are_no_numbers_is_named_and_others_go_on(task: Task, folder: Path) -> None:
    lost = Contestant(record_of("lost"), lambda num_envs: Steady(num_envs, (math.nan, 0.0)))
    with pytest.raises(PlayersFailed, match=r"lost cannot play: .*finite"):
        play_all(task, [lost, contestant("one")], folder, fresh=False)
    assert sorted(path.name for path in folder.iterdir()) == ["one.json.xz", "trajectories.json.xz"]
    with pytest.raises(PlayersFailed, match="lost cannot play"):
        play_all(task, [lost], folder, fresh=False)


def test_trajectories_are_of_every_policy_on_the_first_draws(task: Task, folder: Path) -> None:
    contestants = [
        contestant("slow"),
        contestant("quick", (0.0, 0.1)),
        contestant("ppo", (0.0, 0.2), 1),
        contestant("ppo", seed=0),
    ]
    contestants[3] = Contestant(
        contestants[3].policy.model_copy(update={"parameters": contestants[2].policy.parameters}), contestants[2].make
    )
    play_all(task, contestants, folder, fresh=False)
    recorded = read_part(Trajectories, folder / "trajectories.json.xz")
    standings = read_board(folder).standings
    labels = {"slow": "slow", "quick": "quick", "ppo": "ppo-seed1"}  # an agent's first training seed stands for it
    assert [(episode.policy.label, episode.draw) for episode in recorded.episodes] == [
        (labels[standing.name], draw) for standing in standings for draw in task.draws[:RECORDED_DRAWS]
    ]
    assert recorded.episodes[0].series["minutes"] == pytest.approx(np.arange(1, 13) / 60, rel=1e-4)
    assert recorded.episodes[0].steps == 12
    # A later run that lacks a policy keeps its trajectory.
    play_all(task, contestants[:1], folder, fresh=False)
    assert read_part(Trajectories, folder / "trajectories.json.xz") == recorded


def test_interrupted_recording_keeps_what_is_finished(task: Task, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ordered = []

    def interrupted(policy, make, scenario, draw):
        if len(ordered) == 4:
            raise KeyboardInterrupt
        ordered.append((policy.name, draw))
        return record(policy, make, scenario, draw)

    monkeypatch.setattr(run, "record", interrupted)
    contestants = [contestant("one"), contestant("two", (0.0, 0.1))]
    with pytest.raises(KeyboardInterrupt):
        play_all(task, contestants, folder, fresh=False)
    kept = read_part(Trajectories, folder / "trajectories.json.xz").episodes
    assert [(episode.policy.name, episode.draw) for episode in kept] == ordered
    monkeypatch.setattr(run, "record", record)
    play_all(task, contestants, folder, fresh=False)
    whole = read_part(Trajectories, folder / "trajectories.json.xz").episodes
    assert whole[:4] == kept
    assert len(whole) == 6


def test_rules_come_from_the_catalogue() -> None:
    scenario = Scenario()
    (handbook,) = run.named(["fixed_handbook"], scenario)
    assert handbook.policy.kind == "rule"
    assert handbook.policy.parameters
    assert handbook.policy.made_for is None
    with pytest.raises(ResultError, match=r"no policy is called nonsense; there are .*grid_search"):
        run.named(["grid_search", "nonsense"], scenario)
    untuned = scenario.model_copy(update={"limits": scenario.limits.model_copy(update={"power": 6.5})})
    with pytest.raises(ResultError, match=r"fixed_tuned cannot play: .*baselines\.tune"):
        run.named(["fixed_tuned"], untuned)
    (elsewhere,) = run.named(["fixed_tuned"], untuned, tuned_on=scenario)
    assert elsewhere.policy.made_for == MadeFor.of(scenario)
    assert elsewhere.policy.parameters == run.named(["fixed_tuned"], scenario)[0].policy.parameters


def bound(scenario: Scenario, draws: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
    """No policy earns more."""
    on_step(len(draws))
    return {name: np.full(len(draws), 1000.0 if name == "return" else 0.0) for name in EPISODE_FIELDS}


def test_references_are_ranked_but_do_not_play(task: Task, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = Reference(record_of("oracle").model_copy(update={"kind": "reference"}), bound)
    monkeypatch.setattr(run, "known_references", lambda scenario: [known])
    assert run.named(["oracle"], task.scenario) == [known]
    assert "oracle" in [each.policy.name for each in run.named(None, Scenario())]
    play_all(task, [known, contestant("one")], folder, fresh=False)
    assert read_result(folder / "oracle.json.xz").episodes["return"] == [1000.0] * 4
    assert [each.policy.name for each in read_part(Trajectories, folder / "trajectories.json.xz").episodes] == ["one"] * 3


def test_agents_come_from_their_folders(tmp_path: Path, scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(agent, "load_actor", lambda run: onnx_agents.memoryless(run.seed))
    folders = [tmp_path / f"run{seed}" for seed in (0, 1)]
    for seed, folder in enumerate(folders):
        onnx_agents.run(folder, seed).begin()
    first, second = run.agents(folders, scenario)
    assert (first.policy.label, second.policy.label) == ("ppo-seed0", "ppo-seed1")
    assert first.policy.digest != second.policy.digest
    assert first.policy.made_for == MadeFor.of(onnx_agents.SCENARIO)
    (folders[0] / "policy.zip").write_text("trained anew")
    assert run.agents(folders[:1], scenario)[0].policy.digest != first.policy.digest
    with pytest.raises(ResultError, match="ppo-seed0, which another"):
        run.agents([folders[0], folders[0]], scenario)
    with pytest.raises(ResultError, match=r"nowhere.* holds no training run"):
        run.agents([tmp_path / "nowhere"], scenario)


def test_agents_come_from_files_and_act_as_those_of_the_folders(
    tmp_path: Path, task: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(agent, "load_actor", lambda run: onnx_agents.remembering(run.seed))
    onnx_agents.run(tmp_path / "run", 2).begin()
    path = onnx_agents.write(tmp_path, 2, memory=True)
    from_file, from_folder = (run.agents([each], task.scenario)[0] for each in (path, tmp_path / "run"))
    assert from_file.policy.digest == hashlib.sha256(path.read_bytes()).hexdigest()
    assert from_file.policy.model_copy(update={"digest": from_folder.policy.digest}) == from_folder.policy
    mine, its = (each.episodes(task.scenario, task.draws, lambda ended: None) for each in (from_file, from_folder))
    for name, values in mine.items():
        np.testing.assert_allclose(values, its[name], rtol=1e-4, atol=1e-3)
    with pytest.raises(ResultError, match="ppo-seed2, which another"):
        run.agents([path, tmp_path / "run"], task.scenario)
    with pytest.raises(ResultError, match="cannot play 'shift'"):
        run.agents([path], Scenario.load("shift"))
    path.write_bytes(b"damaged")
    with pytest.raises(ResultError, match=r"no agent can be loaded from .*ppo-seed2\.onnx: .* is no ONNX file"):
        run.agents([path], task.scenario)


def test_splits_are_played_by_what_was_made_for_the_scenario(
    tmp_path: Path, scenario: Scenario, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    splits = ("harder_lot", "ck45")
    monkeypatch.setattr("leaderboard.__main__.SPLITS", splits)
    agent_path = onnx_agents.write(tmp_path, 0)
    words = [
        "run",
        "--results",
        str(tmp_path / "results"),
        "--splits",
        "--draws",
        "2",
        "--split-draws",
        "2",
        "--policies",
        "fixed_tuned",
    ]
    assert main([*words, "--agents", str(agent_path)]) == 0
    for name in splits:
        result = read_result(tmp_path / "results" / "RoughTurning-v0" / name / "fixed_tuned.json.xz")
        assert result.policy.made_for == MadeFor.of(Scenario.load("rough_turning"))
    shown = capsys.readouterr().out
    table = shown[shown.index("return [s] of policies made for rough_turning") :].splitlines()
    assert table[2].split() == ["policy", "rough_turning", *splits]
    assert table[3].split()[0] == "fixed_tuned"
    html = (tmp_path / "results" / "index.html").read_text("utf-8")
    assert "Where they were not made for" in html
    assert "--scenario rough_turning --splits --split-draws 2" in html
    assert main(["run", "--results", str(tmp_path), "--env", "RoughTurning-Shift-v0", "--splits", "--policies"]) == 2
    assert "no splits of RoughTurning-Shift-v0" in capsys.readouterr().err


def test_machines_are_told_all_numbers_and_nothing_else(
    tmp_path: Path, scenario: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario.save(tmp_path / "short.toml")
    results = ["--results", str(tmp_path / "results"), "--json"]
    words = ["--scenario", str(tmp_path / "short.toml"), "--draws", "2", "--policies", "fixed_handbook", "grid_search"]
    assert main(["run", *results, *words]) == 0
    printed = capsys.readouterr()
    assert printed.err.endswith(f"wrote {tmp_path / 'results' / 'index.html'}\n")
    told = json.loads(printed.out)
    (board,) = told["boards"]
    assert (board["env_id"], board["scenario"], len(board["draws"])) == ("RoughTurning-v0", "rough_turning", 2)
    ranked = read_board(tmp_path / "results" / "RoughTurning-v0" / "rough_turning").standings
    assert [standing["name"] for standing in board["standings"]] == [standing.name for standing in ranked]
    first = board["standings"][0]
    assert first["mean_return"]["value"] == ranked[0].mean_return.value
    assert first.keys() - told["units"].keys() == {
        "name", "kind", "description", "training_seeds", "feasible", "best_rule"
    }  # fmt: skip
    assert told["units"].keys() < first.keys()
    assert main(["show", *results]) == 0
    assert json.loads(capsys.readouterr().out) == told


def test_command_line(tmp_path: Path, scenario: Scenario, capsys: pytest.CaptureFixture[str]) -> None:
    scenario.save(tmp_path / "short.toml")
    results = tmp_path / "results"
    common = ["--results", str(results)]
    played = ["run", *common, "--scenario", str(tmp_path / "short.toml"), "--draws", "3", "--policies"]
    assert main([*played, "fixed_handbook", "grid_search"]) == 0
    shown = capsys.readouterr().out
    assert "wrote" in shown
    assert "fixed_handbook" in shown
    page = (results / "index.html").read_text()
    (results / "index.html").unlink()
    assert main(["show", *common]) == 0
    assert capsys.readouterr().out.splitlines() == shown.splitlines()[:-1]
    assert main(["page", *common]) == 0
    assert (results / "index.html").read_text() == page
    assert main(["page", *common, "--out", str(tmp_path / "site" / "page.html")]) == 0
    assert (tmp_path / "site" / "page.html").read_text() == page
    assert main(["figure", *common, "--out", str(tmp_path / "figures" / "board.png")]) == 0
    assert (tmp_path / "figures" / "board.png").read_bytes().startswith(b"\x89PNG")


def test_scenarios_live_side_by_side(tmp_path: Path, scenario: Scenario, capsys: pytest.CaptureFixture[str]) -> None:
    results = ["--results", str(tmp_path / "results")]
    files = {name: str(tmp_path / f"{name}.toml") for name in ("rough_turning", "short", "other")}
    for name, file in files.items():
        scenario.model_copy(update={"name": name}).save(file)
        played = ["--scenario", file, "--draws", "2", "--policies", "fixed_handbook"]
        assert main(["run", *results, *played, *(["grid_search"] if name == "short" else [])]) == 0
    capsys.readouterr()
    assert main(["show", *results]) == 0
    shown = [line.split(", ")[1] for line in capsys.readouterr().out.splitlines() if line.startswith("RoughTurning-v0")]
    assert shown == ["scenario rough_turning", "scenario other", "scenario short"]
    page = (tmp_path / "results" / "index.html").read_text()
    assert page.count("<h2>") == 3
    picture = ["--out", str(tmp_path / "board.png")]
    assert main(["figure", *results, *picture, "--scenario", files["short"]]) == 0
    assert main(["figure", *results, *picture]) == 2
    assert "RoughTurning-v0 on scenario rough_turning" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show"], "holds no results yet"),
        (["page"], "holds no results yet"),
        (["figure"], "holds no results"),
        (["run", "--policies", "nonsense"], "no policy is called nonsense"),
        (["run", "--policies"], "nothing to play"),
        (["run", "--scenario", "nonsense"], "nonsense"),
    ],
)
def test_bad_input_gets_a_message(tmp_path: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*arguments, "--results", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("draws", ["0", "many"])
def test_draws_must_be_a_number(draws: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["run", "--draws", draws])
    assert "--draws" in capsys.readouterr().err


def test_an_interruption_is_no_traceback(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("leaderboard.__main__.read_boards", interrupted)
    assert main(["show"]) == 130
    assert "interrupted" in capsys.readouterr().err
