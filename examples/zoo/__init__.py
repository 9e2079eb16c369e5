"""Settings for rl-baselines3-zoo, translated from ``train/hyperparameters``, for every id.

python -m rl_zoo3.train --algo ppo --env RoughTurning-Family-v0 --gym-packages turning_env --conf-file examples.zoo.ppo --seed 0

The zoo's learning rate falls to zero, and it does not scale rewards.
"""

from typing import Any

import gymnasium

from train.run import hyperparameters
from turning_env import FAMILY_ID, IDS

NAMES = {
    **{
        "steps": "n_timesteps",
        "num_envs": "n_envs",
        "rollout": "n_steps",
        "batch_size": "batch_size",
        "epochs": "n_epochs",
    },
    **{
        "discount": "gamma",
        "gae_lambda": "gae_lambda",
        "clip_range": "clip_range",
        "entropy_coefficient": "ent_coef",
    },
    **{
        "value_coefficient": "vf_coef",
        "max_gradient_norm": "max_grad_norm",
        "memory": "buffer_size",
    },
    **{
        "random_steps": "learning_starts",
        "batches_per_step": "gradient_steps",
        "target_rate": "tau",
    },
    **{"dropped_quantiles": "top_quantiles_to_drop_per_net"},
}
"""The zoo's name for each hyperparameter."""
NETWORK = {
    "initial_log_deviation": "log_std_init",
    "critics": "n_critics",
    "quantiles": "n_quantiles",
}


def settings(algorithm: str) -> dict[str, dict[str, Any]]:
    """Return the zoo's settings of an algorithm for each id."""
    found = {}
    for env_id in (*IDS, FAMILY_ID):
        ours = hyperparameters(algorithm, env_id)
        network = "".join(f", {name}={ours[own]}" for own, name in NETWORK.items() if own in ours)
        theirs = {name: ours[own] for own, name in NAMES.items() if own in ours}
        theirs |= {"policy": "MlpPolicy", "learning_rate": f"lin_{ours['learning_rate']}"}
        theirs["policy_kwargs"] = (
            f"dict(net_arch={ours['hidden_layers']}, activation_fn=nn.ReLU{network})"
        )
        if "target_entropy_per_action" in ours:
            theirs["target_entropy"] = (
                gymnasium.make(env_id).action_space.shape[0] * ours["target_entropy_per_action"]
            )  # type: ignore[index]
            theirs |= {"ent_coef": f"auto_{ours['initial_entropy_coefficient']}", "train_freq": 1}
        found[env_id] = theirs
    return found
