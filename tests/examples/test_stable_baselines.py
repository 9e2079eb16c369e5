"""Stable-Baselines3 and sb3-contrib, made small."""

import numpy as np
import pytest

from examples import stable_baselines
from examples.stable_baselines import lathes, main


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["adapter", "single"])
@pytest.mark.parametrize(("algorithm", "steps"), [("ppo", 1), ("recurrent_ppo", 1), ("sac", 2010), ("tqc", 2010)])
def test_every_algorithm_learns_on_both_kinds_of_lathes(
    algorithm: str, steps: int, kind: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stable_baselines, "ROLLOUT", 512)
    assert (
        main(["--algorithm", algorithm, "--lathes", kind, "--num-envs", "8", "--steps", str(steps), "--tuning-seeds", "1"]) == 0
    )
    done = {1: 512, 2010: 2016}[steps]
    assert capsys.readouterr().out.startswith(f"{algorithm} after {done} steps: -")


def test_both_kinds_of_lathes_play_the_same() -> None:
    adapter, single = lathes("adapter", 3, 7), lathes("single", 3, 7)
    np.testing.assert_array_equal(adapter.reset(), single.reset())
    actions = np.full((3, 2), 0.3, np.float32)
    for _ in range(20):
        seen, rewards, *_ = adapter.step(actions)
        expected, unscaled, *_ = single.step(actions)
        np.testing.assert_array_equal(seen, expected)
        np.testing.assert_allclose(rewards, unscaled / 3, rtol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--steps", "0"], "--steps: is 0, but must be a whole number of at least 1"),
        (["--seed", "x"], "--seed: is x, but must be a whole number of at least 0"),
        (["--num-envs", "3000"], "--num-envs is 3000, but must be at most 2048"),
    ],
)
def test_bad_arguments_are_refused(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    assert said in capsys.readouterr().err
