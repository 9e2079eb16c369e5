"""PPO that is given an allowance of overload in place of its price: train one agent for one training seed.

    python -m train.lagrangian_ppo --seed 0

The reward's term for overload is left out. In its place every second of severe overload costs a multiplier, which rises after a
rollout in which the share of cutting time severely overloaded is above its target, and falls after one in which it is below: dual
ascent on the logarithm of the multiplier (Ray, Achiam and Amodei 2019, "Benchmarking safe exploration in deep reinforcement
learning", section 5.2). The target is a share of ``limits.overload_allowance``, which leaves room for the confidence limit that
admits a policy. Running the same command again resumes an interrupted training, and does nothing if it is finished. What a run's
folder holds: ``train/training.py``.
"""

import math
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from optuna.distributions import FloatDistribution
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from train import command, ppo
from train.run import Run
from train.training import Algorithm
from train.vec_env import RoughTurningVecEnv, of_interval


class AllowanceVecEnv(RoughTurningVecEnv):
    """Lathes that charge a multiplier for severe overload; the returns told at an episode's end remain the environment's own."""

    multiplier = 1.0
    """What a second of severe overload costs [s]."""
    severe_share = 0.0
    """Share of cutting time severely overloaded, up to the last adaptation from the one before."""
    _severe_time = 0.0  # since the last adaptation [s]
    _engaged_time = 0.0  # likewise
    _has_overloaded = False

    def learned_rewards(self, rewards: NDArray[np.float64], infos: dict[str, Any]) -> NDArray[np.float64]:
        """Rewards without the price of overload, but with the multiplier's."""
        overload, severe, engaged = (of_interval(infos, name) for name in _TERMS)
        self._severe_time += float(severe.sum())
        self._engaged_time += float(engaged.sum())
        return rewards - overload - self.multiplier * severe

    def adapt(self, target: float, rate: float) -> None:
        """Let the multiplier follow the severe share since the last adaptation.

        It stays as it is until anything has been severely overloaded: where nothing can be, there is nothing to weigh.
        """
        if self._engaged_time > 0.0:
            self.severe_share = self._severe_time / self._engaged_time
            self._has_overloaded |= self.severe_share > 0.0
            if self._has_overloaded:
                self.multiplier *= math.exp(rate * (self.severe_share - target))
        self._severe_time = self._engaged_time = 0.0


_TERMS = ("reward_overload", "severe_overload_time", "engaged_time")  # all [s]


class DualAscent(BaseCallback):
    """Adapts the multiplier after each rollout."""

    def __init__(self, run: Run) -> None:
        super().__init__()
        self._target = run.parameters["share_of_allowance"] * run.scenario.limits.overload_allowance
        self._rate = run.parameters["multiplier_rate"]

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        lathes: Any = self.training_env
        lathes.adapt(self._target, self._rate)
        for name, value in columns(self.model).items():
            self.logger.record(f"overload/{name}", value)


def new_model(run: Run, lathes: RoughTurningVecEnv) -> PPO:
    """An untrained model of PPO, and the multiplier at its start."""
    assert isinstance(lathes, AllowanceVecEnv)
    lathes.multiplier = run.parameters["initial_multiplier"]
    return ppo.new_model(run, lathes)


def columns(model: Any) -> dict[str, float]:
    """How far the adaptation has come."""
    return {"multiplier": model.env.multiplier, "severe_share": model.env.severe_share}


actor = ppo.actor

SEARCH = ppo.SEARCH | {
    "multiplier_rate": FloatDistribution(0.1, 10.0, log=True),
    "share_of_allowance": FloatDistribution(0.5, 1.0),
}

ALGORITHM = Algorithm(
    *("lagrangian_ppo", "Lagrangian PPO", PPO, new_model, actor, SEARCH),
    lathes=AllowanceVecEnv,
    callbacks=lambda run: [DualAscent(run)],
    columns=columns,
)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    return command.main(ALGORITHM, arguments)


if __name__ == "__main__":
    sys.exit(main())
