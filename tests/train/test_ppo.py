import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from train import agent, ppo
from train.run import Run
from turning_env import Scenario

SMALL = {"intervals": 2048, "lanes": 8, "rollout": 64, "batch_size": 256, "epochs": 2}
SCENARIO = Scenario.model_validate({"name": "short", "tool": {"wear_criterion": 0.1}})


def small_run(runs: Path, seed: int = 3, **changes: Any) -> Run:
    return Run.plan("ppo", "RoughTurning-v0", SCENARIO, seed, runs, "a command", SMALL | changes)


def weights(path: Path) -> dict[str, torch.Tensor]:
    return ppo.PPO.load(path, device="cpu").policy.state_dict()


class Killed(Exception):
    pass


def test_a_killed_training_resumes_to_the_very_same_agent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    undisturbed = ppo.train(small_run(tmp_path / "undisturbed"), checkpoint_every=512)

    run = small_run(tmp_path / "killed")
    save, saved = ppo.save_checkpoint, []

    def save_then_die(model: Any, run: Run) -> None:
        save(model, run)
        saved.append(model.num_timesteps)
        if len(saved) == 2:
            raise Killed

    monkeypatch.setattr(ppo, "save_checkpoint", save_then_die)
    with pytest.raises(Killed):
        ppo.train(run, checkpoint_every=512)
    monkeypatch.setattr(ppo, "save_checkpoint", save)
    assert saved == [512, 1024]
    assert not run.policy.exists()
    resumed = ppo.train(run, checkpoint_every=512)

    expected, found = weights(undisturbed), weights(resumed)
    assert expected.keys() == found.keys()
    for name, value in expected.items():
        assert torch.equal(value, found[name]), name


def test_a_finished_training_is_not_repeated(tmp_path: Path) -> None:
    run = small_run(tmp_path, intervals=512)
    path = ppo.train(run)
    before = path.stat().st_mtime_ns
    assert ppo.train(run) == path
    assert path.stat().st_mtime_ns == before
    assert not run.checkpoint.exists()


def test_a_folder_of_other_settings_is_left_alone(tmp_path: Path) -> None:
    ppo.train(small_run(tmp_path, intervals=512))
    with pytest.raises(ValueError, match="holds a training with other settings"):
        ppo.train(small_run(tmp_path, intervals=512, discount=0.9))


def test_an_agent_is_loaded_as_it_was_trained(tmp_path: Path) -> None:
    run = small_run(tmp_path, intervals=512)
    with pytest.raises(ValueError, match="holds no training run"):
        agent.load(run.folder)
    run.begin()
    with pytest.raises(ValueError, match="not finished"):
        agent.load(run.folder)
    ppo.train(run)
    loaded = agent.load(run.folder)
    assert (loaded.name, loaded.seed, loaded.scenario, loaded.command) == ("ppo", 3, SCENARIO, "a command")
    policy = loaded.make(4)
    policy.reset(np.ones(4, np.bool_))
    observations = np.linspace(0, 1, 44, dtype=np.float32).reshape(4, 11)
    actions = policy.act(observations)
    assert actions.shape == (4, 2)
    assert actions.dtype == np.float32
    assert np.abs(actions).max() <= 1
    np.testing.assert_array_equal(actions, policy.act(observations))
    shutil.rmtree(run.folder)


def test_trainings_never_see_the_bars_of_tuning_or_scoring() -> None:
    most_lanes = 100_000
    last_seed = (ppo.TUNING_START // ppo.SEED_STRIDE - 1) * ppo.SEED_STRIDE + most_lanes
    assert most_lanes <= ppo.SEED_STRIDE
    assert last_seed < ppo.TUNING_START


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seed", "-1"], "--seed is -1, but must be 0 to 999"),
        (["--intervals", "0"], "--intervals is 0"),
        (["--env", "Pendulum-v1"], "RoughTurning-v0"),
    ],
)
def test_wrong_arguments_are_refused(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        ppo.main(arguments)
    assert message in capsys.readouterr().err


def test_an_unknown_scenario_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ppo.main(["--scenario", "nowhere", "--runs", str(tmp_path)]) == 2
    assert "presets: " in capsys.readouterr().err


def test_any_id_can_be_trained(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--env", "RoughTurning-Paper-v0", "--intervals", "100", "--runs", str(tmp_path)]
    assert ppo.main(arguments) == 0
    path = Path(capsys.readouterr().out.strip())
    assert path == tmp_path / "RoughTurning-Paper-v0" / "paper" / "ppo-seed0" / "policy.zip"
    assert agent.load(path.parent).command == "python -m train.ppo " + " ".join(arguments)
