"""Episodes of policies behind the shield, and policies that try to get past it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from turning_control.shield import Shield

from turning_env.observation import read
from turning_env.physics.quantities import action_size
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario import Scenario
from turning_env.vector_env import RoughTurningVectorEnv, info_at_end_of_step


class Guarded(NamedTuple):
    """Figures of episodes, each until its end or until the operator takes over."""

    severe: float  # share of cutting time with an excess above the tolerance, 5 % [-]
    edges_broken: int


def play_guarded(scenario: Scenario, policy: Policy, seeds: Sequence[int]) -> Guarded:
    """Play one episode per seed with a policy behind the shield."""
    num_envs = len(seeds)
    env = RoughTurningVectorEnv(num_envs, scenario, AutoresetMode.SAME_STEP)
    shield = Shield(policy, scenario, num_envs)
    observations, _ = env.reset(seed=list(seeds))
    shield.reset(np.ones(num_envs, np.bool_))
    sums = dict.fromkeys(("severe_overload_time", "engaged_time", "edges_broken"), 0.0)
    running = np.ones(num_envs, np.bool_)
    while running.any():
        actions = shield.act(observations)
        # The operator stops the machine, so the episode ends before the action.
        running &= ~shield.takeover
        observations, _, terminated, truncated, infos = env.step(actions)
        for name in sums:
            sums[name] += float((info_at_end_of_step(infos, name) * running).sum())
        ended = terminated | truncated
        shield.reset(ended)
        running &= ~ended
    severe = sums["severe_overload_time"] / max(sums["engaged_time"], 1e-9)
    return Guarded(severe=severe, edges_broken=round(sums["edges_broken"]))


class UniformRandom(Policy):
    """A policy of uniform random actions in -1..1."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._random = np.random.default_rng(0)

    def act(self, observations: Observations) -> Actions:
        shape = (len(observations), self._size)
        return self._random.uniform(-1.0, 1.0, shape).astype(np.float32)


@dataclass(frozen=True)
class Wave:
    """A square wave of actions over steps."""

    low: float  # action [-1..1]
    high: float  # action [-1..1]
    period: float  # [steps]
    share: float  # share of the period in which the action is the high one [-]

    def level(self, step: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the action at steps."""
        return np.where(step / self.period % 1.0 < self.share, self.high, self.low)


def switching(period: float) -> Wave:
    """Return the wave that switches from -1 to 1 and back; each lasts for ``period`` steps."""
    return Wave(low=-1.0, high=1.0, period=2.0 * period, share=0.5)


class Adversary(Policy):
    """A policy that tries to get past the shield: a wave of the speed, and one of the feed.

    The feed is high only while no load is above ``threshold`` times its limit, and, if ``entries``,
    only in air and in the first steps of a bar.
    """

    def __init__(
        self,
        scenario: Scenario,
        num_envs: int,
        speed: Wave,
        feed: Wave,
        threshold: float = np.inf,
        entry_steps: float = np.inf,
    ) -> None:
        self._scenario = scenario
        self._speed = speed
        self._feed = feed
        self._threshold = threshold
        self._entry_steps = entry_steps
        self._step = np.zeros(num_envs)
        self._in_metal = np.zeros(num_envs)  # [steps]

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Restart the waves of environments."""
        self._step[mask] = 0.0
        self._in_metal[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        """Return the actions of the waves."""
        reading = read(observations, self._scenario)
        limits = self._scenario.limits
        self._in_metal = np.where(reading.cutting, self._in_metal + 1.0, 0.0)
        load = np.maximum(reading.power / limits.power, reading.thrust_force / limits.thrust_force)
        may_be_high = (load < self._threshold) & (self._in_metal <= self._entry_steps)
        feed = np.where(may_be_high, self._feed.level(self._step), self._feed.low)

        # Entries after speed and feed change the edge, which adversaries never do.
        actions = np.full((len(feed), action_size(self._scenario)), -1.0, np.float32)
        if self._scenario.control.action == "override":
            actions[:, 0] = feed
        else:
            actions[:, 0] = self._speed.level(self._step)
            actions[:, 1] = feed
        self._step += 1.0
        return actions
