"""Result files come back bit for bit, are found by their meaning, and are refused when damaged."""

import json
import lzma
from pathlib import Path
from typing import Any

import pytest

from leaderboard import verify
from leaderboard.__main__ import main
from leaderboard.ranking import read_leaderboard, read_leaderboards
from leaderboard.result import (
    MANIFEST_FILE,
    Manifest,
    Result,
    ResultError,
    Task,
    read_part,
    result_path,
    write_manifest,
    write_result,
)
from tests.leaderboard.conftest import MakeResult, only


def written(result: Result, folder: Path) -> Path:
    write_result(result, folder)
    return result_path(folder, result.policy)


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (
            ["schema"],
            "rough-turning/results/0",
            r"schema: 'rough-turning/results/0' is not allowed.*rough-turning/results/5",
        ),
        (
            ["results", 0, "policy", "name"],
            "../up",
            r"results.0.policy.name: '../up' is not allowed",
        ),
        (
            ["task", "scenario", "limits"],
            {"power": -1.0},
            r"task.scenario.limits.power: -1.0 is not allowed: .*0.001",
        ),
        (
            ["task", "seeds"],
            "3..1",
            r"task.seeds: '3..1' is not allowed: '3..1' is not a range of seeds",
        ),
        (["results", 0, "episodes", "return"], [0.0, 0.0, 1.0, 0.0], r"checksum does not match"),
        (
            ["results", 0, "episodes", "return"],
            [0.0, 0.0, float("nan"), 0.0],
            r"results.0.episodes.return.2: nan is not allowed",
        ),
        (["results", 0, "episodes", "luck"], [0.0, 0.0, 0.0, 0.0], r"episodes holds .*luck"),
    ],
)
def test_errors_name_file_and_value(
    make_result: MakeResult, folder: Path, where: list[Any], value: Any, message: str
) -> None:
    path = written(make_result("rule"), folder)
    document = json.loads(lzma.decompress(path.read_bytes()))
    section = document
    for key in where[:-1]:
        section = section[key]
    section[where[-1]] = value
    path.write_bytes(lzma.compress(json.dumps(document).encode()))
    with pytest.raises(ResultError, match=r"rule\.json\.xz: .*" + message):
        only(path)


@pytest.mark.parametrize(
    "place",
    [
        "RoughTurning-v0/rough_turning/copy",
        "Other-v0/rough_turning/rule",
        "RoughTurning-v0/other/rule",
    ],
)
def test_a_file_must_be_where_its_policy_says(
    make_result: MakeResult, folder: Path, place: str
) -> None:
    path = folder.parents[1] / f"{place}.json.xz"
    path.parent.mkdir(parents=True, exist_ok=True)
    written(make_result("rule"), folder).rename(path)
    with pytest.raises(
        ResultError, match=r"should be at RoughTurning-v0.rough_turning.rule\.json\.xz"
    ):
        only(path)


def test_the_manifest_or_else_most_results_decide_which_task_is_ranked(
    make_result: MakeResult, task: Task, folder: Path
) -> None:
    other_task = task.model_copy(update={"seeds": [1, 2, 3, 4]})
    mine = written(make_result("mine", **{"return": [1, 2, 3, 10 / 3]}), folder)
    for name in ("one", "two"):
        written(make_result(name, on=other_task), folder)
    most = read_leaderboard(folder)
    assert ({standing.name for standing in most.standings}, most.left_out) == (
        {"one", "two"},
        [str(folder / "mine")],
    )
    asked = read_leaderboard(folder, task)
    assert [standing.name for standing in asked.standings] == ["mine"]
    assert asked.left_out == [str(folder / "one"), str(folder / "two")]
    write_manifest(folder, task)
    assert read_leaderboard(folder) == asked
    ((name, entry),) = read_part(Manifest, folder / MANIFEST_FILE).results.items()
    assert (name, entry.return_, entry.sha256) == ("mine", 2.33333, only(mine).checksum)
    with pytest.raises(ResultError, match="holds no results on task"):
        read_leaderboard(folder, task.model_copy(update={"seeds": [5]}))


def test_keys_and_texts_of_a_pack_cannot_command_the_terminal(
    make_result: MakeResult, task: Task, folder: Path, capsys
) -> None:
    path = written(make_result("rule"), folder)
    write_manifest(folder, task)
    document = json.loads(lzma.decompress(path.read_bytes()))
    hostile = "\x1b[2Jforged\nline"
    for content in (
        document | {hostile: 1},
        document | {"schema": hostile},
        {"task": {hostile: hostile}, "results": []},
    ):
        path.write_bytes(lzma.compress(json.dumps(content).encode()))
        assert (
            main(
                ["verify", "--check", "--results", str(folder.parents[1]), "--agents", str(folder)]
            )
            == 1
        )
        assert main(["show", "--results", str(folder.parents[1])]) == 2
        told = capsys.readouterr()
        assert "\x1b" not in told.out + told.err
        assert not any(line.startswith("line") for line in (told.out + told.err).splitlines())
    with pytest.raises(ValueError, match="env_id"):
        Task.model_validate(dict(task) | {"env_id": hostile})


@pytest.mark.parametrize("name", ["broken.json.xz", "trajectories.json.xz", MANIFEST_FILE])
@pytest.mark.parametrize("content", ["{", "{}", "[" * 100_000])
def test_an_unusable_file_is_named_and_blocks_nothing(
    make_result, task, folder, name, content, capsys
) -> None:
    written(make_result("one"), folder)
    write_manifest(folder, task)
    lost = folder.with_name("lost") / "lost.json.xz"
    lost.parent.mkdir()
    for path in (folder / name, lost):
        path.write_text(content)
    (leaderboard,) = read_leaderboards(folder.parents[1])
    assert [standing.name for standing in leaderboard.standings] == ["one"]
    told = capsys.readouterr().err
    assert f"skipped: {folder / name}" in told
    assert f"skipped: {lost}" in told
    assert "python -m leaderboard run" in told
    (complaint,) = [
        each
        for each in verify.check(folder.parents[1], Path(), verify.Selection())
        if str(lost) in each
    ]
    assert "cannot be read" in complaint
    write_manifest(folder, task)
    assert set(read_part(Manifest, folder / MANIFEST_FILE).results) == {"one"}
