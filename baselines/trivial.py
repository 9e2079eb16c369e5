"""Policies without knowledge of cutting: random actions, and actions of 0. A useful controller must beat them.

They need nothing of the nominal model.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from baselines.rule import Rule
from turning_env.physics.quantities import action_size
from turning_env.scoring.policy import Actions, Observations, Policy

Words = NDArray[np.uint64]

_WEYL = np.uint64(0x9E3779B97F4A7C15)
_MIXERS = ((np.uint64(30), np.uint64(0xBF58476D1CE4E5B9)), (np.uint64(27), np.uint64(0x94D049BB133111EB)))


def mixed(words: Words) -> Words:
    """Return the words hashed one by one (SplitMix64: Steele, Lea and Flood, "Fast splittable generators", 2014)."""
    words = words + _WEYL
    for shift, multiplier in _MIXERS:
        words = (words ^ (words >> shift)) * multiplier
    return words ^ (words >> np.uint64(31))


class RandomActions:
    """A policy of actions drawn uniformly from the action space.

    The random numbers are keyed by all observations since the environment's reset. So an episode of a seed is the same in any
    batch, and other seeds, with other bars, give other actions.

    Args:
        num_envs: number of environments.
        actions: number of actions per environment.
    """

    def __init__(self, num_envs: int, actions: int) -> None:
        self._keys = np.zeros(num_envs, np.uint64)
        self._numbers = np.arange(1, actions + 1, dtype=np.uint64)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget past observations."""
        self._keys[mask] = 0

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, action size), for observations, shape (num_envs, entries)."""
        for entry in np.ascontiguousarray(observations.T, np.float32).view(np.uint32):
            self._keys = mixed(self._keys ^ entry)
        words = mixed(self._keys[:, np.newaxis] ^ self._numbers) >> np.uint64(40)
        return (words.astype(np.float32) + 0.5) * np.float32(2.0**-23) - np.float32(1.0)


class ZeroActions(Policy):
    """A policy of actions 0: incremental commands do not change; other commands lie in the middle of their ranges.

    Args:
        num_envs: number of environments.
        actions: number of actions per environment.
    """

    def __init__(self, num_envs: int, actions: int) -> None:
        self._actions = np.zeros((num_envs, actions), np.float32)

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, action size)."""
        return self._actions


def _rule(description: str, policy: Callable[[int, int], Policy]) -> Rule:
    return Rule(
        description,
        lambda scenario, num_envs, parameters: policy(num_envs, action_size(scenario)),
        lambda scenario: True,
        {},
        changes_edges=True,
    )


RULES = {
    "random": _rule("random actions, drawn evenly", RandomActions),
    "zero_action": _rule("no action: 0 for all of them", ZeroActions),
}
