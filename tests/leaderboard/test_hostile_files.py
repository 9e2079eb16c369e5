"""Files that a stranger puts into folders of results and agents are read, or refused by name.

No reader waits for ever, fills the memory or ends in a traceback.
"""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from leaderboard.__main__ import main
from leaderboard.policies import SUMS, agent_files
from leaderboard.result import MANIFEST_FILE, PACK_FILE, TRAJECTORIES_FILE, Task, write_manifest
from leaderboard.result import write_result as write
from tests.leaderboard.conftest import MakeResult

Place = Callable[[Path], object]


def to_zero(path: Path) -> None:
    path.symlink_to("/dev/zero")


ODD_FILES: dict[str, Place] = {"pipe": os.mkfifo, "device": to_zero, "folder": Path.mkdir}


@pytest.fixture
def board(make_result: MakeResult, task: Task, folder: Path) -> Path:
    """A folder with one result and its manifest."""
    write(make_result("one"), folder)
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
