"""The linear policy by CMA-ES."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.train.small import SCENARIO, small_run
from train.linear_cma_es import ALGORITHM, GroupedVecEnv, LinearCmaEs, LinearPolicy
from train.linear_start import nominal_optimum
from train.training import new_model, train
from turning_env import FAMILY_ID, Family


def test_candidates_play_the_same_episodes() -> None:
    env = GroupedVecEnv(SCENARIO, 6)
    env.seed_groups(first_seed=10, group_size=3)
    first = env.reset()
    assert np.array_equal(first[:3], first[3:])
    same = np.zeros((6, 2), np.float32)
    for _ in range(5):
        observations, rewards, *_ = env.step(same)
    assert np.array_equal(observations[:3], observations[3:])
    assert np.array_equal(rewards[:3], rewards[3:])
    assert len(np.unique(observations[:3], axis=0)) == 3


@pytest.mark.slow
def test_the_search_finds_a_better_policy(tmp_path: Path) -> None:
    """The first generation is about as good as no action; the last is better."""
    run = small_run(
        ALGORITHM,
        tmp_path,
        total_timesteps=40_000,
        sigma=0.3,
    )
    train(run, ALGORITHM)
    curve = run.read_learning_curve()
    assert curve[-1]["mean_return"] > curve[0]["mean_return"] + 30.0


def test_the_agent_is_the_mean_of_the_search(tmp_path: Path) -> None:
    run = small_run(ALGORITHM, tmp_path)
    train(run, ALGORITHM)
    model = LinearCmaEs.load(run.policy)
    assert isinstance(model.policy, LinearPolicy)
    layer = model.policy.action_net
    numbers = [*layer.weight.detach().numpy().ravel(), *layer.bias.detach().numpy()]
    assert numbers == pytest.approx(model.search.mean, rel=1e-6)


def test_environments_must_be_a_multiple_of_candidates(tmp_path: Path) -> None:
    run = small_run(ALGORITHM, tmp_path, num_envs=10)
    with pytest.raises(ValueError, match="num_envs is 10, but must be a multiple"):
        new_model(run, ALGORITHM)


@pytest.mark.slow
def test_a_search_on_a_family_starts_at_the_nominal_optimum(tmp_path: Path) -> None:
    shop = Family.load("shop")
    run = small_run(ALGORITHM, tmp_path, shop, FAMILY_ID)
    layer = new_model(run, ALGORITHM).policy.action_net
    start = nominal_optimum(shop)
    assert layer.weight.detach().numpy() == pytest.approx(start.matrix, rel=1e-6)
    assert layer.bias.detach().numpy() == pytest.approx(start.constants, rel=1e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {"hides_context": True},
        {"belief": True},
        {"frames": 2},
        {"initial_actions": [0.0, 0.0, 0.0]},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_search_that_sees_something_else_starts_at_the_programmed_set_point(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    """So does one whose first actions are stated."""
    run = small_run(ALGORITHM, tmp_path, Family.load("shop"), FAMILY_ID, **changes)
    layer = new_model(run, ALGORITHM).policy.action_net
    assert not layer.weight.any()
    assert not layer.bias.any()
