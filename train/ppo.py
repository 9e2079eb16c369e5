"""Train an agent with PPO for one training seed.

    python -m train.ppo --seed 0
    python -m train.ppo --env RoughTurning-v0 --scenario forging --seed 1 --total-timesteps 8000000

The same command resumes an interrupted training, and does nothing if training is finished. Files:
see ``train/training.py``. (Schulman et al. 2017, arXiv 1707.06347.)
"""

import math
import sys
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
    """Stable-Baselines3's PPO without its Python loops over environments (docs/scaling.md).

    Samples of a rollout lie in one tensor, which is shuffled once per epoch. Statistics are those
    of the last minibatch.
    """

    def collect_rollouts(
        self,
        env: VecEnv,
        callback: BaseCallback,
        rollout_buffer: RolloutBuffer,
        n_rollout_steps: int,
    ) -> bool:
        """Fill the buffer with a rollout of ``n_rollout_steps`` steps per environment."""
        policy: Any = self.policy
        rollout_buffer.reset()
        callback.on_rollout_start()
        for _ in range(n_rollout_steps):
            observations: Any = self._last_obs
            with torch.no_grad():
                means, values = self._outputs(torch.from_numpy(observations))
                actions = means + policy.log_std.exp() * torch.randn_like(means)
                log_probabilities = log_probability(actions, means, policy.log_std)

            step: Any = env.step(actions.clamp(-1.0, 1.0).numpy())
            next_observations, rewards, ended, infos = step
            self.num_timesteps += env.num_envs
            callback.on_step()
            self._close_episodes(rewards, ended, infos)

            rollout_buffer.add(
                obs=observations,
                action=actions.numpy(),
                reward=rewards,
                episode_start=self._last_episode_starts,  # type: ignore[arg-type]
                value=values,
                log_prob=log_probabilities,
            )
            self._last_obs = next_observations
            self._last_episode_starts = ended
        rollout_buffer.compute_returns_and_advantage(self._values(self._last_obs), ended)
        callback.on_rollout_end()
        return True

    def _close_episodes(self, rewards: Any, ended: Any, infos: Any) -> None:
        """Note the returns of episodes that have ended, and complete the rewards of truncated ones.

        A truncated episode would go on: the value of its last observation is added to its last
        reward, as its environment's next observation is the first of another episode.
        """
        ended_envs = np.flatnonzero(ended).tolist()
        self.ep_info_buffer.extend(infos[i]["episode"] for i in ended_envs)  # type: ignore[union-attr]
        truncated = [i for i in ended_envs if infos[i]["TimeLimit.truncated"]]
        if truncated:
            last = np.stack([infos[i]["terminal_observation"] for i in truncated])
            rewards[truncated] += self.gamma * self._values(last).numpy()

    def _outputs(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Return mean actions, shape (n, actions), and values, shape (n,)."""
        policy: Any = self.policy
        layers = policy.mlp_extractor
        means = policy.action_net(layers.policy_net(observations))
        values = policy.value_net(layers.value_net(observations)).flatten()
        return means, values

    def _values(self, observations: Any) -> Tensor:
        with torch.no_grad():
            return self._outputs(torch.from_numpy(observations))[1]

    def _samples(self) -> Tensor:
        """Return the rollout's samples, shape (n, entries + actions + 3).

        Columns: observation, action, log probability of the action, advantage, return.
        """
        buffer = self.rollout_buffer
        columns = [
            buffer.observations,
            buffer.actions,
            buffer.log_probs,
            buffer.advantages,
            buffer.returns,
        ]
        count = buffer.buffer_size * buffer.n_envs
        return torch.cat([torch.from_numpy(column).reshape(count, -1) for column in columns], dim=1)

    def train(self) -> None:
        """Update the policy with the buffer."""
        policy: Any = self.policy
        self._update_learning_rate(policy.optimizer)
        clip_range = self.clip_range(self._current_progress_remaining)  # type: ignore[operator]
        samples: Any = self._samples()
        entries = self.rollout_buffer.observations.shape[-1]
        for _ in range(self.n_epochs):
            for batch in samples[torch.randperm(len(samples))].split(self.batch_size):
                # See _samples for the columns.
                observations = batch[:, :entries]
                actions = batch[:, entries:-3]
                old_log_probabilities, advantages, returns = batch[:, -3:].unbind(dim=1)
                advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)

                # Probability of the action under the new policy over that under the old one.
                means, values = self._outputs(observations)
                log_probabilities = log_probability(actions, means, policy.log_std)
                log_ratio = log_probabilities - old_log_probabilities
                ratio = log_ratio.exp()

                # Clipped surrogate objective, equation 7 of the paper.
                clipped_ratio = ratio.clamp(1.0 - clip_range, 1.0 + clip_range)
                policy_loss = -torch.min(advantages * ratio, advantages * clipped_ratio).mean()
                value_loss = torch.nn.functional.mse_loss(values, returns)
                # The entropy of a normal distribution is its log deviation plus a constant.
                entropy = policy.log_std.sum()
                loss = policy_loss + self.vf_coef * value_loss - self.ent_coef * entropy

                policy.optimizer.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(policy.parameters(), self.max_grad_norm)
                policy.optimizer.step()
        self._n_updates += self.n_epochs

        # Estimator of the Kullback-Leibler divergence: http://joschu.net/blog/kl-approx.html.
        approx_kl = (ratio - 1.0 - log_ratio).mean()
        clip_fraction = ((ratio - 1.0).abs() > clip_range).float().mean()
        self.logger.record("train/policy_gradient_loss", policy_loss.item())
        self.logger.record("train/value_loss", value_loss.item())
        self.logger.record("train/approx_kl", approx_kl.item())
        self.logger.record("train/clip_fraction", clip_fraction.item())
        self.logger.record("train/std", policy.log_std.exp().mean().item())


def log_probability(actions: Tensor, means: Tensor, log_deviations: Tensor) -> Tensor:
    """Return the logarithms of normal probability densities of actions, shape (n,)."""
    squares = ((actions - means) * torch.exp(-log_deviations)).square().sum(dim=1)
    return -0.5 * squares - log_deviations.sum() - 0.5 * actions.shape[1] * math.log(2.0 * math.pi)


class FirstEntries(torch.nn.Linear):
    """A layer that sees the first entries of its input alone."""

    def forward(self, entries: Tensor) -> Tensor:
        return super().forward(entries[..., : self.in_features])


class AsymmetricPolicy(ActorCriticPolicy):
    """Networks whose actor does not see the last ``hidden`` entries of observations.

    The critic sees all of them (Pinto et al. 2018, arXiv 1710.06542).
    """

    def __init__(self, *arguments: Any, hidden: int, **options: Any) -> None:
        self.hidden = hidden
        super().__init__(*arguments, **options)

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        layers: Any = self.mlp_extractor.policy_net
        layers[0] = FirstEntries(layers[0].in_features - self.hidden, layers[0].out_features)


def settings(run: Run) -> dict[str, Any]:
    """Return the arguments of Stable-Baselines3's PPO for a run; its variants share them."""
    p = run.parameters
    return {
        # It falls linearly over the whole training.
        "learning_rate": LinearSchedule(
            start=p["learning_rate"], end=p["final_learning_rate"], end_fraction=1.0
        ),
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
            # The epsilon of OpenAI's Baselines; fused: one call updates all weights.
            "optimizer_kwargs": {"eps": 1e-5, "fused": True},
        },
        # With fewer, the mean return would be that of some environments alone.
        "stats_window_size": max(100, p["num_envs"]),
        "tensorboard_log": str(run.folder / "tensorboard"),
        "seed": run.seed,
        "device": "cpu",
    }


def new_model(run: Run, vec_env: VecEnv) -> LeanPPO:
    """Return an untrained model."""
    arguments = settings(run)
    if run.parameters.get("asymmetric") is not True:
        return LeanPPO(ActorCriticPolicy, vec_env, **arguments)
    arguments["policy_kwargs"]["hidden"] = vec_env.get_attr("hidden")[0]
    return LeanPPO(AsymmetricPolicy, vec_env, **arguments)


def network(policy: Any) -> Feedforward:
    """Return the agent of a trained policy: its mean action."""
    return Feedforward(policy.mlp_extractor.policy_net, policy.action_net)


DEFAULTS: dict[str, Any] = {
    "total_timesteps": 6_000_000,  # environment steps of the whole training
    "num_envs": 512,  # environments side by side
    "n_steps": 32,  # steps per environment between updates
    "batch_size": 2048,
    "n_epochs": 3,
    # A horizon of about 5 s: life is charged as it is used, so a longer one only adds noise.
    "gamma": 0.8,
    "gae_lambda": 0.95,
    "learning_rate": 2e-3,  # falls linearly ...
    "final_learning_rate": 1e-5,  # ... to this
    "clip_range": 0.2,
    "ent_coef": 0.0,
    "vf_coef": 0.5,
    "max_grad_norm": 0.5,
    "net_arch": [64, 64],  # for policy and value function each
    "activation_fn": "relu",  # or "tanh"
    "log_std_init": -1.0,
    "reward_scale": 0.3333333333,  # factor on rewards [s]
    "belief": False,  # shows the estimates of the optimisers' filter: baselines/belief.py
    "derived": False,  # shows the inputs of baselines/derived_observation.py
    "load_target": False,  # actions are load targets: baselines/load_target.py
    "position": False,  # tells the position along the bar: train/terms.py
    "frames": 1,  # successive observations that the agent sees
    "life_price": "flat",  # charge for the edge's life: "flat", "marginal" (p(D)) or "end"
    "hides_context": False,  # hides the numbers of a family's nominal models
    "asymmetric": False,  # shows the critic the hidden state: train/terms.py
}

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
    defaults=DEFAULTS,
    search=SEARCH,
    training_information=("rewards",),
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
