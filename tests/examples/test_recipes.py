"""Scripts of one library each, made small. What the clone's pins exclude is skipped here, and tried by ``make clients``."""

from importlib import import_module

import pytest

from examples.stable_baselines import main
from turning_env import FAMILY_ID, IDS


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", ["recurrent_ppo", "sac --vec-env gymnasium", f"ppo --env {FAMILY_ID}"]
)
def test_every_algorithm_learns(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(
            f"--algorithm {words} --num-envs 8 --steps 2048 --rollout 512 --tuning-seeds 1".split()
        )
        == 0
    )
    assert capsys.readouterr().out.startswith(f"{words.split()[0]} after 2048 steps: -")


@pytest.mark.slow
def test_torchrl_checks_every_id(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torchrl")
    assert import_module("examples.torch_rl").main(["--steps", "40", "--num-envs", "8"]) == 0
    said = capsys.readouterr().out
    assert all(f"{env_id}: checked\n" in said for env_id in IDS)
    assert "random actions: (8, 5)" in said
