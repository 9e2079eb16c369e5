"""Train a recurrent agent with gradients of the machining models, for one training seed.

    python -m train.analytic_gradient --seed 0

The agent has a memory (a GRU) and sees observations only. Its teacher is privileged: it evaluates the machining models at the
hidden state (``train/model_gain.py``). After every few steps, the teacher returns the gradient of those steps' gain with respect
to the agent's commands. Backpropagation carries the gradient through the agent's memory to its observations. There is no value
function, and no exploration is needed. The gradient is exact, except that it assumes the same hidden state at neighbouring
positions along the bar.

The same command resumes an interrupted training, and does nothing if training is finished. Files: see ``train/training.py``.
(Gradients of a differentiable model: Freeman et al. 2021, arXiv 2106.13281; privileged teacher: Chen et al. 2020,
arXiv 1912.12294; GRU: Cho et al. 2014, arXiv 1406.1078.)
"""

import sys
from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from optuna.distributions import CategoricalDistribution, FloatDistribution
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.type_aliases import MaybeCallback
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from train.actor import Actor
from train.analytic_actor import ACTUAL, GruActor, TargetCommands
from train.model_gain import FIELDS, FORCE, USED_LIFE, ModelGain, Truth, flat_prices
from train.run import Run
from train.training import Algorithm, command_line
from turning_env import Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.vector_env import info_at_end_of_step

Tensor = torch.Tensor


class Rollout(NamedTuple):
    """Observations and hidden states of all steps; fields of shape (steps, num_envs, ...)."""

    memory: Tensor  # memory before the first step, shape (num_envs, memory_size)
    begins: Tensor  # 1 at the first step of an episode
    observations: Tensor
    hidden: list[NDArray[Any]]  # arguments of Truth after the scenario; their last axis is num_envs


class HindsightVecEnv(RoughTurningVecEnv):
    """Environments that keep the hidden states of the last step for a teacher; the agent never sees them."""

    before: NDArray[np.float64]  # FIELDS at the start of the step, shape (len(FIELDS), num_envs)
    after: NDArray[np.float64]
    """``FIELDS`` at the step's end, same shape; if the edge was changed in the step, those of the fresh edge."""
    changed: NDArray[np.bool_]  # whether the edge was changed in the step, shape (num_envs,)
    failed: NDArray[
        np.bool_
    ]  # whether it was changed because it was worn out or broken, shape (num_envs,)

    def reset(self) -> NDArray[np.float32]:
        """Return first observations: the tool is in the air before the first bar, with a fresh edge."""
        observations = super().reset()
        self._now = np.zeros((len(FIELDS), self.num_envs))
        return observations

    def training_rewards(
        self, rewards: NDArray[np.float64], infos: dict[str, Any]
    ) -> NDArray[np.float64]:
        """Keep the hidden states, and return the rewards unchanged."""
        commands_changes = self.vector_env.unwrapped.scenario.control.edge_changes == "commanded"
        self.before = self._now
        self.after = np.stack([info_at_end_of_step(infos, name) for name in FIELDS])
        stopped, cut, engaged = (
            info_at_end_of_step(infos, name)
            for name in ("stopped_time", "cutting_time", "engaged_time")
        )
        self.changed = (stopped > 0.0) & (
            60.0 * cut <= engaged * (1.0 + 1e-6)
        )  # tangled chips also stop the machine
        self.failed = self.changed & ~(commands_changes & (self._actions[:, -1] > 0.0))
        self.after[FORCE] = borne = np.maximum(
            self.after[FORCE], np.where(self.changed, 0.0, self.before[FORCE])
        )
        self._now = np.stack(
            [infos[name] for name in FIELDS]
        )  # after an episode's end, of the next one; edges in use go on
        self._now[FORCE] = np.where(self._now[USED_LIFE] > 0.0, borne, 0.0)
        return rewards


class AnalyticGradient(BaseAlgorithm):
    """The algorithm as a subclass of Stable-Baselines3's base class, which saves models, logs and runs callbacks."""

    policy: Any
    env: Any
    scenario: Any
    settings: Any

    def __init__(
        self,
        policy: type[Actor] = GruActor,
        env: HindsightVecEnv | None = None,
        learning_rate: Any = 1e-3,
        scenario: Scenario | None = None,
        settings: SimpleNamespace | None = None,
        _init_setup_model: bool = True,
        **options: Any,
    ) -> None:
        """Take hyperparameters as ``settings``, and further ``options`` of the base class."""
        super().__init__(
            policy, env, learning_rate, support_multi_env=True, monitor_wrapper=False, **options
        )  # type: ignore[arg-type]
        self.scenario, self.settings = scenario, settings
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        self._setup_lr_schedule()
        self.set_random_seed(self.seed)
        entries = self.observation_space.shape[0]  # type: ignore[index]
        settings = self.settings
        self.policy = GruActor(self.scenario, entries, settings.cells, settings.memory)
        self.policy.optimizer = torch.optim.Adam(self.policy.parameters(), lr=self.lr_schedule(1.0))

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "gain"]

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer"], []

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 5,
        tb_log_name: str = "analytic_gradient",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Collect rollouts and learn from them for ``total_timesteps`` environment steps."""
        self.gain = ModelGain(
            self.scenario,
            flat_prices(self.scenario) if self.settings.life_price == "flat" else None,
        )
        if reset_num_timesteps:
            self.memory = torch.zeros(self.n_envs, self.policy.memory_size)
        total, callbacks = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        callbacks.on_training_start(locals(), globals())
        while self.num_timesteps < total:
            callbacks.on_rollout_start()
            rollout = self.collect(callbacks)
            callbacks.on_rollout_end()
            self._update_current_progress_remaining(self.num_timesteps, total)
            self._update_learning_rate(self.policy.optimizer)
            self.logger.record("train/gain", self.train(rollout))
            self.logger.dump(self.num_timesteps)
        callbacks.on_training_end()
        return self

    def collect(self, callbacks: BaseCallback) -> Rollout:
        """Play a rollout with the agent."""
        start, steps = self.memory, []
        for _ in range(self.settings.n_steps):
            seen, begins = (
                torch.from_numpy(self._last_obs),
                torch.from_numpy(self._last_episode_starts).float().unsqueeze(-1),
            )
            with torch.no_grad():
                actions, self.memory = self.policy(seen, self.memory * (1.0 - begins))
            actions = actions + self.settings.exploration * torch.randn_like(actions)
            observations, _, ended, infos = self.env.step(actions.clamp(-1.0, 1.0).numpy())
            steps.append(
                (begins, seen, self.env.before, self.env.after, self.env.changed, self.env.failed)
            )
            self._last_obs, self._last_episode_starts = observations, ended
            self.num_timesteps += self.n_envs
            self._update_info_buffer(infos, ended)
            callbacks.on_step()
        begun, observed, *hidden = zip(*steps, strict=True)
        return Rollout(
            start, torch.stack(begun), torch.stack(observed), [np.stack(each) for each in hidden]
        )

    def train(self, rollout: Rollout) -> float:
        """Learn from a rollout; return its mean gain per step [s]."""
        gains = []
        for _ in range(self.settings.n_epochs):
            for envs in torch.randperm(self.n_envs).split(self.settings.batch_envs):  # type: ignore[no-untyped-call]
                gain = self.mean_gain(rollout, envs)
                self.policy.optimizer.zero_grad()
                (-gain).backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(
                    self.policy.parameters(), self.settings.max_grad_norm
                )
                self.policy.optimizer.step()
                gains.append(gain.item())
        return float(np.mean(gains))

    def mean_gain(self, rollout: Rollout, envs: Tensor) -> Tensor:
        """Return the mean gain per step [s] of some environments in a rollout, as a function of the agent's parameters."""
        observations = rollout.observations[:, envs]
        truth = Truth(self.scenario, *(each[..., envs.numpy()] for each in rollout.hidden))
        unbounded = self.policy.unroll(observations, rollout.memory[envs], rollout.begins[:, envs])
        target = self.policy.bounded(unbounded)
        commands = self.policy.commands
        speed, feed = commands.speed_and_feed(observations, ACTUAL)
        log_speed, log_feed = commands.commanded(target, observations)
        gain: Tensor
        gain, going_on = self.gain(log_speed, log_feed, speed, feed, truth)
        if commands.changes_edges:
            gain = gain * (1.0 - truth.changed)
            gain = gain + self.gain.edge_change_gain(target[..., -1], going_on)
        saturation = unbounded[..., : commands.targets].square().sum(dim=-1)
        objective: Tensor = gain.mean() - self.settings.saturation_price * saturation.mean()
        return objective


def new_model(run: Run, vec_env: VecEnv) -> AnalyticGradient:
    """Return an untrained model."""
    assert isinstance(vec_env, HindsightVecEnv)
    settings = SimpleNamespace(
        **{"saturation_price": 0.0} | run.parameters
    )  # only some tasks have that price
    if settings.life_price not in ("marginal", "flat"):
        raise ValueError(f"life_price is {settings.life_price!r}, but must be marginal or flat")
    return AnalyticGradient(
        GruActor,
        vec_env,
        LinearSchedule(settings.learning_rate, settings.final_learning_rate, 1.0),
        run.scenario,
        settings,
        tensorboard_log=str(run.folder / "tensorboard"),
        seed=run.seed,
    )


SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "n_steps": CategoricalDistribution([32, 64, 128]),
    "cells": CategoricalDistribution([32, 64, 128]),
}


def plays(scenario: Scenario) -> bool:
    """Return whether the teacher has a model of the scenario's reward: removal of metal, with the feed set in every step."""
    return scenario.control.action in TargetCommands.ACTIONS and scenario.control.aim == "removal"


ALGORITHM = Algorithm(
    name="analytic_gradient",
    model=AnalyticGradient,
    new_model=new_model,
    network=lambda policy: policy,
    search=SEARCH,
    training_information=("model gradients", "true states", "geometry", "life price", "spreads"),
    vec_env=HindsightVecEnv,
    plays=plays,
    families=False,
)

main = partial(command_line, ALGORITHM)

if __name__ == "__main__":
    sys.exit(main())
