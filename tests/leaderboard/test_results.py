"""Result files come back bit for bit, and nothing else comes back."""

import json
import lzma
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leaderboard.board import read_board, read_boards
from leaderboard.result import (
    Result,
    ResultError,
    Task,
    read_part,
    read_result,
    result_files,
    result_folder,
    result_path,
    write_part,
)
from tests.leaderboard.conftest import MakeResult, record_of


def _written(result: Result, folder: Path) -> Path:
    path = result_path(folder, result.policy)
    write_part(result, path)
    return path


def test_round_trip_is_exact(make_result: MakeResult, folder: Path) -> None:
    result = make_result("rule", **{"return": [math.pi, 1 / 3, 5e-324, -0.0], "wear": [1e22 / 7, 0.1, 0.2, 0.30000000000000004]})
    back = read_result(_written(result, folder))
    assert back == result
    for name, values in result.episodes.items():
        assert [value.hex() for value in back.episodes[name]] == [value.hex() for value in values]
    assert back.task.scenario.digest() == back.digests.scenario


def test_agents_have_a_file_per_training_seed(make_result: MakeResult, folder: Path) -> None:
    assert _written(make_result("ppo", 3), folder).name == "ppo-seed3.json.xz"


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (["schema"], "rough-turning/results/0", r"schema: 'rough-turning/results/0' is not allowed.*rough-turning/results/3"),
        (["mood"], 1, r"mood: 1 is not allowed: Extra inputs"),
        (["policy", "kind"], "oracle", r"policy.kind: 'oracle' is not allowed"),
        (["policy", "training_seed"], 1, r"training_seed is 1"),
        (["policy", "name"], "trajectories", r"policy.name: 'trajectories' is not allowed"),
        (["policy", "name"], "../up", r"policy.name: '../up' is not allowed"),
        (["task", "scenario", "limits", "power"], -1.0, r"task.scenario.limits.power: -1.0 is not allowed: .*0.001"),
        (["task", "draws"], [1, 2, 3], r"holds 4 values, but there are 3 draws"),
        (["task", "draws"], [1, 2, 3, 4], r"digests do not match"),
        (["versions", "rough-turning"], "0.0.0", r"digests do not match"),
        (["digests", "code"], "0" * 64, r"digests do not match"),
        (["episodes", "return"], [0.0, 0.0, float("nan"), 0.0], r"episodes.return.2: nan is not allowed"),
        (["episodes", "return"], ["0", 0.0, 0.0, 0.0], r"episodes.return.0: '0' is not allowed"),
        (["episodes", "luck"], [0.0, 0.0, 0.0, 0.0], r"episodes holds .*luck"),
    ],
)
def test_errors_name_file_field_and_value(
    make_result: MakeResult, folder: Path, where: list[str], value: Any, message: str
) -> None:
    path = _written(make_result("rule"), folder)
    document = json.loads(lzma.decompress(path.read_bytes()))
    section = document
    for key in where[:-1]:
        section = section[key]
    section[where[-1]] = value
    path.write_bytes(lzma.compress(json.dumps(document).encode()))
    with pytest.raises(ResultError, match=r"rule\.json\.xz: .*" + message):
        read_result(path)


@pytest.mark.parametrize("content", [b"", b"{", *map(lzma.compress, (b"", b"{", b"[]", b"[" * 100_000, b"\xff\xfe", b'"text"'))])
def test_foreign_files_are_named(folder: Path, content: bytes) -> None:
    folder.mkdir(parents=True)
    (folder / "foreign.json.xz").write_bytes(content)
    with pytest.raises(ResultError, match=r"foreign\.json\.xz"):
        read_board(folder)


def test_a_file_must_be_where_its_policy_says(make_result: MakeResult, folder: Path) -> None:
    path = _written(make_result("rule"), folder)
    copy = path.with_name("copy.json.xz")
    copy.write_bytes(path.read_bytes())
    with pytest.raises(ResultError, match=r"copy\.json\.xz: policy is 'rule'"):
        read_board(folder)
    elsewhere = folder.parents[1] / "Other-v0" / folder.name
    elsewhere.mkdir(parents=True)
    copy.rename(elsewhere / "rule.json.xz")
    with pytest.raises(ResultError, match=r"task\.env_id is 'RoughTurning-v0', but the folder is of 'Other-v0'"):
        read_board(elsewhere)
    other_scenario = elsewhere.rename(folder.with_name("other"))
    with pytest.raises(ResultError, match=r"rule\.json\.xz: task\.scenario\.name is 'rough_turning', .* is of 'other'"):
        read_board(other_scenario)


def test_results_on_different_tasks_are_not_ranked_together(make_result: MakeResult, task: Task, folder: Path) -> None:
    mine = make_result("mine")
    other_task = task.model_copy(update={"draws": [1, 2, 3, 4]})
    episodes = {name: np.array(values) for name, values in mine.episodes.items()}
    other = Result.of(other_task, record_of("other"), episodes)
    _written(mine, folder)
    path = _written(other, folder)
    last = read_board(folder)
    assert [standing.name for standing in last.standings] == ["other"]
    assert last.left_out == [folder / "mine.json.xz"]
    board = read_board(folder, mine.digests.task)
    assert [standing.name for standing in board.standings] == ["mine"]
    assert board.left_out == [path]


def test_results_of_different_code_are_not_ranked_together(
    make_result: MakeResult, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _written(make_result("old"), folder)
    monkeypatch.setattr("leaderboard.results.code_digest", lambda: "0" * 64)
    assert [standing.name for standing in read_board(folder).standings] == ["old"]
    _written(make_result("new"), folder)
    board = read_board(folder)
    assert [standing.name for standing in board.standings] == ["new"]
    assert board.left_out == [folder / "old.json.xz"]


def test_boards_come_in_the_order_of_ids_and_then_of_scenarios(tmp_path: Path, make_result: MakeResult, task: Task) -> None:
    results = tmp_path / "results"
    mine = make_result("mine")
    boards = [
        ("RoughTurning-v0", "rough_turning"),
        ("RoughTurning-v0", "forging"),
        ("RoughTurning-v0", "welded"),
        ("RoughTurning-Paper-v0", "paper"),
        ("RoughTurning-Paper-v0", "casting"),
        ("Another-v0", "casting"),
    ]
    for env_id, name in reversed(boards):
        scenario = task.scenario.model_copy(update={"name": name})
        other = mine.model_copy(update={"task": task.model_copy(update={"env_id": env_id, "scenario": scenario})})
        _written(other, result_folder(results, env_id, name))
    (results / "RoughTurning-v0" / "empty").mkdir()
    (results / "RoughTurning-v0" / "astray.json.xz").write_text("{")
    found = read_boards(results, {})
    assert [(board.task.env_id, board.task.scenario.name) for board in found] == boards


def test_no_results_say_how_to_make_some(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="leaderboard run"):
        read_boards(tmp_path / "nowhere", {})


def test_nothing_is_left_of_a_write_that_fails(make_result: MakeResult, folder: Path) -> None:
    folder.parent.mkdir(parents=True)
    folder.write_text("a file where the folder should be")
    with pytest.raises(ResultError, match=r"rule\.json\.xz cannot be written: "):
        _written(make_result("rule"), folder)


def test_a_broken_write_leaves_the_old_file(make_result: MakeResult, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _written(make_result("rule"), folder)

    def full(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(ResultError, match="No space left"):
        _written(make_result("rule", wear=1.0), folder)
    assert read_part(Result, path).episodes["wear"] == [0.0] * 4


def test_what_a_killed_write_left_is_no_result(make_result: MakeResult, folder: Path) -> None:
    path = _written(make_result("rule"), folder)
    (folder / ".partial-1-other.json.xz").write_text("{")
    assert result_files(folder) == [path]
