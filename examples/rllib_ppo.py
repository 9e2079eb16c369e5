"""RLlib: PPO on single environments, whose scenario is a dictionary in RLlib's configuration.

python -m examples.rllib_ppo --steps 100000
"""

import sys
from collections.abc import Sequence
from typing import Any

import gymnasium
import ray
import torch
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.tune.registry import register_env

from examples.shared import ENV_ID, of_tensors, parser, run, score
from turning_env import Scenario

ROLLOUT = 4096
"""Steps of all environments between updates."""


def make(config: dict[str, Any]) -> gymnasium.Env[Any, Any]:
    """Return an environment; workers import this package, which registers its ids."""
    env = gymnasium.make(f"turning_env:{ENV_ID}", scenario=Scenario.model_validate(config["scenario"]))
    return gymnasium.wrappers.TransformReward(env, lambda reward: float(reward) / 3)


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score; return the exit status."""
    options = parser("rllib_ppo", __doc__, 100_000, 16).parse_args(arguments)
    ray.init(include_dashboard=False, num_cpus=1, log_to_driver=False)
    register_env("rough_turning", make)
    config = (
        PPOConfig()
        .environment("rough_turning", env_config={"scenario": {"control": {"time_limit": 30.0}}})
        .env_runners(num_env_runners=0, num_envs_per_env_runner=options.num_envs)
        .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[64, 64], fcnet_activation="relu"))
        .training(gamma=0.8, lr=1e-3, train_batch_size_per_learner=ROLLOUT, minibatch_size=512, num_epochs=5)
        .debugging(seed=options.seed)
    )
    algorithm = config.build_algo()
    for _ in range(-(-options.steps // ROLLOUT)):
        algorithm.train()
    module = algorithm.get_module()

    def mean(observations: torch.Tensor) -> torch.Tensor:
        numbers: torch.Tensor = module.forward_inference({"obs": observations})["action_dist_inputs"]
        return numbers.chunk(2, dim=1)[0]  # the other half holds standard deviations

    print(f"PPO after {options.steps} steps: {score(of_tensors(mean), options.tuning_seeds)}")
    ray.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
