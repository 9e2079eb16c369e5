"""Train an agent offline with implicit Q-learning (IQL) for one training seed.

    python -m train.datasets --policy mixture
    python -m train.iql --env RoughTurning-Family-v1 --set behaviour=mixture --seed 0

A value function estimates an upper expectile of what the recorded actions earn, so that no other
action is ever valued. The actor imitates recorded actions, weighted by their advantage. Expectile,
temperature and tau are those of the paper for locomotion (Kostrikov et al. 2021, arXiv 2110.06169);
the discount is PPO's on this task. The base of all offline algorithms, ``train/offline.py``, has
the other settings: smaller networks and fewer updates than in the paper.
"""

import sys
from copy import deepcopy
from typing import Any

import torch
from optuna.distributions import FloatDistribution
from stable_baselines3.common.utils import polyak_update
from stable_baselines3.common.vec_env import VecEnv

from train.offline import (
    DEFAULTS,
    Batch,
    OfflineAlgorithm,
    OfflinePolicy,
    TwinCritic,
    mlp,
    network,
    options_of,
)
from train.ppo import log_probability
from train.run import Run
from train.training import Algorithm, command_line

MAX_WEIGHT = 100.0
"""Largest weight of a recorded action [-], as in the authors' code."""
MIN_LOG_DEVIATION = -5.0
"""Lower bound of the logarithm of the deviation of actions, likewise."""


class IQLPolicy(OfflinePolicy):
    """Actor, deviation of its actions, values of actions and of states."""

    def __init__(
        self, observation_space: Any, action_space: Any, net_arch: list[int], **options: Any
    ) -> None:
        super().__init__(observation_space, action_space, net_arch, **options)
        self.log_deviation = torch.nn.Parameter(torch.zeros(self.actions))
        self.critic = TwinCritic(self.entries, self.actions, net_arch)
        self.target_critic = deepcopy(self.critic).requires_grad_(False)
        self.value = mlp(self.entries, 1, net_arch)


class IQL(OfflineAlgorithm):
    """The algorithm; see ``OfflineAlgorithm``."""

    def update(self, batch: Batch) -> dict[str, float]:
        """Take a step with all networks; equations are those of the paper."""
        policy = self.policy
        settings = self.settings
        with torch.no_grad():
            action_values = policy.target_critic.lower(batch.observations, batch.actions)
            next_values = policy.value(batch.next_observations).squeeze(1)
            targets = batch.rewards + settings.gamma * batch.goes_on * next_values

        # Expectile regression of the value of a state, equation 5.
        advantages = action_values - policy.value(batch.observations).squeeze(1)
        is_above = advantages > 0.0
        sides = torch.where(is_above, settings.expectile, 1.0 - settings.expectile)
        value_loss = (sides * advantages.square()).mean()

        # The value of an action by that of the next state, equation 6.
        critic_loss = policy.critic.loss(batch, targets)

        # Imitation weighted by the advantage, equation 7.
        weights = (settings.temperature * advantages.detach()).exp().clamp(max=MAX_WEIGHT)
        means = policy.actor(batch.observations)
        log_deviation = policy.log_deviation.clamp(min=MIN_LOG_DEVIATION)
        log_probabilities = log_probability(batch.actions, means, log_deviation)
        actor_loss = -(weights * log_probabilities).mean()

        # The losses share no trained network, so one step with their sum is one with each.
        policy.optimizer.zero_grad()
        (value_loss + critic_loss + actor_loss).backward()
        policy.optimizer.step()
        polyak_update(policy.critic.parameters(), policy.target_critic.parameters(), settings.tau)
        return {
            "value_loss": value_loss.item(),
            "critic_loss": critic_loss.item(),
            "actor_loss": actor_loss.item(),
            "weight": weights.mean().item(),
        }


def new_model(run: Run, vec_env: VecEnv) -> IQL:
    """Return an untrained model."""
    return IQL(IQLPolicy, vec_env, **options_of(run, vec_env))


ALGORITHM = Algorithm(
    name="iql",
    model=IQL,
    new_model=new_model,
    network=network,
    defaults=DEFAULTS
    | {
        "gamma": 0.997,
        "expectile": 0.7,
        "temperature": 3.0,  # weight of the advantage in scaled rewards [-], beta in the paper
        "tau": 0.005,  # share of the critic that its copy takes over with each update
    },
    search={"expectile": FloatDistribution(0.5, 0.95), "temperature": FloatDistribution(0.5, 10.0)},
    # The data set's policy is a further input: see ``training_inputs`` of leaderboard/inputs.py.
    training_information=("rewards",),
    single_scenarios=False,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
