"""SAC, which learns from all that it remembers: train one agent for one training seed.

    python -m train.sac --seed 0

All lathes make a step, then so many batches are drawn from the memory of past steps. Running the same command again resumes an
interrupted training, and does nothing if it is finished. What a run's folder holds: ``train/training.py``. (Haarnoja et al. 2018,
arXiv 1812.05905.)
"""

import math
import sys
from pathlib import Path
from typing import Any

import torch
from optuna.distributions import FloatDistribution
from stable_baselines3 import SAC
from stable_baselines3.common.utils import LinearSchedule

from train import command
from train.feedforward import Feedforward
from train.run import Run
from train.training import ACTIVATIONS, Algorithm
from train.vec_env import RoughTurningVecEnv


def settings(run: Run, lathes: RoughTurningVecEnv) -> dict[str, Any]:
    """A run's hyperparameters by the names that Stable-Baselines3 gives them in SAC and in TQC."""
    p = run.parameters
    return {
        "learning_rate": LinearSchedule(p["learning_rate"], p["final_learning_rate"], 1.0),
        "buffer_size": p["memory"],
        "learning_starts": p["random_steps"],
        "batch_size": p["batch_size"],
        "tau": p["target_rate"],
        "gamma": p["discount"],
        "train_freq": 1,
        "gradient_steps": p["batches_per_step"],
        "ent_coef": f"auto_{p['initial_entropy_coefficient']}",
        "target_entropy": p["target_entropy_per_action"] * math.prod(lathes.action_space.shape or ()),
        "policy_kwargs": {"net_arch": p["hidden_layers"], "activation_fn": ACTIVATIONS[p["activation"]]},
        "tensorboard_log": str(run.folder / "tensorboard"),
        "seed": run.seed,
        "device": "cpu",
    }


def new_model(run: Run, lathes: RoughTurningVecEnv) -> SAC:
    """An untrained model."""
    return SAC("MlpPolicy", lathes, **settings(run, lathes))


def actor(path: Path) -> Feedforward:
    """The finished agent in a ``policy.zip`` of your own."""
    return squashed(SAC.load(path, device="cpu").actor)


def squashed(network: Any) -> Feedforward:
    """The most likely action of SAC's, and of TQC's, network."""
    return Feedforward(network.latent_pi, network.mu, torch.nn.Tanh())


SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "discount": FloatDistribution(0.5, 0.95),
    "target_rate": FloatDistribution(0.003, 0.05, log=True),
    "target_entropy_per_action": FloatDistribution(-3.0, -0.5),
}

ALGORITHM = Algorithm("sac", "SAC", SAC, new_model, actor, SEARCH, kept=("replay_buffer",), log_interval=100)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    return command.main(ALGORITHM, arguments)


if __name__ == "__main__":
    sys.exit(main())
