"""Pickles are loaded in few places, each for a run of one's own, and with a warning."""

import re
from pathlib import Path

import pytest

from tests.train import onnx_agents, small
from train import training
from train.agents import run_folder as agent
from train.training import new_model, save_checkpoint

ROOT = Path(__file__).parents[2]
PACKAGES = ("turning_env", "baselines", "train", "leaderboard")
ALGORITHMS = {"ppo", "sac", "tqc", "recurrent_ppo", "analytic_gradient"}
LOADERS = (
    r"pickle\.loads?\(|torch\.load\(|joblib\.load\(|allow_pickle=True|"
    r"\b(?:PPO|SAC|TQC|RecurrentPPO|AnalyticGradient|model)\.load\("
)


def test_pickles_are_loaded_by_algorithms_and_to_resume_alone() -> None:
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    found = {str(path.relative_to(ROOT)) for path in paths if re.search(LOADERS, path.read_text("utf-8"))}
    assert found == {"train/training.py", *(f"train/{name}.py" for name in ALGORITHMS)}


def test_who_loads_one_is_warned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    run = onnx_agents.run(tmp_path / "run")
    run.begin()
    run.policy.touch()
    monkeypatch.setattr("train.ppo.ALGORITHM", None)
    monkeypatch.setattr("train.ppo.actor", lambda path: onnx_agents.memoryless())
    agent.load(run.folder)
    warning = f"warning: {run.policy} is a pickle, which can run code: load only what you have trained yourself\n"
    assert capsys.readouterr().err == warning
    algorithm = small.ALGORITHMS["ppo"]
    run = small.small_run(algorithm, tmp_path)
    run.begin()
    save_checkpoint(new_model(run, algorithm), run, algorithm)
    training.load_checkpoint(run, algorithm)
    assert f"warning: {run.checkpoint} is a pickle" in capsys.readouterr().err
