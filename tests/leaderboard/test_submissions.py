"""Strangers' files: one that is refused stops no other, and none takes another's name or place."""

from pathlib import Path

import numpy as np
import pytest

from leaderboard.__main__ import main
from leaderboard.ranking import read_leaderboard
from leaderboard.result import result_folder
from tests.leaderboard.conftest import ENV_ID, only
from tests.train import onnx_agents

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
    return onnx_agents.of_load(
        ACTING, axes=onnx_agents.AXES, none=np.float32([0.0]), constant=constant
    )


@pytest.fixture
def words(tmp_path: Path) -> list[str]:
    SHORT.save(tmp_path / "short.toml")
    where = ["--scenario", str(tmp_path / "short.toml"), "--results", str(tmp_path / "results")]
    return ["run", *where, "--seeds", "2", "--policies", "fixed_handbook", "--agents"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return result_folder(tmp_path / "results", ENV_ID, SHORT.name)


def write(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def test_files_that_are_refused_stop_no_other(
    words: list[str], tmp_path: Path, folder: Path, capsys
) -> None:
    good = onnx_agents.content()
    refused = {
        "garbage": b"garbage",
        "not_finite": acting(float("nan")),
        "too_large": acting(2.0),
        "operator": onnx_agents.of_load("change = Sin(first)"),
        "seed": onnx_agents.stating(good, seed="1" + 300 * "0"),
        "bad name": good,
        "unic\u00f6de": good,
    }
    refused |= {
        name: onnx_agents.stating(good, name=stated) for name, stated in HOSTILE_NAMES.items()
    }
    paths = [write(tmp_path / f"{name}.onnx", content) for name, content in refused.items()]
    (tmp_path / "link.onnx").symlink_to(paths[0])
    (tmp_path / "folder.onnx").mkdir()
    paths += [
        tmp_path / "missing.onnx",
        tmp_path / "folder.onnx",
        tmp_path / "link.onnx",
        Path("long" + 300 * "g" + ".onnx"),
    ]
    team = write(tmp_path / "team.onnx", good)
    assert main([*words, *map(str, paths), str(team)]) == 2
    told = capsys.readouterr()
    for path in paths:
        assert f"- no agent can be loaded from {path}: " in told.err
    assert "\x1b" not in told.err
    assert {each.name for each in read_leaderboard(folder).standings} == {"fixed_handbook", "team"}
    assert (tmp_path / "results" / "index.html").exists()


def test_a_result_is_named_after_the_file_and_not_after_what_the_file_states(
    words, tmp_path, folder, capsys
) -> None:
    rival = write(tmp_path / "rival.onnx", onnx_agents.content())
    assert main([*words, str(rival)]) == 0
    before = (folder / "rival-seed0.json.xz").read_bytes()
    thief = write(
        tmp_path / "thief-seed4.onnx",
        onnx_agents.stating(onnx_agents.content(seed=1), name="rival", seed="0"),
    )
    assert main([*words, str(thief), str(rival)]) == 0
    assert (folder / "rival-seed0.json.xz").read_bytes() == before
    policy = only(folder / "thief-seed4.json.xz").policy
    assert (policy.name, policy.training_seed) == ("thief", 4)
    assert "rival" in policy.description
    # Another file of the rival's name is refused, until it may replace the result.
    again = write(tmp_path / "again" / "rival.onnx", onnx_agents.content(seed=2))
    assert main([*words, str(again)]) == 2
    assert "--replace" in capsys.readouterr().err
    assert (folder / "rival-seed0.json.xz").read_bytes() == before
    assert main([*words, str(again), "--replace"]) == 0
    assert (folder / "rival-seed0.json.xz").read_bytes() != before


def test_files_of_one_name_are_told_apart_by_their_folders(words, tmp_path, folder, capsys) -> None:
    paths = [
        write(tmp_path / team / "agent.onnx", onnx_agents.content(seed=seed))
        for seed, team in enumerate(("red", "blue"))
    ]
    alone = write(tmp_path / "alone.onnx", onnx_agents.content(seed=3))
    assert main([*words, *map(str, paths), str(alone), str(alone)]) == 0
    assert {each.name for each in read_leaderboard(folder).standings} == {
        "fixed_handbook",
        "red_agent",
        "blue_agent",
        "alone",
    }
    # Folders that tell nothing apart: the first file plays, the other is refused.
    same = [
        write(tmp_path / str(place) / "team" / "agent.onnx", onnx_agents.content(seed=4 + place))
        for place in range(2)
    ]
    assert main([*words, *map(str, same)]) == 2
    assert "is team_agent-seed0 too" in capsys.readouterr().err
    assert only(folder / "team_agent-seed0.json.xz")
