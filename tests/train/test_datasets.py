"""Data sets of a family: what they hold, and what a failed recording leaves."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("minari")

from baselines import derived_observation
from baselines.oracles.truthful import Truthful
from leaderboard.family import FamilyPlay
from train import datasets
from train.datasets import HIDDEN, Behaviour, Recording, main
from turning_env import Family, FamilyVectorEnv

FAMILY = Family.load({"extends": "shop", "jobs": 16, "planned": {"control.time_limit": 0.1}})
"""Few jobs, of six steps each."""
JOBS = 5


@pytest.fixture(scope="module")
def mixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return datasets.record(FAMILY, "mixture", JOBS, tmp_path_factory.mktemp("sets"))


@pytest.mark.slow
def test_a_data_set_plays_again_in_the_environment_that_it_recovers(mixture: Path) -> None:
    dataset = datasets.load(mixture)
    env = dataset.recover_environment()
    assert env.observation_space == dataset.observation_space
    assert env.action_space == dataset.action_space
    episodes = list(dataset.iterate_episodes())
    metadata = list(dataset.storage.get_episode_metadata(range(JOBS)))
    assert sorted(int(row["seed"]) for row in metadata) == list(range(JOBS))
    for episode, row in zip(episodes, metadata, strict=True):
        observation, info = env.reset(seed=int(row["seed"]))
        observations = [observation]
        hidden = [[info[name] for name in HIDDEN]]
        rewards = []
        for action in episode.actions:
            observation, reward, terminated, truncated, info = env.step(action)
            observations.append(observation)
            hidden.append([info[name] for name in HIDDEN])
            rewards.append(reward)
        assert terminated or truncated
        assert episode.terminations.tolist() == [False] * (len(rewards) - 1) + [terminated]
        assert episode.truncations.tolist() == [False] * (len(rewards) - 1) + [truncated]
        np.testing.assert_array_equal(episode.observations, observations)
        np.testing.assert_array_equal(episode.rewards, rewards)
        recorded = np.stack([episode.infos[name] for name in HIDDEN], axis=1)
        np.testing.assert_array_equal(recorded, hidden)
        assert row["return"] == pytest.approx(sum(rewards))


def test_observations_are_those_of_an_agent_without_the_hidden_state(mixture: Path) -> None:
    dataset = datasets.load(mixture)
    plain = FamilyVectorEnv(1, FAMILY).single_observation_space
    entries = plain.shape[0] + len(derived_observation.ENTRIES)
    assert dataset.observation_space.shape == (entries,)
    for episode in dataset.iterate_episodes():
        for name in HIDDEN:
            column = episode.infos[name].astype(np.float32)
            if np.ptp(column) > 0.0:
                assert not (episode.observations == column[:, np.newaxis]).all(axis=0).any(), name


def test_the_mixture_has_three_behaviours_by_turns_of_jobs(mixture: Path) -> None:
    rows = datasets.load(mixture).storage.get_episode_metadata(range(JOBS))
    behaviours = {int(row["seed"]): row["behaviour"] for row in rows}
    names = ["self_tuning", "self_tuning+noise", "random"]
    assert [behaviours[job] for job in range(JOBS)] == (names + names)[:JOBS]


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["self_tuning", "causal", "random"])
def test_a_recording_earns_what_the_policy_earns_on_the_leaderboard(policy: str) -> None:
    known = Truthful.of(FAMILY) if policy == "causal" else FAMILY
    plays = FamilyPlay(known, "train", policy, forgets=False)
    jobs = [3, 4]
    expected = plays(FAMILY.job(0).scenario, jobs, lambda ended: None)
    recordings = datasets.play(FAMILY, Behaviour(policy), jobs)
    returns = [recording.rewards.sum() for recording in recordings]
    np.testing.assert_allclose(returns, expected["return"], rtol=1e-12)
    assert [len(recording.actions) for recording in recordings] == expected["steps"].tolist()


def test_noise_depends_on_the_job_alone_and_changes_no_edge() -> None:
    behaviour = Behaviour("self_tuning", noise=0.3)
    _, among_others = datasets.play(FAMILY, behaviour, [7, 8])
    (alone,) = datasets.play(FAMILY, behaviour, [8])
    (without,) = datasets.play(FAMILY, Behaviour("self_tuning"), [8])
    np.testing.assert_array_equal(among_others.actions, alone.actions)
    difference = alone.actions[0] - without.actions[0]
    assert (difference[:2] != 0.0).all()
    assert difference[2] == 0.0


@pytest.mark.slow
def test_an_interrupted_recording_leaves_nothing_and_the_command_records_it_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    play = datasets.play

    def interrupted(family: Family, behaviour: Behaviour, *rest: Any) -> list[Recording]:
        if behaviour.policy == "random":
            raise KeyboardInterrupt
        return play(family, behaviour, *rest)

    monkeypatch.setattr(datasets, "play", interrupted)
    with pytest.raises(KeyboardInterrupt):
        datasets.record(FAMILY, "mixture", 3, tmp_path)
    assert not list(tmp_path.iterdir())
    monkeypatch.undo()
    assert datasets.load(datasets.record(FAMILY, "mixture", 3, tmp_path)).total_episodes == 3


def test_a_data_set_that_exists_is_not_recorded_again(
    mixture: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(ValueError, match="mixture-v0 exists"):
        datasets.record(FAMILY, "mixture", JOBS, mixture.parent)


@pytest.mark.parametrize(
    ("mistake", "message"),
    [
        (["--policy", "predictive"], "predictive"),
        (["--jobs", "5000"], "4096"),
        (["--jobs", "0"], "above 0"),
        (["--split", "unseen_jobs"], "--split"),
        (["--scenario", "rough_turning"], "rough_turning"),
    ],
)
def test_a_mistake_is_an_error_and_writes_nothing(
    mistake: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main([*mistake, "--out", str(tmp_path / "sets")])
    except SystemExit as exit_:
        status = int(exit_.code or 0)
    assert status == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_without_a_data_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds no data set"):
        datasets.load(tmp_path)
