"""Lathes that tell afterwards what was true in an interval. A teacher may know that; an agent never sees it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.vec_env import RoughTurningVecEnv, of_interval
from turning_env import Scenario

Array = NDArray[np.float64]

FIELDS = ("path", "depth_of_cut", "hardness", "used_life")
"""Told of the start and the end of every interval, with the units of ``info``; depth and hardness are 0 in air."""


class HindsightVecEnv(RoughTurningVecEnv):
    """``RoughTurningVecEnv`` with the truth of the last interval."""

    before: Array
    """At its start, shape (len(FIELDS), count)."""
    after: Array
    """At its end, likewise; an edge that was changed in it is the fresh one."""
    changed: NDArray[np.bool_]
    """Whether the edge was changed in it, shape (count,)."""
    failed: NDArray[np.bool_]
    """Whether that was because it was found worn out or broken, likewise."""

    def __init__(self, scenario: Scenario, count: int, reward_scale: float = 1.0) -> None:
        super().__init__(scenario, count, reward_scale)
        self._now = np.zeros((len(FIELDS), count))
        self._commands_changes = scenario.control.edge_changes == "commanded"

    def reset(self) -> NDArray[np.float32]:
        """First observations. The tool stands in the air before the first bar."""
        self._now = np.zeros_like(self._now)
        return super().reset()

    def learned_rewards(self, rewards: Array, infos: dict[str, Any]) -> Array:
        """The rewards themselves; on the way, the truth is kept."""
        self.before = self._now
        self.after = np.stack([of_interval(infos, name) for name in FIELDS])
        self.changed = of_interval(infos, "stopped_time") > 0.0
        commanded = self._actions[:, -1] > 0.0 if self._commands_changes else False
        self.failed = self.changed & ~np.asarray(commanded)
        self._now = np.stack([infos[name] for name in FIELDS])
        return rewards
