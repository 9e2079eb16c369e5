"""Stable-Baselines3 and sb3-contrib, on the batch or on single environments.

    python -m examples.stable_baselines --algorithm ppo --total-timesteps 500000
    python -m examples.stable_baselines --algorithm sac --vec-env gymnasium --num-envs 8
    python -m examples.stable_baselines --env RoughTurning-Family-v1 --gamma 0.997

With ``--vec-env gymnasium``, Stable-Baselines3 makes single environments (``make_vec_env``) and
steps them one after the other. With ``batch``, the adapter in ``turning_env.adapters`` steps all
environments in one call, about thirty times as fast. ``python -m train.ppo`` and the other
trainings add checkpoints and a learning curve.
"""

import sys
from collections.abc import Sequence
from typing import Any

import torch
from gymnasium.wrappers import TransformReward
from sb3_contrib import TQC, RecurrentPPO
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv
from tqdm import tqdm

from examples.shared import at_least, parser, run, score
from turning_env import IDS
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv

ALGORITHMS = ("ppo", "recurrent_ppo", "sac", "tqc")


def make_envs(kind: str, env_id: str, num_envs: int, seed: int, reward_scale: float) -> VecEnv:
    """Return ``num_envs`` environments behind Stable-Baselines3's interface.

    Environment i plays seed + i.
    """
    if kind == "gymnasium":
        return make_vec_env(
            env_id,
            num_envs,
            seed,
            env_kwargs={"render_mode": None},  # its default draws frames
            wrapper_class=lambda env: TransformReward(
                env, lambda reward: reward_scale * float(reward)
            ),
        )
    # The family's id has no preset of its own.
    env = RoughTurningVecEnv(IDS.get(env_id, "shop"), num_envs, reward_scale=reward_scale)
    env.seed(seed)
    return env


def new_model(algorithm: str, env: VecEnv, seed: int, rollout: int, gamma: float) -> Any:
    """Return an untrained model, with ``rollout`` steps of all environments between updates.

    Without a change of edges a short horizon matters most: life is charged as it is used.
    """
    layers = {"net_arch": [64, 64], "activation_fn": torch.nn.ReLU}
    common: dict[str, Any] = {
        "learning_rate": 1e-3,
        "gamma": gamma,
        "seed": seed,
        "device": "cpu",
    }
    on_policy = common | {
        "n_steps": rollout // env.num_envs,
        "batch_size": 512,
        "n_epochs": 5,
    }
    off_policy = common | {
        "learning_starts": 2000,
        "batch_size": 256,
        "train_freq": 1,
        "tau": 0.01,
        "policy_kwargs": layers,
    }
    match algorithm:
        case "ppo":
            return PPO("MlpPolicy", env, **on_policy, policy_kwargs=layers | {"log_std_init": -1.0})
        case "recurrent_ppo":
            memory = {"lstm_hidden_size": 32, "net_arch": [64], "log_std_init": -1.0}
            return RecurrentPPO("MlpLstmPolicy", env, **on_policy, policy_kwargs=memory)
        case "sac":
            return SAC("MlpPolicy", env, **off_policy)
        case _:
            return TQC("MlpPolicy", env, **off_policy, top_quantiles_to_drop_per_net=2)


def main(arguments: Sequence[str] | None = None) -> int:
    """Train, score; return the exit status."""
    command_line = parser("stable_baselines", __doc__, 500_000, num_envs=64, ids=True)
    command_line.add_argument(
        "--algorithm", choices=ALGORITHMS, default="ppo", help="default: %(default)s"
    )
    command_line.add_argument(
        "--vec-env", choices=("batch", "gymnasium"), default="batch", help="default: %(default)s"
    )
    command_line.add_argument(
        "--rollout",
        type=at_least(2),
        default=4096,
        help="steps of all environments between two updates of ppo and recurrent_ppo "
        "(default: %(default)s)",
    )
    options = command_line.parse_args(arguments)
    # At least two steps of each environment between two updates.
    max_envs = options.rollout // 2
    if options.num_envs > max_envs:
        command_line.error(
            f"--num-envs is {options.num_envs}, but must be at most {max_envs}, half of --rollout"
        )
    env = make_envs(
        options.vec_env,
        options.env,
        num_envs=options.num_envs,
        seed=options.seed,
        reward_scale=options.reward_scale,
    )
    model = new_model(
        options.algorithm, env, seed=options.seed, rollout=options.rollout, gamma=options.gamma
    )
    with tqdm(total=options.total_timesteps, unit="step", unit_scale=True, disable=None) as bar:

        def on_step(_locals: dict[str, Any], _globals: dict[str, Any]) -> bool:
            bar.update(model.num_timesteps - bar.n)
            return True

        # Its own bar would need rich.
        model.learn(options.total_timesteps, callback=on_step)
    env.close()
    result = score(model, options.tuning_seeds, options.env)
    print(f"{options.algorithm} after {model.num_timesteps} steps: {result}")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
