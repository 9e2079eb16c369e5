"""The terms of a training: what an agent sees beside the present observation, and how it is charged for edges.

The same three hyperparameters mean the same for every algorithm that has them:

    position = true          # readings of the tool's position along the bar (DistanceTracker in train/analytic_actor.py)
    frames = 4               # number of successive observations, with their positions
    life_price = "marginal"  # "flat": the environment's; "marginal": p(D); "end": the whole edge at its end

The trained agent needs nothing else at run time: position and earlier observations are part of its actor and of its file.
"""

import inspect
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import torch
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecFrameStack

from baselines.models.edge_value import USED_LIVES, worth
from train.actor import Actor
from train.analytic_actor import DistanceTracker, TargetCommands
from train.model_gain import edge_price
from train.run import Run
from turning_env import Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.vector_env import info_at_end_of_step


def used_life_and_end(infos: dict[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return used life [-] at the step's end, and whether the edge is worn out or broken, each of shape (num_envs,)."""
    used = np.minimum(info_at_end_of_step(infos, "used_life"), 1.0)
    return used, (used >= 1.0) | info_at_end_of_step(infos, "broken").astype(np.bool_)


class ChargedAtEnd(RoughTurningVecEnv):
    """Environments whose training rewards charge the whole price of an edge when it is worn out or broken."""

    def training_rewards(self, rewards: NDArray[np.float64], infos: dict[str, Any]) -> NDArray[np.float64]:
        """Return rewards [s] that charge used life at the edge's end."""
        used, ended = used_life_and_end(infos)
        # The reward already charges a broken edge for the life that was left, so only the used life is charged here.
        return (
            rewards
            - info_at_end_of_step(infos, "reward_edge")
            - np.where(ended, edge_price(self.vector_env.scenario) * used, 0.0)
        )


class ChargedMarginally(RoughTurningVecEnv):
    """Environments whose training rewards charge used life D at its marginal price p(D) instead of the flat price.

    They add the difference of a potential of D to a step's reward:

        price D - integral of p from 0 to D

    The differences add up to the same over every whole edge, whatever the agent does (Ng, Harada and Russell 1999, without a
    discount; a broken edge counts as used up). A flat price makes an agent with little foresight use up a fresh edge too fast.
    With the discount in the potential's difference, this would not change.
    """

    def __init__(self, scenario: Scenario, num_envs: int, reward_scale: float = 1.0) -> None:
        super().__init__(scenario, num_envs, reward_scale)
        prices = worth(scenario, scenario.economics.overload_price).life
        self._price = edge_price(scenario)
        self._used_lives = np.concatenate([[0.0], USED_LIVES])
        integral = np.concatenate([[0.0], np.cumsum(prices) / len(prices)])
        self._potentials = self._price * self._used_lives - integral

    def potential(self, used: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the potential [s] of used life [-], of any shape."""
        potential: NDArray[np.float64] = np.interp(used, self._used_lives, self._potentials)
        return potential

    def training_rewards(self, rewards: NDArray[np.float64], infos: dict[str, Any]) -> NDArray[np.float64]:
        """Return rewards [s] plus the potential's difference."""
        used, ended = used_life_and_end(infos)
        before = used + info_at_end_of_step(infos, "reward_edge") / self._price
        return rewards + self.potential(np.where(ended, 1.0, used)) - self.potential(before)


class _Resumable(VecEnvWrapper):
    """A wrapper that a checkpoint can hold: the library's keeps its class's members, which cannot be pickled."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "class_attributes"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.class_attributes = dict(inspect.getmembers(type(self)))


class Stacked(_Resumable, VecFrameStack):
    """Environments that return their last observations together, latest last, 0 before an episode's first."""


class Located(_Resumable):
    """Environments whose observations end with the readings of a ``DistanceTracker``."""

    def __init__(self, venv: VecEnv, scenario: Scenario) -> None:
        self._tracker = DistanceTracker(scenario, TargetCommands(scenario))
        space = venv.observation_space
        assert isinstance(space, Box)
        low, high = (np.append(end, np.full(self._tracker.READINGS, one)) for end, one in ((space.low, -1.0), (space.high, 1.0)))
        super().__init__(venv, Box(low.astype(np.float32), high.astype(np.float32)))
        self._state = torch.zeros(venv.num_envs, self._tracker.STATES)

    def reset(self) -> NDArray[np.float32]:
        """Return first observations, shape (num_envs, entries)."""
        self._state[:] = 0.0
        observations: Any = self.venv.reset()
        return self._located(observations)

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        found: Any = self.venv.step_wait()
        observations, rewards, ended, infos = found
        indices = np.flatnonzero(ended)
        if len(indices):
            last = observations.copy()
            last[indices] = [infos[index]["terminal_observation"] for index in indices]
            before, located = self._state, self._located(last)
            for index in indices:
                infos[index]["terminal_observation"] = located[index]
            self._state = before  # of the environments that go on; the others begin anew
            self._state[torch.from_numpy(ended)] = 0.0
        return self._located(observations), rewards, ended, infos

    def _located(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        readings, self._state = self._tracker(torch.from_numpy(observations), self._state)
        return np.concatenate([observations, readings.numpy()], axis=1)


class LocatedActor(Actor):
    """An actor that is also shown the readings of a ``DistanceTracker``; the memory holds the tracker's state, then its own."""

    def __init__(self, actor: Actor, scenario: Scenario) -> None:
        super().__init__()
        self.actor = actor
        self.commands = TargetCommands(scenario)
        self.tracker = DistanceTracker(scenario, self.commands)
        self.memory_size = self.tracker.STATES + actor.memory_size

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        state, own = memory[:, : self.tracker.STATES], memory[:, self.tracker.STATES :]
        readings, state = self.tracker(observation, state)
        action, own = self.actor(torch.cat([observation, readings], dim=1), own)
        return action, torch.cat([state, own], dim=1)


class StackedActor(Actor):
    """An actor that is shown the last ``frames`` observations, latest last, 0 before an episode's first.

    The memory holds all but the present one, then that of the actor.
    """

    def __init__(self, actor: Actor, frames: int, entries: int) -> None:
        """``entries``: number of entries of one observation."""
        super().__init__()
        self.actor = actor
        self.entries, self.earlier = entries, (frames - 1) * entries
        self.memory_size = self.earlier + actor.memory_size

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        stacked = torch.cat([memory[:, : self.earlier], observation], dim=1)
        action, own = self.actor(stacked, memory[:, self.earlier :])
        return action, torch.cat([stacked[:, self.entries :], own], dim=1)


LIFE_PRICES: dict[str, type[RoughTurningVecEnv]] = {
    "flat": RoughTurningVecEnv,
    "marginal": ChargedMarginally,
    "end": ChargedAtEnd,
}
"""Training environments by the charge for the edge's life."""


@dataclass(frozen=True)
class Terms:
    """The terms of one training. Hyperparameters that an algorithm lacks have the values below.

    Raises:
        ValueError: a value is not allowed.
    """

    scenario: Scenario
    position: bool = False
    frames: int = 1
    life_price: str = "flat"

    def __post_init__(self) -> None:
        if self.life_price not in LIFE_PRICES:
            raise ValueError(f"life_price is {self.life_price!r}, but must be one of {', '.join(LIFE_PRICES)}")
        if not 1 <= self.frames <= 100:
            raise ValueError(f"frames is {self.frames}, but must be 1 to 100")

    @classmethod
    def of(cls, run: Run) -> Self:
        """Return the terms of a run."""
        names = ("position", "frames", "life_price")
        return cls(run.scenario, **{name: run.parameters[name] for name in names if name in run.parameters})

    def shown(self, vec_env: VecEnv) -> VecEnv:
        """Return environments that show what the agent sees."""
        if self.position:
            vec_env = Located(vec_env, self.scenario)
        return Stacked(vec_env, self.frames) if self.frames > 1 else vec_env

    def actor(self, actor: Actor, entries: int) -> Actor:
        """Return the actor on plain observations for one that sees what ``shown`` shows, ``entries`` entries."""
        if self.frames > 1:
            actor = StackedActor(actor, self.frames, entries // self.frames)
        return LocatedActor(actor, self.scenario) if self.position else actor
