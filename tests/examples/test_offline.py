"""Data sets: what is written can be played again, and is of seeds that nothing is scored or tuned on."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("minari")

import minari

from examples import publish
from examples.offline import AGENT, checksum, load, main, policy, record
from turning_env import RoughTurningEnv
from turning_env.scoring.seeds import TUNING_START


def made(behaviour: str, out: Path) -> minari.MinariDataset:
    assert main(["make", "--behaviours", behaviour, "--episodes", "4", "--out", str(out)]) == 0
    return load(out / f"rough_turning-{behaviour}-v0")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("datasets")
    made("mixture", out)
    return out


@pytest.mark.slow
def test_minari_recovers_the_environment_and_episodes_play_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    dataset = minari.load_dataset("rough_turning-mixture-v0")
    metadata = dataset.storage.metadata
    assert metadata["scenario_digest"] == RoughTurningEnv().scenario.digest()
    assert (metadata["first_seed"], metadata["last_seed"], metadata["action_noise"]) == (
        999_000_000,
        999_000_003,
        0.2,
    )
    assert metadata["last_seed"] < TUNING_START
    marks = list(dataset.storage.get_episode_metadata(range(4)))
    assert [mark["behaviour"] for mark in marks] == ["grid_search", "analytic_gradient"] * 2
    env = dataset.recover_environment()
    for seed, (episode, mark) in enumerate(
        zip(dataset.iterate_episodes(), marks, strict=True), 999_000_000
    ):
        assert int(mark["seed"]) == seed
        played = [env.reset(seed=seed)[0], *(env.step(action) for action in episode.actions)]
        np.testing.assert_array_equal(
            [played[0], *(step[0] for step in played[1:])], episode.observations
        )
        for column, recorded in enumerate(
            (episode.rewards, episode.terminations, episode.truncations), 1
        ):
            np.testing.assert_array_equal([step[column] for step in played[1:]], recorded)
        assert episode.terminations[-1] or episode.truncations[-1]
        assert mark["return"] == pytest.approx(episode.rewards.sum())


@pytest.mark.slow
def test_the_metadata_name_the_files_by_their_digests(folder: Path) -> None:
    home = (
        folder / "rough_turning-mixture-v0"
    )  # ``mlcroissant validate`` checks the form (docs/publishing.md)
    files = json.loads((home / "croissant.json").read_text("utf-8"))["distribution"]
    assert {each["contentUrl"] for each in files} == {"data/main_data.hdf5", "data/metadata.json"}
    for each in files:
        assert (
            hashlib.sha256((home / each["contentUrl"]).read_bytes()).hexdigest() == each["sha256"]
        )
    assert publish.repository(home).files.keys() == {
        "README.md",
        "croissant.json",
        "data/main_data.hdf5",
        "data/metadata.json",
    }
    names = [publish.repository(card).name for card in sorted(AGENT.parents[2].glob("*/*/*.md"))]
    assert len(names) == len(set(names)), "two agents share a repository"
    assert publish.main(["OWNER", str(folder)]) == 2
    assert checksum(load(home)) in (home / "README.md").read_text("utf-8")


@pytest.mark.slow
def test_a_data_set_has_the_same_checksum_again(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = checksum(made("mixture", tmp_path))
    assert again == checksum(load(folder / "rough_turning-mixture-v0"))
    assert capsys.readouterr().out.split()[-1] == again
    assert again != checksum(made("load_rule", tmp_path))
    assert checksum(made("mixture", tmp_path)) == again  # kept, not made again


def test_noise_depends_on_the_episodes_seed_alone() -> None:
    together, alone = (
        record(policy("load_rule"), [7, 8], 0.2)[1],
        record(policy("load_rule"), [8], 0.2)[0],
    )
    np.testing.assert_array_equal(together.actions, alone.actions)
