"""Private seeds: results hold their digest, and neither seeds nor trajectories."""

import json
import secrets
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from leaderboard import policies, verify
from leaderboard.__main__ import main
from leaderboard.play import play
from leaderboard.ranking import read_leaderboard
from leaderboard.result import Result, result_folder
from leaderboard.run import private_seeds
from leaderboard.seeds import HELD_OUT_START
from tests.leaderboard.conftest import ENV_ID, on, only
from turning_env import Scenario
from turning_env.files import digest_of

KEY = secrets.token_hex()
RULE = "fixed_handbook"


def test_a_private_key_determines_seeds_that_are_not_public() -> None:
    seeds = private_seeds("correct horse battery", 1000)
    of_another_key = private_seeds("correct horse batterz", 1000)
    assert seeds == private_seeds("correct horse battery", 1000)
    assert not set(seeds) & set(of_another_key)
    assert min(seeds + of_another_key) >= HELD_OUT_START + 1_000_000
    assert max(seeds + of_another_key) < 2**64


class Scored(NamedTuple):
    """A folder of results on private seeds, and what the command printed."""

    results: Path
    scenario: Scenario
    printed: str

    @property
    def folder(self) -> Path:
        """Folder of the only task."""
        return result_folder(self.results, ENV_ID, self.scenario.name)

    @property
    def result(self) -> Result:
        """Result of the only policy."""
        return only(self.folder / f"{RULE}.json.xz")

    def run(self, *words: str) -> int:
        """Run the command again on the same folder."""
        scenario = str(self.results.with_name("short.toml"))
        results = str(self.results)
        return main(["run", "--scenario", scenario, "--results", results, "--seeds", "3", *words])


@pytest.fixture
def scored(tmp_path: Path, scenario: Scenario, capsys: pytest.CaptureFixture[str]) -> Scored:
    """A rule on three private seeds."""
    scenario.save(tmp_path / "short.toml")
    scored = Scored(tmp_path / "results", scenario, printed="")
    assert scored.run("--private-key", KEY, "--policies", RULE) == 0
    return scored._replace(printed=capsys.readouterr().out)


def test_results_hold_the_digest_and_neither_seeds_nor_trajectories(scored: Scored) -> None:
    seeds = private_seeds(KEY, 3)
    files = sorted(path.name for path in scored.folder.iterdir())
    assert files == ["fixed_handbook.json.xz", "manifest.json"]
    assert scored.result.task.seeds == [0, 1, 2]
    assert scored.result.task.private == digest_of(seeds)
    page = (scored.results / "index.html").read_text("utf-8")
    manifest = (scored.folder / "manifest.json").read_text("utf-8")
    public = scored.printed + page + manifest + json.dumps(scored.result.model_dump())
    for secret in (KEY, *map(str, seeds)):
        assert secret not in public
    assert "3 seeds, private: only the scorer knows them" in page
    assert "--private-key KEY" in page


def test_private_seeds_are_played(scored: Scored) -> None:
    policy = policies.one_named(RULE, on(scored.scenario))
    played = play(policy.make, scored.scenario, private_seeds(KEY, 3))
    for name, values in scored.result.episodes.items():
        np.testing.assert_array_equal(values, played[name])


def test_only_the_owner_of_the_key_can_play_the_results_again(scored: Scored) -> None:
    (complaint,) = verify.check(scored.results, scored.results, verify.Selection())
    assert "was played on private seeds" in complaint


def test_another_key_is_another_task_and_public_seeds_are_refused(scored: Scored) -> None:
    assert scored.run("--private-key", KEY[::-1], "--policies", "zero_action") == 0
    of_the_first_key = read_leaderboard(scored.folder, scored.result.task)
    of_the_second_key = read_leaderboard(scored.folder)
    assert [result.policy.name for result in of_the_first_key.results] == [RULE]
    assert [result.policy.name for result in of_the_second_key.results] == ["zero_action"]
    assert scored.run("--policies", RULE) == 2
