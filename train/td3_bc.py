"""Train an agent offline with TD3+BC for one training seed.

    python -m train.datasets --policy mixture
    python -m train.td3_bc --env RoughTurning-Family-v1 --set behaviour=mixture --seed 0

TD3, whose actor also stays close to the recorded actions. Alpha, tau, delay and noise are those of
the paper (Fujimoto and Gu 2021, arXiv 2106.06860); the discount is PPO's on this task. The base of
all offline algorithms, ``train/offline.py``, has the other settings: smaller networks and fewer
updates than in the paper.
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
    network,
    options_of,
)
from train.run import Run
from train.training import Algorithm, command_line

Tensor = torch.Tensor


class TD3BCPolicy(OfflinePolicy):
    """Actor and critic, and copies of both that follow them."""

    def __init__(
        self, observation_space: Any, action_space: Any, net_arch: list[int], **options: Any
    ) -> None:
        super().__init__(observation_space, action_space, net_arch, **options)
        self.critic = TwinCritic(self.entries, self.actions, net_arch)
        self.target_actor = deepcopy(self.actor).requires_grad_(False)
        self.target_critic = deepcopy(self.critic).requires_grad_(False)


class TD3BC(OfflineAlgorithm):
    """The algorithm; see ``OfflineAlgorithm``."""

    def update(self, batch: Batch) -> dict[str, float]:
        """Take a step with the critic, and in some updates with the actor."""
        policy = self.policy
        critic_loss = policy.critic.loss(batch, self._targets(batch))
        policy.optimizer.zero_grad()
        critic_loss.backward()
        policy.optimizer.step()
        if self._n_updates % self.settings.policy_delay == 0:
            self._update_actor(batch)
        return {"critic_loss": critic_loss.item()}

    def _targets(self, batch: Batch) -> Tensor:
        """Return the values to which the critic is fitted, shape (steps,)."""
        policy = self.policy
        settings = self.settings
        with torch.no_grad():
            # Noise smooths the values of neighbouring actions.
            noise = settings.target_policy_noise * torch.randn_like(batch.actions)
            noise = noise.clamp(-settings.target_noise_clip, settings.target_noise_clip)
            next_actions = policy.target_actor(batch.next_observations) + noise
            next_values = policy.target_critic.lower(
                batch.next_observations, next_actions.clamp(-1.0, 1.0)
            )
            targets: Tensor = batch.rewards + settings.gamma * batch.goes_on * next_values
        return targets

    def _update_actor(self, batch: Batch) -> None:
        """Take a step towards higher values and recorded actions, equation 5 of the paper."""
        policy = self.policy
        actions = policy.actor(batch.observations)
        values, _ = policy.critic(batch.observations, actions)
        # Values of any scale weigh as much against the imitation.
        scale = self.settings.alpha / values.abs().mean().detach()
        imitation = torch.nn.functional.mse_loss(actions, batch.actions)
        policy.optimizer.zero_grad()
        (imitation - scale * values.mean()).backward()
        # The critic has gradients from this loss, too, but is not to follow it.
        policy.critic.zero_grad()
        policy.optimizer.step()
        tau = self.settings.tau
        polyak_update(policy.critic.parameters(), policy.target_critic.parameters(), tau)
        polyak_update(policy.actor.parameters(), policy.target_actor.parameters(), tau)


def new_model(run: Run, vec_env: VecEnv) -> TD3BC:
    """Return an untrained model."""
    return TD3BC(TD3BCPolicy, vec_env, **options_of(run, vec_env))


ALGORITHM = Algorithm(
    name="td3_bc",
    model=TD3BC,
    new_model=new_model,
    network=network,
    defaults=DEFAULTS
    | {
        "gamma": 0.997,
        "alpha": 2.5,  # weight of values over that of imitation [-]
        "tau": 0.005,  # share of the networks that their copies take over
        "policy_delay": 2,  # updates of the critic per update of the actor
        "target_policy_noise": 0.2,
        "target_noise_clip": 0.5,
    },
    search={"alpha": FloatDistribution(0.5, 10.0, log=True)},
    # The data set's policy is a further input: see ``training_inputs`` of leaderboard/inputs.py.
    training_information=("rewards",),
    single_scenarios=False,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
