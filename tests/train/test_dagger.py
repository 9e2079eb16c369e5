"""A student of ``self_tuning`` by DAgger."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from baselines.self_tuning import RULES, SelfTuning
from leaderboard.agents import onnx_policy
from leaderboard.agents.agent_file import informed
from tests.train.small import Interruption
from train import dagger, export
from train.run import Run
from train.training import load_agent, train
from turning_env import FAMILY_ID, Family, FamilyVectorEnv

FAMILY = Family.load({"extends": "shop", "jobs": 16, "planned": {"control.time_limit": 0.1}})
"""Few jobs, of six steps each."""
SMALL = {
    "total_timesteps": 96,
    "num_envs": 4,
    "n_steps": 8,
    "teacher_steps": 8,
    "teacher_share": 0.25,
    "n_updates": 2,
    "batch_size": 16,
    "net_arch": [8],
}


def small_run(folder: Path) -> Run:
    return Run.plan("dagger", FAMILY_ID, FAMILY, 1, folder, "a command", SMALL)


def test_the_teacher_acts_as_the_rule_on_every_job_that_follows() -> None:
    env: Any = dagger.TaughtVecEnv(FAMILY, 2)
    env.seed(7)
    observations = env.reset()
    ended = np.ones(2, np.bool_)
    rules = {}
    for _ in range(15):
        for index in np.flatnonzero(ended):
            nominal = env.vector_env.job(index).scenario.nominal()
            rules[index] = SelfTuning(nominal, 1, **RULES["self_tuning"].fixed)
            rules[index].reset(np.ones(1, np.bool_))
        actions = env.labels()
        for index, rule in rules.items():
            expected = rule.act(observations[index : index + 1, :12])[0]
            np.testing.assert_allclose(actions[index], expected, atol=1e-6)
        observations, _, ended, _ = env.step(actions)


@pytest.mark.slow
def test_an_interrupted_training_gives_the_same_student_whose_file_plays_jobs(
    tmp_path: Path,
) -> None:
    algorithm = dagger.ALGORITHM
    whole = small_run(tmp_path / "whole")
    cut = small_run(tmp_path / "cut")
    train(whole, algorithm, checkpoint_every=32)
    interrupting = replace(algorithm, callbacks=lambda run: [Interruption(70)])
    with pytest.raises(KeyboardInterrupt):
        train(cut, interrupting, checkpoint_every=32)
    train(cut, algorithm, checkpoint_every=32)
    assert not (cut.folder / dagger.DATASET).exists()

    file = export.export(cut.folder, tmp_path / "agents")
    models = [FAMILY.job(seed).scenario for seed in range(2)]
    student = informed(load_agent(whole.folder), models)(2)
    exported_student = informed(onnx_policy.load(Path(file["path"])), models)(2)
    env = FamilyVectorEnv(2, FAMILY)
    observations, _ = env.reset(seed=[0, 1])
    for _ in range(4):
        actions = student.act(observations)
        np.testing.assert_allclose(actions, exported_student.act(observations), atol=1e-5)
        observations, *_ = env.step(actions)


def test_too_high_a_feed_costs_more_than_too_low_a_feed() -> None:
    label = torch.tensor([[1.0, 0.1, -1.0]])

    def loss(speed_error: float = 0.0, feed_error: float = 0.0) -> float:
        outputs = label + torch.tensor([speed_error, feed_error, 0.0])
        return float(dagger.ErrorCosts().loss(outputs, label))

    assert loss(feed_error=0.3) > loss(feed_error=-0.3) > loss()
    # Actions are clipped at 1.
    assert loss(speed_error=0.5) == loss()
    assert loss(speed_error=-0.5) > loss()
