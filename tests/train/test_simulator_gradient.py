"""An agent learns from the simulator's lessons, and its training resumes."""

import io
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from leaderboard.agents import onnx_policy
from leaderboard.agents.agent_file import informed
from leaderboard.inputs import class_of
from leaderboard.play import play, play_family
from leaderboard.seeds import tuning_seeds
from tests.train.small import Interruption, small_run
from tests.train.test_dagger import FAMILY
from tests.turning_env.test_family_env import BRIEF
from train import export
from train.run import Run, overrides
from train.simulator_gradient import (
    ALGORITHM,
    TaughtStep,
    earnings_ahead,
    edge_change_gain,
)
from train.simulator_teacher import Lesson
from train.training import VALIDATION, load_agent, play_agent, train
from turning_env import FAMILY_ID, Family, Scenario

BASE = Scenario.load("rough_turning")


@pytest.mark.slow
def test_lessons_teach_an_agent_in_seconds(tmp_path: Path) -> None:
    settings: dict[str, Any] = {
        "total_timesteps": 60_000,
        "num_envs": 64,
        "batch_envs": 16,
        "cells": 32,
    }
    settings |= {"learning_rate": 2e-3, "average_decay": 0.9}
    run = Run.plan(ALGORITHM.name, "RoughTurning-v0", BASE, 3, tmp_path, "a command", settings)
    train(run, ALGORITHM)
    agent = informed(load_agent(run.folder), BASE)
    returns = play(agent, BASE, tuning_seeds(8))["return"]
    assert returns.mean() > -2000.0  # untrained agents return -2800
    # The lathe computes with subnormal numbers, so a training must not flush them to 0.
    assert sys.float_info.min / 2.0 > 0.0


@pytest.mark.slow
def test_an_interrupted_training_on_jobs_gives_the_same_agent(tmp_path: Path) -> None:
    whole = small_run(ALGORITHM, tmp_path / "whole", FAMILY, FAMILY_ID)
    cut = small_run(ALGORITHM, tmp_path / "cut", FAMILY, FAMILY_ID)
    train(whole, ALGORITHM, checkpoint_every=256)
    interrupting = replace(ALGORITHM, callbacks=lambda run: [Interruption(550)])
    with pytest.raises(KeyboardInterrupt):
        train(cut, interrupting, checkpoint_every=256)
    assert cut.checkpoint.exists()
    train(cut, ALGORITHM, checkpoint_every=256)
    assert _weights(whole) == _weights(cut)


def _weights(run: Run) -> bytes:
    """Return the weights of a finished training as bytes."""
    stream = io.BytesIO()
    model = ALGORITHM.model.load(run.policy, device="cpu")
    torch.save(model.get_parameters(), stream)
    return stream.getvalue()


@pytest.mark.slow
def test_an_agent_of_jobs_has_a_file_that_plays_alike_and_states_its_training(
    tmp_path: Path,
) -> None:
    # Of short episodes, because all of them are played twice, step by step.
    family = Family.model_validate(BRIEF | {"held_out_jobs": 3})
    run = small_run(ALGORITHM, tmp_path, family, FAMILY_ID)
    train(run, ALGORITHM)
    assert export.main([str(run.folder), "--out", str(tmp_path)]) == 0
    agent = onnx_policy.load(next(tmp_path.glob("*.onnx")))
    assert class_of(agent) == "privileged agent"
    seeds = range(3)
    make = informed(agent, [family.job(seed, VALIDATION).scenario for seed in seeds])
    returns = play_family(family, VALIDATION, seeds, make)["return"]
    np.testing.assert_allclose(returns, play_agent(run.folder, 1)["return"], rtol=1e-3)


def test_the_change_of_an_edge_is_learned_from_the_sign_of_what_going_on_earns() -> None:
    score_of_edge = torch.zeros(2, requires_grad=True)
    going_on = torch.tensor([3.0, -1.0])
    gain = edge_change_gain(score_of_edge, going_on).sum()
    (slope,) = torch.autograd.grad(gain, score_of_edge)
    # The slope of the logistic loss at 0 is a half.
    np.testing.assert_allclose(slope.numpy(), np.array([-1.5, 0.5]))


def taught_step(going_on: list[float], failed: list[bool], edge_left: list[bool]) -> TaughtStep:
    """Return a step with some earnings; what else is taught is 0."""
    nothing = np.zeros(len(going_on), np.float32)
    lesson = Lesson(
        gradient=np.zeros((len(going_on), 2), np.float32),
        going_on=np.array(going_on, np.float32),
        failed=np.array(failed),
        cost=nothing,
    )
    return TaughtStep(lesson=lesson, edge_left=np.array(edge_left))


def test_earnings_ahead_are_those_of_later_steps_with_the_same_edge() -> None:
    steps = [
        taught_step([1.0, 1.0, 1.0], failed=[False] * 3, edge_left=[False] * 3),
        taught_step([1.0, -8.0, 2.0], failed=[False, True, False], edge_left=[False, False, True]),
        taught_step([1.0, 9.0, -9.0], failed=[False] * 3, edge_left=[False] * 3),
    ]
    means = earnings_ahead(steps, change_lambda=0.5)
    # A steady edge; one that breaks in the second step; one that is changed in it.
    np.testing.assert_allclose(means[:, 0], [1.0, 1.0, 1.0])
    np.testing.assert_allclose(means[:2, 1], [0.5 + 0.5 * -4.0, -4.0])
    np.testing.assert_allclose(means[:2, 2], [0.5 + 0.5 * 2.0, 2.0])
    # After the rollout, what earns goes on, and what does not may stop.
    np.testing.assert_allclose(means[2], [1.0, 9.0, -4.5])
    np.testing.assert_array_equal(
        earnings_ahead(steps, change_lambda=0.0), [step.lesson.going_on for step in steps]
    )


def test_a_weight_of_later_steps_above_1_is_refused() -> None:
    assert overrides(ALGORITHM.name, ["change_lambda=1"]) == {"change_lambda": 1.0}
    with pytest.raises(ValueError, match=r"change_lambda is 1\.5, but must be 0 to 1"):
        overrides(ALGORITHM.name, ["change_lambda=1.5"])
