"""Train an agent with PPO for one training seed.

    python -m train.ppo --seed 0
    python -m train.ppo --env RoughTurning-v0 --scenario forging --seed 1 --steps 8000000

The same command resumes an interrupted training, and does nothing if training is finished. Files: see ``train/training.py``.
(Schulman et al. 2017, arXiv 1707.06347.)
"""

import sys
from functools import partial
from typing import Any

import torch
from optuna.distributions import FloatDistribution, IntDistribution
from stable_baselines3 import PPO
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from train.actor import Feedforward
from train.run import Run
from train.training import ACTIVATIONS, Algorithm, command_line


def settings(run: Run) -> dict[str, Any]:
    """Return a run's hyperparameters under Stable-Baselines3's names, for all variants of PPO."""
    p = run.parameters
    return {
        "learning_rate": LinearSchedule(p["learning_rate"], p["final_learning_rate"], 1.0),
        "n_steps": p["rollout"],
        "batch_size": p["batch_size"],
        "n_epochs": p["epochs"],
        "gamma": p["discount"],
        "gae_lambda": p["gae_lambda"],
        "clip_range": p["clip_range"],
        "ent_coef": p["entropy_coefficient"],
        "vf_coef": p["value_coefficient"],
        "max_grad_norm": p["max_gradient_norm"],
        "policy_kwargs": {
            "net_arch": p["hidden_layers"],
            "activation_fn": ACTIVATIONS[p["activation"]],
            "log_std_init": p["initial_log_deviation"],
        },
        "tensorboard_log": str(run.folder / "tensorboard"),
        "seed": run.seed,
        "device": "cpu",
    }


def new_model(run: Run, vec_env: VecEnv) -> PPO:
    """Return an untrained model; its first actions vary about 0, or about ``initial_actions`` of the hyperparameters."""
    model = PPO("MlpPolicy", vec_env, **settings(run))
    means = run.parameters.get("initial_actions", [])
    last_layer: Any = model.policy.action_net
    with torch.no_grad():
        last_layer.bias[: len(means)] = torch.tensor(means)
    return model


def network(policy: Any) -> Feedforward:
    """Return the agent of a trained policy."""
    return Feedforward(policy.mlp_extractor.policy_net, policy.action_net)


SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "discount": FloatDistribution(0.5, 0.95),
    "epochs": IntDistribution(3, 10),
    "initial_log_deviation": FloatDistribution(-2.0, 0.0),
}

ALGORITHM = Algorithm("ppo", "PPO", PPO, new_model, network, SEARCH)


main = partial(command_line, ALGORITHM)

if __name__ == "__main__":
    sys.exit(main())
