"""SBX, Stable-Baselines3 in JAX: SAC on the batch, with the adapter for Stable-Baselines3.

python -m examples.sbx_sac --steps 100000
"""

import sys
from collections.abc import Sequence

from sbx import SAC

from examples.shared import parser, run, score
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score; return the exit status."""
    options = parser("sbx_sac", __doc__, 100_000, 64).parse_args(arguments)
    env = RoughTurningVecEnv("rough_turning", options.num_envs, reward_scale=1 / 3)
    layers = {"net_arch": [64, 64]}
    # One update per ten environment steps: more updates take time and gain little.
    updates = max(1, options.num_envs // 10)
    settings = {"gamma": 0.8, "learning_rate": 1e-3, "learning_starts": 2000, "gradient_steps": updates}
    model = SAC("MlpPolicy", env, seed=options.seed, policy_kwargs=layers, **settings)
    model.learn(options.steps)
    print(f"SAC after {model.num_timesteps} steps: {score(model, options.tuning_seeds)}")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
