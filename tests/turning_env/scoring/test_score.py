"""The score of whatever a user has that acts."""

import json
import lzma
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from baselines.catalogue import spec
from leaderboard.pack import contents
from turning_env import FAMILY_ID, Scenario
from turning_env.__main__ import main
from turning_env.scenario.family import families
from turning_env.scoring.score import FOLDER, Score, compare, score, shipped

ROOT = Path(__file__).parents[3]
AGENTS = ROOT / "agents" / "RoughTurning-v0" / "rough_turning"
OVERRIDE, PAPER = "RoughTurning-Override-v1", "RoughTurning-Paper-v0"  # an episode of the latter has few steps


def full_feed(observations: Any) -> Any:
    return np.full((len(observations), 2), 0.1, np.float32)


class Counting:
    """A policy with a memory: the steps since the last reset."""

    def __init__(self) -> None:
        self.steps = np.zeros(0)

    def reset(self, mask: Any) -> None:
        self.steps = np.where(mask, 0.0, self.steps if len(self.steps) else np.zeros(len(mask)))

    def act(self, observations: Any) -> Any:
        self.steps += 1
        return full_feed(observations)


class Full(torch.nn.Module):
    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return 0.1 + 0.0 * observations[:, :2]


@pytest.fixture(scope="module")
def expected() -> Score:
    return score(full_feed, PAPER, seeds=4)


def test_the_files_in_the_package_hold_the_results_that_ship() -> None:
    made = contents(ROOT / "leaderboard" / "results")
    assert {path: lzma.decompress(path.read_bytes()).decode() for path in made} == made
    assert {path.name for path in FOLDER.iterdir()} == {path.name for path in made}


@pytest.mark.parametrize(
    "policy", [Counting, Counting(), Full(), f"{__name__}:full_feed"], ids=["class", "object", "torch", "name"]
)
def test_every_kind_of_policy_plays_alike(policy: Any, expected: Score) -> None:
    assert score(policy, PAPER, seeds=4).episodes["return"].tolist() == expected.episodes["return"].tolist()


def test_a_file_that_ships_reaches_the_return_that_ships() -> None:
    found = score(AGENTS.parents[1] / OVERRIDE / "override" / "ppo-seed0.onnx", OVERRIDE, seeds=8)
    ppo = next(each for each in shipped(OVERRIDE) if each.name == "ppo")
    assert found.episodes["return"] == pytest.approx(ppo.returns[0, :8], abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("family", families())
def test_a_family_is_scored_on_unseen_jobs(family: str) -> None:
    """Observations hold the nominal model's numbers, and the policy `idle` gets the return that ships."""
    shapes = set()

    def idle(observations: Any) -> Any:
        shapes.add(observations.shape)
        return idling.act(observations)

    (ships,) = (each for each in shipped(f"{FAMILY_ID}-{family}") if each.name == "idle")
    idling = spec("idle", Scenario.load("shift")).make(3)
    found = score(idle, FAMILY_ID, seeds=3, family=family)
    assert shapes == {(3, gymnasium.make(FAMILY_ID, family=family).observation_space.shape[0])}  # type: ignore[index]
    np.testing.assert_allclose(found.episodes["return"], ships.returns[0, :3], atol=0.01)


def test_the_same_episodes_are_no_better_and_no_worse() -> None:
    others = shipped("RoughTurning-v0", 16)
    rule = next(each for each in others if each.name == "rescaled_grid_search")
    episodes = {"return": rule.returns[0], "severe_overload_time": rule.severe[0], "engaged_time": rule.engaged[0]}
    found = compare("RoughTurning-v0", episodes, Scenario.load("rough_turning"), others)
    (same,) = (each for each in found.comparisons if each.name == "rescaled_grid_search")
    assert (same.ahead.value, same.ahead.low, same.ahead.high) == (0.0, 0.0, 0.0)
    assert same.mean_return == found.mean_return
    assert same.feasible == found.feasible
    ranked = [each.name for each in found.comparisons if each.kind != "oracle"]
    assert ranked[found.rank - 1] == "rescaled_grid_search"
    assert found.ranked == len(ranked) + 1
    assert str(found).startswith(f"rank {found.rank} of {found.ranked}, return ")


@pytest.mark.parametrize(
    ("policy", "env_id", "seeds", "error", "told"),
    [
        (full_feed, "RoughTurning-v1", None, ValueError, "RoughTurning-v0"),
        (full_feed, OVERRIDE, 1, ValueError, "2 to 64"),
        (3, OVERRIDE, 2, TypeError, "int"),
        ("missing.onnx", OVERRIDE, 2, FileNotFoundError, "missing.onnx"),
        (str(ROOT / "README.md"), OVERRIDE, 2, ValueError, "README.md"),
        (f"{__name__}:absent", OVERRIDE, 2, ValueError, "absent"),
        (full_feed, OVERRIDE, 2, ValueError, "shape"),
    ],
)
def test_what_cannot_be_scored_is_said(policy: Any, env_id: str, seeds: int | None, error: type[Exception], told: str) -> None:
    with pytest.raises(error, match=told):
        score(policy, env_id, seeds)


def test_a_model_as_a_zip_file_is_sent_to_the_export(tmp_path: Path) -> None:
    (tmp_path / "me.zip").write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"python -m train\.export"):
        score(tmp_path / "me.zip", OVERRIDE, 2)


def test_the_command_prints_the_rank(expected: Score, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["score", f"{__name__}:full_feed", "--env", PAPER, "--seeds", "4", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rank"] == expected.rank
