"""AgileRL: PPO on the batch.

    python -m examples.agilerl_ppo --steps 200000

AgileRL learns from every step that it sees. With Gymnasium's default autoreset mode, NEXT_STEP, it would also learn from resets.
Choose SAME_STEP, as here.
"""

import sys
from collections.abc import Sequence
from typing import Any

import gymnasium
import torch
from agilerl.algorithms import PPO
from agilerl.rollouts import collect_rollouts

import turning_env  # noqa: F401 - registers the ids
from examples.shared import ENV_ID, parser, run, score

ROLLOUT = 4096
"""Steps of all environments between updates."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score; return the exit status."""
    options = parser("agilerl_ppo", __doc__, 200_000, 64).parse_args(arguments)
    torch.manual_seed(options.seed)
    envs = gymnasium.make_vec(ENV_ID, options.num_envs, autoreset_mode="SameStep")
    envs.reset(seed=options.seed)
    scaled = gymnasium.wrappers.vector.TransformReward(envs, lambda rewards: rewards / 3)
    settings = {
        "learn_step": ROLLOUT,
        "batch_size": 512,
        "update_epochs": 5,
        "lr": 1e-3,
        "gamma": 0.8,
        "num_envs": options.num_envs,
    }
    agent = PPO(envs.single_observation_space, envs.single_action_space, **settings)
    state: dict[str, Any] = {}
    for _ in range(-(-options.steps // ROLLOUT)):
        _, *last = collect_rollouts(agent, scaled, **state)
        state = dict(zip(("last_obs", "last_done", "last_scores", "last_info"), last, strict=True))
        agent.learn()
    agent.set_training_mode(False)

    def act(observations: Any) -> Any:
        return agent.get_action(observations)[0]  # sampled: AgileRL's PPO has no deterministic actions

    print(f"PPO after {options.steps} steps: {score(act, options.tuning_seeds)}")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
