"""Result files come back bit for bit, are found by their meaning, and are refused when damaged."""

import json
import lzma
from pathlib import Path
from typing import Any, NamedTuple

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


def content_of(path: Path) -> Any:
    return json.loads(lzma.decompress(path.read_bytes()))


def damage(path: Path, content: object) -> None:
    """Write another content into a file of results."""
    path.write_bytes(lzma.compress(json.dumps(content).encode()))


class Fault(NamedTuple):
    """A value that a file of results must not hold, and a part of the complaint."""

    keys: list[str | int]  # of the value in the file
    value: object
    message: str


FAULTS = {
    "schema": Fault(
        ["schema"],
        "rough-turning/results/0",
        r"schema: 'rough-turning/results/0' is not allowed.*rough-turning/results/5",
    ),
    "name": Fault(
        ["results", 0, "policy", "name"],
        "../up",
        r"results.0.policy.name: '../up' is not allowed",
    ),
    "scenario": Fault(
        ["task", "scenario", "limits"],
        {"power": -1.0},
        r"task.scenario.limits.power: -1.0 is not allowed: .*0.001",
    ),
    "seeds": Fault(
        ["task", "seeds"],
        "3..1",
        r"task.seeds: '3..1' is not allowed: '3..1' is not a range of seeds",
    ),
    "another return": Fault(
        ["results", 0, "episodes", "return"],
        [0.0, 0.0, 1.0, 0.0],
        r"checksum does not match",
    ),
    "no number": Fault(
        ["results", 0, "episodes", "return"],
        [0.0, 0.0, float("nan"), 0.0],
        r"results.0.episodes.return.2: nan is not allowed",
    ),
    "unknown field": Fault(
        ["results", 0, "episodes", "luck"],
        [0.0, 0.0, 0.0, 0.0],
        r"episodes holds .*luck",
    ),
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_errors_name_file_and_value(make_result: MakeResult, folder: Path, fault: Fault) -> None:
    path = written(make_result("rule"), folder)
    content = content_of(path)
    *sections, field = fault.keys
    section = content
    for key in sections:
        section = section[key]
    section[field] = fault.value
    damage(path, content)
    with pytest.raises(ResultError, match=r"rule\.json\.xz: .*" + fault.message):
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
    written(make_result("mine"), folder)
    for name in ("one", "two"):
        written(make_result(name, on=other_task), folder)

    by_most_results = read_leaderboard(folder)
    assert {standing.name for standing in by_most_results.standings} == {"one", "two"}
    assert by_most_results.left_out == [str(folder / "mine")]

    by_task = read_leaderboard(folder, task)
    assert [standing.name for standing in by_task.standings] == ["mine"]
    assert by_task.left_out == [str(folder / "one"), str(folder / "two")]

    write_manifest(folder, task)
    assert read_leaderboard(folder) == by_task

    with pytest.raises(ResultError, match="holds no results on task"):
        read_leaderboard(folder, task.model_copy(update={"seeds": [5]}))


def test_a_manifest_sums_up_the_results_on_its_task(
    make_result: MakeResult, task: Task, folder: Path
) -> None:
    other_task = task.model_copy(update={"seeds": [1, 2, 3, 4]})
    path = written(make_result("mine", returns=[1, 2, 3, 10 / 3]), folder)
    written(make_result("on_another_task", on=other_task), folder)
    write_manifest(folder, task)
    entries = read_part(Manifest, folder / MANIFEST_FILE).results
    assert list(entries) == ["mine"]
    assert entries["mine"].return_ == 2.33333
    assert entries["mine"].sha256 == only(path).checksum


HOSTILE = "\x1b[2Jforged\nline"


@pytest.mark.parametrize(
    "change",
    [
        pytest.param({HOSTILE: 1}, id="key"),
        pytest.param({"schema": HOSTILE}, id="text"),
        pytest.param({"task": {HOSTILE: HOSTILE}, "results": []}, id="task"),
    ],
)
def test_a_file_of_results_cannot_command_the_terminal(
    change: dict[str, Any],
    make_result: MakeResult,
    task: Task,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = written(make_result("rule"), folder)
    write_manifest(folder, task)
    damage(path, content_of(path) | change)
    results = ["--results", str(folder.parents[1])]
    assert main(["verify", "--check", *results, "--agents", str(folder)]) == 1
    assert main(["show", *results]) == 2
    captured = capsys.readouterr()
    printed = captured.out + captured.err
    assert "rule.json.xz" in printed
    assert "\x1b" not in printed
    assert [line for line in printed.splitlines() if line.startswith("line")] == []


def test_a_hostile_id_is_refused(task: Task) -> None:
    with pytest.raises(ValueError, match="env_id"):
        Task.model_validate(dict(task) | {"env_id": HOSTILE})


@pytest.mark.parametrize("name", ["broken.json.xz", "trajectories.json.xz", MANIFEST_FILE])
@pytest.mark.parametrize("content", ["{", "{}", "[" * 100_000], ids=["cut off", "empty", "deep"])
def test_an_unusable_file_is_named_and_blocks_nothing(
    name: str,
    content: str,
    make_result: MakeResult,
    task: Task,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    written(make_result("one"), folder)
    write_manifest(folder, task)
    lost = folder.with_name("lost") / "lost.json.xz"
    lost.parent.mkdir()
    for path in (folder / name, lost):
        path.write_text(content)
    (leaderboard,) = read_leaderboards(folder.parents[1])
    assert [standing.name for standing in leaderboard.standings] == ["one"]
    notices = capsys.readouterr().err
    assert f"skipped: {folder / name}" in notices
    assert f"skipped: {lost}" in notices
    assert "python -m leaderboard run" in notices
    complaints = verify.check(folder.parents[1], Path(), verify.Selection())
    (about_lost,) = [complaint for complaint in complaints if str(lost) in complaint]
    assert "cannot be read" in about_lost
    write_manifest(folder, task)
    assert set(read_part(Manifest, folder / MANIFEST_FILE).results) == {"one"}
