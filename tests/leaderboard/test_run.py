"""Playing: what is played, what is resumed, what is refused, and the command line over all of it."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from baselines.play import play
from leaderboard import run
from leaderboard.__main__ import main
from leaderboard.results import ResultError, Task, read_part, read_result
from leaderboard.run import Contestant, play_all
from leaderboard.trajectories import Trajectories
from tests.leaderboard.conftest import Steady, contestant
from turning_env import Scenario


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The feed action of every policy that plays, in order."""
    actions: list[float] = []

    def watched(make, *arguments):
        actions.append(float(make(1)._actions[0, 1]))
        return play(make, *arguments)

    monkeypatch.setattr(run, "play", watched)
    return actions


def test_results_are_what_the_policies_do(task: Task, folder: Path) -> None:
    play_all(task, [contestant("slow"), contestant("quick", (0.0, 1.0))], folder, fresh=False)
    for name, action in (("slow", (0.0, 0.0)), ("quick", (0.0, 1.0))):
        result = read_result(folder / f"{name}.json")
        for field, values in play(lambda lanes, action=action: Steady(lanes, action), task.scenario, task.draws).items():
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
    recorded = read_part(Trajectories, folder / "trajectories.json")
    monkeypatch.setattr("leaderboard.results.code_digest", lambda: "0" * 64)
    play_all(task, contestants[:1], folder, fresh=False)
    assert played == pytest.approx([0.1, 0.2, 0.1])
    assert read_part(Trajectories, folder / "trajectories.json").task != recorded.task
    play_all(task, contestants, folder, fresh=False)
    assert played == pytest.approx([0.1, 0.2, 0.1, 0.2])


def test_an_interrupted_run_goes_on(task: Task, folder: Path, played: list[float]) -> None:
    def interrupted(lanes: int) -> Steady:
        raise KeyboardInterrupt

    second = contestant("two", (0, 0.2))
    with pytest.raises(KeyboardInterrupt):
        play_all(task, [contestant("one", (0, 0.1)), Contestant(second.policy, interrupted)], folder, fresh=False)
    assert [path.name for path in folder.iterdir()] == ["one.json"]
    play_all(task, [contestant("one", (0, 0.1)), second], folder, fresh=False)
    assert played == pytest.approx([0.1, 0.2])


def test_an_unreadable_file_is_played_again_or_else_named(task: Task, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    play_all(task, [contestant("one")], folder, fresh=False)
    (folder / "one.json").write_text("{")
    (folder / "trajectories.json").write_text("{")
    play_all(task, [contestant("one")], folder, fresh=False)
    assert "one.json cannot be read" in capsys.readouterr().err
    read_result(folder / "one.json")
    (folder / "foreign.json").write_text("{}")
    with pytest.raises(ResultError, match=r"foreign\.json"):
        play_all(task, [contestant("one")], folder, fresh=False)


def test_agents_that_cannot_be_ranked_are_refused_before_play(task: Task, folder: Path, played: list[float]) -> None:
    with pytest.raises(ResultError, match="ppo-seed0 and ppo-seed1 cannot be one policy"):
        play_all(task, [contestant("ppo", (0, 0.1), 0), contestant("ppo", (0, 0.2), 1)], folder, fresh=False)
    assert not played


def test_trajectories_are_of_one_draw_and_of_the_policies_to_compare(task: Task, folder: Path) -> None:
    names = ["fixed_tuned", "grid_search", "also", "best"]
    contestants = [contestant(name, (0.0, 0.1 * place)) for place, name in enumerate(names)]
    play_all(task, contestants, folder, fresh=False)
    recorded = read_part(Trajectories, folder / "trajectories.json")
    assert recorded.draw == task.draws[0]
    assert {"fixed_tuned", "grid_search"} < {episode.policy.name for episode in recorded.episodes}
    assert len(recorded.episodes) == 3
    assert recorded.episodes[0].series["minutes"] == pytest.approx(np.arange(1, 13) / 60, rel=1e-5)
    # A later run that lacks a policy keeps its trajectory.
    play_all(task, contestants[:1], folder, fresh=False)
    assert read_part(Trajectories, folder / "trajectories.json") == recorded


def test_rules_come_from_the_catalogue() -> None:
    scenario = Scenario()
    (handbook,) = run.rules(["fixed_handbook"], scenario)
    assert handbook.policy.kind == "rule"
    assert handbook.policy.parameters
    with pytest.raises(ResultError, match=r"no policy is called nonsense; there are .*grid_search"):
        run.rules(["grid_search", "nonsense"], scenario)


def test_agents_come_from_their_folders(tmp_path: Path, scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    def load(folder: Path) -> SimpleNamespace:
        if not folder.is_dir():
            raise ValueError(f"{folder} holds no training run")
        return SimpleNamespace(
            name="ppo",
            seed=int(folder.name[-1]),
            scenario=scenario,
            parameters={"gamma": 0.9},
            trained_intervals=1000,
            command="train",
            make=Steady,
        )

    monkeypatch.setitem(sys.modules, "train.agent", SimpleNamespace(load=load))
    monkeypatch.setattr("train.agent", SimpleNamespace(load=load), raising=False)
    for seed in (0, 1):
        (tmp_path / f"run{seed}").mkdir()
        (tmp_path / f"run{seed}" / "policy.zip").write_text(str(seed))
    first, second = run.agents([tmp_path / "run0", tmp_path / "run1"])
    assert (first.policy.label, second.policy.label) == ("ppo-seed0", "ppo-seed1")
    assert first.policy.digest != second.policy.digest
    (tmp_path / "run0" / "policy.zip").write_text("trained anew")
    assert run.agents([tmp_path / "run0"])[0].policy.digest != first.policy.digest
    with pytest.raises(ResultError, match="ppo-seed0, which another"):
        run.agents([tmp_path / "run0", tmp_path / "run0"])
    with pytest.raises(ResultError, match=r"nowhere.* holds no training run"):
        run.agents([tmp_path / "nowhere"])


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
    assert main(["figure", *results, *picture]) == 1
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
    assert main([*arguments, "--results", str(tmp_path)]) == 1
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
