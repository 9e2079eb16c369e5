"""Scripts of one library each, made small.

What the clone's pins exclude is skipped here, and tried by ``make clients``.
"""

import re
from importlib import import_module

import numpy as np
import pytest

from examples.safe_rl import CostStep
from examples.shared import score
from examples.stable_baselines import main
from turning_env import FAMILY_ID, IDS, RoughTurningEnv
from turning_env.policy import Observations

SMALL = "--num-envs 8 --total-timesteps 2048 --rollout 512 --tuning-seeds 1"


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", ["recurrent_ppo", "sac --vec-env gymnasium", f"ppo --env {FAMILY_ID}"]
)
def test_every_algorithm_learns(options: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(f"--algorithm {options} {SMALL}".split()) == 0
    algorithm = options.split()[0]
    assert capsys.readouterr().out.startswith(f"{algorithm} after 2048 steps: -")


@pytest.mark.slow
def test_torchrl_checks_every_id(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torchrl")
    assert import_module("examples.torch_rl").main(["--steps", "40", "--num-envs", "8"]) == 0
    output = capsys.readouterr().out
    assert [env_id for env_id in IDS if f"{env_id}: checked\n" not in output] == []
    assert "random actions: (8, 5)" in output
    assert "mean cost " in output


@pytest.mark.parametrize(
    ("num_seeds", "pattern"),
    [
        (1, r"-\d\d s per episode \(1 tuning seed\)"),
        (2, r"-\d\d\.\d+ s per episode \(standard error \d\.\d+, 2 tuning seeds\)"),
    ],
)
def test_small_returns_have_decimals(num_seeds: int, pattern: str) -> None:
    def full_override(observations: Observations) -> Observations:
        return np.ones((len(observations), 1), np.float32)

    assert re.fullmatch(pattern, score(full_override, num_seeds, "RoughTurning-Override-v1"))


def test_a_step_has_a_cost_whose_sum_says_whether_a_policy_is_feasible() -> None:
    env = CostStep(RoughTurningEnv())
    plain = RoughTurningEnv()
    env.reset(seed=0)
    plain.reset(seed=0)
    total = severe = engaged = 0.0
    full = np.ones(2, np.float32)
    for _ in range(30):
        observation, reward, cost, terminated, _, info = env.step(full)
        expected_observation, expected_reward, *_ = plain.step(full)
        np.testing.assert_array_equal(observation, expected_observation)
        assert reward == expected_reward - info["reward_overload"]
        total += cost
        severe += info["severe_overload_time"]
        engaged += info["engaged_time"]
        if terminated:
            break
    assert severe > 0.0
    assert total == pytest.approx(severe - 0.05 * engaged)
