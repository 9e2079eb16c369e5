"""Files that a stranger puts into folders of results and agents are read, or refused by name.

No reader waits for ever, fills the memory or ends in a traceback.
"""

import json
import lzma
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from leaderboard.__main__ import main
from leaderboard.policies import SUMS, agent_files
from leaderboard.result import (
    MANIFEST_FILE,
    PACK_FILE,
    TRAJECTORIES_FILE,
    ResultError,
    Task,
    read_file,
    read_results,
    write_manifest,
    write_result,
)
from tests.leaderboard.conftest import MakeResult

ROOT = Path(__file__).parents[2]
Place = Callable[[Path], object]


def to_zero(path: Path) -> None:
    path.symlink_to("/dev/zero")


ODD_FILES: dict[str, Place] = {"pipe": os.mkfifo, "device": to_zero, "folder": Path.mkdir}


@pytest.fixture
def board(make_result: MakeResult, task: Task, folder: Path) -> Path:
    """A folder with one result and its manifest."""
    write_result(make_result("one"), folder)
    write_manifest(folder, task)
    return folder


@pytest.mark.parametrize("kind", ODD_FILES)
@pytest.mark.parametrize("name", ["two.json.xz", PACK_FILE, TRAJECTORIES_FILE, MANIFEST_FILE])
def test_what_is_no_regular_file_is_refused_by_name(
    name: str, kind: str, board: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (board / name).unlink(missing_ok=True)
    ODD_FILES[kind](board / name)
    results = ["--results", str(board.parents[1])]
    assert main(["show", *results]) == 0
    printed = capsys.readouterr()
    assert "one" in printed.out
    assert f"{board / name} cannot be read: is a folder, a pipe or a device" in printed.err
    assert main(["verify", "--check", *results, "--agents", str(board)]) == 1


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_agents_and_memory_that_are_no_regular_files_are_refused_by_name(
    kind: str, board: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    agents = tmp_path / "agents"
    agents.mkdir()
    for name in ("odd.onnx", SUMS):
        ODD_FILES[kind](agents / name)
    ODD_FILES[kind](tmp_path / "memory")
    folders = ["--results", str(board.parents[1]), "--agents", str(agents)]
    assert main(["verify", "--check", *folders]) == 1
    complaints = capsys.readouterr().out
    for name in ("odd.onnx", SUMS):
        assert f"{agents / name}: is left out" in complaints
    assert main(["verify", *folders, "--memory", str(tmp_path / "memory")]) == 2
    assert f"{tmp_path / 'memory'} cannot be read" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    [
        "nonsense",
        "0" * 64,
        "0" * 64 + "  /etc/x/y.onnx",
        "0" * 64 + "  ../../up.onnx",
        "0" * 64 + "  ID/SCENARIO/no_agent.txt",
    ],
)
def test_a_list_of_agents_names_nothing_outside_its_folder(line: str, tmp_path: Path) -> None:
    (tmp_path / SUMS).write_text(f"{'1' * 64}  ID/scenario/ppo-seed0.onnx\n{line}\n")
    complaints: list[str] = []
    files = agent_files(tmp_path, complaints.append)
    assert list(files) == ["1" * 64]
    (complaint,) = complaints
    assert complaint.startswith(f"{tmp_path / SUMS}: line 2 is left out")


def damaged(path: Path, change: Callable[[Any], None]) -> None:
    """Change the content of a file of results."""
    content = json.loads(lzma.decompress(path.read_bytes()))
    change(content)
    path.write_bytes(lzma.compress(json.dumps(content).encode(), preset=0))


TOO_LONG: dict[str, Callable[[Any], None]] = {
    "policy.description": lambda result: result["policy"].update(description="x" * 10_001),
    "policy.command": lambda result: result["policy"].update(command="x" * 10_001),
    "policy.parameters": lambda result: result["policy"].update(parameters={"x": "y" * 100_000}),
    "policy.sha256": lambda result: result["policy"].update(sha256="0" * 65),
    "policy.tuned_for.digest": lambda result: result["policy"].update(
        tuned_for={"name": "shift", "digest": "0" * 65}
    ),
    "versions": lambda result: result.update(versions={f"p{n}": "1" for n in range(21)}),
    "versions.numpy": lambda result: result["versions"].update(numpy="1" * 101),
    "checksum": lambda result: result.update(checksum="0" * 65),
}


@pytest.mark.parametrize("field", TOO_LONG)
def test_a_text_of_a_result_has_a_largest_length(field: str, board: Path) -> None:
    path = board / "one.json.xz"
    damaged(path, lambda content: TOO_LONG[field](content["results"][0]))
    with pytest.raises(ResultError, match=rf"results\.0\.{field}") as refusal:
        read_file(path)
    assert len(str(refusal.value)) < 1_000


@pytest.mark.slow
def test_results_of_a_folder_have_a_largest_size_together(
    make_result: MakeResult, board: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    padding = b" " * 60_000_000
    for name in ("a", "b"):
        write_result(make_result(name), board)
        path = board / f"{name}.json.xz"
        content = lzma.decompress(path.read_bytes())
        path.write_bytes(lzma.compress(content + padding, preset=0))
    complaints: list[str] = []
    assert set(read_results(board, complaints.append)) == {"a", "b"}
    (complaint,) = complaints
    assert complaint.startswith(f"{board / 'one.json.xz'} is not read")


REFUSED_CONTENT = {
    "no JSON": lzma.compress(b" " * 60_000_000, preset=0),
    "no results": lzma.compress(b"[" + b" " * 60_000_000 + b"]", preset=0),
    "cut off": lzma.compress(b" " * 60_000_000, preset=0)[:-5],
}


@pytest.mark.slow
@pytest.mark.parametrize("content", REFUSED_CONTENT.values(), ids=REFUSED_CONTENT)
def test_files_that_are_refused_count_towards_the_largest_size(content: bytes, board: Path) -> None:
    for name in ("a", "b"):
        (board / f"{name}.json.xz").write_bytes(content)
    complaints: list[str] = []
    assert not read_results(board, complaints.append)
    assert complaints[-1].startswith(f"{board / 'one.json.xz'} is not read")


def test_files_that_are_refused_count_towards_the_largest_number(board: Path) -> None:
    for number in range(501):
        (board / f"a{number}.json.xz").write_bytes(b"")
    complaints: list[str] = []
    assert not read_results(board, complaints.append)
    assert complaints[-1].startswith(f"{board / 'one.json.xz'} is not read")


def test_a_policy_that_is_listed_twice_is_refused_by_name(board: Path) -> None:
    path = board / "one.json.xz"
    damaged(path, lambda content: content.update(results=content["results"] * 2))
    with pytest.raises(ResultError, match=r"one\.json\.xz: .*more than one result of one"):
        read_file(path)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (lzma.compress(b" " * 100_000_001, preset=0), "holds more than 100000000 bytes"),
        (lzma.compress(b"{}")[:-5], "ends too early"),
        (lzma.compress(b"{}") * 2, "bytes follow its end"),
        (
            lzma.compress(
                b"{}", filters=[{"id": lzma.FILTER_LZMA2, "preset": 0, "dict_size": 1 << 30}]
            ),
            "[Mm]emory",
        ),
    ],
    ids=["large", "cut off", "two", "dictionary"],
)
def test_a_compressed_file_that_asks_for_much_is_refused(
    content: bytes, complaint: str, board: Path
) -> None:
    path = board / "one.json.xz"
    path.write_bytes(content)
    with pytest.raises(ResultError, match=rf"one\.json\.xz cannot be read: .*{complaint}"):
        read_file(path)


@pytest.mark.slow
def test_a_name_that_is_not_utf_8_is_printed_escaped(board: Path, tmp_path: Path) -> None:
    results = tmp_path / os.fsdecode(b"r\xff")
    board.parents[1].rename(results)
    command = [sys.executable, "-m", "leaderboard", "page", "--results", str(results)]
    ended = subprocess.run(
        command,
        cwd=ROOT,
        env=os.environ | {"PYTHONIOENCODING": "utf-8"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert r"r\udcff/index.html" in ended.stdout
    assert (results / "index.html").is_file()


def test_a_task_without_seeds_is_refused_by_name(board: Path) -> None:
    path = board / "one.json.xz"

    def remove_seeds(content: Any) -> None:
        content["task"]["seeds"] = []
        episodes = content["results"][0]["episodes"]
        content["results"][0]["episodes"] = {name: [] for name in episodes}

    damaged(path, remove_seeds)
    with pytest.raises(ResultError, match=r"one\.json\.xz: task: .*seeds must hold a seed or more"):
        read_file(path)


def test_a_file_has_a_largest_number_of_results(board: Path) -> None:
    path = board / "one.json.xz"
    damaged(path, lambda content: content.update(results=content["results"] * 501))
    with pytest.raises(ResultError, match=r"one\.json\.xz: results: .* at most 500 items"):
        read_file(path)


def test_a_private_key_that_is_no_text_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["run", "--private-key", os.fsdecode(b"\xff" * 20)])
    assert "must consist of printable characters" in capsys.readouterr().err
