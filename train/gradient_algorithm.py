"""The base class of algorithms that train a recurrent agent by a teacher's gradients of rollouts.

A subclass tells how it makes its policy, how it takes a step, and the objective of a rollout.
"""

from types import SimpleNamespace
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.type_aliases import MaybeCallback
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from train.analytic_actor import GruActor, TargetCommands
from train.run import Run
from turning_env import Scenario

Tensor = torch.Tensor


class Rollout(NamedTuple):
    """A rollout; its fields have shape (steps, num_envs, ...) unless they say otherwise."""

    memory: Tensor  # memory before the first step, shape (num_envs, memory_size)
    begins: Tensor  # 1 at the first step of an episode, else 0
    observations: Tensor
    lessons: Any  # what the teacher tells of the steps: see ``GradientAlgorithm.stacked``


class GradientAlgorithm(BaseAlgorithm):
    """A subclass of Stable-Baselines3's base class, which saves models, logs and runs callbacks."""

    policy: Any
    env: Any
    scenario: Any
    settings: Any

    def __init__(
        self,
        policy: type[torch.nn.Module] = GruActor,
        env: VecEnv | None = None,
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
        self.policy = self.new_policy(entries)
        self.policy.optimizer = torch.optim.Adam(self.actor.parameters(), lr=self.lr_schedule(1.0))

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer"], []

    def new_policy(self, entries: int) -> torch.nn.Module:
        """Return a new policy for observations of some ``entries``."""
        raise NotImplementedError

    @property
    def actor(self) -> GruActor:
        """The agent that learns, a part of ``policy`` or all of it."""
        raise NotImplementedError

    def explored(self, actions: Tensor) -> Tensor:
        """Return actions with noise, shape (num_envs, actions)."""
        raise NotImplementedError

    def take(self, actions: NDArray[np.float32]) -> tuple[Any, Any]:
        """Take a step in the environments; return its result, and what the teacher tells of it."""
        raise NotImplementedError

    def stacked(self, lessons: list[Any]) -> Any:
        """Return the lessons of steps as arrays or tensors with a first axis of steps."""
        raise NotImplementedError

    def objective(self, rollout: Rollout, envs: Tensor) -> Tensor:
        """Return what to maximise on some environments of a rollout.

        It is a function of the agent's parameters.
        """
        raise NotImplementedError

    def after_update(self) -> None:
        """Follow a step of gradient descent."""

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 5,
        tb_log_name: str = "gradient",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Collect rollouts and learn from them for ``total_timesteps`` environment steps."""
        if reset_num_timesteps:
            self.memory = torch.zeros(self.n_envs, self.actor.memory_size)
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
            self.logger.record("train/objective", self.train(rollout))
            self.logger.dump(self.num_timesteps)
        callbacks.on_training_end()
        return self

    def collect(self, callbacks: BaseCallback) -> Rollout:
        """Play a rollout with the agent."""
        start_memory = self.memory
        begins_of_steps = []
        observations_of_steps = []
        lessons = []
        for _ in range(self.settings.n_steps):
            observations = torch.from_numpy(self._last_obs)
            begins = torch.from_numpy(self._last_episode_starts).float().unsqueeze(-1)
            with torch.no_grad():
                actions, self.memory = self.actor(observations, self.memory * (1.0 - begins))
            taken = self.explored(actions).clamp(-1.0, 1.0).numpy()
            step, lesson = self.take(taken)
            self._last_obs, _, self._last_episode_starts, infos = step

            begins_of_steps.append(begins)
            observations_of_steps.append(observations)
            lessons.append(lesson)
            self.num_timesteps += self.n_envs
            self._update_info_buffer(infos, self._last_episode_starts)
            callbacks.on_step()
        return Rollout(
            memory=start_memory,
            begins=torch.stack(begins_of_steps),
            observations=torch.stack(observations_of_steps),
            lessons=self.stacked(lessons),
        )

    def train(self, rollout: Rollout) -> float:
        """Learn from a rollout; return the mean objective."""
        settings = self.settings
        optimizer = self.policy.optimizer
        objectives = []
        for _ in range(settings.n_epochs):
            batches = torch.randperm(self.n_envs).split(settings.batch_envs)  # type: ignore[no-untyped-call]
            for envs in batches:
                objective = self.objective(rollout, envs)
                optimizer.zero_grad()
                (-objective).backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(self.actor.parameters(), settings.max_grad_norm)
                optimizer.step()
                self.after_update()
                objectives.append(objective.item())
        return float(np.mean(objectives))


def options_of(run: Run, settings: SimpleNamespace) -> dict[str, Any]:
    """Return the options with which a run makes its algorithm."""
    learning_rate = LinearSchedule(
        start=settings.learning_rate, end=settings.final_learning_rate, end_fraction=1.0
    )
    return {
        "learning_rate": learning_rate,
        "scenario": run.scenario,
        "settings": settings,
        "tensorboard_log": str(run.folder / "tensorboard"),
        "seed": run.seed,
    }


def sets_the_feed(scenario: Scenario) -> bool:
    """Return whether every step sets the feed, and the aim is removal of metal.

    Teachers price only such steps.
    """
    return scenario.control.action in TargetCommands.ACTIONS and scenario.control.aim == "removal"
