"""Train a recurrent agent with gradients of the machining models, for one training seed.

    python -m train.analytic_gradient --seed 0

The agent has a memory (a GRU) and sees observations only. Its teacher is privileged: it evaluates
the machining models at the hidden state (``train/model_gain.py``). After every few steps, the
teacher returns the gradient of those steps' gain with respect to the agent's commands.
Backpropagation carries the gradient through the agent's memory to its observations. There is no
value function, and no exploration is needed. The gradient is exact, except that it assumes the same
hidden state at neighbouring positions along the bar.

The same command resumes an interrupted training, and does nothing if training is finished. Files:
see ``train/training.py``. (Gradients of a differentiable model: Freeman et al. 2021, arXiv
2106.13281; privileged teacher: Chen et al. 2020, arXiv 1912.12294; GRU: Cho et al. 2014, arXiv
1406.1078.)
"""

import sys
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from optuna.distributions import CategoricalDistribution, FloatDistribution
from stable_baselines3.common.vec_env import VecEnv

from train.analytic_actor import ACTUAL, GruActor
from train.gradient_algorithm import GradientAlgorithm, Rollout, options_of, sets_the_feed
from train.model_gain import HIDDEN_STATE, HiddenSteps, ModelGain, Truth, flat_prices
from train.run import Run
from train.training import Algorithm, command_line
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.vector_env import info_at_end_of_step

Tensor = torch.Tensor


class HindsightVecEnv(RoughTurningVecEnv):
    """Environments that keep the hidden states of the last step for a teacher.

    The agent never sees them.
    """

    last_step: HiddenSteps
    """Hidden states of the last step, shape (num_envs,)."""

    def reset(self) -> NDArray[np.float32]:
        """Return first observations.

        The tool is in the air before the first bar, and its edge is fresh.
        """
        observations = super().reset()
        self._state = np.zeros(self.num_envs, HIDDEN_STATE)
        return observations

    def training_rewards(
        self, rewards: NDArray[np.float64], infos: dict[str, Any]
    ) -> NDArray[np.float64]:
        """Keep the hidden states, and return the rewards unchanged."""
        before = self._state
        after = np.empty(self.num_envs, HIDDEN_STATE)
        state = np.empty(self.num_envs, HIDDEN_STATE)
        for name in HIDDEN_STATE.names or ():
            after[name] = info_at_end_of_step(infos, name)
            # After an episode's end, that of the next one; edges in use go on.
            state[name] = infos[name]

        changed = self._changed(infos)
        failed = changed & ~self._asked_for_change()
        force_before = np.where(changed, 0.0, before["thrust_force"])
        borne_force = np.maximum(after["thrust_force"], force_before)
        after["thrust_force"] = borne_force
        state["thrust_force"] = np.where(state["used_life"] > 0.0, borne_force, 0.0)
        self.last_step = HiddenSteps(before=before, after=after, changed=changed, failed=failed)
        self._state = state
        return rewards

    def _changed(self, infos: dict[str, Any]) -> NDArray[np.bool_]:
        """Return whether the edge was changed in the step."""
        stopped_time = info_at_end_of_step(infos, "stopped_time")
        cutting_time = info_at_end_of_step(infos, "cutting_time")  # of the edge [min]
        engaged_time = info_at_end_of_step(infos, "engaged_time")  # in the step [s]
        # Tangled chips also stop the machine. An edge of this step has cut no longer than it.
        is_fresh = 60.0 * cutting_time <= engaged_time * (1.0 + 1e-6)
        changed: NDArray[np.bool_] = (stopped_time > 0.0) & is_fresh
        return changed

    def _asked_for_change(self) -> NDArray[np.bool_]:
        """Return whether the agent asked for a change of the edge."""
        scenario = self.vector_env.unwrapped.scenario
        if scenario.control.edge_changes != "commanded":
            return np.zeros(self.num_envs, np.bool_)
        return self._actions[:, -1] > 0.0


class AnalyticGradient(GradientAlgorithm):
    """The algorithm; see the module's docstring."""

    def new_policy(self, entries: int) -> GruActor:
        """Return a new agent, which is the whole policy."""
        settings = self.settings
        return GruActor(self.scenario, entries, cells=settings.cells, memory=settings.memory)

    @property
    def actor(self) -> GruActor:
        """The agent that learns."""
        agent: GruActor = self.policy
        return agent

    @cached_property
    def gain(self) -> ModelGain:
        """The teacher's model of the gain."""
        is_flat = self.settings.life_price == "flat"
        return ModelGain(self.scenario, flat_prices(self.scenario) if is_flat else None)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "gain"]

    def explored(self, actions: Tensor) -> Tensor:
        """Return actions with noise; see ``GradientAlgorithm.explored``."""
        noisy: Tensor = actions + self.settings.exploration * torch.randn_like(actions)
        return noisy

    def take(self, actions: NDArray[np.float32]) -> tuple[Any, HiddenSteps]:
        """Take a step; return its result and its hidden states."""
        step = self.env.step(actions)
        return step, self.env.last_step

    def stacked(self, lessons: list[HiddenSteps]) -> HiddenSteps:
        """Return hidden states with a first axis of steps."""
        return HiddenSteps.stacked(lessons)

    def objective(self, rollout: Rollout, envs: Tensor) -> Tensor:
        """Return the mean gain per step [s] of some environments in a rollout.

        Targets that saturate cost ``saturation_price`` times their square, before they are
        squashed.
        """
        commands = self.actor.commands
        observations = rollout.observations[:, envs]
        truth = Truth(self.scenario, rollout.lessons.of(envs.numpy()))
        unbounded = self.actor.unroll(
            observations, cells=rollout.memory[envs], begins=rollout.begins[:, envs]
        )
        target = self.actor.bounded(unbounded)
        actual = commands.speed_and_feed(observations, ACTUAL)
        log_commanded = commands.commanded(target, observations)
        gain, going_on = self.gain(log_commanded, actual, truth)
        if commands.changes_edges:
            # A step in which the edge is changed does not cut: its speed and feed gain nothing.
            gain = gain * (1.0 - truth.changed)
            gain = gain + self.gain.edge_change_gain(target[..., -1], going_on)
        saturation = unbounded[..., : commands.targets].square().sum(dim=-1)
        objective: Tensor = gain.mean() - self.settings.saturation_price * saturation.mean()
        return objective


def new_model(run: Run, vec_env: VecEnv) -> AnalyticGradient:
    """Return an untrained model.

    Raise ValueError if ``life_price`` is not one that the teacher knows.
    """
    assert isinstance(vec_env, HindsightVecEnv)
    # Only some tasks have a price of saturation.
    settings = SimpleNamespace(**({"saturation_price": 0.0} | run.parameters))
    if settings.life_price not in ("marginal", "flat"):
        raise ValueError(f"life_price is {settings.life_price!r}, but must be marginal or flat")
    return AnalyticGradient(GruActor, vec_env, **options_of(run, settings))


def network(policy: GruActor) -> GruActor:
    """Return the agent of a trained policy: the policy itself."""
    return policy


DEFAULTS: dict[str, Any] = {
    "total_timesteps": 12_000_000,  # environment steps of the whole training
    "num_envs": 256,  # environments side by side
    "n_steps": 64,  # steps per environment between updates, and the reach of gradients
    "batch_envs": 128,  # environments in one step of gradient descent
    "n_epochs": 2,  # how often each rollout is used
    "cells": 64,  # of the GRU
    "learning_rate": 2e-3,  # falls linearly ...
    "final_learning_rate": 1e-5,  # ... to this
    "exploration": 0.05,  # standard deviation of the noise on actions
    "max_grad_norm": 1.0,
    "reward_scale": 1.0,  # the gradient does not use rewards
    "memory": True,  # the GRU remembers
    "position": True,  # the agent tracks its position along the bar
    "life_price": "marginal",  # p(D) in place of the flat charge ("flat")
}

SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "n_steps": CategoricalDistribution([32, 64, 128]),
    "cells": CategoricalDistribution([32, 64, 128]),
}

ALGORITHM = Algorithm(
    name="analytic_gradient",
    model=AnalyticGradient,
    new_model=new_model,
    network=network,
    defaults=DEFAULTS,
    search=SEARCH,
    training_information=("model gradients", "true states", "life price", "spreads", "geometry"),
    vec_env=HindsightVecEnv,
    plays=sets_the_feed,
    families=False,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
