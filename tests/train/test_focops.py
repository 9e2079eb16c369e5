"""FOCOPS improves the policy and keeps it near the last one."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.distributions import Distribution, kl_divergence

from tests.train.small import small_run
from train.focops import ALGORITHM
from train.training import new_model

OBSERVATIONS = torch.from_numpy(np.random.default_rng(0).normal(size=(64, 11)).astype(np.float32))


def untrained(folder: Path, **changes: Any) -> Any:
    return new_model(small_run(ALGORITHM, folder, steps=512, final_learning_rate=1e-3, epochs=20, **changes), ALGORITHM)


def distribution(model: Any) -> Any:
    with torch.no_grad():
        return model.policy.get_distribution(OBSERVATIONS).distribution


def divergence(folder: Path, **changes: Any) -> float:
    """Return the mean KL divergence of the policy after one rollout's updates from the policy before them."""
    model = untrained(folder, **changes)
    before: Distribution = distribution(model)
    model.learn(512)
    return float(kl_divergence(distribution(model), before).sum(dim=1).mean())


@pytest.mark.slow
def test_limit_and_temperature_keep_the_policy_near_the_last_one(tmp_path: Path) -> None:
    far = divergence(tmp_path / "far", kl_limit=10.0, temperature=0.1)
    assert 0.0 < divergence(tmp_path / "limit", kl_limit=1e-4, temperature=0.1) < 0.2 * far
    assert 0.0 < divergence(tmp_path / "hot", kl_limit=10.0, temperature=100.0) < 0.2 * far


def test_actions_with_an_advantage_become_more_frequent(tmp_path: Path) -> None:
    model = untrained(tmp_path, kl_limit=0.1)
    model.learn(512)
    buffer, before = model.rollout_buffer, distribution(model).mean
    buffer.reset()
    observations = model.env.reset()
    while not buffer.full:
        with torch.no_grad():
            actions, values, log_probs = model.policy(torch.from_numpy(observations))
        advantages, starts = actions[:, 0].numpy(), np.zeros(len(actions))
        buffer.add(observations, actions.numpy(), advantages, starts, values, log_probs)
    buffer.advantages[:] = buffer.rewards
    model.train()
    moved = (distribution(model).mean - before).mean(dim=0)
    assert moved[0] > 5.0 * abs(float(moved[1]))
