"""Train an agent with PPO for one training seed.

    python -m train.ppo --seed 0
    python -m train.ppo --env RoughTurning-v0 --scenario forging --seed 1 --total-timesteps 8000000

The same command resumes an interrupted training, and does nothing if training is finished. Files: see ``train/training.py``.
(Schulman et al. 2017, arXiv 1707.06347.)
"""

import math
import sys
from functools import partial
from typing import Any

import numpy as np
import torch
from optuna.distributions import FloatDistribution, IntDistribution
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from train.actor import Feedforward
from train.run import Run
from train.training import ACTIVATIONS, Algorithm, command_line

Tensor = torch.Tensor


class LeanPPO(PPO):
    """Stable-Baselines3's PPO without its Python loops over environments and its statistics of minibatches (docs/peers.md).

    Samples of a rollout lie in one tensor, which is shuffled once per epoch.
    """

    def collect_rollouts(
        self,
        env: VecEnv,
        callback: BaseCallback,
        rollout_buffer: RolloutBuffer,
        n_rollout_steps: int,
    ) -> bool:
        """Fill the buffer; the value of its last observation is added to a truncated episode's last reward."""
        policy: Any = self.policy
        rollout_buffer.reset()
        callback.on_rollout_start()
        for _ in range(n_rollout_steps):
            observations: Any = self._last_obs
            with torch.no_grad():
                means, values = self._outputs(torch.from_numpy(observations))
                actions = means + policy.log_std.exp() * torch.randn_like(means)
                log_probabilities = log_probability(actions, means, policy.log_std)
            found: Any = env.step(actions.clamp(-1.0, 1.0).numpy())
            self._last_obs, rewards, ended, infos = found
            self.num_timesteps += env.num_envs
            callback.on_step()
            done = np.flatnonzero(ended).tolist()
            self.ep_info_buffer.extend(infos[i]["episode"] for i in done)  # type: ignore[union-attr]
            if truncated := [i for i in done if infos[i]["TimeLimit.truncated"]]:
                last = np.stack([infos[i]["terminal_observation"] for i in truncated])
                rewards[truncated] += self.gamma * self._values(last).numpy()
            starts: Any = self._last_episode_starts
            rollout_buffer.add(
                observations, actions.numpy(), rewards, starts, values, log_probabilities
            )
            self._last_episode_starts = ended
        rollout_buffer.compute_returns_and_advantage(self._values(self._last_obs), ended)
        callback.on_rollout_end()
        return True

    def _outputs(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Return mean actions, shape (n, actions), and values, shape (n,)."""
        policy: Any = self.policy
        layers = policy.mlp_extractor
        return policy.action_net(layers.policy_net(observations)), policy.value_net(
            layers.value_net(observations)
        ).flatten()

    def _values(self, observations: Any) -> Tensor:
        with torch.no_grad():
            return self._outputs(torch.from_numpy(observations))[1]

    def train(self) -> None:
        """Update the policy with the buffer."""
        policy: Any = self.policy
        self._update_learning_rate(policy.optimizer)
        clip = self.clip_range(self._current_progress_remaining)  # type: ignore[operator]
        buffer = self.rollout_buffer
        columns = [
            buffer.observations,
            buffer.actions,
            buffer.log_probs,
            buffer.advantages,
            buffer.returns,
        ]
        samples: Any = torch.cat(
            [
                torch.from_numpy(each).reshape(buffer.buffer_size * buffer.n_envs, -1)
                for each in columns
            ],
            dim=1,
        )
        entries = buffer.observations.shape[-1]
        for _ in range(self.n_epochs):
            for batch in samples[torch.randperm(len(samples))].split(self.batch_size):
                observations, actions = batch[:, :entries], batch[:, entries:-3]
                before, advantages, returns = batch[:, -3:].unbind(dim=1)
                advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
                means, values = self._outputs(observations)
                log_ratio = log_probability(actions, means, policy.log_std) - before
                ratio = log_ratio.exp()
                policy_loss = -torch.min(
                    advantages * ratio, advantages * ratio.clamp(1.0 - clip, 1.0 + clip)
                ).mean()
                value_loss = torch.nn.functional.mse_loss(values, returns)
                loss = (
                    policy_loss + self.vf_coef * value_loss - self.ent_coef * policy.log_std.sum()
                )
                policy.optimizer.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(policy.parameters(), self.max_grad_norm)
                policy.optimizer.step()
        self._n_updates += self.n_epochs
        for name, value in (
            ("policy_gradient_loss", policy_loss),
            ("value_loss", value_loss),
            ("approx_kl", (ratio - 1.0 - log_ratio).mean()),
            ("clip_fraction", ((ratio - 1.0).abs() > clip).float().mean()),
            ("std", policy.log_std.exp().mean()),
        ):
            self.logger.record(f"train/{name}", value.item())


class FirstEntries(torch.nn.Linear):
    """A layer that sees the first entries of its input alone."""

    def forward(self, input: Tensor) -> Tensor:
        return super().forward(input[..., : self.in_features])


class AsymmetricPolicy(ActorCriticPolicy):
    """Networks whose actor does not see the last ``hidden`` entries of observations (Pinto et al. 2018, arXiv 1710.06542)."""

    def __init__(self, *arguments: Any, hidden: int, **options: Any) -> None:
        self.hidden = hidden
        super().__init__(*arguments, **options)

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        layers: Any = self.mlp_extractor.policy_net
        layers[0] = FirstEntries(layers[0].in_features - self.hidden, layers[0].out_features)


def log_probability(actions: Tensor, means: Tensor, log_deviations: Tensor) -> Tensor:
    """Return the logarithms of normal probability densities of actions, shape (n,)."""
    squares = ((actions - means) * torch.exp(-log_deviations)).square().sum(dim=1)
    return -0.5 * squares - log_deviations.sum() - 0.5 * actions.shape[1] * math.log(2.0 * math.pi)


def settings(run: Run) -> dict[str, Any]:
    """Return a run's hyperparameters under Stable-Baselines3's names, for all variants of PPO."""
    p = run.parameters
    return {
        "learning_rate": LinearSchedule(p["learning_rate"], p["final_learning_rate"], 1.0),
        "n_steps": p["n_steps"],
        "batch_size": p["batch_size"],
        "n_epochs": p["n_epochs"],
        "gamma": p["gamma"],
        "gae_lambda": p["gae_lambda"],
        "clip_range": p["clip_range"],
        "ent_coef": p["ent_coef"],
        "vf_coef": p["vf_coef"],
        "max_grad_norm": p["max_grad_norm"],
        "policy_kwargs": {
            "net_arch": p["net_arch"],
            "activation_fn": ACTIVATIONS[p["activation_fn"]],
            "log_std_init": p["log_std_init"],
            "optimizer_kwargs": {"eps": 1e-5, "fused": True},
        },
        "stats_window_size": max(100, p["num_envs"]),
        "tensorboard_log": str(run.folder / "tensorboard"),
        "seed": run.seed,
        "device": "cpu",
    }


def new_model(run: Run, vec_env: VecEnv) -> LeanPPO:
    """Return an untrained model."""
    values, asymmetric = settings(run), run.parameters.get("asymmetric") is True
    if asymmetric:
        values["policy_kwargs"]["hidden"] = vec_env.get_attr("hidden")[0]
    return LeanPPO(AsymmetricPolicy if asymmetric else ActorCriticPolicy, vec_env, **values)


def network(policy: Any) -> Feedforward:
    """Return the agent of a trained policy."""
    return Feedforward(policy.mlp_extractor.policy_net, policy.action_net)


SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "gamma": FloatDistribution(0.5, 0.999),
    "n_epochs": IntDistribution(3, 10),
    "log_std_init": FloatDistribution(-2.0, 0.0),
}

ALGORITHM = Algorithm(
    name="ppo",
    model=LeanPPO,
    new_model=new_model,
    network=network,
    search=SEARCH,
    training_information=("rewards",),
)

main = partial(command_line, ALGORITHM)

if __name__ == "__main__":
    sys.exit(main())
