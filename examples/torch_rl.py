"""TorchRL: check the ids, and roll out the batch behind TorchRL's own wrapper.

python -m examples.torch_rl --steps 100000
"""

import sys
import time
from collections.abc import Sequence

import gymnasium
from gymnasium.vector import AutoresetMode

from examples.shared import parser, run
from turning_env import FAMILY_ID, IDS
from turning_env.extras import needed

with needed():
    from torchrl.envs import GymWrapper, check_env_specs  # type: ignore[import-untyped]


def main(arguments: Sequence[str] | None = None) -> int:
    """Check, roll out, print; return the exit status."""
    options = parser("torch_rl", __doc__, 100_000, 1024).parse_args(arguments)
    for env_id in (*IDS, FAMILY_ID):
        check_env_specs(
            GymWrapper(gymnasium.make_vec(env_id, 2, autoreset_mode=AutoresetMode.DISABLED))
        )
        print(f"{env_id}: checked")
    envs = GymWrapper(
        gymnasium.make_vec(
            "RoughTurning-v0", options.num_envs, autoreset_mode=AutoresetMode.DISABLED
        )
    )
    envs.set_seed(options.seed)
    start = time.perf_counter()
    rollout = envs.rollout(-(-options.steps // options.num_envs), break_when_any_done=False)
    speed = rollout.numel() / (time.perf_counter() - start)
    reward = rollout["next", "reward"].mean().item()
    print(
        f"random actions: {tuple(rollout.batch_size)}, mean reward {reward:.2f} s, {speed:.0f} steps per second"
    )
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
