"""TorchRL: its checks, one environment, and many at once.

    python examples/torch_rl.py --steps 100000

Many at once are the project's vector environment behind ``GymWrapper``, in the autoreset mode that TorchRL prefers. (``GymEnv``
with ``num_envs`` starts a process for each instead; there the id must name its package: ``turning_env:RoughTurning-v0``.)
"""

import argparse
import sys
import time
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode

import turning_env
from examples.shared import ENV_ID, at_least, extra, run
from turning_env.console import described

with extra("ecosystem"):
    from tensordict import TensorDictBase  # type: ignore[import-untyped]
    from torchrl.data import Unbounded  # type: ignore[import-untyped]
    from torchrl.envs import GymWrapper, SerialEnv, check_env_specs, default_info_dict_reader  # type: ignore[import-untyped]
    from torchrl.envs.libs.gym import GymEnv  # type: ignore[import-untyped]

SEEN = ["thrust_force", "power", "wear"]
"""Entries of ``info`` that are recorded beside observations [N, kW, mm]."""


class PlainNumbers(default_info_dict_reader):  # type: ignore[misc]
    """Reads entries of ``info`` that are plain numbers; TorchRL's own reader takes NumPy's alone."""

    def __call__(self, info_dict: dict[str, Any], tensordict: TensorDictBase) -> TensorDictBase:
        return super().__call__({name: np.float64(info_dict[name]) for name in SEEN}, tensordict)


def one(env_id: str, seed: int) -> GymEnv:
    """Return a single environment that has passed TorchRL's own check."""
    env = GymEnv(env_id)
    env.set_info_dict_reader(PlainNumbers(SEEN, [Unbounded((), dtype=torch.float64)] * len(SEEN)))
    check_env_specs(env)
    env.set_seed(seed)
    return env


def serial(num_envs: int, seed: int) -> SerialEnv:
    """Return single environments one after the other. TorchRL derives all seeds but the first by a formula of its own."""
    envs = SerialEnv(num_envs, lambda: GymEnv(ENV_ID))
    envs.set_seed(seed)
    return envs


def batch(num_envs: int, seed: int) -> GymWrapper:
    """Return environments side by side; environment i plays the episodes of seed + i."""
    vector = gymnasium.make_vec(ENV_ID, num_envs, vectorization_mode="vector_entry_point", autoreset_mode=AutoresetMode.DISABLED)
    envs = GymWrapper(vector)
    check_env_specs(envs)
    envs.set_seed(seed)
    return envs


def summary(name: str, rollout: TensorDictBase, seconds: float) -> str:
    """Return a rollout's shape, its mean reward [s per step] and how fast it was, for people."""
    reward = rollout["next", "reward"].mean().item()
    return f"{name}: {tuple(rollout.batch_size)}, mean reward {reward:.2f} s, {rollout.numel() / seconds:.0f} steps per second"


def main(arguments: Sequence[str] | None = None) -> int:
    """Check, roll out, print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python examples/torch_rl.py", **described(__doc__))
    parser.add_argument("--steps", type=at_least(1), default=100_000, help="of all environments (default: %(default)s)")
    parser.add_argument("--num-envs", type=at_least(1), default=1024, help="environments side by side (default: %(default)s)")
    parser.add_argument("--seed", type=at_least(0), default=0, help="default: %(default)s")
    options = parser.parse_args(arguments)
    for env_id in turning_env.IDS:
        rollout = one(env_id, options.seed).rollout(10)
        force, power, wear = (rollout["next", name][-1].item() for name in SEEN)
        print(f"{env_id}: checked; after {len(rollout)} steps {force:.0f} N, {power:.2f} kW, {wear:.3f} mm of wear")
    few, many = min(options.num_envs, 4), -(-options.steps // options.num_envs)
    for name, envs, steps in (
        (f"SerialEnv of {few}", serial(few, options.seed), min(options.steps, 1000)),
        (f"GymWrapper of {options.num_envs} environments", batch(options.num_envs, options.seed), many),
    ):
        start = time.perf_counter()
        rollout = envs.rollout(steps, break_when_any_done=False)
        print(summary(name, rollout, time.perf_counter() - start))
        envs.close()
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
