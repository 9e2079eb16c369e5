"""The command trains, writes an agent that plays, and says what is wrong."""

import numpy as np
import pytest
import torch

from train import agent_file
from train.onnx_session import OnnxPolicy, session_of
from train.resident import __main__ as command
from turning_env import RoughTurningVectorEnv

FEW = ["--device", "cpu", "--intervals", "1000", "--lanes", "32", "--rollout", "16", "--batch-size", "128", "--epochs", "1"]


def test_it_writes_an_agent_that_plays(tmp_path, capsys):
    assert command.main([*FEW, "--seed", "3", "--out", str(tmp_path)]) == 0
    path = tmp_path / "resident_ppo-seed3.onnx"
    assert capsys.readouterr().out.strip() == str(path)
    file = agent_file.checked(path.read_bytes())
    assert file.metadata.parameters["lanes"] == 32
    observations, _ = RoughTurningVectorEnv(5).reset(seed=1)
    actions = OnnxPolicy(session_of(file.content), file.memory_size, 5).act(observations)
    assert actions.shape == (5, 2)
    assert (np.abs(actions) <= 1.0).all()


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_it_says_so(tmp_path, capsys):
    assert command.main(["--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("error: ")
    assert not list(tmp_path.iterdir())


def test_an_unknown_scenario_is_named(capsys):
    assert command.main([*FEW, "--scenario", "nowhere"]) == 2
    assert "error: no preset and no file is called 'nowhere'" in capsys.readouterr().err


def test_an_interruption_writes_nothing(tmp_path, capsys, monkeypatch):
    def interrupted(learner, rollout):
        raise KeyboardInterrupt

    monkeypatch.setattr("train.resident.ppo.Learner.update", interrupted)
    assert command.main([*FEW, "--out", str(tmp_path)]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments", [["--lanes", "0"], ["--batch-size", "-1"], ["--seed", "-1"], ["--device", "tpu"]])
def test_bad_arguments_are_refused(arguments, capsys):
    with pytest.raises(SystemExit, match="2"):
        command.main(arguments)
    assert arguments[1] in capsys.readouterr().err
