"""Strangers' files: one that is refused stops no other, and none takes another's name or place."""

from pathlib import Path

import numpy as np
import pytest

from leaderboard.__main__ import main
from leaderboard.ranking import read_leaderboard
from leaderboard.result import result_folder
from tests.leaderboard.agents import onnx_agents
from tests.leaderboard.conftest import ENV_ID, only

SHORT = onnx_agents.SCENARIO
pytestmark = pytest.mark.slow  # plays agents in processes of their own

ACTING = "nothing = ReduceSum(first, axes) zero = Mul(nothing, none) change = Add(zero, constant)"
HOSTILE_NAMES = {
    "slash": "../rival",
    "dot": ".",
    "empty": "",
    "long": 10_000 * "a",
    "escape": "a\x1b[2J",
    "unicode": "a\u202eb",
}


def acting(value: float) -> bytes:
    """Return an agent that always acts by ten times a value."""
    constant = np.full((1, 2), 10.0 * value, np.float32)
    none = np.float32([0.0])
    return onnx_agents.of_load(
        ACTING,
        axes=onnx_agents.AXES,
        none=none,
        constant=constant,
    )


@pytest.fixture
def words(tmp_path: Path) -> list[str]:
    """A run of a rule and of the agents that follow."""
    SHORT.save(tmp_path / "short.toml")
    where = ["--scenario", str(tmp_path / "short.toml"), "--results", str(tmp_path / "results")]
    return ["run", *where, "--seeds", "2", "--policies", "fixed_handbook", "--agents"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return result_folder(tmp_path / "results", ENV_ID, SHORT.name)


def write(path: Path, content: bytes) -> Path:
    """Write a file and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def test_files_that_are_refused_stop_no_other(
    words: list[str], tmp_path: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = onnx_agents.content()
    contents = {
        "garbage": b"garbage",
        "not_finite": acting(float("nan")),
        "too_large": acting(2.0),
        "operator": onnx_agents.of_load("change = Sin(first)"),
        "seed": onnx_agents.stating(good, seed="1" + 300 * "0"),
        "bad name": good,
        "unic\u00f6de": good,
    }
    for name, stated in HOSTILE_NAMES.items():
        contents[name] = onnx_agents.stating(good, name=stated)
    paths = [write(tmp_path / f"{name}.onnx", content) for name, content in contents.items()]
    link = tmp_path / "link.onnx"
    link.symlink_to(paths[0])
    folder_with_suffix = tmp_path / "folder.onnx"
    folder_with_suffix.mkdir()
    missing = tmp_path / "missing.onnx"
    too_long = Path("long" + 300 * "g" + ".onnx")
    paths += [missing, folder_with_suffix, link, too_long]
    team = write(tmp_path / "team.onnx", good)
    assert main([*words, *map(str, paths), str(team)]) == 2
    errors = capsys.readouterr().err
    for path in paths:
        assert f"- no agent can be loaded from {path}: " in errors
    assert "\x1b" not in errors
    names = {standing.name for standing in read_leaderboard(folder).standings}
    assert names == {"fixed_handbook", "team"}
    assert (tmp_path / "results" / "index.html").exists()


@pytest.fixture
def rival(words: list[str], tmp_path: Path) -> Path:
    """The file of a rival, who has a result."""
    path = write(tmp_path / "rival.onnx", onnx_agents.content())
    assert main([*words, str(path)]) == 0
    return path


def test_a_result_is_named_after_the_file_and_not_after_what_the_file_states(
    words: list[str], tmp_path: Path, folder: Path, rival: Path
) -> None:
    before = (folder / "rival-seed0.json.xz").read_bytes()
    stating_the_rival = onnx_agents.stating(onnx_agents.content(seed=1), name="rival", seed="0")
    thief = write(tmp_path / "thief-seed4.onnx", stating_the_rival)
    assert main([*words, str(thief), str(rival)]) == 0
    assert (folder / "rival-seed0.json.xz").read_bytes() == before
    policy = only(folder / "thief-seed4.json.xz").policy
    assert policy.name == "thief"
    assert policy.training_seed == 4
    assert "rival" in policy.description


def test_another_file_of_the_same_name_is_refused_until_it_may_replace_the_result(
    words: list[str],
    tmp_path: Path,
    folder: Path,
    rival: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = (folder / "rival-seed0.json.xz").read_bytes()
    again = write(tmp_path / "again" / rival.name, onnx_agents.content(seed=2))
    assert main([*words, str(again)]) == 2
    assert "--replace" in capsys.readouterr().err
    assert (folder / "rival-seed0.json.xz").read_bytes() == before
    assert main([*words, str(again), "--replace"]) == 0
    assert (folder / "rival-seed0.json.xz").read_bytes() != before


def test_files_of_one_name_are_distinguished_by_their_folders(
    words: list[str], tmp_path: Path, folder: Path
) -> None:
    red = write(tmp_path / "red" / "agent.onnx", onnx_agents.content(seed=0))
    blue = write(tmp_path / "blue" / "agent.onnx", onnx_agents.content(seed=1))
    alone = write(tmp_path / "alone.onnx", onnx_agents.content(seed=3))
    assert main([*words, str(red), str(blue), str(alone), str(alone)]) == 0
    names = {standing.name for standing in read_leaderboard(folder).standings}
    assert names == {"fixed_handbook", "red_agent", "blue_agent", "alone"}


def test_of_files_in_folders_of_one_name_only_the_first_plays(
    words: list[str], tmp_path: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = write(tmp_path / "0" / "team" / "agent.onnx", onnx_agents.content(seed=4))
    second = write(tmp_path / "1" / "team" / "agent.onnx", onnx_agents.content(seed=5))
    assert main([*words, str(first), str(second)]) == 2
    assert "is team_agent-seed0 too" in capsys.readouterr().err
    assert only(folder / "team_agent-seed0.json.xz").policy.name == "team_agent"
