"""The score of whatever a user has that acts."""

import json
import lzma
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.wrappers import NormalizeObservation
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize

from baselines.catalogue import spec
from leaderboard.pack import contents
from turning_env import FAMILY_ID, Scenario
from turning_env.__main__ import main
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.scenario.family import families
from turning_env.scoring.score import FOLDER, Score, compare, score, shipped

ROOT = Path(__file__).parents[3]
AGENTS = ROOT / "agents" / "RoughTurning-v0" / "rough_turning"
OVERRIDE, PAPER = (
    "RoughTurning-Override-v1",
    "RoughTurning-Paper-v0",
)  # an episode of the latter has few steps


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
    "policy",
    [Counting, Counting(), Full(), f"{__name__}:full_feed"],
    ids=["class", "object", "torch", "name"],
)
def test_every_kind_of_policy_plays_alike(policy: Any, expected: Score) -> None:
    assert (
        score(policy, PAPER, seeds=4).episodes["return"].tolist()
        == expected.episodes["return"].tolist()
    )


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
    episodes = {
        "return": rule.returns[0],
        "severe_overload_time": rule.severe[0],
        "engaged_time": rule.engaged[0],
    }
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
def test_what_cannot_be_scored_is_said(
    policy: Any, env_id: str, seeds: int | None, error: type[Exception], told: str
) -> None:
    with pytest.raises(error, match=told):
        score(policy, env_id, seeds)


def test_a_model_as_a_zip_file_is_sent_to_the_export(tmp_path: Path) -> None:
    (tmp_path / "me.zip").write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"python -m train\.export"):
        score(tmp_path / "me.zip", OVERRIDE, 2)


def test_agents_of_the_published_simulation_are_not_ranked_and_the_score_warns(
    expected: Score,
) -> None:
    assert expected.warning is not None
    assert "warning: " in str(expected)
    scenario = Scenario.load("paper")
    gaming = replace(
        shipped(PAPER, 4)[0], name="gaming", kind="agent", returns=np.full((1, 4), 647.0)
    )
    found = compare(PAPER, expected.episodes, scenario, [*shipped(PAPER, 4), gaming])
    assert (found.rank, found.ranked) == (expected.rank, expected.ranked)
    assert next(each.unranked for each in found.comparisons if each.name == "gaming") is not None
    assert "not ranked" in next(line for line in found.table().splitlines() if " gaming " in line)


def test_small_returns_have_decimals_and_the_load_is_told_whole() -> None:
    others = shipped(OVERRIDE, 64)
    rule = next(each for each in others if each.name == "omative")
    fields = {
        "return": rule.returns[0] + 0.1,
        "severe_overload_time": rule.severe[0],
        "engaged_time": rule.engaged[0],
    }
    found = compare(OVERRIDE, fields, Scenario.load("override"), others)
    ahead = next(each for each in found.comparisons if each.name == "modified_fuzzy_override").ahead
    assert f"{ahead.value:+.2f} s" in found.table()
    assert f"{found.severe_share:.2%}" in found.load()


def test_the_share_of_severe_overload_is_called_severe() -> None:
    others = shipped("RoughTurning-v0", 16)
    rule = next(each for each in others if each.name == "grid_search")
    fields = {
        "return": rule.returns[0],
        "severe_overload_time": rule.severe[0],
        "engaged_time": rule.engaged[0],
    }
    found = compare("RoughTurning-v0", fields, Scenario.load("rough_turning"), others)
    assert found.feasibility == "infeasible"
    assert f"{found.severe_share:.1%} of cutting time in severe overload" in str(found)


def learned(env: Any, **options: Any) -> PPO:
    return PPO(
        "MlpPolicy", env, n_steps=8, batch_size=16, n_epochs=1, seed=1, device="cpu", **options
    ).learn(32)


def test_a_normalised_model_is_scored_with_its_statistics_or_refused(tmp_path: Path) -> None:
    env = VecNormalize(RoughTurningVecEnv("paper", 2))
    model = learned(env)
    expected = score(
        lambda seen: model.predict(env.normalize_obs(seen), deterministic=True)[0], PAPER, seeds=4
    )
    plain = score(lambda seen: model.predict(seen, deterministic=True)[0], PAPER, seeds=4)
    found = score(model, PAPER, seeds=4).episodes["return"].tolist()
    assert found == expected.episodes["return"].tolist() != plain.episodes["return"].tolist()
    model.save(tmp_path / "mine.zip")
    with pytest.raises(ValueError, match="VecNormalize, whose statistics its file does not hold"):
        score(PPO.load(tmp_path / "mine.zip"), PAPER, seeds=4)
    env.save(str(tmp_path / "statistics.pkl"))
    again = VecNormalize.load(str(tmp_path / "statistics.pkl"), RoughTurningVecEnv("paper", 2))
    assert (
        score(PPO.load(tmp_path / "mine.zip", env=again), PAPER, seeds=4)
        .episodes["return"]
        .tolist()
        == found
    )


class Halved(gymnasium.ObservationWrapper[Any, Any, Any]):
    """Changes observations, but not their space."""

    def observation(self, observation: Any) -> Any:
        return 0.5 * observation


@pytest.mark.parametrize(
    ("env", "told"),
    [
        (lambda: VecFrameStack(RoughTurningVecEnv("paper", 2), 4), "44 entries"),
        (
            lambda: DummyVecEnv([lambda: NormalizeObservation(gymnasium.make(PAPER))]),
            "NormalizeObservation",
        ),
        (lambda: DummyVecEnv([lambda: Halved(gymnasium.make(PAPER))]), "Halved"),
    ],
    ids=["frames", "normalised", "halved"],
)
def test_a_model_behind_a_wrapper_that_changes_observations_is_refused(
    env: Any, told: str, tmp_path: Path
) -> None:
    model = PPO("MlpPolicy", env(), device="cpu")
    with pytest.raises(ValueError, match=told):
        score(model, PAPER, seeds=4)
    if told != "Halved":  # the file of a model holds the space alone
        model.save(tmp_path / "mine.zip")
        with pytest.raises(ValueError, match=told):
            score(PPO.load(tmp_path / "mine.zip"), PAPER, seeds=4)


def test_the_command_prints_the_rank(expected: Score, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["score", f"{__name__}:full_feed", "--env", PAPER, "--seeds", "4", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rank"] == expected.rank
