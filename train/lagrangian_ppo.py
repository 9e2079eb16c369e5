"""Train PPO with an allowance of overload instead of its price, for one training seed.

    python -m train.lagrangian_ppo --seed 0

The reward's overload term is left out. Instead, a second of severe overload costs a multiplier.
After each rollout, the multiplier rises if the severely overloaded share of cutting time is above
its target, and falls if it is below. This is dual ascent on the logarithm of the multiplier (Ray,
Achiam and Amodei 2019, "Benchmarking safe exploration in deep reinforcement learning", section
5.2). The target is a share of ``limits.overload_allowance``. The rest is a margin, because a
confidence limit decides whether a policy is feasible. Without the margin this is the constraint on
``info["cost"]``: the severe share less the allowance is the cost of a second of cutting. The same
command resumes an interrupted training, and does nothing if training is finished. Files: see
``train/training.py``.
"""

import math
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from optuna.distributions import FloatDistribution
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from train import ppo
from train.run import Run
from train.training import Algorithm, command_line
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.vector_env import info_at_end_of_step


class AllowanceVecEnv(RoughTurningVecEnv):
    """Environments that charge a multiplier for severe overload.

    The returns in ``infos`` remain the environment's own.
    """

    multiplier = 1.0
    """Cost of a second of severe overload [s]."""
    severe_share = 0.0
    """Share of cutting time severely overloaded between the last two adaptations [-]."""
    _severe_time = 0.0  # since the last adaptation [s]
    _engaged_time = 0.0  # since the last adaptation [s]
    _has_overloaded = False

    def training_rewards(
        self, rewards: NDArray[np.float64], infos: dict[str, Any]
    ) -> NDArray[np.float64]:
        """Return rewards that charge the multiplier in place of the price of overload."""
        overload_reward = info_at_end_of_step(infos, "reward_overload")
        severe_time = info_at_end_of_step(infos, "severe_overload_time")
        engaged_time = info_at_end_of_step(infos, "engaged_time")
        self._severe_time += float(severe_time.sum())
        self._engaged_time += float(engaged_time.sum())
        return rewards - overload_reward - self.multiplier * severe_time

    def adapt(self, target: float, rate: float) -> None:
        """Change the multiplier's logarithm by ``rate`` per excess of the severe share [-].

        The multiplier is constant until the first severe overload: if overload is impossible, no
        price is needed.
        """
        if self._engaged_time > 0.0:
            # Dual ascent on the logarithm keeps the multiplier positive.
            self.severe_share = self._severe_time / self._engaged_time
            self._has_overloaded |= self.severe_share > 0.0
            if self._has_overloaded:
                self.multiplier *= math.exp(rate * (self.severe_share - target))
        self._severe_time = 0.0
        self._engaged_time = 0.0


class Adaptation(BaseCallback):
    """A callback that adapts the multiplier after each rollout."""

    def __init__(self, run: Run) -> None:
        super().__init__()
        self._target = run.parameters["share_of_allowance"] * run.scenario.limits.overload_allowance
        self._rate = run.parameters["multiplier_rate"]

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        vec_env: Any = self.training_env
        vec_env.adapt(self._target, self._rate)
        for name, value in columns(self.model).items():
            self.logger.record(f"overload/{name}", value)


def new_model(run: Run, vec_env: VecEnv) -> ppo.LeanPPO:
    """Return an untrained PPO model, and set the initial multiplier."""
    assert isinstance(vec_env, AllowanceVecEnv)
    vec_env.multiplier = run.parameters["initial_multiplier"]
    return ppo.new_model(run, vec_env)


def columns(model: Any) -> dict[str, float]:
    """Return the multiplier [s/s] and the severe share [-] for the learning curve."""
    return {"multiplier": model.env.multiplier, "severe_share": model.env.severe_share}


def callbacks(run: Run) -> list[BaseCallback]:
    """Return the callbacks of a training."""
    return [Adaptation(run)]


DEFAULTS: dict[str, Any] = {
    "total_timesteps": 6_000_000,  # environment steps of the whole training
    "num_envs": 128,  # environments side by side
    "n_steps": 128,  # steps per environment between updates
    "batch_size": 2048,
    "n_epochs": 5,
    # A horizon of about 5 s: life is charged as it is used, so a longer one only adds noise.
    "gamma": 0.8,
    "gae_lambda": 0.95,
    "learning_rate": 1e-3,  # falls linearly ...
    "final_learning_rate": 1e-5,  # ... to this
    "clip_range": 0.2,
    "ent_coef": 0.0,
    "vf_coef": 0.5,
    "max_grad_norm": 0.5,
    "net_arch": [64, 64],  # for policy and value function each
    "activation_fn": "relu",  # or "tanh"
    "log_std_init": -1.0,
    "reward_scale": 0.3333333333,  # factor on rewards [s]
    "initial_multiplier": 1.0,  # [s] per second of severe overload
    # Growth of its logarithm per rollout and excess share of severe overload.
    "multiplier_rate": 2.0,
    # Target over limits.overload_allowance: the finished agent overloads less than exploration.
    "share_of_allowance": 0.9,
}

SEARCH = ppo.SEARCH | {
    "multiplier_rate": FloatDistribution(0.1, 10.0, log=True),
    "share_of_allowance": FloatDistribution(0.5, 1.0),
}

ALGORITHM = Algorithm(
    name="lagrangian_ppo",
    model=ppo.LeanPPO,
    new_model=new_model,
    network=ppo.network,
    defaults=DEFAULTS,
    search=SEARCH,
    training_information=("rewards", "overload share"),
    vec_env=AllowanceVecEnv,
    callbacks=callbacks,
    columns=columns,
    families=False,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
