"""Policies without knowledge of cutting: random, no and degenerate actions. A useful controller must beat them.

Degenerate policies do not machine sensibly: idle, cut as little as possible, break edges or change them all the time. If one
came near the top of a leaderboard, the reward could be gamed. They need nothing of the nominal model.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.fixed import FixedParameters
from baselines.rule import Array, Mask, Rule
from turning_env.physics.quantities import action_size
from turning_env.scenario import Scenario
from turning_env.scenario.scenario_batch import ScenarioBatch
from turning_env.scoring.policy import Actions, Observations, Policy

Words = NDArray[np.uint64]
Condition = Callable[[Scenario], bool]

_WEYL = np.uint64(0x9E3779B97F4A7C15)
_MIXERS = (
    (np.uint64(30), np.uint64(0xBF58476D1CE4E5B9)),
    (np.uint64(27), np.uint64(0x94D049BB133111EB)),
)


def mixed(words: Words) -> Words:
    """Return the words hashed one by one (SplitMix64: Steele, Lea and Flood, "Fast splittable generators", 2014)."""
    words = words + _WEYL
    for shift, multiplier in _MIXERS:
        words = (words ^ (words >> shift)) * multiplier
    return words ^ (words >> np.uint64(31))


class RandomActions(Policy):
    """A policy of a number of ``actions`` per environment, drawn uniformly.

    The random numbers are keyed by all observations since the environment's reset. So an episode of a seed is the same in any
    batch, and other seeds, with other bars, give other actions.
    """

    def __init__(self, num_envs: int, actions: int) -> None:
        self._keys = np.zeros(num_envs, np.uint64)
        self._numbers = np.arange(1, actions + 1, dtype=np.uint64)

    def reset(self, mask: Mask) -> None:
        self._keys[mask] = 0

    def act(self, observations: Observations) -> Actions:
        for entry in np.ascontiguousarray(observations.T, np.float32).view(np.uint32):
            self._keys = mixed(self._keys ^ entry)
        words = mixed(self._keys[:, np.newaxis] ^ self._numbers) >> np.uint64(40)
        return (words.astype(np.float32) + 0.5) * np.float32(2.0**-23) - np.float32(1.0)


class ConstantActions(Policy):
    """A policy of the same action at every step, of shape (action size,) or (num_envs, action size)."""

    def __init__(self, action: Actions) -> None:
        self._action = action

    def act(self, observations: Observations) -> Actions:
        return np.broadcast_to(self._action, (len(observations), self._action.shape[-1])).copy()


class FirstThen(Policy):
    """A policy that repeats an action for some steps, one number or shape (num_envs,), and then plays a policy without memory."""

    def __init__(
        self, num_envs: int, action: Actions, steps: float | Array, policy: Policy
    ) -> None:
        self._action, self._first_steps, self._policy = action, steps, policy
        self._steps = np.zeros(num_envs)

    def reset(self, mask: Mask) -> None:
        self._steps[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        first = self._steps < self._first_steps
        self._steps += 1.0
        then = self._action if first.all() else self._policy.act(observations)
        return np.where(first[:, np.newaxis], self._action, then)


def zero(scenario: Scenario) -> Actions:
    """Return the action of 0: incremental commands do not change; other commands lie in the middle of their ranges."""
    return np.zeros(action_size(scenario), np.float32)


def extreme(scenario: Scenario, end: float) -> Actions:
    """Return the action of the lowest (-1) or highest (1) speed and feed, in most passes or in one; no edge is changed."""
    action = np.full_like(zero(scenario), end)
    if scenario.control.action == "part":
        action[:2] = -end, 0.0  # number of passes, and the drawing's allowance
    if _changes_edges(scenario):
        action[-1] = -1.0
    return action


def _changing(action: Actions) -> Actions:
    return np.append(action[:-1], np.float32(1.0))


def _changes_edges(scenario: Scenario) -> bool:
    return scenario.control.edge_changes == "commanded"


def _wait_then_play(scenarios: Sequence[Scenario], num_envs: int) -> FirstThen:
    first, idle = scenarios[0], extreme(scenarios[0], -1.0)
    each: Any = first if len(scenarios) == 1 else ScenarioBatch.of(scenarios)
    if first.control.action == "part":
        return FirstThen(num_envs, idle, first.workpiece.bars / 2.0, ConstantActions(zero(first)))
    steps = each.control.time_limit * 60.0 / each.control.interval
    return FirstThen(num_envs, idle, steps / 2.0, FixedParameters.programmed(each))


def _rule(
    description: str,
    policy: Callable[[Sequence[Scenario], int], Policy],
    plays: Condition = lambda _: True,
) -> Rule:
    """Return a rule for one scenario or many."""

    def controller(scenario: Scenario | Sequence[Scenario], num_envs: int) -> Policy:
        return policy([scenario] if isinstance(scenario, Scenario) else scenario, num_envs)

    return Rule(description, controller, plays, {}, changes_edges=True, together=True)


def _constant(
    description: str, action: Callable[[Scenario], Actions], *plays: Callable[[Scenario], bool]
) -> Rule:
    return _rule(
        description, lambda scenarios, num_envs: ConstantActions(action(scenarios[0])), *plays
    )


DEGENERATE = {
    "idle": _constant(
        "degenerate: the lowest speed and feed; cuts as little as possible",
        lambda task: extreme(task, -1.0),
    ),
    "wait_then_play": _rule(
        "degenerate: idles for half of the episode, then the programmed speed and feed",
        _wait_then_play,
    ),
    "fastest": _constant(
        "degenerate: the highest speed and feed, until the edge breaks",
        lambda task: extreme(task, 1.0),
    ),
    "never_cut": _constant(
        "degenerate: idles and changes the edge in every step, which leaves next to no time to cut",
        lambda scenario: _changing(extreme(scenario, -1.0)),
        _changes_edges,
    ),
    "change_every_step": _constant(
        "degenerate: changes the edge in every step, at the programmed speed and feed",
        lambda scenario: _changing(zero(scenario)),
        _changes_edges,
    ),
}
"""Rules that do not machine sensibly, by name."""

RULES = {
    "random": _rule(
        "random actions, drawn evenly",
        lambda scenarios, num_envs: RandomActions(num_envs, action_size(scenarios[0])),
    ),
    "zero_action": _constant("no action: 0 for all of them", zero),
    **DEGENERATE,
}
