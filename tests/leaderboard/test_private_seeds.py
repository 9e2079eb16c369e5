"""Private seeds: what a file of them may hold, and what results tell of them."""

import json
import secrets
from pathlib import Path

import numpy as np
import pytest

from leaderboard import verify
from leaderboard.__main__ import main
from leaderboard.private_seeds import private_task, read_seeds
from leaderboard.ranking import read_leaderboard
from leaderboard.result import Result, ResultError, Task
from leaderboard.run import TaskRun, play_all
from tests.leaderboard.conftest import MakeResult, only, spec
from turning_env import Scenario
from turning_env.files import digest_of
from turning_env.scoring.play import play

SEEDS = [2**64 - 1, 0, 12345678901234567890, 5]
TEXT = "# who scores knows these\n18446744073709551615 0\n\n12345678901234567890 # the third\n5\n"


@pytest.mark.parametrize("text", [TEXT, json.dumps(SEEDS), "\n" + json.dumps(SEEDS, indent=1)])
def test_a_file_is_text_or_json(text: str, tmp_path: Path) -> None:
    (tmp_path / "seeds").write_text(text)
    assert read_seeds(tmp_path / "seeds") == SEEDS


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[]", "holds 0 seeds, but must hold 1 to 1000000"),
        (b"007 7", "holds the seed 7 twice"),
        (b"-1", "'-1' is not a whole number of 0 to 18446744073709551615"),
        (b"18446744073709551616", "'18446744073709551616' is not a whole number"),
        (b"[1.0]", "'1.0' is not a whole number"),
        (b'{"seeds": [1]}', "is not a whole number"),
        ("\uff11\uff12".encode(), "is not a whole number"),
        (b"\xff\xfe", "is not a whole number"),
        (b" " * 32_000_001, "larger than 32000000 bytes"),
    ],
)
def test_other_files_are_refused_with_the_reason(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "seeds").write_bytes(content)
    with pytest.raises(ResultError, match=message):
        read_seeds(tmp_path / "seeds")


def test_results_tell_the_digest_and_neither_seeds_nor_trajectories(task: Task, folder: Path) -> None:
    private = [secrets.randbits(64) for _ in range(3)]
    secret = private_task(task, private)
    steady = spec("steady", (0.0, 0.1))
    play_all([TaskRun(secret, [steady], folder, private)], fresh=False)
    assert sorted(path.name for path in folder.iterdir()) == ["manifest.json", "steady.json.xz"]
    result = only(folder / "steady.json.xz")
    assert (result.task.seeds, result.task.private) == ([0, 1, 2], digest_of(private))
    told = json.dumps(result.model_dump()) + (folder / "manifest.json").read_text()
    assert not any(str(seed) in told for seed in private)
    expected = play(steady.make, task.scenario, private)
    for name, values in expected.items():
        np.testing.assert_array_equal(result.episodes[name], values)
    # Other secrets are another task, also as many of them.
    others = private[::-1]
    play_all([TaskRun(private_task(task, others), [spec("other")], folder, others)], fresh=False)
    assert [len(read_leaderboard(folder, each).results) for each in (result.task, None)] == [1, 1]


def test_who_names_other_places_or_changes_the_digest_is_found(task: Task, make_result: MakeResult) -> None:
    with pytest.raises(ValueError, match="must be named by their places"):
        Task.model_validate(task.model_dump() | {"private": "0" * 64})
    changed = make_result("steady").model_dump(by_alias=True)
    changed["task"] |= {"private": "0" * 64, "seeds": list(range(4))}
    with pytest.raises(ValueError, match="checksum does not match"):
        Result.model_validate(changed)


def test_commands(tmp_path: Path, scenario: Scenario, capsys: pytest.CaptureFixture[str]) -> None:
    scenario.save(tmp_path / "short.toml")
    seeds, results = tmp_path / "private_seeds.txt", tmp_path / "results"
    seeds.write_text("7\n" + "\n".join(str(secrets.randbits(63) + 2**63) for _ in range(2)))
    words = ["run", "--scenario", str(tmp_path / "short.toml"), "--results", str(results), "--policies", "fixed_handbook"]
    assert main([*words, "--seeds", str(seeds)]) == 0
    captured = capsys.readouterr()
    assert "3 seeds" in captured.out
    assert "warning: 1 seeds of" in captured.err
    page = (results / "index.html").read_text("utf-8")
    assert "3 seeds, private: only the scorer knows them" in page
    assert "--seeds PRIVATE_SEEDS.txt" in page
    assert not any(seed in page for seed in seeds.read_text().split()[1:])
    complaints = verify.check(results, tmp_path, verify.Selection())
    assert len(complaints) == 1
    assert "was played on private seeds" in complaints[0]
    assert main([*words, "--seeds", str(seeds), "--splits"]) == 2
    assert "splits are played on held-out seeds" in capsys.readouterr().err
