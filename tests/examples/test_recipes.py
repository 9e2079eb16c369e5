"""Scripts of one library each, made small. What the clone's pins exclude is skipped here, and tried by ``make clients``."""

from importlib import import_module

import pytest

from examples.stable_baselines import main
from turning_env import FAMILY_ID, IDS


@pytest.mark.slow
@pytest.mark.parametrize("options", ["--algorithm recurrent_ppo", "--algorithm sac --vec-env gymnasium", f"--env {FAMILY_ID}"])
def test_algorithms_learn_on_every_id(options: str, capsys: pytest.CaptureFixture[str]) -> None:
    small = "--num-envs 8 --steps 2048 --rollout 512 --tuning-seeds 1"
    assert main(f"{options} {small}".split()) == 0
    assert " after 2048 steps: -" in capsys.readouterr().out


@pytest.mark.slow
def test_torchrl_checks_every_id(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torchrl")
    assert import_module("examples.torch_rl").main(["--steps", "40", "--num-envs", "8"]) == 0
    said = capsys.readouterr().out
    assert all(f"{env_id}: checked\n" in said for env_id in IDS)
    assert "random actions: (8, 5)" in said
