"""PPO in one file, on Gymnasium's vector environment, with PyTorch only.

    python -m examples.single_file_ppo --total-timesteps 1000000

Rollouts are arrays of shape (n_steps, num_envs, ...), without a loop over environments. (Schulman
et al. 2017, arXiv 1707.06347; advantages: Schulman et al. 2016, arXiv 1506.02438.)
"""

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor
from tqdm import tqdm

import turning_env  # noqa: F401 - registers the ids
from examples.shared import ENV_ID, run, score
from turning_env.console import described, exits


@dataclass(frozen=True)
class Settings:
    """Options of the command line, such as ``--learning-rate 0.0003``."""

    total_timesteps: int = 1_000_000  # environment steps of the whole training
    seed: int = 0
    num_envs: int = 64
    n_steps: int = 64  # steps per environment between updates
    n_epochs: int = 5
    num_minibatches: int = 4  # per epoch
    learning_rate: float = 1e-3  # at the start; it falls linearly to 0
    # About 5 s of foresight: life is charged as it is used, so more foresight only adds noise.
    gamma: float = 0.8
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    reward_scale: float = 1 / 3  # factor on rewards [1/s]
    tuning_seeds: int = 32  # number of tuning seeds for the score

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            is_seed_zero = name == "seed" and value == 0
            if not (0 < value < math.inf or is_seed_zero):
                raise ValueError(f"--{name.replace('_', '-')} is {value}, but must be above 0")
        if self.gamma > 1 or self.gae_lambda > 1:
            raise ValueError("--gamma and --gae-lambda must be at most 1")


def layers(entries: int, outputs: int, gain: float) -> torch.nn.Sequential:
    """Return two hidden layers of 64 and an output layer; ``gain`` scales the initial outputs."""
    first = torch.nn.Linear(entries, 64)
    second = torch.nn.Linear(64, 64)
    last = torch.nn.Linear(64, outputs)
    # Small first actions, and values near 0, leave room for learning.
    for linear, scale in ((first, 2**0.5), (second, 2**0.5), (last, gain)):
        torch.nn.init.orthogonal_(linear.weight, scale)
        torch.nn.init.zeros_(linear.bias)
    return torch.nn.Sequential(first, torch.nn.ReLU(), second, torch.nn.ReLU(), last)


class Agent(torch.nn.Module):
    """A Gaussian policy with one standard deviation per action, and a value function."""

    def __init__(self, entries: int, actions: int) -> None:
        super().__init__()
        self.mean = layers(entries, actions, gain=0.01)
        self.value = layers(entries, 1, gain=1.0)
        self.log_std = torch.nn.Parameter(torch.full((actions,), -1.0))

    def policy(self, observations: Tensor) -> Any:
        """Return PyTorch's distribution of actions, shape (..., actions)."""
        return torch.distributions.Normal(self.mean(observations), self.log_std.exp())

    def values(self, observations: Tensor) -> Tensor:
        """Return the expected discounted return of scaled rewards, shape (...)."""
        values: Tensor = self.value(observations)
        return values.squeeze(-1)


@dataclass
class Rollout:
    """Steps of all environments; fields have shape (n_steps, num_envs, ...)."""

    observations: Tensor
    actions: Tensor
    log_probabilities: Tensor
    rewards: Tensor
    ends: Tensor
    advantages: Tensor
    returns: Tensor


@dataclass
class Batch:
    """Samples of a rollout; fields have shape (n, ...)."""

    observations: Tensor
    actions: Tensor
    log_probabilities: Tensor
    advantages: Tensor
    returns: Tensor

    @classmethod
    def of(cls, rollout: Rollout) -> "Batch":
        """Return all samples of a rollout."""
        samples = {field.name: getattr(rollout, field.name).flatten(0, 1) for field in fields(cls)}
        return cls(**samples)

    def __getitem__(self, indices: Tensor) -> "Batch":
        """Return some of the samples."""
        return Batch(**{name: values[indices] for name, values in vars(self).items()})


class Rollouts:
    """A source of rollouts, whose environments continue from the last one."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.envs = gymnasium.make_vec(
            ENV_ID,
            settings.num_envs,
            vectorization_mode="vector_entry_point",
            autoreset_mode=AutoresetMode.SAME_STEP,
        )
        observations, _ = self.envs.reset(seed=settings.seed)
        self.observations = torch.from_numpy(observations)

    @torch.no_grad()
    def next(self, agent: Agent) -> Rollout:
        """Play a rollout with an agent."""
        n_steps = self.settings.n_steps
        observations = []
        actions = []
        log_probabilities = []
        rewards = []
        ends = []
        for _ in range(n_steps):
            policy = agent.policy(self.observations)
            action = policy.sample()
            observations.append(self.observations)
            actions.append(action)
            log_probabilities.append(policy.log_prob(action).sum(-1))

            next_observations, reward, terminated, truncated, infos = self.envs.step(action.numpy())
            scaled_reward = torch.from_numpy(reward * self.settings.reward_scale).float()
            if truncated.any():  # the episode would go on: add the value of the last state
                last = torch.from_numpy(np.stack(list(infos["final_obs"][truncated])))
                value = self.settings.gamma * agent.values(last)
                scaled_reward[torch.from_numpy(truncated)] += value
            rewards.append(scaled_reward)
            ends.append(torch.from_numpy(terminated | truncated))
            self.observations = torch.from_numpy(next_observations)

        values = agent.values(torch.stack([*observations, self.observations]))
        advantages = self._advantages(values, rewards, ends)
        return Rollout(
            observations=torch.stack(observations),
            actions=torch.stack(actions),
            log_probabilities=torch.stack(log_probabilities),
            rewards=torch.stack(rewards),
            ends=torch.stack(ends),
            advantages=advantages,
            returns=advantages + values[:-1],
        )

    def _advantages(self, values: Tensor, rewards: list[Tensor], ends: list[Tensor]) -> Tensor:
        """Return generalised advantages; ``values`` has a step more than rewards and ends."""
        advantages = torch.zeros_like(values)
        for step in reversed(range(len(rewards))):
            # After an end, nothing of the next episode counts.
            discount = self.settings.gamma * (~ends[step])
            surprise = rewards[step] + discount * values[step + 1] - values[step]
            later = discount * self.settings.gae_lambda * advantages[step + 1]
            advantages[step] = surprise + later
        return advantages[:-1]


def loss(agent: Agent, batch: Batch, clip_range: float) -> Tensor:
    """Return PPO's loss: the clipped objective plus half the squared error of values."""
    log_probabilities = agent.policy(batch.observations).log_prob(batch.actions).sum(-1)
    # Clipped surrogate objective, equation 7 of the paper.
    ratio = (log_probabilities - batch.log_probabilities).exp()
    clipped_ratio = ratio.clamp(1 - clip_range, 1 + clip_range)
    advantages = batch.advantages
    advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    gain = torch.minimum(ratio * advantages, clipped_ratio * advantages).mean()
    value_loss = 0.5 * (agent.values(batch.observations) - batch.returns).square().mean()
    return value_loss - gain


def train(settings: Settings) -> Agent:
    """Train an agent for a number of steps, rounded up to whole rollouts."""
    torch.manual_seed(settings.seed)
    rollouts = Rollouts(settings)
    (entries,) = rollouts.envs.single_observation_space.shape or (0,)
    (actions,) = rollouts.envs.single_action_space.shape or (0,)
    agent = Agent(entries, actions)
    # The epsilon of OpenAI's Baselines.
    optimizer = torch.optim.Adam(agent.parameters(), settings.learning_rate, eps=1e-5)
    size = settings.num_envs * settings.n_steps
    updates = math.ceil(settings.total_timesteps / size)
    scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda update: 1 - update / updates)
    for _ in tqdm(range(updates), unit_scale=size, unit="step", disable=None):
        # Environments do not matter any more: a sample is a step of any of them.
        samples = Batch.of(rollouts.next(agent))
        for _ in range(settings.n_epochs):
            for indices in torch.randperm(size).chunk(settings.num_minibatches):
                optimizer.zero_grad()
                loss(agent, samples[indices], settings.clip_range).backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimizer.step()
        scheduler.step()
    return agent


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m examples.single_file_ppo", **described(__doc__)
    )
    for field in fields(Settings):
        field_type: Any = field.type
        parser.add_argument(
            f"--{field.name.replace('_', '-')}",
            type=field_type,
            default=field.default,
            help="default: %(default)s",
        )
    settings = Settings(**vars(parser.parse_args(arguments)))
    agent = train(settings)
    print(f"PPO after {settings.total_timesteps} steps: {score(agent.mean, settings.tuning_seeds)}")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
