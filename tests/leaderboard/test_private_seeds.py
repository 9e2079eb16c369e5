"""Private seeds: what results tell of them, and the commands."""

import json
import secrets
from pathlib import Path

import numpy as np
import pytest

from leaderboard import verify
from leaderboard.__main__ import main
from leaderboard.ranking import read_leaderboard
from leaderboard.result import Task
from leaderboard.run import TaskRun, play_all
from tests.leaderboard.conftest import only, spec
from turning_env import Scenario
from turning_env.files import digest_of
from turning_env.scoring.play import play
from turning_env.scoring.seeds import private_seeds

KEY = secrets.token_hex()


def private(task: Task, seeds: list[int]) -> Task:
    return task.model_copy(update={"seeds": list(range(len(seeds))), "private": digest_of(seeds)})


def test_results_tell_the_digest_and_neither_seeds_nor_trajectories(task: Task, folder: Path) -> None:
    seeds = private_seeds(KEY, 3)
    steady = spec("steady", (0.0, 0.1))
    play_all([TaskRun(private(task, seeds), [steady], folder, seeds)], fresh=False)
    assert sorted(path.name for path in folder.iterdir()) == ["manifest.json", "steady.json.xz"]
    result = only(folder / "steady.json.xz")
    assert (result.task.seeds, result.task.private) == ([0, 1, 2], digest_of(seeds))
    told = json.dumps(result.model_dump()) + (folder / "manifest.json").read_text()
    assert not any(str(seed) in told for seed in seeds)
    expected = play(steady.make, task.scenario, seeds)
    for name, values in expected.items():
        np.testing.assert_array_equal(result.episodes[name], values)
    # Other secrets are another task, also as many of them.
    others = private_seeds(KEY[::-1], 3)
    play_all([TaskRun(private(task, others), [spec("other")], folder, others)], fresh=False)
    assert [len(read_leaderboard(folder, each).results) for each in (result.task, None)] == [1, 1]


def test_commands(tmp_path: Path, scenario: Scenario, capsys: pytest.CaptureFixture[str]) -> None:
    scenario.save(tmp_path / "short.toml")
    results = tmp_path / "results"
    words = ["run", "--scenario", str(tmp_path / "short.toml"), "--results", str(results), "--policies", "fixed_handbook"]
    assert main([*words, "--seeds", "3", "--private-key", KEY]) == 0
    captured = capsys.readouterr()
    page = (results / "index.html").read_text("utf-8")
    assert "3 seeds, private: only the scorer knows them" in page
    assert "--private-key KEY" in page
    assert not any(secret in page + captured.out for secret in (KEY, *map(str, private_seeds(KEY, 3))))
    complaints = verify.check(results, tmp_path, verify.Selection())
    assert len(complaints) == 1
    assert "was played on private seeds" in complaints[0]
