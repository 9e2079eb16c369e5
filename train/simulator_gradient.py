"""Train a recurrent agent with gradients of the simulator's charged cost, for one training seed.

    python -m train.simulator_gradient --env RoughTurning-Family-v1 --seed 0

The agent has a memory (a GRU) and sees observations only. Its teacher is the simulator: before
every step, copies of the lathe try a slightly higher and lower speed and feed. The difference of
what they are charged is the gradient of the step's cost with respect to the agent's set point
(``train/simulator_teacher.py``). Backpropagation carries it through the agent's memory to its
observations. There is no value function: the price of the edge's life stands for what comes later.
The agent that plays is an average over the updates.

The same command resumes an interrupted training, and does nothing if training is finished. Files:
see ``train/training.py``. (Gradients of a simulator: Freeman et al. 2021, arXiv 2106.13281;
averages over updates: Polyak and Juditsky 1992, doi 10.1137/0330046; GRU: Cho et al. 2014, arXiv
1406.1078.)
"""

import sys
from collections.abc import Sequence
from copy import deepcopy
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from optuna.distributions import CategoricalDistribution, FloatDistribution
from stable_baselines3.common.vec_env import VecEnv
from torch.nn.functional import softplus

from train.analytic_actor import GruActor
from train.gradient_algorithm import GradientAlgorithm, Rollout, options_of, sets_the_feed
from train.run import Run
from train.simulator_teacher import FEED, SPEED, Lesson, TrialVecEnv
from train.training import Algorithm, command_line
from turning_env import Scenario

Tensor = torch.Tensor


class SetPointActor(GruActor):
    """A GRU of ``cells``, with two layers of 2 * ``cells`` and ``cells`` units behind it.

    Its outputs are set points of speed and feed, positions -1..1 in the job's ranges, and an
    edge-change score.
    """

    def __init__(self, scenario: Scenario, entries: int, cells: int) -> None:
        super().__init__(scenario, entries, cells)
        wide = torch.nn.Linear(cells + entries, 2 * cells)
        narrow = torch.nn.Linear(2 * cells, cells)
        self.hidden: Any = torch.nn.Sequential(wide, torch.nn.ReLU(), narrow)


class AveragedPolicy(torch.nn.Module):
    """An actor that learns, and its average over the updates, which plays in the end."""

    def __init__(self, actor: SetPointActor) -> None:
        super().__init__()
        self.actor = actor
        self.average = deepcopy(actor).requires_grad_(False)

    def follow(self, decay: float) -> None:
        """Let the average follow the actor, with a share ``decay`` of its own left."""
        with torch.no_grad():
            torch._foreach_lerp_(
                list(self.average.parameters()), list(self.actor.parameters()), 1.0 - decay
            )


class TaughtStep(NamedTuple):
    """A step and what the teacher tells about it."""

    lesson: Lesson
    """Its ``gradient`` is 0 where the agent changes the edge."""
    edge_left: NDArray[np.bool_]
    """Whether the agent has changed the edge or the episode has ended, shape (num_envs,)."""


class Taught(NamedTuple):
    """The lessons of a rollout; tensors of shape (steps, num_envs, ...)."""

    gradient: Tensor
    """See ``Lesson``."""
    going_on: Tensor
    """See ``earnings_ahead``."""


class SimulatorGradient(GradientAlgorithm):
    """The algorithm; see the module's docstring."""

    updates: int = 0
    """Steps of gradient descent so far."""

    def new_policy(self, entries: int) -> AveragedPolicy:
        """Return a new agent and its average."""
        return AveragedPolicy(SetPointActor(self.scenario, entries, self.settings.cells))

    @property
    def actor(self) -> SetPointActor:
        """The agent that learns."""
        agent: SetPointActor = self.policy.actor
        return agent

    def explored(self, actions: Tensor) -> Tensor:
        """Return actions with noise, but edges are changed without it."""
        targets = self.actor.commands.targets
        noisy = actions.clone()
        noise = torch.randn_like(actions[:, :targets])
        noisy[:, :targets] += self.settings.exploration * noise
        return noisy

    def take(self, actions: NDArray[np.float32]) -> tuple[Any, TaughtStep]:
        """Take a step; return its result and what the simulator teaches about it."""
        lesson = self.env.lesson(actions)
        changed = np.zeros(len(actions), np.bool_)
        if self.actor.commands.changes_edges:
            changed = actions[:, -1] > 0.0
        # The set point of a step that changes the edge is not that of the edge in use.
        lesson.gradient[changed] = 0.0
        self.logger.record_mean("train/cost", float(lesson.cost.mean()))
        result = self.env.step(actions)
        _, _, ended, _ = result
        return result, TaughtStep(lesson, edge_left=changed | ended)

    def stacked(self, lessons: list[TaughtStep]) -> Taught:
        """Return lessons with a first axis of steps."""
        return Taught(
            gradient=torch.from_numpy(np.stack([step.lesson.gradient for step in lessons])),
            going_on=torch.from_numpy(earnings_ahead(lessons, self.settings.change_lambda)),
        )

    def after_update(self) -> None:
        """Let the average follow the agent."""
        self.updates += 1
        # At first, the mean of all updates: the first ones are soon forgotten.
        self.policy.follow(min(self.settings.average_decay, 1.0 - 1.0 / self.updates))

    def objective(self, rollout: Rollout, envs: Tensor) -> Tensor:
        """Return an objective [s per step] of some environments, whose gradient is the teacher's.

        A set point beyond the reach of one step has the gradient of the reached one
        (straight-through estimator).
        """
        actor = self.actor
        unbounded = actor.unroll(
            rollout.observations[:, envs],
            cells=rollout.memory[envs],
            begins=rollout.begins[:, envs],
        )
        commanded = actor.commands.commanded(
            actor.bounded(unbounded), rollout.observations[:, envs]
        )
        gradients = rollout.lessons.gradient[:, envs]
        gain = gradients[..., SPEED] * commanded.speed + gradients[..., FEED] * commanded.feed
        objective: Tensor = gain.mean()
        if actor.commands.changes_edges:
            going_on = rollout.lessons.going_on[:, envs]
            objective = objective + edge_change_gain(unbounded[..., -1], going_on).mean()
        return objective


def earnings_ahead(steps: Sequence[TaughtStep], change_lambda: float) -> NDArray[np.float32]:
    """Return mean earnings of going on with the edge from each step on [s].

    Later steps of the rollout with the same edge count by powers of l = ``change_lambda``. With the
    earnings e of a step, the mean G of the step t is

        G_t = (1 - l) e_t + l G_(t+1),

    but e_t if the edge has no later step, as if it had gone on to earn as much, and (1 - l) e_t if
    the edge fails. After the last step of the rollout an edge goes on, but does not fail for sure.

    Args:
        steps: the steps of a rollout.
        change_lambda: from 0, where one step decides, to 1.

    Returns:
        Means, shape (steps, num_envs).
    """
    means = np.empty((len(steps), *steps[0].lesson.going_on.shape), np.float32)
    later = np.maximum(steps[-1].lesson.going_on, 0.0)
    for index in reversed(range(len(steps))):
        lesson = steps[index].lesson
        earnings = lesson.going_on
        after = np.where(steps[index].edge_left, earnings, later)
        after = np.where(lesson.failed, 0.0, after)
        later = (1.0 - change_lambda) * earnings + change_lambda * after
        means[index] = later
    return means


def edge_change_gain(score: Tensor, going_on: Tensor) -> Tensor:
    """Return an objective whose maximum makes ``score`` positive if the edge should be changed.

    It is best to change an edge as soon as one more step with it has negative expected earnings
    (optimal stopping in the monotone case, Chow and Robbins 1961). The earnings ``going_on`` [s]
    of that step, or their mean over later ones, are uncertain in advance. A logistic loss weighted
    by them is least if ``score`` has the opposite sign of their expectation. All have one shape.
    """
    return -(torch.relu(going_on) * softplus(score) + torch.relu(-going_on) * softplus(-score))


def new_model(run: Run, vec_env: VecEnv) -> SimulatorGradient:
    """Return an untrained model."""
    assert isinstance(vec_env, TrialVecEnv)
    options = options_of(run, SimpleNamespace(**run.parameters))
    return SimulatorGradient(SetPointActor, vec_env, **options)


def network(policy: AveragedPolicy) -> SetPointActor:
    """Return the agent of a trained policy."""
    return policy.average


DEFAULTS: dict[str, Any] = {
    "total_timesteps": 12_000_000,  # environment steps of the whole training
    "num_envs": 256,  # environments side by side
    "n_steps": 64,  # steps per environment between updates, and the reach of gradients
    "batch_envs": 128,  # environments in one step of gradient descent
    "n_epochs": 1,  # how often each rollout is used
    "cells": 192,  # of the GRU
    "learning_rate": 1e-3,  # falls linearly ...
    "final_learning_rate": 1e-5,  # ... to this
    # Weight of later steps in whether to change the edge. Where edges break at random, one step
    # teaches little: earnings_ahead.
    "change_lambda": 0.0,
    "exploration": 0.05,  # standard deviation of the noise on actions
    "max_grad_norm": 0.5,
    "average_decay": 0.998,  # share of the averaged network that an update leaves
    "reward_scale": 1.0,  # the gradient does not use rewards
    "memory": True,  # the GRU remembers
    "derived": False,  # shows the inputs of baselines/derived_observation.py
}

SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "n_steps": CategoricalDistribution([32, 64, 128]),
    "cells": CategoricalDistribution([64, 128, 192]),
}

ALGORITHM = Algorithm(
    name="simulator_gradient",
    model=SimulatorGradient,
    new_model=new_model,
    network=network,
    defaults=DEFAULTS,
    search=SEARCH,
    training_information=("simulator gradients", "life price", "spreads"),
    vec_env=TrialVecEnv,
    plays=sets_the_feed,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
