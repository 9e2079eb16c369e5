"""Policies without knowledge of cutting: random, no and degenerate actions.

A useful controller must beat them. Degenerate policies do not machine sensibly: idle, cut as little
as possible, break edges or change them all the time. If one came near the top of a leaderboard, the
reward could be gamed. They use nothing from the nominal model.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.fixed import FixedParameters
from baselines.rule import Array, Mask, Rule, Scenarios
from turning_env.physics.quantities import action_size
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario import Scenario
from turning_env.scenario.scenario_batch import ScenarioBatch

Words = NDArray[np.uint64]


def mixed(words: Words) -> Words:
    """Return the words hashed one by one.

    The hash is SplitMix64 (Steele, Lea and Flood, "Fast splittable generators", 2014).
    """
    words = words + np.uint64(0x9E3779B97F4A7C15)
    words = words ^ (words >> np.uint64(30))
    words = words * np.uint64(0xBF58476D1CE4E5B9)
    words = words ^ (words >> np.uint64(27))
    words = words * np.uint64(0x94D049BB133111EB)
    return words ^ (words >> np.uint64(31))


class RandomActions(Policy):
    """A policy of actions that are drawn uniformly.

    The random numbers are keyed by all observations since the environment's reset. So an episode of
    a seed is the same in any batch, and other seeds, with other bars, give other actions.

    Args:
        num_envs: number of environments.
        actions: number of actions of each.
    """

    def __init__(self, num_envs: int, actions: int) -> None:
        self._keys = np.zeros(num_envs, np.uint64)
        self._numbers = np.arange(1, actions + 1, dtype=np.uint64)

    def reset(self, mask: Mask) -> None:
        self._keys[mask] = 0

    def act(self, observations: Observations) -> Actions:
        columns = np.ascontiguousarray(observations.T, np.float32)
        for entry in columns.view(np.uint32):
            self._keys = mixed(self._keys ^ entry)
        words = mixed(self._keys[:, np.newaxis] ^ self._numbers)
        # The upper 24 bits of a word fit the mantissa of a float32, so each value is exact.
        numbers = (words >> np.uint64(40)).astype(np.float32)
        share = (numbers + 0.5) * np.float32(2.0**-23)  # of 0..2
        return share - np.float32(1.0)


class ConstantActions(Policy):
    """A policy of the same action at every step.

    ``action`` has the shape (action size,) or (num_envs, action size).
    """

    def __init__(self, action: Actions) -> None:
        self._action = action

    def act(self, observations: Observations) -> Actions:
        return np.broadcast_to(self._action, (len(observations), self._action.shape[-1])).copy()


class FirstThen(Policy):
    """A policy that repeats an action for some steps, and then plays another policy.

    Args:
        num_envs: number of environments.
        action: the action to repeat.
        steps: number of steps for which it is repeated, one number or of shape (num_envs,).
        policy: the policy that follows, which has no memory.
    """

    def __init__(
        self, num_envs: int, action: Actions, steps: float | Array, policy: Policy
    ) -> None:
        self._action = action
        self._first_steps = steps
        self._policy = policy
        self._steps = np.zeros(num_envs)

    def reset(self, mask: Mask) -> None:
        self._steps[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        first = self._steps < self._first_steps
        self._steps += 1.0
        then = self._action if first.all() else self._policy.act(observations)
        return np.where(first[:, np.newaxis], self._action, then)


def zero(scenario: Scenario) -> Actions:
    """Return the action of 0.

    Incremental commands do not change; other commands lie in the middle of their ranges.
    """
    return np.zeros(action_size(scenario), np.float32)


def extreme(scenario: Scenario, end: float) -> Actions:
    """Return the action of the lowest (-1) or highest (1) speed and feed; no edge is changed.

    A part is cut in most passes, or in one.
    """
    action = np.full_like(zero(scenario), end)
    if scenario.control.action == "part":
        action[0] = -end  # number of passes
        action[1] = 0.0  # the drawing's allowance
    if _changes_edges(scenario):
        action[-1] = -1.0
    return action


def _changing(action: Actions) -> Actions:
    """Return an action that also changes the edge."""
    return np.append(action[:-1], np.float32(1.0))


def _changes_edges(scenario: Scenario) -> bool:
    return scenario.control.edge_changes == "commanded"


def _always(scenario: Scenario) -> bool:
    return True


def _wait_then_play(scenarios: Sequence[Scenario], num_envs: int) -> FirstThen:
    """Return a policy that idles for half of an episode, then cuts as programmed.

    ``scenarios``: one for all environments, or one for each; their actions are alike.
    """
    first = scenarios[0]
    idle = extreme(first, -1.0)
    policy: Policy
    if first.control.action == "part":
        steps = first.workpiece.bars
        policy = ConstantActions(zero(first))
        return FirstThen(num_envs, idle, steps=steps / 2.0, policy=policy)
    # The values of a batch are arrays, so each environment idles for half of its episode.
    batch: Any = first
    if len(scenarios) > 1:
        batch = ScenarioBatch.of(scenarios)
    seconds = batch.control.time_limit * 60.0
    steps = seconds / batch.control.interval
    policy = FixedParameters.programmed(batch)
    return FirstThen(num_envs, idle, steps=steps / 2.0, policy=policy)


def _rule(
    description: str,
    policy: Callable[[Sequence[Scenario], int], Policy],
    plays: Callable[[Scenario], bool] = _always,
) -> Rule:
    """Return a rule for one scenario or many."""

    def build(scenario: Scenarios, num_envs: int) -> Policy:
        scenarios = [scenario] if isinstance(scenario, Scenario) else scenario
        return policy(scenarios, num_envs)

    return Rule(description, build, plays=plays, parameters={}, changes_edges=True, together=True)


def _constant(
    description: str,
    action: Callable[[Scenario], Actions],
    plays: Callable[[Scenario], bool] = _always,
) -> Rule:
    """Return the rule of a constant action."""

    def build(scenarios: Sequence[Scenario], num_envs: int) -> ConstantActions:
        return ConstantActions(action(scenarios[0]))

    return _rule(description, build, plays=plays)


def _random(scenarios: Sequence[Scenario], num_envs: int) -> RandomActions:
    return RandomActions(num_envs, action_size(scenarios[0]))


DEGENERATE = {
    "idle": _constant(
        "degenerate: the lowest speed and feed; cuts as little as possible",
        lambda scenario: extreme(scenario, -1.0),
    ),
    "wait_then_play": _rule(
        "degenerate: idles for half of the episode, then the programmed speed and feed",
        _wait_then_play,
    ),
    "fastest": _constant(
        "degenerate: the highest speed and feed, until the edge breaks",
        lambda scenario: extreme(scenario, 1.0),
    ),
    "never_cut": _constant(
        "degenerate: idles and changes the edge in every step, which leaves next to no time to cut",
        lambda scenario: _changing(extreme(scenario, -1.0)),
        plays=_changes_edges,
    ),
    "change_every_step": _constant(
        "degenerate: changes the edge in every step, at the programmed speed and feed",
        lambda scenario: _changing(zero(scenario)),
        plays=_changes_edges,
    ),
}
"""Rules that do not machine sensibly, by name."""

RULES = {
    "random": _rule("random actions, drawn evenly", _random),
    "zero_action": _constant("no action: 0 for all of them", zero),
    **DEGENERATE,
}
