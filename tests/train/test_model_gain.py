"""The differentiable gain: what it charges is what the environment charges, and its gradients teach."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from baselines.optimiser import worth
from train.analytic_actor import ACTUAL, TargetCommands
from train.analytic_gradient import ALGORITHM, HindsightVecEnv
from train.model_gain import FIELDS, ModelGain, Truth
from train.run import Run, hyperparameters
from train.training import load_agent, train
from turning_env import Scenario
from turning_env.scoring.play import play
from turning_env.scoring.seeds import tuning_seeds
from turning_env.vector_env import info_at_end_of_step

BASE = Scenario.load("rough_turning")
SMALL = {"total_timesteps": 40_000, "num_envs": 64, "batch_envs": 16, "cells": 32}


@pytest.mark.slow
def test_its_gradients_teach_an_agent_in_seconds(tmp_path: Path) -> None:
    settings = hyperparameters("analytic_gradient", "RoughTurning-v0") | SMALL
    run = Run.plan("analytic_gradient", "RoughTurning-v0", BASE, 3, tmp_path, "a command", settings)
    train(run, ALGORITHM)
    returns = play(load_agent(run.folder).make, BASE, tuning_seeds(8))["return"]
    assert returns.mean() > -1000.0  # it begins at -2800


def test_overload_and_life_are_charged_as_the_environment_charges_them() -> None:
    """Random set points, held for a while each, on lagging drives."""

    class Reporting(HindsightVecEnv):
        overload: Any

        def training_rewards(self, rewards: Any, infos: dict[str, Any]) -> Any:
            self.overload = -info_at_end_of_step(infos, "reward_overload")
            return super().training_rewards(rewards, infos)

    num_envs = 16
    env, commands, random = (
        Reporting(BASE, num_envs),
        TargetCommands(BASE),
        np.random.default_rng(1),
    )
    env.seed(5)
    observations = env.reset()
    steps: list[tuple[Any, ...]] = []
    last, ends = np.zeros((len(FIELDS), num_envs)), 0
    for step in range(240):
        if step % 15 == 0:
            target = torch.tensor(
                random.uniform([0.2, -0.2], [0.9, 0.6], (num_envs, 2)), dtype=torch.float32
            )
        seen = torch.from_numpy(observations)
        observations, _, ended, _ = env.step(commands.action(target, seen).numpy())
        np.testing.assert_array_equal(
            env.before, last
        )  # a step starts where the one before has ended
        last, ends = np.where(ended, 0.0, env.after), ends + ended.sum()
        steps.append((seen, target, env.before, env.after, env.changed, env.failed, env.overload))
    *tensors, before, after, changed, failed, overload = zip(*steps, strict=True)
    seen, target = (torch.stack(each) for each in tensors)
    before, after, reported = np.stack(before), np.stack(after), np.stack(overload)
    truth = Truth(BASE, before, after, np.stack(changed), np.stack(failed))
    log_speed, log_feed = commands.commanded(target, seen)
    given = log_speed, log_feed, *commands.speed_and_feed(seen, ACTUAL), truth
    prices = worth(BASE)
    unpriced = BASE.model_copy(
        update={"economics": BASE.economics.model_copy(update={"overload_price": 0.0})}
    )
    gain, free = ModelGain(BASE, prices), ModelGain(unpriced, prices)
    dear = ModelGain(BASE, prices._replace(life=prices.life + 1000.0))
    charged = (free(*given)[0] - gain(*given)[0]).numpy()
    assert reported.max() > 1.0
    depth, used_life = FIELDS.index("depth_of_cut"), FIELDS.index("used_life")
    inside = (before[:, depth] > 0) & (
        after[:, depth] > 0
    )  # entries and exits are known to a fifth of a step
    np.testing.assert_allclose(charged[inside], reported[inside], atol=0.25)
    assert abs(charged.sum() / reported.sum() - 1.0) < 0.05
    life = (gain(*given)[0] - dear(*given)[0]).sum(0).numpy() / 1000.0
    used = (after[:, used_life] - before[:, used_life]).sum(0)
    assert 0.7 < np.median(life / used) < 1.4  # inserts wear more or less than the nominal one
