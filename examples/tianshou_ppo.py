"""Tianshou: PPO on the batch.

    python -m examples.tianshou_ppo --steps 200000

Tianshou's own vector environments (`DummyVectorEnv`, `SubprocVectorEnv`) also work. They step single environments and spend most
of their time on copying infos.
"""

import sys
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from tianshou.algorithm import PPO
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Batch, Collector, VectorReplayBuffer
from tianshou.env import BaseVectorEnv
from tianshou.trainer import OnPolicyTrainerParams
from tianshou.utils.net.common import Net
from tianshou.utils.net.continuous import ContinuousActorProbabilistic, ContinuousCritic
from torch.distributions import Independent, Normal

import turning_env  # noqa: F401 - registers the ids
from examples.shared import ENV_ID, parser, run, score

ROLLOUT = 4096
"""Steps of all environments between updates."""


class BatchVectorEnv(BaseVectorEnv):
    """An adapter from the batch to Tianshou's interface, without infos; all environments step together."""

    def __init__(self, num_envs: int, seed: int) -> None:
        self.envs = gymnasium.make_vec(ENV_ID, num_envs, autoreset_mode="Disabled")
        self.envs.reset(seed=seed)
        self.env_num, self.is_async, self.is_closed = num_envs, False, False
        self.infos = np.array([{"env_id": index} for index in range(num_envs)])

    def get_env_attr(self, key: str, id: Any = None) -> list[Any]:
        return [getattr(self.envs, f"single_{key}")] * self.env_num

    def reset(self, env_id: Any = None, **kwargs: Any) -> tuple[Any, Any]:
        chosen = np.arange(self.env_num) if env_id is None else np.asarray(env_id)
        observations, _ = self.envs.reset(options={"reset_mask": np.isin(np.arange(self.env_num), chosen)})
        return observations[chosen], self.infos[chosen]

    def step(self, action: Any, id: Any = None) -> tuple[Any, Any, Any, Any, Any]:
        return *self.envs.step(action)[:4], self.infos


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score; return the exit status."""
    options = parser("tianshou_ppo", __doc__, 200_000, 64).parse_args(arguments)
    torch.manual_seed(options.seed)
    envs = BatchVectorEnv(options.num_envs, options.seed)
    observation_space, action_space = envs.observation_space[0], envs.action_space[0]
    shape: dict[str, Any] = {"state_shape": observation_space.shape, "hidden_sizes": [64, 64]}
    actor = ContinuousActorProbabilistic(
        preprocess_net=Net(**shape), action_shape=action_space.shape, unbounded=True, conditioned_sigma=False
    )
    policy = ProbabilisticActorPolicy(
        actor=actor, dist_fn=lambda of: Independent(Normal(*of), 1), action_space=action_space, deterministic_eval=True
    )
    algorithm = PPO(
        policy=policy,
        critic=ContinuousCritic(preprocess_net=Net(**shape)),
        optim=AdamOptimizerFactory(lr=1e-3),
        gamma=0.8,
        return_scaling=True,
    )
    collector = Collector(algorithm, envs, VectorReplayBuffer(2 * ROLLOUT, options.num_envs))
    settings = OnPolicyTrainerParams(
        training_collector=collector,
        max_epochs=1,
        epoch_num_steps=options.steps,
        collection_step_num_env_steps=ROLLOUT,
        update_step_num_repetitions=5,
        batch_size=512,
        verbose=False,
    )
    algorithm.run_training(settings)
    policy.eval()

    @torch.no_grad()
    def act(observations: Any) -> Any:
        return policy(Batch(obs=observations, info=Batch())).act.numpy()

    print(f"PPO after {options.steps} steps: {score(act, options.tuning_seeds)}")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
