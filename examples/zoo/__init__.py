"""Settings for rl-baselines3-zoo, translated from those of ``train``, for every id.

Use them by ``--conf-file examples.zoo.ppo``; docs/ecosystem.md has the commands. The zoo's learning
rate falls to zero, and it does not scale rewards.
"""

from typing import Any

import gymnasium

from train.run import hyperparameters
from turning_env import ALL_IDS

SAME_NAMES = (
    "n_steps",
    "batch_size",
    "n_epochs",
    "gamma",
    "gae_lambda",
    "clip_range",
    "ent_coef",
    "vf_coef",
    "max_grad_norm",
    "buffer_size",
    "learning_starts",
    "gradient_steps",
    "tau",
    "top_quantiles_to_drop_per_net",
)
"""Hyperparameters that have the same name and meaning in the zoo."""
POLICY_NAMES = ("log_std_init", "n_critics", "n_quantiles")
"""Hyperparameters that the zoo passes to the policy's networks."""


def settings(algorithm: str) -> dict[str, dict[str, Any]]:
    """Return the zoo's settings of an algorithm for each id."""
    return {env_id: _of_id(algorithm, env_id) for env_id in ALL_IDS}


def _of_id(algorithm: str, env_id: str) -> dict[str, Any]:
    ours = hyperparameters(algorithm, env_id)
    zoo = {name: ours[name] for name in SAME_NAMES if name in ours}
    zoo["n_timesteps"] = ours["total_timesteps"]
    zoo["n_envs"] = ours["num_envs"]
    zoo["policy"] = "MlpPolicy"
    zoo["learning_rate"] = f"lin_{ours['learning_rate']}"

    # The zoo evaluates this text, in which ``nn`` is ``torch.nn``.
    network = [f"net_arch={ours['net_arch']}", "activation_fn=nn.ReLU"]
    network += [f"{name}={ours[name]}" for name in POLICY_NAMES if name in ours]
    zoo["policy_kwargs"] = f"dict({', '.join(network)})"

    if "target_entropy_per_action" in ours:  # SAC and TQC
        action_space: Any = gymnasium.make(env_id).action_space
        zoo["target_entropy"] = action_space.shape[0] * ours["target_entropy_per_action"]
        zoo["ent_coef"] = f"auto_{ours['initial_ent_coef']}"
        zoo["train_freq"] = 1
    return zoo
