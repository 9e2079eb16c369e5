from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from baselines.guided import HOLD
from leaderboard.agents import onnx_policy
from leaderboard.agents.agent_file import informed
from tests.train.small import Interruption
from train import export, guided_ppo
from train.run import Run
from train.training import train
from turning_env import FAMILY_ID, Family, FamilyVectorEnv, RoughTurningVectorEnv, Scenario
from turning_env.policy import Policy

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
    models = [FAMILY.job(seed).scenario for seed in range(2)]

    def small_run(name: str) -> Run:
        return Run.plan(
            "guided_ppo",
            FAMILY_ID,
            scenario=FAMILY,
            seed=1,
            runs=tmp_path / name,
            command="a command",
            given=SMALL,
        )

    def exported(run: Run, name: str) -> Policy:
        """Return the policy in the file of a run, for both jobs."""
        file = export.export(run.folder, tmp_path / "agents" / name)
        agent = onnx_policy.load(Path(file["path"]))
        return informed(agent, models)(2)

    whole = small_run("whole")
    train(whole, algorithm, checkpoint_every=32)
    cut = small_run("cut")
    interrupting = replace(algorithm, callbacks=lambda run: [Interruption(40)])
    with pytest.raises(KeyboardInterrupt):
        train(cut, interrupting, checkpoint_every=32)
    train(cut, algorithm, checkpoint_every=32)

    guide = exported(whole, "whole")
    resumed_guide = exported(cut, "cut")
    env = FamilyVectorEnv(2, FAMILY)
    observations, _ = env.reset(seed=[0, 1])
    for _ in range(2 * HOLD):
        actions = guide.act(observations)
        np.testing.assert_array_equal(actions, resumed_guide.act(observations))
        observations, *_ = env.step(actions)


def test_a_guide_plays_a_lathe_of_ones_own() -> None:
    agent = onnx_policy.load(Path("agents/RoughTurning-Family-v1/unmodelled/guided_ppo-seed0.onnx"))
    values = {"adhesion": 0.5}
    env = RoughTurningVectorEnv(2)
    observations, _ = env.reset(seed=[0, 1])
    guide = informed(agent, Scenario(), values | {"stiffness": 0.7})(2)
    assert env.action_space.contains(guide.act(observations))
    with pytest.raises(ValueError, match="stiffness"):
        informed(agent, Scenario(), values)(2)
