from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from baselines.guided import HOLD
from tests.train.small import Interruption
from train import export, guided_ppo
from train.agents import onnx_policy
from train.agents.agent_file import informed
from train.run import Run
from train.training import train
from turning_env import FAMILY_ID, Family, FamilyVectorEnv, RoughTurningVectorEnv, Scenario

FAMILY = Family.load("unmodelled")
SMALL = {
    "total_timesteps": 64,
    "num_envs": 4,
    "n_steps": 8,
    "batch_size": 16,
    "n_epochs": 2,
    "guide": True,
}


@pytest.mark.slow
def test_an_interrupted_training_gives_the_same_guide_whose_file_plays_jobs(tmp_path: Path) -> None:
    algorithm = guided_ppo.ALGORITHM
    whole, cut = (
        Run.plan("guided_ppo", FAMILY_ID, FAMILY, 1, tmp_path / name, "a command", SMALL)
        for name in ("whole", "cut")
    )
    train(whole, algorithm, checkpoint_every=32)
    with pytest.raises(KeyboardInterrupt):
        train(
            cut, replace(algorithm, callbacks=lambda run: [Interruption(40)]), checkpoint_every=32
        )
    train(cut, algorithm, checkpoint_every=32)
    files = [
        export.export(run.folder, tmp_path / "agents" / name)
        for name, run in (("whole", whole), ("cut", cut))
    ]
    models = [FAMILY.job(seed).scenario for seed in range(2)]
    one, other = (informed(onnx_policy.load(Path(file["path"])), models)(2) for file in files)
    env = FamilyVectorEnv(2, FAMILY)
    observations, _ = env.reset(seed=[0, 1])
    for _ in range(2 * HOLD):
        actions = one.act(observations)
        np.testing.assert_array_equal(actions, other.act(observations))
        observations, *_ = env.step(actions)


def test_a_guide_plays_a_lathe_of_ones_own() -> None:
    agent = onnx_policy.load(Path("agents/RoughTurning-Family-v0/unmodelled/guided_ppo-seed0.onnx"))
    values = {
        "heat": 0.5,
        "adhesion": 0.5,
        "abrasion": 0.3,
        "toughness": 0.6,
        "heat_resistance": 0.5,
    }
    env = RoughTurningVectorEnv(2)
    observations, _ = env.reset(seed=[0, 1])
    assert env.action_space.contains(
        informed(agent, Scenario(), values | {"stiffness": 0.7})(2).act(observations)
    )
    with pytest.raises(ValueError, match="stiffness"):
        informed(agent, Scenario(), values)(2)
