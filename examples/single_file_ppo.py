"""PPO in one file, on Gymnasium's vector environment, with PyTorch only.

    python -m examples.single_file_ppo --steps 1000000

Rollouts are arrays of shape (rollout, environments, ...), without a loop over environments. (Schulman et al. 2017, arXiv
1707.06347; advantages: Schulman et al. 2016, arXiv 1506.02438.)
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

    steps: int = 1_000_000  # environment steps of the whole training
    seed: int = 0
    num_envs: int = 64
    rollout: int = 64  # steps per environment between updates
    epochs: int = 5
    batches: int = 4  # minibatches per epoch
    learning_rate: float = 1e-3  # learning rate at the start; it falls linearly to 0
    discount: float = 0.8
    """Discount per step: about 5 s of foresight. Life is charged as it is used, so more foresight only adds noise."""
    gae_lambda: float = 0.95
    clip: float = 0.2
    reward_scale: float = 1 / 3  # factor on rewards [1/s]
    tuning_seeds: int = 32  # number of tuning seeds for the score

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 < value < math.inf and (name, value) != ("seed", 0):
                raise ValueError(f"--{name.replace('_', '-')} is {value}, but must be above 0")
        if self.discount > 1 or self.gae_lambda > 1:
            raise ValueError("--discount and --gae-lambda must be at most 1")


class Agent(torch.nn.Module):
    """A Gaussian policy with one standard deviation per action, and a value function."""

    def __init__(self, entries: int, actions: int) -> None:
        super().__init__()
        self.mean, self.value = layers(entries, actions, 0.01), layers(entries, 1, 1.0)
        self.log_deviation = torch.nn.Parameter(torch.full((actions,), -1.0))

    def policy(self, observations: Tensor) -> Any:
        """Return PyTorch's distribution of actions, shape (..., actions)."""
        return torch.distributions.Normal(self.mean(observations), self.log_deviation.exp())

    def values(self, observations: Tensor) -> Tensor:
        """Return the expected discounted return of scaled rewards, shape (...)."""
        values: Tensor = self.value(observations)
        return values.squeeze(-1)


def layers(entries: int, results: int, gain: float) -> torch.nn.Sequential:
    """Return two hidden layers of 64 and an output layer; ``gain`` scales the initial outputs."""
    linears = [torch.nn.Linear(*sizes) for sizes in ((entries, 64), (64, 64), (64, results))]
    for linear, scale in zip(linears, (2**0.5, 2**0.5, gain), strict=True):
        torch.nn.init.orthogonal_(linear.weight, scale)
        torch.nn.init.zeros_(linear.bias)
    first, second, last = linears
    return torch.nn.Sequential(first, torch.nn.ReLU(), second, torch.nn.ReLU(), last)


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
        self.observations = torch.from_numpy(self.envs.reset(seed=settings.seed)[0])

    @torch.no_grad()
    def next(self, agent: Agent) -> dict[str, Tensor]:
        """Return the steps, advantages and returns of a rollout, each of shape (rollout, environments, ...)."""
        steps: dict[str, list[Tensor]] = {
            name: [] for name in ("observation", "action", "log_probability", "reward", "end")
        }
        for _ in range(self.settings.rollout):
            policy = agent.policy(self.observations)
            action = policy.sample()
            observations, rewards, terminated, truncated, infos = self.envs.step(action.numpy())
            reward = torch.from_numpy(rewards * self.settings.reward_scale).float()
            if truncated.any():  # the episode would go on: add the value of the last state
                last = torch.from_numpy(np.stack(list(infos["final_obs"][truncated])))
                reward[torch.from_numpy(truncated)] += self.settings.discount * agent.values(last)
            end = torch.from_numpy(terminated | truncated)
            step = (self.observations, action, policy.log_prob(action).sum(-1), reward, end)
            for kept, value in zip(steps.values(), step, strict=True):
                kept.append(value)
            self.observations = torch.from_numpy(observations)
        return {name: torch.stack(values) for name, values in steps.items()} | self._advantages(
            agent, steps
        )

    def _advantages(self, agent: Agent, steps: dict[str, list[Tensor]]) -> dict[str, Tensor]:
        """Return generalised advantages, and returns = advantages + values, each of shape (rollout, environments)."""
        values = agent.values(torch.stack([*steps["observation"], self.observations]))
        advantages = torch.zeros_like(values)
        for step in reversed(range(self.settings.rollout)):
            goes_on = self.settings.discount * (~steps["end"][step])
            surprise = steps["reward"][step] + goes_on * values[step + 1] - values[step]
            advantages[step] = surprise + goes_on * self.settings.gae_lambda * advantages[step + 1]
        return {"advantage": advantages[:-1], "return": (advantages + values)[:-1]}


def loss(agent: Agent, batch: dict[str, Tensor], clip: float) -> Any:
    """Return PPO's loss: the clipped objective plus half the squared error of values."""
    log_probability = agent.policy(batch["observation"]).log_prob(batch["action"]).sum(-1)
    ratio = (log_probability - batch["log_probability"]).exp()
    advantage = (batch["advantage"] - batch["advantage"].mean()) / (batch["advantage"].std() + 1e-8)
    gain = torch.minimum(ratio * advantage, ratio.clamp(1 - clip, 1 + clip) * advantage).mean()
    return 0.5 * (agent.values(batch["observation"]) - batch["return"]).square().mean() - gain


def train(settings: Settings) -> Agent:
    """Train an agent for a number of steps, rounded up to whole rollouts."""
    torch.manual_seed(settings.seed)
    rollouts = Rollouts(settings)
    (entries,), (actions,) = (
        rollouts.envs.single_observation_space.shape or (0,),
        rollouts.envs.single_action_space.shape or (0,),
    )
    agent = Agent(entries, actions)
    optimizer = torch.optim.Adam(agent.parameters(), settings.learning_rate, eps=1e-5)
    size = settings.num_envs * settings.rollout
    updates = -(-settings.steps // size)
    falling = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda update: 1 - update / updates)
    for _ in tqdm(range(updates), unit_scale=size, unit="step", disable=None):
        rollout = {name: values.flatten(0, 1) for name, values in rollouts.next(agent).items()}
        for _ in range(settings.epochs):
            for indices in torch.randperm(size).chunk(settings.batches):
                optimizer.zero_grad()
                loss(
                    agent,
                    {name: values[indices] for name, values in rollout.items()},
                    settings.clip,
                ).backward()
                torch.nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimizer.step()
        falling.step()
    return agent


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m examples.single_file_ppo", **described(__doc__)
    )
    for field in fields(Settings):
        kind: Any = field.type
        parser.add_argument(
            f"--{field.name.replace('_', '-')}",
            type=kind,
            default=field.default,
            help="default: %(default)s",
        )
    settings = Settings(**vars(parser.parse_args(arguments)))
    agent = train(settings)
    print(f"PPO after {settings.steps} steps: {score(agent.mean, settings.tuning_seeds)}")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
