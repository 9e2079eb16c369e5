"""TorchRL: check the ids, and roll out the batch behind TorchRL's own wrapper.

python -m examples.torch_rl --total-timesteps 100000
"""

import math
import sys
import time
from collections.abc import Sequence

import gymnasium
from gymnasium.vector import AutoresetMode

from examples.shared import parser, run
from turning_env import ALL_IDS
from turning_env.extras import needed

with needed():
    import torch
    from torchrl.data import Composite, Unbounded  # type: ignore[import-untyped]
    from torchrl.envs import GymWrapper, check_env_specs  # type: ignore[import-untyped]
    from torchrl.envs.gym_like import default_info_dict_reader  # type: ignore[import-untyped]


def wrapped(env_id: str, num_envs: int) -> GymWrapper:
    """Return environments of an id behind TorchRL's wrapper, which resets them itself."""
    envs = gymnasium.make_vec(env_id, num_envs, autoreset_mode=AutoresetMode.DISABLED)
    return GymWrapper(envs)


def with_infos(envs: GymWrapper, names: Sequence[str]) -> GymWrapper:
    """Let rollouts hold entries of ``info``, such as the cost, of shape (num_envs,) each."""
    shape = envs.batch_size
    specs = {name: Unbounded(shape, dtype=torch.float64) for name in names}
    reader = default_info_dict_reader([*names], spec=Composite(specs, shape=shape))
    return envs.set_info_dict_reader(reader)


def main(arguments: Sequence[str] | None = None) -> int:
    """Check, roll out, print; return the exit status."""
    options = parser("torch_rl", __doc__, 100_000, num_envs=1024).parse_args(arguments)
    for env_id in ALL_IDS:
        check_env_specs(wrapped(env_id, num_envs=2))
        print(f"{env_id}: checked")

    # An episode's sum of costs decides whether a policy is feasible.
    envs = with_infos(wrapped("RoughTurning-v0", options.num_envs), ["cost"])
    envs.set_seed(options.seed)
    n_steps = math.ceil(options.total_timesteps / options.num_envs)
    start = time.perf_counter()
    rollout = envs.rollout(n_steps, break_when_any_done=False)
    speed = rollout.numel() / (time.perf_counter() - start)
    reward = rollout["next", "reward"].mean().item()
    cost = rollout["next", "cost"].mean().item()
    print(
        f"random actions: {tuple(rollout.batch_size)}, mean reward {reward:.2f} s, "
        f"mean cost {cost:.2f} s, {speed:.0f} steps per second"
    )
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
