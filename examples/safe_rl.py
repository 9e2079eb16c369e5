"""Safe reinforcement learning: a cost beside the reward, and the leaderboard's constraint on it.

    python -m examples.safe_rl --total-timesteps 20000

``CostStep`` has the steps of Safety-Gymnasium's interface, with six values. The script plays
constant speed and feed, and prints the return and the cost of an episode. docs/ecosystem.md has
recipes for OmniSafe and TorchRL.
"""

import sys
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from examples.shared import parser, run

Step = tuple[Any, float, float, bool, bool, dict[str, Any]]


class CostStep(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose steps return a cost after the reward.

    A step's cost is ``info["cost"]`` [s]: the time in severe overload less the allowed share of
    cutting time. A policy is feasible if an episode's sum is at most 0 on average. The reward lacks
    its term of overload, so that overload has one price, the multiplier of the constraint.
    """

    def step(self, action: Any) -> Step:  # type: ignore[override]
        """Return observation, reward, cost, terminated, truncated and info."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        reward_without_overload = float(reward) - info["reward_overload"]
        return observation, reward_without_overload, info["cost"], terminated, truncated, info


def main(arguments: Sequence[str] | None = None) -> int:
    """Play, print; return the exit status."""
    options = parser("safe_rl", __doc__, 20_000, num_envs=1).parse_args(arguments)
    env = CostStep(gymnasium.make("RoughTurning-v0"))
    env.reset(seed=options.seed)
    returns = [0.0]
    costs = [0.0]
    for _ in range(options.total_timesteps):
        _, reward, cost, terminated, truncated, _ = env.step(np.zeros(2, np.float32))
        returns[-1] += reward
        costs[-1] += cost
        if terminated or truncated:
            env.reset()
            returns.append(0.0)
            costs.append(0.0)
    print(
        f"{len(costs)} episodes: mean return {np.mean(returns):.0f} s, cost {np.mean(costs):.1f} s"
    )
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
