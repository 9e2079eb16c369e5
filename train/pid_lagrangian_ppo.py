"""Train PPO with an allowance of overload, enforced by a PID controller of the multiplier, for one training seed.

    python -m train.pid_lagrangian_ppo --seed 0

It differs from ``train/lagrangian_ppo.py`` in the rule that sets the multiplier after each rollout (Stooke, Achiam and Abbeel
2020, "Responsive safety in reinforcement learning by PID Lagrangian methods", algorithm 2). With the excess e of the severely
overloaded share of cutting time over its target:

    multiplier = max(0, gain_p e + integral + gain_d max(0, rise of the smoothed share))
    integral = max(0, integral + gain_i e)

The proportional and the derivative term damp the oscillation of pure dual ascent, which is integral control. PPO normalises
advantages, so a large multiplier does not lengthen its steps. The same command resumes an interrupted training, and does nothing
if training is finished. Files: see ``train/training.py``.
"""

import dataclasses
import sys
from collections.abc import Mapping
from functools import partial
from typing import Any

from optuna.distributions import FloatDistribution

from train import lagrangian_ppo, ppo
from train.lagrangian_ppo import AllowanceVecEnv
from train.training import command_line


class PidVecEnv(AllowanceVecEnv):
    """Environments that charge the multiplier that a PID controller sets."""

    _integral: float | None = None  # [s/s]; the initial multiplier at first
    _smoothed_share = 0.0  # severe share of cutting time, exponentially smoothed over rollouts [-]

    def next_multiplier(self, excess: float, parameters: Mapping[str, Any]) -> float:
        """Return max(0, P + I + D) for the excess of the severe share over its target [-]."""
        integral = self.multiplier if self._integral is None else self._integral
        rise = (1.0 - parameters["smoothing"]) * (self.severe_share - self._smoothed_share)
        self._integral = max(0.0, integral + parameters["gain_i"] * excess)
        self._smoothed_share += rise
        multiplier: float = parameters["gain_p"] * excess + self._integral + parameters["gain_d"] * max(0.0, rise)
        return max(0.0, multiplier)


SEARCH = ppo.SEARCH | {
    "gain_p": FloatDistribution(1.0, 100.0, log=True),
    "gain_i": FloatDistribution(1.0, 100.0, log=True),
    "gain_d": FloatDistribution(1.0, 100.0, log=True),
    "share_of_allowance": FloatDistribution(0.5, 1.0),
}

ALGORITHM = dataclasses.replace(
    lagrangian_ppo.ALGORITHM,
    name="pid_lagrangian_ppo",
    title="Lagrangian PPO with PID control",
    search=SEARCH,
    vec_env=PidVecEnv,
)


main = partial(command_line, ALGORITHM)

if __name__ == "__main__":
    sys.exit(main())
