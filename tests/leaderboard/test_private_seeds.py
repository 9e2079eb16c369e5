"""Private seeds: results hold their digest, and neither seeds nor trajectories; other secrets are another task."""

import json
import secrets
from pathlib import Path

import numpy as np
import pytest

from leaderboard import policies, verify
from leaderboard.__main__ import main
from leaderboard.ranking import read_leaderboard
from leaderboard.result import result_folder
from leaderboard.run import private_seeds
from tests.leaderboard.conftest import ENV_ID, on, only
from turning_env import Scenario
from turning_env.files import digest_of
from turning_env.scoring.play import play
from turning_env.scoring.seeds import HELD_OUT_START

KEY = secrets.token_hex()


def test_a_private_key_determines_seeds_that_are_not_public() -> None:
    first, other = (
        private_seeds("correct horse battery", 1000),
        private_seeds("correct horse batterz", 1000),
    )
    assert first == private_seeds("correct horse battery", 1000)
    assert not set(first) & set(other)
    assert HELD_OUT_START + 1_000_000 <= min(first + other) <= max(first + other) < 2**64


def test_results_tell_the_digest_and_nothing_else(
    tmp_path: Path, scenario: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario.save(tmp_path / "short.toml")
    seeds, results = private_seeds(KEY, 3), tmp_path / "results"
    words = [
        "run",
        "--scenario",
        str(tmp_path / "short.toml"),
        "--results",
        str(results),
        "--seeds",
        "3",
    ]
    assert main([*words, "--private-key", KEY, "--policies", "fixed_handbook"]) == 0
    folder = result_folder(results, ENV_ID, scenario.name)
    assert sorted(path.name for path in folder.iterdir()) == [
        "fixed_handbook.json.xz",
        "manifest.json",
    ]
    result, page = (
        only(folder / "fixed_handbook.json.xz"),
        (results / "index.html").read_text("utf-8"),
    )
    assert (result.task.seeds, result.task.private) == ([0, 1, 2], digest_of(seeds))
    told = (
        capsys.readouterr().out
        + page
        + json.dumps(result.model_dump())
        + (folder / "manifest.json").read_text()
    )
    assert not any(secret in told for secret in (KEY, *map(str, seeds)))
    assert "3 seeds, private: only the scorer knows them" in page
    assert "--private-key KEY" in page
    played = play(policies.one_named("fixed_handbook", on(scenario)).make, scenario, seeds)
    for name, values in result.episodes.items():
        np.testing.assert_array_equal(values, played[name])
    (complaint,) = verify.check(results, tmp_path, verify.Selection())
    assert "was played on private seeds" in complaint
    assert main([*words, "--private-key", KEY[::-1], "--policies", "zero_action"]) == 0
    assert [len(read_leaderboard(folder, each).results) for each in (result.task, None)] == [1, 1]
    assert main([*words, "--policies", "fixed_handbook"]) == 2  # on public seeds
