import math
from pathlib import Path

import numpy as np
import pytest

from tests.train.small import SCENARIO, small_run
from train import lagrangian_ppo, pid_lagrangian_ppo
from train.lagrangian_ppo import AllowanceVecEnv
from train.pid_lagrangian_ppo import PidVecEnv
from train.training import Algorithm, train
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.vector_env import info_at_end_of_step

OVERLOADING = Scenario.model_validate({"name": "weak", "tool": {"wear_criterion": 0.1}, "limits": {"thrust_force": 300.0}})
UNLIMITED = Scenario.model_validate(
    {"name": "strong", "tool": {"wear_criterion": 0.1}, "limits": {"thrust_force": 1e6, "power": 1e4}}
)
FASTER = np.ones((4, 2), np.float32)


def test_severe_overload_costs_the_multiplier_in_place_of_its_price() -> None:
    ours, theirs = AllowanceVecEnv(OVERLOADING, 4, 0.5), RoughTurningVecEnv(OVERLOADING, 4)
    reference = RoughTurningVectorEnv(4, OVERLOADING, "SameStep")
    ours.multiplier = 7.0
    for each in (ours, theirs):
        each.seed(5)
        each.reset()
    reference.reset(seed=5)
    ends, severe_time, engaged_time = 0, 0.0, 0.0
    for _ in range(300):
        _, rewards, dones, infos = ours.step(FASTER)
        _, full_rewards, _, full_infos = theirs.step(FASTER)
        *_, terms = reference.step(FASTER)
        names = ("reward_overload", "severe_overload_time", "engaged_time")
        overload, severe, engaged = (info_at_end_of_step(terms, name) for name in names)
        np.testing.assert_allclose(rewards, 0.5 * (full_rewards - overload - 7.0 * severe), rtol=1e-5, atol=1e-4)
        severe_time, engaged_time = severe_time + severe.sum(), engaged_time + engaged.sum()
        for index in np.flatnonzero(dones):
            assert infos[index]["episode"] == full_infos[index]["episode"]  # the environment's own return
            ends += 1
    assert ends > 3
    assert severe_time > 0.0
    ours.adapt(0.04, {"multiplier_rate": 2.0})
    assert ours.severe_share == pytest.approx(severe_time / engaged_time)
    assert ours.multiplier == pytest.approx(7.0 * math.exp(2.0 * (severe_time / engaged_time - 0.04)))


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", [lagrangian_ppo.ALGORITHM, pid_lagrangian_ppo.ALGORITHM], ids=["dual_ascent", "pid"])
@pytest.mark.parametrize(("scenario", "moves"), [(OVERLOADING, True), (UNLIMITED, False)], ids=["overloading", "unlimited"])
def test_the_multiplier_moves_only_where_something_overloads(
    algorithm: Algorithm, scenario: Scenario, moves: bool, tmp_path: Path
) -> None:
    run = small_run(algorithm, tmp_path, scenario, initial_multiplier=3.0)
    train(run, algorithm)
    multipliers = [row["multiplier"] for row in run.read_learning_curve()]
    assert multipliers
    assert (multipliers[-1] > 3.0) if moves else set(multipliers) == {3.0}


def test_too_little_overload_lets_the_multiplier_fall() -> None:
    vec_env = AllowanceVecEnv(SCENARIO, 1)
    vec_env._severe_time, vec_env._engaged_time = 1.0, 100.0
    vec_env.adapt(0.05, {"multiplier_rate": 1.0})
    assert vec_env.multiplier == pytest.approx(math.exp(-0.04))
    vec_env.adapt(0.05, {"multiplier_rate": 1.0})  # nothing was cut since
    assert vec_env.multiplier == pytest.approx(math.exp(-0.04))


def after(vec_env: AllowanceVecEnv, share: float, **parameters: float) -> float:
    """Return the multiplier after a rollout with a severe share of cutting time, for the target 0.1."""
    vec_env._severe_time, vec_env._engaged_time = 100.0 * share, 100.0
    vec_env.adapt(0.1, {"gain_p": 0.0, "gain_i": 0.0, "gain_d": 0.0, "smoothing": 0.0} | parameters)
    return vec_env.multiplier


def test_the_proportional_term_is_the_excess() -> None:
    vec_env = PidVecEnv(SCENARIO, 1)
    assert [after(vec_env, share, gain_p=10.0) for share in (0.4, 0.2, 0.0)] == pytest.approx([4.0, 2.0, 0.0])


def test_the_integral_sums_excesses_from_the_initial_multiplier_and_stays_at_0() -> None:
    vec_env = PidVecEnv(SCENARIO, 1)
    multipliers = [after(vec_env, share, gain_i=10.0) for share in (0.2, 0.0, 0.0, 0.0, 0.0, 0.3)]
    assert multipliers == pytest.approx([2.0, 1.0, 0.0, 0.0, 0.0, 2.0])


def test_the_derivative_term_brakes_a_rise_of_the_smoothed_share_only() -> None:
    vec_env = PidVecEnv(SCENARIO, 1)
    shares = (0.2, 0.2, 0.0, 0.4)  # smoothed by halves: 0.1, 0.15, 0.075, 0.2375
    braked = [after(vec_env, share, gain_d=10.0, smoothing=0.5) for share in shares]
    assert braked == pytest.approx([2.0, 1.5, 1.0, 2.625])
