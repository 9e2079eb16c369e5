"""Data sets can be played again, and are of seeds that nothing is scored or tuned on."""

import csv
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("minari")

import minari

from examples import publish
from examples.offline import AGENTS, FIRST_SEED, checksum, load, main, policy, record
from leaderboard.seeds import TUNING_START
from turning_env import RoughTurningEnv
from turning_env.physics.quantities import layout

NAME = "rough_turning-mixture-v0"
EPISODES = 4


def made(behaviour: str, out: Path) -> minari.MinariDataset:
    arguments = ["make", "--behaviours", behaviour, "--episodes", str(EPISODES), "--out", str(out)]
    assert main(arguments) == 0
    return load(out / f"rough_turning-{behaviour}-v0")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("datasets")
    made("mixture", out)
    return out


@pytest.mark.slow
def test_the_metadata_state_scenario_seeds_and_policies(folder: Path) -> None:
    storage = load(folder / NAME).storage
    metadata = storage.metadata
    assert metadata["scenario_digest"] == RoughTurningEnv().scenario.digest()
    assert metadata["action_noise"] == 0.2
    assert metadata["first_seed"] == FIRST_SEED
    assert metadata["last_seed"] == FIRST_SEED + EPISODES - 1
    assert metadata["last_seed"] < TUNING_START
    episodes = list(storage.get_episode_metadata(range(EPISODES)))
    policies = [episode["behaviour"] for episode in episodes]
    assert policies == ["grid_search", "analytic_gradient"] * 2


@pytest.mark.slow
def test_minari_recovers_the_environment_and_episodes_play_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    dataset = minari.load_dataset(NAME)
    env = dataset.recover_environment()
    episodes = list(dataset.iterate_episodes())
    marks = list(dataset.storage.get_episode_metadata(range(EPISODES)))
    assert len(episodes) == EPISODES
    for index, (episode, mark) in enumerate(zip(episodes, marks, strict=True)):
        seed = FIRST_SEED + index
        assert int(mark["seed"]) == seed
        first_observation, _ = env.reset(seed=seed)
        observations = [first_observation]
        rewards = []
        terminations = []
        truncations = []
        for action in episode.actions:
            observation, reward, terminated, truncated, _ = env.step(action)
            observations.append(observation)
            rewards.append(reward)
            terminations.append(terminated)
            truncations.append(truncated)
        np.testing.assert_array_equal(observations, episode.observations)
        np.testing.assert_array_equal(rewards, episode.rewards)
        np.testing.assert_array_equal(terminations, episode.terminations)
        np.testing.assert_array_equal(truncations, episode.truncations)
        assert terminations[-1] or truncations[-1]
        assert mark["return"] == pytest.approx(episode.rewards.sum())


@pytest.mark.slow
def test_the_metadata_name_the_files_by_their_digests(folder: Path) -> None:
    home = folder / NAME
    files = json.loads((home / "croissant.json").read_text("utf-8"))["distribution"]
    urls = {file["contentUrl"] for file in files}
    assert urls == {"data/main_data.hdf5", "data/metadata.json", "episodes.csv"}
    for file in files:
        content = (home / file["contentUrl"]).read_bytes()
        assert hashlib.sha256(content).hexdigest() == file["sha256"]
    assert checksum(load(home)) in (home / "README.md").read_text("utf-8")


def record_sets(home: Path) -> dict[str, dict[str, Any]]:
    """Return the record sets of a data set's metadata by name."""
    croissant = json.loads((home / "croissant.json").read_text("utf-8"))
    return {record_set["name"]: record_set for record_set in croissant["recordSet"]}


@pytest.mark.slow
def test_the_table_of_episodes_has_the_columns_that_the_metadata_describe(folder: Path) -> None:
    home = folder / NAME
    fields = record_sets(home)["episodes"]["field"]
    columns = [field["source"]["extract"]["column"] for field in fields]
    with (home / "episodes.csv").open(newline="") as file:
        table = csv.DictReader(file)
        rows = list(table)
    assert table.fieldnames == columns
    episodes = list(load(home).iterate_episodes())
    assert len(rows) == EPISODES
    for index, (row, episode) in enumerate(zip(rows, episodes, strict=True)):
        assert int(row["steps"]) == len(episode)
        assert float(row["total_reward"]) == pytest.approx(episode.rewards.sum())
        assert int(row["seed"]) == FIRST_SEED + index


@pytest.mark.slow
def test_the_metadata_describe_arrays_and_observations(folder: Path) -> None:
    home = folder / NAME
    tables = record_sets(home)
    (episode,) = load(home).iterate_episodes([1])
    for row in tables["arrays"]["data"]:
        array = getattr(episode, row["arrays/name"])
        assert array.dtype == row["arrays/dtype"]
        # Such as "steps + 1, 11".
        shape = row["arrays/shape"]
        shape = shape.replace("steps + 1", str(len(episode) + 1))
        shape = shape.replace("steps", str(len(episode)))
        assert shape == ", ".join(map(str, array.shape))
    entries = tables["observation"]["data"]
    names = [row["observation/name"] for row in entries]
    assert names == list(layout(RoughTurningEnv().scenario))
    low = [row["observation/low"] for row in entries]
    high = [row["observation/high"] for row in entries]
    assert (low <= episode.observations).all()
    assert (episode.observations <= high).all()


@pytest.mark.slow
def test_croissants_own_library_reads_the_metadata(folder: Path) -> None:
    croissant = pytest.importorskip("mlcroissant")
    dataset = croissant.Dataset(folder / NAME / "croissant.json")
    assert not dataset.metadata.issues.errors
    episodes = list(dataset.records("episodes"))
    assert [row["episodes/episode"] for row in episodes] == list(range(EPISODES))
    assert [row["observation/place"] for row in dataset.records("observation")]


@pytest.mark.slow
def test_a_data_set_is_published_with_its_cards(folder: Path) -> None:
    files = publish.repository(folder / NAME).files
    data = {"data/main_data.hdf5", "data/metadata.json"}
    assert files.keys() == {"README.md", "croissant.json", "episodes.csv"} | data
    # The folder of data sets is none itself.
    assert publish.main(["OWNER", str(folder)]) == 2


def test_no_two_agents_share_a_repository() -> None:
    cards = sorted(AGENTS.glob("*/*/*.md"))
    names = {publish.repository(card).name for card in cards}
    assert len(cards) > 10
    assert len(names) == len(cards)


@pytest.mark.slow
def test_a_data_set_has_the_same_checksum_again(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = checksum(made("mixture", tmp_path))
    assert again == checksum(load(folder / NAME))
    assert capsys.readouterr().out.split()[-1] == again
    assert again != checksum(made("load_rule", tmp_path))
    assert checksum(made("mixture", tmp_path)) == again  # kept, not made again


@pytest.mark.slow
def test_noise_depends_on_the_episodes_seed_alone() -> None:
    _, together = record(policy("load_rule"), [7, 8], noise=0.2)
    (alone,) = record(policy("load_rule"), [8], noise=0.2)
    np.testing.assert_array_equal(together.actions, alone.actions)
