"""RLlib: PPO on the vector environment of any id.

python -m examples.rllib_ppo --total-timesteps 100000
python -m examples.rllib_ppo --env RoughTurning-Family-v1 --gamma 0.997 --reward-scale 0.05
"""

import math
import sys
from collections.abc import Sequence
from typing import Any

import gymnasium
import ray
import torch
from gymnasium.wrappers.vector import TransformReward
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.tune.registry import register_env

from examples.shared import of_tensors, parser, run, score

ROLLOUT = 8192  # steps of all environments between updates


def make(config: dict[str, Any]) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    """Return the environments of a worker.

    The worker's Gymnasium imports this package by the id's prefix, which registers the ids.
    """
    envs = gymnasium.make_vec(
        f"turning_env:{config['id']}", config["num_envs"], vectorization_mode="vector_entry_point"
    )
    return TransformReward(envs, lambda rewards: rewards * config["reward_scale"])


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score; return the exit status."""
    options = parser("rllib_ppo", __doc__, 100_000, num_envs=64, ids=True).parse_args(arguments)
    ray.init(include_dashboard=False, num_cpus=1, log_to_driver=False)
    register_env("rough_turning", make)
    env_config = {"id": options.env, "reward_scale": options.reward_scale}
    network = DefaultModelConfig(fcnet_hiddens=[64, 64], fcnet_activation="relu")
    config = (
        PPOConfig()
        .environment("rough_turning", env_config=env_config)
        .env_runners(
            num_env_runners=0,
            num_envs_per_env_runner=options.num_envs,
            gym_env_vectorize_mode="vector_entry_point",
        )
        .rl_module(model_config=network)
        .training(
            gamma=options.gamma,
            lr=1e-3,
            train_batch_size_per_learner=ROLLOUT,
            minibatch_size=512,
            num_epochs=5,
        )
        .debugging(seed=options.seed)
    )
    algorithm = config.build_algo()
    for _ in range(math.ceil(options.total_timesteps / ROLLOUT)):
        algorithm.train()
    module = algorithm.get_module()

    def mean(observations: torch.Tensor) -> torch.Tensor:
        outputs = module.forward_inference({"obs": observations})
        numbers: torch.Tensor = outputs["action_dist_inputs"]
        return numbers.chunk(2, dim=1)[0]  # the other half holds standard deviations

    result = score(of_tensors(mean), options.tuning_seeds, options.env)
    print(f"PPO after {options.total_timesteps} steps: {result}")
    ray.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
