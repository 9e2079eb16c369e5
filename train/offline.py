"""The base of algorithms that learn from recorded steps alone: ``bc``, ``iql`` and ``td3_bc``.

    python -m train.datasets --policy self_tuning --jobs 256
    python -m train.bc --env RoughTurning-Family-v1 --set behaviour=self_tuning

``behaviour`` names the data set, as ``--policy`` of ``train/datasets.py`` does, and decides on the
class in which the agent is ranked. An algorithm's own file says which networks it has and what an
update does. Observations are standardised by the data set's mean and deviation, which the agent's
file holds, too.
"""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.torch_layers import create_mlp
from stable_baselines3.common.type_aliases import MaybeCallback, Schedule
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from train import datasets
from train.actor import Feedforward
from train.run import Run

Tensor = torch.Tensor

ROUND = 50
"""Updates between two calls of the callbacks."""
MIN_DEVIATION = 1e-3
"""Added to the deviation of an observation's entry, as TD3+BC does: some entries hardly vary."""


class Batch(NamedTuple):
    """Some recorded steps; observations are standardised."""

    observations: Tensor  # before the step, shape (steps, entries)
    actions: Tensor  # in -1..1, shape (steps, action size)
    rewards: Tensor  # scaled, shape (steps,)
    next_observations: Tensor  # after the step, shape (steps, entries)
    goes_on: Tensor  # 0 where the episode has terminated, else 1; shape (steps,)


class Standardise(torch.nn.Module):
    """A layer that takes the mean off its inputs and divides them by their deviation."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, entries: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(entries))
        self.register_buffer("deviation", torch.ones(entries))

    def fit(self, observations: Tensor) -> None:
        """Take mean and deviation of observations, shape (steps, entries)."""
        self.mean.copy_(observations.mean(dim=0))
        self.deviation.copy_(observations.std(dim=0) + MIN_DEVIATION)

    def forward(self, observations: Tensor) -> Tensor:
        standardised: Tensor = (observations - self.mean) / self.deviation
        return standardised


class RecordedSteps:
    """The first steps of a data set.

    Args:
        folder: folder of the data set.
        count: number of steps.
        reward_scale: factor on the rewards [1/s].

    Raises:
        ValueError: the data set has fewer steps.
    """

    def __init__(self, folder: Path, count: int, reward_scale: float) -> None:
        dataset = datasets.load(folder)
        _check_count(folder, dataset, count)
        observations = []
        rows = []
        actions = []
        rewards = []
        ends = []
        next_row = 0
        for episode in dataset.iterate_episodes():
            length = len(episode.rewards)
            observations.append(episode.observations)
            # An episode has one observation more than steps.
            rows.append(np.arange(next_row, next_row + length))
            next_row += length + 1
            actions.append(episode.actions)
            rewards.append(episode.rewards)
            ends.append(episode.terminations)
            if next_row - len(rows) >= count:
                break
        self.observations = torch.from_numpy(np.concatenate(observations))
        """All observations, shape (rows, entries)."""
        self._rows = torch.from_numpy(np.concatenate(rows)[:count])
        self._actions = torch.from_numpy(np.concatenate(actions)[:count])
        scaled_rewards = reward_scale * np.concatenate(rewards)[:count]
        self._rewards = torch.from_numpy(scaled_rewards.astype(np.float32))
        self._goes_on = torch.from_numpy(~np.concatenate(ends)[:count]).float()

    def sample(self, size: int) -> Batch:
        """Return steps drawn with replacement."""
        chosen = torch.randint(len(self._rows), (size,))
        rows = self._rows[chosen]
        return Batch(
            observations=self.observations[rows],
            actions=self._actions[chosen],
            rewards=self._rewards[chosen],
            next_observations=self.observations[rows + 1],
            goes_on=self._goes_on[chosen],
        )


def _check_count(folder: Path, dataset: Any, count: int) -> None:
    """Raise ValueError if a data set has fewer steps."""
    if dataset.total_steps < count:
        raise ValueError(
            f"total_timesteps is {count}, but {folder} has {dataset.total_steps} steps: "
            f"set total_timesteps to at most {dataset.total_steps}, or record more jobs"
        )


def mlp(inputs: int, outputs: int, net_arch: list[int]) -> torch.nn.Sequential:
    """Return layers with ReLU between them."""
    return torch.nn.Sequential(*create_mlp(inputs, outputs, net_arch))


class TwinCritic(torch.nn.Module):
    """Two estimates of the value of an action, of which learners take the lower one."""

    def __init__(self, entries: int, actions: int, net_arch: list[int]) -> None:
        super().__init__()
        self.first = mlp(entries + actions, 1, net_arch)
        self.second = mlp(entries + actions, 1, net_arch)

    def forward(self, observations: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Return both estimates, shape (steps,) each."""
        inputs = torch.cat([observations, actions], dim=1)
        return self.first(inputs).squeeze(1), self.second(inputs).squeeze(1)

    def lower(self, observations: Tensor, actions: Tensor) -> Tensor:
        """Return the lower estimate, shape (steps,)."""
        first, second = self(observations, actions)
        return torch.minimum(first, second)

    def loss(self, batch: Batch, targets: Tensor) -> Tensor:
        """Return the squared error of both estimates."""
        first, second = self(batch.observations, batch.actions)
        error = torch.nn.functional.mse_loss
        return error(first, targets) + error(second, targets)


class OfflinePolicy(BasePolicy):
    """An actor that returns the mean action; subclasses add the networks of their training.

    Args:
        observation_space: space of observations.
        action_space: space of actions.
        net_arch: units of the hidden layers of every network.
        options: further options of the base class.
    """

    def __init__(
        self, observation_space: Any, action_space: Any, net_arch: list[int], **options: Any
    ) -> None:
        super().__init__(observation_space, action_space, **options)
        self.entries = observation_space.shape[0]
        self.actions = action_space.shape[0]
        self.standardise = Standardise(self.entries)
        layers = mlp(self.entries, self.actions, net_arch)
        self.actor = torch.nn.Sequential(*layers, torch.nn.Tanh())
        self.optimizer: Any = None

    def _predict(self, observation: Any, deterministic: bool = False) -> Tensor:
        actions: Tensor = self.actor(self.standardise(observation))
        return actions


class OfflineAlgorithm(BaseAlgorithm):
    """A subclass of Stable-Baselines3's base class, which saves models, logs and runs callbacks.

    ``num_timesteps`` is the share of the updates that are done, in steps of the data set.

    Args:
        policy: class of the networks.
        env: environments; they give the spaces, and take no step.
        learning_rate: step size of Adam, or a schedule.
        dataset: folder of the data set.
        settings: hyperparameters.
        options: further options of the base class.
    """

    policy: Any
    settings: Any

    def __init__(
        self,
        policy: type[OfflinePolicy] = OfflinePolicy,
        env: VecEnv | None = None,
        learning_rate: float | Schedule = 1e-3,
        *,
        dataset: str = "",
        settings: SimpleNamespace | None = None,
        _init_setup_model: bool = True,
        **options: Any,
    ) -> None:
        super().__init__(
            policy, env, learning_rate, support_multi_env=True, monitor_wrapper=False, **options
        )
        self.dataset = dataset
        self.settings = settings
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        """Make the networks; Stable-Baselines3 calls this at the end of its constructors."""
        self._setup_lr_schedule()
        self.set_random_seed(self.seed)
        self.policy = self.policy_class(
            self.observation_space, self.action_space, **self.policy_kwargs
        )
        self.policy.optimizer = self._new_optimizer()

    def _new_optimizer(self) -> torch.optim.Optimizer:
        # Copies that follow the trained networks are not trained themselves.
        trained = [weights for weights in self.policy.parameters() if weights.requires_grad]
        return torch.optim.Adam(trained, lr=self.lr_schedule(1.0), fused=True)

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer"], []

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "steps"]

    def update(self, batch: Batch) -> dict[str, float]:
        """Update the networks once; return losses by name."""
        raise NotImplementedError

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 5,
        tb_log_name: str = "offline",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Learn from the first ``total_timesteps`` steps of the data set."""
        total_timesteps, callbacks = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        settings = self.settings
        self.steps = RecordedSteps(Path(self.dataset), total_timesteps, settings.reward_scale)
        if self._n_updates == 0:
            self.policy.standardise.fit(self.steps.observations)
        self.steps.observations = self.policy.standardise(self.steps.observations)
        callbacks.on_training_start(locals(), globals())
        while self._n_updates < settings.n_updates:
            callbacks.on_rollout_start()
            self._update_learning_rate(self.policy.optimizer)
            for _ in range(min(ROUND, settings.n_updates - self._n_updates)):
                losses = self.update(self.steps.sample(settings.batch_size))
                self._n_updates += 1
            self.num_timesteps = round(total_timesteps * self._n_updates / settings.n_updates)
            self._update_current_progress_remaining(self.num_timesteps, total_timesteps)
            callbacks.on_step()
            for name, loss in losses.items():
                self.logger.record(f"train/{name}", loss)
            self.logger.dump(self._n_updates)
            callbacks.on_rollout_end()
        callbacks.on_training_end()
        # The finished agent needs neither these nor the moments of the gradients.
        del self.steps
        self.policy.optimizer = self._new_optimizer()
        return self


def options_of(run: Run, vec_env: VecEnv) -> dict[str, Any]:
    """Return the arguments of an algorithm for a run, whose data set is checked.

    Raises:
        ValueError: there is no data set, or it is of another family, policy or observation, or
            has fewer steps than the training is to use.
    """
    p = run.parameters
    family = run.family
    assert family is not None
    folder = datasets.folder_of(Path(p["datasets"]), family, p["behaviour"])
    dataset = datasets.load(folder)
    metadata = dataset.storage.metadata
    if metadata["family_digest"] != family.digest() or metadata["policy"] != p["behaviour"]:
        raise ValueError(f"{folder} is not of family {family.name!r} and {p['behaviour']}")
    if dataset.observation_space.shape != vec_env.observation_space.shape:
        raise ValueError(
            f"{folder} has observations of shape {dataset.observation_space.shape}, but the "
            f"agent's have {vec_env.observation_space.shape}: data sets have derived inputs"
        )
    _check_count(folder, dataset, p["total_timesteps"])
    return {
        # It falls linearly over the whole training.
        "learning_rate": LinearSchedule(
            start=p["learning_rate"], end=p["final_learning_rate"], end_fraction=1.0
        ),
        "dataset": str(folder),
        "settings": SimpleNamespace(**p),
        "policy_kwargs": {"net_arch": p["net_arch"]},
        "tensorboard_log": str(run.folder / "tensorboard"),
        "seed": run.seed,
        "device": "cpu",
    }


def network(policy: OfflinePolicy) -> Feedforward:
    """Return the agent of a trained policy."""
    return Feedforward(policy.standardise, policy.actor)


DEFAULTS: dict[str, Any] = {
    "behaviour": "self_tuning",  # data set: --policy of train/datasets.py
    "datasets": "runs/datasets",  # folder of data sets
    "total_timesteps": 400_000,  # steps of the data set that are used, from the first on
    "n_updates": 10_000,
    "batch_size": 256,  # steps per update
    "learning_rate": 1e-3,  # falls linearly ...
    "final_learning_rate": 1e-5,  # ... to this
    "net_arch": [128, 128],  # of every network
    "reward_scale": 0.05,  # factor on rewards [s]
    "num_envs": 1,  # no environment is played
    "derived": True,  # shows the inputs of baselines/derived_observation.py, as the data sets do
}
"""Hyperparameters that all of these algorithms have."""
