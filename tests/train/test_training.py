import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from tests.train.small import ALGORITHMS, small_run
from train import learning_curve, training
from train.agents import run_folder as agent
from train.run import Run
from train.training import Algorithm, train
from turning_env import IDS, Scenario
from turning_env.batch.driver import action_space, observation_space

every_algorithm = pytest.mark.parametrize("algorithm", ALGORITHMS.values(), ids=ALGORITHMS)


class Killed(Exception):
    pass


@every_algorithm
def test_a_killed_training_resumes_to_the_very_same_agent(
    algorithm: Algorithm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    undisturbed = small_run(algorithm, tmp_path / "undisturbed")
    train(undisturbed, algorithm, checkpoint_every=512)

    run = small_run(algorithm, tmp_path / "killed")
    save, saved = training.save_checkpoint, []

    def save_then_die(model: Any, run: Run, algorithm: Algorithm) -> None:
        save(model, run, algorithm)
        saved.append(model.num_timesteps)
        if len(saved) == 2:
            raise Killed

    monkeypatch.setattr(training, "save_checkpoint", save_then_die)
    with pytest.raises(Killed):
        train(run, algorithm, checkpoint_every=512)
    monkeypatch.setattr(training, "save_checkpoint", save)
    assert saved == [512, 1024]
    assert not run.policy.exists()
    train(run, algorithm, checkpoint_every=512)

    expected, found = (algorithm.model.load(each.policy, device="cpu").get_parameters() for each in (undisturbed, run))
    assert _bytes(expected) == _bytes(found)
    rows, resumed_rows = (learning_curve.read(each.folder) for each in (undisturbed, run))
    assert rows[-1]["steps"] == 2048
    for row, resumed_row in zip(rows, resumed_rows, strict=True):
        assert row | {"wall_time": 0.0} == resumed_row | {"wall_time": 0.0}
    assert all(np.diff([row["wall_time"] for row in resumed_rows]) > 0.0)


def _bytes(parameters: Any) -> bytes:
    """Weights and optimisers' states as one string of bytes."""
    stream = io.BytesIO()
    torch.save(parameters, stream)
    return stream.getvalue()


@every_algorithm
def test_a_loaded_agent_does_what_its_model_predicts(algorithm: Algorithm, tmp_path: Path) -> None:
    run = small_run(algorithm, tmp_path, steps=1024)
    path = train(run, algorithm)
    model: Any = algorithm.model.load(path, device="cpu")
    loaded = agent.load(run.folder)
    assert (loaded.name, loaded.seed, loaded.command) == (algorithm.name, 3, "a command")
    policy = loaded.make(6)
    policy.reset(np.ones(6, np.bool_))
    random, state, starts = np.random.default_rng(0), None, np.ones(6, np.bool_)
    for step in range(5):
        observations = random.normal(scale=3.0, size=(6, 11)).astype(np.float32)
        expected, state = model.predict(observations, state, starts, deterministic=True)
        found = policy.act(observations)
        np.testing.assert_allclose(found, expected, atol=1e-6)
        assert found.dtype == np.float32
        assert np.abs(found).max() <= 1.0
        starts = np.arange(6) == step
        policy.reset(starts)


@every_algorithm
def test_there_is_an_agent_for_every_id_that_it_plays(algorithm: Algorithm, tmp_path: Path) -> None:
    for preset in IDS.values():
        scenario = Scenario.load(preset)
        run = small_run(algorithm, tmp_path, scenario)
        if not algorithm.plays(scenario):
            with pytest.raises(ValueError, match=f"{algorithm.name} cannot learn on scenario"):
                train(run, algorithm)
            continue
        model = algorithm.new_model(run, algorithm.lathes(scenario, run.parameters["num_envs"]))
        model.save(tmp_path / "policy.zip")
        actor = algorithm.actor(tmp_path / "policy.zip")
        observation = torch.from_numpy(observation_space(scenario).sample()[None])
        action, memory = actor(observation, torch.zeros(1, actor.memory_size))
        assert action.shape == (1, *(action_space(scenario).shape or ()))
        assert memory.shape == (1, actor.memory_size)


def test_a_finished_training_is_not_repeated(tmp_path: Path) -> None:
    algorithm = ALGORITHMS["ppo"]
    run = small_run(algorithm, tmp_path, steps=512)
    path = train(run, algorithm)
    before = path.stat().st_mtime_ns
    assert train(run, algorithm) == path
    assert path.stat().st_mtime_ns == before
    assert not run.checkpoint.exists()


def test_there_is_no_agent_before_a_training_is_finished(tmp_path: Path) -> None:
    run = small_run(ALGORITHMS["ppo"], tmp_path)
    with pytest.raises(ValueError, match="holds no training run"):
        agent.load(run.folder)
    run.begin()
    with pytest.raises(ValueError, match="not finished"):
        agent.load(run.folder)


def test_a_folder_of_other_settings_is_left_alone(tmp_path: Path) -> None:
    algorithm = ALGORITHMS["ppo"]
    train(small_run(algorithm, tmp_path, steps=512), algorithm)
    with pytest.raises(ValueError, match="holds a training with other settings"):
        train(small_run(algorithm, tmp_path, steps=512, discount=0.9), algorithm)


def test_an_agent_is_small_and_holds_no_lathes(tmp_path: Path) -> None:
    algorithm = ALGORITHMS["sac"]
    run = small_run(algorithm, tmp_path, memory=1_000_000, steps=64)
    path = train(run, algorithm)
    assert path.stat().st_size < 1_000_000
    assert not hasattr(algorithm.model.load(path, device="cpu"), "beside")


def test_trainings_never_see_the_bars_of_tuning_or_scoring() -> None:
    most_lanes = 100_000
    last_seed = (training.SEEDS - 1) * training.SEED_STRIDE + most_lanes
    assert most_lanes <= training.SEED_STRIDE
    assert last_seed < training.TUNING_START
