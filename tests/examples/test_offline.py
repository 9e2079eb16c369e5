"""Data sets: what is written can be played again, and is of seeds that nothing is scored or tuned on."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("minari")

import minari

from examples import offline
from examples.offline import clone, load, main
from examples.shared import network_policy
from turning_env import RoughTurningEnv
from turning_env.scoring.seeds import TUNING_START


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of data sets: a mixture of four episodes."""
    out = tmp_path_factory.mktemp("datasets")
    assert main(["make", "--behaviour", "mixture", "--episodes", "4", "--out", str(out)]) == 0
    return out


@pytest.mark.slow
def test_minari_finds_what_was_written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    dataset = minari.load_dataset("rough_turning-mixture-v0")
    assert dataset.total_episodes == 4
    assert dataset.recover_environment().unwrapped.scenario.name == "rough_turning"
    metadata = dataset.storage.metadata
    assert metadata["algorithm_name"] == "mixture"
    assert (metadata["first_seed"], metadata["last_seed"]) == (999_000_000, 999_000_003)
    assert metadata["scenario_digest"] == RoughTurningEnv().scenario.digest()
    marks = list(dataset.storage.get_episode_metadata(range(4)))
    assert [mark["behaviour"] for mark in marks] == ["grid_search", "analytic_gradient"] * 2


@pytest.mark.slow
def test_episodes_can_be_played_again(folder: Path) -> None:
    dataset = load(folder / "rough_turning-mixture-v0")
    env = RoughTurningEnv()
    seeds = []
    for episode, mark in zip(dataset.iterate_episodes(), dataset.storage.get_episode_metadata(range(4)), strict=True):
        seed = int(mark["seed"])
        seeds.append(seed)
        observation, _ = env.reset(seed=seed)
        for step, action in enumerate(episode.actions):
            np.testing.assert_array_equal(observation, episode.observations[step])
            observation, reward, terminated, truncated, _ = env.step(action)
            recorded = episode.rewards[step], episode.terminations[step], episode.truncations[step]
            assert (reward, terminated, truncated) == recorded
        np.testing.assert_array_equal(observation, episode.observations[-1])
        assert terminated or truncated
        assert mark["return"] == pytest.approx(episode.rewards.sum())
    assert seeds == list(range(999_000_000, 999_000_004))
    assert max(seeds) < TUNING_START


@pytest.mark.slow
def test_a_clone_acts_as_the_behaviour_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["make", "--behaviour", "grid_search", "--episodes", "2", "--out", str(tmp_path)]) == 0
    dataset = load(tmp_path / "rough_turning-grid_search-v0")
    network = clone(dataset, 100)
    episode = next(iter(dataset.iterate_episodes()))
    errors = network_policy(network).act(episode.observations[:-1]) - episode.actions
    assert np.square(errors).mean() < 0.3 * np.var(episode.actions, axis=0).mean()
    assert main(["clone", str(tmp_path / "rough_turning-grid_search-v0"), "--epochs", "1", "--tuning-seeds", "2"]) == 0
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()][-2:] == ["grid_search", "clone"]


def test_an_existing_data_set_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rough_turning-mixture-v0").mkdir()
    assert main(["make", "--behaviour", "mixture", "--episodes", "4", "--out", str(tmp_path)]) == 2
    assert "exists: delete it, or choose another --out" in capsys.readouterr().err


def test_an_interrupted_data_set_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(offline, "write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        main(["make", "--behaviour", "grid_search", "--episodes", "1", "--out", str(tmp_path)])
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_data_set_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["clone", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("error: ")
    with pytest.raises(SystemExit, match="2"):
        main(["make", "--episodes", "1000001"])
