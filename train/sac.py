"""Train an agent with SAC, which learns off-policy from a replay buffer, for one training seed.

    python -m train.sac --seed 0

After each step of all environments, batches are sampled from the replay buffer. The same command
resumes an interrupted training, and does nothing if training is finished. Files: see
``train/training.py``. (Haarnoja et al. 2018, arXiv 1812.05905.)
"""

import math
import sys
from typing import Any

import torch
from optuna.distributions import FloatDistribution
from stable_baselines3 import SAC
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from train.actor import Feedforward
from train.run import Run
from train.training import ACTIVATIONS, Algorithm, command_line


def settings(run: Run, vec_env: VecEnv) -> dict[str, Any]:
    """Return the arguments of Stable-Baselines3's SAC and TQC for a run."""
    p = run.parameters
    actions = math.prod(vec_env.action_space.shape or ())
    return {
        # It falls linearly over the whole training.
        "learning_rate": LinearSchedule(
            start=p["learning_rate"], end=p["final_learning_rate"], end_fraction=1.0
        ),
        "buffer_size": p["buffer_size"],
        "learning_starts": p["learning_starts"],
        "batch_size": p["batch_size"],
        "tau": p["tau"],
        "gamma": p["gamma"],
        # After every step of all environments, not of one.
        "train_freq": 1,
        "gradient_steps": p["gradient_steps"],
        # "auto": the coefficient is learned, so that the policy's entropy approaches its target.
        "ent_coef": f"auto_{p['initial_ent_coef']}",
        "target_entropy": p["target_entropy_per_action"] * actions,
        "policy_kwargs": {
            "net_arch": p["net_arch"],
            "activation_fn": ACTIVATIONS[p["activation_fn"]],
        },
        "tensorboard_log": str(run.folder / "tensorboard"),
        "seed": run.seed,
        # Networks this small are slower on a GPU.
        "device": "cpu",
    }


def new_model(run: Run, vec_env: VecEnv) -> SAC:
    """Return an untrained model."""
    return SAC("MlpPolicy", vec_env, **settings(run, vec_env))


def network(policy: Any) -> Feedforward:
    """Return the agent of a trained policy of SAC or TQC: its most likely action."""
    return Feedforward(policy.actor.latent_pi, policy.actor.mu, torch.nn.Tanh())


DEFAULTS: dict[str, Any] = {
    "total_timesteps": 1_500_000,  # environment steps of the whole training
    "num_envs": 128,  # environments side by side
    "learning_starts": 20_000,  # with random actions, before learning starts
    "buffer_size": 1_500_000,  # size of the replay buffer: all steps
    "batch_size": 512,
    "gradient_steps": 1,  # after each step of all environments
    "gamma": 0.8,  # as for PPO
    "tau": 0.02,  # update rate of the target networks
    "learning_rate": 1e-3,  # falls linearly ...
    "final_learning_rate": 1e-5,  # ... to this
    "initial_ent_coef": 0.1,
    "target_entropy_per_action": -1.0,
    "net_arch": [64, 64],  # for policy and value functions each
    "activation_fn": "relu",  # or "tanh"
    "reward_scale": 0.3333333333,  # factor on rewards [s]
    "belief": False,  # shows the estimates of the optimisers' filter: baselines/belief.py
    "derived": False,  # shows the inputs of baselines/derived_observation.py
    "load_target": False,  # actions are load targets: baselines/load_target.py
    "position": False,  # tells the position along the bar: train/terms.py
    "frames": 1,  # successive observations that the agent sees
    "life_price": "flat",  # charge for the edge's life: "flat", "marginal" (p(D)) or "end"
}

SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "gamma": FloatDistribution(0.5, 0.999),
    "tau": FloatDistribution(0.003, 0.05, log=True),
    "target_entropy_per_action": FloatDistribution(-3.0, -0.5),
}

ALGORITHM = Algorithm(
    name="sac",
    model=SAC,
    new_model=new_model,
    network=network,
    defaults=DEFAULTS,
    search=SEARCH,
    training_information=("rewards",),
    # Stable-Baselines3 does not save the replay buffer, without which a training cannot go on.
    extra_state=("replay_buffer",),
    log_interval=100,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
