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
from copy import deepcopy
from types import SimpleNamespace
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from optuna.distributions import CategoricalDistribution, FloatDistribution
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.type_aliases import MaybeCallback
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv
from torch.nn.functional import softplus

from train.actor import Actor
from train.analytic_actor import GruActor, TargetCommands
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

    def __init__(self, actor: SetPointActor, learning_rate: float) -> None:
        super().__init__()
        self.actor = actor
        self.average = deepcopy(actor).requires_grad_(False)
        self.optimizer = torch.optim.Adam(actor.parameters(), lr=learning_rate)

    def follow(self, decay: float) -> None:
        """Let the average follow the actor, with a share ``decay`` of its own left."""
        with torch.no_grad():
            torch._foreach_lerp_(
                list(self.average.parameters()), list(self.actor.parameters()), 1.0 - decay
            )


class Rollout(NamedTuple):
    """A rollout; its fields have shape (steps, num_envs, ...) unless they say otherwise."""

    memory: Tensor  # memory before the first step, shape (num_envs, memory_size)
    begins: Tensor  # 1 at the first step of an episode, else 0
    observations: Tensor
    gradients: Tensor  # ``Lesson.gradient``, 0 where the agent changes the edge
    going_on: Tensor  # ``Lesson.going_on``


class SimulatorGradient(BaseAlgorithm):
    """The algorithm, as a subclass of Stable-Baselines3's base class.

    The base class saves models, logs and runs callbacks.
    """

    policy: Any
    env: Any
    scenario: Any
    settings: Any
    updates: int = 0
    """Steps of gradient descent so far."""

    def __init__(
        self,
        policy: type[Actor] = SetPointActor,
        env: TrialVecEnv | None = None,
        learning_rate: Any = 1e-3,
        scenario: Scenario | None = None,
        settings: SimpleNamespace | None = None,
        _init_setup_model: bool = True,
        **options: Any,
    ) -> None:
        """Take hyperparameters as ``settings``, and further ``options`` of the base class."""
        super().__init__(
            policy,  # type: ignore[arg-type]
            env,
            learning_rate,
            support_multi_env=True,
            monitor_wrapper=False,
            **options,
        )
        self.scenario = scenario
        self.settings = settings
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        self._setup_lr_schedule()
        self.set_random_seed(self.seed)
        entries = self.observation_space.shape[0]  # type: ignore[index]
        actor = SetPointActor(self.scenario, entries, self.settings.cells)
        self.policy = AveragedPolicy(actor, learning_rate=self.lr_schedule(1.0))

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer"], []

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 5,
        tb_log_name: str = "simulator_gradient",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Collect rollouts and learn from them for ``total_timesteps`` environment steps."""
        if reset_num_timesteps:
            self.memory = torch.zeros(self.n_envs, self.policy.actor.memory_size)
        total_timesteps, callbacks = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        callbacks.on_training_start(locals(), globals())
        while self.num_timesteps < total_timesteps:
            callbacks.on_rollout_start()
            rollout = self.collect(callbacks)
            callbacks.on_rollout_end()
            self._update_current_progress_remaining(self.num_timesteps, total_timesteps)
            self._update_learning_rate(self.policy.optimizer)
            self.train(rollout)
            self.logger.dump(self.num_timesteps)
        callbacks.on_training_end()
        return self

    def collect(self, callbacks: BaseCallback) -> Rollout:
        """Play a rollout with the agent, and let the simulator teach about its steps."""
        start_memory = self.memory
        begins_of_steps = []
        observations_of_steps = []
        lessons = []
        costs = []
        for _ in range(self.settings.n_steps):
            observations = torch.from_numpy(self._last_obs)
            begins = torch.from_numpy(self._last_episode_starts).float().unsqueeze(-1)
            with torch.no_grad():
                actions, self.memory = self.policy.actor(observations, self.memory * (1.0 - begins))
            # The edge is changed without exploration.
            commands = actions[:, : self.policy.actor.commands.targets]
            commands.add_(self.settings.exploration * torch.randn_like(commands))
            taken = actions.clamp_(-1.0, 1.0).numpy()
            lesson = self.env.lesson(taken)
            if self.policy.actor.commands.changes_edges:
                # The set point of a step that changes the edge is not that of the edge in use.
                lesson.gradient[taken[:, -1] > 0.0] = 0.0
            self._last_obs, _, self._last_episode_starts, infos = self.env.step(taken)

            begins_of_steps.append(begins)
            observations_of_steps.append(observations)
            lessons.append(lesson)
            costs.append(lesson.cost.mean())
            self.num_timesteps += self.n_envs
            self._update_info_buffer(infos, self._last_episode_starts)
            callbacks.on_step()
        self.logger.record("train/cost", float(np.mean(costs)))
        return Rollout(
            memory=start_memory,
            begins=torch.stack(begins_of_steps),
            observations=torch.stack(observations_of_steps),
            gradients=_stacked(lessons, "gradient"),
            going_on=_stacked(lessons, "going_on"),
        )

    def train(self, rollout: Rollout) -> None:
        """Learn from a rollout."""
        settings = self.settings
        policy = self.policy
        for _ in range(settings.n_epochs):
            batches = torch.randperm(self.n_envs).split(settings.batch_envs)  # type: ignore[no-untyped-call]
            for envs in batches:
                objective = self.objective(rollout, envs)
                policy.optimizer.zero_grad()
                (-objective).backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(policy.actor.parameters(), settings.max_grad_norm)
                policy.optimizer.step()
                self.updates += 1
                # At first, the mean of all updates: the first ones are soon forgotten.
                policy.follow(min(settings.average_decay, 1.0 - 1.0 / self.updates))

    def objective(self, rollout: Rollout, envs: Tensor) -> Tensor:
        """Return an objective [s per step] of some environments, whose gradient is the teacher's.

        It is a function of the agent's parameters. A set point beyond the reach of one step has
        the gradient of the reached one (straight-through estimator).
        """
        actor = self.policy.actor
        unbounded = actor.unroll(
            rollout.observations[:, envs],
            cells=rollout.memory[envs],
            begins=rollout.begins[:, envs],
        )
        commanded = actor.commands.commanded(
            actor.bounded(unbounded), rollout.observations[:, envs]
        )
        gradients = rollout.gradients[:, envs]
        gain = gradients[..., SPEED] * commanded.speed + gradients[..., FEED] * commanded.feed
        objective: Tensor = gain.mean()
        if actor.commands.changes_edges:
            going_on = rollout.going_on[:, envs]
            objective = objective + edge_change_gain(unbounded[..., -1], going_on).mean()
        return objective


def _stacked(lessons: list[Lesson], name: str) -> Tensor:
    """Return a field of lessons with a first axis of steps."""
    return torch.from_numpy(np.stack([getattr(lesson, name) for lesson in lessons]))


def edge_change_gain(score: Tensor, going_on: Tensor) -> Tensor:
    """Return an objective whose maximum makes ``score`` positive if the edge should be changed.

    It is best to change an edge as soon as one more step with it has negative expected earnings
    (optimal stopping in the monotone case, Chow and Robbins 1961). The earnings ``going_on`` [s]
    of that step are uncertain in advance. A logistic loss weighted by them is least if ``score``
    has the opposite sign of their expectation. All have one shape.
    """
    return -(torch.relu(going_on) * softplus(score) + torch.relu(-going_on) * softplus(-score))


def new_model(run: Run, vec_env: VecEnv) -> SimulatorGradient:
    """Return an untrained model."""
    assert isinstance(vec_env, TrialVecEnv)
    settings = SimpleNamespace(**run.parameters)
    learning_rate = LinearSchedule(
        start=settings.learning_rate, end=settings.final_learning_rate, end_fraction=1.0
    )
    return SimulatorGradient(
        SetPointActor,
        vec_env,
        learning_rate=learning_rate,
        scenario=run.scenario,
        settings=settings,
        tensorboard_log=str(run.folder / "tensorboard"),
        seed=run.seed,
    )


def network(policy: AveragedPolicy) -> SetPointActor:
    """Return the agent of a trained policy."""
    return policy.average


def plays(scenario: Scenario) -> bool:
    """Return whether the teacher can price the scenario's steps.

    Its aim must be removal of metal, with the feed set in every step.
    """
    return scenario.control.action in TargetCommands.ACTIONS and scenario.control.aim == "removal"


DEFAULTS: dict[str, Any] = {
    "total_timesteps": 12_000_000,  # environment steps of the whole training
    "num_envs": 256,  # environments side by side
    "n_steps": 64,  # steps per environment between updates, and the reach of gradients
    "batch_envs": 128,  # environments in one step of gradient descent
    "n_epochs": 1,  # how often each rollout is used
    "cells": 192,  # of the GRU
    "learning_rate": 1e-3,  # falls linearly ...
    "final_learning_rate": 1e-5,  # ... to this
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
    plays=plays,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
