"""SBX, Stable-Baselines3 in JAX: SAC on the batch, with the adapter for Stable-Baselines3.

python -m examples.sbx_sac --total-timesteps 100000
python -m examples.sbx_sac --env RoughTurning-Override-v1 --gamma 0.98
"""

import sys
from collections.abc import Sequence

from sbx import SAC

from examples.shared import parser, run, score
from turning_env import IDS
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score; return the exit status."""
    options = parser("sbx_sac", __doc__, 100_000, num_envs=64, ids=True).parse_args(arguments)
    env = RoughTurningVecEnv(
        IDS.get(options.env, "shop"), options.num_envs, reward_scale=options.reward_scale
    )
    model = SAC(
        "MlpPolicy",
        env,
        gamma=options.gamma,
        learning_rate=1e-3,
        learning_starts=2000,
        # One update per ten environment steps: more updates take time and gain little.
        gradient_steps=max(1, options.num_envs // 10),
        policy_kwargs={"net_arch": [64, 64]},
        seed=options.seed,
    )
    model.learn(options.total_timesteps)
    result = score(model, options.tuning_seeds, options.env)
    print(f"SAC after {model.num_timesteps} steps: {result}")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
