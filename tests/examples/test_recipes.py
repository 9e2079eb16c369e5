"""Scripts of one library each, made small. What the clone's pins exclude is skipped here, and tried by ``make clients``."""

from importlib import import_module

import numpy as np
import pytest

from examples.stable_baselines import main, make_envs
from turning_env import IDS


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "vec_env", "steps"),
    [
        *(("ppo", "batch", 512), ("ppo", "gymnasium", 512), ("recurrent_ppo", "batch", 512)),
        *(("sac", "gymnasium", 2016), ("tqc", "batch", 2016)),
    ],
)
def test_every_algorithm_of_stable_baselines_learns(
    algorithm: str, vec_env: str, steps: int, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ["--num-envs", "8", "--steps", str(steps), "--rollout", "512", "--tuning-seeds", "1"]
    assert main(["--algorithm", algorithm, "--vec-env", vec_env, *small]) == 0
    assert capsys.readouterr().out.startswith(f"{algorithm} after {steps} steps: -")


def test_the_batch_and_single_environments_play_the_same() -> None:
    batch, single = make_envs("batch", 3, 7), make_envs("gymnasium", 3, 7)
    np.testing.assert_array_equal(batch.reset(), single.reset())
    actions = np.full((3, 2), 0.3, np.float32)
    for _ in range(20):
        seen, rewards, *_ = batch.step(actions)
        expected, unscaled, *_ = single.step(actions)
        np.testing.assert_array_equal(seen, expected)
        np.testing.assert_allclose(rewards, unscaled / 3, rtol=1e-6)


@pytest.mark.slow
def test_torchrl_checks_every_id(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torchrl")
    assert import_module("examples.torch_rl").main(["--steps", "40", "--num-envs", "8"]) == 0
    said = capsys.readouterr().out
    assert all(f"{env_id}: checked\n" in said for env_id in IDS)
    assert "random actions: (8, 5)" in said


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # what the libraries do is not this project's
@pytest.mark.parametrize(
    ("library", "recipe"),
    [("ray", "rllib_ppo"), ("sbx", "sbx_sac"), ("skrl", "skrl_ppo")],
)
def test_other_libraries_learn(library: str, recipe: str, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip(library)
    assert import_module(f"examples.{recipe}").main(["--steps", "500", "--tuning-seeds", "2"]) == 0
    assert " s per episode " in capsys.readouterr().out.splitlines()[-1]


def test_bad_arguments_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["--steps", "0"])
    assert "--steps: is 0, but must be a whole number of at least 1" in capsys.readouterr().err
