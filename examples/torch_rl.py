"""TorchRL: check the ids, and roll out the batch with the project's adapter.

python -m examples.torch_rl --steps 100000
"""

import sys
import time
from collections.abc import Sequence

from examples.shared import parser, run
from turning_env import IDS
from turning_env.adapters.torchrl import RoughTurningTorchEnv
from turning_env.extras import needed

with needed():
    from torchrl.envs import check_env_specs  # type: ignore[import-untyped]

SEEN = ("thrust_force", "power", "wear")
"""Entries of ``info`` to record beside observations [N], [kW], [mm]."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Check, roll out, print; return the exit status."""
    options = parser("torch_rl", __doc__, 100_000, 1024).parse_args(arguments)
    for env_id, preset in IDS.items():
        env = RoughTurningTorchEnv(2, preset, info=SEEN)
        check_env_specs(env)
        force, power, wear = (env.rollout(10)["next", name][0, -1].item() for name in SEEN)
        print(f"{env_id}: checked; after 10 steps {force:.0f} N, {power:.2f} kW, {wear:.3f} mm of wear")
    envs = RoughTurningTorchEnv(options.num_envs)
    envs.set_seed(options.seed)
    start = time.perf_counter()
    rollout = envs.rollout(-(-options.steps // options.num_envs), break_when_any_done=False)
    speed = rollout.numel() / (time.perf_counter() - start)
    reward = rollout["next", "reward"].mean().item()
    print(f"random actions: {tuple(rollout.batch_size)}, mean reward {reward:.2f} s, {speed:.0f} steps per second")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
