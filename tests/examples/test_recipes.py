"""Scripts of one library each, made small. What the clone's pins exclude is skipped here, and tried by ``make clients``."""

from importlib import import_module

import pytest

from examples.stable_baselines import main
from turning_env import IDS


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "vec_env", "steps"), [("recurrent_ppo", "batch", 512), ("sac", "gymnasium", 2016)])
def test_every_algorithm_learns(algorithm: str, vec_env: str, steps: int, capsys: pytest.CaptureFixture[str]) -> None:
    small = ["--num-envs", "8", "--steps", str(steps), "--rollout", "512", "--tuning-seeds", "1"]
    assert main(["--algorithm", algorithm, "--vec-env", vec_env, *small]) == 0
    assert capsys.readouterr().out.startswith(f"{algorithm} after {steps} steps: -")


@pytest.mark.slow
def test_torchrl_checks_every_id(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torchrl")
    assert import_module("examples.torch_rl").main(["--steps", "40", "--num-envs", "8"]) == 0
    said = capsys.readouterr().out
    assert all(f"{env_id}: checked\n" in said for env_id in IDS)
    assert "random actions: (8, 5)" in said
