"""The differentiable gain charges what the environment charges, and its gradients teach."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from baselines.optimiser import worth
from leaderboard.play import play
from leaderboard.seeds import tuning_seeds
from train.analytic_actor import ACTUAL, TargetCommands
from train.analytic_gradient import ALGORITHM, HindsightVecEnv
from train.model_gain import HiddenSteps, ModelGain, Truth
from train.run import Run, hyperparameters
from train.training import load_agent, train
from turning_env import Scenario
from turning_env.vector_env import info_at_end_of_step

BASE = Scenario.load("rough_turning")
SMALL = {
    "total_timesteps": 40_000,
    "num_envs": 64,
    "batch_envs": 16,
    "cells": 32,
}
NUM_ENVS = 16
STEPS = 240


@pytest.mark.slow
def test_its_gradients_teach_an_agent_in_seconds(tmp_path: Path) -> None:
    settings = hyperparameters("analytic_gradient", "RoughTurning-v0") | SMALL
    run = Run.plan("analytic_gradient", "RoughTurning-v0", BASE, 3, tmp_path, "a command", settings)
    train(run, ALGORITHM)
    returns = play(load_agent(run.folder).make, BASE, tuning_seeds(8))["return"]
    assert returns.mean() > -1000.0  # untrained agents return -2800


class ReportingVecEnv(HindsightVecEnv):
    """Environments that keep the price of overload of the last step [s], shape (num_envs,)."""

    overload: NDArray[np.float64]

    def training_rewards(self, rewards: Any, infos: dict[str, Any]) -> Any:
        self.overload = -info_at_end_of_step(infos, "reward_overload")
        return super().training_rewards(rewards, infos)


class Played(NamedTuple):
    """Steps of environments; arrays have shape (steps, num_envs, ...)."""

    observations: torch.Tensor
    targets: torch.Tensor
    hidden: HiddenSteps
    overload: NDArray[np.float64]


@pytest.fixture(scope="module")
def played() -> Played:
    """Random set points, held for a while each, on lagging drives."""
    env = ReportingVecEnv(BASE, NUM_ENVS)
    commands = TargetCommands(BASE)
    random = np.random.default_rng(1)
    env.seed(5)
    observations = env.reset()
    observations_of_steps = []
    targets = []
    hidden = []
    overload = []
    for step in range(STEPS):
        if step % 15 == 0:
            target = random.uniform([0.2, -0.2], [0.9, 0.6], (NUM_ENVS, 2))
        targets.append(torch.tensor(target, dtype=torch.float32))
        observations_of_steps.append(torch.from_numpy(observations))
        actions = commands.action(targets[-1], observations_of_steps[-1])
        observations, *_ = env.step(actions.numpy())
        hidden.append(env.last_step)
        overload.append(env.overload)
    return Played(
        observations=torch.stack(observations_of_steps),
        targets=torch.stack(targets),
        hidden=HiddenSteps.stacked(hidden),
        overload=np.stack(overload),
    )


def gains(scenario: Scenario, played: Played, more_for_life: float = 0.0) -> NDArray[np.float64]:
    """Return the gain of each step [s], with a higher price of edge life [s]."""
    prices = worth(BASE)
    prices = prices._replace(life=prices.life + more_for_life)
    commands = TargetCommands(BASE)
    result: NDArray[np.float64] = (
        ModelGain(scenario, prices)(
            commands.commanded(played.targets, played.observations),
            commands.speed_and_feed(played.observations, ACTUAL),
            Truth(BASE, played.hidden),
        )
        .gain.detach()
        .numpy()
    )
    return result


def test_a_step_starts_where_the_one_before_has_ended(played: Played) -> None:
    # No episode ends within these steps.
    before = played.hidden.before
    np.testing.assert_array_equal(before[0], np.zeros(NUM_ENVS, before.dtype))
    np.testing.assert_array_equal(before[1:], played.hidden.after[:-1])


def test_overload_is_charged_as_the_environment_charges_it(played: Played) -> None:
    free_economics = BASE.economics.model_copy(update={"overload_price": 0.0})
    free = BASE.model_copy(update={"economics": free_economics})
    charged = gains(free, played) - gains(BASE, played)
    assert played.overload.max() > 1.0
    # Entries and exits are known to a fifth of a step.
    depth_before = played.hidden.before["depth_of_cut"]
    depth_after = played.hidden.after["depth_of_cut"]
    inside = (depth_before > 0) & (depth_after > 0)
    np.testing.assert_allclose(charged[inside], played.overload[inside], atol=0.25)
    assert abs(charged.sum() / played.overload.sum() - 1.0) < 0.05


def test_life_is_charged_as_the_environment_uses_it(played: Played) -> None:
    charged = gains(BASE, played) - gains(BASE, played, more_for_life=1000.0)
    charged_life = charged.sum(0) / 1000.0
    used_life = (played.hidden.after["used_life"] - played.hidden.before["used_life"]).sum(0)
    # Inserts wear more or less than the nominal one.
    assert 0.7 < np.median(charged_life / used_life) < 1.4
