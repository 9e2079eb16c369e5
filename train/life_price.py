"""Training rewards that charge edge life at another price than the environment's flat one."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.optimiser import USED_LIVES, worth
from turning_env import Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.scenario.laws import edge_price
from turning_env.vector_env import info_at_end_of_step

LIFE_PRICES = ("flat", "marginal", "end")
"""Charges for the edge's life; ``flat`` is the environment's."""


class LifePriceVecEnv(RoughTurningVecEnv):
    """Environments whose training rewards charge edge life at another price than the flat one.

    They add the difference of a potential of used life D to a step's reward. So the differences add
    up to the same over every whole edge, whatever the agent does (Ng, Harada and Russell 1999,
    without a discount; a broken edge counts as used up):

        marginal: price * D - integral of p from 0 to D; the reward charges D at its price p(D)
        end: price * D, and 0 at the edge's end, where the reward charges the whole edge

    A flat price makes an agent with little foresight use up a fresh edge too fast. With the
    discount in the potential's difference, this would not change.
    """

    def __init__(self, life_price: str, scenario: Scenario, *arguments: Any) -> None:
        """Make environments that charge an edge's life by one of ``LIFE_PRICES``.

        Args:
            life_price: "marginal" or "end".
            scenario: the scenario.
            *arguments: further arguments of ``RoughTurningVecEnv``.
        """
        super().__init__(scenario, *arguments)
        self._edge_price = 60.0 * edge_price(scenario)  # [s]
        self._used_lives = np.concatenate([[0.0], USED_LIVES])
        self._potentials = self._edge_price * self._used_lives
        self._potential_at_end = 0.0
        if life_price == "marginal":
            prices = worth(scenario).life
            integral = np.concatenate([[0.0], np.cumsum(prices) / len(prices)])
            self._potentials -= integral
            self._potential_at_end = float(self._potentials[-1])

    def potential(self, used_life: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the potential [s] of used life [-] of an edge in use, of any shape."""
        potential: NDArray[np.float64] = np.interp(used_life, self._used_lives, self._potentials)
        return potential

    def training_rewards(
        self, rewards: NDArray[np.float64], infos: dict[str, Any]
    ) -> NDArray[np.float64]:
        """Return rewards [s] plus the potential's difference."""
        used_life = np.minimum(info_at_end_of_step(infos, "used_life"), 1.0)
        is_broken = info_at_end_of_step(infos, "broken").astype(np.bool_)
        has_ended = (used_life >= 1.0) | is_broken
        # The reward's flat charge tells how much life the step has used.
        life_charge = info_at_end_of_step(infos, "reward_edge")
        used_life_before = used_life + life_charge / self._edge_price
        potential = np.where(has_ended, self._potential_at_end, self.potential(used_life))
        return rewards + potential - self.potential(used_life_before)
